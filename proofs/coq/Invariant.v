(** * What holds after every input, and in between: the state is what the trace says *)
From Coq Require Import List NArith Bool Lia Sorted Permutation.
From Fuseline Require Import Rules Sets Trace Slots.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** Nothing of [t] is due; nothing at all is. *)
Definition rest_of (s : state) (t : N) : Prop := forall sl p due,
  lookup t (opened s) = Some sl -> In (p, due) (armed sl) -> clock s < due.
Definition at_rest (s : state) : Prop := forall t, rest_of s t.

(** The moves of a run, with the input that is under way. *)
Inductive reach (cfg : config) : trace -> state -> option body -> Prop :=
| at_start : reach cfg [] initial None
| at_input tr s n b : reach cfg tr s None -> reach cfg (Got (N.max (clock s) n) b :: tr) (set_clock n s) (Some b)
| at_firing tr s b due t s' ds : reach cfg tr s (Some b) ->
    earliest (timers (opened s)) = Some (due, t) -> due <= clock s ->
    update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> reach cfg (after ds tr) s' (Some b)
| at_apply tr s b s' ds : reach cfg tr s (Some b) -> at_rest s -> apply cfg s b = (s', ds) ->
    reach cfg (after ds tr) s' None.

Record good (cfg : config) (tr : trace) (s : state) : Prop := {
  g_nodup : NoDup (map fst (opened s));
  g_reached : forall t, In t (map fst (opened s)) -> reached s t = true;
  g_slot : forall t sl, lookup t (opened s) = Some sl -> slot_ok cfg sl;
  g_traced : forall t sl, lookup t (opened s) = Some sl -> traced cfg tr t sl;
  g_about : forall t, says tr (about t) -> reached s t = true;
  g_opened : forall t, says tr (about t) -> says tr (opens t);
  g_open : forall t, says tr (opens t) -> lookup t (opened s) <> None \/ says tr (retires cfg t);
  g_floor : forall t p, says tr (accepts t p) -> lookup t (opened s) <> None \/ exists m, says tr (emits t m);
  g_drained : forall t, is_progressive cfg = true -> says tr (opens t) -> lookup t (opened s) = None ->
    forall q, q = 0 \/ says tr (requests t q) -> says tr (closes cfg t q);
  g_best : forall t m q, says tr (emits t m) -> says tr (holds t q) -> q <= m;
  g_one : forall t p a b, says tr (arms t p a) -> says tr (arms t p b) -> a = b;
  g_free : forall t, says tr (holds t 0) -> exists p, says tr (requests t p);
  g_done : forall t, lookup t (opened s) = None -> endings t tr = [] \/ done cfg (endings t tr)
}.

(** ** Lines about one timestamp say nothing of another *)
Section Lines.
Variables (cfg : config) (tr : trace) (ds : list decision) (u : N).
Hypothesis N : forall d, In d ds -> ~ about u d.
Lemma says_other (X : decision -> Prop) : (forall d, X d -> about u d) -> (says (after ds tr) X <-> says tr X).
Proof.
  intros H. rewrite says_after. split; auto. intros [(d & I & D)|?]; auto. elim (N d I). auto.
Qed.
Lemma endings_other : endings u (after ds tr) = endings u tr.
Proof.
  rewrite endings_after, no_endings; auto. intros d I. specialize (N d I). unfold about in N.
  destruct d; cbn in *; auto; destruct (N.eqb_spec t u) as [->|]; auto; now elim N.
Qed.
Ltac about_it := intros d; destruct d; unfold about; cbn; try tauto; try (intuition congruence).
Lemma opens_about t d : opens t d -> about t d. Proof. revert d. about_it. Qed.
Lemma requests_about t p d : requests t p d -> about t d. Proof. revert d. about_it. Qed.
Lemma arms_about t p due d : arms t p due d -> about t d.
Proof. revert d. intros d; destruct d as [n v [x|]|? ? ?|? ? ?|? ? ? ?|? ? ? ?|? ? ?|? ? ? ?|? ? ?|? ? ?|? ?|? ? ?];
  unfold about; cbn; try tauto; intuition congruence. Qed.
