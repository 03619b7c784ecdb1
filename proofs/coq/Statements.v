(** * The promises of SPEC.md, section 4, as statements about a trace

    Each says of [tr] what came in and what was decided, in the words of Trace.v, and nothing of a state. Promises.v,
    Lines.v, Accounts.v, Ticks.v and AsPatient.v prove them of the trace of any inputs under any configuration. Since each
    beginning of a run is a run, "by an instant" reads: whenever the clock of the trace has reached it. Examples.v has
    for each a run where its hypothesis holds, and a trace that breaks it. *)
From Coq Require Import List NArith Bool Sorted.
From Fuseline Require Import Words Trace.
Import ListNotations.
Open Scope N_scope.

(** The instant of the newest input. *)
Fixpoint clock_of (tr : trace) : N :=
  match tr with [] => 0 | Got now _ :: _ => now | Did _ :: rest => clock_of rest end.
(** The trace before the newest input. *)
Fixpoint before_input (tr : trace) : trace :=
  match tr with [] => [] | Got _ _ :: rest => rest | Did _ :: rest => before_input rest end.
(** The decisions after it. *)
Fixpoint since_input (tr : trace) : list decision :=
  match tr with Did d :: rest => d :: since_input rest | _ => [] end.
(** The newest input. *)
Fixpoint input_of (tr : trace) : option body :=
  match tr with [] => None | Got _ b :: _ => Some b | Did _ :: rest => input_of rest end.
(** Whether the gate of [p] is shut: it is if it refused the last offer that came to it. *)
Fixpoint gate_of (p : N) (tr : trace) : bool :=
  match tr with
  | [] => false
  | Did (Request _ _ q _) :: rest => if q =? p then false else gate_of p rest
  | Did (Refuse _ _ (Some q) Queue) :: rest => if q =? p then true else gate_of p rest
  | _ :: rest => gate_of p rest
  end.
Definition instant_of (d : decision) : N :=
  match d with
  | Opened n _ _ | Failed n _ _ | Timer n _ _ | Refuse n _ _ _ | Request n _ _ _ | Hold n _ _ | Drop n _ _ _
  | Emit n _ _ | Final n _ _ | Miss n _ | Cancel n _ _ => n
  end.

(** ** The reasons of F1, F2 and F3, as the trace before a decision has them *)

(* ANCHOR: reasons *)
Section Reasons.
Variables (cfg : config) (earlier : trace).
(** Of a table the first reason that holds is the answer; without one, what came is accepted. *)
Fixpoint answer (rows : list (reason * Prop)) (o : option reason) : Prop :=
  match rows with
  | [] => o = None
  | (why, holds) :: rest => holds /\ o = Some why \/ ~ holds /\ answer rest o
  end.
(** Local is always requested. *)
Definition asked (t p : N) : Prop := p = 0 \/ says earlier (requests t p).
Definition not_reached (t : N) : Prop := forall u, t <= u -> ~ says earlier (opens u).
(** So many timestamps are open. *)
Definition at_least_open (n : N) : Prop := exists ts, NoDup ts /\ n <= N.of_nat (length ts) /\
  forall u, In u ts -> says earlier (opens u) /\ ~ says earlier (retires cfg u).
(** That of [p] is shut after an offer with so much backlog. *)
Definition shuts (p backlog : N) : Prop := exists c, registered cfg p = Some c /\
  if gate_of p earlier then resume c < backlog else limit c <= backlog.
Definition f1_rows (now t : N) (deadline : option N) : list (reason * Prop) := [
  (Order,    exists u, t <= u /\ says earlier (opens u));
  (Full,     at_least_open (window cfg));
  (Deadline, exists d, deadline = Some d /\ due_at now d <= now)
].
Definition f2_rows (now t p deadline backlog : N) : list (reason * Prop) := [
  (Unknown,   is_cloud cfg p = false \/ not_reached t);
  (Closed,    ~ says earlier (opens t) \/ says earlier (retires cfg t));
  (Duplicate, asked t p);
  (Outranked, exists q, p < q /\ says earlier (accepts t q));
  (Deadline,  due_at now deadline <= now);
  (Queue,     shuts p backlog)
].
Definition f3_rows (t p : N) : list (reason * Prop) := [
  (Unknown,     p <> 0 /\ is_cloud cfg p = false \/ not_reached t);
  (Superseded,  ~ says earlier (opens t) \/ says earlier (retires cfg t) \/
                is_progressive cfg = true /\ exists q, p < q /\ says earlier (emits t q));
  (Unsolicited, ~ asked t p);
  (Duplicate,   says earlier (accepts t p));
  (Late,        says earlier (gives_out t p))
].
(** What each decision about an open says of the trace before it. *)
Definition f1_line (d : decision) : Prop :=
  match d with
  | Opened now t due => exists x, input_of earlier = Some (Open t x) /\ due = option_map (due_at now) x /\
      answer (f1_rows now t x) None
  | Refuse now t None why => exists x, input_of earlier = Some (Open t x) /\ answer (f1_rows now t x) (Some why)
  | _ => True
  end.
