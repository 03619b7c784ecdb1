(** * E1 to E3: two operators in a row, with a budget *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Broken Slots Invariant Runs Accounts Lines Promises.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** Each decision bears the instant of its input *)
Lemma expire_instant cfg n : forall s s' ds, expire n cfg s = (s', ds) -> clock s' = clock s /\
  forall d, In d ds -> instant_of d = clock s.
Proof.
  induction n as [|n IH]; intros s s' ds; cbn [expire]; [intros [= <- <-]; split; [auto|intros d []]|].
  destruct (earliest _) as [[due t]|]; [|intros [= <- <-]; split; [auto|intros d []]].
  destruct (due <=? clock s); [|intros [= <- <-]; split; [auto|intros d []]].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire n cfg s1) as [s2 ds2] eqn:E. intros [= <- <-].
  apply IH in E as [C E]. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as <- <-.
  cbn in C, E. split; auto. intros d I. apply in_app_or in I as [I|I]; auto.
  apply in_app_or in I as [I|I]; [apply in_map_iff in I as (q & <- & _); reflexivity|]. eapply settle_instant; eauto.
Qed.
(** ** What each line of a trace says of the inputs *)
Definition is_opening (t : N) (d : decision) : bool :=
  match d with Opened _ u _ => u =? t | Refuse _ u None _ => u =? t | _ => false end.
Record sound (cfg : config) (tr : trace) : Prop := {
  s_opened : forall now t due, In (Did (Opened now t due)) tr -> exists d, In (Got now (Open t d)) tr /\
    due = option_map (due_at now) d /\ forall y, due = Some y -> now < y;
  s_request : forall now t p due, In (Did (Request now t p due)) tr -> exists d bl, In (Got now (Offer t p d bl)) tr /\
    due = due_at now d /\ now < due;
  s_refused : forall now t why, In (Did (Refuse now t None why)) tr -> exists d, In (Got now (Open t d)) tr;
  s_openings : forall t, length (filter (is_opening t) (decisions tr)) = length (open_inputs t tr);
  s_instants : forall d, In (Did d) tr -> instant_of d <= clock_of tr
}.
Lemma decisions_after ds tr : decisions (after ds tr) = rev ds ++ decisions tr.
Proof.
  unfold after, decisions. rewrite flat_map_app. f_equal. rewrite <- map_rev. induction (rev ds) as [|d l IH]; cbn; auto.
  now rewrite IH.
Qed.
Lemma in_after d ds tr : In (Did d) (after ds tr) <-> In d ds \/ In (Did d) tr.
Proof.
  unfold after. rewrite in_app_iff, <- in_rev, in_map_iff. split.
  - intros [(x & [= ->] & I)|I]; auto.
  - intros [I|I]; eauto.
Qed.
Lemma got_after now b ds tr : In (Got now b) (after ds tr) <-> In (Got now b) tr.
Proof.
  unfold after. rewrite in_app_iff, <- in_rev, in_map_iff. split; auto. intros [(x & [=] & _)|I]; auto.
Qed.
Lemma opens_after t ds tr : open_inputs t (after ds tr) = open_inputs t tr.
Proof.
  unfold after, open_inputs. rewrite flat_map_app, <- map_rev. induction (rev ds) as [|d l IH]; cbn; auto.
Qed.
Lemma filter_length_rev {A} (f : A -> bool) l : length (filter f (rev l)) = length (filter f l).
Proof.
  induction l as [|x l IH]; cbn; auto. rewrite filter_app, app_length, IH. cbn. destruct (f x); cbn; lia.
Qed.
Lemma timers_no_opening t ds : Forall of_timers ds -> filter (is_opening t) ds = [].
Proof.
  induction 1 as [|d ds H F IH]; cbn; auto. destruct d; cbn in *; auto; contradiction.
Qed.
Lemma own_openings cfg now b ds t : own cfg now b ds ->
  length (filter (is_opening t) ds) = match b with Open u _ => if u =? t then 1%nat else 0%nat | _ => 0%nat end.
