(** * P9 bounded and P11 accounted *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** P9, the window; what an input costs is the implementation's affair and not spoken of here *)
(* ANCHOR: window *)
Definition fits_window (cfg : config) (s : state) : Prop := N.of_nat (length (opened s)) <= window cfg.
(* ANCHOR_END: window *)
Lemma update_window cfg s s0 t o : opened s0 = opened s -> fits_window cfg s -> fits_window cfg (fst (update s0 t o)).
Proof.
  unfold fits_window, update. cbn. intros ->. assert (X := replace_length t (fst o) (opened s)). lia.
Qed.
Lemma apply_window cfg s b : fits_window cfg s -> fits_window cfg (fst (apply cfg s b)).
Proof.
  intros W. destruct b as [t d|t p d bl|t p|t p|]; cbn [apply]; auto.
  - unfold open. destruct (first_reason _) eqn:F; auto. cbn in F. destruct (reached s t); [discriminate|].
    destruct (N.leb_spec (window cfg) (N.of_nat (length (opened s)))); [discriminate|].
    unfold fits_window. cbn. rewrite app_length. cbn. lia.
  - unfold offer. destruct (first_reason _); auto. destruct (gate_shut cfg s p bl); auto.
    now apply (update_window cfg s).
  - unfold arrive. destruct (first_reason _); auto. now apply (update_window cfg s).
  - unfold arrive. destruct (first_reason _); auto. now apply (update_window cfg s).
Qed.
(* ANCHOR: P9 *)
(** At most [window] timestamps are open. *)
Theorem p9_window cfg ins : fits_window cfg (state_after cfg ins).
(* ANCHOR_END: P9 *)
Proof.
  destruct (run_reach cfg ins) as [R _]. induction R as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R
    IH A U]; auto.
  - unfold fits_window. cbn. lia.
  - change s' with (fst (s', ds)). rewrite <- U. now apply (update_window cfg s).
  - change s' with (fst (s', ds)). rewrite <- U. now apply apply_window.
Qed.

(** ** P11 *)

Lemma apply_own cfg s b : own cfg (clock s) b (snd (apply cfg s b)).
Proof.
  destruct b as [t d|t p d bl|t p|t p|]; cbn [apply own]; auto.
  - unfold open. destruct (first_reason _); cbn; eauto.
  - unfold offer. destruct (first_reason _); cbn; eauto. destruct (gate_shut cfg s p bl); cbn; eauto.
  - unfold arrive. destruct (first_reason _); cbn; eauto. right. unfold result.
    destruct (is_progressive cfg) eqn:Pr; [|destruct (any_above p _); cbn; auto].
    + right. unfold improve. eexists. destruct (filter (N.ltb p) _); cbn; [exists [Final (clock s) t p]; auto|].
      exists []. rewrite app_nil_r. auto.
    + right. eexists. exists []. rewrite app_nil_r. auto.
  - unfold arrive. destruct (first_reason _); cbn; eauto. right. unfold fail.
    destruct (settle _ _ _ _ _) as [o e] eqn:Se. cbn.
    exists e. split; auto. apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & Pr & m & ->
      & _)|(NP & m & E & _)]]]; auto.
    + right. right. left. eauto.
    + injection E as _ ->. right. right. right. split; auto. eexists. eauto.
Qed.
Lemma expire_of_timers cfg n : forall s s' ds, expire n cfg s = (s', ds) -> Forall of_timers ds.
Proof.
  induction n as [|n IH]; intros s s' ds; cbn [expire]; [intros [= _ <-]; constructor|].
  destruct (earliest _) as [[due t]|]; [|intros [= _ <-]; constructor].
  destruct (due <=? clock s); [|intros [= _ <-]; constructor].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire n cfg s1) as [s2 ds2] eqn:E. intros [= _ <-].
  apply Forall_app. split; [|eapply IH; eauto]. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
  injection U as _ <-. cbn. apply Forall_app. split.
  - apply Forall_forall. intros d I. apply in_map_iff in I as (q & <- & _). exact I.
  - apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & ->
      & _)|(_ & m & X & _)]]]; repeat constructor.
    injection X as _ ->. constructor; [exact I|]. apply Forall_forall. intros d J.
    apply in_map_iff in J as (q & <- & _). exact I.
Qed.
(* ANCHOR: accounted *)
(** Each input has exactly the decisions that its kind may have: an open is accepted or refused, an offer admitted or
    refused, a result forwarded, held (not under progressive) or dropped, a failure accepted or dropped,
      for a reason. *)
