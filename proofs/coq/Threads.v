(** * Section 8: many threads

    A call names one timestamp and bears an instant of its caller's own clock: it fires what is due by then of its own
    timestamp, then its input is applied. No call sees another one half done, since what it computes from the slot that
    it looked at is exchanged for that slot if it is there still. *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Kept Runs Accounts Promises Ticks.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** A call *)
(* ANCHOR: calls *)
(** [names] is the timestamp; an open expires nothing. A tick is for its timestamp alone. *)
Record call := { names : N; instant : N; does : body }.
Definition fits_call (c : call) : Prop :=
  match does c with Open t _ | Offer t _ _ _ | Result t _ | Fail t _ => names c = t | Tick => True end.
Definition expires (c : call) : bool := match does c with Open _ _ => false | _ => true end.
(** The earliest due instant of one timestamp. *)
Definition earliest_of (sl : slot) : option N :=
  fold_right (fun a best => match best with Some d => Some (N.min (snd a) d) | None => Some (snd a) end) None (armed sl).
Fixpoint expire_own (rounds : nat) (cfg : config) (t : N) (s : state) : state * list decision :=
  match rounds, option_map earliest_of (lookup t (opened s)) with
  | S n, Some (Some due) =>
      if due <=? clock s then
        let (s1, ds1) := update s t (fire cfg (clock s) t due (slot_of s t)) in
        let (s2, ds2) := expire_own n cfg t s1 in (s2, ds1 ++ ds2)
      else (s, [])
  | _, _ => (s, [])
  end.
(** What a call does at one instant. The clock is its caller's: that of another one binds it not. *)
Definition execute (cfg : config) (s : state) (c : call) : state * list decision :=
  let s0 := at_clock (instant c) s in
  let (s1, ds1) := if expires c then expire_own (length (armed (slot_of s0 (names c)))) cfg (names c) s0 else (s0, []) in
  let (s2, ds2) := apply cfg s1 (does c) in (s2, ds1 ++ ds2).
Fixpoint in_order (cfg : config) (s : state) (tr : trace) (cs : list call) : state * trace :=
  match cs with
  | [] => (s, tr)
  | c :: rest => let (s1, ds) := execute cfg s c in in_order cfg s1 (after ds (Got (instant c) (does c) :: tr)) rest
  end.
(* ANCHOR_END: calls *)

(** ** In the order of the calls the invariant holds: whatever instants they bear *)
Lemma earliest_of_some sl due : earliest_of sl = Some due -> (exists p, In (p, due) (armed sl)) /\
  forall p d, In (p, d) (armed sl) -> due <= d.
Proof.
  unfold earliest_of. revert due. induction (armed sl) as [|[p d] l IH]; cbn; [discriminate|]. intros due.
  destruct (fold_right _ None l) as [x|] eqn:F; intros [= <-].
  - destruct (IH x eq_refl) as [(q & Q) M]. split.
    + destruct (N.min_spec d x) as [[_ ->]|[_ ->]]; [exists p; auto|exists q; auto].
    + intros r e [[= <- <-]|I]; [lia|]. specialize (M r e I). lia.
  - split; [exists p; auto|]. destruct l as [|y l]; [|cbn in F; destruct (fold_right _ None l); discriminate].
    intros r e [[= <- <-]|[]]. lia.
Qed.
Lemma earliest_of_none sl : earliest_of sl = None -> armed sl = [].
Proof. unfold earliest_of. destruct (armed sl) as [|a l]; auto. cbn. destruct (fold_right _ None l); discriminate. Qed.
Lemma expire_own_good cfg t b n : forall tr s s' ds, good cfg tr s -> current tr s b ->
  (length (armed (slot_of s t)) <= n)%nat -> expire_own n cfg t s = (s', ds) ->
  good cfg (after ds tr) s' /\ current (after ds tr) s' b /\ rest_of s' t.
Proof.
  assert (Rest : forall s : state, (forall sl due, lookup t (opened s) = Some sl -> earliest_of sl = Some due ->
    clock s < due) -> rest_of s t).
  { intros s H sl p d L I. destruct (earliest_of sl) as [e|] eqn:E.
    - specialize (H sl e L E). apply earliest_of_some in E as [_ M]. specialize (M p d I). lia.
    - apply earliest_of_none in E. rewrite E in I. contradiction. }
  induction n as [|n IH]; intros tr s s' ds G C F; cbn [expire_own].
  - intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros sl due L E. rewrite (slot_of_open _ _ _ L) in F.
    apply earliest_of_some in E as [(p & I) _]. destruct (armed sl); [contradiction|cbn in F; lia].
  - destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [option_map].
    2:{ intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros x due E. congruence. }
    destruct (earliest_of sl) as [due|] eqn:E.
    2:{ intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros x d Lx Ex. congruence. }
    destruct (N.leb_spec due (clock s)) as [D|D].
    2:{ intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros x d Lx Ex. congruence. }
    destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= <- <-].
    assert (G1 := good_fire cfg tr s due t sl s1 ds1 G L U). assert (C1 := current_fire cfg tr s b due t s1 ds1 C U).
    rewrite after_app. apply (IH _ s1 s2 ds2 G1 C1); auto.
    rewrite (slot_of_open _ _ _ L) in F, U. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
    injection U as <- _. unfold slot_of. cbn [fst opened set_opened].
    rewrite (lookup_replace t o _ sl (g_nodup _ _ _ G) L). destruct o as [x|]; [|cbn; lia].
    apply settle_keeps in Se as ->. apply earliest_of_some in E as [(p & I) _].
    assert (Fw := filter_fewer (fun e0 : N * N => negb (mem (fst e0) (fired due sl))) (p, due) (armed sl) I).
    assert (M : mem p (fired due sl) = true) by now apply mem_iff, fired_in. cbn in Fw. rewrite M in Fw.
    specialize (Fw eq_refl). cbn. lia.
Qed.
Lemma execute_good cfg tr s c s' ds : fits_call c -> good cfg tr s -> execute cfg s c = (s', ds) ->
  good cfg (after ds (Got (instant c) (does c) :: tr)) s'.