Lemma holds_about t p d : holds t p d -> about t d. Proof. revert d. about_it. Qed.
Lemma emits_about t p d : emits t p d -> about t d. Proof. revert d. about_it. Qed.
Lemma accepts_about t p d : accepts t p d -> about t d.
Proof. intros [H|H]; [now apply holds_about in H|now apply emits_about in H]. Qed.
Lemma retires_about t d : retires cfg t d -> about t d. Proof. revert d. about_it. Qed.
Lemma closes_about t p d : closes cfg t p d -> about t d. Proof. revert d. about_it. Qed.
Lemma disarms_about t p d : disarms cfg t p d -> about t d. Proof. revert d. about_it. Qed.
Lemma answers_about t p d : answers t p d -> about t d. Proof. revert d. about_it. Qed.
Lemma told_other sl : traced cfg tr u sl -> traced cfg (after ds tr) u sl.
Proof.
  intros T. constructor; intros; rewrite ?says_other in * by
    (first [apply opens_about|apply requests_about|apply arms_about|apply holds_about|apply accepts_about
           |apply closes_about|apply disarms_about|apply answers_about]).
  - apply (a_open _ _ _ _ T).
  - apply (a_requested _ _ _ _ T).
  - apply (a_pending _ _ _ _ T).
  - now apply (a_cached _ _ _ _ T).
  - now apply (a_never _ _ _ _ T).
  - apply (a_armed _ _ _ _ T).
  - now apply (a_got _ _ _ _ T).
  - now apply (a_known _ _ _ _ T).
  - rewrite endings_other. apply (a_running _ _ _ _ T).
Qed.
End Lines.
Ltac abouts := first [apply opens_about|apply requests_about|apply arms_about|apply holds_about|apply emits_about
  |apply accepts_about|apply closes_about|apply disarms_about|apply answers_about|apply retires_about
  |(intros; assumption)].

(** ** Each move keeps it *)
Lemma good_at cfg tr s now b s' : good cfg tr s -> opened s' = opened s -> newest s' = newest s ->
  good cfg (Got now b :: tr) s'.
