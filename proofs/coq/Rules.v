(** * The rules of SPEC.md, section 3

    One function, [step], that takes a configuration, a state and an input and gives the state after it and its
    decisions. Each rule stands under its identifier and reads as its text does, with the four sets of a timestamp as
    lists of priorities in ascending order. Nothing bounds the number of clouds, of timestamps or of the window. *)
From Coq Require Import List NArith Bool.
From Fuseline Require Export Words.
Import ListNotations.
Open Scope N_scope.

(** ** Sets of priorities *)
Definition mem (p : N) (l : list N) : bool := existsb (N.eqb p) l.
Definition any_above (p : N) (l : list N) : bool := existsb (N.ltb p) l.
Definition clouds_of (l : list N) : list N := filter (fun q => negb (q =? 0)) l.
(** The list stays in ascending order. *)
Fixpoint add {A} (key : A -> N) (x : A) (l : list A) : list A :=
  match l with
  | [] => [x]
  | y :: rest => if key x <? key y then x :: l else y :: add key x rest
  end.
Definition greatest (l : list N) : option N :=
  fold_right (fun p best => match best with Some m => Some (N.max p m) | None => Some p end) None l.

(** ** The open timestamps *)
Fixpoint lookup (t : N) (l : list (N * slot)) : option slot :=
  match l with
  | [] => None
  | (u, sl) :: rest => if u =? t then Some sl else lookup t rest
  end.
Fixpoint replace (t : N) (o : option slot) (l : list (N * slot)) : list (N * slot) :=
  match l with
  | [] => []
  | (u, sl) :: rest =>
      if u =? t then match o with Some x => (u, x) :: rest | None => rest end else (u, sl) :: replace t o rest
  end.
Definition is_open (s : state) (t : N) : bool := match lookup t (opened s) with Some _ => true | None => false end.
Definition slot_of (s : state) (t : N) : slot :=
  match lookup t (opened s) with Some sl => sl | None => empty_slot end.
