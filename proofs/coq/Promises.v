(** * P1 to P8 and P12: the trace of any run is as Statements.v says *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Rules Sets Trace Statements Slots Kept Runs Accounts.
Import ListNotations.
Open Scope N_scope.

Arguments after : simpl never.
Lemma timer_at_firing cfg now t timer sl o ds : settle cfg now t timer sl = (o, ds) ->
  forall a u p, ~ In (Timer a u p) ds.
Proof.
  intros H a u p I. apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & ->
    & _)|(_ & m & E & _)]]].
  - contradiction.
  - destruct I as [[=]|[]].
  - destruct I as [[=]|[]].
  - injection E as _ ->. destruct I as [[=]|I]. apply in_map_iff in I as (q & [=] & _).
Qed.
Lemma reach_fires cfg tr s cur : reach cfg tr s cur -> P8_fires tr.
Proof.
  intros R. induction R as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U]; intros now u p I.
  - contradiction.
  - destruct I as [[=]|I]. destruct (IH now u p I) as (e & H & Le). exists e. now rewrite says_got.
  - unfold after in I. apply in_app_or in I as [I|I].
    2:{ destruct (IH now u p I) as (e & H & Le). exists e. rewrite says_after. auto. }
    apply in_rev in I. apply in_map_iff in I as (d & [= ->] & I).
    assert (G := reach_good _ _ _ _ R). destruct (due_lookup _ _ _ _ _ G E) as (sl & q & Lk & _).
    rewrite (slot_of_open _ _ _ Lk) in U. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
    injection U as <- <-.
    apply in_app_or in I as [I|I]; [|elim (timer_at_firing _ _ _ _ _ _ _ Se _ _ _ I)].
    apply in_map_iff in I as (x & [= <- <- <-] & I). apply fired_in in I. exists due. split; auto. apply says_after.
    right.
    now apply (a_armed _ _ _ _ (g_told _ _ _ G t sl Lk)).
  - unfold after in I. apply in_app_or in I as [I|I].
    2:{ destruct (IH now u p I) as (e & H & Le). exists e. rewrite says_after. auto. }
    apply in_rev in I. apply in_map_iff in I as (d & [= ->] & I). exfalso.
    assert (O := apply_own cfg s b). rewrite U in O. cbn in O. revert I. clear - O.
    destruct b as [t d|t q d bl|t q|t q|]; cbn in O.
    + destruct O as [->|(w & ->)]; intros [[=]|[]].
    + destruct O as [->|(w & ->)]; intros [[=]|[]].
    + destruct O as [(w & ->)|[(-> & _)|(cs & last & -> & K)]]; [intros [[=]|[]]|intros [[=]|[]]|].
      intros [[=]|I]. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (x & [=] & _)|].
      destruct K as [->|(_ & ->)]; [contradiction|destruct I as [[=]|[]]].
    + destruct O as [(w & ->)|(last & -> & K)]; [intros [[=]|[]]|]. intros [[=]|I].
      destruct K as [->|[->|[(_ & m & ->)|(_ & m & cs & ->)]]];
        [contradiction|destruct I as [[=]|[]]|destruct I as [[=]|[]]|].
      destruct I as [[=]|I]. apply in_map_iff in I as (x & [=] & _).
    + subst. contradiction.
Qed.

(** ** What follows from the invariant alone, of many threads too (Threads.v) *)
Section Invariant.
Variables (cfg : config) (tr : trace) (s : state).
Hypothesis G : good cfg tr s.
Local Lemma open_slot t : says tr (opens t) -> ~ says tr (retires cfg t) ->
  exists sl, lookup t (opened s) = Some sl /\ slot_ok cfg sl /\ told cfg tr t sl.
Proof.
  intros O N. destruct (g_open _ _ _ G t O) as [L|]; [|contradiction].
  destruct (lookup t (opened s)) as [sl|] eqn:E; [|now elim L].
  exists sl. split; auto. split; [now apply (g_slot _ _ _ G t)|now apply (g_told _ _ _ G)].
Qed.
Lemma good_p1_once : P1_once cfg tr.
Proof.
  intros t NP. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - left. assert (X := a_running _ _ _ _ (g_told _ _ _ G t sl L)). unfold running in X. now rewrite NP in X.
  - destruct (g_done _ _ _ G t L) as [E|D]; auto. unfold done in D. rewrite NP in D. tauto.
Qed.
Lemma good_p1_progressive : P1_progressive cfg tr.
Proof.
  intros t Pr. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - left. assert (X := a_running _ _ _ _ (g_told _ _ _ G t sl L)). unfold running in X. rewrite Pr in X.
    destruct X as (ps & E & F & _). eauto.
  - destruct (g_done _ _ _ G t L) as [E|D]; [left; exists []; split; auto; constructor|].
    unfold done in D. rewrite Pr in D. tauto.
