(** * P13 as patient *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Kept Runs Ticks.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** The progressive state beside a patient one: the best that is held was sent, and what it outranks has ended *)
Definition beyond (best : option N) (p : N) : bool := match best with Some m => m <? p | None => true end.
Definition shadow (sl : slot) : slot :=
  let best := greatest (cached sl) in
  {| requested := requested sl; pending := filter (beyond best) (pending sl);
     cached := match best with Some m => [m] | None => [] end;
     armed := filter (fun e => beyond best (fst e)) (armed sl) |}.
Definition shadows (l : list (N * slot)) : list (N * slot) := map (fun e => (fst e, shadow (snd e))) l.
Definition beside (s : state) : state :=
  {| clock := clock s; newest := newest s; shut := shut s; opened := shadows (opened s) |}.

Lemma lookup_shadows t l : lookup t (shadows l) = option_map shadow (lookup t l).
Proof. induction l as [|[u sl] l IH]; cbn; auto. destruct (u =? t); auto. Qed.
Lemma replace_shadows t o l : replace t (option_map shadow o) (shadows l) = shadows (replace t o l).
Proof.
  induction l as [|[u sl] l IH]; cbn; auto. destruct (u =? t); [destruct o; reflexivity|]. cbn. f_equal. exact IH.
Qed.
Lemma filter_twice {A} (f g h : A -> bool) l : (forall x, In x l -> g x && f x = h x) ->
  filter f (filter g l) = filter h l.
Proof.
  induction l as [|x l IH]; cbn; intros H; auto. assert (Hx := H x (or_introl eq_refl)).
  rewrite <- Hx. destruct (g x); cbn; rewrite IH by auto; auto.
Qed.
Lemma filter_same {A} (f h : A -> bool) l : (forall x, In x l -> f x = h x) -> filter f l = filter h l.
Proof. intros H. now apply filter_ext_in. Qed.
Lemma filter_all {A} (f : A -> bool) l : (forall x, In x l -> f x = true) -> filter f l = l.
Proof. induction l as [|x l IH]; cbn; intros H; auto. rewrite (H x), IH; auto. Qed.
Lemma filter_add {A} (key : A -> N) best x l : beyond best (key x) = true ->
  filter (fun e => beyond best (key e)) (add key x l) = add key x (filter (fun e => beyond best (key e)) l).
Proof.
  intros B. induction l as [|y l IH]; cbn; [now rewrite B|]. destruct (N.ltb_spec (key x) (key y)) as [L|L]; cbn.
  - rewrite B. assert (Y : beyond best (key y) = true).
    { destruct best as [m|]; auto. cbn in *. apply N.ltb_lt in B. apply N.ltb_lt. lia. }
    rewrite Y. cbn. apply N.ltb_lt in L. now rewrite L.
  - rewrite IH. destruct (beyond best (key y)); cbn; auto. apply N.ltb_ge in L. now rewrite L.
Qed.
Lemma greatest_is l m : In m l -> (forall q, In q l -> q <= m) -> greatest l = Some m.
Proof.
  intros I M. destruct (greatest l) as [n|] eqn:G.
  - apply greatest_some in G as [J K]. specialize (M n J). specialize (K m I). f_equal. lia.
  - apply greatest_none in G. subst. contradiction.
Qed.

Section Of.
Variables (window : N) (cs : list cloud).
Let pat : config := {| Words.window := window; rule := Patient; clouds := cs |}.
Let pro : config := {| Words.window := window; rule := Progressive; clouds := cs |}.

(** ** F4 to F6 *)
Lemma shadow_close ps qs sl : (forall q, In q qs <-> In q ps /\ beyond (greatest (cached sl)) q = true) ->
  shadow (close ps sl) = close qs (shadow sl).
