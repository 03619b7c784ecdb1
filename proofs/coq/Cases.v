(** * A configuration and inputs, for Examples.v and the seeded faults (faults.toml) *)
From Coq Require Import List NArith.
From Fuseline Require Import Words Broken.
Import ListNotations.
Open Scope N_scope.

Definition under (r : commit) : config :=
  {| window := 2; rule := r; clouds := [cloud_with 1 4 None; cloud_with 2 4 (Some 0); cloud_with 3 4 None] |}.
Definition eager := under Eager.
Definition progressive := under Progressive.
Definition input_at (now : N) (b : body) : input := {| at_ := now; what := b |}.
(** Local and the first cloud are held until that cloud's timer fires. *)
Definition held : list input :=
  [input_at 0 (Open 1 (Some 100)); input_at 0 (Offer 1 1 50 0); input_at 0 (Offer 1 2 80 0);
   input_at 10 (Result 1 0); input_at 20 (Result 1 1)].
Definition committed := held ++ [input_at 50 Tick].
Definition over := committed ++ [input_at 100 Tick].
(** A timer fires and its timestamp stays open. *)
Definition waiting : list input := [input_at 0 (Open 1 (Some 100)); input_at 0 (Offer 1 1 50 0); input_at 60 Tick].

Tactic Notation "breaks" uconstr(lemma) := refine (lemma _); vm_compute; reflexivity.
Ltac happens := vm_compute; reflexivity.
