(** * What each line says of the trace before it: F1's order, F2 with its gate, F7, and P8's live timers *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** Lines one by one *)
Definition each (P : trace -> decision -> Prop) (tr : trace) : Prop := forall later d earlier,
  tr = later ++ Did d :: earlier -> P earlier d.
Lemma each_got (P : trace -> decision -> Prop) now b tr : each P tr -> each P (Got now b :: tr).
Proof. intros H later d earlier E. destruct later as [|x later]; [discriminate|]. injection E as _ E. eauto. Qed.
Lemma each_did (P : trace -> decision -> Prop) d tr : P tr d -> each P tr -> each P (Did d :: tr).
Proof. intros D H later e earlier E. destruct later as [|x later]; injection E as X E; subst; eauto. Qed.
Lemma after_one d ds tr : after (d :: ds) tr = after ds (Did d :: tr).
Proof. change (d :: ds) with ([d] ++ ds). now rewrite after_app. Qed.
Lemma each_after (P : trace -> decision -> Prop) ds : forall tr, (forall a d b, ds = a ++ d :: b -> P (after a tr) d) -> each P tr ->
  each P (after ds tr).
Proof.
  induction ds as [|d ds IH]; intros tr H T; auto. rewrite after_one. apply IH.
  - intros a e b ->. specialize (H (d :: a) e b eq_refl). now rewrite after_one in H.
  - apply each_did; auto. exact (H [] d ds eq_refl).
Qed.

(** ** What is kept *)
Definition shut_by (c : cloud) (was : bool) (backlog : N) : bool :=
  if was then negb (backlog <=? resume c) else limit c <=? backlog.
Definition gate_law (cfg : config) (earlier : trace) (t p : N) (refused : bool) : Prop := forall x backlog c,
  input_of earlier = Some (Offer t p x backlog) -> registered cfg p = Some c ->
  shut_by c (gate_of p earlier) backlog = refused.
Definition line_ok (cfg : config) (earlier : trace) (d : decision) : Prop :=
  match d with
  | Opened _ t _ => forall u, says earlier (opens u) -> u < t
  | Refuse _ t None Order => exists u, t <= u /\ says earlier (opens u)
  | Request _ t p _ =>
      is_cloud cfg p = true /\ (forall q, says earlier (accepts t q) -> q < p) /\ gate_law cfg earlier t p false
  | Refuse _ t (Some p) Queue => gate_law cfg earlier t p true
  | Cancel _ _ p => p <> 0
  | Timer _ t p => ~ says earlier (disarms cfg t p)
  | _ => True
  end.
Record lines (cfg : config) (tr : trace) (s : state) (cur : option body) : Prop := {
  l_each : each (line_ok cfg) tr;
  l_gate : forall p, gate_of p tr = mem p (shut s);
  l_newest : forall n, newest s = Some n -> says tr (opens n);
  l_armed : forall t sl, lookup t (opened s) = Some sl -> NoDup (map fst (armed sl));
  l_input : forall b, cur = Some b -> input_of tr = Some b
}.

(** Whether a line moves the gate. *)
Definition moves_gate (d : decision) : bool :=
  match d with Request _ _ _ _ => true | Refuse _ _ (Some _) Queue => true | _ => false end.
Lemma gate_after p ds : forall tr, (forall d, In d ds -> moves_gate d = false) -> gate_of p (after ds tr) = gate_of p tr.
Proof.
  induction ds as [|d ds IH]; intros tr H; auto. rewrite after_one, IH by (intros; apply H; now right).
  specialize (H d (or_introl eq_refl)). destruct d as [| | |n t [q|] []| | | | | | |]; cbn in *; auto; discriminate.
Qed.
Lemma input_after ds : forall tr, input_of (after ds tr) = input_of tr.
Proof. induction ds as [|d ds IH]; intros tr; auto. now rewrite after_one, IH. Qed.
Lemma says_more ds tr X : says tr X -> says (after ds tr) X.
Proof. intros H. apply says_after. auto. Qed.

