(** * Section 8: how often a call looks at its timestamp (F8), and what old names name *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Ticks Broken Threads.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.

(** ** Looks *)
(* ANCHOR: looks *)
(** How often thread [i]'s exchanges fail at [t]: each because its slot changed since the thread looked. *)
Fixpoint failures does_call (i : nat) (t : N) (m : moment) (acts : list act) : nat :=
  match acts with
  | [] => 0
  | a :: rest =>
      (match a with Exchange j c => if PeanoNat.Nat.eqb j i && (names c =? t) && stale i t m then 1 else 0 | Look _ _ => 0 end +
       failures does_call i t (perform does_call m a) rest)%nat
  end.
(** A call looks again only after its exchange failed. That happens, after its timestamp was opened, at most [2c + 1]
    times with [c] clouds, and after as many the timestamp is retired: so it looks at most [2c + 1] times. *)
Definition S8_looks (cfg : config) does_call : Prop := forall before acts i t,
  Forall fits_act (before ++ acts) ->
  let m := interleave does_call at_first before in
  says (history m) (opens t) -> seen m i = None ->
  (failures does_call i t m acts <= 2 * length (clouds cfg) + 1)%nat /\
  (failures does_call i t m acts = 2 * length (clouds cfg) + 1 ->
    lookup t (opened (machine (interleave does_call m acts))) = None)%nat.
(* ANCHOR_END: looks *)

(** An offer moves a cloud from the first to the second, what closes takes from the second. *)
Definition unrequested (cfg : config) (sl : slot) : list cloud :=
  filter (fun c => negb (mem (priority c) (requested sl))) (clouds cfg).
Definition changes_of (cfg : config) (sl : slot) : nat := (2 * length (unrequested cfg sl) + length (pending sl))%nat.
Definition changes_left (cfg : config) (t : N) (s : state) : nat :=
  match lookup t (opened s) with Some sl => changes_of cfg sl | None => 0%nat end.
(** Each timestamp that was reached is as it was, or has fewer changes left. *)
Definition moves (cfg : config) (s s' : state) : Prop := forall t, reached s t = true ->
  reached s' t = true /\
  (lookup t (opened s') = lookup t (opened s) \/ (changes_left cfg t s' < changes_left cfg t s)%nat).
Lemma moves_not cfg s s' : opened s' = opened s -> newest s' = newest s -> moves cfg s s'.
Proof. intros O N t R. rewrite O. unfold reached in *. rewrite N. auto. Qed.
Lemma moves_on cfg a b c : moves cfg a b -> moves cfg b c -> moves cfg a c.
Proof.
  intros A B t R. destruct (A t R) as [R1 C1]. destruct (B t R1) as [R2 C2]. split; auto. unfold changes_left in *.
  destruct C1 as [C1|C1], C2 as [C2|C2].
  - left. congruence.
  - right. now rewrite <- C1.
  - right. now rewrite C2.
  - right. lia.
Qed.
Lemma some_changes cfg sl : slot_ok cfg sl -> (0 < changes_of cfg sl)%nat.
Proof. intros O. destruct (ok_waits _ _ O) as (p & P). unfold changes_of. destruct (pending sl); [contradiction|]. cbn [length]. lia. Qed.
Lemma shorter {A} (f : A -> bool) l : (length (filter f l) <= length l)%nat.
Proof. induction l as [|x l IH]; cbn [filter]; auto. destruct (f x); cbn [length]; lia. Qed.
(** One timestamp's slot is replaced by one with fewer changes left, or it is retired. *)
Lemma moves_one cfg tr s t sl o s' : good cfg tr s -> lookup t (opened s) = Some sl ->
  opened s' = replace t o (opened s) -> newest s' = newest s ->
  (forall x, o = Some x -> (changes_of cfg x < changes_of cfg sl)%nat) -> moves cfg s s'.
Proof.
  intros G L O N F u R. split; [unfold reached in *; now rewrite N|]. unfold changes_left. rewrite O.
  destruct (N.eq_dec u t) as [->|D]; [|rewrite lookup_replace_other; auto].
  rewrite (lookup_replace t o _ sl (g_nodup _ _ _ G) L), L. right. destruct o as [x|]; auto.
  exact (some_changes cfg sl (g_slot _ _ _ G t sl L)).
Qed.
Lemma close_changes cfg ps p sl : In p ps -> In p (pending sl) -> (changes_of cfg (close ps sl) < changes_of cfg sl)%nat.
Proof.
  intros I P. unfold changes_of, unrequested, close. cbn [requested pending].
  assert (E : negb (mem p ps) = false) by now apply negb_false_iff, mem_iff.
  assert (X := filter_fewer (fun q => negb (mem q ps)) p (pending sl) P E). lia.
Qed.
Lemma fire_moves cfg tr s due t sl s' ds : good cfg tr s -> lookup t (opened s) = Some sl ->
  (exists p, In (p, due) (armed sl)) -> update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> moves cfg s s'.
Proof.
  intros G L (p & I) U. rewrite (slot_of_open _ _ _ L) in U. unfold update, fire in U.
  destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as <- _.
  apply (moves_one cfg tr s t sl o); auto. intros x ->. assert (O := g_slot _ _ _ G t sl L).
  assert (K := settle_keeps _ _ _ _ _ _ _ Se). subst x.
  assert (Fp : In p (fired due sl)) by now apply fired_in.
  destruct (ok_armed _ _ O p due I) as [P|(C & E & Z)]; [now apply (close_changes cfg (fired due sl) p)|].
  exfalso. apply settle_cases in Se as [(_ & _ & _ & _ & H)|[([=] & _)|[([=] & _)|(_ & m & X & _)]]]; [|discriminate X].
  assert (Y : cached sl = []); [|rewrite Y in C; contradiction]. apply H; auto. apply existsb_exists. exists p.
  split; auto. now apply negb_true_iff, N.eqb_neq.
Qed.
Lemma expire_own_moves cfg t n : forall tr s s' ds, good cfg tr s -> expire_own n cfg t s = (s', ds) -> moves cfg s s'.
Proof.
  induction n as [|n IH]; intros tr s s' ds G; cbn [expire_own]; [intros [= <- _]; now apply moves_not|].
  destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [option_map]; [|intros [= <- _]; now apply moves_not].
  destruct (earliest_of sl) as [due|] eqn:E; [|intros [= <- _]; now apply moves_not].
  destruct (due <=? clock s); [|intros [= <- _]; now apply moves_not].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= <- _].
  apply (moves_on cfg s s1); [|apply (IH (after ds1 tr) s1 s2 ds2); auto; eapply good_fire; eauto].
  apply earliest_of_some in E as [A _]. eapply fire_moves; eauto.
Qed.
Lemma join_changes cfg p due sl : ~ In p (requested sl) -> is_cloud cfg p = true ->
  (changes_of cfg (join p due sl) < changes_of cfg sl)%nat.
Proof.
  intros NI C. unfold changes_of, unrequested. cbn [join requested pending].
  assert (A : forall l : list N, length (add id p l) = S (length l)).
  { induction l as [|y l IH]; cbn; auto. destruct (_ <? _); cbn; auto. }
  rewrite A. enough (length (filter (fun c => negb (mem (priority c) (add id p (requested sl)))) (clouds cfg)) <
    length (filter (fun c => negb (mem (priority c) (requested sl))) (clouds cfg)))%nat by lia.
  unfold is_cloud, registered in C. destruct (find _ (clouds cfg)) as [c|] eqn:F; [|discriminate].
  apply find_some in F as [I E]. apply N.eqb_eq in E. clear C A. revert I.
  set (f := fun c : cloud => negb (mem (priority c) (add id p (requested sl)))).
  set (g := fun c : cloud => negb (mem (priority c) (requested sl))).
  assert (FG : forall x, f x = true -> g x = true).
  { unfold f, g. intros x. rewrite !negb_true_iff, !mem_not, add_in. tauto. }
  assert (Fc : f c = false) by (unfold f; apply negb_false_iff, mem_iff, add_in; auto).
  assert (Gc : g c = true) by (unfold g; apply negb_true_iff, mem_not; now rewrite E).
  assert (Le : forall l, (length (filter f l) <= length (filter g l))%nat).
  { induction l as [|x l IH]; cbn; auto. specialize (FG x). destruct (f x), (g x); cbn; try lia; now discriminate FG. }
  induction (clouds cfg) as [|x l IH]; [intros []|]. intros [->|I]; cbn.
  - rewrite Fc, Gc. cbn. specialize (Le l). lia.
  - specialize (IH I). specialize (FG x). destruct (f x), (g x); cbn; try lia; now discriminate FG.
Qed.
Lemma apply_moves cfg tr s b : good cfg tr s -> moves cfg s (fst (apply cfg s b)).
Proof.
  intros G. destruct b as [t d|t p d bl|t p|t p|]; cbn [apply]; try now apply moves_not.
  - unfold open. destruct (first_reason _) eqn:F; [now apply moves_not|]. cbn in F.
    destruct (reached s t) eqn:Rt; [discriminate|]. intros u R. cbn. assert (D : u <> t) by congruence.
    assert (NT : ~ In t (map fst (opened s))) by (intros I; apply (g_reached _ _ _ G) in I; congruence).
    split; [unfold reached in *; cbn; destruct (newest s); [|discriminate]; apply N.leb_gt in Rt;
      apply N.leb_le in R; apply N.leb_le; lia|].
    left. rewrite lookup_app by auto. apply not_eq_sym, N.eqb_neq in D. now rewrite D.
  - unfold offer. destruct (first_reason _) eqn:F; [now apply moves_not|].
    apply f2_none in F as (sl & L & N & _ & C & _). destruct (gate_shut cfg s p bl); [now apply moves_not|].
    rewrite (slot_of_open _ _ _ L).
    apply (moves_one cfg tr s t sl (Some (join p (due_at (clock s) d) sl))); auto.
    intros x [= <-]. now apply join_changes.
  - unfold arrive. destruct (first_reason _) eqn:F; [now apply moves_not|].
    apply f3_none in F as (sl & L & P & _). rewrite (slot_of_open _ _ _ L). unfold update. cbn [fst].
    apply (moves_one cfg tr s t sl (fst (result cfg (clock s) t p sl))); auto. intros x. unfold result, improve.
    assert (Fw : forall f : N -> bool, f p = false -> (length (filter f (pending sl)) < length (pending sl))%nat).
    { intros f E. now apply (filter_fewer f p). }
    destruct (is_progressive cfg); [destruct (filter (N.ltb p) (pending sl)) as [|q r] eqn:Q|
      destruct (any_above p (pending sl))]; cbn; intros [= <-]; unfold changes_of, unrequested; cbn [requested pending hold].
    + assert (X := Fw (N.ltb p) (N.ltb_irrefl p)). rewrite Q in X. lia.
    + assert (E : negb (p =? p) = false) by now rewrite N.eqb_refl.
      assert (X := Fw (fun q => negb (q =? p)) E). lia.
  - unfold arrive. destruct (first_reason _) eqn:F; [now apply moves_not|].
    apply f3_none in F as (sl & L & P & _). rewrite (slot_of_open _ _ _ L). unfold update, fail.
    destruct (settle _ _ _ _ _) as [o e] eqn:Se. cbn [fst].
    apply (moves_one cfg tr s t sl o); auto. intros x ->. apply settle_keeps in Se as ->.
    apply (close_changes cfg [p] p); cbn; auto.
Qed.
Lemma execute_moves cfg tr s c s' ds : fits_call c -> good cfg tr s -> execute cfg s c = (s', ds) -> moves cfg s s'.
Proof.
  intros Fit G. unfold execute. set (s0 := at_clock (instant c) s). set (tr0 := Got (instant c) (does c) :: tr).
  assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
  assert (C0 : current tr0 s0 (does c)) by (exists [], tr; split; [reflexivity|intros d []]).
  destruct (if expires c then _ else _) as [s1 ds1] eqn:E. destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A.
  intros [= <- _]. apply (moves_on cfg s s0); [now apply moves_not|].
  assert (M : moves cfg s0 s1 /\ good cfg (after ds1 tr0) s1).
  { destruct (expires c); [|injection E as <- <-; split; [now apply moves_not|exact G0]]. split.
    - eapply expire_own_moves; eauto.
    - eapply (expire_own_good cfg (names c) (does c) _ tr0); eauto. }
  destruct M as [M G1]. apply (moves_on cfg s0 s1); auto. change s2 with (fst (s2, ds2)). rewrite <- A.
  eapply apply_moves; eauto.
Qed.
Lemma lookup_still t u o l : lookup t l = None -> lookup t (replace u o l) = None.
Proof.
  rewrite !lookup_none. intros NI I. apply NI. eapply replace_keys; eauto.
Qed.
Lemma lookup_end t u x l : lookup t (l ++ [(u, x)]) = match lookup t l with Some y => Some y | None =>
  if u =? t then Some x else None end.
Proof. induction l as [|[v y] l IH]; cbn; auto. destruct (v =? t); auto. Qed.
(** No timestamp that was opened has more changes left than [2c + 1]. *)
Definition bounded (cfg : config) (s : state) : Prop := forall t,
  (changes_left cfg t s <= 2 * length (clouds cfg) + 1)%nat.
Lemma moves_bounded cfg tr s c s' ds : fits_call c -> good cfg tr s -> execute cfg s c = (s', ds) ->
  bounded cfg s -> bounded cfg s'.
