(** * What each line says of the trace before it: F0 to F4, F7, P2, and P8's live timers *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Tables.
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
Definition line_ok (cfg : config) (earlier : trace) (d : decision) : Prop :=
  instant_of d = clock_of earlier /\
  match d with
  | Opened _ _ _ | Refuse _ _ None _ => f1_line cfg earlier d
  | Request _ _ _ _ | Refuse _ _ (Some _) _ => f2_line cfg earlier d
  | Failed _ _ _ | Drop _ _ _ _ => f3_line cfg earlier d
  | Hold _ t p => f3_line cfg earlier d /\ arrives earlier t p
  | Emit now t p => f3_line cfg earlier d /\ (arrives earlier t p \/ says earlier (holds t p)) /\
      (is_progressive cfg = false -> forall q, p < q -> says earlier (requests t q) -> ~ says earlier (closes cfg t q) ->
       is_eager cfg = true /\ exists r, r <> 0 /\ In (Timer now t r) (since_input earlier))
  | Cancel _ t q => q <> 0 /\ says earlier (requests t q) /\ ~ says earlier (answers t q)
  | Timer _ t p => (exists due, says earlier (arms t p due) /\ due <= clock_of earlier) /\
      ~ says earlier (disarms cfg t p) /\ ~ says earlier (retires cfg t)
  | Final _ _ _ | Miss _ _ => True
  end.
Record lines (cfg : config) (tr : trace) (s : state) (cur : option body) : Prop := {
  l_each : each (line_ok cfg) tr;
  l_clock : clock s = clock_of tr;
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
Lemma settle_gates cfg now t timer sl o ds d : settle cfg now t timer sl = (o, ds) -> In d ds -> moves_gate d = false.
Proof.
  intros H I. apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(_ & m & E & _)]]].
  - contradiction.
  - destruct I as [<-|[]]. reflexivity.
  - destruct I as [<-|[]]. reflexivity.
  - injection E as _ ->. destruct I as [<-|I]; [reflexivity|]. apply in_map_iff in I as (q & <- & _). reflexivity.
Qed.
Lemma result_gates cfg now t p sl d : In d (snd (result cfg now t p sl)) -> moves_gate d = false.
Proof.
  assert (C : forall l, In d (map (Cancel now t) l) -> moves_gate d = false).
  { intros l I. apply in_map_iff in I as (q & <- & _). reflexivity. }
  unfold result, improve. destruct (is_progressive cfg); [|destruct (any_above p (pending sl))]; cbn [snd fst].
  - destruct (filter (N.ltb p) (pending sl)); cbn [snd In]; rewrite ?in_app_iff; cbn [In]; intros I;
      repeat destruct I as [I|I]; try contradiction; eauto; now subst.
  - intros [<-|[]]. reflexivity.
  - intros [<-|I]; eauto.
Qed.
Lemma since_after d ds tr : In d ds -> In d (since_input (after ds tr)).
Proof.
  revert tr. induction ds as [|e ds IH] using rev_ind; intros tr I; [contradiction|]. rewrite after_app.
  apply in_app_or in I as [I|[->|[]]]; [right; now apply IH|now left].
Qed.
(** An output before what outranks it is by an eager timer. *)
Lemma settle_commits cfg now t timer s o m cs : is_progressive cfg = false ->
  settle cfg now t timer s = (o, Emit now t m :: cs) -> any_above m (pending s) = true -> is_eager cfg = true /\ timer = true.
Proof.
  intros NP. unfold settle. rewrite NP. destruct (greatest (cached s)) as [k|]; [|destruct (pending s); discriminate].
  destruct (_ || _) eqn:E; [|discriminate]. unfold forward. intros [= _ <- _] A. rewrite A in E. cbn in E.
  now apply andb_true_iff in E.
Qed.
(** An output, and what is cancelled with it. *)
Lemma each_cancels cfg tr now t m cs : each (line_ok cfg) tr -> line_ok cfg tr (Emit now t m) -> now = clock_of tr ->
  (forall q, In q cs -> q <> 0 /\ q <> m /\ says tr (requests t q) /\ ~ says tr (answers t q)) ->
  each (line_ok cfg) (after (Emit now t m :: map (Cancel now t) cs) tr).