(** What a firing and what an accepted result or failure decide. *)
Lemma settle_lines cfg now t timer sl o ds earlier : settle cfg now t timer sl = (o, ds) -> forall d, In d ds ->
  moves_gate d = false /\ line_ok cfg earlier d.
Proof.
  intros H d I. apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & E & _)]]].
  - contradiction.
  - destruct I as [<-|[]]. cbn. auto.
  - destruct I as [<-|[]]. cbn. auto.
  - injection E as _ ->. destruct I as [<-|I]; [cbn; auto|]. apply in_map_iff in I as (q & <- & I).
    apply clouds_in in I as [_ Z]. cbn. auto.
Qed.
Lemma result_lines cfg now t p sl earlier d : In d (snd (result cfg now t p sl)) -> moves_gate d = false /\ line_ok cfg earlier d.
Proof.
  assert (C : forall l, In d (map (Cancel now t) (clouds_of l)) -> moves_gate d = false /\ line_ok cfg earlier d).
  { intros l I. apply in_map_iff in I as (q & <- & I). apply clouds_in in I as [_ Z]. cbn. auto. }
  assert (E : forall m, Emit now t m = d -> moves_gate d = false /\ line_ok cfg earlier d) by (intros m <-; cbn; auto).
  unfold result, improve. destruct (is_progressive cfg); [|destruct (any_above p (pending sl))]; cbn [snd fst].
  - destruct (filter (N.ltb p) (pending sl)); cbn [snd]; rewrite ?in_app_iff; cbn [In]; intros I.
    + destruct I as [[I|I]|[<-|[]]]; [eapply E; eauto|eapply C; eauto|cbn; auto].
    + destruct I as [I|I]; [eapply E; eauto|eapply C; eauto].
  - intros [<-|[]]. cbn. auto.
  - intros [I|I]; [eapply E; eauto|eapply C; eauto].
