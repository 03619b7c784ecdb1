(** * P9 bounded and P11 accounted *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Kept Runs.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** P9, the window; what an input costs is the implementation's affair and not spoken of here *)
(* ANCHOR: window *)
Definition fits_window (cfg : config) (s : state) : Prop := N.of_nat (length (opened s)) <= window cfg.
(* ANCHOR_END: window *)
Lemma update_window cfg s s0 t o : opened s0 = opened s -> fits_window cfg s -> fits_window cfg (fst (update s0 t o)).
Proof.
  unfold fits_window, update. cbn. intros ->. assert (X := replace_length t (fst o) (opened s)). lia.
Qed.
Lemma apply_window cfg s b : fits_window cfg s -> fits_window cfg (fst (apply cfg s b)).
Proof.
  intros W. destruct b as [t d|t p d bl|t p|t p|]; cbn [apply]; auto.
  - unfold open. destruct (first_reason _) eqn:F; auto. cbn in F. destruct (reached s t); [discriminate|].
    destruct (N.leb_spec (window cfg) (N.of_nat (length (opened s)))); [discriminate|].
    unfold fits_window. cbn. rewrite app_length. cbn. lia.
  - unfold offer. destruct (first_reason _); auto. destruct (gate_shut cfg s p bl); auto.
    now apply (update_window cfg s).
  - unfold arrive. destruct (first_reason _); auto. now apply (update_window cfg s).
  - unfold arrive. destruct (first_reason _); auto. now apply (update_window cfg s).
Qed.
(* ANCHOR: P9 *)
(** At most [window] timestamps are open. *)
Theorem p9_window cfg ins : fits_window cfg (state_after cfg ins).
(* ANCHOR_END: P9 *)
Proof.
  destruct (run_reach cfg ins) as [R _]. induction R as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R
    IH A U]; auto.
  - unfold fits_window. cbn. lia.
  - change s' with (fst (s', ds)). rewrite <- U. now apply (update_window cfg s).
  - change s' with (fst (s', ds)). rewrite <- U. now apply apply_window.
Qed.

(** ** P11 *)

Lemma apply_own cfg s b : own cfg (clock s) b (snd (apply cfg s b)).
Proof.
  destruct b as [t d|t p d bl|t p|t p|]; cbn [apply own]; auto.
  - unfold open. destruct (first_reason _); cbn; eauto.
  - unfold offer. destruct (first_reason _); cbn; eauto. destruct (gate_shut cfg s p bl); cbn; eauto.
  - unfold arrive. destruct (first_reason _); cbn; eauto. right. unfold result.
    destruct (is_progressive cfg) eqn:Pr; [|destruct (any_above p _); cbn; auto].
    + right. unfold improve. eexists. destruct (filter (N.ltb p) _); cbn; [exists [Final (clock s) t p]; auto|].
      exists []. rewrite app_nil_r. auto.
    + right. eexists. exists []. rewrite app_nil_r. auto.
  - unfold arrive. destruct (first_reason _); cbn; eauto. right. unfold fail.
    destruct (settle _ _ _ _ _) as [o e] eqn:Se. cbn.
    exists e. split; auto. apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & Pr & m & ->
      & _)|(NP & m & E & _)]]]; auto.
    + right. right. left. eauto.
    + injection E as _ ->. right. right. right. split; auto. eexists. eauto.
Qed.
Lemma expire_of_timers cfg n : forall s s' ds, expire n cfg s = (s', ds) -> Forall of_timers ds.
Proof.
  induction n as [|n IH]; intros s s' ds; cbn [expire]; [intros [= _ <-]; constructor|].
  destruct (earliest _) as [[due t]|]; [|intros [= _ <-]; constructor].
  destruct (due <=? clock s); [|intros [= _ <-]; constructor].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire n cfg s1) as [s2 ds2] eqn:E. intros [= _ <-].
  apply Forall_app. split; [|eapply IH; eauto]. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
  injection U as _ <-. cbn. apply Forall_app. split.
  - apply Forall_forall. intros d I. apply in_map_iff in I as (q & <- & _). exact I.
  - apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & ->
      & _)|(_ & m & X & _)]]]; repeat constructor.
    injection X as _ ->. constructor; [exact I|]. apply Forall_forall. intros d J.
    apply in_map_iff in J as (q & <- & _). exact I.
Qed.
(* ANCHOR: accounted *)
(** Each input has exactly the decisions that its kind may have: an open is accepted or refused, an offer admitted or
    refused, a result forwarded, held (not under progressive) or dropped, a failure accepted or dropped,
      for a reason. *)
