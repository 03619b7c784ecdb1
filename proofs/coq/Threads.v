(** * Section 8: many threads

    A call names one timestamp and bears an instant of its caller's own clock: it fires what is due by then of its own
    timestamp, then its input is applied. No call sees another one half done, since what it computes from the slot that
    it looked at is exchanged for that slot if it is there still. *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Promises Lines Ticks.
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
(** Each line says of the trace before it what F1, F2, F7 and P8 say of it. *)
Lemma expire_own_lines cfg t b n : forall tr s s' ds, good cfg tr s -> lines cfg tr s (Some b) ->
  expire_own n cfg t s = (s', ds) -> lines cfg (after ds tr) s' (Some b).
Proof.
  induction n as [|n IH]; intros tr s s' ds G K; cbn [expire_own]; [now intros [= <- <-]|].
  destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [option_map]; [|now intros [= <- <-]].
  destruct (earliest_of sl) as [due|]; [|now intros [= <- <-]]. destruct (due <=? clock s); [|now intros [= <- <-]].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= <- <-].
  rewrite after_app. apply (IH _ s1 s2); auto; [eapply good_fire|eapply lines_fire]; eauto.
Qed.
Lemma execute_lines cfg tr s c s' ds : fits_call c -> good cfg tr s -> lines cfg tr s None ->
  execute cfg s c = (s', ds) -> lines cfg (after ds (Got (instant c) (does c) :: tr)) s' None.
Proof.
  intros Fit G K. unfold execute. set (s0 := at_clock (instant c) s). set (tr0 := Got (instant c) (does c) :: tr).
  assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
  assert (C0 : current tr0 s0 (does c)) by (exists [], tr; split; [reflexivity|intros d []]).
  assert (K0 : lines cfg tr0 s0 (Some (does c))).
  { destruct K as [K1 K2 K3 K4 _]. constructor; auto; [now apply each_got|]. intros m M. apply says_got. now apply K3. }
  destruct (if expires c then _ else _) as [s1 ds1] eqn:E. destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A.
  intros [= <- <-]. rewrite after_app. destruct (expires c).
  - apply (lines_apply cfg (after ds1 tr0) s1 (does c)); auto; [|eapply expire_own_lines; eauto].
    eapply (expire_own_good cfg (names c) (does c) _ tr0); eauto.
  - injection E as <- <-. eapply lines_apply; eauto.
Qed.
Lemma in_order_lines cfg cs : forall s tr, Forall fits_call cs -> good cfg tr s -> lines cfg tr s None ->
  lines cfg (snd (in_order cfg s tr cs)) (fst (in_order cfg s tr cs)) None.
Proof.
  induction cs as [|c cs IH]; intros s tr F G K; cbn; auto. inversion F; subst.
  destruct (execute cfg s c) as [s1 ds] eqn:E. apply IH; auto; [eapply execute_good|eapply execute_lines]; eauto.
Qed.
(** A timer fires only if it was armed, and not before its due instant by the clock of the caller. *)
Lemma expire_own_fires cfg t now u p n : forall tr s s' ds, good cfg tr s -> expire_own n cfg t s = (s', ds) ->
  In (Timer now u p) ds -> exists due, says (after ds tr) (arms u p due) /\ due <= now.
Proof.
  induction n as [|n IH]; intros tr s s' ds G; cbn [expire_own]; [now intros [= _ <-]|].
  destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [option_map]; [|now intros [= _ <-]].
  destruct (earliest_of sl) as [due|]; [|now intros [= _ <-]].
  destruct (N.leb_spec due (clock s)) as [D|]; [|now intros [= _ <-]].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= _ <-] I.
  assert (G1 := good_fire cfg tr s due t sl s1 ds1 G L U). rewrite after_app.
  apply in_app_or in I as [I|I]; [|now apply (IH _ s1 s2)]. exists due.
  rewrite (slot_of_open _ _ _ L) in U. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
  injection U as _ <-. apply in_app_or in I as [I|I]; [|elim (timer_at_firing _ _ _ _ _ _ _ Se _ _ _ I)].
  apply in_map_iff in I as (x & [= <- <- <-] & I). apply fired_in in I. split; auto. apply says_more, says_more.
  now apply (a_armed _ _ _ _ (g_traced _ _ _ G t sl L)).
Qed.
Lemma in_order_fires cfg cs : forall s tr, Forall fits_call cs -> good cfg tr s -> P8_fires tr ->
  P8_fires (snd (in_order cfg s tr cs)).
