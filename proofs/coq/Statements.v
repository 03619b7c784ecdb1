(** * The promises of SPEC.md, section 4, as statements about a trace

    Each says of [tr] what came in and what was decided, in the words of Trace.v, and nothing of a state. Promises.v,
   Accounts.v, Ticks.v and AsPatient.v prove them of the trace of any inputs under any configuration. Since each beginning
    of a run is a run, "by an instant" reads: whenever the clock of the trace has reached it. Examples.v has for each a run
    where its hypothesis holds, and a trace that breaks it. *)
From Coq Require Import List NArith Bool Sorted.
From Fuseline Require Import Words Trace.
Import ListNotations.
Open Scope N_scope.

(** The instant of the newest input. *)
Fixpoint clock_of (tr : trace) : N :=
  match tr with [] => 0 | Got now _ :: _ => now | Did _ :: rest => clock_of rest end.

Section Of.
Variables (cfg : config) (tr : trace).

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
(** Whatever is forwarded had been asked for, and came before the due instant of its request, or of local, if any. *)
Definition P2_never_late : Prop := forall t p : N,
  says tr (emits t p) -> in_time tr t p.
(** No result that was ever held for a timestamp outranks the one that is forwarded. *)
Definition P3_best_available : Prop := forall t m q : N,
  says tr (emits t m) -> says tr (holds t q) -> q <= m.
(** While results are held, something that was asked for and has not come outranks all of them. *)
Definition P4_prompt : Prop := forall t c : N,
  says tr (holds t c) -> ~ says tr (retires cfg t) ->
  exists q, says tr (requests t q) /\ ~ says tr (closes cfg t q) /\ forall b, says tr (holds t b) -> b < q.
(** Once any result was accepted, local's or a cloud's, its timestamp has an output by the latest due instant of its
    requests. *)
Definition P5_local_floor : Prop := forall t p : N,
  says tr (accepts t p) ->
   (forall q due, q <> 0 -> says tr (arms t q due) -> due <= clock_of tr) -> exists m, says tr (emits t m).
(** Local's result is held only for a timestamp for which a request was admitted. *)
Definition P6_free_without_cloud : Prop := forall t : N,
  says tr (holds t 0) -> exists p, says tr (requests t p).
(** A timestamp that was opened and is not retired waits for local, or has a live timer that is due later. *)
Definition P7_no_stall : Prop := forall t : N,
  says tr (opens t) -> ~ says tr (retires cfg t) -> ~ says tr (closes cfg t 0) \/
  exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
(** One that was opened with a deadline has a live timer as long as it is open. *)
Definition P7_with_deadline : Prop := forall t x : N,
  says tr (arms t 0 x) -> ~ says tr (retires cfg t) ->
  exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
(** And it is retired by the latest due instant that was ever armed for it. *)
Definition P7_retired : Prop := forall t x : N,
  says tr (arms t 0 x) -> (forall p due, says tr (arms t p due) -> due <= clock_of tr) ->
   says tr (retires cfg t).
(** A request, and local, arms at most one due instant. *)
Definition P8_one_timer : Prop := forall t p a b : N,
  says tr (arms t p a) -> says tr (arms t p b) -> a = b.
(** A timer fires only if it was armed, and not before its due instant. *)
Definition P8_fires : Prop := forall now t p : N,
  In (Did (Timer now t p)) tr -> exists due, says tr (arms t p due) /\ due <= now.
(** None is overdue: an armed timer that is due has ended, or its timestamp has. *)
Definition P8_served : Prop := forall t p due : N,
  says tr (arms t p due) -> due <= clock_of tr -> ~ says tr (retires cfg t) ->
   says tr (disarms cfg t p).
(** Once local has arrived, or was outdone, and the due instants of all requests are past, a timestamp is retired. *)
Definition P12_bounded_wait : Prop := forall t : N,
  says tr (opens t) -> says tr (closes cfg t 0) ->
   (forall p due, p <> 0 -> says tr (arms t p due) -> due <= clock_of tr) -> says tr (retires cfg t).
End Of.
