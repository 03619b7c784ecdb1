(** * For each promise a run where its hypothesis holds, and a trace of a faulty machine that breaks it

    The runs are of the rules, computed. The faulty traces are written by hand, the newest line first. *)
From Coq Require Import List NArith Bool.
From Fuseline Require Import Rules Trace Statements Broken Cases Accounts Ticks AsPatient Threads Looks Names Answered.
Import ListNotations.
Open Scope N_scope.

Example p1_once_happens : endings 1 (trace_of eager over) = [Sent 1]. Proof. happens. Qed.
Example p1_once_can_break : ~ P1_once eager [Did (Emit 60 1 2); Did (Emit 50 1 1); Did (Opened 0 1 None)].
Proof. breaks (broken_p1 eager _ 1). Qed.
Example p1_progressive_happens : endings 1 (trace_of progressive (held ++ [input_at 30 (Result 1 2)])) = [Ended 2;
  Sent 2; Sent 1; Sent 0].
Proof. happens. Qed.
Example p1_progressive_can_break : ~ P1_progressive progressive [Did (Emit 20 1 0); Did (Emit 10 1 1);
  Did (Opened 0 1 None)].
Proof. breaks (broken_p1_progressive progressive _ 1). Qed.

Example p2_never_late_happens : sayb (trace_of eager committed) (b_emits 1 1) = true. Proof. happens. Qed.
(** At the due instant it is late. *)
Example p2_never_late_can_break : ~ P2_never_late
  [Did (Emit 50 1 1); Got 50 (Result 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p2 _ 1 1). Qed.
(** A first copy comes in time and nothing is made of it; a second one comes late and is forwarded. *)
Definition second_copy : trace := [Did (Emit 60 1 1); Got 60 (Result 1 1); Got 10 (Result 1 1); Did (Request 0 1 1 50);
  Got 0 (Offer 1 1 50 0); Did (Opened 0 1 None); Got 0 (Open 1 None)].
Example second_copy_breaks_p2 : ~ P2_never_late second_copy. Proof. breaks (broken_p2 _ 1 1). Qed.
(** Or the first copy is held, so that the line of the output might be its. *)
Definition held_copy : trace := [Did (Emit 60 1 1); Got 60 (Result 1 1); Did (Hold 10 1 1); Got 10 (Result 1 1);
  Did (Request 0 1 2 80); Got 0 (Offer 1 2 80 0); Did (Request 0 1 1 50); Got 0 (Offer 1 1 50 0); Did (Opened 0 1 None); Got 0 (Open 1 None)].
Example held_copy_breaks_p2 : ~ P2_late_dropped held_copy. Proof. breaks (broken_p2_late _ 1 1). Qed.
Example p2_late_dropped_happens : armed_in 1 (trace_of eager waiting) = [(1, 50); (0, 100)] /\
  snd (step eager (state_after eager waiting) (input_at 60 (Result 1 1))) = [Drop 60 1 1 Late].
Proof. split; happens. Qed.
Example p2_late_dropped_can_break : ~ P2_late_dropped second_copy. Proof. breaks (broken_p2_late _ 1 1). Qed.

Example p3_best_available_happens : sayb (trace_of eager committed) (b_emits 1 1) &&
  sayb (trace_of eager committed) (b_holds 1 0) = true.
Proof. happens. Qed.
Example p3_best_available_can_break : ~ P3_best_available [Did (Emit 50 1 0); Did (Hold 20 1 1); Did (Hold 10 1 0)].
Proof. breaks (broken_p3 _ 1 0 1). Qed.
(** Nor may it be passed over by a machine that drops it. *)
Example passed_over_breaks_p3 : ~ P3_best_available [Did (Emit 50 1 0); Got 50 (Result 1 0); Did (Drop 20 1 1 Late);
  Got 20 (Result 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p3 _ 1 0 1). Qed.
(** The second cloud's result comes in time, and is an output; a machine that ends with local's breaks it. *)
Definition first_failed : list input := [input_at 0 (Open 1 None); input_at 0 (Offer 1 1 50 0); input_at 10 (Result 1 0);
  input_at 20 (Fail 1 1); input_at 30 (Result 1 1)].
Example p3_progressive_happens : let tr := trace_of progressive (held ++ [input_at 30 (Result 1 2)]) in
  b_in_time 1 1 tr && b_in_time 1 2 tr = true.
Proof. happens. Qed.
Example p3_progressive_can_break : ~ P3_progressive progressive [Did (Drop 30 1 1 Superseded); Got 30 (Result 1 1);
  Did (Final 10 1 0); Did (Emit 10 1 0); Got 10 (Result 1 0); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p3_progressive progressive _ 1 1). Qed.
(** After its failure a result is not in time (section 1), although its due instant is later: local's output was final. *)
Example failed_is_not_in_time : let tr := trace_of progressive first_failed in
  (decisions tr, b_in_time 1 1 tr) = ([Drop 30 1 1 Superseded; Final 20 1 0; Failed 20 1 1; Emit 10 1 0; Request 0 1 1 50;
    Opened 0 1 None], false).
Proof. happens. Qed.

Example p4_prompt_happens : sayb (trace_of eager held) (b_holds 1 1) &&
  negb (sayb (trace_of eager held) (b_retires eager 1)) = true.
Proof. happens. Qed.
Example p4_prompt_can_break : ~ P4_prompt eager [Did (Hold 20 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p4 eager _ 1 1). Qed.

Example p5_local_floor_happens : sayb (trace_of eager over) (b_accepts 1 0) && past true 1 (trace_of eager over) = true.
Proof. happens. Qed.
Example p5_local_floor_can_break : ~ P5_local_floor
  [Did (Miss 50 1); Did (Timer 50 1 1); Got 50 Tick; Did (Hold 10 1 0); Did (Request 0 1 1 50);
    Did (Opened 0 1 None)].
Proof. breaks (broken_p5 _ 1 0). Qed.

Example p6_free_without_cloud_happens : sayb (trace_of eager held) (b_holds 1 0) = true. Proof. happens. Qed.
Example p6_free_without_cloud_can_break : ~ P6_free_without_cloud [Did (Hold 10 1 0); Did (Opened 0 1 None)].
Proof. breaks (broken_p6 _ 1). Qed.

Example p7_no_stall_happens : sayb (trace_of eager waiting) (b_opens 1) &&
  negb (sayb (trace_of eager waiting) (b_retires eager 1)) = true.
Proof. happens. Qed.
Example p7_no_stall_can_break : ~ P7_no_stall eager [Did (Failed 10 1 0); Got 10 (Fail 1 0); Did (Opened 0 1 None)].
Proof. breaks (broken_p7 eager _ 1). Qed.
Example p7_with_deadline_happens : armed_in 1 (trace_of eager waiting) = [(1, 50); (0, 100)] /\
  sayb (trace_of eager waiting) (b_retires eager 1) = false.
Proof. split; happens. Qed.
Example p7_with_deadline_can_break : ~ P7_with_deadline eager [Got 120 Tick; Did (Opened 0 1 (Some 100))].
Proof. breaks (broken_p7_with_deadline eager _ 1). Qed.
Example p7_retired_happens : sayb (trace_of eager over) (b_retires eager 1) &&
  past false 1 (trace_of eager over) = true.
Proof. happens. Qed.
Example p7_retired_can_break : ~ P7_retired eager [Got 120 Tick; Did (Opened 0 1 (Some 100))].
Proof. breaks (broken_p7_retired eager _ 1). Qed.

Example p8_one_timer_happens : armed_in 1 (trace_of eager over) = [(2, 80); (1, 50); (0, 100)]. Proof. happens. Qed.
Example p8_one_timer_can_break : ~ P8_one_timer [Did (Request 5 1 1 60); Did (Request 0 1 1 50)].
Proof. breaks (broken_p8_one _ 1 1 60 50). Qed.
Example p8_fires_happens : In (Did (Timer 60 1 1)) (trace_of eager waiting). Proof. vm_compute. now left. Qed.
Example p8_fires_can_break : ~ P8_fires [Did (Timer 40 1 1); Got 40 Tick; Did (Request 0 1 1 50)].
Proof. breaks (broken_p8_fires _ 1 1). Qed.
Example p8_served_happens : (50 <=? clock_of (trace_of eager waiting)) &&
  negb (sayb (trace_of eager waiting) (b_retires eager 1)) = true.
Proof. happens. Qed.
Example p8_served_can_break : ~ P8_served eager [Got 50 Tick; Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p8_served eager _ 1 1 50). Qed.

Example p12_bounded_wait_happens : sayb (trace_of eager over) (b_closes eager 1 0) && past true 1 (trace_of eager over) = true.
Proof. happens. Qed.
Example p12_bounded_wait_can_break : ~ P12_bounded_wait eager
  [Got 50 Tick; Did (Hold 10 1 0); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p12 eager _ 1). Qed.

(** A timer that has fired is live no more. *)
Example p8_while_live_happens : sayb (trace_of eager waiting) (b_disarms eager 1 1) = true. Proof. happens. Qed.
Example p8_while_live_can_break : ~ P8_while_live eager
  [Did (Timer 60 1 1); Did (Timer 50 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p8_while_live eager _ 1 1). Qed.
(** The timer of the first cloud fires after the second one's result was forwarded, which retired the timestamp. *)
Definition timer_of_retired : trace := [Did (Timer 60 0 1); Got 60 Tick; Did (Emit 20 0 2); Got 20 (Result 0 2);
  Did (Request 0 0 2 80); Got 0 (Offer 0 2 80 0); Did (Request 0 0 1 60); Got 0 (Offer 0 1 60 0); Did (Opened 0 0 None);
  Got 0 (Open 0 None)].
Example timer_of_retired_breaks_p8 : ~ P8_while_live eager timer_of_retired /\ ~ P8_while_live (under Patient) timer_of_retired.
Proof. split; breaks (broken_p8_while_live _ _ 0 1). Qed.

(** F0 to F3. The second cloud's gate shuts at a backlog of 4 and opens at 0. *)
Definition offers : list input := [input_at 0 (Open 5 None); input_at 1 (Open 5 None); input_at 2 (Offer 5 2 50 4);
  input_at 3 (Offer 5 2 50 1); input_at 4 (Offer 5 2 50 0)].
Example f0_instants_happens : decisions (trace_of eager [input_at 5 (Open 5 None); input_at 1 (Open 5 None)]) =
  [Refuse 5 5 None Order; Opened 5 5 None].
Proof. happens. Qed.
Example f0_instants_can_break : ~ F0_instants [Did (Opened 1 5 None); Got 5 (Open 5 None)]. Proof. breaks (broken_f0 _). Qed.
Example f1_open_happens : In (Did (Refuse 1 5 None Order)) (trace_of eager offers). Proof. vm_compute. tauto. Qed.
Example f1_open_can_break : ~ F1_open eager [Did (Refuse 1 4 None Full); Got 1 (Open 4 None); Did (Opened 0 3 None); Got 0 (Open 3 None)].
Proof. breaks (broken_f1 eager _). Qed.
Example f2_offer_happens : filter written (rev (decisions (trace_of eager offers))) = [Refuse 1 5 None Order;
  Refuse 2 5 (Some 2) Queue; Refuse 3 5 (Some 2) Queue; Request 4 5 2 54].
Proof. happens. Qed.
(** A machine that refuses every offer as closed. *)
Example f2_offer_can_break : ~ F2_offer eager [Did (Refuse 2 5 (Some 2) Closed); Got 2 (Offer 5 2 50 0);
  Did (Opened 0 5 None); Got 0 (Open 5 None)].
Proof. breaks (broken_f2 eager _). Qed.
(** One that opens a gate whose backlog is above the resume. *)
Example gate_breaks_f2 : ~ F2_offer eager [Did (Request 3 5 2 53); Got 3 (Offer 5 2 50 1);
  Did (Refuse 2 5 (Some 2) Queue); Got 2 (Offer 5 2 50 4); Did (Opened 0 5 None); Got 0 (Open 5 None)].
Proof. breaks (broken_f2 eager _). Qed.
Example f3_arrival_happens : snd (step eager (state_after eager waiting) (input_at 60 (Result 1 1))) = [Drop 60 1 1 Late] /\
  snd (step eager (state_after eager waiting) (input_at 60 (Fail 1 2))) = [Drop 60 1 2 Unsolicited].
Proof. split; happens. Qed.
(** No request was made, says a machine that forgets. *)
Example f3_arrival_can_break : ~ F3_arrival eager (Did (Drop 60 1 1 Unsolicited) :: Got 60 (Result 1 1) :: trace_of eager waiting).
Proof. breaks (broken_f3 eager _). Qed.
(** F6. The first cloud's timer commits its own result, though the second's is awaited; a failure does not. *)
Example f6_commits_happens : since_input (trace_of eager committed) = [Cancel 50 1 2; Emit 50 1 1; Timer 50 1 1].
Proof. happens. Qed.
Example f6_commits_can_break : ~ F6_commits eager (Did (Emit 30 1 0) :: Did (Failed 30 1 1) :: Got 30 (Fail 1 1) ::
  trace_of eager (firstn 4 held)).
Proof. breaks (broken_f6 eager _ 1 0 2). Qed.
(** F7. Local is pending still when the first cloud's result is forwarded. *)
Example f7_cancelled_happens : decisions (trace_of eager [input_at 0 (Open 1 None); input_at 0 (Offer 1 1 50 0);
  input_at 5 (Result 1 1)]) = [Emit 5 1 1; Request 0 1 1 50; Opened 0 1 None].
Proof. happens. Qed.
Example f7_cancelled_can_break : ~ F7_cancelled [Did (Cancel 5 1 0); Did (Emit 5 1 1)]. Proof. breaks (broken_f7 _ 1 0). Qed.
Definition two_clouds : list input := [input_at 0 (Open 1 None); input_at 0 (Offer 1 1 50 0); input_at 0 (Offer 1 2 50 0);
  input_at 5 (Result 1 2)].
Example f7_cancels_happens : map (fun r => decisions (trace_of (under r) two_clouds)) [Eager; Progressive] =
  [[Cancel 5 1 1; Emit 5 1 2; Request 0 1 2 50; Request 0 1 1 50; Opened 0 1 None];
   [Final 5 1 2; Cancel 5 1 1; Emit 5 1 2; Request 0 1 2 50; Request 0 1 1 50; Opened 0 1 None]].
Proof. happens. Qed.
Example f7_cancels_can_break : ~ F7_cancels eager [Did (Emit 5 1 2); Did (Request 0 1 2 50); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_f7_cancels eager _ 1 2 1). Qed.

(** P9: a window that is full. *)
Example p9_window_happens : length (opened (state_after eager [input_at 0 (Open 1 None); input_at 0 (Open 2 None);
  input_at 0 (Open 3 None)])) = 2%nat.
Proof. happens. Qed.
Example p9_window_can_break : ~ fits_window eager
  (set_opened [(1, empty_slot); (2, empty_slot); (3, empty_slot)] (state_after eager [])).
Proof. intros H. now apply H. Qed.
(** P10: a tick at which a timer fires comes before an input after it. *)
Example p10_ticks_happens : ticked held (firstn 4 held ++ [input_at 15 Tick; input_at 20 (Result 1 1)]).
Proof. repeat apply t_both. apply (t_tick 15 (input_at 20 (Result 1 1)) [input_at 20 (Result 1 1)] []);
  [repeat constructor|discriminate]. Qed.
Example p10_ticks_can_break : map unstamped [Timer 50 1 1; Emit 50 1 0] <> map unstamped [Emit 60 1 1]. Proof.
discriminate. Qed.
Definition with_clouds (l : list cloud) : config := {| window := 2; rule := Eager; clouds := l |}.
Definition offered_once (cfg : config) : list decision :=
  snd (step cfg (state_after cfg [input_at 0 (Open 1 None)]) (input_at 0 (Offer 1 1 50 2))).
Example p10_order_happens : let (a, b) := (cloud_with 1 4 None, cloud_with 2 1 None) in
  offered_once (with_clouds [a; b]) = [Request 0 1 1 50] /\ offered_once (with_clouds [b; a]) = [Request 0 1 1 50].
Proof. split; happens. Qed.
(** Of two clouds with one priority the order decides whose gate it is. *)
Example p10_order_can_break : let (a, b) := (cloud_with 1 4 None, cloud_with 1 1 None) in
  offered_once (with_clouds [a; b]) <> offered_once (with_clouds [b; a]).
Proof. vm_compute. discriminate. Qed.
(** A timer comes first, with what it decides, then the result that it made late. *)
Example p11_accounted_happens : snd (step eager (state_after eager held) (input_at 60 (Result 1 2))) =
  [Timer 60 1 1; Emit 60 1 1; Cancel 60 1 2] ++ [Drop 60 1 2 Superseded].
Proof. happens. Qed.
(** P13: the last input ends the timestamp under both rules, with the same result. *)
Example p13_as_patient_happens : patient_ends (snd (step (under Patient) (state_after (under Patient) held) (input_at 80 Tick)))
  = [Over 1 (Some 1)]
  /\ progressive_ends (snd (step progressive (state_after progressive held) (input_at 80 Tick))) = [Over 1 (Some 1)].
Proof. split; happens. Qed.
Example p13_as_patient_can_break : progressive_ends [Final 80 1 0] <> patient_ends [Emit 80 1 1]. Proof. discriminate. Qed.

(** T1: local's result goes at once where the timer of its request has fired. *)
Example local_goes_at_once_happens : snd (step eager (state_after eager waiting) (input_at 70 (Result 1 0))) = [Emit 70 1 0]. Proof.
happens. Qed.
Example local_goes_at_once_can_break : ~ Local_goes_at_once [Did (Hold 70 1 0); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_t1 _ 70 1). Qed.
Example p11_accounted_can_break : ~ own eager 60 (Result 1 1) []. Proof. breaks (broken_p11_result _ _ _ _ _). Qed.

(** T1 of a run: the request is due at 50, and local's result comes at 60. *)
Definition answered_at (now : N) : list input := [input_at 0 (Open 1 None); input_at 0 (Offer 1 1 50 0); input_at now (Result 1 0)].
Lemma answered_came now : local_came (answered_at now) 1 eager.
Proof.
  exists (firstn 2 (answered_at now)), (input_at now (Result 1 0)), []. repeat split.
  exists (Opened 0 1 None). split; [vm_compute; tauto|reflexivity].
Qed.
Example t1_of_a_run_happens : local_came (answered_at 60) 1 eager /\
  sayb (trace_of eager (answered_at 60)) (b_emits 1 0) = true.
Proof. split; [apply answered_came|happens]. Qed.
(** With a deadline above local's response, of 10, no output is there by then. *)
Example t1_of_a_run_can_break : local_came (answered_at 10) 1 eager /\
  ~ exists m, says (trace_of eager (answered_at 10)) (emits 1 m).
Proof. split; [apply answered_came|]. intros (m & E). apply sent_in in E. exact E. Qed.

(** E1 to E3: each hypothesis holds, and the second's item is there at 90. *)
Example e2_by_the_deadline_happens : let tr1 := trace_of eager first_in_row in let tr2 := trace_of progressive second_in_row in
  (b_budgeted tr1 1 0 100 40 && b_punctual 5 tr1 && b_budgeted tr2 7 61 100 10 && b_punctual 5 tr2,
   last_items eager 1 tr1, last_items progressive 7 tr2) = (true, [Miss 60 1], [Miss 90 7]).
Proof. happens. Qed.
Example e1_one_item_happens : b_budgeted (trace_of eager first_in_row) 1 0 100 40 &&
  b_punctual 5 (trace_of eager first_in_row) && (ends 0 100 40 <=? clock_of (trace_of eager first_in_row)) = true.
Proof. happens. Qed.
Example e3_budget_happens : b_budgeted (trace_of eager first_in_row) 1 0 100 40 = true /\
  armed_in 1 (trace_of eager first_in_row) = [(1, 50); (0, 60)].
Proof. split; happens. Qed.
(** The second operator answers when the end-to-end deadline is over. *)
Example e2_by_the_deadline_can_break : ~ E2_by_the_deadline eager eager (trace_of eager first_in_row)
  [Did (Miss 101 7); Got 101 Tick; Did (Opened 61 7 (Some 101)); Got 61 (Open 7 (Some 29))].
Proof. breaks (broken_e2 eager eager _ _ 1 7 0 61 100 40 10 5 5). Qed.
Example e1_one_item_can_break : ~ E1_one_item eager [Did (Miss 60 1); Did (Emit 50 1 0); Got 60 Tick;
  Did (Opened 0 1 (Some 60)); Got 0 (Open 1 (Some 60))].
Proof. breaks (broken_e1 eager _ 1 0 100 40 5). Qed.
Example e3_budget_can_break : ~ E3_budget [Did (Request 0 1 1 61); Got 0 (Offer 1 1 60 0); Did (Opened 0 1 (Some 60));
  Got 0 (Open 1 (Some 60))].
Proof. breaks (broken_e3 _ 1 0 100 40). Qed.

(** Section 8: two threads look at one timestamp at once; the second's exchange fails, and its call looks again. *)
Definition call_of (t now : N) (b : body) : call := {| names := t; instant := now; does := b |}.
Definition alone (i : nat) (c : call) : list act := [Look i (names c); Exchange i c].
Definition requested_twice : list act := alone 0 (call_of 1 0 (Open 1 None)) ++ alone 0 (call_of 1 0 (Offer 1 1 50 0)) ++
  alone 0 (call_of 1 0 (Offer 1 2 80 0)).
Definition calls_at_once : list act := requested_twice ++ [Look 1 1; Look 2 1;
  Exchange 1 (call_of 1 5 (Result 1 1)); Exchange 2 (call_of 1 4 (Result 1 0))] ++
  alone 2 (call_of 1 4 (Result 1 0)) ++ alone 1 (call_of 1 6 (Fail 1 2)).
Example s8_one_order_happens : decisions (history (interleave (execute eager) at_first calls_at_once)) =
  [Emit 6 1 1; Failed 6 1 2; Hold 4 1 0; Hold 5 1 1; Request 0 1 2 80; Request 0 1 1 50; Opened 0 1 None].
Proof. happens. Qed.
(** These calls in their order, as section 8's statements of promises have them: the second thread's clock is behind. *)
Definition calls_in_order : list call := [call_of 1 0 (Open 1 None); call_of 1 0 (Offer 1 1 50 0);
  call_of 1 0 (Offer 1 2 80 0); call_of 1 5 (Result 1 1); call_of 1 4 (Result 1 0); call_of 1 6 (Fail 1 2)].
Example s8_calls_happen : Forall fits_call calls_in_order /\
  snd (in_order eager initial [] calls_in_order) = history (interleave (execute eager) at_first calls_at_once).
Proof. split; [repeat constructor|happens]. Qed.
(** If an exchange did not compare, the second would undo the first: its result, that was held, would not be sent. *)
Definition undone : trace := let seen := lookup 1 (opened (state_after eager (firstn 3 held))) in
  let (s1, ds1) := execute eager (state_after eager (firstn 3 held)) (call_of 1 5 (Result 1 1)) in
  let (s2, ds2) := execute eager (with_slot s1 1 seen) (call_of 1 4 (Result 1 0)) in
  let (s3, ds3) := execute eager s2 (call_of 1 6 (Fail 1 1)) in
  let (s4, ds4) := execute eager s3 (call_of 1 6 (Fail 1 2)) in
  after (ds1 ++ ds2 ++ ds3 ++ ds4) (trace_of eager (firstn 3 held)).
Example s8_one_order_can_break : ~ P3_best_available undone. Proof. breaks (broken_p3 _ 1 0 1). Qed.
(** With one cloud a call that is in time for nothing fails as often as it can: the offer, both results and no more. *)
Definition one_cloud : config := {| window := 2; rule := Eager; clouds := [cloud_with 1 4 None] |}.
Definition opening : list act := alone 0 (call_of 1 0 (Open 1 None)).
Definition overtaken (c : call) : list act := [Look 9 1] ++ alone 0 c ++ [Exchange 9 (call_of 1 60 Tick)].
Definition unlucky : list act := overtaken (call_of 1 0 (Offer 1 1 50 0)) ++ overtaken (call_of 1 10 (Result 1 0)) ++
  overtaken (call_of 1 20 (Result 1 1)) ++ overtaken (call_of 1 30 Tick).
Example s8_looks_happens : let m := interleave (execute one_cloud) at_first opening in
  failures (execute one_cloud) 9 1 m unlucky = 3%nat /\
  lookup 1 (opened (machine (interleave (execute one_cloud) m unlucky))) = None.
Proof. split; happens. Qed.
(** A machine in which an offer after the result requests again goes on for ever. *)
Definition again (s : state) (c : call) : state * list decision :=
  let (s1, ds) := execute one_cloud s c in
  match does c with
  | Fail 1 1 => (set_opened [(1, {| requested := [0; 1]; pending := [0]; cached := []; armed := [] |})] s1, ds)
  | Offer 1 1 _ _ => (set_opened [(1, {| requested := [0; 1]; pending := [0; 1]; cached := []; armed := [(1, 50)] |})] s1, ds)
  | _ => (s1, ds)
  end.
Definition overtaken_twice := overtaken (call_of 1 0 (Offer 1 1 50 0)) ++ overtaken (call_of 1 0 (Fail 1 1)).
Example s8_looks_can_break : ~ S8_looks one_cloud again.
Proof.
  intros H. destruct (H opening (overtaken_twice ++ overtaken_twice) 9%nat 1) as [L _].
  - repeat constructor.
  - exists (Opened 0 1 None). split; [vm_compute; tauto|reflexivity].
  - reflexivity.
  - revert L. vm_compute. intros L. repeat apply le_S_n in L. inversion L.
Qed.
(** A word whose generations last for two messages: the name of the first is taken for the third's, not for the second's. *)
Definition three_in_a_place (n : nat) : trace := skipn (5 - n) [Did (Opened 20 3 None); Did (Miss 10 2);
  Did (Opened 10 2 None); Did (Miss 0 1); Did (Opened 0 1 None)].
Example s8_names_happens : map (fun n => let tr := three_in_a_place n in
    (name (fun _ => 0) 2 tr 1 =? generation 2 (count (fun _ => 0) tr 1) (Nat.odd n), since (fun _ => 0) tr 1))
  [1; 2; 3; 4; 5]%nat = [(true, 0); (false, 0); (false, 1); (false, 1); (true, 2)].
Proof. happens. Qed.
(** An owner that opens in a place that is not free: the first message's name is the second's. *)
Example s8_names_can_break : ~ S8_old_names eager (fun _ => 0) 2 [Did (Opened 10 2 None); Did (Opened 0 1 None)].
Proof.
  intros H. destruct (H 2 1) as (n & E & Z).
  - exists (Opened 10 2 None). cbn. auto.
  - exists (Opened 0 1 None). cbn. auto.
  - intros (d & I & R). destruct I as [[= <-]|[[= <-]|[]]]; exact R.
  - reflexivity.
  - reflexivity.
  - change (0 = n * 2) in E. assert (n = 0) as -> by (destruct n; [reflexivity|discriminate]). now discriminate (Z eq_refl).
Qed.
Example s8_retired_happens : lookup 1 (opened (state_after eager over)) = None /\ reached (state_after eager over) 1 = true.
Proof. split; happens. Qed.
(** A name of what is open is answered otherwise. *)
Example s8_retired_can_break : snd (execute eager (state_after eager held) (call_of 1 30 (Result 1 2))) <>
  [Drop 30 1 2 Superseded].
Proof. vm_compute. discriminate. Qed.