Proof.
  induction cs as [|c cs IH]; intros s tr F G P; cbn; auto. inversion F; subst.
  destruct (execute cfg s c) as [s1 ds] eqn:E. apply IH; auto; [eapply execute_good; eauto|].
  intros now u p I. unfold after in I. apply in_app_or in I as [I|[[=]|I]].
  2:{ destruct (P now u p I) as (due & A & L). exists due. split; auto. apply says_more. now apply says_got. }
  apply in_rev in I. apply in_map_iff in I as (d & [= ->] & I). revert E I. unfold execute.
  set (s0 := at_clock (instant c) s). set (tr0 := Got (instant c) (does c) :: tr).
  assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
  destruct (if expires c then _ else _) as [s2 ds1] eqn:E. destruct (apply cfg s2 (does c)) as [s3 ds2] eqn:A.
  intros [= <- <-] I. rewrite after_app. apply in_app_or in I as [I|I].
  - destruct (expires c); [|injection E as <- <-; contradiction].
    destruct (expire_own_fires cfg (names c) now u p _ tr0 s0 s2 ds1 G0 E I) as (due & X & L). exists due. split; auto.
    now apply says_more.
  - elim (no_timer_at_apply cfg s2 (does c) now u p). now rewrite A.
Qed.
Lemma start_good cfg : good cfg [] initial.
Proof. exact (reach_good _ _ _ _ (at_start cfg)). Qed.
Lemma start_lines cfg : lines cfg [] initial None.
Proof. exact (reach_lines _ _ _ _ (at_start cfg)). Qed.

(** ** What is promised of many threads *)
(* ANCHOR: promises *)
Section Calls.
Variables (cfg : config) (cs : list call).
Hypothesis F : Forall fits_call cs.
Local Notation tr := (snd (in_order cfg initial [] cs)).
Local Notation G := (in_order_good cfg cs initial [] F (start_good cfg)).
Local Notation K := (in_order_lines cfg cs initial [] F (start_good cfg) (start_lines cfg)).
(** In the order of the calls of any threads a timestamp is forwarded once at most, or missed. *)
Theorem s8_p1_once : P1_once cfg tr. Proof. exact (good_p1_once _ _ _ G). Qed.
(** So do the outputs of one rise strictly under progressive, with one end. *)
Theorem s8_p1_progressive : P1_progressive cfg tr. Proof. exact (good_p1_progressive _ _ _ G). Qed.
(** What is forwarded came in time, by the clock of the caller who gave the result. *)
Theorem s8_p2_never_late : P2_never_late tr. Proof. exact (good_p2_never_late _ _ _ G). Qed.
(** No result that any thread had held outranks the one that is forwarded. *)
Theorem s8_p3_best_available : P3_best_available tr. Proof. exact (good_p3_best_available _ _ _ G). Qed.
(** Results are held only for one that outranks them all and may still come. *)
Theorem s8_p4_prompt : P4_prompt cfg tr. Proof. exact (good_p4_prompt _ _ _ G). Qed.
(** Local's result is held only where the request of some thread was admitted. *)
Theorem s8_p6_free_without_cloud : P6_free_without_cloud tr. Proof. exact (good_p6_free_without_cloud _ _ _ G). Qed.
(** Whatever threads race, a request arms one due instant at most. *)
Theorem s8_p8_one_timer : P8_one_timer tr. Proof. exact (good_p8_one_timer _ _ _ G). Qed.
(** A timer fires only at its due instant or later, by the clock of the caller who fired it. *)
Theorem s8_p8_fires : P8_fires tr.
Proof. apply in_order_fires; [exact F|exact (start_good cfg)|intros ? ? ? []]. Qed.
(** A timer fires only while it is live, so one of several threads fires it. *)
Theorem s8_p8_while_live : P8_while_live cfg tr. Proof. exact (each_p8_while_live _ _ (l_each _ _ _ _ K)). Qed.
(** The timestamps that threads open rise in the order of the calls. *)
Theorem s8_f1_order : F1_order tr. Proof. exact (each_f1_order cfg _ (l_each _ _ _ _ K)). Qed.
(** Whatever thread makes the offer, a source that is requested is a registered cloud. *)
Theorem s8_f2_registered : F2_registered cfg tr. Proof. exact (each_f2_registered _ _ (l_each _ _ _ _ K)). Qed.
(** A request outranks all that any thread had accepted for its timestamp before. *)
Theorem s8_f2_outranks : F2_outranks tr. Proof. exact (each_f2_outranks cfg _ (l_each _ _ _ _ K)). Qed.
(** The gates follow their law in the order of the calls that offer. *)
Theorem s8_f2g_gate : F2g_gate cfg tr. Proof. exact (each_f2g_gate _ _ (l_each _ _ _ _ K)). Qed.
(** Local is not cancelled, whichever thread commits. *)
Theorem s8_f7_local : F7_local tr. Proof. exact (each_f7_local cfg _ (l_each _ _ _ _ K)). Qed.
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
    changes nothing. A call goes by the slot that was looked at; the greatest timestamp and the gates are the owner's,
    whose calls come one after the other. *)
Definition slot_same (x y : option slot) : {x = y} + {x <> y}.
Proof. repeat decide equality. Defined.
Definition with_slot (s : state) (t : N) (o : option slot) : state :=
  set_opened (map (fun e => if fst e =? t then match o with Some sl => (t, sl) | None => e end else e) (opened s)) s.
