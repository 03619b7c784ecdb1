(** * The words of SPEC.md: sections 1, 2 and 6 *)
From Coq Require Import List NArith Bool.
Import ListNotations.
Open Scope N_scope.

(** ** Instants *)
Definition end_of_time : N := 18446744073709551615.
Definition due_at (now deadline : N) : N := N.min (now + deadline) end_of_time. (* A14 *)

(** ** Configuration and state (section 2) *)
Inductive commit := Eager | Patient | Progressive.
Record cloud := { priority : N; limit : N; resume : N }.
Definition cloud_with (p limit : N) (resume : option N) : cloud :=
  {| priority := p; limit := limit; resume := match resume with Some r => r | None => N.pred limit end |}.
Record config := { window : N; rule : commit; clouds : list cloud }.

Record slot := {
  requested : list N;
  pending : list N;
  cached : list N;
  armed : list (N * N) (* a priority and its due instant *)
}.
Definition empty_slot : slot := {| requested := []; pending := []; cached := []; armed := [] |}.
Record state := { clock : N; newest : option N; shut : list N; opened : list (N * slot) }.
Definition initial : state := {| clock := 0; newest := None; shut := []; opened := [] |}.

(** ** A configuration that is not refused (section 2) *)
Definition well_made (cfg : config) : Prop :=
  1 <= window cfg <= 1024 /\ (length (clouds cfg) <= 15)%nat /\ NoDup (map priority (clouds cfg)) /\
  Forall (fun c => 1 <= priority c <= 65535 /\ 1 <= limit c /\ resume c < limit c) (clouds cfg).

Definition registered (cfg : config) (p : N) : option cloud := find (fun c => priority c =? p) (clouds cfg).
Definition is_cloud (cfg : config) (p : N) : bool := match registered cfg p with Some _ => true | None => false end.

Definition is_eager (cfg : config) : bool := match rule cfg with Eager => true | _ => false end.
Definition is_patient (cfg : config) : bool := match rule cfg with Patient => true | _ => false end.
Definition is_progressive (cfg : config) : bool := match rule cfg with Progressive => true | _ => false end.

(** ** Inputs and decisions (section 6) *)
Inductive body :=
| Open (t : N) (deadline : option N) | Offer (t p deadline backlog : N) | Result (t p : N) | Fail (t p : N) | Tick.
Record input := { at_ : N; what : body }.
Inductive reason :=
| Order | Full | Deadline | Unknown | Closed | Duplicate | Outranked | Queue | Superseded | Unsolicited | Late.
(** [Opened] and [Failed] say that an open or a failure was accepted, for which a trace has no line. *)
Inductive decision :=
| Opened (now t : N) (due : option N) | Failed (now t p : N)
| Timer (now t p : N) | Refuse (now t : N) (p : option N) (why : reason) | Request (now t p due : N)
| Hold (now t p : N) | Drop (now t p : N) (why : reason) | Emit (now t p : N) | Final (now t p : N)
| Miss (now t : N) | Cancel (now t p : N).
Definition written (d : decision) : bool := match d with Opened _ _ _ | Failed _ _ _ => false | _ => true end.

(** ** The trace of a run, the newest line first: each input at the instant of F0, and then its decisions *)
Inductive line := Got (now : N) (b : body) | Did (d : decision).
Definition trace := list line.
Definition after (ds : list decision) (tr : trace) : trace := rev (map Did ds) ++ tr.