(** And each about an offer. *)
Definition f2_line (d : decision) : Prop :=
  match d with
  | Request now t p due => exists x backlog, input_of earlier = Some (Offer t p x backlog) /\ due = due_at now x /\
      answer (f2_rows now t p x backlog) None
  | Refuse now t (Some p) why => exists x backlog, input_of earlier = Some (Offer t p x backlog) /\
      answer (f2_rows now t p x backlog) (Some why)
  | _ => True
  end.
(** And each about a result or a failure. What is forwarded by a failure or a timer had been held; under progressive
    nothing is. *)
Definition f3_line (d : decision) : Prop :=
  match d with
  | Drop _ t p why => (input_of earlier = Some (Result t p) \/ input_of earlier = Some (Fail t p)) /\
      answer (f3_rows t p) (Some why)
  | Hold _ t p => is_progressive cfg = false /\ input_of earlier = Some (Result t p) /\ answer (f3_rows t p) None
  | Failed _ t p => input_of earlier = Some (Fail t p) /\ answer (f3_rows t p) None
  | Emit _ t p => says earlier (holds t p) \/ input_of earlier = Some (Result t p) /\ answer (f3_rows t p) None
  | _ => True
  end.
End Reasons.
(* ANCHOR_END: reasons *)

Section Of.
Variables (cfg : config) (tr : trace).

(* ANCHOR: P1-P6 *)
(** Under eager and patient a timestamp is forwarded once, or missed once, or neither, but never both or again. *)
Definition P1_once : Prop := forall t : N,
  is_progressive cfg = false ->
   endings t tr = [] \/ endings t tr = [Missed] \/ exists p, endings t tr = [Sent p].
(** Under progressive its outputs rise strictly, a final or a miss comes at most once and last, a miss only without
    outputs, and a final names the last of them. *)
Definition P1_progressive : Prop := forall t : N,
  is_progressive cfg = true ->
   (exists ps, endings t tr = map Sent ps /\ falling ps) \/ endings t tr = [Missed] \/
  exists p ps, endings t tr = Ended p :: Sent p :: map Sent ps /\ falling (p :: ps).
(** Whatever is held comes just now, in time; and so does whatever is forwarded, or it had been held. *)
Definition P2_never_late : Prop := forall later d earlier t p, tr = later ++ Did d :: earlier ->
  (holds t p d -> arrives earlier t p) /\ (emits t p d -> arrives earlier t p \/ says earlier (holds t p)).
(** Each copy of a result that comes at its due instant or later is dropped, also where another copy came before. *)
Definition P2_late_dropped : Prop := forall later now t p earlier due, tr = later ++ Got now (Result t p) :: earlier ->
  says earlier (arms t p due) -> due <= now -> soon later (fun d => exists why, d = Drop now t p why).
(** No result that is held, or that came in time before this input, outranks the one that is forwarded. *)
Definition P3_best_available : Prop := forall later now t m earlier q, tr = later ++ Did (Emit now t m) :: earlier ->
  says earlier (holds t q) \/ in_time (before_input earlier) t q -> q <= m.
(** Under progressive whatever came in time is an output, or a better one is. *)
Definition P3_progressive : Prop := forall t q : N,
  is_progressive cfg = true -> in_time tr t q -> exists m, q <= m /\ says tr (emits t m).
(** While results are held, something that was requested and has not come outranks all of them. *)
Definition P4_prompt : Prop := forall t c : N,
  says tr (holds t c) -> ~ says tr (retires cfg t) ->
  exists q, says tr (requests t q) /\ ~ says tr (closes cfg t q) /\ forall b, says tr (holds t b) -> b < q.
(** Once any result was accepted, local's or a cloud's, its timestamp has an output by the latest due instant of its
    requests. *)