Inductive act := Look (thread : nat) (t : N) | Exchange (thread : nat) (c : call).
Record moment := {
  machine : state;
  seen : nat -> option (N * option slot); (* what each thread looked at last, until its exchange uses it up *)
  history : trace
}.
Definition at_first : moment := {| machine := initial; seen := fun _ => None; history := [] |}.
Definition remember (i : nat) (o : option (N * option slot)) (m : moment) : nat -> option (N * option slot) :=
  fun j => if Nat.eqb j i then o else seen m j.
(** Thread [i] looked at [t], and its slot is another one now. *)
Definition stale (i : nat) (t : N) (m : moment) : bool :=
  match seen m i with
  | Some (u, o) => (u =? t) && if slot_same o (lookup t (opened (machine m))) then false else true
  | None => false
  end.
(** [does_call] is what a call does, as [execute] says. *)
Definition perform (does_call : state -> call -> state * list decision) (m : moment) (a : act) : moment :=
  match a with
  | Look i t => {| machine := machine m; seen := remember i (Some (t, lookup t (opened (machine m)))) m; history := history m |}
  | Exchange i c =>
      match seen m i with
      | Some (t, o) =>
          if (t =? names c) && negb (stale i t m) then
            let (s, ds) := does_call (with_slot (machine m) t o) c in
            {| machine := s; seen := remember i None m; history := after ds (Got (instant c) (does c) :: history m) |}
          else {| machine := machine m; seen := remember i None m; history := history m |}
      | None => m
      end
  end.
Definition interleave does_call (m : moment) (acts : list act) : moment := fold_left (perform does_call) acts m.
Definition fits_act (a : act) : Prop := match a with Exchange _ c => fits_call c | Look _ _ => True end.
Lemma with_same s t : NoDup (map fst (opened s)) -> with_slot s t (lookup t (opened s)) = s.
Proof.
  intros D. unfold with_slot. destruct s as [c n g l]. cbn in *. unfold set_opened. cbn. f_equal.
  destruct (lookup t l) as [sl|] eqn:L.
  - rewrite <- (map_id l) at 2. apply map_ext_in. intros [u x] I. cbn. destruct (N.eqb_spec u t) as [->|]; auto.
    apply in_lookup in I; auto. congruence.
  - rewrite <- (map_id l) at 2. apply map_ext. intros [u x]. cbn. now destruct (u =? t).
Qed.
Lemma fresh_same m i t o : seen m i = Some (t, o) -> stale i t m = false -> o = lookup t (opened (machine m)).
Proof. unfold stale. intros ->. rewrite N.eqb_refl. cbn. now destruct (slot_same _ _). Qed.
(** An act changes nothing but what its thread has seen, or does a call as a whole. *)
Lemma perform_cases cfg m a : NoDup (map fst (opened (machine m))) -> fits_act a ->
  machine (perform (execute cfg) m a) = machine m /\ history (perform (execute cfg) m a) = history m \/
  exists i c s ds, a = Exchange i c /\ fits_call c /\ stale i (names c) m = false /\ execute cfg (machine m) c = (s, ds) /\
    perform (execute cfg) m a = {| machine := s; seen := remember i None m;
      history := after ds (Got (instant c) (does c) :: history m) |}.
Proof.
  intros D F. destruct a as [i t|i c]; cbn; auto. destruct (seen m i) as [[t o]|] eqn:S; auto.
  destruct (t =? names c) eqn:E; cbn; auto. apply N.eqb_eq in E as ->.
  destruct (stale i (names c) m) eqn:St; cbn; auto. right.
  rewrite (fresh_same m i (names c) o S St), with_same by auto. destruct (execute cfg (machine m) c) as [s ds] eqn:X.
  exists i, c, s, ds. auto.
Qed.
(* ANCHOR: order *)
(** Any interleaving of looks and exchanges is a run of whole calls, one after the other: those whose exchanges
    succeeded, in the order of these. So all that is promised above holds of it. *)
Theorem s8_one_order cfg acts : forall m, good cfg (history m) (machine m) -> Forall fits_act acts ->
  exists cs, Forall fits_call cs /\
    (machine (interleave (execute cfg) m acts), history (interleave (execute cfg) m acts)) =
    in_order cfg (machine m) (history m) cs.
(* ANCHOR_END: order *)
Proof.
  induction acts as [|a acts IH]; intros m G F; cbn [interleave fold_left].
  - exists []. split; [constructor|reflexivity].
  - inversion F as [|? ? Fa Fr]; subst.
    destruct (perform_cases cfg m a (g_nodup _ _ _ G) Fa) as [(M & L)|(i & c & s & ds & -> & Fc & _ & X & P)].
    + destruct (IH (perform (execute cfg) m a)) as (cs & Fs & Y); [now rewrite M, L|auto|].
      exists cs. split; auto. unfold interleave in Y. now rewrite Y, M, L.
    + rewrite P. destruct (IH {| machine := s; seen := remember i None m;
        history := after ds (Got (instant c) (does c) :: history m) |}) as (cs & Fs & Y); auto.
      { eapply execute_good; eauto. }
      exists (c :: cs). split; [constructor; auto|]. unfold interleave in Y. rewrite Y. cbn. now rewrite X.
Qed.
