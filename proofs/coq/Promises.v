(** * The promises of SPEC.md, section 4, over the trace of any run

    [tr] is the trace of any inputs under any configuration, and nothing else is spoken of: what came in, and what was
    decided. Since each beginning of a run is a run, "by an instant" reads: whenever the clock of the trace has reached
    it. The words are those of Trace.v. Examples.v computes a run for each hypothesis, and breaks each statement. *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Rules Sets Trace Slots Kept Runs.
Import ListNotations.
Open Scope N_scope.

Section Of.
Variables (cfg : config) (ins : list input).
Let tr := trace_of cfg ins.
Let s := state_after cfg ins.
Let R : reach cfg tr s None := proj1 (run_reach cfg ins).
Let AR : at_rest s := proj2 (run_reach cfg ins).
Let G : good cfg tr s := reach_good _ _ _ _ R.

Local Lemma clock_is : clock s = clock_of tr.
Proof. exact (reach_clock _ _ _ _ R). Qed.
Local Lemma open_slot t : says tr (opens t) -> ~ says tr (retires cfg t) ->
  exists sl, lookup t (opened s) = Some sl /\ slot_ok cfg sl /\ told cfg tr t sl.
Proof.
  intros O N. destruct (g_open _ _ _ G t O) as [L|]; [|contradiction]. destruct (lookup t (opened s)) as [sl|] eqn:E; [|now elim L].
  exists sl. split; auto. split; [now apply (g_slot _ _ _ G t)|now apply (g_told _ _ _ G)].
Qed.
Local Lemma live_later t sl p due : lookup t (opened s) = Some sl -> In (p, due) (armed sl) -> clock_of tr < due.
Proof. rewrite <- clock_is. apply AR. Qed.

Local Lemma stable t : ~ ~ says tr (retires cfg t) -> says tr (retires cfg t).
Proof. destruct (says_dec tr (retires cfg t) (retires_dec cfg t)); tauto. Qed.
Local Lemma stable_timer t p : ~ ~ says tr (disarms cfg t p) -> says tr (disarms cfg t p).
Proof. destruct (says_dec tr (disarms cfg t p) (disarms_dec cfg t p)); tauto. Qed.

(** ** P1 once *)

(** Under eager and patient a timestamp is forwarded once, or missed once, or neither, but never both or again. *)
Theorem p1_once t : is_progressive cfg = false ->
  endings t tr = [] \/ endings t tr = [Missed] \/ exists p, endings t tr = [Sent p].
Proof.
  intros NP. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - left. assert (X := a_running _ _ _ _ (g_told _ _ _ G t sl L)). unfold running in X. now rewrite NP in X.
  - destruct (g_done _ _ _ G t L) as [E|D]; auto. unfold done in D. rewrite NP in D. tauto.
Qed.
(** Under progressive its outputs rise strictly, a final or a miss comes at most once and last, a miss only without
    outputs, and a final names the last of them. *)
Theorem p1_progressive t : is_progressive cfg = true ->
  (exists ps, endings t tr = map Sent ps /\ falling ps) \/ endings t tr = [Missed] \/
  exists p ps, endings t tr = Ended p :: Sent p :: map Sent ps /\ falling (p :: ps).
Proof.
  intros Pr. destruct (lookup t (opened s)) as [sl|] eqn:L.
  - left. assert (X := a_running _ _ _ _ (g_told _ _ _ G t sl L)). unfold running in X. rewrite Pr in X.
    destruct X as (ps & E & F & _). eauto.
  - destruct (g_done _ _ _ G t L) as [E|D]; [left; exists []; split; auto; constructor|].
    unfold done in D. rewrite Pr in D. tauto.
Qed.

(** ** P2 never late *)

(** Whatever is forwarded had been asked for, and came before the due instant of its request, or of local, if any. *)
Theorem p2_never_late t p : says tr (emits t p) -> in_time tr t p.
Proof. intros (d & I & E). apply (g_accepted _ _ _ G). exists d. split; auto. now right. Qed.

(** ** P3 best available *)

(** No result that was ever held for a timestamp outranks the one that is forwarded. *)
Theorem p3_best_available t m q : says tr (emits t m) -> says tr (holds t q) -> q <= m.
Proof. apply (g_best _ _ _ G). Qed.

(** ** P4 prompt *)

(** While results are held, something that was asked for and has not come outranks all of them. *)
Theorem p4_prompt t c : says tr (holds t c) -> ~ says tr (retires cfg t) ->
  exists q, says tr (requests t q) /\ ~ says tr (closes cfg t q) /\ forall b, says tr (holds t b) -> b < q.
Proof.
  intros H N. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct H as (d & I & H). exists d. split; auto. now apply holds_about in H. }
  destruct (open_slot t O N) as (sl & L & Ok & T).
  assert (NP : is_progressive cfg = false).
  { destruct (is_progressive cfg) eqn:E; auto. now apply (a_never _ _ _ _ T E) in H. }
  assert (C := a_cached _ _ _ _ T NP). destruct (greatest (cached sl)) as [m|] eqn:Gr.
  - apply greatest_some in Gr as [M B]. destruct (ok_prompt _ _ Ok m M) as (q & Q & Lq). exists q.
    assert (P := Q). apply (a_pending _ _ _ _ T) in P as [Rq Cl]. apply (a_requested _ _ _ _ T) in Rq as [->|Rq]; [lia|].
    repeat split; auto. intros b Hb. apply C in Hb. specialize (B b Hb). lia.
  - apply greatest_none in Gr. apply C in H. rewrite Gr in H. contradiction.