Proof.
  assert (C : forall u cs l, filter (is_opening t) (map (Cancel now u) cs ++ l) = filter (is_opening t) l).
  { intros u cs l. induction cs; cbn; auto. }
  assert (C0 : forall u cs, filter (is_opening t) (map (Cancel now u) cs) = []).
  { intros u cs. induction cs; cbn; auto. }
  destruct b as [u d0|u p d0 bl|u p|u p|]; cbn.
  - intros [->|(w & ->)]; cbn; destruct (u =? t); reflexivity.
  - intros [->|(w & ->)]; reflexivity.
  - intros [(w & ->)|[(-> & _)|(cs & last & -> & K)]]; [reflexivity..|]. cbn. rewrite C.
    destruct K as [->|(_ & ->)]; reflexivity.
  - intros [(w & ->)|(last & -> & K)]; [reflexivity|]. cbn.
    destruct K as [->|[->|[(_ & m & ->)|(_ & m & cs & ->)]]]; [reflexivity..|]. cbn. now rewrite C0.
  - intros ->. reflexivity.
Qed.
Lemma clock_trace cfg ins : clock_of (trace_of cfg ins) = clock (state_after cfg ins).
Proof. symmetry. exact (reach_clock _ _ _ _ (proj1 (run_reach cfg ins))). Qed.
(** The decisions of due timers, then those of the input itself. *)
Lemma step_parts cfg s i : exists s1 fires, clock s1 = N.max (clock s) (at_ i) /\
  snd (step cfg s i) = fires ++ snd (apply cfg s1 (what i)) /\ Forall of_timers fires /\
  forall d, In d fires -> instant_of d = N.max (clock s) (at_ i).
Proof.
  unfold step. destruct (expire _ _ _) as [s1 ds1] eqn:E. exists s1, ds1. assert (T := expire_of_timers _ _ _ _ _ E).
  apply expire_instant in E as [C I]. cbn in C, I. destruct (apply cfg s1 (what i)). cbn. auto.
Qed.
Lemma apply_lines cfg s b d : In d (snd (apply cfg s b)) -> instant_of d = clock s /\
  (forall n t due, d = Opened n t due -> exists x, b = Open t x /\ due = option_map (due_at n) x /\
    forall y, due = Some y -> n < y) /\
  (forall n t p due, d = Request n t p due -> exists x bl, b = Offer t p x bl /\ due = due_at n x /\ n < due) /\
  (forall n t why, d = Refuse n t None why -> exists x, b = Open t x).