Proof.
  intros Q. unfold shadow, close. cbn. set (best := greatest (cached sl)) in *.
  assert (E : forall q, beyond best q = true -> mem q qs = mem q ps).
  { intros q B. destruct (mem q ps) eqn:M.
    - apply mem_iff, Q. split; auto. now apply mem_iff.
    - apply mem_not. rewrite Q. apply mem_not in M. tauto. }
  f_equal.
  - rewrite (filter_twice _ _ (fun q => negb (mem q ps) && beyond best q)) by auto.
    symmetry. apply filter_twice. intros q _. destruct (beyond best q) eqn:B; cbn; [rewrite (E q B);
      now rewrite andb_true_r|now rewrite andb_false_r].
  - rewrite (filter_twice _ _ (fun e => negb (mem (fst e) ps) && beyond best (fst e))) by auto.
    symmetry. apply filter_twice. intros q _. destruct (beyond best (fst q)) eqn:B; cbn; [rewrite (E _ B);
      now rewrite andb_true_r|now rewrite andb_false_r].
Qed.
Lemma no_common_cancels now t l : patient_ends (map (Cancel now t) l) = [] /\
  progressive_ends (map (Cancel now t) l) = [].
Proof. unfold patient_ends, progressive_ends. split; induction l; auto. Qed.
Lemma settle_shadow now t timer sl : exists ds,
  settle pro now t timer (shadow sl) = (option_map shadow (fst (settle pat now t timer sl)), ds) /\
  progressive_ends ds = patient_ends (snd (settle pat now t timer sl)).
Proof.
  unfold settle. cbn [is_progressive pat pro rule is_eager]. unfold shadow at 1 2. cbn [pending cached].
  destruct (greatest (cached sl)) as [m|] eqn:G.
  - change (beyond (Some m)) with (N.ltb m). replace (greatest [m]) with (Some m) by reflexivity.
    destruct (any_above m (pending sl)) eqn:A; cbn [negb orb andb].
    + apply above_iff in A as (q & Q & L). destruct (filter (N.ltb m) (pending sl)) as [|x l] eqn:F.
      * assert (X := filter_nil _ _ F q Q). apply N.ltb_lt in L. cbn in X. congruence.
      * eexists. split; reflexivity.
    + rewrite above_not in A. destruct (filter (N.ltb m) (pending sl)) as [|x l] eqn:F.
      * eexists. split; [reflexivity|]. cbn. unfold patient_ends in *.
        now rewrite (proj1 (no_common_cancels now t _)).
      * assert (X : In x (filter (N.ltb m) (pending sl))) by (rewrite F; now left). apply filter_In in X as [X Y].
        apply N.ltb_lt in Y. specialize (A x X). lia.
  - assert (F : filter (fun _ : N => true) (pending sl) = pending sl) by (apply filter_all; auto).
    change (beyond None) with (fun _ : N => true). rewrite F.
    destruct (pending sl) as [|x l] eqn:P; eexists; split; reflexivity.
Qed.

(** What closes only what the best outranks changes nothing beside, and keeps patient waiting. *)
Lemma shadow_below ps sl : slot_ok pat sl -> (forall q, In q ps -> beyond (greatest (cached sl)) q = false) ->
  ps <> [] -> forall now t timer, settle pat now t timer (close ps sl) = (Some (close ps sl), []) /\
  shadow (close ps sl) = shadow sl.
Proof.
  intros O B NE now t timer. split.
  - unfold settle. cbn [is_progressive pat rule is_eager close cached pending].
    destruct (greatest (cached sl)) as [m|] eqn:G.
    + apply greatest_some in G as [M _]. destruct (ok_prompt _ _ O m M) as (q & Q & L).
      assert (A : any_above m (filter (fun q0 => negb (mem q0 ps)) (pending sl)) = true).
      { apply above_iff. exists q. split; auto. apply filter_In. split; auto. apply negb_true_iff, mem_not. intros I.
        apply B in I. cbn in I. apply N.ltb_ge in I. lia. }
      now rewrite A.
    + destruct ps as [|p ps]; [now elim NE|]. specialize (B p (or_introl eq_refl)). discriminate.
  - rewrite (shadow_close ps []).
    + unfold close, shadow. cbn. f_equal; apply filter_all; auto.
    + intros q. split; [intros []|]. intros [I C]. rewrite (B q I) in C. discriminate.
Qed.

(** ** F5 *)
Lemma timers_shadows x l : In x (timers (shadows l)) -> In x (timers l).
Proof.
  destruct x as [d t]. rewrite !timers_in. intros (sl & p & I & A). apply in_map_iff in I as ([u y] & [= <- <-] & I).
  cbn in *. apply filter_In in A as [A _]. eauto.
