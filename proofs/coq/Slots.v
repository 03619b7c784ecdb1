(** * One timestamp: what F2 to F9 do to its sets is what their decisions say *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Rules Sets Trace.
Import ListNotations.
Open Scope N_scope.

Section Of.
Arguments after : simpl never.
Variables (cfg : config) (tr : trace) (t now : N).

Variable sl : slot.
(** What a rule makes of an open timestamp, and its decisions, fit together. *)
Record fits (o : option slot) (ds : list decision) : Prop := {
  f_about : forall d, In d ds -> about t d;
  f_kept : forall sl, o = Some sl -> slot_ok cfg sl /\ traced cfg (after ds tr) t sl;
  f_gone : o = None -> says (after ds tr) (retires cfg t) /\ done cfg (endings t (after ds tr)) /\
    forall p, says tr (accepts t p) -> exists m, says (after ds tr) (emits t m);
  f_drained : o = None -> is_progressive cfg = true -> forall q, In q (requested sl) -> says (after ds tr) (closes cfg t q);
  f_best : forall d m q, In d ds -> emits t m d -> says tr (holds t q) -> q <= m;
  f_arms : forall d p due, In d ds -> arms t p due d ->
    p <> 0 /\ ~ says tr (requests t p) /\ (forall e, In e ds -> e = d) /\ o <> None;
  f_free : forall d, In d ds -> holds t 0 d -> exists p, says tr (requests t p);
  f_held : forall d p, In d ds -> holds t p d -> o <> None /\ forall m, ~ says (after ds tr) (emits t m);
  f_open : forall d, In d ds -> ~ opens t d
}.

Hypotheses (O : slot_ok cfg sl) (T : traced cfg tr t sl).


(** Nothing came of what was not requested and outranks all outputs. *)
Lemma nothing_yet p : ~ In p (requested sl) -> (forall q, In q (cached sl) -> q < p) -> ~ says tr (closes cfg t p).
Proof.
  intros N L (d & I & C). destruct (closes_how _ _ _ _ C) as [A|(q & E & Q)].
  - apply N. apply (a_known _ _ _ _ T). exists d. auto.
  - destruct (a_got _ _ _ _ T q) as (c & IC & M); [exists d; split; auto; now right|]. specialize (L c IC). lia.
Qed.
Lemma disarmed_closed p : says tr (disarms cfg t p) -> says tr (closes cfg t p).
Proof. intros (d & I & D). exists d. split; auto. now apply disarms_closes. Qed.
Lemma one_line d0 (X : decision -> Prop) : (exists d, In d [d0] /\ X d) <-> X d0.
Proof. split; [intros (d & [<-|[]] & H); auto|]. intros H. exists d0. split; auto. now left. Qed.

(** ** F2 *)
Lemma admit_fits p due : ~ In p (requested sl) -> any_above p (cached sl) = false ->
  fits (Some (join p due sl)) [Request now t p due].
Proof.
  intros N A. rewrite above_not in A.
  assert (P0 : p <> 0) by (intros ->; apply N; apply (ok_zero _ _ O)).
  assert (NR : ~ says tr (requests t p)) by (intros X; apply N; apply (a_requested _ _ _ _ T); auto).
  assert (L : forall q, In q (cached sl) -> q < p).
  { intros q C. assert (q <> p) by (intros ->; apply N; now apply (ok_cached _ _ O)). specialize (A q C). lia. }
  assert (NC := nothing_yet p N L).
  constructor.
  - intros d [<-|[]]. reflexivity.
  - intros s [= <-]. split.
    + constructor; cbn; try setoid_rewrite add_in.
      * right. apply (ok_zero _ _ O).
      * intros q [->|I]; auto. right. now apply (ok_pending _ _ O).
      * intros q I. right. now apply (ok_cached _ _ O).
      * intros q C [->|I]; [specialize (L p C); lia|]. now apply (ok_apart _ _ O q).
      * exists p. auto.
      * intros c C. exists p. split; auto.
      * intros Pr c q C [->|Q]; auto. now apply (ok_better _ _ O).
      * intros q [->|Q] Z; [exists due; auto|]. destruct (ok_timer _ _ O q Q Z) as (e & H). exists e. auto.
      * intros q e [[= -> ->]|I]; auto. destruct (ok_armed _ _ O q e I); auto.
    + constructor; cbn; intros; rewrite ?add_in, ?says_after, ?one_line in *; cbn.
      * right. apply (a_open _ _ _ _ T).
      * rewrite (a_requested _ _ _ _ T). intuition congruence.
      * rewrite (a_pending _ _ _ _ T). split; [intros [->|[I H]]|intros [[->|I] H]]; tauto.
      * rewrite (a_cached _ _ _ _ T) by auto. tauto.
      * intros [[]|X]. now apply (a_never _ _ _ _ T H p0).
      * rewrite (a_armed _ _ _ _ T). split.
        -- intros [[= -> ->]|[I H]]; [|tauto]. split; [auto|]. intros [[]|X]. now apply NC, disarmed_closed.
        -- intros [[(_ & -> & ->)|I] H]; [now left|]. right. tauto.
      * apply (a_got _ _ _ _ T). destruct H as [[[]|[]]|H]; auto.
      * right. apply (a_known _ _ _ _ T). destruct H as [[]|H]; auto.
      * rewrite endings_after. exact (a_running _ _ _ _ T).
  - discriminate.
  - discriminate.
  - intros d m q [<-|[]] [].
  - intros d q e [<-|[]] (_ & -> & ->). split; auto. split; auto. split; [intros x [<-|[]]; reflexivity|discriminate].
  - intros d [<-|[]] [].
  - intros d q [<-|[]] [].
  - intros d [<-|[]] [].
Qed.

(** ** F3, held *)
Lemma hold_fits p : is_progressive cfg = false -> In p (pending sl) -> any_above p (pending sl) = true ->
  fits (Some (hold cfg p sl)) [Hold now t p].
Proof.
  intros NP P A. apply above_iff in A as (w & W & PW).
  assert (AP : ~ says tr (closes cfg t p)) by now apply (a_pending _ _ _ _ T).
  constructor.
  - intros d [<-|[]]. reflexivity.
  - intros s [= <-]. split.
    + constructor; cbn; try setoid_rewrite add_in; try setoid_rewrite filter_In; try setoid_rewrite negb_true_iff;
        try setoid_rewrite N.eqb_neq.
      * apply (ok_zero _ _ O).
      * intros q [Q _]. now apply (ok_pending _ _ O).
      * intros q [->|Q]; [now apply (ok_pending _ _ O)|now apply (ok_cached _ _ O)].
      * intros q [->|Q] [I N]; [congruence|]. now apply (ok_apart _ _ O q).
      * exists w. split; auto. unfold id in *. lia.
      * intros c [->|Ic]; [exists w; repeat split; auto; unfold id in *; lia|].
        destruct (ok_prompt _ _ O c Ic) as (q & Q & L). destruct (N.eq_dec q p) as [->|].
        -- exists w. repeat split; auto; lia.
        -- exists q. auto.
      * congruence.
      * intros q [Q N] Z. destruct (ok_timer _ _ O q Q Z) as (e & H). exists e.
        destruct (_ || _); auto. apply filter_In. split; auto. now apply negb_true_iff, N.eqb_neq.
      * intros q e I. destruct ((p =? 0) || is_patient cfg) eqn:D.
        -- apply filter_In in I as [I N]. apply negb_true_iff, N.eqb_neq in N. cbn in N.
           destruct (ok_armed _ _ O q e I) as [?|(? & ? & ?)]; auto.
        -- apply orb_false_iff in D as [D1 D2]. apply N.eqb_neq in D1.
           assert (E : is_eager cfg = true) by (clear - NP D2; unfold is_eager, is_patient, is_progressive in *;
             destruct (rule cfg); congruence).
           destruct (N.eq_dec q p) as [->|]; [right; auto|].
           destruct (ok_armed _ _ O q e I) as [?|(? & ? & ?)]; auto.
    + constructor; cbn; intros; rewrite ?add_in, ?filter_In, ?negb_true_iff, ?N.eqb_neq, ?says_after,
        ?one_line in *; cbn.
      * right. apply (a_open _ _ _ _ T).
      * rewrite (a_requested _ _ _ _ T). tauto.
      * rewrite (a_pending _ _ _ _ T). intuition congruence.
      * rewrite (a_cached _ _ _ _ T) by auto. intuition congruence.
      * congruence.
      * assert (D : (p =? 0) || is_patient cfg = true <-> p = 0 \/ is_patient cfg = true)
          by now rewrite orb_true_iff, N.eqb_eq.
        destruct ((p =? 0) || is_patient cfg).
        -- rewrite filter_In, negb_true_iff, N.eqb_neq, (a_armed _ _ _ _ T). cbn. split; [|intros [[[]|I] H]].
           ++ intros [[I H] N]. split; auto. intros [(_ & X & _)|X]; auto.
           ++ split; [tauto|]. intros ->. apply H. left. tauto.
        -- rewrite (a_armed _ _ _ _ T). split; [|tauto]. intros [I H]. split; auto.
           intros [(_ & -> & X)|X]; auto. apply D in X. discriminate.
      * destruct H as [[[_ ->]|[]]|H]; [exists p0; rewrite add_in; split; auto; lia|].
        destruct (a_got _ _ _ _ T _ H) as (c & Ic & L). exists c. rewrite add_in. auto.
      * destruct H as [[_ <-]|H]; [now apply (ok_pending _ _ O)|now apply (a_known _ _ _ _ T)].
      * rewrite endings_after. assert (R := a_running _ _ _ _ T). revert R. unfold running. rewrite NP. cbn. auto.
  - discriminate.
  - discriminate.
  - intros d m q [<-|[]] [].
  - intros d q e [<-|[]] [].
  - intros d [<-|[]] [_ ->]. exists w. assert (Rw := ok_pending _ _ O w W).
    apply (a_requested _ _ _ _ T) in Rw as [->|R]; [lia|exact R].
  - intros d q _ _. split; [discriminate|]. intros m E. apply says_after in E as [(d0 & [<-|[]] & [])|E].
    apply sent_in in E. assert (R := a_running _ _ _ _ T). unfold running in R. rewrite NP in R. rewrite R in E.
    contradiction.
  - intros d [<-|[]] [].
Qed.

(** ** F4 and F5: [ps] leave pending and armed *)
Definition closing (ps : list N) (ds : list decision) : Prop :=
  (forall d, In d ds -> exists p, In p ps /\ (d = Timer now t p \/ d = Failed now t p)) /\
  (forall p, In p ps -> exists d, In d ds /\ (d = Timer now t p \/ d = Failed now t p)).

Lemma closing_says ps ds (X : decision -> Prop) : closing ps ds ->
  (exists d, In d ds /\ X d) -> exists p, In p ps /\ (X (Timer now t p) \/ X (Failed now t p)).
Proof. intros [A _] (d & I & H). destruct (A d I) as (p & P & [->| ->]); eauto. Qed.
Lemma closing_ends ps ds : closing ps ds -> flat_map (end_of t) ds = [].
Proof. intros [A _]. apply no_endings. intros d I. destruct (A d I) as (p & _ & [->| ->]); reflexivity. Qed.

Lemma close_fits ps ds : closing ps ds -> (forall p, In p ps -> In p (requested sl)) ->
  (exists p, In p (pending (close ps sl))) ->
  (forall c, In c (cached sl) -> exists q, In q (pending (close ps sl)) /\ c < q) ->
  fits (Some (close ps sl)) ds.
Proof.
  intros CL RQ W PR. assert (S := fun X => closing_says ps ds X CL).
  assert (NO : forall X : decision -> Prop, (forall p, ~ X (Timer now t p) /\ ~ X (Failed now t p)) ->
    ~ exists d, In d ds /\ X d).
  { intros X H E. destruct (S X E) as (p & _ & K). destruct (H p). tauto. }
  assert (CO : forall p X, (forall q, X (Timer now t q) <-> q = p) -> (forall q, X (Failed now t q) <-> q = p) ->
    ((exists d, In d ds /\ X d) <-> In p ps)).
  { intros p X H1 H2. split.
    - intros E. destruct (S X E) as (q & Q & [H|H]); [apply H1 in H|apply H2 in H]; congruence.
    - intros I. destruct CL as [_ B]. destruct (B p I) as (d & D & [->| ->]); eexists; split; eauto;
        [now apply H1|now apply H2]. }
  constructor.
  - intros d I. destruct CL as [A _]. destruct (A d I) as (p & _ & [->| ->]); reflexivity.
  - intros s [= <-]. split.
    + constructor; cbn; try setoid_rewrite filter_In; try setoid_rewrite negb_true_iff; try setoid_rewrite mem_not.
      * apply (ok_zero _ _ O).
      * intros q [Q _]. now apply (ok_pending _ _ O).
      * apply (ok_cached _ _ O).
      * intros q C [Q _]. now apply (ok_apart _ _ O q).
      * destruct W as (p & W). cbn in W. rewrite filter_In, negb_true_iff, mem_not in W. eauto.
      * intros c C. destruct (PR c C) as (q & Q & L). cbn in Q. rewrite filter_In, negb_true_iff, mem_not in Q. eauto.
      * intros Pr c q C [Q _]. now apply (ok_better _ _ O).
      * intros q [Q N] Z. destruct (ok_timer _ _ O q Q Z) as (e & H). exists e. auto.
      * intros q e [I N]. destruct (ok_armed _ _ O q e I); auto.
    + constructor; cbn; intros; rewrite ?filter_In, ?negb_true_iff, ?mem_not, ?says_after in *; cbn.
      * right. apply (a_open _ _ _ _ T).
      * rewrite (a_requested _ _ _ _ T). specialize (NO (requests t p)). cbn in NO. tauto.
      * rewrite (a_pending _ _ _ _ T), (CO p (closes cfg t p)) by (cbn; intros; intuition congruence). tauto.
      * rewrite (a_cached _ _ _ _ T) by auto. specialize (NO (holds t p)). cbn in NO. tauto.
      * intros [X|X]; [elim (NO (holds t p)); auto|now apply (a_never _ _ _ _ T H p)].
      * rewrite (a_armed _ _ _ _ T), (CO p (disarms cfg t p)) by (cbn; intros; intuition congruence).
        specialize (NO (arms t p due)). cbn in NO. tauto.
      * apply (a_got _ _ _ _ T). destruct H as [H|H]; auto. elim (NO (accepts t p)); auto.
        unfold accepts. cbn. tauto.
      * destruct H as [H|H]; [|now apply (a_known _ _ _ _ T)]. apply RQ.
        apply (CO p (answers t p)) in H; cbn; intros; intuition congruence.
      * rewrite endings_after, (closing_ends ps ds CL). exact (a_running _ _ _ _ T).
  - discriminate.
  - discriminate.
  - intros d m q I H. elim (NO (emits t m)); eauto.
  - intros d q e I H. elim (NO (arms t q e)); eauto.
  - intros d I H. elim (NO (holds t 0)); eauto.
  - intros d q I H. elim (NO (holds t q)); eauto.
  - intros d I H. elim (NO (opens t)); eauto.
Qed.

(** ** F6, F7, F9: the endings *)
Ltac line_by_line A :=
  match goal with I : In ?d (_ ++ _) |- _ => apply in_app_or in I as [I|I];
    [destruct (A d I) as (? & _ & [->| ->])|] end.
Lemma cancels_end cs : flat_map (end_of t) (map (Cancel now t) cs) = [].
Proof. apply no_endings. intros d I. apply in_map_iff in I as (q & <- & _). reflexivity. Qed.

Lemma forward_fits ps ds m s : is_progressive cfg = false -> closing ps ds ->
  (forall q, In q (cached sl) -> q <= m) -> fits None (ds ++ snd (forward now t m s)).
Proof.
  intros NP CL B. assert (CE := closing_ends ps ds CL). destruct CL as [A _]. unfold forward. cbn [snd].
  assert (E : says (after (ds ++ Emit now t m :: map (Cancel now t) (clouds_of (pending s))) tr) (emits t m)).
  { apply says_after. left. eexists. split; [apply in_or_app; right; left; reflexivity|]. cbn. auto. }
  constructor; try discriminate.
  - intros d I. line_by_line A; try reflexivity. destruct I as [<-|I]; [reflexivity|].
    apply in_map_iff in I as (q & <- & _). reflexivity.
  - intros _. split; [|split; [|eauto]].
    + destruct E as (d & I & H). exists d. split; auto. destruct d; cbn in *; tauto.
    + assert (R := a_running _ _ _ _ T). revert R. rewrite endings_after, flat_map_app, CE. cbn.
      rewrite N.eqb_refl, cancels_end. unfold running, done. rewrite NP. cbn. intros ->. right. eauto.
  - congruence.
  - intros d k q I H Hq. line_by_line A; try contradiction. destruct I as [<-|I].
    + destruct H as [_ <-]. apply B. now apply (a_cached _ _ _ _ T NP).
    + apply in_map_iff in I as (? & <- & _). contradiction.
  - intros d q e I H. line_by_line A; try contradiction. destruct I as [<-|I]; [contradiction|].
    apply in_map_iff in I as (? & <- & _). contradiction.
  - intros d I H. line_by_line A; try contradiction. destruct I as [<-|I]; [contradiction|].
    apply in_map_iff in I as (? & <- & _). contradiction.
  - intros d q I H. line_by_line A; try contradiction. destruct I as [<-|I]; [contradiction|].
    apply in_map_iff in I as (? & <- & _). contradiction.
  - intros d I H. line_by_line A; try contradiction. destruct I as [<-|I]; [contradiction|].
    apply in_map_iff in I as (? & <- & _). contradiction.
Qed.

(** What settling comes to. *)
Lemma settle_cases timer s o e : settle cfg now t timer s = (o, e) ->
  (o = Some s /\ e = [] /\ (exists p, In p (pending s)) /\
   (is_progressive cfg = false -> forall c, In c (cached s) -> exists q, In q (pending s) /\ c < q) /\
   (is_eager cfg = true -> timer = true -> cached s = [])) \/
  (o = None /\ e = [Miss now t] /\ cached s = [] /\ pending s = []) \/
  (o = None /\ pending s = [] /\ is_progressive cfg = true /\ exists m, e = [Final now t m] /\ In m (cached s)) \/
  (is_progressive cfg = false /\ exists m, (o, e) = forward now t m s /\ greatest (cached s) = Some m).
Proof.
  unfold settle. destruct (is_progressive cfg) eqn:NP.
  - assert (NE : is_eager cfg = false) by (unfold is_eager, is_progressive in *; destruct (rule cfg); congruence).
    destruct (pending s) as [|p l] eqn:P.
    + destruct (greatest (cached s)) as [m|] eqn:G; intros [= <- <-].
      * right. right. left. repeat split; auto. exists m. split; auto. now apply greatest_some.
      * right. left. repeat split; auto. now apply greatest_none.
    + intros [= <- <-]. left. repeat split; auto; try congruence. exists p. cbn; auto.
  - destruct (greatest (cached s)) as [m|] eqn:G.
    + destruct (any_above m (pending s)) eqn:A; cbn.
      * destruct (is_eager cfg && timer) eqn:E; [intros H; right; right; right; split; auto; exists m;
          now rewrite <- H|].
        intros [= <- <-]. left. apply above_iff in A as (w & W & L). apply greatest_some in G as [_ M].
        repeat split; auto; [eauto| |intros E1 E2; rewrite E1, E2 in E; discriminate].
        intros _ c C. exists w. split; auto. specialize (M c C). lia.
      * intros H. right; right; right. split; auto. exists m. now rewrite <- H.
    + apply greatest_none in G. destruct (pending s) as [|p l] eqn:P; intros [= <- <-].
      * right. left. auto.
      * left. repeat split; auto; [exists p; cbn; auto|]. rewrite G. intros _ c [].
Qed.

(** Where nothing is pending, all that was requested was closed. *)
Lemma drained ps ds e : closing ps ds -> pending (close ps sl) = [] -> forall q, In q (requested sl) ->
  says (after (ds ++ e) tr) (closes cfg t q).
Proof.
  intros [_ CL] P q Q. apply says_after. destruct (in_dec N.eq_dec q ps) as [I|I].
  - left. destruct (CL q I) as (d & J & [->| ->]); eexists; (split; [apply in_or_app; left; exact J|cbn; auto]).
  - right. destruct (says_dec tr (closes cfg t q) (closes_dec cfg t q)) as [C|C]; auto. exfalso.
    assert (X : In q (pending (close ps sl))).
    { apply filter_In. split; [now apply (a_pending _ _ _ _ T)|]. now apply negb_true_iff, mem_not. }
    rewrite P in X. contradiction.
Qed.
Lemma settle_fits timer ps ds o e : closing ps ds -> (forall p, In p ps -> In p (requested sl)) ->
  settle cfg now t timer (close ps sl) = (o, e) -> fits o (ds ++ e).
Proof.
  intros CL RQ H. apply settle_cases in H as
    [(-> & -> & W & B & _)|[(-> & -> & K & P)|[(-> & P & Pr & m & -> & M)|(NP & m & F & G)]]].
  - rewrite app_nil_r. apply close_fits; auto. intros c Ic. destruct (is_progressive cfg) eqn:Pr; [|now apply B].
    destruct W as (p & W). exists p. split; auto. cbn in W. apply filter_In in W as [W _].
    now apply (ok_better _ _ O).
  - assert (CE := closing_ends ps ds CL). assert (Dr := fun e => drained ps ds e CL P). destruct CL as [A _]. cbn in K. constructor; try discriminate.
    + intros d I. line_by_line A; try reflexivity. destruct I as [<-|[]]; reflexivity.
    + intros _. split; [|split].
      * apply says_after. left. exists (Miss now t). split; [apply in_or_app; cbn; auto|reflexivity].
      * assert (R := a_running _ _ _ _ T). revert R. rewrite endings_after, flat_map_app, CE, K. cbn.
        rewrite N.eqb_refl.
        unfold running, done. destruct (is_progressive cfg); [|intros ->; auto].
        intros (l & -> & _ & F). destruct l; [auto|discriminate].
      * intros p X. destruct (a_got _ _ _ _ T p X) as (c & Ic & _). rewrite K in Ic. contradiction.
    + intros _ _ q Q. now apply Dr.
    + intros d k q I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d q x I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d q I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
  - assert (CE := closing_ends ps ds CL). assert (Dr := fun e => drained ps ds e CL P). destruct CL as [A _]. cbn in M.
    assert (R := a_running _ _ _ _ T). unfold running in R. rewrite Pr in R. destruct R as (l & El & Fl & Kl).
    rewrite Kl in M. destruct l as [|x l]; [contradiction|]. destruct M as [->|[]].
    assert (EM : says tr (emits t m)).
    { apply sent_in. rewrite El. now left. }
    constructor; try discriminate.
    + intros d I. line_by_line A; try reflexivity. destruct I as [<-|[]]; reflexivity.
    + intros _. split; [|split].
      * apply says_after. left. exists (Final now t m). split; [apply in_or_app; cbn; auto|reflexivity].
      * rewrite endings_after, flat_map_app, CE, El. cbn. rewrite N.eqb_refl. unfold done. rewrite Pr. right.
        exists m, l.
        auto.
      * intros p _. exists m. apply says_after. auto.
    + intros _ _ q Q. now apply Dr.
    + intros d k q I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d q x I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d q I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
    + intros d I X. line_by_line A; try contradiction. destruct I as [<-|[]]. contradiction.
  - assert (X := forward_fits ps ds m (close ps sl) NP CL). rewrite <- F in X. cbn [snd] in X.
    assert (o = None) as -> by (unfold forward in F; congruence).
    apply greatest_some in G as [_ M]. now apply X.
Qed.

Ltac final_lines I :=
  destruct I as [<-|I]; [|apply in_app_or in I as [I|[<-|[]]]; [apply in_map_iff in I as (? & <- & _)|]].
Lemma improve_fits p o ds : is_progressive cfg = true -> In p (pending sl) ->
  improve now t p sl = (o, ds) -> fits o ds.
Proof.
  intros Pr P. unfold improve. set (cs := clouds_of _).
  assert (R := a_running _ _ _ _ T). unfold running in R. rewrite Pr in R. destruct R as (l & El & Fl & Kl).
  assert (F : falling (p :: l)).
  { constructor; auto. destruct l as [|x l]; constructor.
    - apply (ok_better _ _ O Pr); auto. rewrite Kl. cbn. auto.
    - inversion Fl as [|? ? F1 F2]; subst. rewrite Forall_forall in *. intros y Y. specialize (F2 y Y).
      assert (x < p) by (apply (ok_better _ _ O Pr); auto; rewrite Kl; cbn; auto). lia. }
  assert (NH := a_never _ _ _ _ T Pr).
  assert (ST : forall X : decision -> Prop, (forall q, ~ X (Cancel now t q)) ->
    ((exists d, In d (Emit now t p :: map (Cancel now t) cs) /\ X d) <-> X (Emit now t p))).
  { intros X NX. split.
    - intros (d & [<-|I] & H); auto. apply in_map_iff in I as (q & <- & _). elim (NX q H).
    - intros H. eexists. split; [left; reflexivity|auto]. }
  destruct (filter (N.ltb p) (pending sl)) as [|b bs] eqn:B; intros [= <- <-].
  - constructor; try discriminate.
    + intros d I. final_lines I; reflexivity.
    + intros _. change (Emit now t p :: map (Cancel now t) cs ++ [Final now t p])
        with ((Emit now t p :: map (Cancel now t) cs) ++ [Final now t p]). split; [|split].
      * apply says_after. left. exists (Final now t p). split; [apply in_or_app; cbn; auto|reflexivity].
      * rewrite endings_after, flat_map_app. cbn. rewrite N.eqb_refl, cancels_end, El. unfold done. rewrite Pr. right.
        exists p, l. auto.
      * intros q _. exists p. apply says_after. left. exists (Emit now t p). cbn. auto.
    + intros _ _ q Q. apply says_after. destruct (says_dec tr (closes cfg t q) (closes_dec cfg t q)) as [C|C]; auto.
      left. exists (Emit now t p). split; [now left|]. cbn. split; auto. unfold outdone.
      destruct (N.eq_dec p q); auto. right. split; auto. apply N.nle_gt. intros Le.
      assert (X : In q (filter (N.ltb p) (pending sl))).
      { apply filter_In. split; [now apply (a_pending _ _ _ _ T)|apply N.ltb_lt; lia]. }
      rewrite B in X. contradiction.
    + intros d m q _ _ H. now apply NH in H.
    + intros d q e I H. final_lines I; contradiction.
    + intros d I H. final_lines I; contradiction.
    + intros d q I H. final_lines I; contradiction.
    + intros d I H. final_lines I; contradiction.
  - assert (BI : forall q, In q (b :: bs) <-> In q (pending sl) /\ p < q) by (intros q;
      rewrite <- B, filter_In, N.ltb_lt; tauto).
    constructor; try discriminate.
    + intros d [<-|I]; [reflexivity|]. apply in_map_iff in I as (q & <- & _). reflexivity.
    + intros s [= <-]. split.
      * constructor; cbn [requested pending cached armed]; try setoid_rewrite BI; try setoid_rewrite filter_In;
          try setoid_rewrite N.ltb_lt.
        -- apply (ok_zero _ _ O).
        -- intros q [Q _]. now apply (ok_pending _ _ O).
        -- intros q [<-|[]]. now apply (ok_pending _ _ O).
        -- intros q [<-|[]] [_ L]. lia.
        -- exists b. apply BI. now left.
        -- intros c [<-|[]]. exists b. assert (X : In b (b :: bs)) by now left. apply BI in X. tauto.
        -- intros _ c q [<-|[]] [_ L]. auto.
        -- intros q [Q L] Z. destruct (ok_timer _ _ O q Q Z) as (e & H). exists e. auto.
        -- intros q e [I L]. cbn in L. destruct (ok_armed _ _ O q e I) as [?|(? & E & _)]; auto.
           clear - Pr E. unfold is_eager, is_progressive in *. destruct (rule cfg); discriminate.
      * constructor; cbn [requested pending cached armed]; intros;
          rewrite ?BI, ?filter_In, ?N.ltb_lt, ?says_after, ?ST in * by (cbn; tauto);
            cbn [opens requests holds arms answers closes disarms emits].
        -- right. apply (a_open _ _ _ _ T).
        -- rewrite (a_requested _ _ _ _ T). tauto.
        -- rewrite (a_pending _ _ _ _ T). unfold outdone. rewrite Pr. split.
           ++ intros [[I H] L]. split; auto. intros [(_ & [E|(_ & E)])|X]; auto; lia.
           ++ intros [I H]. split; [tauto|]. apply N.nle_gt. intros L. apply H. left. split; auto.
              destruct (N.eq_dec p p0); auto. right. split; auto. lia.
        -- congruence.
        -- intros [[]|X]. now apply (NH p0).
        -- rewrite (a_armed _ _ _ _ T). cbn [fst]. unfold outdone. rewrite Pr. split.
           ++ intros [[I H] L]. split; auto. intros [(_ & [E|(_ & E)])|X]; auto; lia.
           ++ intros [[[]|I] H]. split; [tauto|]. apply N.nle_gt. intros L. apply H. left. split; auto.
              destruct (N.eq_dec p p0); auto. right. split; auto. lia.
        -- rewrite ST in H by (unfold accepts; cbn; tauto). exists p. split; [now left|].
           destruct H as [[[]|[_ <-]]|H]; [lia|].
           destruct (a_got _ _ _ _ T _ H) as (c & Ic & L). assert (c < p) by now apply (ok_better _ _ O Pr). lia.
        -- destruct H as [[_ <-]|H]; [now apply (ok_pending _ _ O)|now apply (a_known _ _ _ _ T)].
        -- rewrite endings_after. cbn. rewrite N.eqb_refl, cancels_end, El. unfold running. rewrite Pr.
           exists (p :: l). auto.
    + intros d m q _ _ H. now apply NH in H.
    + intros d q e [<-|I] H; [contradiction|]. apply in_map_iff in I as (? & <- & _). contradiction.
    + intros d [<-|I] H; [contradiction|]. apply in_map_iff in I as (? & <- & _). contradiction.
    + intros d q [<-|I] H; [contradiction|]. apply in_map_iff in I as (? & <- & _). contradiction.
    + intros d [<-|I] H; [contradiction|]. apply in_map_iff in I as (? & <- & _). contradiction.
Qed.
End Of.