Qed.

Lemma good_p2_never_late : P2_never_late tr.
Proof. intros t p. intros (d & I & E). apply (g_accepted _ _ _ G). exists d. split; auto. now right. Qed.

Lemma good_p3_best_available : P3_best_available tr.
Proof. intros t m q. apply (g_best _ _ _ G). Qed.

Lemma good_p4_prompt : P4_prompt cfg tr.
Proof.
  intros t c H N. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct H as (d & I & H). exists d. split; auto. now apply holds_about in H. }
  destruct (open_slot t O N) as (sl & L & Ok & T).
  assert (NP : is_progressive cfg = false).
  { destruct (is_progressive cfg) eqn:E; auto. now apply (a_never _ _ _ _ T E) in H. }
  assert (C := a_cached _ _ _ _ T NP). destruct (greatest (cached sl)) as [m|] eqn:Gr.
  - apply greatest_some in Gr as [M B]. destruct (ok_prompt _ _ Ok m M) as (q & Q & Lq). exists q.
    assert (P := Q). apply (a_pending _ _ _ _ T) in P as [Rq Cl].
    apply (a_requested _ _ _ _ T) in Rq as [->|Rq]; [lia|].
    repeat split; auto. intros b Hb. apply C in Hb. specialize (B b Hb). lia.
  - apply greatest_none in Gr. apply C in H. rewrite Gr in H. contradiction.
Qed.
Lemma good_p6_free_without_cloud : P6_free_without_cloud tr.
Proof. intros t. apply (g_free _ _ _ G). Qed.
Lemma good_p8_one_timer : P8_one_timer tr.
Proof. intros t p a b. apply (g_one _ _ _ G). Qed.
End Invariant.

Section Of.
Variables (cfg : config) (ins : list input).
Let tr := trace_of cfg ins.
Let s := state_after cfg ins.
Let R : reach cfg tr s None := proj1 (run_reach cfg ins).
Let AR : at_rest s := proj2 (run_reach cfg ins).
Let G : good cfg tr s := reach_good _ _ _ _ R.

Local Lemma clock_is : clock s = clock_of tr.
Proof. exact (reach_clock _ _ _ _ R). Qed.
Local Notation open_slot := (open_slot cfg tr s G).
Local Lemma live_later t sl p due : lookup t (opened s) = Some sl -> In (p, due) (armed sl) -> clock_of tr < due.
Proof. rewrite <- clock_is. apply AR. Qed.

Local Lemma stable t : ~ ~ says tr (retires cfg t) -> says tr (retires cfg t).
Proof. destruct (says_dec tr (retires cfg t) (retires_dec cfg t)); tauto. Qed.
Local Lemma stable_timer t p : ~ ~ says tr (disarms cfg t p) -> says tr (disarms cfg t p).
Proof. destruct (says_dec tr (disarms cfg t p) (disarms_dec cfg t p)); tauto. Qed.

(** The four sets of an open timestamp (section 2) are what the lines of its trace say. *)
Theorem sets_of_the_trace t sl : lookup t (opened s) = Some sl ->
  (forall p, In p (requested sl) <-> p = 0 \/ says tr (requests t p)) /\
  (forall p, In p (pending sl) <-> In p (requested sl) /\ ~ says tr (closes cfg t p)) /\
  (is_progressive cfg = false -> forall p, In p (cached sl) <-> says tr (holds t p)) /\
  (is_progressive cfg = true -> exists ps, endings t tr = map Sent ps /\ cached sl = firstn 1 ps) /\
  (forall p due, In (p, due) (armed sl) <-> says tr (arms t p due) /\ ~ says tr (disarms cfg t p)).
Proof.
  intros L. assert (T := g_told _ _ _ G t sl L). split; [apply (a_requested _ _ _ _ T)|].
  split; [apply (a_pending _ _ _ _ T)|].
  split; [apply (a_cached _ _ _ _ T)|]. split; [|apply (a_armed _ _ _ _ T)].
  intros Pr. assert (X := a_running _ _ _ _ T). unfold running in X. rewrite Pr in X.
  destruct X as (ps & E & _ & C). eauto.
Qed.