Proof.
  intros Fit G. unfold execute. set (s0 := at_clock (instant c) s). set (tr0 := Got (instant c) (does c) :: tr).
  assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
  assert (C0 : current tr0 s0 (does c)) by (exists [], tr; split; [reflexivity|intros d []]).
  destruct (if expires c then _ else _) as [s1 ds1] eqn:E. destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A.
  intros [= <- <-]. rewrite after_app.
  assert (K : good cfg (after ds1 tr0) s1 /\ current (after ds1 tr0) s1 (does c) /\
    (forall t p, does c = Result t p -> rest_of s1 t)).
  { destruct (expires c) eqn:X.
    - apply (expire_own_good cfg (names c) (does c) _ tr0) in E as (A1 & A2 & A3); auto. split; [exact A1|split; [exact A2|]].
      intros t p B. unfold fits_call in Fit. rewrite B in Fit. now rewrite <- Fit.
    - injection E as <- <-. split; [exact G0|split; [exact C0|]]. intros t p B. unfold expires in X. rewrite B in X. discriminate. }
  destruct K as (K1 & K2 & K3). eapply good_apply; eauto.
Qed.
Lemma in_order_good cfg cs : forall s tr, Forall fits_call cs -> good cfg tr s ->
  good cfg (snd (in_order cfg s tr cs)) (fst (in_order cfg s tr cs)).
Proof.
  induction cs as [|c cs IH]; intros s tr F G; cbn; auto. inversion F; subst.
  destruct (execute cfg s c) as [s1 ds] eqn:E. apply IH; auto. eapply execute_good; eauto.
Qed.
Lemma start_good cfg : good cfg [] initial.
Proof. exact (reach_good _ _ _ _ (at_start cfg)). Qed.

(** ** What is promised of many threads *)
(* ANCHOR: promises *)
Section Calls.
Variables (cfg : config) (cs : list call).
Hypothesis F : Forall fits_call cs.
Local Notation tr := (snd (in_order cfg initial [] cs)).
Local Notation G := (in_order_good cfg cs initial [] F (start_good cfg)).
(** P1 to P4, and one due instant for each timer (P8), in the order of the calls; P2 is by the clock of the caller who
    gave the result. *)
Theorem s8_p1_once : P1_once cfg tr. Proof. exact (good_p1_once _ _ _ G). Qed.
Theorem s8_p1_progressive : P1_progressive cfg tr. Proof. exact (good_p1_progressive _ _ _ G). Qed.
Theorem s8_p2_never_late : P2_never_late tr. Proof. exact (good_p2_never_late _ _ _ G). Qed.
Theorem s8_p3_best_available : P3_best_available tr. Proof. exact (good_p3_best_available _ _ _ G). Qed.
Theorem s8_p4_prompt : P4_prompt cfg tr. Proof. exact (good_p4_prompt _ _ _ G). Qed.
Theorem s8_p6_free_without_cloud : P6_free_without_cloud tr. Proof. exact (good_p6_free_without_cloud _ _ _ G). Qed.
Theorem s8_p8_one_timer : P8_one_timer tr. Proof. exact (good_p8_one_timer _ _ _ G). Qed.
End Calls.
(** P11: the input itself has the decisions that its kind may have. *)
Theorem s8_p11_accounted cfg s c : exists of_due of_input, snd (execute cfg s c) = of_due ++ of_input /\
  own cfg (instant c) (does c) of_input.
