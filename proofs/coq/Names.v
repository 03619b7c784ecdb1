(** * Section 8: what an old name names

    A name has the place in the window in which its message was opened, and the generation that the place's word had then.
    A word counts how often its place was opened and retired, as far as it has bits for it. *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Trace Statements Broken.
Import ListNotations.
Open Scope N_scope.

(* ANCHOR: names *)
Section Of.
(** [place t] is where the message was opened; [m] is for how many messages the generations of a word last. *)
Variables (cfg : config) (place : N -> N) (m : N) (tr : trace).
(** The messages that were opened in a place, the newest first. *)
Definition messages (k : N) : list N := filter (fun t => place t =? k) (opened_in tr).
Fixpoint newer (t : N) (l : list N) : N :=
  match l with [] => 0 | u :: rest => if u =? t then 0 else N.succ (newer t rest) end.
(** How many messages have been opened in the place of [t] since. *)
Definition since (t : N) : N := newer t (messages (place t)).
Definition count (t : N) : N := N.of_nat (length (messages (place t))).
(** The generation is odd while a message is open. *)
Definition generation (openings : N) (is_open : bool) : N :=
  (if is_open then 2 * openings - 1 else 2 * openings) mod (2 * m).
Definition name (t : N) : N := generation (count t - since t) true.
(** The owner opens a message only in a place that is free. *)
Definition free_places : Prop := forall later earlier now t due, tr = later ++ Did (Opened now t due) :: earlier ->
  forall u, place u = place t -> says earlier (opens u) -> says earlier (retires cfg u).
(** Where [u] is open, a name of [t] is taken for that of [u] only if exactly a multiple of [m] messages have been
    opened in its place since; none have if [t] is [u]. *)
Definition S8_old_names : Prop := forall t u : N,
  says tr (opens t) -> says tr (opens u) -> ~ says tr (retires cfg u) -> place u = place t ->
  name t = generation (count t) true -> exists n, since t = n * m /\ (n = 0 -> t = u).
(** In a free place no name is taken for any. *)
Definition S8_free_place : Prop := forall t : N, says tr (opens t) -> name t <> generation (count t) false.
End Of.
(** The word has 64 bits, of which each of [c] clouds and local takes two. *)
Definition lasts (c : N) : N := 2 ^ (61 - 2 * c).
(* ANCHOR_END: names *)

Lemma newest_of f tr v rest : filter f (opened_in tr) = v :: rest -> exists later now due earlier,
  tr = later ++ Did (Opened now v due) :: earlier /\ filter f (opened_in earlier) = rest.
Proof.
  induction tr as [|l tr IH]; [discriminate|]. unfold opened_in. cbn [flat_map]. rewrite filter_app. intros H.
  assert (Other : filter f (opened_in tr) = v :: rest -> exists later now due earlier,
    l :: tr = later ++ Did (Opened now v due) :: earlier /\ filter f (opened_in earlier) = rest).
  { intros E. destruct (IH E) as (y & n & due & x & -> & R). exists (l :: y), n, due, x. auto. }
  destruct l as [n b|d]; [now apply Other|]. destruct d as [n u due| | | | | | | | | |]; try now apply Other.
  cbn in H. destruct (f u) eqn:F; [|now apply Other]. injection H as -> R. exists [], n, due, tr. auto.
Qed.
Lemma newer_less t l : In t l -> newer t l < N.of_nat (length l).
Proof.
  induction l as [|u l IH]; [intros []|]. cbn [newer length In]. destruct (N.eqb_spec u t); [lia|].
  intros [E|I]; [contradiction|]. specialize (IH I). lia.
Qed.
Lemma newer_none t l : In t l -> newer t l = 0 -> exists rest, l = t :: rest.
Proof.
  destruct l as [|u l]; [intros []|]. cbn. destruct (N.eqb_spec u t) as [->|]; [eauto|lia].
Qed.
Section Proofs.
Variables (cfg : config) (place : N -> N) (m : N) (tr : trace).
Hypothesis Some_bits : 1 <= m.
Lemma in_messages t : says tr (opens t) -> In t (messages place tr (place t)).
Proof. intros O. apply filter_In. split; [now apply opened_in_iff|apply N.eqb_refl]. Qed.
Lemma old_free_place : S8_free_place place m tr.
Proof.
  intros t O. unfold name, generation. assert (L := newer_less _ _ (in_messages t O)). fold (since place tr t) in L.
  fold (count place tr t) in L. set (n := count place tr t) in *. set (d := since place tr t) in *. intros E.
  assert (A := N.div_mod (2 * (n - d) - 1) (2 * m) ltac:(lia)). assert (B := N.div_mod (2 * n) (2 * m) ltac:(lia)).
  rewrite E in A. set (r := (2 * n) mod (2 * m)) in *. rewrite <- N.mul_assoc in A, B.
  set (x := m * _) in A. set (y := m * _) in B. lia.
Qed.
Hypothesis Free : free_places cfg place tr.
Lemma newest_open u : says tr (opens u) -> ~ says tr (retires cfg u) -> exists rest, messages place tr (place u) = u :: rest.
Proof.
  intros O N. assert (I := in_messages u O). destruct (messages place tr (place u)) as [|v rest] eqn:M; [contradiction|].
  destruct I as [->|I]; [eauto|]. exfalso. assert (V : place v = place u).
  { assert (X : In v (messages place tr (place u))) by (rewrite M; now left). apply filter_In in X as [_ X].
    now apply N.eqb_eq in X. }
  apply newest_of in M as (later & now & due & earlier & E & R). apply N. subst rest. apply filter_In in I as [I _].
  destruct (Free later earlier now v due E u (eq_sym V)) as (d & D & X); [now apply opened_in_iff|].
  exists d. split; auto. rewrite E. apply in_or_app. right. now right.
Qed.
Lemma old_names : S8_old_names cfg place m tr.
Proof.
  intros t u Ot Ou N P E. unfold name, generation in E. assert (L := newer_less _ _ (in_messages t Ot)).
  assert (Z := newer_none _ _ (in_messages t Ot)).
  fold (since place tr t) in L, Z. fold (count place tr t) in L.
  set (n := count place tr t) in *. set (d := since place tr t) in *.
  assert (A := N.div_mod (2 * (n - d) - 1) (2 * m) ltac:(lia)). assert (B := N.div_mod (2 * n - 1) (2 * m) ltac:(lia)).
  rewrite E in A. set (r := (2 * n - 1) mod (2 * m)) in *. set (x := _ / _) in A. set (y := _ / _) in B.
  exists (y - x). assert (D : d = (y - x) * m) by (rewrite N.mul_sub_distr_r; lia). split; auto. intros Y.
  assert (d = 0) as Zd by (rewrite D, Y; reflexivity). destruct (Z Zd) as (rest & M).
  destruct (newest_open u Ou N) as (rest' & M'). rewrite P, M in M'. congruence.
Qed.
End Proofs.
(* ANCHOR: named *)
(** With a word of 64 bits and room for [c] clouds. *)
Theorem s8_names cfg place c tr : free_places cfg place tr ->
  S8_old_names cfg place (lasts c) tr /\ S8_free_place place (lasts c) tr.
(* ANCHOR_END: named *)
Proof.
  intros F. assert (L : 1 <= lasts c) by (unfold lasts; assert (2 ^ (61 - 2 * c) <> 0) by (apply N.pow_nonzero; lia); lia).
  split; [now apply old_names|now apply old_free_place].
Qed.