Proof.
  intros K E C H. rewrite after_one. apply each_after; [|now apply each_did]. intros a d b Eq.
  assert (I : In d (map (Cancel now t) cs)) by (rewrite Eq; apply in_elt). apply in_map_iff in I as (q & <- & I).
  destruct (H q I) as (Z & M & R & A). split; [cbn; now rewrite clock_after|]. cbn. split; auto. split.
  - apply says_more. destruct R as (x & J & R). exists x. split; auto. now right.
  - intros X. apply says_after in X as [(x & J & X)|(x & J & X)].
    + assert (Ix : In x (map (Cancel now t) cs)) by (rewrite Eq; apply in_or_app; auto).
      apply in_map_iff in Ix as (y & <- & _). contradiction.
    + destruct J as [[= <-]|J]; [cbn in X; destruct X as [_ ->]; contradiction|]. apply A. exists x. auto.
Qed.
Lemma each_settle cfg tr s t sl ps ds timer o e : good cfg tr s -> lookup t (opened s) = Some sl ->
  closing t (clock s) ps ds -> clock s = clock_of tr -> settle cfg (clock s) t timer (close ps sl) = (o, e) ->
  (timer = true -> exists r, r <> 0 /\ In (Timer (clock s) t r) ds) -> each (line_ok cfg) (after ds tr) -> each (line_ok cfg) (after e (after ds tr)).
Proof.
  intros G L CL C H Ti K. assert (T := g_traced _ _ _ G t sl L). assert (O := g_slot _ _ _ G t sl L). assert (H0 := H).
  apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & m & -> & _)|(NP & m & E & Gr)]]]; auto.
  - apply each_did; auto. split; [cbn; now rewrite clock_after|exact Logic.I].
  - apply each_did; auto. split; [cbn; now rewrite clock_after|exact Logic.I].
  - injection E as _ ->. apply greatest_some in Gr as [M _]. cbn in M. assert (Hm := M).
    apply (a_cached _ _ _ _ T NP) in Hm. apply each_cancels; auto.
    + split; [cbn; now rewrite clock_after|]. split; [left; now apply says_more|].
      split; [right; now apply says_more|]. intros _ q Lq R Cl.
      assert (A : any_above m (pending (close ps sl)) = true).
      { apply above_iff. exists q. split; auto. unfold close. cbn [pending]. apply filter_In. split.
        - apply (a_pending _ _ _ _ T). split; [|intros X; now apply Cl, says_more]. apply (a_requested _ _ _ _ T). right.
          apply says_after in R as [R|R]; auto. apply (closing_says t (clock s) ps ds _ CL) in R as (r & _ & [[]|[]]).
        - apply negb_true_iff, mem_not. intros I. apply Cl, says_after. left. destruct CL as [_ CL].
          destruct (CL q I) as (d & J & [->| ->]); eexists; split; eauto; cbn; auto. }
      destruct (settle_commits _ _ _ _ _ _ _ _ NP H0 A) as [Ea Tt]. split; auto. destruct (Ti Tt) as (r & Z & I).
      exists r. split; auto. now apply since_after.
    + now rewrite clock_after.
    + intros q Q. apply clouds_in in Q as [Q Z]. cbn in Q. apply filter_In in Q as [Q Nq].
      apply negb_true_iff, mem_not in Nq. split; auto. split; [intros ->; now apply (ok_apart _ _ O m)|].
      assert (P := Q). apply (a_pending _ _ _ _ T) in P as [R Cl]. apply (a_requested _ _ _ _ T) in R as [R|R]; [contradiction|].
      split; [now apply says_more|]. intros X. apply says_after in X as [X|X].
      * apply (closing_says t (clock s) ps ds _ CL) in X as (p & P & [[_ ->]|[_ ->]]); contradiction.
      * apply Cl. destruct X as (x & J & X). exists x. split; auto. destruct x; cbn in *; try tauto.
        destruct X as [-> ->]. split; auto. now left.
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
  due <= clock s -> update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> lines cfg (after ds tr) s' (Some b).
