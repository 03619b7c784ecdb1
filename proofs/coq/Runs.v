(** * Every run goes through the moves of Invariant.v, and after each input nothing is due *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

Lemma after_app a b tr : after (a ++ b) tr = after b (after a tr).
Proof. unfold after. now rewrite map_app, rev_app_distr, app_assoc. Qed.
Lemma clock_after ds tr : clock_of (after ds tr) = clock_of tr.
Proof.
  unfold after. induction ds as [|d ds IH] using rev_ind; auto.
  rewrite map_app, rev_app_distr. exact IH.
Qed.

(** ** A round of F5 disarms a timer *)
Lemma settle_keeps cfg now t timer sl x ds : settle cfg now t timer sl = (Some x, ds) -> x = sl.
Proof.
  intros H. apply settle_cases in H as [([= ->] & _)|[([=] & _)|[([=] & _)|(_ & m & E & _)]]]; auto. discriminate.
Qed.
Lemma fire_fewer cfg tr s due t s' ds : good cfg tr s -> earliest (timers (opened s)) = Some (due, t) ->
  update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) ->
  (length (timers (opened s')) < length (timers (opened s)))%nat.
Proof.
  intros G E. destruct (due_lookup _ _ _ _ _ G E) as (sl & p & L & A). rewrite (slot_of_open _ _ _ L).
  unfold update, fire.
  destruct (settle _ _ _ _ _) as [o e] eqn:Se. intros [= <- _]. cbn.
  assert (R := replace_timers t o (opened s) sl L). destruct o as [x|]; [|destruct (armed sl);
    [contradiction|cbn in *; lia]].
  apply settle_keeps in Se as ->. cbn in R.
  assert (F := filter_fewer (fun e0 : N * N => negb (mem (fst e0) (fired due sl))) (p, due) (armed sl) A).
  assert (M : mem p (fired due sl) = true) by now apply mem_iff, fired_in. cbn in F. rewrite M in F.
  specialize (F eq_refl). lia.
Qed.
Lemma rest_if s : NoDup (map fst (opened s)) ->
  (forall due t, earliest (timers (opened s)) = Some (due, t) -> clock s < due) -> at_rest s.
Proof.
  intros D H t sl p due L I. assert (X : In (due, t) (timers (opened s))).
  { apply timers_in. exists sl, p. split; auto. now apply lookup_in. }
  destruct (earliest (timers (opened s))) as [[e u]|] eqn:E.
  - apply earliest_some in E as [_ M]. specialize (M _ X). specialize (H e u eq_refl). cbn in M. lia.
  - apply earliest_none in E. rewrite E in X. contradiction.
Qed.
Lemma expire_reach cfg n : forall tr s s' ds b, reach cfg tr s (Some b) -> (length (timers (opened s)) <= n)%nat ->
  expire n cfg s = (s', ds) -> reach cfg (after ds tr) s' (Some b) /\ at_rest s' /\ clock s' = clock s.
Proof.
  induction n as [|n IH]; intros tr s s' ds b R F; cbn [expire].
  - assert (Z : timers (opened s) = []) by (destruct (timers (opened s)); [auto|cbn in F; lia]).
    intros [= <- <-]. repeat split; auto. apply rest_if; [apply (g_nodup _ _ _ (reach_good _ _ _ _ R))|].
    rewrite Z. discriminate.
  - assert (G := reach_good _ _ _ _ R). destruct (earliest (timers (opened s))) as [[due t]|] eqn:E.
    2:{ intros [= <- <-]. repeat split; auto. apply rest_if; [apply (g_nodup _ _ _ G)|]. rewrite E. discriminate. }
    destruct (N.leb_spec due (clock s)) as [D|D].
    2:{ intros [= <- <-]. repeat split; auto. apply rest_if; [apply (g_nodup _ _ _ G)|]. rewrite E.
    now intros ? ? [= <- _]. }
    destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire n cfg s1) as [s2 ds2] eqn:Ex. intros [= <- <-].
    assert (Fw := fire_fewer cfg tr s due t s1 ds1 G E U).
    assert (C : clock s1 = clock s) by (unfold update in U; injection U as <- _; reflexivity).
    destruct (IH _ s1 s2 ds2 b (at_firing cfg tr s b due t s1 ds1 R E D U) ltac:(lia) Ex) as (A & B & H).
    rewrite after_app. repeat split; auto. congruence.
Qed.

(** ** A20: what an input arms is due later *)
Lemma rest_replace cfg tr s u t sl o s' : good cfg tr s -> rest_of s u -> lookup t (opened s) = Some sl ->
  opened s' = replace t o (opened s) -> clock s' = clock s ->
  (forall x p due, o = Some x -> In (p, due) (armed x) -> In (p, due) (armed sl) \/ clock s < due) -> rest_of s' u.
Proof.
  intros G AR L EO EC K x p due Lu I. rewrite EC. rewrite EO in Lu. destruct (N.eq_dec u t) as [->|N].
  - rewrite (lookup_replace t o _ sl (g_nodup _ _ _ G) L) in Lu. destruct (K x p due Lu I); auto. eapply AR; eauto.
  - rewrite lookup_replace_other in Lu by auto. eapply AR; eauto.
Qed.
Theorem a20_rest cfg tr s u b s' ds : good cfg tr s -> rest_of s u -> apply cfg s b = (s', ds) ->
  rest_of s' u /\ clock s' = clock s.
Proof.
  intros G AR. destruct b as [t d|t p d bl|t p|t p|]; cbn [apply].
  - unfold open. destruct (first_reason _) eqn:F; intros [= <- _]; auto. cbn in F.
    destruct (reached s t) eqn:Re; [discriminate|]. destruct (window cfg <=? _); [discriminate|].
    split; auto. intros x p due. cbn. rewrite lookup_app by (intros I; apply (g_reached _ _ _ G) in I; congruence).
    destruct (t =? u); [|apply AR]. intros [= <-]. cbn. destruct d as [e|]; cbn; [|intros []].
    intros [[= <- <-]|[]]. destruct (N.leb_spec (due_at (clock s) e) (clock s)); [discriminate|auto].
  - unfold offer. destruct (first_reason _) eqn:F; [intros [= <- _]; auto|].
    apply f2_none in F as (sl & L & _ & _ & _ & D). rewrite (slot_of_open _ _ _ L).
    destruct (gate_shut cfg s p bl); intros [= <- _]; [split; auto|]. split; auto.
    eapply (rest_replace cfg tr s u t sl _ _ G AR L); [reflexivity|reflexivity|]. intros x q due [= <-]. cbn.
    intros I. apply add_in in I as [[= -> ->]|I]; auto.
  - unfold arrive. destruct (first_reason _) eqn:F; [intros [= <- _]; auto|].
    apply f3_none in F as (sl & L & _). rewrite (slot_of_open _ _ _ L). unfold update. intros [= <- _]. split; auto.
    eapply (rest_replace cfg tr s u t sl _ _ G AR L); [reflexivity|reflexivity|]. intros x q due.
    unfold result, improve.
    destruct (is_progressive cfg); [|destruct (any_above p (pending sl))]; cbn; try discriminate.
    + destruct (filter _ (pending sl)); cbn; [discriminate|]. intros [= <-]. cbn. rewrite filter_In. tauto.
    + intros [= <-]. cbn. destruct (_ || _); [rewrite filter_In; tauto|auto].
  - unfold arrive. destruct (first_reason _) eqn:F; [intros [= <- _]; auto|].
    apply f3_none in F as (sl & L & _). rewrite (slot_of_open _ _ _ L). unfold update. intros [= <- _]. split; auto.
    eapply (rest_replace cfg tr s u t sl _ _ G AR L); [reflexivity|reflexivity|]. intros x q due. unfold fail.
    destruct (settle _ _ _ _ _) as [o e] eqn:Se. cbn. intros ->. apply settle_keeps in Se as ->. cbn.
    rewrite filter_In. tauto.
  - intros [= <- _]. auto.
Qed.

(** ** Steps and runs *)
Lemma step_reach cfg tr s i s' ds : reach cfg tr s None -> step cfg s i = (s', ds) ->
  reach cfg (after ds (Got (N.max (clock s) (at_ i)) (what i) :: tr)) s' None /\ at_rest s'.
Proof.
  intros R. unfold step. assert (R0 := at_input cfg tr s (at_ i) (what i) R). set (s0 := set_clock (at_ i) s) in *.
  destruct (expire _ cfg s0) as [s1 ds1] eqn:E. destruct (apply cfg s1 (what i)) as [s2 ds2] eqn:A. intros [= <- <-].
  destruct (expire_reach cfg _ _ s0 s1 ds1 (what i) R0 (le_n _) E) as (R1 & AR & _).
  rewrite after_app. split; [eapply at_apply; eauto|]. intros u. eapply a20_rest; [eapply reach_good; exact R1|apply AR|exact A].
Qed.
Lemma run_reach_from cfg ins : forall tr s, reach cfg tr s None -> at_rest s ->
  let (s', tr') := run cfg s tr ins in reach cfg tr' s' None /\ at_rest s'.
Proof.
  induction ins as [|i ins IH]; intros tr s R AR; cbn; auto.
  destruct (step cfg s i) as [s1 ds] eqn:S. destruct (step_reach _ _ _ _ _ _ R S). now apply IH.
Qed.
Theorem run_reach cfg ins : reach cfg (trace_of cfg ins) (state_after cfg ins) None /\ at_rest (state_after cfg ins).
Proof.
  unfold trace_of, state_after. assert (X := run_reach_from cfg ins [] initial (at_start cfg)).
  destruct (run cfg initial [] ins). apply X. intros u sl p due L. discriminate.
Qed.
Lemma reach_clock cfg tr s cur : reach cfg tr s cur -> clock s = clock_of tr.
Proof.
  induction 1 as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U]; auto;
    rewrite ?clock_after, <- ?IH.
  - unfold update in U. injection U as <- _. reflexivity.
  - eapply (a20_rest _ _ _ 0) in U as [_ ->]; [reflexivity|eapply reach_good; exact R|apply A].
Qed.
