(** * T1 of a run: where local's result came and all due instants are past, an output is there

    So the machine's half of Deadline.v, of what came in alone, gives the vehicle's half its hypothesis. *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Lines Promises Deadline.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(* ANCHOR: came *)
(** Local failed, or its own deadline was over before its result came. *)
Definition gives_up (t : N) (d : decision) : Prop :=
  match d with Timer _ u 0 | Failed _ u 0 => u = t | _ => False end.
(** Local's result came when its timestamp had been opened, in a run so far. *)
Definition local_came (ins : list input) (t : N) (cfg : config) : Prop := exists before i rest,
  ins = before ++ i :: rest /\ what i = Result t 0 /\ says (trace_of cfg before) (opens t).
(* ANCHOR_END: came *)
Lemma closed_without_output cfg tr s t sl : good cfg tr s -> lookup t (opened s) = Some sl -> cached sl = [] ->
  ~ In 0 (pending sl) -> says tr (gives_up t).
Proof.
  intros G L C P. assert (T := g_traced _ _ _ G t sl L). assert (O := g_slot _ _ _ G t sl L).
  assert (Got_ : forall q, ~ says tr (accepts t q)).
  { intros q A. apply (a_got _ _ _ _ T) in A as (c & I & _). rewrite C in I. contradiction. }
  assert (D : forall d, {gives_up t d} + {~ gives_up t d}).
  { intros d. destruct d as [? ? ?|? u [|q]|? u [|q]| | | | | | | |]; cbn; auto; apply N.eq_dec. }
  destruct (says_dec tr (gives_up t) D) as [|N]; auto. exfalso. apply P. apply (a_pending _ _ _ _ T).
  split; [apply (ok_zero _ _ O)|]. intros (d & I & H).
  destruct d as [? ? ?|n u q|n u q| | |n u q| |n u q| | |]; cbn in H; try contradiction.
  - destruct H as [-> ->]. apply N. exists (Failed n t 0). split; auto. reflexivity.
  - destruct H as [-> ->]. apply N. exists (Timer n t 0). split; auto. reflexivity.
  - destruct H as [-> ->]. apply (Got_ 0). exists (Hold n t 0). split; auto. left. cbn. auto.
  - destruct H as [-> _]. apply (Got_ q). exists (Emit n t q). split; auto. right. cbn. auto.
Qed.
Lemma missed_given_up cfg tr s cur t : reach cfg tr s cur -> says tr (fun d => exists now, d = Miss now t) -> says tr (gives_up t).
Proof.
  intros R. induction R as [|tr s n b R IH|tr s b due u s' ds R IH E L U|tr s b s' ds R IH AR U]; intros M.
  - destruct M as (d & [] & _).
  - apply says_got, IH. exact (proj1 (says_got _ _ _ _) M).
  - apply says_after in M as [(d & I & now & ->)|M]; [|apply says_after; right; now apply IH].
    assert (G := reach_good _ _ _ _ R). destruct (due_lookup _ _ _ _ _ G E) as (sl & q & Lk & _).
    rewrite (slot_of_open _ _ _ Lk) in U. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
    injection U as _ <-. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (x & [=] & _)|].
    apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & C & P)|[(_ & _ & _ & m & -> & _)|(_ & m & X & _)]]].
    + contradiction.
    + destruct I as [[= <- <-]|[]]. apply says_after.
      destruct (in_dec N.eq_dec 0 (fired due sl)) as [F|F].
      * left. exists (Timer (clock s) u 0). split; [apply in_or_app; left; apply in_map_iff; eauto|reflexivity].
      * right. apply (closed_without_output cfg tr s u sl G Lk C). intros Z.
        assert (K : In 0 (pending (close (fired due sl) sl))).
        { apply filter_In. split; auto. apply negb_true_iff. now apply mem_not. }
        rewrite P in K. contradiction.
    + destruct I as [[=]|[]].
    + injection X as _ ->. destruct I as [[=]|I]. apply in_map_iff in I as (x & [=] & _).
  - apply says_after in M as [(d & I & now & ->)|M]; [|apply says_after; right; now apply IH].
    assert (G := reach_good _ _ _ _ R). assert (O := apply_own cfg s b). rewrite U in O. cbn in O.
    destruct b as [v d|v q d bl|v q|v q|]; cbn in O.
    + destruct O as [->|(w & ->)]; destruct I as [[=]|[]].
    + destruct O as [->|(w & ->)]; destruct I as [[=]|[]].
    + destruct O as [(w & ->)|[(-> & NP)|(cs & last & -> & K)]]; [destruct I as [[=]|[]]|destruct I as [[=]|[]]|].
      destruct I as [[=]|I]. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (x & [=] & _)|].
      destruct K as [->|(_ & ->)]; [contradiction|destruct I as [[=]|[]]].
    + cbn [apply] in U. unfold arrive in U. destruct (first_reason _) eqn:F; [injection U as _ <-; destruct I as [[=]|[]]|].
      apply f3_none in F as (sl & Lk & _). rewrite (slot_of_open _ _ _ Lk) in U. unfold update, fail in U.
      destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as _ <-. cbn [snd] in *. apply says_after.
      destruct I as [[=]|I].
      apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & C & P)|[(_ & _ & _ & m & -> & _)|(_ & m & X & _)]]].
      * contradiction.
      * destruct I as [[= <- <-]|[]]. destruct (N.eq_dec q 0) as [->|Z].
        -- left. exists (Failed (clock s) v 0). split; [cbn; auto|reflexivity].
        -- right. apply (closed_without_output cfg tr s v sl G Lk C). intros Y.
           assert (K : In 0 (pending (close [q] sl))).
           { apply filter_In. split; auto. apply negb_true_iff, mem_not. intros [X|[]]. contradiction. }
           rewrite P in K. contradiction.
      * destruct I as [[=]|[]].
      * injection X as _ ->. destruct I as [[=]|I]. apply in_map_iff in I as (x & [=] & _).
    + subst. contradiction.
