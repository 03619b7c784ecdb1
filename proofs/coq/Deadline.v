(** * T1: no later than local

    SPEC.md has the conditions, and the book's chapter of safe deadlines the proof in prose. The machine's half is about the
    trace of any run; the vehicle's half is about frames, and takes the machine's as a hypothesis. *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Promises.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.

(** ** The machine's half: local goes at once *)
Lemma reach_at_once cfg tr s cur : reach cfg tr s cur -> Local_goes_at_once tr.
Proof.
  intros R. induction R as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH AR U]; intros now u I.
  - contradiction.
  - destruct I as [[=]|I]. destruct (IH now u I) as (p & e & Z & A & Le). exists p, e. now rewrite says_got.
  - unfold after in I. apply in_app_or in I as [I|I].
    2:{ destruct (IH now u I) as (p & e & Z & A & Le). exists p, e. rewrite says_after. auto. }
    apply in_rev, in_map_iff in I as (d & [= ->] & I). exfalso. unfold update, fire in U.
    destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as _ <-.
    apply in_app_or in I as [I|I]; [apply in_map_iff in I as (x & [=] & _)|].
    apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & X & _)]]].
    + contradiction.
    + destruct I as [[=]|[]].
    + destruct I as [[=]|[]].
    + injection X as _ ->. destruct I as [[=]|I]. apply in_map_iff in I as (q & [=] & _).
  - unfold after in I. apply in_app_or in I as [I|I].
    2:{ destruct (IH now u I) as (p & e & Z & A & Le). exists p, e. rewrite says_after. auto. }
    apply in_rev, in_map_iff in I as (d & [= ->] & I).
    assert (G := reach_good _ _ _ _ R). assert (O := apply_own cfg s b). rewrite U in O. cbn in O.
    destruct b as [t d|t q d bl|t q|t q|]; cbn in O.
    + destruct O as [->|(w & ->)]; destruct I as [[=]|[]].
    + destruct O as [->|(w & ->)]; destruct I as [[=]|[]].
    + destruct O as [(w & ->)|[(-> & NP)|(cs & last & -> & K)]]; [destruct I as [[=]|[]]| |].
      * destruct I as [[= <- <- ->]|[]]. cbn [apply] in U. unfold arrive in U.
        destruct (first_reason _) eqn:F; [discriminate|]. apply f3_none in F as (sl & Lk & P & _).
        rewrite (slot_of_open _ _ _ Lk) in U. unfold result in U. rewrite NP in U.
        destruct (any_above 0 (pending sl)) eqn:A; [|discriminate]. apply above_iff in A as (x & X & Lx).
        destruct (ok_timer _ _ (g_slot _ _ _ G t sl Lk) x X) as (due & Ar); [lia|].
        exists x, due. split; [lia|]. split; [|exact (AR t sl x due Lk Ar)].
        apply says_after. right. now apply (a_armed _ _ _ _ (g_traced _ _ _ G t sl Lk)).
      * destruct I as [[=]|I]. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (x & [=] & _)|].
        destruct K as [->|(_ & ->)]; [contradiction|destruct I as [[=]|[]]].
    + destruct O as [(w & ->)|(last & -> & K)]; [destruct I as [[=]|[]]|]. destruct I as [[=]|I].
      destruct K as [->|[->|[(_ & m & ->)|(_ & m & cs & ->)]]];
        [contradiction|destruct I as [[=]|[]]|destruct I as [[=]|[]]|].
      destruct I as [[=]|I]. apply in_map_iff in I as (x & [=] & _).
    + subst. contradiction.