Definition P5_output (t : N) : Prop := forall p : N,
  says tr (accepts t p) ->
  (forall q due, q <> 0 -> says tr (arms t q due) -> due <= clock_of tr) -> exists m, says tr (emits t m).
Definition P5_local_floor : Prop := forall t : N, P5_output t.
(** Local's result is held only for a timestamp for which a request was admitted. *)
Definition P6_free_without_cloud : Prop := forall t : N,
  says tr (holds t 0) -> exists p, says tr (requests t p).
(* ANCHOR_END: P1-P6 *)
(* ANCHOR: P7-P12 *)
(** A timestamp that is not retired waits for local, or has a live timer that is due later. *)
Definition P7_waits (t : N) : Prop := ~ says tr (retires cfg t) -> ~ says tr (closes cfg t 0) \/
  exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
Definition P7_no_stall : Prop := forall t : N, P7_waits t.
(** One that was opened with a deadline has a live timer as long as it is open. *)
Definition P7_timed (t : N) : Prop := forall x : N,
  says tr (arms t 0 x) -> ~ says tr (retires cfg t) ->
  exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
Definition P7_with_deadline : Prop := forall t : N, P7_timed t.
(** And it is retired by the latest due instant that was ever armed for it. *)
Definition P7_ends (t : N) : Prop := forall x : N,
  says tr (arms t 0 x) -> (forall p due, says tr (arms t p due) -> due <= clock_of tr) ->
  says tr (retires cfg t).
Definition P7_retired : Prop := forall t : N, P7_ends t.
(** A request, and local, arms at most one due instant. *)
Definition P8_one_timer : Prop := forall t p a b : N,
  says tr (arms t p a) -> says tr (arms t p b) -> a = b.
(** A timer fires only if it was armed before, and not before its due instant. *)
Definition P8_fires : Prop := forall later now t p earlier, tr = later ++ Did (Timer now t p) :: earlier ->
  exists due, says earlier (arms t p due) /\ due <= clock_of earlier.
(** And only while it is live: until what P8 names ended it, or its timestamp was retired, so once at most. *)
Definition P8_while_live : Prop := forall later now t p earlier, tr = later ++ Did (Timer now t p) :: earlier ->
  ~ says earlier (disarms cfg t p) /\ ~ says earlier (retires cfg t).
(** None is overdue: an armed timer that is due has ended, or its timestamp has. *)
Definition P8_punctual (t : N) : Prop := forall p due : N,
  says tr (arms t p due) -> due <= clock_of tr -> ~ says tr (retires cfg t) ->
  says tr (disarms cfg t p).
Definition P8_served : Prop := forall t : N, P8_punctual t.
(** Once local has arrived, or was outdone, and the due instants of all requests are past, a timestamp is retired. *)
Definition P12_over (t : N) : Prop := says tr (closes cfg t 0) ->
  (forall p due, p <> 0 -> says tr (arms t p due) -> due <= clock_of tr) -> says tr (retires cfg t).
Definition P12_bounded_wait : Prop := forall t : N, P12_over t.
(* ANCHOR_END: P7-P12 *)
(** ** What each line says of the trace before it: F0 to F4, F7 *)

(* ANCHOR: F0-F7 *)
(** A decision bears the instant of the input that it follows. *)
Definition F0_instants : Prop := forall later d earlier, tr = later ++ Did d :: earlier -> instant_of d = clock_of earlier.
(** An open is accepted where no reason of F1 holds, and refused for the first that does. *)
Definition F1_open : Prop := forall later d earlier, tr = later ++ Did d :: earlier -> f1_line cfg earlier d.
(** An offer is admitted where no reason of F2 holds, that of the gate (F2g) included, and refused for the first that does. *)
Definition F2_offer : Prop := forall later d earlier, tr = later ++ Did d :: earlier -> f2_line cfg earlier d.
(** A result or failure is accepted where no reason of F3 holds, and dropped for the first that does. *)
Definition F3_arrival : Prop := forall later d earlier, tr = later ++ Did d :: earlier -> f3_line cfg earlier d.
(** Where something pending outranks an output, the rule is eager, and by this input a timer of a cloud fired. *)
Definition F6_commits : Prop := forall later now t m earlier q, tr = later ++ Did (Emit now t m) :: earlier ->
  is_progressive cfg = false -> m < q -> says earlier (requests t q) -> ~ says earlier (closes cfg t q) ->
  is_eager cfg = true /\ exists p, p <> 0 /\ In (Timer now t p) (since_input earlier).
(** Local is never cancelled, nor a cloud that was not requested, or of which a result, a failure or a timer came. *)
Definition F7_cancelled : Prop := forall later now t q earlier, tr = later ++ Did (Cancel now t q) :: earlier ->
  q <> 0 /\ says earlier (requests t q) /\ ~ says earlier (answers t q).
(** With an output each other cloud that is pending is cancelled; under progressive each that the output outranks. *)
Definition F7_cancels : Prop := forall later now t m earlier q, tr = later ++ Did (Emit now t m) :: earlier ->
  says earlier (requests t q) -> ~ says earlier (closes cfg t q) -> q <> m -> (is_progressive cfg = true -> q < m) ->
  soon later (fun d => d = Cancel now t q).
(* ANCHOR_END: F0-F7 *)
End Of.

(** ** P10: what may differ *)

(* ANCHOR: P10 *)
(** A decision apart from the [at] that it bears. *)
Definition unstamped (d : decision) : decision :=
  match d with
  | Opened _ t due => Opened 0 t due | Failed _ t p => Failed 0 t p | Timer _ t p => Timer 0 t p
  | Refuse _ t p why => Refuse 0 t p why | Request _ t p due => Request 0 t p due | Hold _ t p => Hold 0 t p
  | Drop _ t p why => Drop 0 t p why | Emit _ t p => Emit 0 t p | Final _ t p => Final 0 t p
  | Miss _ t => Miss 0 t | Cancel _ t p => Cancel 0 t p
  end.
(** All decisions of a trace, the newest first. *)
Definition decisions (tr : trace) : list decision :=
  flat_map (fun l => match l with Did d => [d] | Got _ _ => [] end) tr.
(** [b] is [a] with more ticks, each at an instant no later than the input that follows it. *)
Inductive ticked : list input -> list input -> Prop :=
| t_end : ticked [] []
| t_both i a b : ticked a b -> ticked (i :: a) (i :: b)
| t_tick n i a b : ticked a (i :: b) -> n <= at_ i -> ticked a ({| at_ := n; what := Tick |} :: i :: b).
(* ANCHOR_END: P10 *)

(** ** P11: what an input has *)

(* ANCHOR: P11 *)
(** The decisions that an input itself has, after those of the timers that it meets. *)
Definition own (cfg : config) (now : N) (b : body) (ds : list decision) : Prop :=
  match b with
  | Tick => ds = []
  | Open t d => ds = [Opened now t (option_map (due_at now) d)] \/ exists why, ds = [Refuse now t None why]
  | Offer t p d _ => ds = [Request now t p (due_at now d)] \/ exists why, ds = [Refuse now t (Some p) why]
  | Result t p =>
      (exists why, ds = [Drop now t p why]) \/ (ds = [Hold now t p] /\ is_progressive cfg = false) \/
      exists cs last, ds = Emit now t p :: map (Cancel now t) cs ++ last /\
        (last = [] \/ is_progressive cfg = true /\ last = [Final now t p])
  | Fail t p =>
      (exists why, ds = [Drop now t p why]) \/ exists last, ds = Failed now t p :: last /\
        (last = [] \/ last = [Miss now t] \/ is_progressive cfg = true /\ (exists m, last = [Final now t m]) \/
         is_progressive cfg = false /\ exists m cs, last = Emit now t m :: map (Cancel now t) cs)
  end.
Definition of_timers (d : decision) : Prop :=
  match d with Timer _ _ _ | Emit _ _ _ | Cancel _ _ _ | Final _ _ _ | Miss _ _ => True | _ => False end.
(* ANCHOR_END: P11 *)

(** ** P13: what is alike *)

(* ANCHOR: P13 *)
(** What both rules decide alike: what was opened, admitted and refused, and with what a timestamp ended. *)
Inductive common :=
| Accepted (t : N) (due : option N) | Admitted (t p due : N) | Refused (t : N) (p : option N) (why : reason)
| Over (t : N) (last : option N).
(** Under patient a timestamp ends with its output, under progressive with the final that names its last one. *)
Definition of_patient (d : decision) : list common :=
  match d with
  | Opened _ t due => [Accepted t due] | Request _ t p due => [Admitted t p due]
  | Refuse _ t p why => [Refused t p why]
  | Emit _ t m => [Over t (Some m)] | Miss _ t => [Over t None] | _ => []
  end.
Definition of_progressive (d : decision) : list common :=
  match d with
  | Opened _ t due => [Accepted t due] | Request _ t p due => [Admitted t p due]
  | Refuse _ t p why => [Refused t p why]
  | Final _ t m => [Over t (Some m)] | Miss _ t => [Over t None] | _ => []
  end.
Definition patient_ends (ds : list decision) : list common := flat_map of_patient ds.
Definition progressive_ends (ds : list decision) : list common := flat_map of_progressive ds.
(* ANCHOR_END: P13 *)

(** ** T1, the machine's half *)

(* ANCHOR: T1 *)
(** Local's result is held only while a request is live that is due later: at or after all due instants it goes at
    once. *)
Definition Local_goes_at_once (tr : trace) : Prop := forall now t,
  In (Did (Hold now t 0)) tr -> exists p due, p <> 0 /\ says tr (arms t p due) /\ now < due.
(* ANCHOR_END: T1 *)

(** ** E1 to E3: two operators in a row *)

(* ANCHOR: E1-E3 *)
(** The last item of a message is sent where its timestamp is retired or its open was refused (D1). *)
Definition is_last (cfg : config) (t : N) (d : decision) : bool :=
  match d with
  | Miss _ u | Final _ u _ | Refuse _ u None _ => u =? t
  | Emit _ u _ => (u =? t) && negb (is_progressive cfg)
  | _ => false
  end.
Definition last_items (cfg : config) (t : N) (tr : trace) : list decision := filter (is_last cfg t) (decisions tr).
(** When, and with which deadline of local, [t] was to be opened. *)
Definition open_inputs (t : N) (tr : trace) : list (N * option N) :=
  flat_map (fun l => match l with Got now (Open u d) => if u =? t then [(now, d)] else [] | _ => [] end) tr.
(** A driver takes in message [t] at [a] once, and its deadlines end [reserve] before the end-to-end deadline, which is
    due at [due]; that of local is at least 1 ns. *)
Definition budgeted (tr : trace) (t a due reserve : N) : Prop :=
  (exists d, open_inputs t tr = [(a, Some d)] /\ d <= N.max 1 (due - reserve - a)) /\
  forall now p d backlog, In (Got now (Offer t p d backlog)) tr -> d <= due - reserve - now.
(** An input comes at most [late] after each due instant that is past. *)
Definition punctual (late : N) (tr : trace) : Prop := forall t p due,
  says tr (arms t p due) -> due <= clock_of tr -> exists now b, In (Got now b) tr /\ due <= now <= due + late.
(** A request of a message is due no later than [reserve] before its end-to-end deadline is. *)
Definition E3_budget (tr : trace) : Prop := forall t a due reserve p x : N,
  budgeted tr t a due reserve -> p <> 0 -> says tr (arms t p x) -> x <= due - reserve.
(** The end of a message's deadlines. *)
Definition ends (a due reserve : N) : N := N.max (due - reserve) (a + 1).
(** One operator has exactly one last item for each message that it takes in, once its deadlines are over, and no later
    than the lateness of its timers after that. *)
Definition E1_one_item (cfg : config) (tr : trace) : Prop := forall t a due reserve late,
  budgeted tr t a due reserve -> punctual late tr -> ends a due reserve <= clock_of tr ->
  exists d, last_items cfg t tr = [d] /\ instant_of d <= ends a due reserve + late.
(** Of two in a row the second takes in the first's last item for [t] as its message [u], at most [gap] later, with the
    same end-to-end deadline. Then it has exactly one last item for it; and that is no later than the end-to-end deadline,
    if each reserve covers what comes after: the second's its own lateness, the first's that, its own and the gap. *)
Definition E2_by_the_deadline (cfg1 cfg2 : config) (tr1 tr2 : trace) : Prop := forall t u a b due reserve1 reserve2 late gap,
  budgeted tr1 t a due reserve1 -> punctual late tr1 -> ends a due reserve1 <= clock_of tr1 ->
  (forall d, last_items cfg1 t tr1 = [d] -> instant_of d <= b <= instant_of d + gap) ->
  budgeted tr2 u b due reserve2 -> punctual late tr2 -> ends b due reserve2 <= clock_of tr2 ->
  exists d, last_items cfg2 u tr2 = [d] /\
    instant_of d <= N.max (due - reserve2) (ends a due reserve1 + late + gap + 1) + late /\
    (late <= reserve2 -> reserve2 + late + gap + 1 <= reserve1 -> reserve1 + a < due -> instant_of d <= due).
(* ANCHOR_END: E1-E3 *)
