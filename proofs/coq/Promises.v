(** * P1 to P8, P12 and F7: the trace of any run is as Statements.v says *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Tables Lines Arrivals.
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
Lemma no_timer_at_apply cfg s b now u p : ~ In (Timer now u p) (snd (apply cfg s b)).
Proof.
  assert (O := apply_own cfg s b). destruct b as [t d|t q d bl|t q|t q|]; cbn [own] in O.
  - destruct O as [->|(w & ->)]; intros [[=]|[]].
  - destruct O as [->|(w & ->)]; intros [[=]|[]].
  - destruct O as [(w & ->)|[(-> & _)|(cs & last & -> & K)]]; [intros [[=]|[]]|intros [[=]|[]]|].
    intros [[=]|I]. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (x & [=] & _)|].
    destruct K as [->|(_ & ->)]; [contradiction|destruct I as [[=]|[]]].
  - destruct O as [(w & ->)|(last & -> & K)]; [intros [[=]|[]]|]. intros [[=]|I].
    destruct K as [->|[->|[(_ & m & ->)|(_ & m & cs & ->)]]];
      [contradiction|destruct I as [[=]|[]]|destruct I as [[=]|[]]|].
    destruct I as [[=]|I]. apply in_map_iff in I as (x & [=] & _).
  - rewrite O. intros [].
Qed.
(** ** What follows from the invariant alone, of many threads too (Threads.v) *)
Section Invariant.
Variables (cfg : config) (tr : trace) (s : state).
Hypothesis G : good cfg tr s.
Local Lemma open_slot t : says tr (opens t) -> ~ says tr (retires cfg t) ->
  exists sl, lookup t (opened s) = Some sl /\ slot_ok cfg sl /\ traced cfg tr t sl.
Proof.
  intros O N. destruct (g_open _ _ _ G t O) as [L|]; [|contradiction].
  destruct (lookup t (opened s)) as [sl|] eqn:E; [|now elim L].
  exists sl. split; auto. split; [now apply (g_slot _ _ _ G t)|now apply (g_traced _ _ _ G)].
Qed.
Lemma good_p1_once : P1_once cfg tr.
Proof.
  intros t NP. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - left. assert (X := a_running _ _ _ _ (g_traced _ _ _ G t sl L)). unfold running in X. now rewrite NP in X.
  - destruct (g_done _ _ _ G t L) as [E|D]; auto. unfold done in D. rewrite NP in D. tauto.
Qed.
Lemma good_p1_progressive : P1_progressive cfg tr.
Proof.
  intros t Pr. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - left. assert (X := a_running _ _ _ _ (g_traced _ _ _ G t sl L)). unfold running in X. rewrite Pr in X.
    destruct X as (ps & E & F & _). eauto.
  - destruct (g_done _ _ _ G t L) as [E|D]; [left; exists []; split; auto; constructor|].
    unfold done in D. rewrite Pr in D. tauto.
Qed.

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

(** ** What follows for a timestamp of which nothing is due *)
Variable t : N.
Hypotheses (Rest : rest_of s t) (Clock : clock s = clock_of tr).
Local Lemma live_later sl p due : lookup t (opened s) = Some sl -> In (p, due) (armed sl) -> clock_of tr < due.
Proof. rewrite <- Clock. apply Rest. Qed.
Local Lemma stable : ~ ~ says tr (retires cfg t) -> says tr (retires cfg t).
Proof. destruct (says_dec tr (retires cfg t) (retires_dec cfg t)); tauto. Qed.
Lemma rest_p5 : P5_output tr t.
Proof.
  intros p A D. destruct (g_floor _ _ _ G t p A) as [L|?]; auto.
  destruct (lookup t (opened s)) as [sl|] eqn:E; [|now elim L].
  assert (T := g_traced _ _ _ G t sl E). assert (O := g_slot _ _ _ G t sl E).
  destruct (a_got _ _ _ _ T p A) as (c & C & _). destruct (ok_prompt _ _ O c C) as (q & Q & Lq).
  destruct (ok_timer _ _ O q Q) as (due & I); [lia|]. assert (X := live_later sl q due E I).
  apply (a_armed _ _ _ _ T) in I as [I _]. apply D in I; lia.
