(** * P10 deterministic *)
From Coq Require Import List NArith Bool Lia Permutation.
From Fuseline Require Import Rules Sets Trace Statements Slots Kept Runs.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

Definition at_clock (c : N) (s : state) : state :=
  {| clock := c; newest := newest s; shut := shut s; opened := opened s |}.

(** All firings due by [c], without a bound on the rounds. *)
Inductive fires (cfg : config) (c : N) : state -> state -> list decision -> Prop :=
| f_rest s : (forall due t, earliest (timers (opened s)) = Some (due, t) -> c < due) -> fires cfg c s s []
| f_more s due t s1 ds1 s2 ds2 : earliest (timers (opened s)) = Some (due, t) -> due <= c ->
    update s t (fire cfg (clock s) t due (slot_of s t)) = (s1, ds1) -> fires cfg c s1 s2 ds2 ->
    fires cfg c s s2 (ds1 ++ ds2).

Lemma expire_fires cfg n : forall tr s s' ds b, reach cfg tr s (Some b) -> (length (timers (opened s)) <= n)%nat ->
  expire n cfg s = (s', ds) -> fires cfg (clock s) s s' ds.
Proof.
  induction n as [|n IH]; intros tr s s' ds b R F; cbn [expire].
  - intros [= <- <-]. constructor. assert (Z : timers (opened s) = []) by (destruct (timers (opened s));
      [auto|cbn in F; lia]).
    rewrite Z. discriminate.
  - destruct (earliest (timers (opened s))) as [[due t]|] eqn:E.
    2:{ intros [= <- <-]. constructor. intros d0 t0 X. congruence. }
    destruct (N.leb_spec due (clock s)) as [L|L].
    2:{ intros [= <- <-]. constructor. intros d0 t0 X. rewrite E in X. congruence. }
    destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire n cfg s1) as [s2 ds2] eqn:Ex. intros [= <- <-].
    assert (Fw := fire_fewer cfg tr s due t s1 ds1 (reach_good _ _ _ _ R) E U).
    assert (C : clock s1 = clock s) by (unfold update in U; injection U as <- _; reflexivity).
    apply (f_more cfg (clock s) s due t s1 ds1); auto. rewrite <- C.
    apply (IH _ s1 s2 ds2 b (at_firing cfg tr s b due t s1 ds1 R E L U)); [lia|auto].
Qed.
Lemma fires_one cfg c s s1 ds1 : fires cfg c s s1 ds1 -> forall s2 ds2, fires cfg c s s2 ds2 -> s1 = s2 /\ ds1 = ds2.
Proof.
  induction 1 as [s H|s d t s1 ds1 s3 ds3 E L F A IH]; intros s2 ds2 B.
  - inversion B; subst; auto. match goal with X : earliest _ = Some _ |- _ => apply H in X end. lia.
  - inversion B as [? H|? d0 t0 ? ? ? ? E0 L0 F0 B0]; subst.
    + apply H in E. lia.
    + rewrite E in E0. injection E0 as <- <-. rewrite F in F0. injection F0 as <- <-.
      destruct (IH _ _ B0) as [-> ->]. auto.
Qed.
Lemma settle_unstamped cfg a b t timer sl : fst (settle cfg a t timer sl) = fst (settle cfg b t timer sl) /\
  map unstamped (snd (settle cfg a t timer sl)) = map unstamped (snd (settle cfg b t timer sl)).
Proof.
  unfold settle, forward. destruct (is_progressive cfg).
  - destruct (pending sl), (greatest (cached sl)); auto.
  - destruct (greatest (cached sl)) as [m|]; [|destruct (pending sl); auto].
    destruct (_ || _); cbn; auto. split; auto. f_equal. rewrite !map_map. reflexivity.
Qed.
Lemma fire_at cfg c s due t s1 ds1 : update s t (fire cfg (clock s) t due (slot_of s t)) = (s1, ds1) -> exists ds2,
  update (at_clock c s) t (fire cfg c t due (slot_of (at_clock c s) t)) = (at_clock c s1, ds2) /\
  map unstamped ds2 = map unstamped ds1.
Proof.
  change (slot_of (at_clock c s) t) with (slot_of s t). unfold update, fire.
  destruct (settle_unstamped cfg (clock s) c t (existsb (fun p => negb (p =? 0)) (fired due (slot_of s t)))
    (close (fired due (slot_of s t)) (slot_of s t))) as [A B].
  destruct (settle cfg (clock s) _ _ _) as [o e], (settle cfg c _ _ _) as [o2 e2]. cbn in A, B. subst o2.
  intros [= <- <-]. eexists. split; [reflexivity|]. cbn. rewrite !map_app, !map_map, B. reflexivity.