Qed.
Lemma nodup_filter {A B} (f : A -> B) g (l : list A) : NoDup (map f l) -> NoDup (map f (filter g l)).
Proof.
  induction l as [|x l IH]; cbn; auto. intros D. inversion D as [|? ? N D']; subst. destruct (g x); auto. cbn.
  constructor; auto. intros I. apply N. apply in_map_iff in I as (y & <- & I). apply filter_In in I as [I _].
  now apply in_map.
Qed.
Lemma nodup_add p due (l : list (N * N)) : ~ In p (map fst l) -> NoDup (map fst l) ->
  NoDup (map fst (add fst (p, due) l)).
Proof.
  induction l as [|y l IH]; cbn; intros N D; [constructor; auto|]. destruct (p <? fst y); cbn.
  - constructor; auto.
  - inversion D as [|? ? N' D']; subst. constructor; [|apply IH; tauto]. intros I. apply N'.
    apply in_map_iff in I as (z & E & I). apply add_in in I as [->|I]; [cbn in E; elim N; now left|]. rewrite <- E. now apply in_map.
Qed.
Lemma armed_update s t o s' : NoDup (map fst (opened s)) -> opened s' = replace t o (opened s) ->
  (forall u sl, lookup u (opened s) = Some sl -> NoDup (map fst (armed sl))) ->
  (forall sl x, lookup t (opened s) = Some sl -> o = Some x -> NoDup (map fst (armed x))) ->
  forall u sl, lookup u (opened s') = Some sl -> NoDup (map fst (armed sl)).
Proof.
  intros D E H K u sl L. rewrite E in L. destruct (N.eq_dec u t) as [->|Ne].
  - destruct (lookup t (opened s)) as [x|] eqn:Lt.
    + rewrite (lookup_replace t o _ x D Lt) in L. now apply (K x sl).
    + apply lookup_none in Lt. assert (X : lookup t (replace t o (opened s)) = None).
      { apply lookup_none. intros I. apply Lt. now apply replace_keys in I. }
      congruence.
  - rewrite lookup_replace_other in L by auto. eauto.
Qed.

Lemma lines_fire cfg tr s b due t sl s' ds : good cfg tr s -> lines cfg tr s (Some b) -> lookup t (opened s) = Some sl ->
  update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> lines cfg (after ds tr) s' (Some b).
Proof.
  intros G K L U. rewrite (slot_of_open _ _ _ L) in U. unfold fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as <- <-.
  assert (D := l_armed _ _ _ _ K t sl L).
  assert (Df : NoDup (fired due sl)) by now apply nodup_filter.
  assert (Q : forall d, In d (map (Timer (clock s) t) (fired due sl) ++ e) -> moves_gate d = false).
  { intros d I. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (p & <- & _); reflexivity|].
    eapply (settle_lines _ _ _ _ _ _ _ tr Se); eauto. }
  constructor.
  - apply each_after; [|apply (l_each _ _ _ _ K)]. intros a d b' Eq.
    assert (I : In d (map (Timer (clock s) t) (fired due sl) ++ e)) by (rewrite Eq; apply in_elt).
    destruct d as [ | |now u p| | | | | | | | ]; try solve [eapply (settle_lines _ _ _ _ _ _ _ _ Se);
      apply in_app_or in I as [I|I]; [apply in_map_iff in I as (w & [=] & _)|exact I]].
    cbn. intros X. assert (Nt : ~ In (Timer now u p) e).
    { intros J. apply settle_cases in Se as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & F & _)]]].
      - contradiction.
      - destruct J as [[=]|[]].
      - destruct J as [[=]|[]].
      - injection F as _ ->. destruct J as [[=]|J]. apply in_map_iff in J as (w & [=] & _). }
    apply in_app_or in I as [I|I]; [|contradiction]. apply in_map_iff in I as (p' & [= <- <- ->] & I).
    apply says_after in X as [(x & Xa & X)|X].
    + (* an earlier line of the same firing *)
      assert (S : exists ps qs, fired due sl = ps ++ p :: qs /\ a = map (Timer (clock s) t) ps).
      { clear - Eq Nt. revert a Eq. induction (fired due sl) as [|z zs IH]; intros a Eq.
        - cbn in Eq. elim Nt. rewrite Eq. apply in_elt.
        - destruct a as [|y a]; cbn in Eq.
          + injection Eq as -> _. exists [], zs. auto.
          + injection Eq as <- Eq. destruct (IH a Eq) as (ps & qs & -> & ->). exists (z :: ps), qs. auto. }
      destruct S as (ps & qs & P1 & ->). apply in_map_iff in Xa as (z & <- & Z). cbn in X. destruct X as [_ ->].
      rewrite P1 in Df. apply NoDup_remove_2 in Df. apply Df, in_or_app. auto.
    + apply fired_in in I. apply (a_armed _ _ _ _ (g_traced _ _ _ G t sl L)) in I as [_ I]. contradiction.
  - intros p. rewrite gate_after by exact Q. apply (l_gate _ _ _ _ K).
  - intros n N. apply says_more. apply (l_newest _ _ _ _ K n N).
  - apply (armed_update s t o); [apply (g_nodup _ _ _ G)|reflexivity|apply (l_armed _ _ _ _ K)|].
    intros sl0 x L0 ->. apply settle_keeps in Se as ->. now apply nodup_filter.
  - intros c [= <-]. rewrite input_after. now apply (l_input _ _ _ _ K).
Qed.

Lemma mem_set_gate p q (f : bool) s : mem p (shut (set_gate q f s)) = if q =? p then f else mem p (shut s).
Proof.
  unfold set_gate, set_shut. cbn [shut]. assert (X : mem p (filter (fun x => negb (x =? q)) (shut s)) =
    mem p (shut s) && negb (p =? q)).
  { unfold mem. induction (shut s) as [|x l IH]; auto. cbn [filter existsb]. destruct (N.eqb_spec x q) as [->|Ne]; cbn [negb existsb].
    - rewrite IH. destruct (N.eqb_spec p q); cbn; rewrite ?andb_false_r; auto.
    - rewrite IH. destruct (N.eqb_spec p x) as [->|]; cbn; auto. destruct (N.eqb_spec x q); [contradiction|auto]. }
  assert (C : forall l, mem p (q :: l) = (p =? q) || mem p l) by reflexivity.
  destruct f; rewrite ?C, X; destruct (N.eqb_spec q p), (N.eqb_spec p q); try congruence; cbn;
    rewrite ?andb_true_r, ?andb_false_r; auto.
Qed.
(** An input with one decision that moves no gate. *)
Lemma lines_silent cfg tr s s' d b : lines cfg tr s (Some b) -> moves_gate d = false -> line_ok cfg tr d ->
  shut s' = shut s -> newest s' = newest s -> opened s' = opened s -> lines cfg (after [d] tr) s' None.
Proof.
  intros K A L S N O. constructor.
  - apply each_did; auto. apply (l_each _ _ _ _ K).
  - intros p. rewrite gate_after, S; [apply (l_gate _ _ _ _ K)|]. now intros e [<-|[]].
  - intros n E. rewrite N in E. apply says_more. now apply (l_newest _ _ _ _ K).
  - rewrite O. apply (l_armed _ _ _ _ K).
  - discriminate.
Qed.
Lemma first_none rows why holds : first_reason rows = None -> In (why, holds) rows -> holds = false.
Proof.
  induction rows as [|[w h] rows IH]; cbn; [tauto|]. destruct h eqn:H; [discriminate|]. intros F [[= <- <-]|I]; auto.
Qed.
Lemma lines_offer cfg tr s t p x backlog s' ds : good cfg tr s -> lines cfg tr s (Some (Offer t p x backlog)) ->
  offer cfg s t p x backlog = (s', ds) -> lines cfg (after ds tr) s' None.
Proof.
  intros G K. assert (In_ := l_input _ _ _ _ K _ eq_refl). unfold offer. destruct (first_reason _) as [why|] eqn:F.
  - intros [= <- <-]. assert (W : why <> Queue).
    { clear - F. intros ->. cbn in F.
      repeat match type of F with (if ?b then _ else _) = _ => destruct b; try discriminate end. }
    apply (lines_silent cfg tr s s _ _ K); auto; cbn; destruct why; auto; congruence.
  - assert (R := F). apply f2_none in F as (sl & L & NR & A & C & _). rewrite (slot_of_open _ _ _ L).
    assert (T := g_traced _ _ _ G t sl L). assert (O := g_slot _ _ _ G t sl L).
    assert (Law : gate_law cfg tr t p (gate_shut cfg s p backlog)).
    { intros y b0 c E Rc. rewrite In_ in E. injection E as <- <-. unfold gate_shut. rewrite Rc. unfold shut_then, shut_by.
      rewrite (l_gate _ _ _ _ K). assert (X := Rc). unfold registered in X. apply find_some in X as [_ X].
      apply N.eqb_eq in X. now rewrite X. }
    destruct (gate_shut cfg s p backlog) eqn:Sh; intros [= <- <-]; constructor; try discriminate.
    + apply each_did; [exact Law|apply (l_each _ _ _ _ K)].
    + intros q. change (gate_of q (after _ tr)) with (if p =? q then true else gate_of q tr).
      rewrite mem_set_gate, (l_gate _ _ _ _ K). reflexivity.
    + intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
    + intros u sl0 Lu. apply (l_armed _ _ _ _ K u sl0 Lu).
    + apply each_did; [|apply (l_each _ _ _ _ K)]. cbn. split; auto. split; auto. intros q Acc.
      apply (a_got _ _ _ _ T) in Acc as (c & Ic & Le). rewrite above_not in A. specialize (A c Ic).
      assert (c <> p) by (intros ->; apply NR, (ok_cached _ _ O), Ic). lia.
    + intros q. change (gate_of q (after _ tr)) with (if p =? q then false else gate_of q tr).
      unfold update. cbn [fst shut set_opened]. rewrite mem_set_gate, (l_gate _ _ _ _ K). reflexivity.
    + intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
    + eapply (armed_update s t (Some (join p (due_at (clock s) x) sl))); [apply (g_nodup _ _ _ G)|reflexivity| |].
      * apply (l_armed _ _ _ _ K).
      * intros sl0 y L0 [= <-]. cbn. apply nodup_add; [|apply (l_armed _ _ _ _ K t sl L)]. intros I.
        apply in_map_iff in I as ([q d] & E & I). cbn in E. subst q. apply NR. eapply armed_requested; eauto.
Qed.
Lemma lines_apply cfg tr s b s' ds : good cfg tr s -> lines cfg tr s (Some b) -> apply cfg s b = (s', ds) ->
  lines cfg (after ds tr) s' None.
Proof.
  intros G K. destruct b as [t d|t p x bl|t p|t p|]; cbn [apply].
  - unfold open. destruct (first_reason _) as [why|] eqn:F.
    + intros [= <- <-]. apply (lines_silent cfg tr s s _ _ K); auto. cbn. destruct why; auto.
      cbn in F. destruct (reached s t) eqn:Re; [|destruct (window cfg <=? _), d as [e|];
        [discriminate|discriminate|destruct (due_at (clock s) e <=? clock s); discriminate|discriminate]].
      unfold reached in Re. destruct (newest s) as [n|] eqn:N; [|discriminate]. apply N.leb_le in Re.
      exists n. split; auto. now apply (l_newest _ _ _ _ K).
    + intros [= <- <-]. assert (Re : reached s t = false) by (cbn in F; destruct (reached s t); [discriminate|auto]).
      constructor; try discriminate.
      * apply each_did; [|apply (l_each _ _ _ _ K)]. cbn. intros u (y & I & Ou).
        assert (X : reached s u = true) by (apply (g_about _ _ _ G); exists y; split; auto; now apply opens_about in Ou).
        unfold reached in *. destruct (newest s); [|discriminate]. apply N.leb_le in X. apply N.leb_gt in Re. lia.
      * intros p. rewrite gate_after; [apply (l_gate _ _ _ _ K)|]. now intros e [<-|[]].
      * cbn [newest]. intros n [= <-]. eexists. split; [now left|]. cbn. reflexivity.
      * cbn [opened]. intros u sl Lu. rewrite lookup_app in Lu by (intros I; apply (g_reached _ _ _ G) in I; congruence).
        destruct (t =? u); [|now apply (l_armed _ _ _ _ K u)]. injection Lu as <-. cbn.
        destruct d; cbn; repeat constructor; auto.
  - now apply lines_offer.
  - unfold arrive. destruct (first_reason _) as [why|] eqn:F.
    + intros [= <- <-]. apply (lines_silent cfg tr s s _ _ K); auto. cbn. auto.
    + apply f3_none in F as (sl & L & _). rewrite (slot_of_open _ _ _ L). unfold update. intros [= <- <-].
      assert (Q := fun earlier d => result_lines cfg (clock s) t p sl earlier d). constructor; try discriminate.
      * apply each_after; [|apply (l_each _ _ _ _ K)]. intros a d y E. apply Q. rewrite E. apply in_elt.
      * intros q. rewrite gate_after; [apply (l_gate _ _ _ _ K)|]. intros d I. now apply (Q tr).
      * intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
      * eapply (armed_update s t (fst (result cfg (clock s) t p sl))); [apply (g_nodup _ _ _ G)|reflexivity| |].
        -- apply (l_armed _ _ _ _ K).
        -- intros sl0 y L0. rewrite L in L0. injection L0 as <-. assert (D := l_armed _ _ _ _ K t sl L). unfold result, improve.
           destruct (is_progressive cfg); [|destruct (any_above p (pending sl))]; cbn; try discriminate.
           ++ destruct (filter _ (pending sl)); cbn; [discriminate|]. intros [= <-]. now apply nodup_filter.
           ++ intros [= <-]. cbn. destruct (_ || _); auto using nodup_filter.
  - unfold arrive. destruct (first_reason _) as [why|] eqn:F.
    + intros [= <- <-]. apply (lines_silent cfg tr s s _ _ K); auto. cbn. auto.
    + apply f3_none in F as (sl & L & _). rewrite (slot_of_open _ _ _ L). unfold update, fail.
      destruct (settle _ _ _ _ _) as [o e] eqn:Se. intros [= <- <-].
      assert (Q : forall earlier d, In d (Failed (clock s) t p :: e) -> moves_gate d = false /\ line_ok cfg earlier d).
      { intros earlier d [<-|I]; [cbn; auto|]. eapply settle_lines; eauto. }
      constructor; try discriminate.
      * apply each_after; [|apply (l_each _ _ _ _ K)]. intros a d y E. apply Q. rewrite E. apply in_elt.
      * intros q. rewrite gate_after; [apply (l_gate _ _ _ _ K)|]. intros d I. now apply (Q tr).
      * intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
      * eapply (armed_update s t o); [apply (g_nodup _ _ _ G)|reflexivity| |].
        -- apply (l_armed _ _ _ _ K).
        -- intros sl0 y L0 ->. apply settle_keeps in Se as ->. apply nodup_filter, (l_armed _ _ _ _ K t sl L).
  - intros [= <- <-]. destruct K as [K1 K2 K3 K4 _]. constructor; auto. discriminate.
Qed.
Lemma reach_lines cfg tr s cur : reach cfg tr s cur -> lines cfg tr s cur.
Proof.
  induction 1 as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U].
  - constructor; try discriminate; auto. intros later d earlier E. destruct later; discriminate.
  - destruct IH as [K1 K2 K3 K4 _]. constructor; auto.
    + now apply each_got.
    + intros m M. apply says_got. now apply K3.
  - assert (G := reach_good _ _ _ _ R). destruct (due_lookup _ _ _ _ _ G E) as (sl & q & Lt & _). eapply lines_fire; eauto.
  - eapply lines_apply; eauto. eapply reach_good; eauto.