Theorem p11_accounted cfg s i : exists of_due of_input, snd (step cfg s i) = of_due ++ of_input /\
  Forall of_timers of_due /\ own cfg (N.max (clock s) (at_ i)) (what i) of_input.
(* ANCHOR_END: accounted *)
Proof.
  unfold step. destruct (expire _ _ _) as [s1 ds1] eqn:E. destruct (apply cfg s1 (what i)) as [s2 ds2] eqn:A. cbn.
  exists ds1, ds2. split; auto. split; [eapply expire_of_timers; eauto|].
  assert (C : clock s1 = N.max (clock s) (at_ i)).
  { clear A. revert E. change (N.max (clock s) (at_ i)) with (clock (set_clock (at_ i) s)).
    generalize (length (timers (opened (set_clock (at_ i) s)))). intros n. generalize (set_clock (at_ i) s).
    revert s1 ds1. induction n as [|n IH]; intros s1 ds1 s0; cbn [expire]; [now intros [= <- _]|].
    destruct (earliest _) as [[due t]|]; [|now intros [= <- _]]. destruct (due <=? clock s0); [|now intros [= <- _]].
    destruct (update _ _ _) as [s4 ds4] eqn:U. destruct (expire n cfg s4) as [s3 ds3] eqn:X. intros [= <- _].
    apply IH in X. rewrite X. unfold update in U. injection U as <- _. reflexivity. }
  rewrite <- C. change ds2 with (snd (s2, ds2)). rewrite <- A. apply apply_own.
Qed.
(** What was opened is open, or its output, its final or its miss was decided. *)
Theorem p11_opened cfg ins t : says (trace_of cfg ins) (opens t) ->
  lookup t (opened (state_after cfg ins)) <> None \/ says (trace_of cfg ins) (retires cfg t).
Proof. destruct (run_reach cfg ins) as [R _]. apply (g_open _ _ _ (reach_good _ _ _ _ R)). Qed.

Lemma reason_meaning cfg tr s t p why : good cfg tr s -> first_reason (f3_reasons cfg s t p) = Some why ->
  meaning cfg tr t p why.
Proof.
  intros G. cbn. destruct ((p =? 0) || is_cloud cfg p) eqn:K; cbn.
  2:{ intros [= <-]. apply orb_false_iff in K as [K1 K2]. apply N.eqb_neq in K1. left. auto. }
  destruct (reached s t) eqn:Re; cbn.
  2:{ intros [= <-]. right. intros u Lu (d & I & O). assert (reached s u = true) as X.
      { apply (g_about _ _ _ G). exists d. split; auto. now apply opens_about in O. }
      unfold reached in *. destruct (newest s); [|discriminate]. apply N.leb_le in X. apply N.leb_gt in Re. lia. }
  unfold is_open, slot_of. destruct (lookup t (opened s)) as [sl|] eqn:L; cbn.
  2:{ intros [= <-]. cbn. destruct (says_dec tr (opens t)) as [O|O]; auto.
      - intros d. destruct d; cbn; auto. apply N.eq_dec.
      - destruct (g_open _ _ _ G t O); [contradiction|auto]. }
  assert (T := g_told _ _ _ G t sl L). assert (O := g_slot _ _ _ G t sl L). assert (Run := a_running _ _ _ _ T).
  assert (Em : is_progressive cfg = true -> forall q, In q (cached sl) -> says tr (emits t q)).
  { intros Pr q Q. unfold running in Run. rewrite Pr in Run. destruct Run as (ps & E & _ & C). apply sent_in.
    rewrite E.
    rewrite C in Q. destruct ps as [|x ps]; [contradiction|]. destruct Q as [->|[]]. now left. }
  destruct (is_progressive cfg && any_above p (cached sl)) eqn:S.
  { intros [= <-]. apply andb_true_iff in S as [Pr A]. apply above_iff in A as (q & Q & Lq). right. right. eauto. }
  destruct (mem p (requested sl)) eqn:M1; cbn.
  2:{ intros [= <-]. apply mem_not in M1. cbn. rewrite (a_requested _ _ _ _ T) in M1. tauto. }
  apply mem_iff in M1. destruct (mem p (cached sl)) eqn:M2.
  { intros [= <-]. apply mem_iff in M2. cbn. destruct (is_progressive cfg) eqn:Pr.
    - destruct (Em eq_refl p M2) as (d & I & H). exists d. split; auto. now right.
    - apply (a_cached _ _ _ _ T Pr) in M2 as (d & I & H). exists d. split; auto. now left. }
  destruct (mem p (pending sl)) eqn:M3; cbn; [discriminate|]. intros [= <-]. apply mem_not in M3. cbn.
  rewrite (a_pending _ _ _ _ T) in M3. split; [tauto|]. intros q Lq E.
  assert (Acc : says tr (accepts t q)) by (destruct E as (d & I & E); exists d; split; auto; now right).
  apply (a_got _ _ _ _ T) in Acc as (c & C & Lc). unfold running in Run. destruct (is_progressive cfg); cbn in S.
  - rewrite above_not in S. specialize (S c C). lia.
  - apply sent_in in E. rewrite Run in E. contradiction.
