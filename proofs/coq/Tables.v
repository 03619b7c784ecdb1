(** * The tables of F1, F2 and F3: a row holds of the state where it holds of the trace *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Computed Slots Invariant Runs.
Import ListNotations.
Open Scope N_scope.

Lemma answer_same rows computed o : same rows computed -> (answer rows o <-> first_reason computed = o).
Proof.
  intros H. rewrite (answer_first rows computed o H). enough (first_of computed = first_reason computed) as -> by reflexivity.
  clear. induction computed as [|[why [|]] rest IH]; cbn; auto.
Qed.
Lemma first_app a b : first_reason (a ++ b) = match first_reason a with Some why => Some why | None => first_reason b end.
Proof. induction a as [|[why [|]] a IH]; cbn; auto. Qed.

Section Of.
Variables (cfg : config) (tr : trace) (s : state).
Hypothesis G : good cfg tr s.
(** What an open timestamp was forwarded, held or answered. *)
Lemma open_endings t sl e : lookup t (opened s) = Some sl -> In e (endings t tr) ->
  is_progressive cfg = true /\ exists p, e = Sent p.
Proof.
  intros L I. assert (R := a_running _ _ _ _ (g_traced _ _ _ G t sl L)). unfold running in R.
  destruct (is_progressive cfg); [|rewrite R in I; contradiction]. split; auto. destruct R as (ps & R & _).
  rewrite R in I. apply in_map_iff in I as (p & <- & _). eauto.
Qed.
Lemma open_not_retired t sl : lookup t (opened s) = Some sl -> ~ says tr (retires cfg t).
Proof.
  intros L (d & I & H). assert (E : forall e, In e (end_of t d) -> is_progressive cfg = true /\ exists p, e = Sent p).
  { intros e J. apply (open_endings t sl e L). apply in_flat_map. exists (Did d). auto. }
  destruct d as [| | | | | | |n u q|n u q|n u|]; cbn in H; try contradiction.
  - destruct H as [-> NP]. destruct (E (Sent q)); [cbn; rewrite N.eqb_refl; now left|congruence].
  - subst u. destruct (E (Ended q)) as [_ (p & [=])]. cbn. rewrite N.eqb_refl. now left.
  - subst u. destruct (E Missed) as [_ (p & [=])]. cbn. rewrite N.eqb_refl. now left.
Qed.
Lemma is_open_iff t : is_open s t = true <-> says tr (opens t) /\ ~ says tr (retires cfg t).
Proof.
  unfold is_open. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - split; auto. intros _. split; [apply (a_open _ _ _ _ (g_traced _ _ _ G t sl L))|now apply (open_not_retired t sl)].
  - split; [discriminate|]. intros [O N]. destruct (g_open _ _ _ G t O); contradiction.
Qed.
Lemma not_open_iff t : ~ says tr (opens t) \/ says tr (retires cfg t) <-> is_open s t = false.
Proof.
  rewrite <- not_true_iff_false, is_open_iff. destruct (says_dec tr (opens t) (opens_dec t)),
    (says_dec tr (retires cfg t) (retires_dec cfg t)); tauto.
Qed.
Lemma in_slot t : is_open s t = true -> lookup t (opened s) = Some (slot_of s t).
Proof. unfold is_open, slot_of. destruct (lookup t (opened s)); congruence. Qed.

Hypothesis newest_opened : forall n, newest s = Some n -> says tr (opens n).
Lemma reached_iff t : (exists u, t <= u /\ says tr (opens u)) <-> reached s t = true.
Proof.
  split.
  - intros (u & L & d & I & O). assert (X : reached s u = true).
    { apply (g_about _ _ _ G). exists d. split; auto. now apply opens_about in O. }
    unfold reached in *. destruct (newest s); [|discriminate]. apply N.leb_le in X. apply N.leb_le. lia.
  - unfold reached. destruct (newest s) as [n|] eqn:N; [|discriminate]. intros L. apply N.leb_le in L. eauto.
Qed.
Lemma not_reached_iff t : not_reached tr t <-> reached s t = false.
Proof.
  rewrite <- not_true_iff_false, <- reached_iff. unfold not_reached. split; [intros H (u & L & O); now apply (H u)|].
  intros H u L O. apply H. eauto.
Qed.
Lemma full_iff n : at_least_open cfg tr n <-> n <= N.of_nat (length (opened s)).
Proof.
  split.
  - intros (ts & D & L & H). rewrite <- (map_length fst (opened s)).
    assert (X := NoDup_incl_length (l' := map fst (opened s)) D). enough (incl ts (map fst (opened s))) by (specialize (X H0); lia).
    intros u I. apply H, is_open_iff, in_slot, lookup_in in I. change u with (fst (u, slot_of s u)). now apply in_map.
  - intros L. exists (map fst (opened s)). rewrite map_length. split; [apply (g_nodup _ _ _ G)|]. split; auto.
    intros u I. apply is_open_iff. unfold is_open. destruct (lookup u (opened s)) eqn:E; auto.
    now apply lookup_none in E.
Qed.
Lemma f1_same t deadline : same (f1_rows cfg tr (clock s) t deadline) (f1_reasons cfg s t deadline).
Proof.
  cbn. split; [auto|]. split; [apply reached_iff|]. intros _. split; [auto|].
  split; [rewrite full_iff; symmetry; apply N.leb_le|]. intros _. split; [auto|]. split; [|auto]. split.
  - intros (d & -> & L). now apply N.leb_le.
  - intros H. destruct deadline as [d|]; [|discriminate]. exists d. split; auto. now apply N.leb_le.
Qed.

(** Of an open timestamp. *)
Lemma requested_iff t p : is_open s t = true -> (asked tr t p <-> mem p (requested (slot_of s t)) = true).
Proof.
  intros O. apply in_slot in O. rewrite mem_iff, (a_requested _ _ _ _ (g_traced _ _ _ G t _ O)). reflexivity.
Qed.
Lemma emitted_cached t c : is_open s t = true -> is_progressive cfg = true -> In c (cached (slot_of s t)) ->
  says tr (emits t c).
Proof.
  intros O Pr I. apply in_slot in O. assert (R := a_running _ _ _ _ (g_traced _ _ _ G t _ O)). unfold running in R.
  rewrite Pr in R. destruct R as (ps & E & _ & C). apply sent_in. rewrite E. rewrite C in I.
  destruct ps as [|x ps]; [contradiction|]. destruct I as [->|[]]. now left.
Qed.
Lemma accepted_cached t c : is_open s t = true -> In c (cached (slot_of s t)) -> says tr (accepts t c).
Proof.
  intros O I. destruct (is_progressive cfg) eqn:Pr.
  - destruct (emitted_cached t c O Pr I) as (d & J & E). exists d. split; auto. now right.
  - apply in_slot in O. apply (a_cached _ _ _ _ (g_traced _ _ _ G t _ O) Pr) in I as (d & J & H). exists d. split; auto.
    now left.
Qed.
Lemma above_same t p : is_open s t = true ->
  ((exists q, p < q /\ says tr (accepts t q)) <-> any_above p (cached (slot_of s t)) = true).
Proof.
  intros O. rewrite above_iff. split.
  - intros (q & L & A). apply (a_got _ _ _ _ (g_traced _ _ _ G t _ (in_slot t O))) in A as (c & I & M).
    exists c. split; auto. lia.
  - intros (q & I & L). exists q. split; auto. now apply accepted_cached.
Qed.
Hypothesis gates : forall p, gate_of p tr = mem p (shut s).
Lemma shuts_iff p backlog : shuts cfg tr p backlog <-> gate_shut cfg s p backlog = true.
Proof.
  unfold shuts, gate_shut, shut_then. destruct (registered cfg p) as [c|] eqn:R; [|split; [intros (c & [=] & _)|discriminate]].
  assert (X := R). apply find_some in X as [_ X]. apply N.eqb_eq in X. rewrite X, gates.
  destruct (mem p (shut s)).
  - rewrite negb_true_iff, N.leb_gt. split; [intros (d & [= <-] & L)|]; eauto.
  - rewrite N.leb_le. split; [intros (d & [= <-] & L)|]; eauto.
Qed.
Lemma f2_same t p d backlog : same (f2_rows cfg tr (clock s) t p d backlog)
  (f2_reasons cfg s t p d ++ [(Queue, gate_shut cfg s p backlog)]).
Proof.
  cbn. split; [auto|]. split.
  { rewrite not_reached_iff, negb_true_iff, andb_false_iff. reflexivity. }
  intros _. split; [auto|]. split; [rewrite not_open_iff, negb_true_iff; reflexivity|]. rewrite negb_false_iff. intros O.
  split; [auto|]. split; [now apply requested_iff|]. intros _. split; [auto|]. split; [now apply above_same|]. intros _.
  split; [auto|]. split; [symmetry; apply N.leb_le|]. intros _. split; [auto|]. split; [apply shuts_iff|auto].
Qed.
Lemma f3_same t p : same (f3_rows cfg tr t p) (f3_reasons cfg s t p).
Proof.
  cbn. split; [auto|]. split.
  { rewrite not_reached_iff, negb_true_iff, andb_false_iff, orb_false_iff, N.eqb_neq. reflexivity. }
  intros _. split; [auto|]. split.
  { rewrite <- or_assoc, not_open_iff, orb_true_iff, negb_true_iff, andb_true_iff. split.
    - intros [O|(Pr & q & L & E)]; auto. destruct (is_open s t) eqn:O; auto. right. split; auto.
      apply above_same; auto. exists q. split; auto. destruct E as (d & I & E). exists d. split; auto. now right.
    - intros [O|(Pr & A)]; auto. destruct (is_open s t) eqn:O; auto. right. split; auto.
      apply above_iff in A as (q & I & L). exists q. split; auto. now apply emitted_cached. }
  rewrite orb_false_iff, negb_false_iff, andb_false_iff. intros [O NA].
  assert (T := g_traced _ _ _ G t _ (in_slot t O)). assert (Sk := g_slot _ _ _ G t _ (in_slot t O)).
  split; [auto|]. split.
  { rewrite (requested_iff t p O), negb_true_iff. destruct (mem p (requested (slot_of s t))); intuition congruence. }
  rewrite negb_false_iff, mem_iff. intros Rq. split; [auto|].
  assert (Dup : says tr (accepts t p) <-> mem p (cached (slot_of s t)) = true).
  { rewrite mem_iff. split; [|now apply accepted_cached]. intros A. destruct (is_progressive cfg) eqn:Pr.
    - destruct (a_got _ _ _ _ T p A) as (c & I & L). destruct (N.eq_dec c p) as [->|Ne]; auto.
      destruct NA as [|NA]; [discriminate|]. rewrite above_not in NA. specialize (NA c I). lia.
    - apply (a_cached _ _ _ _ T Pr). destruct A as (d & I & [H|E]); [exists d; auto|].
      destruct (open_endings t _ (Sent p) (in_slot t O)) as [[=] _]; [|congruence]. apply sent_in. exists d. auto. }
  split; [exact Dup|]. intros ND. assert (NAcc : ~ says tr (accepts t p)) by (rewrite Dup, ND; discriminate).
  split; [auto|]. split; [|auto]. rewrite negb_true_iff, mem_not, (a_pending _ _ _ _ T). split.
  - intros (d & I & H) [_ N]. apply N. exists d. split; auto. destruct d; cbn in *; tauto.
  - intros N. destruct (says_dec tr (gives_out t p)) as [Y|Y]; auto.
    { intros d. destruct d as [|n u q|n u q| | | | | | | |]; cbn; auto; destruct (N.eq_dec u t), (N.eq_dec q p); tauto. }
    elim N. split; auto. intros (d & I & C). destruct d as [|n u q|n u q| | |n u q| |n u q| | |]; cbn in C; try contradiction.
    + apply Y. exists (Failed n u q). auto.
    + apply Y. exists (Timer n u q). auto.
    + apply NAcc. exists (Hold n u q). split; auto. now left.
    + destruct C as [-> [->|(Pr & L)]]; [apply NAcc; exists (Emit n t p); split; auto; right; cbn; auto|].
      destruct NA as [NA|NA]; [congruence|]. enough (any_above p (cached (slot_of s t)) = true) by congruence.
      apply above_same; auto. exists q. split; auto. exists (Emit n t q). split; auto. right. cbn. auto.
Qed.
End Of.