Qed.
Lemma rest_p7 : P7_waits cfg tr t.
Proof.
  intros N. destruct (says_dec tr (opens t) (opens_dec t)) as [O|O].
  2:{ left. intros (d & I & C). apply O, (g_opened _ _ _ G). exists d. split; auto. now apply closes_about in C. }
  destruct (open_slot t O N) as (sl & L & Ok & T). destruct (ok_waits _ _ Ok) as (p & P).
  destruct (N.eq_dec p 0) as [->|Z]; [left; now apply (a_pending _ _ _ _ T) in P|]. right.
  destruct (ok_timer _ _ Ok p P Z) as (due & I). exists p, due. assert (X := live_later sl p due L I).
  apply (a_armed _ _ _ _ T) in I. tauto.
Qed.
Lemma rest_p7_timed : P7_timed cfg tr t.
Proof.
  intros x A N. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct A as (d & I & H). exists d. split; auto. now apply arms_about in H. }
  destruct (rest_p7 N) as [W|?]; auto. destruct (open_slot t O N) as (sl & L & Ok & T).
  assert (I : In (0, x) (armed sl)).
  { apply (a_armed _ _ _ _ T). split; auto. intros (d & I & D). apply W. exists d. split; auto.
    now apply disarms_closes. }
  exists 0, x. assert (X := live_later sl 0 x L I). apply (a_armed _ _ _ _ T) in I. tauto.
Qed.
Lemma rest_p7_ends : P7_ends cfg tr t.
Proof.
  intros x A D. apply stable. intros N. destruct (rest_p7_timed x A N) as (p & due & I & _ & L).
  specialize (D p due I). lia.
Qed.
Lemma rest_p8 : P8_punctual cfg tr t.
Proof.
  intros p due A D N. destruct (says_dec tr (disarms cfg t p) (disarms_dec cfg t p)) as [|Z]; auto. exfalso.
  assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct A as (d & I & H). exists d. split; auto. now apply arms_about in H. }
  destruct (open_slot t O N) as (sl & L & _ & T).
  assert (I : In (p, due) (armed sl)) by (apply (a_armed _ _ _ _ T); auto).
  assert (X := live_later sl p due L I). lia.
Qed.
Lemma rest_p12 : P12_over cfg tr t.
Proof.
  intros C D. apply stable. intros N. destruct (rest_p7 N) as [W|(p & due & A & Z & L)]; [contradiction|].
  destruct (N.eq_dec p 0) as [->|Ne]; [|specialize (D p due Ne A); lia].
  assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct C as (d & I & H). exists d. split; auto. now apply closes_about in H. }
  destruct (open_slot t O N) as (sl & Lk & Ok & T). destruct (ok_waits _ _ Ok) as (q & P).
  assert (Y : q <> 0) by (intros ->; apply (a_pending _ _ _ _ T) in P; tauto).
  destruct (ok_timer _ _ Ok q P Y) as (e & I). assert (X := live_later sl q e Lk I).
  apply (a_armed _ _ _ _ T) in I as [I _]. specialize (D q e Y I). lia.
Qed.
End Invariant.

Section Of.
Variables (cfg : config) (ins : list input).
Let tr := trace_of cfg ins.
Let s := state_after cfg ins.
Let R : reach cfg tr s None := proj1 (run_reach cfg ins).
Let AR : at_rest s := proj2 (run_reach cfg ins).
Let G : good cfg tr s := reach_good _ _ _ _ R.

Let Ck : clock s = clock_of tr := reach_clock _ _ _ _ R.

(** The four sets of an open timestamp (section 2) are what the lines of its trace say. *)
Theorem sets_of_the_trace t sl : lookup t (opened s) = Some sl ->
  (forall p, In p (requested sl) <-> p = 0 \/ says tr (requests t p)) /\
  (forall p, In p (pending sl) <-> In p (requested sl) /\ ~ says tr (closes cfg t p)) /\
  (is_progressive cfg = false -> forall p, In p (cached sl) <-> says tr (holds t p)) /\
  (is_progressive cfg = true -> exists ps, endings t tr = map Sent ps /\ cached sl = firstn 1 ps) /\
  (forall p due, In (p, due) (armed sl) <-> says tr (arms t p due) /\ ~ says tr (disarms cfg t p)).