Qed.

(** ** P5 local floor *)

(** Once any result was accepted, local's or a cloud's, its timestamp has an output by the latest due instant of its
    requests. *)
Theorem p5_local_floor t p : says tr (accepts t p) ->
  (forall q due, q <> 0 -> says tr (arms t q due) -> due <= clock_of tr) -> exists m, says tr (emits t m).
Proof.
  intros A D. destruct (g_floor _ _ _ G t p A) as [L|?]; auto. destruct (lookup t (opened s)) as [sl|] eqn:E; [|now elim L].
  assert (T := g_told _ _ _ G t sl E). assert (O := g_slot _ _ _ G t sl E).
  destruct (a_got _ _ _ _ T p A) as (c & C & _). destruct (ok_prompt _ _ O c C) as (q & Q & Lq).
  destruct (ok_timer _ _ O q Q) as (due & I); [lia|]. assert (X := live_later t sl q due E I).
  apply (a_armed _ _ _ _ T) in I as [I _]. apply D in I; lia.
Qed.

(** ** P6 free without cloud *)

(** Local's result is held only for a timestamp for which a request was admitted. *)
Theorem p6_free_without_cloud t : says tr (holds t 0) -> exists p, says tr (requests t p).
Proof. apply (g_free _ _ _ G). Qed.

(** ** P7 no stall *)

(** A timestamp that was opened and is not retired waits for local, or has a live timer that is due later. *)
Theorem p7_no_stall t : says tr (opens t) -> ~ says tr (retires cfg t) -> ~ says tr (closes cfg t 0) \/
  exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
Proof.
  intros O N. destruct (open_slot t O N) as (sl & L & Ok & T). destruct (ok_waits _ _ Ok) as (p & P).
  destruct (N.eq_dec p 0) as [->|Z]; [left; now apply (a_pending _ _ _ _ T) in P|]. right.
  destruct (ok_timer _ _ Ok p P Z) as (due & I). exists p, due. assert (X := live_later t sl p due L I).
  apply (a_armed _ _ _ _ T) in I. tauto.
Qed.
(** One that was opened with a deadline has a live timer as long as it is open. *)
Theorem p7_with_deadline t x : says tr (arms t 0 x) -> ~ says tr (retires cfg t) ->
  exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
Proof.
  intros A N. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct A as (d & I & H). exists d. split; auto. now apply arms_about in H. }
  destruct (p7_no_stall t O N) as [W|?]; auto. destruct (open_slot t O N) as (sl & L & Ok & T).
  assert (I : In (0, x) (armed sl)).
  { apply (a_armed _ _ _ _ T). split; auto. intros (d & I & D). apply W. exists d. split; auto. now apply disarms_closes. }
  exists 0, x. assert (X := live_later t sl 0 x L I). apply (a_armed _ _ _ _ T) in I. tauto.
Qed.
(** And it is retired by the latest due instant that was ever armed for it. *)
Theorem p7_retired t x : says tr (arms t 0 x) -> (forall p due, says tr (arms t p due) -> due <= clock_of tr) ->
  says tr (retires cfg t).
Proof.
  intros A D. apply stable. intros N. destruct (p7_with_deadline t x A N) as (p & due & I & _ & L). specialize (D p due I). lia.
Qed.

(** ** P8 timers *)

(** A request, and local, arms at most one due instant. *)
Theorem p8_one_timer t p a b : says tr (arms t p a) -> says tr (arms t p b) -> a = b.
Proof. apply (g_one _ _ _ G). Qed.
(** The live timers of an open timestamp are those that were armed and were not ended by what P8 names. *)
Theorem p8_live t sl p due : lookup t (opened s) = Some sl ->
  (In (p, due) (armed sl) <-> says tr (arms t p due) /\ ~ says tr (disarms cfg t p)).
Proof. intros L. exact (a_armed _ _ _ _ (g_told _ _ _ G t sl L) p due). Qed.
(** None is overdue: an armed timer that is due has ended, or its timestamp has. *)
Theorem p8_served t p due : says tr (arms t p due) -> due <= clock_of tr -> ~ says tr (retires cfg t) ->
  says tr (disarms cfg t p).
Proof.
  intros A D N. apply stable_timer. intros Z. assert (O : says tr (opens t)).
  { apply (g_opened _ _ _ G). destruct A as (d & I & H). exists d. split; auto. now apply arms_about in H. }
  destruct (open_slot t O N) as (sl & L & _ & T).
  assert (I : In (p, due) (armed sl)) by (apply (a_armed _ _ _ _ T); auto).
  assert (X := live_later t sl p due L I). lia.
Qed.

(** ** P12 bounded wait *)

(** Once local has arrived, or was outdone, and the due instants of all requests are past, a timestamp is retired. *)
Theorem p12_bounded_wait t : says tr (opens t) -> says tr (closes cfg t 0) ->
  (forall p due, p <> 0 -> says tr (arms t p due) -> due <= clock_of tr) -> says tr (retires cfg t).
Proof.
  intros O C D. apply stable. intros N. destruct (open_slot t O N) as (sl & L & Ok & T). destruct (ok_waits _ _ Ok) as (p & P).
  assert (Z : p <> 0) by (intros ->; apply (a_pending _ _ _ _ T) in P; tauto).
  destruct (ok_timer _ _ Ok p P Z) as (due & I). assert (X := live_later t sl p due L I).
  apply (a_armed _ _ _ _ T) in I as [I _]. specialize (D p due Z I). lia.
Qed.
End Of.
