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
(** Two operators in a row: the end-to-end deadline is due at 100. The first keeps a reserve of 40, and misses its message at
    60; the second takes that item in at 61, and keeps a reserve of 10. *)
Definition first_in_row : list input := [input_at 0 (Open 1 (Some 60)); input_at 0 (Offer 1 1 50 0); input_at 50 Tick;
  input_at 60 Tick].
Definition second_in_row : list input := [input_at 61 (Open 7 (Some 29)); input_at 61 (Offer 7 2 29 0); input_at 90 Tick].