Proof.
  intros G Eo En. assert (Er : forall t, reached s' t = reached s t) by (intros t; unfold reached; now rewrite En).
  destruct G as [A1 A2 A3 A4 A5 A6 A7 A9 A8 A10 A11 A12 A13].
  constructor; rewrite ?Eo; intros; rewrite ?says_got, ?Er in *; eauto.
  - destruct (A4 t sl H) as [T1 T2 T3 T4 T5 T6 T7 T8 T9]. constructor; intros; rewrite ?says_got in *; eauto.
  - destruct (A9 t p H) as [?|(m & M)]; auto. right. exists m. now rewrite says_got.
  - destruct (A12 t H) as (p & P). exists p. now rewrite says_got.
Qed.
Lemma good_got cfg tr s n b : good cfg tr s -> good cfg (Got (N.max (clock s) n) b :: tr) (set_clock n s).
Proof. intros G. now apply (good_at cfg tr s). Qed.

Lemma slot_reached cfg tr s t sl : good cfg tr s -> lookup t (opened s) = Some sl -> reached s t = true.
Proof.
  intros G L. apply (g_reached _ _ _ G). change t with (fst (t, sl)). apply in_map. now apply lookup_in.
Qed.

Lemma good_fits cfg tr s t sl o ds s' : good cfg tr s -> lookup t (opened s) = Some sl -> fits cfg tr t sl o ds ->
  opened s' = replace t o (opened s) -> newest s' = newest s -> good cfg (after ds tr) s'.
Proof.
  intros G L F EO EN. assert (R : forall u, reached s' u = reached s u) by (intros u; unfold reached; now rewrite EN).
  assert (Rt := slot_reached _ _ _ _ _ G L). assert (Tt := g_traced _ _ _ G t sl L).
  assert (NO : forall u, u <> t -> forall d, In d ds -> ~ about u d).
  { intros u N d I. assert (X := f_about _ _ _ _ _ _ F d I). unfold about in *. congruence. }
  assert (Lt : lookup t (opened s') = o) by (rewrite EO; eapply lookup_replace; eauto; apply (g_nodup _ _ _ G)).
  assert (Lu : forall u, u <> t -> lookup u (opened s') = lookup u (opened s)) by (intros; rewrite EO;
    now apply lookup_replace_other).
  constructor.
  - rewrite EO. apply replace_nodup, (g_nodup _ _ _ G).
  - intros u I. rewrite R. rewrite EO in I. apply replace_keys in I. now apply (g_reached _ _ _ G).
  - intros u x. destruct (N.eq_dec u t) as [->|N].
    + rewrite Lt. intros E. now apply (f_kept _ _ _ _ _ _ F).
    + rewrite Lu by auto. apply (g_slot _ _ _ G).
  - intros u x. destruct (N.eq_dec u t) as [->|N].
    + rewrite Lt. intros E. now apply (f_kept _ _ _ _ _ _ F).
    + rewrite Lu by auto. intros H. apply told_other; auto. now apply (g_traced _ _ _ G).
  - intros u H. rewrite R. destruct (N.eq_dec u t) as [->|N]; auto. apply (g_about _ _ _ G).
    rewrite says_other in H; eauto.
  - intros u H. destruct (N.eq_dec u t) as [->|N].
    + apply says_after. right. apply (a_open _ _ _ _ Tt).
    + rewrite says_other in * by eauto using opens_about. now apply (g_opened _ _ _ G).
  - intros u H. destruct (N.eq_dec u t) as [->|N].
    + rewrite Lt. destruct o; [left; discriminate|right]. now apply (f_gone _ _ _ _ _ _ F).
    + rewrite Lu by auto. rewrite says_other in * by eauto using opens_about, retires_about.
      now apply (g_open _ _ _ G).
  - intros u p H. destruct (N.eq_dec u t) as [->|N].
    + rewrite Lt. destruct o; [left; discriminate|right]. destruct (f_gone _ _ _ _ _ _ F eq_refl) as (_ & _ & Fl).
      rewrite says_after in H. destruct H as [(d & I & [H|H])|H]; [|exists p; apply says_after; eauto|eauto].
      now destruct (f_held _ _ _ _ _ _ F d p I H).
    + rewrite Lu by auto. rewrite says_other in H by eauto using accepts_about.
      destruct (g_floor _ _ _ G u p H) as [?|(m & M)]; auto. right. exists m. apply says_after. auto.
  - intros u Pr Ou. destruct (N.eq_dec u t) as [->|N].
    + rewrite Lt. intros -> q Q. apply (f_drained _ _ _ _ _ _ F eq_refl Pr). apply (a_requested _ _ _ _ Tt).
      destruct Q as [Q|Q]; auto. right. apply says_after in Q as [(d & I & Q)|Q]; auto.
      exfalso. destruct d; try contradiction. destruct Q as [-> ->].
      destruct (f_arms _ _ _ _ _ _ F _ q due I) as (_ & _ & _ & X); [cbn; auto|congruence].
    + rewrite Lu by auto. rewrite says_other in Ou by eauto using opens_about. intros L0 q Q.
      rewrite says_other by eauto using closes_about. apply (g_drained _ _ _ G u Pr Ou L0).
      destruct Q as [Q|Q]; auto. right. rewrite says_other in Q by eauto using requests_about. auto.
  - intros u m q M H. destruct (N.eq_dec u t) as [->|N].
    + apply says_after in H as [(d & I & H)|H]; [now destruct (f_held _ _ _ _ _ _ F d q I H) as [_ Z]; elim (Z m)|].
      apply says_after in M as [(d & I & M)|M]; [eapply (f_best _ _ _ _ _ _ F); eauto|now apply (g_best _ _ _ G t)].
    + rewrite says_other in M, H by eauto using emits_about, holds_about. now apply (g_best _ _ _ G u).
  - intros u p a b A B. destruct (N.eq_dec u t) as [->|N].
    + assert (C : forall x, says tr (arms t p x) -> p = 0 \/ says tr (requests t p)).
      { intros x (d & I & H). destruct d as [n v [e|]|? ? ?|? ? ?|? ? ? ?|? ? ? ?|? ? ?|? ? ? ?|? ? ?|? ? ?|? ?|? ?
          ?]; cbn in H; try tauto.
        right. eexists. split; eauto. cbn. tauto. }
      rewrite says_after in A, B. destruct A as [(d & I & A)|A], B as [(e & J & B)|B].
      * destruct (f_arms _ _ _ _ _ _ F d p a I A) as (_ & _ & U & _). rewrite (U e J) in B. clear - A B.
        destruct d as [n v [x|]|? ? ?|? ? ?|? ? ? ?|? ? ? ?|? ? ?|? ? ? ?|? ? ?|? ? ?|? ?|? ? ?]; cbn in *;
          try tauto; intuition congruence.
      * destruct (f_arms _ _ _ _ _ _ F d p a I A) as (Z & Q & _). destruct (C b B); tauto.
      * destruct (f_arms _ _ _ _ _ _ F e p b J B) as (Z & Q & _). destruct (C a A); tauto.
      * now apply (g_one _ _ _ G t p).
    + rewrite says_other in A, B by eauto using arms_about. now apply (g_one _ _ _ G u p).
  - intros u H. rewrite says_after in H. destruct H as [(d & I & H)|H].
    + assert (u = t) as ->.
      { destruct (N.eq_dec u t); auto. elim (NO u n d I). now apply holds_about in H. }
      destruct (f_free _ _ _ _ _ _ F d I H) as (p & P). exists p. apply says_after. auto.
    + destruct (g_free _ _ _ G u H) as (p & P). exists p. apply says_after. auto.
  - intros u. destruct (N.eq_dec u t) as [->|N].
    + rewrite Lt. intros ->. right. now apply (f_gone _ _ _ _ _ _ F).
    + rewrite Lu by auto. rewrite endings_other by eauto. apply (g_done _ _ _ G).
Qed.

(** Refusals and drops. *)
Lemma good_silent cfg tr s ds s' : good cfg tr s -> (forall d, In d ds -> topic d = None) ->
  opened s' = opened s -> newest s' = newest s -> good cfg (after ds tr) s'.
Proof.
  intros G S EO EN. assert (NO : forall u d, In d ds -> ~ about u d).
  { intros u d I. unfold about. rewrite (S d I). discriminate. }
  assert (R : forall u, reached s' u = reached s u) by (intros u; unfold reached; now rewrite EN).
  assert (Q : forall u (X : decision -> Prop), (forall d, X d -> about u d) -> (says (after ds tr) X <-> says tr X)).
  { intros u X H. apply (says_other tr ds u); auto. }
  destruct G as [A1 A2 A3 A4 A5 A6 A7 A9 A8 A10 A11 A12 A13]. constructor; rewrite ?EO; auto.
  - intros t I. rewrite R. auto.
  - intros t sl L. apply told_other; auto.
  - intros t. rewrite R, (Q t) by abouts. auto.
  - intros t. rewrite !(Q t) by abouts. auto.
  - intros t. rewrite !(Q t) by abouts. auto.
  - intros t p. rewrite (Q t) by abouts. intros H. destruct (A9 t p H) as [?|(m & M)]; auto. right. exists m.
    rewrite (Q t) by abouts. auto.
  - intros t Pr Ot L q Rq. rewrite (Q t) in Ot by abouts. rewrite (Q t) by abouts. apply (A8 t Pr Ot L).
    destruct Rq as [?|Rq]; auto. right. rewrite (Q t) in Rq by abouts. auto.
  - intros t m q. rewrite !(Q t) by abouts. apply A10.
  - intros t p a b. rewrite !(Q t) by abouts. apply A11.
  - intros t. rewrite (Q t) by abouts. intros H. destruct (A12 t H) as (p & P). exists p. rewrite (Q t) by abouts.
    auto.
  - intros t. rewrite endings_other by auto. apply A13.
Qed.

(** ** F1 *)
Lemma new_fits cfg tr now t due : (forall X : decision -> Prop, (forall d, X d -> about t d) -> ~ says tr X) ->
  endings t tr = [] ->
  slot_ok cfg (new_slot due) /\ traced cfg (after [Opened now t due] tr) t (new_slot due).
Proof.
  intros N EN. split.
  - constructor; cbn; try tauto; auto.
    + exists 0. auto.
    + intros p [<-|[]] Z. now elim Z.
    + intros p d. destruct due; cbn; [intros [[= <- _]|[]]|intros []]; auto.
  - constructor; cbn [requested pending cached armed new_slot]; intros; rewrite ?says_after, ?one_line in *.
    + now left.
    + cbn. split; [intros [<-|[]]; auto|]. intros [->|[[]|X]]; auto. now apply N in X; [|abouts].
    + cbn. split; [|tauto]. intros I. split; auto. intros [[]|X]. now apply N in X; [|abouts].
    + cbn. split; [tauto|]. intros [[]|X]. now apply N in X; [|abouts].
    + intros [[]|X]. now apply N in X; [|abouts].
    + assert (ND : ~ says tr (disarms cfg t p)) by (apply N; abouts). destruct due as [e|]; cbn.
      * split; [intros [[= <- <-]|[]]; intuition|]. intros [[(_ & -> & ->)|X] _]; auto. now apply N in X; [|abouts].
      * split; [tauto|]. intros [[[]|X] _]. now apply N in X; [|abouts].
    + destruct H as [[[]|[]]|X]. now apply N in X; [|abouts].
    + destruct H as [[]|X]. now apply N in X; [|abouts].
    + rewrite endings_after, EN. unfold running. cbn. destruct (is_progressive cfg); auto. exists [].
      repeat constructor.
Qed.

Lemma good_new cfg tr s t due s' : good cfg tr s -> reached s t = false -> newest s' = Some t ->
  opened s' = opened s ++ [(t, new_slot due)] -> good cfg (after [Opened (clock s) t due] tr) s'.
Proof.
  intros G NR EN EO. set (ds := [Opened (clock s) t due]).
  assert (NT : ~ In t (map fst (opened s))) by (intros I; apply (g_reached _ _ _ G) in I; congruence).
  assert (NS : forall X : decision -> Prop, (forall d, X d -> about t d) -> ~ says tr X).
  { intros X H (d & I & D). assert (says tr (about t)) as Y by (exists d; auto). apply (g_about _ _ _ G) in Y.
    congruence. }
  assert (NE : endings t tr = []).
  { destruct (endings t tr) as [|e l] eqn:E; auto. exfalso. assert (I : In e (endings t tr)) by (rewrite E; now left).
    unfold endings in I. apply in_flat_map in I as ([n b|d] & I & H); [contradiction|].
    apply (NS (fun x => about t x)); auto. exists d. split; auto. unfold about.
    destruct d; cbn in *; try tauto; destruct (N.eqb_spec t0 t) as [->|]; auto; contradiction. }
  destruct (new_fits cfg tr (clock s) t due NS NE) as [Ok Td].
  assert (Rm : forall u, reached s u = true -> reached s' u = true).
  { intros u. unfold reached in *. rewrite EN. destruct (newest s) as [n|]; [|discriminate].
    apply N.leb_gt in NR. rewrite !N.leb_le. lia. }
  assert (Rt : reached s' t = true) by (unfold reached; rewrite EN; apply N.leb_refl).
  assert (NO : forall u, u <> t -> forall d, In d ds -> ~ about u d).
  { intros u N d [<-|[]]. unfold about. cbn. congruence. }
  assert (Q : forall u (X : decision -> Prop), u <> t -> (forall d, X d -> about u d) -> (says (after ds tr) X <->
    says tr X)).
  { intros u X N H. apply (says_other tr ds u); auto. }
  assert (QT : forall (X : decision -> Prop), (forall d, X d -> about t d) -> says (after ds tr) X ->
    X (Opened (clock s) t due)).
  { intros X H Y. apply says_after in Y as [(d & [<-|[]] & D)|Y]; auto. now apply NS in Y. }
  assert (Lu : forall u, lookup u (opened s') = if t =? u then Some (new_slot due) else lookup u (opened s)).
  { intros u. rewrite EO. now apply lookup_app. }
  destruct G as [A1 A2 A3 A4 A5 A6 A7 A9 A8 A10 A11 A12 A13]. constructor.
  - rewrite EO, map_app. cbn. apply (Permutation_NoDup (Permutation_cons_append _ _)). now constructor.
  - intros u I. rewrite EO, map_app in I. apply in_app_or in I as [I|[<-|[]]]; auto.
  - intros u x. rewrite Lu. destruct (t =? u); [intros [= <-]; auto|eauto].
  - intros u x. rewrite Lu. destruct (N.eqb_spec t u) as [<-|N]; [intros [= <-]; auto|]. intros L.
    apply told_other; auto.
  - intros u H. destruct (N.eq_dec u t) as [->|N]; auto. rewrite (Q u) in H; auto.
  - intros u H. destruct (N.eq_dec u t) as [->|N]; [apply says_after; left; eexists; split; [now left|reflexivity]|].
    rewrite (Q u) in H by auto. rewrite (Q u) by (auto; abouts). auto.
  - intros u H. rewrite Lu. destruct (N.eqb_spec t u) as [->|N]; [left; discriminate|].
    rewrite (Q u) in * by (auto; abouts). auto.
  - intros u p H. destruct (N.eq_dec u t) as [->|N]; [apply QT in H as [[]|[]]; abouts|].
    rewrite (Q u) in H by (auto; abouts). rewrite Lu. apply not_eq_sym, N.eqb_neq in N. rewrite N.
    destruct (A9 u p H) as [?|(m & M)]; auto. right. exists m. apply says_after. auto.
  - intros u Pr Ou. rewrite Lu. destruct (N.eqb_spec t u) as [->|N]; [discriminate|]. intros L q Rq.
    rewrite (Q u) in Ou by (auto; abouts). rewrite (Q u) by (auto; abouts). apply (A8 u Pr Ou L).
    destruct Rq as [?|Rq]; auto. right. rewrite (Q u) in Rq by (auto; abouts). auto.
  - intros u m q H H2. destruct (N.eq_dec u t) as [->|N]; [apply QT in H; [contradiction|abouts]|].
    rewrite (Q u) in H, H2 by (auto; abouts). now apply (A10 u).
  - intros u p a b H H2. destruct (N.eq_dec u t) as [->|N].
    + apply QT in H; [|abouts]. apply QT in H2; [|abouts]. destruct due; cbn in *; [|contradiction].
      destruct H as (_ & _ & ->), H2 as (_ & _ & ->). reflexivity.
    + rewrite (Q u) in H, H2 by (auto; abouts). now apply (A11 u p).
  - intros u H. destruct (N.eq_dec u t) as [->|N]; [apply QT in H; [contradiction|abouts]|].
    rewrite (Q u) in H by (auto; abouts). destruct (A12 u H) as (p & P). exists p. apply says_after. auto.
  - intros u. rewrite Lu. destruct (N.eqb_spec t u) as [->|N]; [discriminate|].
    rewrite endings_other by (apply NO; auto). auto.
Qed.

(** ** Where the input under way stands *)
Definition arming (d : decision) : bool := match d with Opened _ _ _ | Request _ _ _ _ => true | _ => false end.
Definition current (tr : trace) (s : state) (b : body) : Prop := exists ds earlier,
  tr = map Did ds ++ Got (clock s) b :: earlier /\ forall d, In d ds -> arming d = false.

Lemma settle_quiet cfg now t timer sl o ds : settle cfg now t timer sl = (o, ds) -> forall d, In d ds ->
  arming d = false.
Proof.
  intros H d I. apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & E & _)]]].
  - contradiction.
  - destruct I as [<-|[]]. reflexivity.
  - destruct I as [<-|[]]. reflexivity.
  - injection E as _ ->. destruct I as [<-|I]; [reflexivity|]. apply in_map_iff in I as (q & <- & _). reflexivity.
Qed.
Lemma current_fire cfg tr s b due t s' ds : current tr s b ->
  update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> current (after ds tr) s' b.
Proof.
  intros (y & x & -> & Q) U. unfold update, fire in U.
  destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as <- <-. cbn.
  exists (rev (map (Timer (clock s) t) (fired due (slot_of s t)) ++ e) ++ y), x.
  split; [unfold after; now rewrite (map_app Did (rev _)), map_rev, app_assoc|].
  intros d I. apply in_app_or in I as [I|I]; [|now apply Q]. apply in_rev in I.
  apply in_app_or in I as [I|I]; [apply in_map_iff in I as (q & <- & _); reflexivity|]. eapply settle_quiet; eauto.
Qed.
Lemma reach_current cfg tr s cur : reach cfg tr s cur -> forall b, cur = Some b -> current tr s b.
Proof.
  induction 1 as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U]; try discriminate.
  - intros c [= <-]. exists [], tr. split; [reflexivity|intros d []].
  - intros c [= <-]. eapply current_fire; eauto.
Qed.
(** A result that is accepted is in time. *)
Lemma pending_arrives cfg tr s t p sl : good cfg tr s -> current tr s (Result t p) -> rest_of s t ->
  lookup t (opened s) = Some sl -> In p (pending sl) -> arrives tr t p.
Proof.
  intros G (y & x & E & Q) AR L P. assert (T := g_traced _ _ _ G t sl L). assert (O := g_slot _ _ _ G t sl L).
  assert (X : forall Y : decision -> Prop, (forall d, Y d -> arming d = true) -> says tr Y -> says x Y).
  { intros Y H (d & I & D). rewrite E in I. apply in_app_or in I as [I|[I|I]]; [|discriminate|exists d; auto].
    apply in_map_iff in I as (d' & [= ->] & I). apply Q in I. apply H in D. congruence. }
  assert (Old : forall Y, says x Y -> says tr Y).
  { intros Y (d & I & D). exists d. split; auto. rewrite E. apply in_or_app. right. now right. }
  assert (NC := proj2 (proj1 (a_pending _ _ _ _ T p) P)).
  exists y, x, (clock s). repeat split; auto.
  - apply X; [|apply (a_open _ _ _ _ T)]. intros d; destruct d; cbn; tauto.
  - intros Z. apply X; [intros d; destruct d; cbn; tauto|].
    apply (ok_pending _ _ O) in P. apply (a_requested _ _ _ _ T) in P as [?|?]; [contradiction|auto].
  - intros due A. apply (AR sl p due L). apply (a_armed _ _ _ _ T). split; auto.
    intros (d & I & D). apply NC. exists d. split; auto. now apply disarms_closes.
  - intros A. apply Old in A as (d & I & D). apply NC. exists d. split; auto. destruct d; cbn in *; tauto.
Qed.

(** ** Every run *)
Lemma due_lookup cfg tr s due t : good cfg tr s -> earliest (timers (opened s)) = Some (due, t) ->
  exists sl p, lookup t (opened s) = Some sl /\ In (p, due) (armed sl).
Proof.
  intros G E. apply earliest_some in E as [I _]. apply timers_in in I as (sl & p & I & A).
  exists sl, p. split; auto. apply in_lookup; auto. apply (g_nodup _ _ _ G).
Qed.
Lemma slot_of_open s t sl : lookup t (opened s) = Some sl -> slot_of s t = sl.
Proof. unfold slot_of. now intros ->. Qed.
Lemma armed_requested cfg sl p due : slot_ok cfg sl -> In (p, due) (armed sl) -> In p (requested sl).
Proof. intros O I. destruct (ok_armed _ _ O p due I) as [?|(? & _)];
  [now apply (ok_pending _ _ O)|now apply (ok_cached _ _ O)]. Qed.

Lemma good_fire cfg tr s due t sl s' ds : good cfg tr s -> lookup t (opened s) = Some sl ->
  update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> good cfg (after ds tr) s'.
Proof.
  intros G L U. rewrite (slot_of_open _ _ _ L) in U.
  assert (O := g_slot _ _ _ G t sl L). unfold fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
  injection U as <- <-.
  eapply (good_fits cfg tr s t sl o); eauto; try reflexivity.
  apply (settle_fits cfg tr t (clock s) sl O (g_traced _ _ _ G t sl L) _ (fired due sl) _ o e) with (3 := Se).
  - split.
    + intros d I. apply in_map_iff in I as (q & <- & I). eauto.
    + intros q I. exists (Timer (clock s) t q). split; auto. apply in_map_iff. eauto.
  - intros q I. apply fired_in in I. eapply armed_requested; eauto.
Qed.

(** What the tables leave over. *)
Lemma f3_none cfg s t p : first_reason (f3_reasons cfg s t p) = None -> exists sl, lookup t (opened s) = Some sl /\
  In p (pending sl) /\ In p (requested sl) /\ ~ In p (cached sl) /\ reached s t = true.
Proof.
  cbn. destruct ((p =? 0) || is_cloud cfg p); cbn; [|discriminate]. destruct (reached s t); cbn; [|discriminate].
  unfold is_open, slot_of. destruct (lookup t (opened s)) as [sl|]; cbn; [|discriminate].
  destruct (is_progressive cfg && any_above p (cached sl)); [discriminate|].
  destruct (mem p (requested sl)) eqn:M1; cbn; [|discriminate]. destruct (mem p (cached sl)) eqn:M2; [discriminate|].
  destruct (mem p (pending sl)) eqn:M3; cbn; [|discriminate]. intros _. exists sl.
  rewrite mem_iff in M1, M3. rewrite mem_not in M2. auto.
Qed.
Lemma f2_none cfg s t p d : first_reason (f2_reasons cfg s t p d) = None ->
  exists sl, lookup t (opened s) = Some sl /\
  ~ In p (requested sl) /\ any_above p (cached sl) = false /\ is_cloud cfg p = true /\ clock s < due_at (clock s) d.
Proof.
  cbn. destruct (is_cloud cfg p); cbn; [|discriminate]. destruct (reached s t); cbn; [|discriminate].
  unfold is_open, slot_of. destruct (lookup t (opened s)) as [sl|]; cbn; [|discriminate].
  destruct (mem p (requested sl)) eqn:M1; cbn; [discriminate|].
  destruct (any_above p (cached sl)) eqn:M2; [discriminate|].
  destruct (N.leb_spec (due_at (clock s) d) (clock s)); [discriminate|]. rewrite mem_not in M1. intros _. exists sl.
  auto.
Qed.

Lemma good_apply cfg tr s b s' ds : good cfg tr s -> apply cfg s b = (s', ds) -> good cfg (after ds tr) s'.
Proof.
  intros G. destruct b as [t d|t p d bl|t p|t p|]; cbn [apply].
  - unfold open. destruct (first_reason _) eqn:F.
    + intros [= <- <-]. apply (good_silent cfg tr s); auto; try reflexivity. intros e [<-|[]]. reflexivity.
    + intros [= <- <-]. apply good_new; auto. cbn in F. destruct (reached s t); [discriminate|auto].
  - unfold offer. destruct (first_reason _) eqn:F.
    + intros [= <- <-]. apply (good_silent cfg tr s); auto; try reflexivity. intros e [<-|[]]. reflexivity.
    + apply f2_none in F as (sl & L & N & A & _ & _). destruct (gate_shut cfg s p bl).
      * intros [= <- <-]. apply (good_silent cfg tr s); auto; try reflexivity. intros e [<-|[]]. reflexivity.
      * rewrite (slot_of_open _ _ _ L). intros [= <- <-]. eapply (good_fits cfg tr s t sl); eauto; try reflexivity.
        apply (admit_fits cfg tr t (clock s) sl (g_slot _ _ _ G t sl L) (g_traced _ _ _ G t sl L)); auto.
  - unfold arrive. destruct (first_reason _) eqn:F.
    + intros [= <- <-]. apply (good_silent cfg tr s); auto; try reflexivity. intros e [<-|[]]. reflexivity.
    + apply f3_none in F as (sl & L & P & Rq & NC & _). rewrite (slot_of_open _ _ _ L).
      assert (O := g_slot _ _ _ G t sl L). assert (T := g_traced _ _ _ G t sl L).
      unfold update, result.
      destruct (is_progressive cfg) eqn:Pr; [|destruct (any_above p (pending sl)) eqn:A].
      * destruct (improve (clock s) t p sl) as [o e] eqn:Im. intros [= <- <-].
        eapply (good_fits cfg tr s t sl o); eauto; try reflexivity.
        eapply improve_fits; eauto.
      * intros [= <- <-]. eapply (good_fits cfg tr s t sl); eauto; try reflexivity. now apply hold_fits.
      * intros [= <- <-]. eapply (good_fits cfg tr s t sl None); eauto; try reflexivity.
        apply (forward_fits cfg tr t (clock s) sl T [] [] p (close [p] sl)); auto; [split; intros ? []|].
        intros q Q. rewrite above_not in A. destruct (ok_prompt _ _ O q Q) as (w & W & Lw). specialize (A w W). lia.
  - unfold arrive. destruct (first_reason _) eqn:F.
    + intros [= <- <-]. apply (good_silent cfg tr s); auto; try reflexivity. intros e [<-|[]]. reflexivity.
    + apply f3_none in F as (sl & L & P & Rq & NC & _). rewrite (slot_of_open _ _ _ L). unfold update, fail.
      destruct (settle _ _ _ _ _) as [o e] eqn:Se. intros [= <- <-].
      eapply (good_fits cfg tr s t sl o); eauto; try reflexivity.
      apply (settle_fits cfg tr t (clock s) sl (g_slot _ _ _ G t sl L) (g_traced _ _ _ G t sl L) false [p] [Failed
        (clock s) t p]); auto.
      * split; [intros x [<-|[]]; exists p; cbn; auto|]. intros q [<-|[]]. eexists. split; [now left|auto].
      * intros q [<-|[]]. auto.
  - intros [= <- <-]. apply (good_silent cfg tr s); auto; try reflexivity. intros e [].
Qed.

Theorem reach_good cfg tr s cur : reach cfg tr s cur -> good cfg tr s.
Proof.
  induction 1 as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U].
  - constructor; cbn; try (constructor; fail); intros; try discriminate; try contradiction; auto;
      match goal with H : says [] _ |- _ => destruct H as (d & [] & _) end.
  - now apply good_got.
  - destruct (due_lookup _ _ _ _ _ IH E) as (sl & p & X & _). eapply good_fire; eauto.
  - eapply good_apply; eauto.
Qed.