(* ANCHOR_END: promises *)
Proof.
  unfold execute. destruct (if expires c then _ else _) as [s1 ds1] eqn:E.
  destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A. cbn. exists ds1, ds2. split; auto.
  assert (Cl : forall n s0 s3 ds3, expire_own n cfg (names c) s0 = (s3, ds3) -> clock s3 = clock s0).
  { induction n as [|n IH]; intros s0 s3 ds3; cbn [expire_own]; [now intros [= <- _]|].
    destruct (option_map _ _) as [[due|]|]; try now intros [= <- _].
    destruct (due <=? clock s0); [|now intros [= <- _]]. destruct (update _ _ _) as [s4 ds4] eqn:U.
    destruct (expire_own n cfg (names c) s4) as [s5 ds5] eqn:X. intros [= <- _]. apply IH in X. rewrite X.
    unfold update in U. injection U as <- _. reflexivity. }
  assert (C : clock s1 = instant c) by (destruct (expires c); [now apply Cl in E|now injection E as <- _]).
  rewrite <- C. change ds2 with (snd (s2, ds2)). rewrite <- A. apply apply_own.
Qed.

(** ** Exchanges *)

(** A thread looks at the slot of a timestamp, computes what its call makes of it, and exchanges the one for the other;
    between the two any others may do the same. The exchange succeeds if the slot that it looked at is there, and else
    changes nothing. [plan] goes by the slot that was looked at; the greatest timestamp and the gates are the owner's,
    whose calls come one after the other. *)
Definition slot_same (x y : option slot) : {x = y} + {x <> y}.
Proof. repeat decide equality. Defined.
Definition with_slot (s : state) (t : N) (o : option slot) : state :=
  set_opened (map (fun e => if fst e =? t then match o with Some sl => (t, sl) | None => e end else e) (opened s)) s.
Definition plan (cfg : config) (s : state) (seen : option slot) (c : call) : state * list decision :=
  execute cfg (with_slot s (names c) seen) c.
Inductive act := Look (thread : nat) (t : N) | Exchange (thread : nat) (c : call).
(** What each thread looked at last. *)
Definition memory := nat -> option slot.
Fixpoint interleave (cfg : config) (s : state) (seen : memory) (tr : trace) (acts : list act) : state * trace :=
  match acts with
  | [] => (s, tr)
  | Look i t :: rest =>
      interleave cfg s (fun j => if Nat.eqb j i then lookup t (opened s) else seen j) tr rest
  | Exchange i c :: rest =>
      if slot_same (seen i) (lookup (names c) (opened s)) then
        let (s1, ds) := plan cfg s (seen i) c in
        interleave cfg s1 seen (after ds (Got (instant c) (does c) :: tr)) rest
      else interleave cfg s seen tr rest
  end.
Lemma with_same s t : NoDup (map fst (opened s)) -> with_slot s t (lookup t (opened s)) = s.
Proof.
  intros D. unfold with_slot. destruct s as [c n g l]. cbn in *. unfold set_opened. cbn. f_equal.
  destruct (lookup t l) as [sl|] eqn:L.
  - rewrite <- (map_id l) at 2. apply map_ext_in. intros [u x] I. cbn. destruct (N.eqb_spec u t) as [->|]; auto.
    apply in_lookup in I; auto. congruence.
  - rewrite <- (map_id l) at 2. apply map_ext. intros [u x]. cbn. now destruct (u =? t).
Qed.
(* ANCHOR: order *)
(** Any interleaving of looks and exchanges is a run of whole calls, one after the other: those whose exchanges
    succeeded, in the order of these. So all that is promised above holds of it. *)
Theorem s8_one_order cfg acts : forall s seen tr, good cfg tr s ->
  Forall (fun a => match a with Exchange _ c => fits_call c | Look _ _ => True end) acts ->
  exists cs, Forall fits_call cs /\ interleave cfg s seen tr acts = in_order cfg s tr cs.
(* ANCHOR_END: order *)
Proof.
  induction acts as [|[i t|i c] acts IH]; intros s seen tr G F; cbn [interleave].
  - exists []. split; [constructor|reflexivity].
  - inversion F; subst. apply IH; auto.
  - inversion F as [|? ? Fc Fa]; subst. destruct (slot_same _ _) as [E|E]; [|now apply IH].
    unfold plan. rewrite E, with_same by apply (g_nodup _ _ _ G). destruct (execute cfg s c) as [s1 ds] eqn:X.
    destruct (IH s1 seen (after ds (Got (instant c) (does c) :: tr))) as (cs & Fs & Y); auto.
    { eapply execute_good; eauto. }
    exists (c :: cs). split; [constructor; auto|]. cbn. now rewrite X.
Qed.