Proof.
  intros G K L Le U. rewrite (slot_of_open _ _ _ L) in U. unfold fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as <- <-.
  assert (D := l_armed _ _ _ _ K t sl L). assert (C := l_clock _ _ _ _ K).
  assert (Df : NoDup (fired due sl)) by now apply nodup_filter.
  assert (Q : forall d, In d (map (Timer (clock s) t) (fired due sl) ++ e) -> moves_gate d = false).
  { intros d I. apply in_app_or in I as [I|I]; [apply in_map_iff in I as (p & <- & _); reflexivity|].
    eapply settle_gates; eauto. }
  constructor.
  - rewrite after_app. eapply (each_settle cfg tr s t sl (fired due sl)); eauto.
    { split; [intros d I; apply in_map_iff in I as (q & <- & I); eauto|].
      intros q I. exists (Timer (clock s) t q). split; auto. apply in_map_iff. eauto. }
    { intros X. apply existsb_exists in X as (r & I & Z). apply negb_true_iff, N.eqb_neq in Z. exists r. split; auto.
      now apply in_map. }
    apply each_after; [|apply (l_each _ _ _ _ K)]. intros a d y Eq.
    assert (I : In d (map (Timer (clock s) t) (fired due sl))) by (rewrite Eq; apply in_elt).
    apply in_map_iff in I as (p & <- & I). assert (A := I). apply fired_in in A.
    apply (a_armed _ _ _ _ (g_traced _ _ _ G t sl L)) in A as [A Nd].
    assert (S : exists ps qs, fired due sl = ps ++ p :: qs /\ a = map (Timer (clock s) t) ps).
    { clear - Eq. revert a Eq. induction (fired due sl) as [|z zs IH]; intros a Eq; [destruct a; discriminate|].
      destruct a as [|x a]; cbn in Eq.
      - injection Eq as -> _. exists [], zs. auto.
      - injection Eq as <- Eq. destruct (IH a Eq) as (ps & qs & -> & ->). exists (z :: ps), qs. auto. }
    destruct S as (ps & qs & P1 & ->). split; [cbn; now rewrite clock_after|]. cbn.
    split; [exists due; rewrite clock_after, <- C; split; auto; now apply says_more|]. split.
    + intros X. apply says_after in X as [(x & Xa & X)|X]; [|contradiction].
      apply in_map_iff in Xa as (z & <- & Z). cbn in X. destruct X as [_ ->].
      rewrite P1 in Df. apply NoDup_remove_2 in Df. apply Df, in_or_app. auto.
    + intros X. apply says_after in X as [(x & Xa & X)|X]; [apply in_map_iff in Xa as (z & <- & _); contradiction|].
      now apply (open_not_retired cfg tr s G t sl L).
  - now rewrite clock_after.
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
Lemma lines_silent cfg tr s d b : lines cfg tr s (Some b) -> moves_gate d = false -> line_ok cfg tr d ->
  lines cfg (after [d] tr) s None.
Proof.
  intros K A L. constructor.
  - apply each_did; auto. apply (l_each _ _ _ _ K).
  - rewrite clock_after. apply (l_clock _ _ _ _ K).
  - intros p. rewrite gate_after; [apply (l_gate _ _ _ _ K)|]. now intros e [<-|[]].
  - intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
  - apply (l_armed _ _ _ _ K).
  - discriminate.
