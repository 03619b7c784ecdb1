(** The machine of Rules.v as OCaml. *)
From Fuseline Require Import Rules.
From Coq Require Import ExtrOcamlBasic Extraction.
Extraction Language OCaml.
Extraction "machine.ml" initial cloud_with step.