Qed.
Lemma earliest_is l x : In x l -> (forall y, In y l -> fst x < fst y \/ fst x = fst y /\ snd x <= snd y) ->
  earliest l = Some x.
Proof.
  intros I M. destruct (earliest l) as [y|] eqn:E.
  - apply earliest_some in E as [J K]. specialize (M y J). specialize (K x I). f_equal. destruct x, y. cbn in *.
    f_equal; lia.
  - apply earliest_none in E. subst. contradiction.
Qed.
Lemma slot_of_beside s t sl : lookup t (opened s) = Some sl -> slot_of (beside s) t = shadow sl.
Proof. intros L. unfold slot_of. cbn. rewrite lookup_shadows, L. reflexivity. Qed.
Lemma replace_same t sl sl' l : lookup t l = Some sl -> shadow sl' = shadow sl ->
  shadows (replace t (Some sl') l) = shadows l.
Proof.
  intros L E. induction l as [|[u x] l IH]; cbn in *; [discriminate|]. destruct (u =? t).
  - injection L as ->. cbn. now rewrite E.
  - cbn. f_equal. auto.
Qed.
Lemma fired_shadow due sl q : In q (fired due (shadow sl)) <->
  In q (fired due sl) /\ beyond (greatest (cached sl)) q = true.
Proof. rewrite !fired_in. cbn. rewrite filter_In. tauto. Qed.
Lemma timer_lines now t ps : patient_ends (map (Timer now t) ps) = [] /\ progressive_ends (map (Timer now t) ps) = [].
Proof. unfold patient_ends, progressive_ends. split; induction ps; auto. Qed.
Lemma patient_app a b : patient_ends (a ++ b) = patient_ends a ++ patient_ends b.
Proof. apply flat_map_app. Qed.
Lemma progressive_app a b : progressive_ends (a ++ b) = progressive_ends a ++ progressive_ends b.
Proof. apply flat_map_app. Qed.

(** Whether a timer of a cloud fired matters to eager alone. *)
Lemma any_timer now t a b sl : settle pro now t a sl = settle pro now t b sl.
Proof. reflexivity. Qed.

Lemma fires_shadow s s' ds : fires pat (clock s) s s' ds -> forall tr b, reach pat tr s (Some b) -> exists es,
  fires pro (clock s) (beside s) (beside s') es /\ progressive_ends es = patient_ends ds.
Proof.
  intros F. remember (clock s) as c eqn:C. induction F as [s H|s due t s1 ds1 s2 ds2 E D U F IH]; intros tr b R.
  - exists []. split; auto. constructor. intros due t X. apply earliest_some in X as [I _]. cbn [beside opened] in I.
    apply timers_shadows in I. destruct (earliest (timers (opened s))) as [[e u]|] eqn:Y.
    + apply earliest_some in Y as [_ M]. specialize (M _ I). specialize (H e u eq_refl). cbn in M. lia.
    + apply earliest_none in Y. rewrite Y in I. contradiction.
  - assert (G := reach_good _ _ _ _ R). destruct (due_lookup _ _ _ _ _ G E) as (sl & p & L & A).
    assert (O := g_slot _ _ _ G t sl L). subst c.
    assert (R1 := at_firing pat tr s b due t s1 ds1 R E D U). assert (C1 : clock s = clock s1).
    { unfold update in U. injection U as <- _. reflexivity. }
    destruct (IH C1 _ b R1) as (es & F2 & V2). rewrite (slot_of_open _ _ _ L) in U. unfold fire in U.
    destruct (fired due (shadow sl)) as [|q qs] eqn:Q.
    + destruct (shadow_below (fired due sl) sl O) with (now := clock s) (t := t)
        (timer := existsb (fun p => negb (p =? 0)) (fired due sl)) as [St Sh].
      * intros q I. destruct (beyond (greatest (cached sl)) q) eqn:B; auto. exfalso.
        assert (X : In q (fired due (shadow sl))) by (apply fired_shadow; auto). rewrite Q in X. contradiction.
      * intros Z. apply fired_in in A. rewrite Z in A. contradiction.
      * rewrite St in U. unfold update in U. cbn in U. injection U as <- <-. exists es.
        rewrite app_nil_r, patient_app.
        rewrite (proj1 (timer_lines _ _ _)). split; auto.
        replace (beside s) with (beside (set_opened (replace t (Some (close (fired due sl) sl)) (opened s)) s)); auto.
        unfold beside, set_opened. cbn. f_equal. now apply (replace_same t sl).
    + destruct (settle_shadow (clock s) t (existsb (fun p => negb (p =? 0)) (fired due sl)) (close (fired due sl)
        sl)) as (e2 & S2 & V).
      destruct (settle pat _ _ _ _) as [o e1]. cbn [fst snd] in S2, V. injection U as <- <-.
      exists ((map (Timer (clock s) t) (fired due (shadow sl)) ++ e2) ++ es). split.
      * apply (f_more pro (clock s) _ due t (beside (set_opened (replace t o (opened s)) s))); auto.
        -- apply earliest_is.
           ++ apply timers_in. exists (shadow sl), q. split.
              ** apply in_map_iff. exists (t, sl). split; auto. now apply lookup_in.
              ** assert (X : In q (fired due (shadow sl))) by (rewrite Q; now left). now apply fired_in in X.
           ++ intros y Y. apply timers_shadows in Y. now apply earliest_some in E as [_ M]; apply M.
        -- rewrite (slot_of_beside _ _ _ L). unfold fire. cbn [beside clock].
           rewrite <- (shadow_close (fired due sl) (fired due (shadow sl)) sl) by (intros; apply fired_shadow).
           rewrite (any_timer _ _ _ (existsb (fun p => negb (p =? 0)) (fired due sl))), S2. unfold update. cbn.
           unfold beside, set_opened. cbn. now rewrite replace_shadows.
      * rewrite !progressive_app, !patient_app, V, V2.
        now rewrite (proj1 (timer_lines _ _ _)), (proj2 (timer_lines _ _ _)).
Qed.

(** ** F1 to F4 *)
Lemma above_best p l : any_above p (match greatest l with Some m => [m] | None => [] end) = any_above p l.
Proof.
  destruct (greatest l) as [m|] eqn:G.
  - apply greatest_some in G as [I M]. cbn. rewrite orb_false_r. destruct (N.ltb_spec p m) as [L|L].
    + symmetry. apply above_iff. eauto.
    + symmetry. apply above_not. intros q Q. specialize (M q Q). lia.
  - apply greatest_none in G. now subst.
Qed.
Lemma admit_shadow p due sl : slot_ok pat sl -> ~ In p (requested sl) -> any_above p (cached sl) = false ->
  shadow (join p due sl) = join p due (shadow sl).
Proof.
  intros O N A. assert (B : beyond (greatest (cached sl)) p = true).
  { destruct (greatest (cached sl)) as [m|] eqn:G; auto. apply greatest_some in G as [I _]. rewrite above_not in A.
    specialize (A m I). cbn. apply N.ltb_lt. assert (m <> p) by (intros ->; apply N; now apply (ok_cached _ _ O)).
    lia. }
  unfold shadow, join. cbn. f_equal.
  - apply (filter_add id (greatest (cached sl)) p (pending sl)). exact B.
  - apply (filter_add fst (greatest (cached sl)) (p, due) (armed sl)). exact B.
Qed.
Lemma shadows_length l : length (shadows l) = length l.
Proof. apply map_length. Qed.

Lemma hold_shadow p sl : greatest (p :: cached sl) = Some p -> beyond (greatest (cached sl)) p = true ->
  shadow (hold pat p sl) = {| requested := requested sl; pending := filter (N.ltb p) (filter (beyond (greatest
    (cached sl))) (pending sl));
    cached := [p]; armed := filter (fun e => p <? fst e) (filter (fun e => beyond (greatest (cached sl)) (fst e))
      (armed sl)) |}.
Proof.
  intros G B. assert (G2 : greatest (cached (hold pat p sl)) = Some p).
  { apply greatest_some in G as [_ M]. apply greatest_is; cbn; [apply add_in; auto|]. intros q I.
    apply add_in in I as [->|I]; [unfold id; lia|].
    apply M. now right. }
  assert (K : forall q, beyond (greatest (cached sl)) q && (p <? q) = (p <? q)).
  { intros q. destruct (N.ltb_spec p q) as [L|L]; [|apply andb_false_r]. rewrite andb_true_r.
    destruct (greatest (cached sl)); auto. cbn in *. apply N.ltb_lt in B. apply N.ltb_lt. lia. }
  assert (K2 : forall q, negb (q =? p) && (p <? q) = (p <? q)).
  { intros q. destruct (N.eqb_spec q p) as [->|]; cbn; auto. symmetry. apply N.ltb_irrefl. }
  unfold shadow. rewrite G2. cbn [requested pending cached armed hold is_patient pat rule]. rewrite orb_true_r.
  f_equal.
  - rewrite (filter_twice _ _ (N.ltb p)) by (intros; apply K2). symmetry. apply filter_twice. intros; apply K.
  - rewrite (filter_twice _ _ (fun e => p <? fst e)) by (intros; apply K2). symmetry. apply filter_twice.
    intros; apply K.
Qed.

Lemma slot_beside s t : slot_of (beside s) t = shadow (slot_of s t).
Proof. unfold slot_of. cbn. rewrite lookup_shadows. destruct (lookup t (opened s)); reflexivity. Qed.
Lemma open_beside s t : is_open (beside s) t = is_open s t.
Proof. unfold is_open. cbn. rewrite lookup_shadows. destruct (lookup t (opened s)); reflexivity. Qed.
Lemma update_beside s t o ds es : update (beside s) t (option_map shadow o, es) = (beside (fst (update s t (o,
  ds))), es).
Proof. unfold update. cbn. unfold beside, set_opened. cbn. now rewrite replace_shadows. Qed.
Lemma update_unchanged s t sl sl' ds : lookup t (opened s) = Some sl -> shadow sl' = shadow sl ->
  beside (fst (update s t (Some sl', ds))) = beside s.
Proof. intros L E. unfold update, beside, set_opened. cbn. f_equal. now apply (replace_same t sl). Qed.

(** What patient drops progressive drops; what patient takes, it takes if it is beyond the best, and drops else. *)
Lemma drops_shadow s t p : (forall sl, lookup t (opened s) = Some sl -> slot_ok pat sl) ->
  match first_reason (f3_reasons pat s t p) with
  | Some _ => first_reason (f3_reasons pro (beside s) t p) <> None
  | None => (first_reason (f3_reasons pro (beside s) t p) = None <->
    beyond (greatest (cached (slot_of s t))) p = true)
  end.
Proof.
  intros Ok. unfold f3_reasons. rewrite slot_beside, open_beside. cbn [is_progressive pat pro rule andb].
  change (reached (beside s) t) with (reached s t). change (is_cloud pro p) with (is_cloud pat p).
  rewrite orb_false_r.
  cbn [first_reason]. destruct (negb (_ && _)); [discriminate|]. unfold is_open, slot_of.
  destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [negb orb]; [|discriminate]. specialize (Ok sl eq_refl).
  cbn [shadow requested pending cached]. rewrite above_best.
  assert (B : beyond (greatest (cached sl)) p = true <-> any_above p (cached sl) = false /\ ~ In p (cached sl)).
  { destruct (greatest (cached sl)) as [m|] eqn:G; cbn.
    - apply greatest_some in G as [I M]. rewrite above_not, N.ltb_lt. split.
      + intros X. split; [intros q Q; specialize (M q Q); lia|intros Q; specialize (M p Q); lia].
      + intros [A N]. specialize (A m I). assert (m <> p) by congruence. lia.
    - apply greatest_none in G. rewrite G. cbn. tauto. }
  assert (D : mem p (match greatest (cached sl) with Some m => [m] | None => [] end) = true -> In p (cached sl)).
  { intros D. apply mem_iff in D. destruct (greatest (cached sl)) as [m|] eqn:G; [|contradiction].
    destruct D as [<-|[]].
    now apply greatest_some in G. }
  set (twice := mem p (match greatest (cached sl) with Some m => [m] | None => [] end)) in *.
  assert (Pe : mem p (filter (beyond (greatest (cached sl))) (pending sl)) = mem p (pending sl) &&
    beyond (greatest (cached sl)) p).
  { apply eq_true_iff_eq. rewrite andb_true_iff, !mem_iff, filter_In. tauto. }
  rewrite Pe. destruct (mem p (requested sl)) eqn:M1; cbn [negb].
  2:{ destruct (any_above p (cached sl)); discriminate. }
  destruct (mem p (cached sl)) eqn:M2.
  - apply mem_iff in M2. destruct (any_above p (cached sl)) eqn:A; [discriminate|]. destruct twice; [discriminate|].
    assert (Z : beyond (greatest (cached sl)) p = false) by (destruct (beyond _ p); auto; destruct B as [B _];
      specialize (B eq_refl); tauto).
    rewrite Z, andb_false_r. discriminate.
  - apply mem_not in M2. destruct twice; [now elim M2; apply D|].
    destruct (mem p (pending sl)) eqn:M3; cbn [negb andb].
    + destruct (any_above p (cached sl)) eqn:A.
      * split; [discriminate|]. intros X. apply B in X. destruct X. discriminate.
      * assert (Z : beyond (greatest (cached sl)) p = true) by (apply (proj2 B); auto). rewrite Z. tauto.
    + destruct (any_above p (cached sl)); discriminate.
Qed.
Lemma below_not s sl p : slot_ok pat sl -> In p (pending sl) -> beyond (greatest (cached sl)) p = false ->
  exists m q, greatest (cached sl) = Some m /\ p < m /\ In q (pending sl) /\ m < q /\ clock s = clock s.
Proof.
  intros O P B. destruct (greatest (cached sl)) as [m|] eqn:G; [|discriminate]. cbn in B. apply N.ltb_ge in B.
  apply greatest_some in G as [I _]. destruct (ok_prompt _ _ O m I) as (q & Q & L). exists m, q. repeat split; auto.
  assert (p <> m) by (intros ->; now apply (ok_apart _ _ O m)). lia.
Qed.

Lemma apply_shadow tr s b : good pat tr s -> exists es,
  apply pro (beside s) b = (beside (fst (apply pat s b)), es) /\
    progressive_ends es = patient_ends (snd (apply pat s b)).
Proof.
  intros G. assert (Ok := fun t => g_slot _ _ _ G t). destruct b as [t d|t p d bl|t p|t p|]; cbn [apply].
  - unfold open. assert (E : f1_reasons pro (beside s) t d = f1_reasons pat s t d)
      by (unfold f1_reasons; cbn; now rewrite shadows_length).
    rewrite E. destruct (first_reason _); [eexists; split; reflexivity|]. eexists. split.
    + unfold beside. cbn. unfold shadows. rewrite map_app. cbn. destruct d; reflexivity.
    + reflexivity.
  - unfold offer. assert (E : f2_reasons pro (beside s) t p d = f2_reasons pat s t p d).
    { unfold f2_reasons. rewrite slot_beside, open_beside. cbn [requested cached shadow]. now rewrite above_best. }
    rewrite E. destruct (first_reason (f2_reasons pat s t p d)) eqn:F; [eexists; split; reflexivity|].
    apply f2_none in F as (sl & L & N & A & _ & _). change (gate_shut pro (beside s) p bl) with (gate_shut pat s p
      bl).
    destruct (gate_shut pat s p bl); [eexists; split; reflexivity|]. rewrite slot_beside, (slot_of_open _ _ _ L).
    change (set_gate p false (beside s)) with (beside (set_gate p false s)). change (clock (beside s)) with (clock s).
    rewrite <- (admit_shadow p _ sl (Ok t sl L) N A).
    change (Some (shadow (join p (due_at (clock s) d) sl))) with (option_map shadow (Some (join p (due_at (clock s)
      d) sl))).
    eexists. split; [apply update_beside|reflexivity].
  - unfold arrive. assert (D := drops_shadow s t p (Ok t)). destruct (first_reason (f3_reasons pat s t p)) eqn:F.
    { destruct (first_reason (f3_reasons pro (beside s) t p)); [eexists; split; reflexivity|now elim D]. }
    apply f3_none in F as (sl & L & P & Rq & NC & _). rewrite slot_beside. rewrite (slot_of_open _ _ _ L) in *.
    assert (O := Ok t sl L). unfold result. cbn [is_progressive pat pro rule].
    destruct (beyond (greatest (cached sl)) p) eqn:B.
    + rewrite (proj2 D eq_refl). assert (Gr : greatest (p :: cached sl) = Some p).
      { apply greatest_is; [now left|]. intros q [<-|Q]; [lia|]. destruct (greatest (cached sl)) as [m|] eqn:Gm.
        - apply greatest_some in Gm as [_ M]. specialize (M q Q). cbn in B. apply N.ltb_lt in B. lia.
        - apply greatest_none in Gm. rewrite Gm in Q. contradiction. }
      assert (Lo : forall q, p < q -> beyond (greatest (cached sl)) q = true).
      { intros q X. destruct (greatest (cached sl)); auto. cbn in *. apply N.ltb_lt in B. apply N.ltb_lt. lia. }
      unfold improve. cbn [pending cached armed requested shadow]. change (clock (beside s)) with (clock s).
      destruct (any_above p (pending sl)) eqn:A.
      * apply above_iff in A as (w & W & Lw). destruct (filter (N.ltb p) (filter _ (pending sl))) as [|x l] eqn:Fl.
        { exfalso. assert (X : In w (filter (beyond (greatest (cached sl))) (pending sl))) by (apply filter_In; auto).
          assert (Y := filter_nil _ _ Fl w X). apply N.ltb_lt in Lw. cbn in Y. congruence. }
        rewrite <- Fl, <- (hold_shadow p sl Gr B).
        change (Some (shadow (hold pat p sl))) with (option_map shadow (Some (hold pat p sl))).
        eexists. split; [apply update_beside|]. cbn. apply no_common_cancels.
      * rewrite above_not in A. destruct (filter (N.ltb p) (filter _ (pending sl))) as [|x l] eqn:Fl.
        2:{ exfalso. assert (X : In x (x :: l)) by now left. rewrite <- Fl, !filter_In, N.ltb_lt in X.
            destruct X as [[X _] Y]. specialize (A x X). lia. }
        change (@None slot) with (option_map shadow None) at 1. eexists. split; [apply update_beside|].
        unfold forward. cbn. rewrite progressive_app, (proj2 (no_common_cancels _ _ _)).
        unfold patient_ends. cbn. fold (patient_ends (map (Cancel (clock s) t) (clouds_of (filter (fun q => negb ((q
          =? p) || false)) (pending sl))))).
        now rewrite (proj1 (no_common_cancels _ _ _)).
    + destruct (first_reason (f3_reasons pro (beside s) t p)) eqn:F2; [|now destruct D as [D _];
        specialize (D eq_refl)].
      destruct (below_not s sl p O P B) as (m & q & Gm & Lp & Q & Lq & _).
      assert (A : any_above p (pending sl) = true) by (apply above_iff; exists q; split; auto; lia). rewrite A.
      rewrite (update_unchanged s t sl); auto; [eexists; split; reflexivity|].
      assert (G2 : greatest (cached (hold pat p sl)) = Some m).
      { apply greatest_some in Gm as [I M]. apply greatest_is; cbn; [apply add_in; auto|]. intros x X.
        apply add_in in X as [->|X]; auto.
        unfold id. lia. }
      unfold shadow. rewrite G2, Gm. cbn [requested pending cached armed hold is_patient pat rule].
      rewrite orb_true_r. f_equal.
      * apply filter_twice. intros x _. cbn. destruct (N.eqb_spec x p) as [->|]; cbn; auto. symmetry.
        apply N.ltb_ge. lia.
      * apply filter_twice. intros x _. cbn. destruct (N.eqb_spec (fst x) p) as [->|]; cbn; auto. symmetry.
        apply N.ltb_ge. lia.
  - unfold arrive. assert (D := drops_shadow s t p (Ok t)). destruct (first_reason (f3_reasons pat s t p)) eqn:F.
    { destruct (first_reason (f3_reasons pro (beside s) t p)); [eexists; split; reflexivity|now elim D]. }
    apply f3_none in F as (sl & L & P & Rq & NC & _). rewrite slot_beside. rewrite (slot_of_open _ _ _ L) in *.
    assert (O := Ok t sl L). unfold fail. destruct (beyond (greatest (cached sl)) p) eqn:B.
    + rewrite (proj2 D eq_refl). change (clock (beside s)) with (clock s).
      destruct (settle_shadow (clock s) t false (close [p] sl)) as (es & S & V).
      rewrite (shadow_close [p] [p] sl) in S by (intros q; split; [intros [<-|[]]; split;
        [now left|exact B]|intros [I _]; exact I]). rewrite S.
      destruct (settle pat _ _ _ _) as [o e]. cbn [fst snd] in V. eexists.
      split; [apply update_beside|]. cbn. exact V.
    + destruct (first_reason (f3_reasons pro (beside s) t p)) eqn:F2; [|now destruct D as [D _];
        specialize (D eq_refl)].
      destruct (shadow_below [p] sl O) with (now := clock s) (t := t) (timer := false) as [S E].
      * now intros q [<-|[]].
      * discriminate.
      * rewrite S. rewrite (update_unchanged s t sl); auto. eexists. split; reflexivity.
  - eexists. split; reflexivity.
Qed.

(** ** Steps *)
Lemma step_shadow tr s tr2 i : reach pat tr s None -> reach pro tr2 (beside s) None -> exists es,
  step pro (beside s) i = (beside (fst (step pat s i)), es) /\ progressive_ends es = patient_ends (snd (step pat s
    i)).
Proof.
  intros R R2. unfold step. change (set_clock (at_ i) (beside s)) with (beside (set_clock (at_ i) s)).
  assert (R0 := at_input pat tr s (at_ i) (what i) R). assert (R02 := at_input pro tr2 (beside s) (at_ i) (what i)
    R2).
  change (set_clock (at_ i) (beside s)) with (beside (set_clock (at_ i) s)) in R02.
  set (s0 := set_clock (at_ i) s) in *.
  destruct (expire _ pat s0) as [s1 ds1] eqn:E. destruct (expire _ pro (beside s0)) as [u1 es1] eqn:E2.
  destruct (expire_reach pat _ _ s0 s1 ds1 (what i) R0 (le_n _) E) as (R1 & _ & _).
  apply (expire_fires pat _ _ _ _ _ _ R0 (le_n _)) in E. apply (expire_fires pro _ _ _ _ _ _ R02 (le_n _)) in E2.
  destruct (fires_shadow _ _ _ E _ _ R0) as (es & F & V). change (clock (beside s0)) with (clock s0) in E2.
  destruct (fires_one _ _ _ _ _ E2 _ _ F) as [-> ->].
  destruct (apply_shadow _ s1 (what i) (reach_good _ _ _ _ R1)) as (e2 & -> & V2).
  destruct (apply pat s1 (what i)) as [s2 ds2]. cbn [fst snd] in *. eexists. split; [reflexivity|].
  now rewrite progressive_app, patient_app, V, V2.
Qed.

(* ANCHOR: P13 *)
(** On the same inputs progressive decides, input by input, what patient decides: it opens,
    admits and refuses the same
    for the same reasons, and retires the same timestamps, each with the output that patient forwards as its last. *)
Theorem p13_as_patient ins : forall i,
  let s := state_after pat ins in
  state_after pro ins = beside s /\
  progressive_ends (snd (step pro (state_after pro ins) i)) = patient_ends (snd (step pat s i)).
(* ANCHOR_END: P13 *)
Proof.
  assert (X : forall l s tr tr2, reach pat tr s None -> reach pro tr2 (beside s) None ->
    exists tr3 tr4, fst (run pro (beside s) tr2 l) = beside (fst (run pat s tr l)) /\
    reach pat tr3 (fst (run pat s tr l)) None /\ reach pro tr4 (beside (fst (run pat s tr l))) None).
  { induction l as [|j l IH]; intros s tr tr2 R R2; cbn; [eauto|].
    destruct (step_shadow tr s tr2 j R R2) as (es & S2 & _). rewrite S2.
    destruct (step pat s j) as [s1 ds1] eqn:S. cbn [fst] in *.
    apply IH; [apply (step_reach pat tr s j s1 ds1 R S)|].
    apply (step_reach pro tr2 (beside s) j (beside s1) es R2 S2). }
  intros i s. destruct (X ins initial [] [] (at_start pat) (at_start pro)) as (tr3 & tr4 & E & R & R2).
  change (beside initial) with initial in E. unfold state_after in *. fold s in E, R, R2. rewrite E. split; auto.
  destruct (step_shadow tr3 s tr4 i R R2) as (es & -> & V). exact V.
Qed.
End Of.