(** ** P1 to P4 *)
Theorem p1_once : P1_once cfg tr. Proof. exact (good_p1_once _ _ _ G). Qed.
Theorem p1_progressive : P1_progressive cfg tr. Proof. exact (good_p1_progressive _ _ _ G). Qed.
Theorem p2_never_late : P2_never_late tr. Proof. exact (good_p2_never_late _ _ _ G). Qed.
Theorem p3_best_available : P3_best_available tr. Proof. exact (good_p3_best_available _ _ _ G). Qed.
Theorem p4_prompt : P4_prompt cfg tr. Proof. exact (good_p4_prompt _ _ _ G). Qed.

(** ** P5 local floor *)
Theorem p5_local_floor : P5_local_floor tr.
Proof.
  intros t p A D. destruct (g_floor _ _ _ G t p A) as [L|?]; auto.
  destruct (lookup t (opened s)) as [sl|] eqn:E; [|now elim L].
  assert (T := g_told _ _ _ G t sl E). assert (O := g_slot _ _ _ G t sl E).
  destruct (a_got _ _ _ _ T p A) as (c & C & _). destruct (ok_prompt _ _ O c C) as (q & Q & Lq).
  destruct (ok_timer _ _ O q Q) as (due & I); [lia|]. assert (X := live_later t sl q due E I).
  apply (a_armed _ _ _ _ T) in I as [I _]. apply D in I; lia.
Qed.

(** ** P6 free without cloud *)
Theorem p6_free_without_cloud : P6_free_without_cloud tr.
Proof. exact (good_p6_free_without_cloud _ _ _ G). Qed.

(** ** P7 no stall *)
Theorem p7_no_stall : P7_no_stall cfg tr.
Proof.
  intros t O N. destruct (open_slot t O N) as (sl & L & Ok & T). destruct (ok_waits _ _ Ok) as (p & P).
  destruct (N.eq_dec p 0) as [->|Z]; [left; now apply (a_pending _ _ _ _ T) in P|]. right.
  destruct (ok_timer _ _ Ok p P Z) as (due & I). exists p, due. assert (X := live_later t sl p due L I).
  apply (a_armed _ _ _ _ T) in I. tauto.
Qed.
Theorem p7_with_deadline : P7_with_deadline cfg tr.
Proof.
  intros t x A N. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct A as (d & I & H). exists d. split; auto. now apply arms_about in H. }
  destruct (p7_no_stall t O N) as [W|?]; auto. destruct (open_slot t O N) as (sl & L & Ok & T).
  assert (I : In (0, x) (armed sl)).
  { apply (a_armed _ _ _ _ T). split; auto. intros (d & I & D). apply W. exists d. split; auto.
    now apply disarms_closes. }
  exists 0, x. assert (X := live_later t sl 0 x L I). apply (a_armed _ _ _ _ T) in I. tauto.
Qed.
Theorem p7_retired : P7_retired cfg tr.
Proof.
  intros t x A D. apply stable. intros N. destruct (p7_with_deadline t x A N) as (p & due & I & _ & L).
  specialize (D p due I). lia.
Qed.

(** ** P8 timers *)
Theorem p8_one_timer : P8_one_timer tr.
Proof. exact (good_p8_one_timer _ _ _ G). Qed.
Theorem p8_fires : P8_fires tr. Proof. exact (reach_fires _ _ _ _ R). Qed.
(** The live timers of an open timestamp are those that were armed and were not ended by what P8 names. *)
Theorem p8_live t sl p due : lookup t (opened s) = Some sl ->
  (In (p, due) (armed sl) <-> says tr (arms t p due) /\ ~ says tr (disarms cfg t p)).
Proof. intros L. exact (a_armed _ _ _ _ (g_told _ _ _ G t sl L) p due). Qed.
Theorem p8_served : P8_served cfg tr.
Proof.
  intros t p due A D N. apply stable_timer. intros Z. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct A as (d & I & H). exists d. split; auto. now apply arms_about in H. }
  destruct (open_slot t O N) as (sl & L & _ & T).
  assert (I : In (p, due) (armed sl)) by (apply (a_armed _ _ _ _ T); auto).
  assert (X := live_later t sl p due L I). lia.
Qed.

(** ** P12 bounded wait *)
Theorem p12_bounded_wait : P12_bounded_wait cfg tr.
Proof.
  intros t O C D. apply stable. intros N. destruct (open_slot t O N) as (sl & L & Ok & T).
  destruct (ok_waits _ _ Ok) as (p & P).
  assert (Z : p <> 0) by (intros ->; apply (a_pending _ _ _ _ T) in P; tauto).
  destruct (ok_timer _ _ Ok p P Z) as (due & I). assert (X := live_later t sl p due L I).
  apply (a_armed _ _ _ _ T) in I as [I _]. specialize (D p due Z I). lia.
Qed.
End Of.
