(** * For each promise a run where its hypothesis holds, and a trace of a faulty machine that breaks it

    The runs are of the rules, computed. The faulty traces are written by hand, the newest line first. *)
From Coq Require Import List NArith Bool.
From Fuseline Require Import Rules Trace Statements Broken Cases Ticks AsPatient Threads.
Import ListNotations.
Open Scope N_scope.

Example p1_happens : endings 1 (trace_of eager over) = [Sent 1]. Proof. happens. Qed.
Example p1_can_break : ~ P1_once eager [Did (Emit 60 1 2); Did (Emit 50 1 1); Did (Opened 0 1 None)].
Proof. breaks (broken_p1 eager _ 1). Qed.
Example p1_progressive_happens : endings 1 (trace_of progressive (held ++ [input_at 30 (Result 1 2)])) = [Ended 2;
  Sent 2; Sent 1; Sent 0].
Proof. happens. Qed.
Example p1_progressive_can_break : ~ P1_progressive progressive [Did (Emit 20 1 0); Did (Emit 10 1 1);
  Did (Opened 0 1 None)].
Proof. breaks (broken_p1_progressive progressive _ 1). Qed.

Example p2_happens : sayb (trace_of eager committed) (b_emits 1 1) = true. Proof. happens. Qed.
(** At the due instant it is late. *)
Example p2_can_break : ~ P2_never_late
  [Did (Emit 50 1 1); Got 50 (Result 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p2 _ 1 1). Qed.

Example p3_happens : sayb (trace_of eager committed) (b_emits 1 1) &&
  sayb (trace_of eager committed) (b_holds 1 0) = true.
Proof. happens. Qed.
Example p3_can_break : ~ P3_best_available [Did (Emit 50 1 0); Did (Hold 20 1 1); Did (Hold 10 1 0)].
Proof. breaks (broken_p3 _ 1 0 1). Qed.

Example p4_happens : sayb (trace_of eager held) (b_holds 1 1) &&
  negb (sayb (trace_of eager held) (b_retires eager 1)) = true.
Proof. happens. Qed.
Example p4_can_break : ~ P4_prompt eager [Did (Hold 20 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p4 eager _ 1 1). Qed.

Example p5_happens : sayb (trace_of eager over) (b_accepts 1 0) && past true 1 (trace_of eager over) = true.
Proof. happens. Qed.
Example p5_can_break : ~ P5_local_floor
  [Did (Miss 50 1); Did (Timer 50 1 1); Got 50 Tick; Did (Hold 10 1 0); Did (Request 0 1 1 50);
    Did (Opened 0 1 None)].
Proof. breaks (broken_p5 _ 1 0). Qed.

Example p6_happens : sayb (trace_of eager held) (b_holds 1 0) = true. Proof. happens. Qed.
Example p6_can_break : ~ P6_free_without_cloud [Did (Hold 10 1 0); Did (Opened 0 1 None)].
Proof. breaks (broken_p6 _ 1). Qed.

Example p7_happens : sayb (trace_of eager waiting) (b_opens 1) &&
  negb (sayb (trace_of eager waiting) (b_retires eager 1)) = true.
Proof. happens. Qed.
Example p7_can_break : ~ P7_no_stall eager [Did (Failed 10 1 0); Got 10 (Fail 1 0); Did (Opened 0 1 None)].
Proof. breaks (broken_p7 eager _ 1). Qed.
Example p7_with_deadline_can_break : ~ P7_with_deadline eager [Got 120 Tick; Did (Opened 0 1 (Some 100))].
Proof. breaks (broken_p7_with_deadline eager _ 1). Qed.
Example p7_retired_happens : sayb (trace_of eager over) (b_retires eager 1) &&
  past false 1 (trace_of eager over) = true.
Proof. happens. Qed.
Example p7_retired_can_break : ~ P7_retired eager [Got 120 Tick; Did (Opened 0 1 (Some 100))].
Proof. breaks (broken_p7_retired eager _ 1). Qed.

Example p8_one_happens : armed_in 1 (trace_of eager over) = [(2, 80); (1, 50); (0, 100)]. Proof. happens. Qed.
Example p8_one_can_break : ~ P8_one_timer [Did (Request 5 1 1 60); Did (Request 0 1 1 50)].
Proof. breaks (broken_p8_one _ 1 1 60 50). Qed.
Example p8_fires_happens : In (Did (Timer 60 1 1)) (trace_of eager waiting). Proof. vm_compute. now left. Qed.
Example p8_fires_can_break : ~ P8_fires [Did (Timer 40 1 1); Did (Request 0 1 1 50)].
Proof. breaks (broken_p8_fires _ 40 1 1). Qed.
Example p8_served_happens : (50 <=? clock_of (trace_of eager waiting)) &&
  negb (sayb (trace_of eager waiting) (b_retires eager 1)) = true.
Proof. happens. Qed.
Example p8_served_can_break : ~ P8_served eager [Got 50 Tick; Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p8_served eager _ 1 1 50). Qed.

Example p12_happens : sayb (trace_of eager over) (b_closes eager 1 0) && past true 1 (trace_of eager over) = true.
Proof. happens. Qed.
Example p12_can_break : ~ P12_bounded_wait eager
  [Got 50 Tick; Did (Hold 10 1 0); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p12 eager _ 1). Qed.

(** A timer that has fired is live no more. *)
Example p8_while_live_happens : sayb (trace_of eager waiting) (b_disarms eager 1 1) = true. Proof. happens. Qed.
Example p8_while_live_can_break : ~ P8_while_live eager
  [Did (Timer 60 1 1); Did (Timer 50 1 1); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_p8_while_live eager _ 1 1). Qed.

(** F1, F2, F2g, F7. The second cloud's gate shuts at a backlog of 4 and opens at 0. *)
Definition asked : list input := [input_at 0 (Open 5 None); input_at 1 (Open 5 None); input_at 2 (Offer 5 2 50 4);
  input_at 3 (Offer 5 2 50 1); input_at 4 (Offer 5 2 50 0)].
Example f1_happens : In (Did (Refuse 1 5 None Order)) (trace_of eager asked). Proof. vm_compute. tauto. Qed.
Example f1_can_break : ~ F1_order [Did (Refuse 1 4 None Order); Did (Opened 0 3 None)].
Proof. breaks (broken_f1 _). Qed.
Example f2_happens : sayb (trace_of eager held) (b_requests 1 2) = true. Proof. happens. Qed.
Example f2_registered_can_break : ~ F2_registered eager [Did (Request 0 1 9 50); Did (Opened 0 1 None)].
Proof. breaks (broken_f2_registered eager _ 1 9). Qed.
Example f2_outranks_can_break : ~ F2_outranks
  [Did (Request 5 1 1 50); Did (Hold 4 1 2); Did (Request 0 1 3 50); Did (Request 0 1 2 50); Did (Opened 0 1 None)].
Proof. breaks (broken_f2_outranks _ 1 1 2). Qed.
Example f2g_happens : filter written (rev (decisions (trace_of eager asked))) = [Refuse 1 5 None Order;
  Refuse 2 5 (Some 2) Queue; Refuse 3 5 (Some 2) Queue; Request 4 5 2 54].
Proof. happens. Qed.
Example f2g_can_break : ~ F2g_gate eager [Did (Request 3 5 2 53); Got 3 (Offer 5 2 50 1);
  Did (Refuse 2 5 (Some 2) Queue); Got 2 (Offer 5 2 50 4); Did (Opened 0 5 None)].
Proof. breaks (broken_f2g eager _). Qed.
(** Local is pending still when the first cloud's result is forwarded. *)
Example f7_happens : decisions (trace_of eager [input_at 0 (Open 1 None); input_at 0 (Offer 1 1 50 0);
  input_at 5 (Result 1 1)]) = [Emit 5 1 1; Request 0 1 1 50; Opened 0 1 None].
Proof. happens. Qed.
Example f7_can_break : ~ F7_local [Did (Cancel 5 1 0); Did (Emit 5 1 1)]. Proof. breaks (broken_f7 _ 1). Qed.

(** P9: a window that is full. *)
Example p9_happens : length (opened (state_after eager [input_at 0 (Open 1 None); input_at 0 (Open 2 None);
  input_at 0 (Open 3 None)])) = 2%nat.
Proof. happens. Qed.
(** P10: a tick at which a timer fires comes before an input after it. *)
Example p10_happens : ticked held (firstn 4 held ++ [input_at 15 Tick; input_at 20 (Result 1 1)]).
Proof. repeat apply t_both. apply (t_tick 15 (input_at 20 (Result 1 1)) [input_at 20 (Result 1 1)] []);
  [repeat constructor|discriminate]. Qed.
Example p10_can_break : map unstamped [Timer 50 1 1; Emit 50 1 0] <> map unstamped [Emit 60 1 1]. Proof.
discriminate. Qed.
(** P11: a late result says so. *)
Example p11_happens : snd (step eager (state_after eager waiting) (input_at 60 (Result 1 1))) = [Drop 60 1 1 Late].
Proof. happens. Qed.
(** P13: the last input ends the timestamp under both rules, with the same result. *)
Example p13_happens : patient_ends (snd (step (under Patient) (state_after (under Patient) held) (input_at 80 Tick)))
  = [Over 1 (Some 1)]
  /\ progressive_ends (snd (step progressive (state_after progressive held) (input_at 80 Tick))) = [Over 1 (Some 1)].
Proof. split; happens. Qed.
Example p13_can_break : progressive_ends [Final 80 1 0] <> patient_ends [Emit 80 1 1]. Proof. discriminate. Qed.

(** T1: local's result goes at once where the timer of its request has fired. *)
Example t1_happens : snd (step eager (state_after eager waiting) (input_at 70 (Result 1 0))) = [Emit 70 1 0]. Proof.
happens. Qed.
Example t1_can_break : ~ goes_at_once [Did (Hold 70 1 0); Did (Request 0 1 1 50); Did (Opened 0 1 None)].
Proof. breaks (broken_t1 _ 70 1). Qed.
Example p11_can_break : ~ own eager 60 (Result 1 1) []. Proof. breaks (broken_p11_result _ _ _ _ _). Qed.

(** E1 to E3: each hypothesis holds, and the second's item is there at 90. *)
Example e2_happens : let tr1 := trace_of eager first_in_row in let tr2 := trace_of progressive second_in_row in
  (b_budgeted tr1 1 0 100 40 && b_punctual 5 tr1 && b_budgeted tr2 7 61 100 10 && b_punctual 5 tr2,
   last_items eager 1 tr1, last_items progressive 7 tr2) = (true, [Miss 60 1], [Miss 90 7]).
Proof. happens. Qed.
(** The second operator answers when the end-to-end deadline is over. *)
Example e2_can_break : ~ E2_by_the_deadline eager eager (trace_of eager first_in_row)
  [Did (Miss 101 7); Got 101 Tick; Did (Opened 61 7 (Some 101)); Got 61 (Open 7 (Some 29))].
Proof. breaks (broken_e2 eager eager _ _ 1 7 0 61 100 40 10 5 5). Qed.
Example e1_can_break : ~ E1_one_item eager [Did (Miss 60 1); Did (Emit 50 1 0); Got 60 Tick;
  Did (Opened 0 1 (Some 60)); Got 0 (Open 1 (Some 60))].
Proof. breaks (broken_e1 eager _ 1 0 100 40 5). Qed.
Example e3_can_break : ~ E3_budget [Did (Request 0 1 1 61); Got 0 (Offer 1 1 60 0); Did (Opened 0 1 (Some 60));
  Got 0 (Open 1 (Some 60))].
Proof. breaks (broken_e3 _ 1 0 100 40). Qed.

(** Section 8: two threads look at one timestamp at once; the second's exchange fails, and its call looks again. *)
Definition calls_at_once : list act := [Exchange 0 {| names := 1; instant := 0; does := Open 1 None |}; Look 0 1;
  Exchange 0 {| names := 1; instant := 0; does := Offer 1 1 50 0 |}; Look 0 1;
  Exchange 0 {| names := 1; instant := 0; does := Offer 1 2 80 0 |};
  Look 1 1; Look 2 1;
  Exchange 1 {| names := 1; instant := 5; does := Result 1 1 |}; Exchange 2 {| names := 1; instant := 4; does := Result 1 0 |};
  Look 2 1; Exchange 2 {| names := 1; instant := 4; does := Result 1 0 |};
  Look 1 1; Exchange 1 {| names := 1; instant := 6; does := Fail 1 2 |}].
Example s8_happens : decisions (snd (interleave eager initial (fun _ => None) [] calls_at_once)) =
  [Emit 6 1 1; Failed 6 1 2; Hold 4 1 0; Hold 5 1 1; Request 0 1 2 80; Request 0 1 1 50; Opened 0 1 None].
Proof. happens. Qed.
(** If an exchange did not compare, the second would undo the first: its result, that was held, would not be sent. *)
Definition undone : trace := let seen := lookup 1 (opened (state_after eager (firstn 3 held))) in
  let (s1, ds1) := plan eager (state_after eager (firstn 3 held)) seen {| names := 1; instant := 5; does := Result 1 1 |} in
  let stale := with_slot s1 1 seen in
  let (s2, ds2) := execute eager stale {| names := 1; instant := 4; does := Result 1 0 |} in
  let (s3, ds3) := execute eager s2 {| names := 1; instant := 6; does := Fail 1 1 |} in
  let (s4, ds4) := execute eager s3 {| names := 1; instant := 6; does := Fail 1 2 |} in
  after (ds1 ++ ds2 ++ ds3 ++ ds4) (trace_of eager (firstn 3 held)).
Example s8_can_break : ~ P3_best_available undone. Proof. breaks (broken_p3 _ 1 0 1). Qed.