Proof.
  intros L. assert (T := g_traced _ _ _ G t sl L). split; [apply (a_requested _ _ _ _ T)|].
  split; [apply (a_pending _ _ _ _ T)|].
  split; [apply (a_cached _ _ _ _ T)|]. split; [|apply (a_armed _ _ _ _ T)].
  intros Pr. assert (X := a_running _ _ _ _ T). unfold running in X. rewrite Pr in X.
  destruct X as (ps & E & _ & C). eauto.
Qed.

(** Each beginning of a run is a run. *)
Lemma reach_beginnings tr0 s0 cur : reach cfg tr0 s0 cur -> forall later now b earlier,
  tr0 = later ++ Got now b :: earlier -> settled cfg earlier.
Proof.
  assert (Same : forall ds x, (forall later now b earlier, x = later ++ Got now b :: earlier -> settled cfg earlier) ->
    forall later now b earlier, after ds x = later ++ Got now b :: earlier -> settled cfg earlier).
  { intros ds x H later now b earlier E. unfold after in E. rewrite <- map_rev in E.
    apply got_after_split in E as (y & E & _). eapply H; eauto. }
  induction 1 as [|x s1 n b R1 IH|x s1 b due t s' ds R1 IH E L U|x s1 b s' ds R1 IH A U]; eauto.
  - intros later now b earlier E. destruct later; discriminate.
  - intros [|l later] now c earlier E.
    + injection E as _ _ <-. exact (proj2 (reach_settled cfg x s1 None R1)).
    + injection E as _ E. eapply IH; eauto.
Qed.

(** ** P1 to P4 *)
Theorem p1_once : P1_once cfg tr. Proof. exact (good_p1_once _ _ _ G). Qed.
Theorem p1_progressive : P1_progressive cfg tr. Proof. exact (good_p1_progressive _ _ _ G). Qed.
Theorem p2_late_dropped : P2_late_dropped tr.
Proof. exact (c_late _ _ (proj2 (reach_settled cfg tr s None R))). Qed.
Theorem p3_best_available : P3_best_available tr.
Proof.
  exact (settled_best cfg tr (reach_beginnings tr s None R) (l_each _ _ _ _ (reach_lines _ _ _ _ R)) p1_once
    p1_progressive (g_best _ _ _ G)).
Qed.
Theorem p3_progressive : P3_progressive cfg tr.
Proof. exact (settled_progressive cfg tr (l_each _ _ _ _ (reach_lines _ _ _ _ R)) (proj2 (reach_settled cfg tr s None R))). Qed.
Theorem p4_prompt : P4_prompt cfg tr. Proof. exact (good_p4_prompt _ _ _ G). Qed.
Theorem f7_cancels : F7_cancels cfg tr. Proof. exact (proj1 (reach_settled cfg tr s None R)). Qed.

(** ** P5 to P8, P12 *)
Theorem p5_local_floor : P5_local_floor tr. Proof. intros t. exact (rest_p5 _ _ _ G t (AR t) Ck). Qed.
Theorem p6_free_without_cloud : P6_free_without_cloud tr. Proof. exact (good_p6_free_without_cloud _ _ _ G). Qed.
Theorem p7_no_stall : P7_no_stall cfg tr. Proof. intros t. exact (rest_p7 _ _ _ G t (AR t) Ck). Qed.
Theorem p7_with_deadline : P7_with_deadline cfg tr. Proof. intros t. exact (rest_p7_timed _ _ _ G t (AR t) Ck). Qed.
Theorem p7_retired : P7_retired cfg tr. Proof. intros t. exact (rest_p7_ends _ _ _ G t (AR t) Ck). Qed.
Theorem p8_one_timer : P8_one_timer tr. Proof. exact (good_p8_one_timer _ _ _ G). Qed.
Theorem p8_served : P8_served cfg tr. Proof. intros t. exact (rest_p8 _ _ _ G t (AR t) Ck). Qed.
Theorem p12_bounded_wait : P12_bounded_wait cfg tr. Proof. intros t. exact (rest_p12 _ _ _ G t (AR t) Ck). Qed.
End Of.