Qed.
Lemma fires_then cfg c1 c2 s s1 ds1 : c1 <= c2 -> fires cfg c1 s s1 ds1 -> forall s2 ds2,
  fires cfg c2 (at_clock c2 s1) s2 ds2 -> exists ds,
  fires cfg c2 (at_clock c2 s) s2 ds /\ map unstamped ds = map unstamped (ds1 ++ ds2).
Proof.
  intros L A. induction A as [s H|s d t s1 ds1 s3 ds3 E D F A IH]; intros s2 ds2 B; [exists ds2; auto|].
  destruct (IH _ _ B) as (ds & X & Y). destruct (fire_at cfg c2 s d t s1 ds1 F) as (ds' & P & Q).
  exists (ds' ++ ds). split.
  - apply (f_more cfg c2 _ d t (at_clock c2 s1)); auto. lia.
  - rewrite <- app_assoc, !map_app in *. now rewrite Q, Y.
Qed.

(** One tick before an input. *)
Lemma one_tick cfg tr s c1 c2 b s1 ds1 s2 ds2 : reach cfg tr s None -> c1 <= c2 ->
  step cfg s {| at_ := c1; what := Tick |} = (s1, ds1) ->
  step cfg s1 {| at_ := c2; what := b |} = (s2, ds2) ->
  exists ds, step cfg s {| at_ := c2; what := b |} = (s2, ds) /\ map unstamped ds = map unstamped (ds1 ++ ds2).
Proof.
  intros R L S1. assert (R1 := proj1 (step_reach _ _ _ _ _ _ R S1)). revert S1. unfold step. cbn [at_ what apply].
  destruct (expire _ cfg (set_clock c1 s)) as [u1 e1] eqn:E1. intros [= <- <-].
  destruct (expire _ cfg (set_clock c2 u1)) as [u2 e2] eqn:E2.
  destruct (apply cfg u2 b) as [u3 e3] eqn:A. intros [= <- <-]. rewrite app_nil_r in *.
  destruct (expire_reach cfg _ _ _ u1 e1 Tick (at_input cfg tr s c1 Tick R) (le_n _) E1) as (_ & _ & C1).
  apply (expire_fires cfg _ _ _ _ _ _ (at_input cfg tr s c1 Tick R) (le_n _)) in E1.
  apply (expire_fires cfg _ _ _ _ _ _ (at_input cfg _ u1 c2 Tick R1) (le_n _)) in E2. cbn in C1, E1, E2.
  rewrite C1 in E2. replace (N.max (N.max (clock s) c1) c2) with (N.max (clock s) c2) in E2 by lia.
  assert (S1 : set_clock c2 u1 = at_clock (N.max (clock s) c2) u1).
  { unfold set_clock, at_clock. rewrite C1. f_equal. lia. }
  rewrite S1 in E2.
  destruct (fires_then cfg (N.max (clock s) c1) (N.max (clock s) c2) _ u1 e1 ltac:(lia) E1 _ _ E2) as (ds & F & U).
  destruct (expire _ cfg (set_clock c2 s)) as [u4 e4] eqn:E4.
  apply (expire_fires cfg _ _ _ _ _ _ (at_input cfg tr s c2 Tick R) (le_n _)) in E4.
  destruct (fires_one _ _ _ _ _ E4 _ _ F) as [-> ->]. rewrite A. eexists. split; [reflexivity|].
  now rewrite app_assoc, !map_app, U, !map_app.
Qed.

(** The state after some inputs and all their decisions. *)
Fixpoint answers (cfg : config) (s : state) (ins : list input) : state * list decision :=
  match ins with
  | [] => (s, [])
  | i :: rest => let (s1, ds1) := step cfg s i in let (s2, ds2) := answers cfg s1 rest in (s2, ds1 ++ ds2)
  end.
Lemma ticks_change_nothing cfg a b : ticked a b ->
  fst (answers cfg initial a) = fst (answers cfg initial b) /\
  map unstamped (snd (answers cfg initial a)) = map unstamped (snd (answers cfg initial b)).
Proof.
  intros T. assert (X : forall tr s, reach cfg tr s None -> fst (answers cfg s a) = fst (answers cfg s b) /\
    map unstamped (snd (answers cfg s a)) = map unstamped (snd (answers cfg s b))).
  2:{ exact (X [] initial (at_start cfg)). }
  induction T as [|i a b T IH|n i a b T IH L]; intros tr s R; auto.
  - cbn. destruct (step cfg s i) as [s1 ds1] eqn:S. destruct (IH _ s1 (proj1 (step_reach _ _ _ _ _ _ R S))) as [E1
      E2].
    destruct (answers cfg s1 a), (answers cfg s1 b). cbn in *. rewrite !map_app, E2. auto.
  - destruct (IH tr s R) as [-> ->]. cbn. destruct (step cfg s {| at_ := n; what := Tick |}) as [s1 ds1] eqn:S1.
    destruct (step cfg s1 i) as [s2 ds2] eqn:S2. destruct i as [c body].
    destruct (one_tick cfg tr s n c body s1 ds1 s2 ds2 R L S1 S2) as (ds & -> & U).
    destruct (answers cfg s2 b). cbn. split; auto. now rewrite app_assoc, !map_app, U, !map_app.
Qed.

Lemma decisions_of_run cfg ins : forall s tr,
  fst (run cfg s tr ins) = fst (answers cfg s ins) /\
  decisions (snd (run cfg s tr ins)) = rev (snd (answers cfg s ins)) ++ decisions tr.
Proof.
  induction ins as [|i ins IH]; intros s tr; cbn; auto. destruct (step cfg s i) as [s1 ds1].
  destruct (IH s1 (after ds1 (Got (N.max (clock s) (at_ i)) (what i) :: tr))) as [E1 E2]. rewrite E1, E2.
  destruct (answers cfg s1 ins) as [s2 ds2]. cbn. split; auto.
  rewrite rev_app_distr, <- app_assoc. f_equal. unfold after, decisions. rewrite flat_map_app. cbn. f_equal.
  clear E1 E2. induction ds1 as [|d ds1 IHd]; auto. cbn [map rev]. rewrite flat_map_app, IHd. reflexivity.
Qed.
(* ANCHOR: ticks *)
(** However many ticks come between inputs, all decisions but their [at], and the state in the end, are the same. *)
Theorem p10_ticks cfg a b : ticked a b -> state_after cfg a = state_after cfg b /\
  map unstamped (decisions (trace_of cfg a)) = map unstamped (decisions (trace_of cfg b)).
(* ANCHOR_END: ticks *)
Proof.
  intros T. unfold state_after, trace_of. destruct (ticks_change_nothing cfg a b T) as [E1 E2].
  destruct (decisions_of_run cfg a initial []) as [-> ->], (decisions_of_run cfg b initial []) as [-> ->].
  split; auto. now rewrite !map_app, !map_rev, E2.
Qed.

Lemma registered_order a b p : Permutation a b -> NoDup (map priority a) ->
  find (fun c => priority c =? p) a = find (fun c => priority c =? p) b.
Proof.
  induction 1 as [|x a b P IH|x y a|a b c P IH Q IH2]; cbn; intros D; auto.
  - inversion D; subst. destruct (priority x =? p); auto.
  - destruct (N.eqb_spec (priority x) p), (N.eqb_spec (priority y) p); auto.
    inversion D as [|? ? F]; subst. elim F. cbn. left. congruence.
  - rewrite IH by auto. apply IH2. eapply Permutation_NoDup; [|exact D]. now apply Permutation_map.
Qed.
(* ANCHOR: order *)
(** The order of the clouds in the configuration decides nothing. *)
Theorem p10_order cfg other s i : window cfg = window other -> rule cfg = rule other ->
  Permutation (clouds cfg) (clouds other) -> NoDup (map priority (clouds cfg)) -> step cfg s i = step other s i.
(* ANCHOR_END: order *)
Proof.
  intros W E P D. assert (C : forall p, registered cfg p = registered other p) by (intros p;
    now apply registered_order).
  assert (Pr : is_progressive cfg = is_progressive other) by (unfold is_progressive; now rewrite E).
  assert (Eg : is_eager cfg = is_eager other) by (unfold is_eager; now rewrite E).
  assert (Pt : is_patient cfg = is_patient other) by (unfold is_patient; now rewrite E).
  assert (K : forall p, is_cloud cfg p = is_cloud other p) by (intros p; unfold is_cloud; now rewrite C).
  assert (S : forall now t x sl, settle cfg now t x sl = settle other now t x sl) by (intros; unfold settle;
    now rewrite Pr, Eg).
  assert (X : forall n u, expire n cfg u = expire n other u).
  { induction n as [|n IH]; intros u; cbn [expire]; auto. destruct (earliest _) as [[d t]|]; auto.
    unfold fire. rewrite S. destruct (d <=? clock u); auto. destruct (update _ _ _). now rewrite IH. }
  assert (A : forall u b, apply cfg u b = apply other u b).
  { intros u b. destruct b; cbn [apply]; auto.
    - unfold open, f1_reasons. now rewrite W.
    - unfold offer, f2_reasons, gate_shut. now rewrite K, C.
    - unfold arrive, f3_reasons, result, hold. now rewrite K, Pr, Pt.
    - unfold arrive, f3_reasons, fail. rewrite K, Pr, S. reflexivity. }
  unfold step. rewrite X. destruct (expire _ other _). now rewrite A.
Qed.