Qed.

(** ** What each line says is what the statements say, of many threads too (Threads.v) *)
Section Each.
Variables (cfg : config) (tr : trace).
Hypothesis ok : each (line_ok cfg) tr.
Lemma each_f1_order : F1_order tr.
Proof. intros y d x now t E. apply ok in E. split; [intros due ->; exact E|intros ->; exact E]. Qed.
Lemma each_f2_registered : F2_registered cfg tr.
Proof.
  intros t p (d & I & R). apply in_split in I as (y & x & E). apply ok in E. destruct d; try contradiction.
  destruct R as [-> ->]. apply E.
Qed.
Lemma each_f2_outranks : F2_outranks tr.
Proof. intros y x now t p due q E. apply ok in E. apply E. Qed.
Lemma each_f2g_gate : F2g_gate cfg tr.
Proof.
  intros y d x now t p z b c E I C. apply ok in E. split; [intros due ->|intros ->]; cbn in E.
  - destruct E as (_ & _ & E). specialize (E z b c I C). unfold shut_by in E. destruct (gate_of p x).
    + apply negb_false_iff in E. now apply N.leb_le.
    + now apply N.leb_gt.
  - specialize (E z b c I C). unfold shut_by in E. destruct (gate_of p x).
    + apply negb_true_iff in E. now apply N.leb_gt.
    + now apply N.leb_le.