Qed.
Lemma lines_offer cfg tr s t p x backlog s' ds : good cfg tr s -> lines cfg tr s (Some (Offer t p x backlog)) ->
  offer cfg s t p x backlog = (s', ds) -> lines cfg (after ds tr) s' None.
Proof.
  intros G K. assert (In_ := l_input _ _ _ _ K _ eq_refl). assert (C := l_clock _ _ _ _ K).
  assert (S := fun o => answer_same _ _ o (f2_same cfg tr s G (l_newest _ _ _ _ K) (l_gate _ _ _ _ K) t p x backlog)).
  setoid_rewrite first_app in S. unfold offer. destruct (first_reason (f2_reasons cfg s t p x)) as [why|] eqn:F.
  - intros [= <- <-]. assert (W : why <> Queue).
    { clear - F. intros ->. cbn in F.
      repeat match type of F with (if ?b then _ else _) = _ => destruct b; try discriminate end. }
    apply (lines_silent cfg tr s _ _ K); [destruct why; auto; congruence|]. split; [exact C|]. exists x, backlog.
    split; auto. now apply S.
  - assert (R := F). apply f2_none in F as (sl & L & NR & _). rewrite (slot_of_open _ _ _ L).
    destruct (gate_shut cfg s p backlog) eqn:Sh; intros [= <- <-]; constructor; try discriminate;
      try (rewrite clock_after; exact C).
    + apply each_did; [|apply (l_each _ _ _ _ K)]. split; [exact C|]. exists x, backlog. split; auto. apply S. reflexivity.
    + intros q. change (gate_of q (after _ tr)) with (if p =? q then true else gate_of q tr).
      rewrite mem_set_gate, (l_gate _ _ _ _ K). reflexivity.
    + intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
    + intros u sl0 Lu. apply (l_armed _ _ _ _ K u sl0 Lu).
    + apply each_did; [|apply (l_each _ _ _ _ K)]. split; [exact C|]. exists x, backlog. split; auto. split; auto.
      apply S. reflexivity.
    + intros q. change (gate_of q (after _ tr)) with (if p =? q then false else gate_of q tr).
      unfold update. cbn [fst shut set_opened]. rewrite mem_set_gate, (l_gate _ _ _ _ K). reflexivity.
    + intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
    + eapply (armed_update s t (Some (join p (due_at (clock s) x) sl))); [apply (g_nodup _ _ _ G)|reflexivity| |].
      * apply (l_armed _ _ _ _ K).
      * intros sl0 y L0 [= <-]. cbn. apply nodup_add; [|apply (l_armed _ _ _ _ K t sl L)]. intros I.
        apply in_map_iff in I as ([q d] & E & I). cbn in E. subst q. apply NR. eapply armed_requested; [apply (g_slot _ _ _ G t sl L)|exact I].
Qed.
(** What a result that is accepted decides. *)
Lemma each_result cfg tr s t p sl : good cfg tr s -> lines cfg tr s (Some (Result t p)) ->
  lookup t (opened s) = Some sl -> In p (pending sl) -> arrives tr t p -> answer (f3_rows cfg tr t p) None ->
  each (line_ok cfg) (after (snd (result cfg (clock s) t p sl)) tr).
Proof.
  intros G K L P Ar An. assert (T := g_traced _ _ _ G t sl L). assert (In_ := l_input _ _ _ _ K _ eq_refl).
  assert (C := l_clock _ _ _ _ K). assert (Ke := l_each _ _ _ _ K).
  assert (Em : is_progressive cfg = true \/ any_above p (pending sl) = false -> line_ok cfg tr (Emit (clock s) t p)).
  { intros Y. split; [exact C|]. split; [cbn; auto|]. split; auto. intros NP q Lq R Cl. exfalso. destruct Y as [Y|Y]; [congruence|].
    rewrite above_not in Y. enough (q <= p) by lia. apply Y, (a_pending _ _ _ _ T). split; auto.
    apply (a_requested _ _ _ _ T). auto. }
  assert (Cs : forall l, is_progressive cfg = true \/ any_above p (pending sl) = false ->
    (forall q, In q l -> In q (pending sl) /\ q <> p) ->
    each (line_ok cfg) (after (Emit (clock s) t p :: map (Cancel (clock s) t) (clouds_of l)) tr)).
  { intros l Y Hl. apply each_cancels; auto. intros q Q. apply clouds_in in Q as [Q Z]. destruct (Hl q Q) as [W N].
    split; auto. split; auto. apply (a_pending _ _ _ _ T) in W as [R Cl].
    apply (a_requested _ _ _ _ T) in R as [R|R]; [contradiction|]. split; auto. intros (x & J & X). apply Cl.
    exists x. split; auto. destruct x; cbn in *; try tauto. destruct X as [-> ->]. split; auto. now left. }
  unfold result, improve. destruct (is_progressive cfg) eqn:Pr; [|destruct (any_above p (pending sl)) eqn:A]; cbn [snd].
  - assert (X := Cs (filter (fun q => q <? p) (pending sl)) (or_introl eq_refl)). specialize (X ltac:(intros q Q; apply filter_In in Q as [Q Y];
      apply N.ltb_lt in Y; split; [auto|lia])).
    destruct (filter (N.ltb p) (pending sl)); cbn [snd]; auto. rewrite after_app. apply each_did; auto.
    split; [cbn; now rewrite clock_after|exact Logic.I].
  - apply each_did; auto. split; [exact C|]. cbn. auto.
  - apply (Cs (pending (close [p] sl)) (or_intror eq_refl)). intros q Q. unfold close in Q. cbn [pending] in Q. apply filter_In in Q as [Q Y]. apply negb_true_iff, mem_not in Y. split; auto.
    intros ->. apply Y. now left.
Qed.
Lemma lines_apply cfg tr s b s' ds : good cfg tr s -> lines cfg tr s (Some b) -> current tr s b ->
  (forall t p, b = Result t p -> rest_of s t) -> apply cfg s b = (s', ds) -> lines cfg (after ds tr) s' None.
Proof.
  intros G K Cu AR. assert (In_ := l_input _ _ _ _ K _ eq_refl). assert (C := l_clock _ _ _ _ K).
  destruct b as [t d|t p x bl|t p|t p|]; cbn [apply].
  - assert (S := fun o => answer_same _ _ o (f1_same cfg tr s G (l_newest _ _ _ _ K) t d)). unfold open.
    destruct (first_reason _) as [why|] eqn:F.
    + intros [= <- <-]. apply (lines_silent cfg tr s _ _ K); auto. split; [exact C|]. exists d. split; auto. now apply S.
    + intros [= <- <-]. assert (Re : reached s t = false) by (cbn in F; destruct (reached s t); [discriminate|auto]).
      constructor; try discriminate.
      * apply each_did; [|apply (l_each _ _ _ _ K)]. split; [exact C|]. exists d. split; auto. split; auto. now apply S.
      * now rewrite clock_after.
      * intros p. rewrite gate_after; [apply (l_gate _ _ _ _ K)|]. now intros e [<-|[]].
      * cbn [newest]. intros n [= <-]. eexists. split; [now left|]. cbn. reflexivity.
      * cbn [opened]. intros u sl Lu. rewrite lookup_app in Lu by (intros I; apply (g_reached _ _ _ G) in I; congruence).
        destruct (t =? u); [|now apply (l_armed _ _ _ _ K u)]. injection Lu as <-. cbn.
        destruct d; cbn; repeat constructor; auto.
  - now apply lines_offer.
  - assert (S := fun o => answer_same _ _ o (f3_same cfg tr s G (l_newest _ _ _ _ K) t p)). unfold arrive.
    destruct (first_reason _) as [why|] eqn:F.
    + intros [= <- <-]. apply (lines_silent cfg tr s _ _ K); auto. split; [exact C|]. cbn. split; auto. now apply S.
    + assert (An := proj2 (S None) eq_refl). apply f3_none in F as (sl & L & P & _). rewrite (slot_of_open _ _ _ L). unfold update. intros [= <- <-].
      constructor; try discriminate.
      * apply each_result; auto. eapply pending_arrives; eauto.
      * now rewrite clock_after.
      * intros q. rewrite gate_after; [apply (l_gate _ _ _ _ K)|]. intros d I. eapply result_gates; eauto.
      * intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
      * eapply (armed_update s t (fst (result cfg (clock s) t p sl))); [apply (g_nodup _ _ _ G)|reflexivity| |].
        -- apply (l_armed _ _ _ _ K).
        -- intros sl0 y L0. rewrite L in L0. injection L0 as <-. assert (D := l_armed _ _ _ _ K t sl L). unfold result, improve.
           destruct (is_progressive cfg); [|destruct (any_above p (pending sl))]; cbn; try discriminate.
           ++ destruct (filter _ (pending sl)); cbn; [discriminate|]. intros [= <-]. now apply nodup_filter.
           ++ intros [= <-]. cbn. destruct (_ || _); auto using nodup_filter.
  - assert (S := fun o => answer_same _ _ o (f3_same cfg tr s G (l_newest _ _ _ _ K) t p)). unfold arrive.
    destruct (first_reason _) as [why|] eqn:F.
    + intros [= <- <-]. apply (lines_silent cfg tr s _ _ K); auto. split; [exact C|]. cbn. split; auto. now apply S.
    + assert (An := proj2 (S None) eq_refl). apply f3_none in F as (sl & L & _). rewrite (slot_of_open _ _ _ L). unfold update, fail.
      destruct (settle _ _ _ _ _) as [o e] eqn:Se. intros [= <- <-]. cbn [snd].
      assert (Q : forall d, In d (Failed (clock s) t p :: e) -> moves_gate d = false).
      { intros d [<-|I]; [reflexivity|]. eapply settle_gates; eauto. }
      constructor; try discriminate.
      * change (Failed (clock s) t p :: e) with ([Failed (clock s) t p] ++ e). rewrite after_app.
        eapply (each_settle cfg tr s t sl [p]); eauto.
        { split; [intros x [<-|[]]; exists p; cbn; auto|]. intros q [<-|[]]. eexists. split; [now left|auto]. }
        { discriminate. }
        apply each_did; [|apply (l_each _ _ _ _ K)]. split; [exact C|]. cbn. auto.
      * now rewrite clock_after.
      * intros q. rewrite gate_after; [apply (l_gate _ _ _ _ K)|exact Q].
      * intros n E. apply says_more. now apply (l_newest _ _ _ _ K).
      * eapply (armed_update s t o); [apply (g_nodup _ _ _ G)|reflexivity| |].
        -- apply (l_armed _ _ _ _ K).
        -- intros sl0 y L0 ->. apply settle_keeps in Se as ->. apply nodup_filter, (l_armed _ _ _ _ K t sl L).
  - intros [= <- <-]. destruct K as [K1 K2 K3 K4 K5 _]. constructor; auto. discriminate.
Qed.
Lemma reach_lines cfg tr s cur : reach cfg tr s cur -> lines cfg tr s cur.
Proof.
  induction 1 as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U].
  - constructor; try discriminate; auto. intros later d earlier E. destruct later; discriminate.
  - destruct IH as [K1 K2 K3 K4 K5 _]. constructor; auto.
    + now apply each_got.
    + intros m M. apply says_got. now apply K4.
  - assert (G := reach_good _ _ _ _ R). destruct (due_lookup _ _ _ _ _ G E) as (sl & q & Lt & _). eapply lines_fire; eauto.
  - apply (lines_apply cfg tr s b); [eapply reach_good; eauto|exact IH|eapply reach_current; eauto|intros t p _; apply A|exact U].
Qed.

(** ** What each line says is what the statements say, of many threads too (Threads.v) *)
Section Each.
Variables (cfg : config) (tr : trace).
Hypothesis ok : each (line_ok cfg) tr.
Lemma each_f0_instants : F0_instants tr.
Proof. intros y d x E. apply (ok _ _ _ E). Qed.
Lemma each_f1_open : F1_open cfg tr.
Proof. intros y d x E. apply ok in E as [_ E]. destruct d as [| | |? ? [|] ?| | | | | | |]; try exact Logic.I; exact E. Qed.
Lemma each_f2_offer : F2_offer cfg tr.
Proof. intros y d x E. apply ok in E as [_ E]. destruct d as [| | |? ? [|] ?| | | | | | |]; try exact Logic.I; exact E. Qed.
Lemma each_f3_arrival : F3_arrival cfg tr.
Proof. intros y d x E. apply ok in E as [_ E]. destruct d; try exact Logic.I; apply E. Qed.
Lemma each_f6_commits : F6_commits cfg tr.
Proof. intros y now t m x q E NP. apply ok in E as [_ (_ & _ & E)]. exact (E NP q). Qed.
Lemma each_f7_cancelled : F7_cancelled tr.
Proof. intros y now t q x E. apply ok in E as [_ E]. exact E. Qed.
Lemma each_p2_never_late : P2_never_late tr.
Proof.
  intros y d x t p E. apply ok in E as [_ E]. split; intros H; destruct d; try contradiction; destruct H as [-> ->]; apply E.
Qed.
Lemma each_p8_fires : P8_fires tr.
Proof. intros y now t p x E. apply ok in E as [_ E]. apply E. Qed.
Lemma each_p8_while_live : P8_while_live cfg tr.
Proof. intros y now t p x E. apply ok in E as [_ E]. apply E. Qed.
End Each.

(** ** Of any run *)
Section Run.
Variables (cfg : config) (ins : list input).
Local Notation tr := (trace_of cfg ins).
Local Lemma ok : each (line_ok cfg) tr.
Proof. exact (l_each _ _ _ _ (reach_lines _ _ _ _ (proj1 (run_reach cfg ins)))). Qed.
Theorem f0_instants : F0_instants tr. Proof. exact (each_f0_instants cfg tr ok). Qed.
Theorem f1_open : F1_open cfg tr. Proof. exact (each_f1_open cfg tr ok). Qed.
Theorem f2_offer : F2_offer cfg tr. Proof. exact (each_f2_offer cfg tr ok). Qed.
Theorem f3_arrival : F3_arrival cfg tr. Proof. exact (each_f3_arrival cfg tr ok). Qed.
Theorem f6_commits : F6_commits cfg tr. Proof. exact (each_f6_commits cfg tr ok). Qed.
Theorem f7_cancelled : F7_cancelled tr. Proof. exact (each_f7_cancelled cfg tr ok). Qed.
Theorem p2_never_late : P2_never_late tr. Proof. exact (each_p2_never_late cfg tr ok). Qed.
Theorem p8_fires : P8_fires tr. Proof. exact (each_p8_fires cfg tr ok). Qed.
Theorem p8_while_live : P8_while_live cfg tr. Proof. exact (each_p8_while_live cfg tr ok). Qed.
End Run.