Proof.
  intros I. assert (O := apply_own cfg s b). split; [eapply own_instant; eauto|].
  destruct b as [t x|t p x bl|t p|t p|]; cbn [own] in O.
  - split; [|split].
    + intros n u due ->. destruct O as [E|(w & E)]; rewrite E in I; destruct I as [[= <- <- <-]|[]].
      exists x. split; [auto|]. split; [auto|]. cbn [apply] in E. unfold open in E.
      destruct (first_reason _) eqn:F; [discriminate|]. cbn in F. destruct (reached s t); [discriminate|].
      destruct (window cfg <=? _); [discriminate|]. intros y Y. destruct x as [x|]; [|discriminate].
      injection Y as <-. destruct (N.leb_spec (due_at (clock s) x) (clock s)); [discriminate|auto].
    + intros n u p due ->. destruct O as [E|(w & E)]; rewrite E in I; destruct I as [[=]|[]].
    + intros n u w ->. destruct O as [E|(w' & E)]; rewrite E in I; destruct I as [[=]|[]]; subst; eauto.
  - split; [|split].
    + intros n u due ->. destruct O as [E|(w & E)]; rewrite E in I; destruct I as [[=]|[]].
    + intros n u q due ->. destruct O as [E|(w & E)]; rewrite E in I; destruct I as [[= <- <- <- <-]|[]].
      exists x, bl. split; [auto|]. split; [auto|]. cbn [apply] in E. unfold offer in E.
      destruct (first_reason _) eqn:F; [discriminate|]. now apply f2_none in F as (sl & _ & _ & _ & _ & D).
    + intros n u w ->. destruct O as [E|(w' & E)]; rewrite E in I; destruct I as [[=]|[]].
  - assert (N : forall e, In e (snd (apply cfg s (Result t p))) ->
      match e with Opened _ _ _ | Request _ _ _ _ | Refuse _ _ _ _ => False | _ => True end).
    { intros e J. destruct O as [(w & E)|[(E & _)|(cs & last & E & K)]]; rewrite E in J;
        [destruct J as [<-|[]]; exact Logic.I..|]. destruct J as [<-|J]; [exact Logic.I|].
      apply in_app_or in J as [J|J]; [apply in_map_iff in J as (z & <- & _); exact Logic.I|].
      destruct K as [->|(_ & ->)]; [contradiction|destruct J as [<-|[]]; exact Logic.I]. }
    apply N in I. repeat split; intros; subst; contradiction.
  - assert (N : forall e, In e (snd (apply cfg s (Fail t p))) ->
      match e with Opened _ _ _ | Request _ _ _ _ | Refuse _ _ _ _ => False | _ => True end).
    { intros e J. destruct O as [(w & E)|(last & E & K)]; rewrite E in J; [destruct J as [<-|[]]; exact Logic.I|].
      destruct J as [<-|J]; [exact Logic.I|].
      destruct K as [->|[->|[(_ & m & ->)|(_ & m & cs & ->)]]];
        [contradiction|destruct J as [<-|[]]; exact Logic.I..|].
      destruct J as [<-|J]; [exact Logic.I|]. apply in_map_iff in J as (z & <- & _). exact Logic.I. }
    apply N in I. repeat split; intros; subst; contradiction.
  - rewrite O in I. contradiction.
Qed.
Lemma trace_sound cfg ins : sound cfg (trace_of cfg ins).
Proof.
  induction ins as [|i ins IH] using rev_ind; [constructor; cbn; try contradiction; auto; intros; contradiction|].
  rewrite trace_snoc. set (s := state_after cfg ins) in *. set (tr := trace_of cfg ins) in *.
  destruct (step_parts cfg s i) as (s1 & fires & C & E & T & Ti). rewrite E, <- C in *.
  assert (Ap := apply_lines cfg s1 (what i)). assert (O := apply_own cfg s1 (what i)).
  assert (Old : forall d, In d fires -> of_timers d) by (apply Forall_forall; exact T).
  destruct IH as [A1 A2 A3 A4 A5]. constructor.
  - intros n t due I. apply in_after in I as [I|[[=]|I]].
    + apply in_app_or in I as [I|I]; [now apply Old in I|]. apply Ap in I as (X & Y & _).
      destruct (Y _ _ _ eq_refl) as (x & B & -> & L). cbn in X. subst n.
      exists x. split; [|split; auto]. apply got_after. left. now rewrite B.
    + destruct (A1 _ _ _ I) as (d & G & R). exists d. split; auto. apply got_after. now right.
  - intros n t p due I. apply in_after in I as [I|[[=]|I]].
    + apply in_app_or in I as [I|I]; [now apply Old in I|]. apply Ap in I as (X & _ & Y & _).
      destruct (Y _ _ _ _ eq_refl) as (x & bl & B & -> & L). cbn in X. subst n.
      exists x, bl. split; [|split; auto]. apply got_after. left. now rewrite B.
    + destruct (A2 _ _ _ _ I) as (d & bl & G & R). exists d, bl. split; auto. apply got_after. now right.
  - intros n t why I. apply in_after in I as [I|[[=]|I]].
    + apply in_app_or in I as [I|I]; [now apply Old in I|]. apply Ap in I as (X & _ & _ & Y).
      destruct (Y _ _ _ eq_refl) as (x & B). cbn in X. subst n. exists x. apply got_after. left. now rewrite B.
    + destruct (A3 _ _ _ I) as (d & G). exists d. apply got_after. now right.
  - intros t. rewrite decisions_after, opens_after, filter_app, app_length, filter_length_rev, filter_app.
    rewrite timers_no_opening by exact T. cbn [app decisions open_inputs flat_map].
    rewrite (own_openings _ _ _ _ t O), app_length. fold (decisions tr). fold (open_inputs t tr). rewrite A4.
    destruct (what i) as [u d|u q d bl|u q|u q|]; auto. destruct (u =? t); auto.
  - intros d I. rewrite clock_after. cbn [clock_of]. apply in_after in I as [I|[[=]|I]].
    + apply in_app_or in I as [I|I]; [rewrite (Ti _ I)|destruct (Ap _ I) as (-> & _)]; lia.
    + apply A5 in I. unfold tr in I. rewrite clock_trace in I. fold s in I. lia.
Qed.

(** ** One operator *)
(** The trace until an input, itself the trace of a run; no later decision bears an earlier instant. *)
Lemma until_input cfg ins now b : In (Got now b) (trace_of cfg ins) -> exists begins, clock_of (trace_of cfg begins) = now /\
  (forall d, In (Did d) (trace_of cfg begins) -> In (Did d) (trace_of cfg ins)) /\
  forall d, In (Did d) (trace_of cfg ins) -> In (Did d) (trace_of cfg begins) \/ now <= instant_of d.
Proof.
  induction ins as [|i ins IH] using rev_ind; [intros []|]. intros I. assert (J := I). rewrite trace_snoc in I.
  apply got_after in I. destruct I as [[= <- _]|I].
  - exists (ins ++ [i]). split; [now rewrite trace_snoc, clock_after|auto].
  - destruct (IH I) as (bs & C & In1 & In2). exists bs. split; auto. split.
    + intros d H. rewrite trace_snoc. apply in_after. right. right. auto.
    + intros d H. rewrite trace_snoc in H. apply in_after in H as [H|[[=]|H]]; auto. right.
      destruct (step_parts cfg (state_after cfg ins) i) as (s1 & fires & C1 & E & _ & Ti). rewrite E in H.
      assert (L : now <= clock (state_after cfg ins)).
      { rewrite <- clock_trace. clear - I. revert I. induction ins as [|j ins IH] using rev_ind; [intros []|].
        rewrite trace_snoc, clock_after, got_after. cbn [clock_of]. intros [[= <- _]|I]; [lia|]. apply IH in I.
        rewrite clock_trace in I. lia. }
      apply in_app_or in H as [H|H]; [rewrite (Ti _ H)|destruct (apply_lines _ _ _ _ H) as (-> & _); rewrite C1]; lia.
Qed.
Definition is_refusal (t : N) (d : decision) : bool := match d with Refuse _ u None _ => u =? t | _ => false end.
Definition is_end (cfg : config) (t : N) (d : decision) : bool :=
  match d with
  | Miss _ u | Final _ u _ => u =? t
  | Emit _ u _ => (u =? t) && negb (is_progressive cfg)
  | _ => false
  end.
Lemma is_end_iff cfg t d : is_end cfg t d = true <-> retires cfg t d.
Proof.
  destruct d; cbn; rewrite ?andb_true_iff, ?N.eqb_eq, ?negb_true_iff; try tauto; split; try discriminate; tauto.
Qed.
Lemma last_split cfg t ds : length (filter (is_last cfg t) ds) =
  (length (filter (is_refusal t) ds) + length (filter (is_end cfg t) ds))%nat.
Proof.
  induction ds as [|d ds IH]; auto.
  assert (X : is_last cfg t d = is_refusal t d || is_end cfg t d /\ is_refusal t d && is_end cfg t d = false).
  { destruct d as [| | |n u [q|] w| | | | | | |]; cbn; rewrite ?orb_false_r, ?andb_false_r; auto. }
  destruct X as [X Y]. cbn. rewrite X. destruct (is_refusal t d), (is_end cfg t d); cbn in *; try discriminate; lia.
Qed.
Lemma endings_decisions t tr : endings t tr = flat_map (end_of t) (decisions tr).
Proof.
  unfold endings, decisions. induction tr as [|[n b|d] tr IH]; cbn; auto. now rewrite IH.
Qed.
Definition is_over (cfg : config) (e : ending) : bool :=
  match e with Sent _ => negb (is_progressive cfg) | _ => true end.
Lemma ends_endings cfg t tr : length (filter (is_end cfg t) (decisions tr)) =
  length (filter (is_over cfg) (endings t tr)).
Proof.
  rewrite endings_decisions. induction (decisions tr) as [|d ds IH]; auto.
  cbn [flat_map filter]. rewrite filter_app, app_length, <- IH.
  destruct d; cbn; auto; destruct (_ =? _); cbn; auto. destruct (is_progressive cfg); auto.
Qed.
Lemma at_most_one_end cfg ins t : (length (filter (is_end cfg t) (decisions (trace_of cfg ins))) <= 1)%nat.
Proof.
  rewrite ends_endings. destruct (is_progressive cfg) eqn:Pr.
  - assert (Z : forall ps, filter (is_over cfg) (map Sent ps) = []).
    { intros ps. induction ps; auto. cbn. now rewrite Pr. }
    destruct (p1_progressive cfg ins t Pr) as [(ps & -> & _)|[->|(p & ps & -> & _)]]; cbn; rewrite ?Pr; cbn;
      rewrite ?Z; cbn; lia.
  - destruct (p1_once cfg ins t Pr) as [->|[->|(p & ->)]]; cbn; rewrite ?Pr; cbn; lia.
Qed.
Lemma says_filter tr (X : decision -> Prop) f : (forall d, f d = true <-> X d) ->
  (says tr X <-> (0 < length (filter f (decisions tr)))%nat).
Proof.
  intros H. unfold says. split.
  - intros (d & I & Y). assert (J : In d (filter f (decisions tr))).
    { apply filter_In. split; [|now apply H]. unfold decisions. apply in_flat_map. exists (Did d). split; auto. now left. }
    destruct (filter f (decisions tr)); [contradiction|cbn; lia].
  - destruct (filter f (decisions tr)) as [|d l] eqn:E; [cbn; lia|]. intros _. exists d.
    assert (J : In d (filter f (decisions tr))) by (rewrite E; now left). apply filter_In in J as [J Y].
    split; [|now apply H]. unfold decisions in J. apply in_flat_map in J as (e & I & K).
    destruct e as [n b|e]; [contradiction|]. destruct K as [->|[]]. exact I.
Qed.

Lemma open_inputs_in now t d tr : In (Got now (Open t d)) tr -> In (now, d) (open_inputs t tr).
Proof.
  intros I. unfold open_inputs. apply in_flat_map. eexists. split; [exact I|]. cbn. rewrite N.eqb_refl. now left.
Qed.
(** Of what was armed for a timestamp something is due last. *)
Lemma latest_armed t tr p x : says tr (arms t p x) -> exists q y, says tr (arms t q y) /\
  forall r z, says tr (arms t r z) -> z <= y.
Proof.
  intros A. apply armed_in_iff in A.
  assert (M : forall l : list (N * N), In (p, x) l -> exists q y, In (q, y) l /\ forall r z, In (r, z) l -> z <= y).
  { clear A. intros l. assert (X : l = [] \/ exists q y, In (q, y) l /\ forall r z, In (r, z) l -> z <= y).
    { induction l as [|[q y] l IH]; auto. right. destruct IH as [->|(r & z & I & B)].
      - exists q, y. split; [now left|]. intros r z [[= <- <-]|[]]. lia.
      - destruct (N.le_gt_cases z y).
        + exists q, y. split; [now left|]. intros r' z' [[= <- <-]|J]; [lia|]. specialize (B _ _ J). lia.
        + exists r, z. split; [now right|]. intros r' z' [[= <- <-]|J]; [lia|]. eauto. }
    destruct X as [->|X]; [contradiction|auto]. }
  destruct (M _ A) as (q & y & I & B). exists q, y. split; [now apply armed_in_iff|].
  intros r z H. apply armed_in_iff in H. eauto.
Qed.

Section Of.
Variables (cfg : config) (ins : list input).
Local Notation tr := (trace_of cfg ins).
Local Notation S := (trace_sound cfg ins).

Lemma request_within t a due r n p x : budgeted tr t a due r -> In (Did (Request n t p x)) tr -> x <= due - r.
Proof.
  intros [_ O] I. destruct (s_request _ _ S _ _ _ _ I) as (d & bl & G & -> & L).
  specialize (O _ _ _ _ G). unfold due_at in *. lia.
Qed.
(** A request is due no later than its operator's reserve before the end-to-end deadline. *)
Theorem e3_budget : E3_budget tr.
Proof.
  intros t a due r p x B Z (d & I & A). destruct d as [n u [e|]| | | |n u q e| | | | | |]; cbn in A; try tauto.
  destruct A as (-> & -> & ->). eapply request_within; eauto.
Qed.
Lemma ends_all t a due r : budgeted tr t a due r -> forall p x, says tr (arms t p x) -> x <= ends a due r.
Proof.
  intros B p x (e & I & A). unfold ends. destruct e as [n u [y|]| | | |n u q y| | | | | |]; cbn in A; try contradiction.
  - destruct A as (-> & _ & ->). destruct B as [(d & Op & D) _].
    destruct (s_opened _ _ S _ _ _ I) as (d' & G & E & _). apply open_inputs_in in G.
    rewrite Op in G. destruct G as [[= <- <-]|[]]. cbn in E. injection E as ->. unfold due_at. lia.
  - destruct A as (-> & -> & ->). apply (request_within t a due r _ _ _ B) in I. lia.
Qed.
(** Each message that an operator takes in leads to exactly one last item, by the end of its deadlines. *)
Theorem e1_one_item : E1_one_item cfg tr.
Proof.
  intros t a due r late B P C. assert (K := s_openings _ _ S t). assert (All := ends_all t a due r B).
  assert (B' := B). destruct B' as [(d & Op & D) _]. rewrite Op in K. cbn [length] in K.
  assert (Split := last_split cfg t (decisions tr)). assert (One := at_most_one_end cfg ins t).
  assert (G := reach_good _ _ _ _ (proj1 (run_reach cfg ins))). fold tr in G.
  set (opened_line := fun e => match e with Opened _ u _ => u =? t | _ => false end).
  assert (K2 : (length (filter (is_refusal t) (decisions tr)) + length (filter opened_line (decisions tr)) = 1)%nat).
  { rewrite <- K. generalize (decisions tr). intros l. induction l as [|e l IH]; auto. cbn.
    destruct e as [n u x| | |n u [q|] w| | | | | | |]; cbn; auto; destruct (u =? t); cbn; lia. }
  assert (Opens : says tr (opens t) <-> (0 < length (filter opened_line (decisions tr)))%nat).
  { apply says_filter. intros e. destruct e; cbn; try (split; [discriminate|contradiction]). apply N.eqb_eq. }
  assert (Ends := says_filter tr (retires cfg t) (is_end cfg t) (is_end_iff cfg t)).
  destruct (filter opened_line (decisions tr)) as [|o os] eqn:Fo.
  - (* Its open was refused. *)
    assert (Z : length (filter (is_end cfg t) (decisions tr)) = 0%nat).
    { destruct (length (filter (is_end cfg t) (decisions tr))) eqn:L; auto. exfalso.
      assert (X : says tr (retires cfg t)) by (apply Ends; lia).
      assert (Y : says tr (opens t)).
      { apply (g_opened _ _ _ G). destruct X as (e & I & X). exists e. split; auto. now apply retires_about in X. }
      apply Opens in Y. cbn in Y. lia. }
    cbn in K2. rewrite Z in Split. unfold last_items.
    destruct (filter (is_last cfg t) (decisions tr)) as [|e [|e2 es]] eqn:Fl; cbn in Split; try lia.
    exists e. split; auto.
    assert (I : In e (filter (is_last cfg t) (decisions tr))) by (rewrite Fl; now left).
    assert (Rf : is_refusal t e = true).
    { destruct (is_refusal t e) eqn:R; auto. exfalso. apply filter_In in I as [I Y].
      assert (is_end cfg t e = true).
      { destruct e as [| | |? ? [|] ?| | | | | | |]; cbn in *; auto; congruence. }
      assert (J : In e (filter (is_end cfg t) (decisions tr))) by (apply filter_In; auto).
      destruct (filter (is_end cfg t) (decisions tr)); [contradiction|discriminate]. }
    apply filter_In in I as [I _]. unfold decisions in I. apply in_flat_map in I as (x & I & M).
    destruct x as [n b|x]; [contradiction|]. destruct M as [->|[]].
    destruct e as [| | |n u [q|] w| | | | | | |]; cbn in Rf; try discriminate. apply N.eqb_eq in Rf as ->.
    destruct (s_refused _ _ S _ _ _ I) as (x & H). apply open_inputs_in in H. rewrite Op in H.
    destruct H as [[= <- _]|[]]. cbn. unfold ends. lia.
  - (* It was opened. *)
    assert (So : says tr (opens t)) by (apply Opens; cbn; lia).
    destruct So as (e & Io & So). destruct e as [n u due0| | | | | | | | | |]; cbn in So; try contradiction. subst u.
    destruct (s_opened _ _ S _ _ _ Io) as (d' & Gt & E & Later). assert (Gt' := open_inputs_in _ _ _ _ Gt).
    rewrite Op in Gt'. destruct Gt' as [[= <- <-]|[]]. cbn in E. subst due0. specialize (Later _ eq_refl).
    assert (Ar : says tr (arms t 0 (due_at a d))) by (eexists; split; [exact Io|cbn; auto]).
    destruct (latest_armed _ _ _ _ Ar) as (q & y & Ay & My).
    assert (Ly := All _ _ Ay). destruct (P _ _ _ Ay) as (now & b & Ib & Lb); [lia|].
    destruct (until_input cfg ins now b Ib) as (bs & Cb & In1 & In2).
    assert (Ar' : says (trace_of cfg bs) (arms t 0 (due_at a d))).
    { destruct (In2 _ Io) as [X|X]; [eexists; split; [exact X|cbn; auto]|]. cbn in X. specialize (My _ _ Ar). lia. }
    assert (Rt : says (trace_of cfg bs) (retires cfg t)).
    { apply (p7_retired cfg bs t _ Ar'). intros p x (f & If & Af). rewrite Cb.
      assert (x <= y) by (apply (My p); exists f; auto). lia. }
    destruct Rt as (e & Ie & Re). assert (Le := s_instants _ _ (trace_sound cfg bs) _ Ie). rewrite Cb in Le.
    apply In1 in Ie. assert (Re' := proj2 (is_end_iff cfg t e) Re).
    assert (Pos : (0 < length (filter (is_end cfg t) (decisions tr)))%nat) by (apply Ends; exists e; auto).
    assert (J : In e (last_items cfg t tr)).
    { apply filter_In. split; [unfold decisions; apply in_flat_map; exists (Did e); split; [auto|now left]|].
      destruct e as [| | |? ? [|] ?| | | | | | |]; cbn in *; auto; discriminate. }
    assert (Len : length (last_items cfg t tr) = 1%nat) by (unfold last_items; cbn in K2; lia).
    destruct (last_items cfg t tr) as [|f [|f2 fs]]; cbn in Len; try discriminate.
    destruct J as [<-|[]]. exists f. split; auto. lia.
Qed.
End Of.

(** ** Two in a row *)
(** The second of two operators in a row has one last item for a message, by the end-to-end deadline if the reserves suffice. *)
Theorem e2_by_the_deadline cfg1 cfg2 ins1 ins2 : E2_by_the_deadline cfg1 cfg2 (trace_of cfg1 ins1) (trace_of cfg2 ins2).
Proof.
  intros t u a b due r1 r2 late gap B1 P1 C1 H B2 P2 C2.
  destruct (e1_one_item cfg1 ins1 t a due r1 late B1 P1 C1) as (d1 & L1 & T1). specialize (H d1 L1).
  destruct (e1_one_item cfg2 ins2 u b due r2 late B2 P2 C2) as (d2 & L2 & T2).
  exists d2. unfold ends in *. split; [auto|]. split; [lia|]. intros. lia.
Qed.