Qed.
Lemma run_app cfg a b : forall s tr, run cfg s tr (a ++ b) = let (s1, tr1) := run cfg s tr a in run cfg s1 tr1 b.
Proof.
  induction a as [|i a IH]; intros s tr; cbn; auto. destruct (step cfg s i) as [s1 ds]. apply IH.
Qed.
Lemma arrive_drop cfg s t p rule now u q why : In (Drop now u q why) (snd (arrive cfg s t p rule)) ->
  (forall sl, forall d, In d (snd (rule sl)) -> topic d <> None) ->
  snd (arrive cfg s t p rule) = [Drop now t p why] /\ first_reason (f3_reasons cfg s t p) = Some why.
Proof.
  unfold arrive. destruct (first_reason _) as [w|].
  - intros [[= <- <- <- <-]|[]] _. auto.
  - cbn. intros I H. now apply H in I.
Qed.
Lemma result_topic cfg now t p sl d : In d (snd (result cfg now t p sl)) -> topic d <> None.
Proof.
  unfold result, improve. destruct (is_progressive cfg); [destruct (filter (N.ltb p) (pending sl))|destruct
    (any_above p (pending sl))];
    cbn; rewrite ?in_app_iff, ?in_map_iff; intros I; repeat destruct I as [I|I]; try contradiction; subst;
      try discriminate;
    try (destruct I as (x & <- & _); discriminate).
Qed.
Lemma fail_topic cfg now t p sl d : In d (snd (fail cfg now t p sl)) -> topic d <> None.
Proof.
  unfold fail. destruct (settle _ _ _ _ _) as [o e] eqn:S. cbn. intros [<-|I]; [discriminate|].
  apply settle_cases in S as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & E & _)]]].
  - contradiction.
  - destruct I as [<-|[]]. discriminate.
  - destruct I as [<-|[]]. discriminate.
  - injection E as _ ->. destruct I as [<-|I]; [discriminate|]. apply in_map_iff in I as (x & <- & _). discriminate.
Qed.
(* ANCHOR: reason *)
(** A dropped result or failure bears the first reason of F3 that holds,
    and of the trace until then it says the truth. *)
Theorem p11_reason cfg ins i t p why now : what i = Result t p \/ what i = Fail t p ->
  In (Drop now t p why) (snd (step cfg (state_after cfg ins) i)) ->
  exists before, trace_of cfg (ins ++ [i]) = after [Drop now t p why] before /\ meaning cfg before t p why.
(* ANCHOR_END: reason *)
Proof.
  intros B. unfold trace_of, state_after. rewrite run_app. assert (R := proj1 (run_reach cfg ins)).
  unfold trace_of, state_after in R. destruct (run cfg initial [] ins) as [s tr]. cbn [fst snd run] in *.
  unfold step. assert (R0 := at_input cfg tr s (at_ i) (what i) R). set (s0 := set_clock (at_ i) s) in *.
  destruct (expire _ cfg s0) as [s1 ds1] eqn:E.
  destruct (expire_reach cfg _ _ s0 s1 ds1 (what i) R0 (le_n _) E) as (R1 & _ & _).
  assert (G := reach_good _ _ _ _ R1).
  apply expire_of_timers in E. rewrite Forall_forall in E.
  assert (K : In (Drop now t p why) (snd (apply cfg s1 (what i))) ->
    snd (apply cfg s1 (what i)) = [Drop now t p why] /\ first_reason (f3_reasons cfg s1 t p) = Some why).
  { destruct B as [B|B]; rewrite B; cbn [apply]; intros I; eapply arrive_drop; eauto using result_topic, fail_topic. }
  destruct (apply cfg s1 (what i)) as [s2 ds2]. cbn [fst snd] in *. intros I.
  apply in_app_or in I as [I|I]; [now apply E in I|].
  destruct (K I) as [-> F]. eexists. split; [apply after_app|]. eapply reason_meaning; eauto.
Qed.