(** Some [t' >= t] was opened. *)
Definition reached (s : state) (t : N) : bool := match newest s with Some n => t <=? n | None => false end.
Definition set_clock (n : N) (s : state) : state :=
  {| clock := N.max (clock s) n; newest := newest s; shut := shut s; opened := opened s |}.
Definition set_opened (o : list (N * slot)) (s : state) : state :=
  {| clock := clock s; newest := newest s; shut := shut s; opened := o |}.
Definition set_shut (g : list N) (s : state) : state :=
  {| clock := clock s; newest := newest s; shut := g; opened := opened s |}.
(** What became of one timestamp, and the decisions about it: without a slot it is retired. *)
Definition outcome := (option slot * list decision)%type.
Definition update (s : state) (t : N) (o : outcome) : state * list decision :=
  (set_opened (replace t (fst o) (opened s)) s, snd o).

(** A table of reasons: the first that holds refuses or drops. *)
Fixpoint first_reason (rows : list (reason * bool)) : option reason :=
  match rows with
  | [] => None
  | (why, holds) :: rest => if holds then Some why else first_reason rest
  end.

(** ** F1 Open *)
Definition f1_reasons (cfg : config) (s : state) (t : N) (deadline : option N) : list (reason * bool) := [
  (Order,    reached s t);
  (Full,     window cfg <=? N.of_nat (length (opened s)));
  (Deadline, match deadline with Some d => due_at (clock s) d <=? clock s | None => false end)
].
Definition new_slot (due : option N) : slot :=
  {| requested := [0]; pending := [0]; cached := [];
     armed := match due with Some d => [(0, d)] | None => [] end |}.
Definition open (cfg : config) (s : state) (t : N) (deadline : option N) : state * list decision :=
  match first_reason (f1_reasons cfg s t deadline) with
  | Some why => (s, [Refuse (clock s) t None why])
  | None =>
      let due := option_map (due_at (clock s)) deadline in
      ({| clock := clock s; newest := Some t; shut := shut s; opened := opened s ++ [(t, new_slot due)] |},
       [Opened (clock s) t due])
  end.

(** ** F2g Gate: whether that of [c] is shut after an offer *)
Definition shut_then (s : state) (c : cloud) (backlog : N) : bool :=
  if mem (priority c) (shut s) then negb (backlog <=? resume c) else limit c <=? backlog.
Definition gate_shut (cfg : config) (s : state) (p backlog : N) : bool :=
  match registered cfg p with Some c => shut_then s c backlog | None => false end.
Definition set_gate (p : N) (is_shut : bool) (s : state) : state :=
  let others := filter (fun q => negb (q =? p)) (shut s) in
  set_shut (if is_shut then p :: others else others) s.

(** ** F2 Offer: the gate, the last row, is looked at only where no row above holds *)
Definition f2_reasons (cfg : config) (s : state) (t p deadline : N) : list (reason * bool) := [
  (Unknown,   negb (is_cloud cfg p && reached s t));
  (Closed,    negb (is_open s t));
  (Duplicate, mem p (requested (slot_of s t)));
  (Outranked, any_above p (cached (slot_of s t)));
  (Deadline,  due_at (clock s) deadline <=? clock s)
].
Definition join (p due : N) (sl : slot) : slot :=
  {| requested := add id p (requested sl); pending := add id p (pending sl); cached := cached sl;
     armed := add fst (p, due) (armed sl) |}.
Definition offer (cfg : config) (s : state) (t p deadline backlog : N) : state * list decision :=
  match first_reason (f2_reasons cfg s t p deadline) with
  | Some why => (s, [Refuse (clock s) t (Some p) why])
  | None =>
      let is_shut := gate_shut cfg s p backlog in
      let asked := set_gate p is_shut s in
      if is_shut then (asked, [Refuse (clock s) t (Some p) Queue])
      else
        let due := due_at (clock s) deadline in
        update asked t (Some (join p due (slot_of s t)), [Request (clock s) t p due])
  end.

(** ** F7 Forward: [m] goes downstream, and its timestamp is retired *)
Definition forward (now t m : N) (sl : slot) : outcome :=
  (None, Emit now t m :: map (Cancel now t) (clouds_of (pending sl))).

(** ** F9: [p] goes downstream, and what it outranks is awaited no more *)
Definition improve (now t p : N) (sl : slot) : outcome :=
  let lines := Emit now t p :: map (Cancel now t) (clouds_of (filter (fun q => q <? p) (pending sl))) in
  match filter (N.ltb p) (pending sl) with
  | [] => (None, lines ++ [Final now t p])
  | better => (Some {| requested := requested sl; pending := better; cached := [p];
                       armed := filter (fun e => p <? fst e) (armed sl) |}, lines)
  end.

(** ** F6 Settle, after F4 or F5, whether or not by a timer of a cloud *)
Definition settle (cfg : config) (now t : N) (timer : bool) (sl : slot) : outcome :=
  if is_progressive cfg then
    match pending sl, greatest (cached sl) with
    | _ :: _, _ => (Some sl, [])
    | [], Some m => (None, [Final now t m])
    | [], None => (None, [Miss now t])
    end
  else
    match greatest (cached sl) with
    | Some m =>
        if negb (any_above m (pending sl)) || (is_eager cfg && timer) then forward now t m sl else (Some sl, [])
    | None => match pending sl with [] => (None, [Miss now t]) | _ => (Some sl, []) end
    end.

(** ** F3 Result *)
Definition f3_reasons (cfg : config) (s : state) (t p : N) : list (reason * bool) := [
  (Unknown,     negb (((p =? 0) || is_cloud cfg p) && reached s t));
  (Superseded,  negb (is_open s t) || is_progressive cfg && any_above p (cached (slot_of s t)));
  (Unsolicited, negb (mem p (requested (slot_of s t))));
  (Duplicate,   mem p (cached (slot_of s t)));
  (Late,        negb (mem p (pending (slot_of s t))))
].
(** [ps] leave pending and armed. *)
Definition close (ps : list N) (sl : slot) : slot :=
  {| requested := requested sl; pending := filter (fun q => negb (mem q ps)) (pending sl); cached := cached sl;
     armed := filter (fun e => negb (mem (fst e) ps)) (armed sl) |}.
Definition hold (cfg : config) (p : N) (sl : slot) : slot :=
  {| requested := requested sl; pending := filter (fun q => negb (q =? p)) (pending sl);
     cached := add id p (cached sl);
     armed := if (p =? 0) || is_patient cfg then filter (fun e => negb (fst e =? p)) (armed sl) else armed sl |}.
Definition result (cfg : config) (now t p : N) (sl : slot) : outcome :=
  if is_progressive cfg then improve now t p sl
  else if any_above p (pending sl) then (Some (hold cfg p sl), [Hold now t p])
  else forward now t p (close [p] sl).

(** ** F4 Fail *)
Definition fail (cfg : config) (now t p : N) (sl : slot) : outcome :=
  let (o, ds) := settle cfg now t false (close [p] sl) in (o, Failed now t p :: ds).
(** Drops for the reasons of F3; else the rule is applied. *)
Definition arrive (cfg : config) (s : state) (t p : N) (accept : slot -> outcome) : state * list decision :=
  match first_reason (f3_reasons cfg s t p) with
  | Some why => (s, [Drop (clock s) t p why])
  | None => update s t (accept (slot_of s t))
  end.

(** ** F5 Expire: the earliest due instant of all, and the smallest timestamp that has one then *)
Definition timers (l : list (N * slot)) : list (N * N) :=
  flat_map (fun e => map (fun a => (snd a, fst e)) (armed (snd e))) l.
Definition sooner (x y : N * N) : bool := (fst x <? fst y) || ((fst x =? fst y) && (snd x <=? snd y)).
Definition earliest (l : list (N * N)) : option (N * N) :=
  fold_right (fun x best =>
    match best with Some y => if sooner x y then Some x else Some y | None => Some x end) None l.
Definition fired (due : N) (sl : slot) : list N := map fst (filter (fun e => snd e =? due) (armed sl)).
Definition fire (cfg : config) (now t due : N) (sl : slot) : outcome :=
  let ps := fired due sl in
  let (o, ds) := settle cfg now t (existsb (fun p => negb (p =? 0)) ps) (close ps sl) in
  (o, map (Timer now t) ps ++ ds).
(** Each firing disarms a timer, so as many rounds as there are timers are enough (Invariant.v). *)
Fixpoint expire (rounds : nat) (cfg : config) (s : state) : state * list decision :=
  match rounds, earliest (timers (opened s)) with
  | S n, Some (due, t) =>
      if due <=? clock s then
        let (s1, ds1) := update s t (fire cfg (clock s) t due (slot_of s t)) in
        let (s2, ds2) := expire n cfg s1 in (s2, ds1 ++ ds2)
      else (s, [])
  | _, _ => (s, [])
  end.

(** ** F0 Time: the clock, then what is due, then the input itself *)
Definition apply (cfg : config) (s : state) (b : body) : state * list decision :=
  match b with
  | Open t deadline => open cfg s t deadline
  | Offer t p deadline backlog => offer cfg s t p deadline backlog
  | Result t p => arrive cfg s t p (result cfg (clock s) t p)
  | Fail t p => arrive cfg s t p (fail cfg (clock s) t p)
  | Tick => (s, [])
  end.
Definition step (cfg : config) (s : state) (i : input) : state * list decision :=
  let s0 := set_clock (at_ i) s in
  let (s1, ds1) := expire (length (timers (opened s0))) cfg s0 in
  let (s2, ds2) := apply cfg s1 (what i) in
  (s2, ds1 ++ ds2).

(** ** Runs *)
Fixpoint run (cfg : config) (s : state) (tr : trace) (ins : list input) : state * trace :=
  match ins with
  | [] => (s, tr)
  | i :: rest =>
      let (s1, ds) := step cfg s i in
      run cfg s1 (after ds (Got (N.max (clock s) (at_ i)) (what i) :: tr)) rest
  end.
Definition state_after (cfg : config) (ins : list input) : state := fst (run cfg initial [] ins).
Definition trace_of (cfg : config) (ins : list input) : trace := snd (run cfg initial [] ins).