Qed.
Lemma each_f7_local : F7_local tr.
Proof. intros now t I. apply in_split in I as (y & x & E). apply ok in E. now apply E. Qed.
Lemma each_p8_while_live : P8_while_live cfg tr.
Proof. intros y x now t p E. apply ok in E. exact E. Qed.
End Each.

(** ** Of any run *)
Section Run.
Variables (cfg : config) (ins : list input).
Local Notation tr := (trace_of cfg ins).
Local Lemma ok : each (line_ok cfg) tr.
Proof. exact (l_each _ _ _ _ (reach_lines _ _ _ _ (proj1 (run_reach cfg ins)))). Qed.
Theorem f1_order : F1_order tr. Proof. exact (each_f1_order cfg tr ok). Qed.
Theorem f2_registered : F2_registered cfg tr. Proof. exact (each_f2_registered cfg tr ok). Qed.
Theorem f2_outranks : F2_outranks tr. Proof. exact (each_f2_outranks cfg tr ok). Qed.
Theorem f2g_gate : F2g_gate cfg tr. Proof. exact (each_f2g_gate cfg tr ok). Qed.
Theorem f7_local : F7_local tr. Proof. exact (each_f7_local cfg tr ok). Qed.
Theorem p8_while_live : P8_while_live cfg tr. Proof. exact (each_p8_while_live cfg tr ok). Qed.
End Run.