Theorem p11_accounted cfg s i : exists of_due of_input, snd (step cfg s i) = of_due ++ of_input /\
  Forall of_timers of_due /\ own cfg (N.max (clock s) (at_ i)) (what i) of_input.
(* ANCHOR_END: accounted *)
Proof.
  unfold step. destruct (expire _ _ _) as [s1 ds1] eqn:E. destruct (apply cfg s1 (what i)) as [s2 ds2] eqn:A. cbn.
  exists ds1, ds2. split; auto. split; [eapply expire_of_timers; eauto|].
  assert (C : clock s1 = N.max (clock s) (at_ i)).
  { clear A. revert E. change (N.max (clock s) (at_ i)) with (clock (set_clock (at_ i) s)).
    generalize (length (timers (opened (set_clock (at_ i) s)))). intros n. generalize (set_clock (at_ i) s).
    revert s1 ds1. induction n as [|n IH]; intros s1 ds1 s0; cbn [expire]; [now intros [= <- _]|].
    destruct (earliest _) as [[due t]|]; [|now intros [= <- _]]. destruct (due <=? clock s0); [|now intros [= <- _]].
    destruct (update _ _ _) as [s4 ds4] eqn:U. destruct (expire n cfg s4) as [s3 ds3] eqn:X. intros [= <- _].
    apply IH in X. rewrite X. unfold update in U. injection U as <- _. reflexivity. }
  rewrite <- C. change ds2 with (snd (s2, ds2)). rewrite <- A. apply apply_own.
Qed.
Lemma run_app cfg a b : forall s tr, run cfg s tr (a ++ b) = let (s1, tr1) := run cfg s tr a in run cfg s1 tr1 b.
Proof.
  induction a as [|i a IH]; intros s tr; cbn; auto. destruct (step cfg s i) as [s1 ds]. apply IH.
Qed.

(** One more input, and the trace until it. *)
Lemma trace_snoc cfg ins i : trace_of cfg (ins ++ [i]) =
  after (snd (step cfg (state_after cfg ins) i))
    (Got (N.max (clock (state_after cfg ins)) (at_ i)) (what i) :: trace_of cfg ins).
Proof.
  unfold trace_of, state_after. rewrite run_app. destruct (run cfg initial [] ins) as [s tr]. cbn.
  destruct (step cfg s i). reflexivity.
Qed.

(** ** Each decision bears the instant of its input *)
Lemma settle_instant cfg now t timer sl o ds : settle cfg now t timer sl = (o, ds) -> forall d, In d ds ->
  instant_of d = now.
Proof.
  intros H d I. apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & E & _)]]].
  - contradiction.
  - destruct I as [<-|[]]. reflexivity.
  - destruct I as [<-|[]]. reflexivity.
  - injection E as _ ->. destruct I as [<-|I]; [reflexivity|]. apply in_map_iff in I as (q & <- & _). reflexivity.
Qed.
Lemma own_instant cfg now b ds : own cfg now b ds -> forall d, In d ds -> instant_of d = now.
Proof.
  assert (C : forall t cs d, In d (map (Cancel now t) cs) -> instant_of d = now).
  { intros t cs d I. apply in_map_iff in I as (q & <- & _). reflexivity. }
  destruct b as [t d0|t p d0 bl|t p|t p|]; cbn.
  - intros [->|(w & ->)] d [<-|[]]; reflexivity.
  - intros [->|(w & ->)] d [<-|[]]; reflexivity.
  - intros [(w & ->)|[(-> & _)|(cs & last & -> & K)]] d I; [destruct I as [<-|[]]; reflexivity..|].
    destruct I as [<-|I]; [reflexivity|]. apply in_app_or in I as [I|I]; [eapply C; eauto|].
    destruct K as [->|(_ & ->)]; [contradiction|]. destruct I as [<-|[]]. reflexivity.
  - intros [(w & ->)|(last & -> & K)] d I; [destruct I as [<-|[]]; reflexivity|].
    destruct I as [<-|I]; [reflexivity|].
    destruct K as [->|[->|[(_ & m & ->)|(_ & m & cs & ->)]]]; [contradiction|destruct I as [<-|[]]; reflexivity..|].
    destruct I as [<-|I]; [reflexivity|]. eapply C; eauto.
  - intros -> d [].
Qed.