Qed.
Theorem local_goes_at_once cfg ins : Local_goes_at_once (trace_of cfg ins).
Proof. exact (reach_at_once _ _ _ _ (proj1 (run_reach cfg ins))). Qed.
(** So where local's result is accepted when all due instants of its timestamp are past, an output is there. *)
Theorem output_with_local cfg ins t : let tr := trace_of cfg ins in says tr (accepts t 0) ->
  (forall p due, p <> 0 -> says tr (arms t p due) -> due <= clock_of tr) -> exists m, says tr (emits t m).
Proof. exact (p5_local_floor cfg ins t 0). Qed.

(** ** T1: the vehicle's half *)
Section T1.
(** Frames are numbered. Local takes some, has its result at an instant, and reports the obstacle or does not. *)
Variables (takes : N -> Prop) (local_at : N -> N) (local_reports : N -> Prop).
(** Fusion: by an instant an output for a frame was sent, and it reports the obstacle or does not. *)
Variables (sent_by : N -> N -> Prop) (reports : N -> Prop).
(** How many reports in a row make the vehicle brake. *)
Variable needed : nat.

(** A row by [now]: so many frames, each with an output that reports, and no frame between them that [breaks]. *)
Definition row (out : N -> N -> Prop) (rep breaks : N -> Prop) (now : N) : Prop := exists frames,
  NoDup frames /\ length frames = needed /\ (forall k, In k frames -> out k now /\ rep k) /\
  forall i j k, In i frames -> In j frames -> i <= k <= j -> out k now -> breaks k -> rep k.
Definition alone (k now : N) : Prop := takes k /\ local_at k <= now.
(** Only a frame that local takes breaks a row. *)
Definition alone_brakes := row alone local_reports takes.
Definition fusion_brakes := row sent_by reports takes.

(** The machine's half: with a deadline of at most local's least response, fusion's output is no later than local's.
    *)
Hypothesis no_later : forall k now, takes k -> local_at k <= now -> sent_by k now.
(** The cloud reports whatever local would report, on each frame that local takes. *)
Hypothesis as_local : forall k, takes k -> local_reports k -> reports k.
(** Local has its results in the order of the frames. *)
Hypothesis in_order : forall i k, takes i -> takes k -> i <= k -> local_at i <= local_at k.

(* ANCHOR: T1 *)
(** T1: whenever local alone has the row at which it brakes, fusion has it. *)
Theorem t1_no_later_than_local now : alone_brakes now -> fusion_brakes now.
(* ANCHOR_END: T1 *)
Proof.
  intros (frames & D & L & O & B). exists frames. repeat split; auto.
  - destruct (O k H) as [[T A] _]. now apply no_later.
  - destruct (O k H) as [[T A] Rp]. now apply as_local.
  - intros i j k I J K _ T. apply as_local; auto. apply (B i j k); auto.
    destruct (O j J) as [[Tj Aj] _]. split; auto. specialize (in_order k j T Tj). lia.
Qed.
End T1.

(** The condition on rows is needed: local takes frames 0, 2 and 4 and reports on each; on frame 3 a lorry hides the
    obstacle, and the cloud's honest output breaks the row, if any output may. *)
Definition even_takes (k : N) : Prop := k = 0 \/ k = 2 \/ k = 4.
Definition any_sent (k now : N) : Prop := k <= 4 /\ k <= now.
Example t1_no_later_than_local_happens : row 3 any_sent (fun k => k <> 3 /\ k <> 1) even_takes 4.
Proof.
  exists [0; 2; 4]. split; [repeat constructor; cbn; intuition discriminate|]. split; [reflexivity|]. split.
  - intros k I. unfold any_sent. cbn in I. intuition (subst; lia).
  - unfold even_takes. intros i j k _ _ _ _ T. lia.
Qed.
Example t1_no_later_than_local_can_break :
  row 3 (alone even_takes (fun k => k)) even_takes even_takes 4 /\
  (forall k now, even_takes k -> k <= now -> any_sent k now) /\
  ~ row 3 any_sent (fun k => k <> 3 /\ k <> 1) (fun _ => True) 4.
Proof.
  split; [|split].
  - exists [0; 2; 4]. split; [repeat constructor; cbn; intuition discriminate|]. split; [reflexivity|]. split.
    + intros k I. unfold alone, even_takes. cbn in I. intuition (subst; lia).
    + intros i j k _ _ _ _ T. exact T.
  - unfold any_sent, even_takes. intros k now T L. lia.
  - intros (frames & D & L & O & B).
    assert (Three : ~ In 3 frames /\ ~ In 1 frames) by (split; intros I; destruct (O _ I) as [_ [? ?]]; congruence).
    assert (Only : incl frames [0; 2; 4]).
    { intros k I. destruct (O k I) as [[A _] [N3 N1]]. cbn. destruct (N.eq_dec k 0), (N.eq_dec k 2), (N.eq_dec k 4);
        auto. lia. }
    assert (All : incl [0; 2; 4] frames) by (apply NoDup_length_incl; auto; rewrite L; auto).
    destruct (B 2 4 3) as [X _]; [apply All; cbn; auto|apply All; cbn; auto|lia|unfold any_sent;
      lia|exact I|congruence].
Qed.