Proof.
  intros Fit G X B t. assert (M := execute_moves cfg tr s c s' ds Fit G X). destruct (reached s t) eqn:R.
  - destruct (M t R) as [_ [E|L]]; specialize (B t); unfold changes_left in *; [now rewrite E|lia].
  - unfold changes_left. destruct (lookup t (opened s')) as [sl|] eqn:L'; [|lia].
    assert (L : lookup t (opened s) = None).
    { destruct (lookup t (opened s)) eqn:L; auto. apply (slot_reached cfg tr s t) in L; auto. congruence. }
    unfold execute in X. set (s0 := at_clock (instant c) s) in X. set (tr0 := Got (instant c) (does c) :: tr).
    assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
    assert (C0 : current tr0 s0 (does c)) by (exists [], tr; split; [reflexivity|intros d []]).
    destruct (if expires c then _ else _) as [s1 ds1] eqn:E. destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A.
    injection X as -> _.
    assert (K : lookup t (opened s1) = None).
    { destruct (expires c); [|injection E as <- _; exact L].
      assert (G1 : good cfg (after ds1 tr0) s1) by (eapply (expire_own_good cfg (names c) (does c) _ tr0); eauto).
      revert E. generalize (length (armed (slot_of s0 (names c)))). change (opened s) with (opened s0) in L.
      intros n. clear - L. revert s1 ds1 L. generalize s0. induction n as [|n IH]; intros a s1 ds1 L; cbn [expire_own].
      - now intros [= <- _].
      - destruct (option_map _ _) as [[due|]|]; try (now intros [= <- _]). destruct (due <=? clock a); [|now intros [= <- _]].
        destruct (update _ _ _) as [s3 ds3] eqn:U. destruct (expire_own n _ _ s3) as [s4 ds4] eqn:Y. intros [= <- _].
        apply (IH s3 s4 ds4); auto. unfold update in U. injection U as <- _. cbn. now apply lookup_still. }
    revert A L'. destruct (does c) as [u d|u p d bl|u p|u p|]; cbn [apply].
    + unfold open. destruct (first_reason _); intros [= <- _]; [congruence|]. cbn.
      destruct (N.eq_dec u t) as [->|D]; [|]; rewrite lookup_end, K.
      * rewrite N.eqb_refl. intros [= <-]. unfold changes_of, unrequested. cbn [pending new_slot length].
        assert (Z := shorter (fun c => negb (mem (priority c) (requested (new_slot (option_map (due_at (clock s1)) d))))) (clouds cfg)).
        lia.
      * apply N.eqb_neq in D. rewrite D. discriminate.
    + unfold offer. destruct (first_reason _); [intros [= <- _]; congruence|]. destruct (gate_shut cfg s1 p bl);
        intros [= <- _]; cbn; [congruence|]. now rewrite lookup_still.
    + unfold arrive. destruct (first_reason _); [intros [= <- _]; congruence|]. intros [= <- _]. cbn. now rewrite lookup_still.
    + unfold arrive. destruct (first_reason _); [intros [= <- _]; congruence|]. intros [= <- _]. cbn. now rewrite lookup_still.
    + intros [= <- _]. congruence.
Qed.
Lemma bounded_at_first cfg : bounded cfg initial.
Proof. intros t. unfold changes_left. cbn. lia. Qed.
Lemma interleave_keeps cfg acts : forall m, good cfg (history m) (machine m) -> bounded cfg (machine m) ->
  Forall fits_act acts -> let e := interleave (execute cfg) m acts in good cfg (history e) (machine e) /\ bounded cfg (machine e).
Proof.
  induction acts as [|a acts IH]; intros m G B F; cbn; auto. inversion F as [|? ? Fa Fr]; subst. unfold interleave in IH.
  destruct (perform_cases cfg m a (g_nodup _ _ _ G) Fa) as [(M & L)|(i & c & s & ds & -> & Fc & _ & X & P)].
  - apply IH; auto; now rewrite ?M, ?L.
  - rewrite P. apply IH; cbn; auto; [eapply execute_good|eapply moves_bounded]; eauto.
Qed.
Definition owes (i : nat) (t : N) (m : moment) : nat := if stale i t m then 1%nat else 0%nat.
Lemma failures_bound cfg i t acts : forall m, good cfg (history m) (machine m) -> Forall fits_act acts ->
  reached (machine m) t = true ->
  (failures (execute cfg) i t m acts + changes_left cfg t (machine (interleave (execute cfg) m acts)) <=
   changes_left cfg t (machine m) + owes i t m)%nat.
Proof.
  induction acts as [|a acts IH]; intros m G F R; cbn [failures interleave fold_left]; [lia|].
  inversion F as [|? ? Fa Fr]; subst. unfold interleave in IH.
  destruct (perform_cases cfg m a (g_nodup _ _ _ G) Fa) as [(M & L)|(j & c & s & ds & -> & Fc & St & X & P)].
  - specialize (IH (perform (execute cfg) m a)). rewrite M, L in IH. specialize (IH G Fr R).
    enough ((match a with Exchange j c => if PeanoNat.Nat.eqb j i && (names c =? t) && stale i t m then 1 else 0 | Look _ _ => 0 end +
      owes i t (perform (execute cfg) m a) <= owes i t m)%nat) by lia. clear IH. unfold owes.
    destruct a as [j u|j c].
    + unfold stale. cbn. unfold remember. destruct (PeanoNat.Nat.eqb_spec i j) as [->|D].
      * cbn. destruct (u =? t) eqn:E; cbn; [|lia]. apply N.eqb_eq in E as ->. destruct (slot_same _ _); [lia|congruence].
      * lia.
    + destruct (PeanoNat.Nat.eqb_spec j i) as [->|D]; cbn [andb].
      * assert (Z : stale i t (perform (execute cfg) m (Exchange i c)) = false \/ perform (execute cfg) m (Exchange i c) = m).
        { cbn. destruct (seen m i) as [[v o]|]; auto. left. destruct (_ && _); [destruct (execute cfg _ c)|];
            unfold stale, remember; cbn; now rewrite PeanoNat.Nat.eqb_refl. }
        destruct Z as [Z|Z]; [rewrite Z; destruct (names c =? t), (stale i t m); cbn; lia|].
        rewrite Z. unfold perform in Z. destruct (seen m i) as [[v o]|] eqn:S.
        -- exfalso. destruct (_ && _); [destruct (execute cfg _ c)|]; apply (f_equal (fun x => seen x i)) in Z; cbn in Z;
             unfold remember in Z; rewrite PeanoNat.Nat.eqb_refl in Z; congruence.
        -- unfold stale. rewrite S. rewrite andb_false_r. lia.
      * enough (stale i t (perform (execute cfg) m (Exchange j c)) = stale i t m) as -> by lia.
        unfold stale at 1. rewrite M. cbn. destruct (seen m j) as [[v o]|]; [|reflexivity].
        apply not_eq_sym, PeanoNat.Nat.eqb_neq in D.
        destruct (_ && _); [destruct (execute cfg _ c)|]; cbn; unfold remember; now rewrite D.
  - rewrite P. assert (Mv := execute_moves cfg (history m) (machine m) c s ds Fc G X t R). destruct Mv as [R' C].
    specialize (IH {| machine := s; seen := remember j None m; history := after ds (Got (instant c) (does c) :: history m) |}).
    cbn [machine history] in IH. specialize (IH ltac:(eapply execute_good; eauto) Fr R').
    destruct (PeanoNat.Nat.eqb_spec j i) as [->|D]; cbn [andb].
    + assert (Z : owes i t {| machine := s; seen := remember i None m;
        history := after ds (Got (instant c) (does c) :: history m) |} = 0%nat).
      { unfold owes, stale. cbn. unfold remember. now rewrite PeanoNat.Nat.eqb_refl. }
      rewrite Z in IH. assert (Q : (names c =? t) && stale i t m = false).
      { destruct (N.eqb_spec (names c) t) as [<-|]; auto. }
      rewrite Q. unfold changes_left in *. destruct C as [C|C]; [rewrite C in IH|]; lia.
    + assert (Z : (owes i t {| machine := s; seen := remember j None m;
        history := after ds (Got (instant c) (does c) :: history m) |} <=
        (if slot_same (lookup t (opened s)) (lookup t (opened (machine m))) then owes i t m else 1))%nat).
      { unfold owes, stale. cbn. unfold remember. apply not_eq_sym, PeanoNat.Nat.eqb_neq in D. rewrite D.
        destruct (seen m i) as [[u o]|]; [|destruct (slot_same _ _); cbn; lia].
        destruct (slot_same (lookup t (opened s)) (lookup t (opened (machine m)))) as [->|]; [lia|].
        destruct (_ && _); lia. }
      destruct (slot_same _ _) as [E|E]; [|destruct C as [C|C]; [congruence|lia]].
      unfold changes_left in *. rewrite E in *. lia.
Qed.
Theorem s8_looks cfg : S8_looks cfg (execute cfg).
Proof.
  intros before acts i t F m O S. apply Forall_app in F as [F1 F2].
  destruct (interleave_keeps cfg before at_first (start_good cfg) (bounded_at_first cfg) F1) as [G B]. fold m in G, B.
  assert (R : reached (machine m) t = true).
  { apply (g_about _ _ _ G). destruct O as (d & I & H). exists d. split; auto. now apply opens_about in H. }
  assert (X := failures_bound cfg i t acts m G F2 R). assert (Z : owes i t m = 0%nat) by (unfold owes, stale; now rewrite S).
  specialize (B t). split; [lia|]. intros E.
  destruct (interleave_keeps cfg acts m G) as [Ge _]; auto.
  { destruct (interleave_keeps cfg before at_first (start_good cfg) (bounded_at_first cfg) F1). auto. }
  unfold changes_left at 1 in X. destruct (lookup t (opened (machine (interleave _ m acts)))) as [sl|] eqn:L; auto.
  assert (Y := some_changes cfg sl (g_slot _ _ _ Ge t sl L)). lia.
Qed.
(* ANCHOR: retired *)
(** A name of what was retired is answered [superseded], [closed], or that nothing fired. *)
Theorem s8_retired cfg s t now p x backlog : reached s t = true -> lookup t (opened s) = None -> is_cloud cfg p = true ->
  let answer b := snd (execute cfg s {| names := t; instant := now; does := b |}) in
  answer (Result t p) = [Drop now t p Superseded] /\ answer (Fail t p) = [Drop now t p Superseded] /\
  answer (Offer t p x backlog) = [Refuse now t (Some p) Closed] /\ answer Tick = [].
(* ANCHOR_END: retired *)
Proof.
  intros R L C answer. unfold answer, execute. cbn [names instant does expires].
  assert (Sl : slot_of (at_clock now s) t = empty_slot) by (unfold slot_of; cbn; now rewrite L).
  rewrite Sl. cbn [armed empty_slot length expire_own option_map apply]. unfold arrive, offer, f3_reasons, f2_reasons.
  change (reached (at_clock now s) t) with (reached s t). rewrite R, C, orb_true_r. unfold is_open. cbn [opened at_clock].
  rewrite L. cbn. auto.
Qed.