Qed.
Lemma runs_on cfg a b X : says (trace_of cfg a) X -> says (trace_of cfg (a ++ b)) X.
Proof.
  unfold trace_of. rewrite run_app. destruct (run cfg initial [] a) as [s tr]. cbn [snd]. revert s tr.
  induction b as [|i b IH]; intros s tr H; cbn; auto. destruct (step cfg s i) as [s1 ds]. apply IH.
  apply says_after. right. now apply says_got.
Qed.
(** Where local's result came and local was not given up, it was accepted, or an output was there. *)
Lemma came_accepted cfg ins t : local_came ins t cfg -> ~ says (trace_of cfg ins) (gives_up t) ->
  says (trace_of cfg ins) (accepts t 0) \/ exists m, says (trace_of cfg ins) (emits t m).
Proof.
  intros (before & i & rest & -> & W & O) NG. rewrite (app_assoc before [i] rest : before ++ i :: rest = _) in *.
  assert (NG1 : ~ says (trace_of cfg (before ++ [i])) (gives_up t)) by (intros H; now apply NG, runs_on).
  enough (says (trace_of cfg (before ++ [i])) (accepts t 0) \/ exists m, says (trace_of cfg (before ++ [i])) (emits t m))
    as [A|(m & E)] by (try (left; now apply runs_on); right; exists m; now apply runs_on).
  assert (O1 := runs_on cfg before [i] _ O). set (tr := trace_of cfg (before ++ [i])) in *.
  destruct (p11_accounted cfg (state_after cfg before) i) as (of_due & of_input & S & _ & Own). rewrite W in Own.
  assert (In_ : forall d, In d of_input -> In (Did d) tr).
  { intros d I. unfold tr, trace_of, state_after in *. rewrite run_app. destruct (run cfg initial [] before) as [s x].
    cbn [fst snd run] in *. destruct (step cfg s i) as [s1 ds]. cbn [snd] in *. subst ds. unfold after.
    apply in_or_app. left. apply -> in_rev. apply in_map. apply in_or_app. auto. }
  destruct Own as [(why & E)|[(E & _)|(cs & last & E & _)]].
  - set (now := N.max (clock (state_after cfg before)) (at_ i)) in *.
    assert (Ex : exists x, tr = after [Drop now t 0 why] x).
    { eexists. unfold tr. rewrite trace_snoc, S, E, after_app. reflexivity. }
    destruct Ex as (x & Ex). assert (New : forall X, says x X -> says tr X) by (intros X H; rewrite Ex; apply says_after; auto).
    assert (Ox : says x (opens t)) by (rewrite Ex in O1; apply says_after in O1 as [(d & [<-|[]] & [])|O1]; exact O1).
    destruct (f3_arrival cfg (before ++ [i]) [] (Drop now t 0 why) x Ex) as [_ An]. cbn in An.
    destruct An as [[[[Z _]|U] _]|[_ [[M _]|[_ [[U _]|[_ [[U _]|[_ [[U _]|[_ [=]]]]]]]]]]].
    + contradiction.
    + elim (U t); [apply N.le_refl|exact Ox].
    + destruct M as [M|[M|(_ & q & _ & M)]]; [contradiction| |right; exists q; auto]. right.
      apply New in M. destruct M as (d & I & M). destruct d as [| | | | | | |n u q|n u q|n u|]; cbn in M; try contradiction.
      * destruct M as [-> _]. exists q, (Emit n t q). split; [exact I|cbn; auto].
      * subst u. assert (In (Ended q) (endings t tr)) as J.
        { apply in_flat_map. exists (Did (Final n t q)). split; auto. cbn. rewrite N.eqb_refl. now left. }
        destruct (is_progressive cfg) eqn:Pr.
        -- destruct (p1_progressive cfg (before ++ [i]) t Pr) as [(ps & K & _)|[K|(p & ps & K & _)]]; fold tr in K;
             rewrite K in J.
           ++ apply in_map_iff in J as (y & [=] & _).
           ++ destruct J as [[=]|[]].
           ++ exists p. apply sent_in. fold tr. rewrite K. cbn. auto.
        -- destruct (p1_once cfg (before ++ [i]) t Pr) as [K|[K|(p & K)]]; fold tr in K; rewrite K in J;
             [contradiction|destruct J as [[=]|[]]|destruct J as [[=]|[]]].
      * subst u. elim NG1. eapply missed_given_up; [exact (proj1 (run_reach cfg (before ++ [i])))|].
        exists (Miss n t). split; eauto.
    + elim U. now left.
    + left. now apply New.
    + elim NG1. apply New in U as (d & I & H). exists d. split; auto.
      destruct d as [|n u q|n u q| | | | | | | |]; cbn in H; try contradiction; destruct H as [-> ->]; reflexivity.
  - left. exists (Hold (N.max (clock (state_after cfg before)) (at_ i)) t 0). split; [apply In_; rewrite E; now left|].
    left. cbn. auto.
  - right. exists 0, (Emit (N.max (clock (state_after cfg before)) (at_ i)) t 0). split; [apply In_; rewrite E; now left|].
    cbn. auto.
Qed.
(* ANCHOR: T1 *)
(** T1 of a run, of which [by_then now] came in up to the first input at or after [now]: each frame that local takes has its
    timestamp opened, its result comes by [local_at], and its requests are due no later. Whenever local alone has the row
    of reports at which the vehicle brakes, the outputs have it. *)
Theorem t1_of_a_run cfg (by_then : N -> list input) (takes : N -> Prop) (local_at : N -> N)
    (local_reports reports : N -> Prop) (needed : nat) :
  let tr now := trace_of cfg (by_then now) in
  (forall now, now <= clock_of (tr now)) ->
  (forall k now, takes k -> local_at k <= now -> local_came (by_then now) k cfg) ->
  (forall k now, takes k -> ~ says (tr now) (gives_up k)) ->
  (forall k now p due, takes k -> p <> 0 -> says (tr now) (arms k p due) -> due <= local_at k) ->
  (forall k, takes k -> local_reports k -> reports k) ->
  (forall i k, takes i -> takes k -> i <= k -> local_at i <= local_at k) ->
  forall now, alone_brakes takes local_at local_reports needed now ->
    fusion_brakes takes (fun k n => exists m, says (tr n) (emits k m)) reports needed now.
(* ANCHOR_END: T1 *)
Proof.
  intros tr Time Came Kept Due As_local In_order. eapply t1_no_later_than_local; eauto.
  intros k now T L. destruct (came_accepted cfg (by_then now) k (Came k now T L) (Kept k now T)) as [A|E]; auto.
  apply (output_with_local cfg (by_then now) k A). intros p due Z I. specialize (Due k now p due T Z I).
  specialize (Time now). unfold tr in Time. lia.
Qed.
