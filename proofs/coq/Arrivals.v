(** * What comes of each arrival: P2's late copies, P3, and F7's cancels *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Tables Lines.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** F7 *)
Lemma cancels_more cfg ds tr : F7_cancels cfg tr -> (forall a b now t m q, ds = a ++ Emit now t m :: b ->
    says (after a tr) (requests t q) -> ~ says (after a tr) (closes cfg t q) -> q <> m ->
    (is_progressive cfg = true -> q < m) -> In (Cancel now t q) b) -> F7_cancels cfg (after ds tr).
Proof.
  intros H B later now t m earlier q E R C N L. destruct (in_after_split _ _ _ _ _ E) as [(a & b & D & -> & ->)|(y & Y & ->)].
  - assert (I := B a b now t m q D R C N L). apply in_rev, in_split in I as (u & v & ->).
    exists (map Did u), (Cancel now t q), v. split; auto. now rewrite map_app.
  - apply soon_more. now apply (H y now t m earlier q).
Qed.
Definition is_output (d : decision) : bool := match d with Emit _ _ _ => true | _ => false end.
Lemma one_output now t m cs fin : forall T a n u k b, (forall d, In d T \/ In d fin -> is_output d = false) ->
  T ++ Emit now t m :: map (Cancel now t) cs ++ fin = a ++ Emit n u k :: b ->
  a = T /\ n = now /\ u = t /\ k = m /\ b = map (Cancel now t) cs ++ fin.
Proof.
  intros T. induction T as [|d T IH]; intros a n u k b H E.
  - destruct a as [|x a]; [injection E as <- <- <- <-; auto|]. injection E as _ E. exfalso.
    assert (I : In (Emit n u k) (map (Cancel now t) cs ++ fin)) by (rewrite E; apply in_elt).
    apply in_app_or in I as [I|I]; [apply in_map_iff in I as (q & [=] & _)|]. specialize (H _ (or_intror I)). discriminate.
  - destruct a as [|x a]; injection E as -> E.
    + specialize (H (Emit n u k) ltac:(cbn; auto)). discriminate.
    + destruct (IH a n u k b) as (-> & Y); auto. intros e [I|I]; apply H; [left; now right|auto].
Qed.
Lemma no_output ds : (forall d, In d ds -> is_output d = false) -> forall a now t m b, ds <> a ++ Emit now t m :: b.
Proof.
  intros H a now t m b E. assert (I : In (Emit now t m) ds) by (rewrite E; apply in_elt). specialize (H _ I). discriminate.
Qed.
Lemma requests_cloud cfg tr t q : each (line_ok cfg) tr -> says tr (requests t q) -> is_cloud cfg q = true /\ q <> 0.
Proof.
  intros K (d & I & R). apply in_split in I as (y & x & E). apply K in E as [_ E]. destruct d; try contradiction.
  destruct R as [-> ->]. destruct E as (x0 & bl & _ & _ & [[_ [=]]|[Z [[_ [=]]|[_ [[_ [=]]|[Rq _]]]]]]). split.
  - destruct (is_cloud cfg q); [auto|elim Z; auto].
  - intros ->. apply Rq. now left.
Qed.
Lemma did_split d y rest : forall u v, map Did y ++ rest = u ++ Did d :: v ->
  (exists c, v = map Did c ++ rest /\ forall e, In e c -> In e y) \/ exists u', rest = u' ++ Did d :: v.
Proof.
  induction y as [|e y IH]; intros u v E; [eauto|]. destruct u as [|l u].
  - injection E as -> <-. left. exists y. split; auto. intros f I. now right.
  - injection E as _ E. destruct (IH u v E) as [(c & -> & H)|?]; auto. left. exists c. split; auto. intros f I. right. auto.
Qed.
Lemma arms_arming t p due d : arms t p due d -> arming d = true.
Proof. destruct d; cbn; auto; intros []. Qed.
(** Of what [T] closes nothing is cancelled. *)
Lemma cancels_settle cfg tr s t sl ps T timer o e : good cfg tr s -> each (line_ok cfg) tr -> lookup t (opened s) = Some sl ->
  closing t (clock s) ps T -> settle cfg (clock s) t timer (close ps sl) = (o, e) -> F7_cancels cfg tr ->
  F7_cancels cfg (after (T ++ e) tr).
Proof.
  intros G K L CL H F. assert (Tt := g_traced _ _ _ G t sl L).
  assert (NT : forall d, In d T -> is_output d = false).
  { intros d I. destruct CL as [A _]. destruct (A d I) as (p & _ & [->| ->]); reflexivity. }
  apply cancels_more; auto. intros a b now u m q E.
  apply settle_cases in H as [(_ & -> & _)|[(_ & -> & _)|[(_ & _ & _ & k & -> & _)|(NP & k & X & Gr)]]];
    try (elim (no_output (T ++ _)) with (2 := E); intros d I; apply in_app_or in I as [I|I]; auto; cbn in I;
         repeat destruct I as [<-|I]; try contradiction; reflexivity).
  injection X as _ ->. rewrite <- (app_nil_r (map _ _)) in E.
  apply one_output in E as (-> & -> & -> & -> & ->); [|intros d [I|[]]; auto]. rewrite app_nil_r.
  intros R C N _. apply in_map. rewrite says_after in R. destruct R as [R|R].
  { apply (closing_says t (clock s) ps T _ CL) in R as (p & _ & [[]|[]]). }
  apply clouds_in. split; [|now apply (requests_cloud cfg tr t q)]. unfold close. cbn [pending]. apply filter_In. split.
  - apply (a_pending _ _ _ _ Tt). split; [apply (a_requested _ _ _ _ Tt); auto|]. intros Y. apply C, says_after. auto.
  - apply negb_true_iff, mem_not. intros I. apply C, says_after. left. destruct CL as [_ B].
    destruct (B q I) as (d & J & [->| ->]); eexists; split; eauto; cbn; auto.
Qed.
Lemma cancels_fire cfg tr s due t sl s' ds : good cfg tr s -> each (line_ok cfg) tr -> lookup t (opened s) = Some sl ->
  update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> F7_cancels cfg tr -> F7_cancels cfg (after ds tr).
Proof.
  intros G K L U F. rewrite (slot_of_open _ _ _ L) in U. unfold fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
  injection U as <- <-. eapply (cancels_settle cfg tr s t sl (fired due sl)); eauto. split.
  - intros d I. apply in_map_iff in I as (q & <- & I). eauto.
  - intros q I. exists (Timer (clock s) t q). split; auto. apply in_map_iff. eauto.
Qed.
Lemma cancels_apply cfg tr s b s' ds : good cfg tr s -> each (line_ok cfg) tr -> apply cfg s b = (s', ds) ->
  F7_cancels cfg tr -> F7_cancels cfg (after ds tr).
Proof.
  intros G K A F.
  assert (Quiet : (forall d, In d ds -> is_output d = false) -> F7_cancels cfg (after ds tr)).
  { intros H. apply cancels_more; auto. intros x y now t m q E. now apply (no_output ds H) in E. }
  destruct b as [t d|t p x bl|t p|t p|]; cbn [apply] in A.
  - apply Quiet. unfold open in A. destruct (first_reason _); injection A as _ <-; intros e [<-|[]]; reflexivity.
  - apply Quiet. unfold offer in A. destruct (first_reason _); [|destruct (gate_shut _ _ _ _)]; injection A as _ <-;
      intros e [<-|[]]; reflexivity.
  - unfold arrive in A. destruct (first_reason _) eqn:Fr.
    { apply Quiet. injection A as _ <-. intros e [<-|[]]. reflexivity. }
    apply f3_none in Fr as (sl & L & P & _). rewrite (slot_of_open _ _ _ L) in A. injection A as _ <-.
    assert (T := g_traced _ _ _ G t sl L). apply cancels_more; auto. intros a b now u m q E.
    assert (In_ : forall fin k, Emit (clock s) t p :: map (Cancel (clock s) t) (clouds_of k) ++ fin = a ++ Emit now u m :: b ->
      (forall d, In d fin -> is_output d = false) ->
      (forall q, In q (pending sl) -> q <> p -> (is_progressive cfg = true -> q < p) -> In q k) ->
      says (after a tr) (requests u q) -> ~ says (after a tr) (closes cfg u q) -> q <> m ->
      (is_progressive cfg = true -> q < m) -> In (Cancel now u q) b).
    { intros fin k X Fin Hk R C N Lt. apply (one_output _ _ _ _ _ []) in X as (-> & -> & -> & -> & ->); [|intros d [[]|I]; auto].
      apply in_or_app. left. apply in_map, clouds_in. split; [|now apply (requests_cloud cfg tr t q)]. apply Hk; auto.
      apply (a_pending _ _ _ _ T). split; auto. apply (a_requested _ _ _ _ T). auto. }
    revert E. unfold result, improve. destruct (is_progressive cfg) eqn:Pr; [|destruct (any_above p (pending sl))]; cbn [snd].
    + assert (Hk : forall q, In q (pending sl) -> q <> p -> (true = true -> q < p) -> In q (filter (fun q => q <? p) (pending sl))).
      { intros w W _ Lt. apply filter_In. split; auto. now apply N.ltb_lt, Lt. }
      destruct (filter (N.ltb p) (pending sl)); cbn [snd]; intros E; eapply In_; eauto.
      * intros d [<-|[]]. reflexivity.
      * rewrite <- E, app_nil_r. reflexivity.
      * intros d [].
    + intros E. elim (no_output _) with (2 := E). intros d [<-|[]]. reflexivity.
    + intros E. eapply (In_ []); [rewrite app_nil_r; exact E|intros d []|]. intros w W N _. unfold close. cbn [pending].
      apply filter_In. split; auto. apply negb_true_iff, mem_not. intros [<-|[]]. contradiction.
  - unfold arrive in A. destruct (first_reason _) eqn:Fr.
    { apply Quiet. injection A as _ <-. intros e [<-|[]]. reflexivity. }
    apply f3_none in Fr as (sl & L & P & _). rewrite (slot_of_open _ _ _ L) in A. unfold fail in A.
    destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection A as _ <-. cbn [snd].
    apply (cancels_settle cfg tr s t sl [p] [Failed (clock s) t p] false o e); auto.
    split; [intros d [<-|[]]; exists p; cbn; auto|]. intros q [<-|[]]. eexists. split; [now left|auto].
  - injection A as _ <-. exact F.
Qed.

(** ** What holds at the end of each input *)
Record settled (cfg : config) (tr : trace) : Prop := {
  c_late : P2_late_dropped tr;
  c_came : forall t q, in_time tr t q -> says tr (accepts t q) \/
    is_progressive cfg = false /\ says tr (retires cfg t) \/ is_progressive cfg = true /\ exists m, q < m /\ says tr (emits t m)
}.
(** The trace before the input under way. *)
Definition begun (cfg : config) (tr : trace) (s : state) (b : body) : Prop := exists ds earlier,
  tr = map Did ds ++ Got (clock s) b :: earlier /\ (forall d, In d ds -> arming d = false) /\ settled cfg earlier.
Lemma got_once ds x a b l r n m : map Did ds ++ Got n a :: x = map Did l ++ Got m b :: r -> ds = l /\ n = m /\ a = b /\ x = r.
Proof.
  revert l. induction ds as [|d ds IH]; intros [|e l] E; try discriminate; [now injection E as -> -> ->|].
  injection E as -> E. apply IH in E as (-> & E). auto.
Qed.
Lemma older ds tr (X : decision -> Prop) : (forall d, X d -> arming d = true) -> (forall d, In d ds -> arming d = false) ->
  says (map Did ds ++ tr) X -> says tr X.
Proof.
  intros H Q (d & I & D). apply in_app_or in I as [I|I]; [|exists d; auto]. apply in_map_iff in I as (e & [= ->] & I).
  apply Q in I. apply H in D. congruence.
Qed.
Lemma settled_apply cfg tr s b s' ds : good cfg tr s -> lines cfg tr s (Some b) -> begun cfg tr s b ->
  (forall t p, b = Result t p -> rest_of s t) -> apply cfg s b = (s', ds) -> settled cfg (after ds tr).
Proof.
  intros G K (y & x & E & Q & S) AR A. assert (Ke := l_each _ _ _ _ K).
  assert (Cu : current tr s b) by (exists y, x; auto).
  assert (Old : forall Y, says x Y -> says tr Y).
  { intros Y (d & I & D). exists d. split; auto. rewrite E. apply in_or_app. right. now right. }
  assert (Sp : forall later now t p earlier, after ds tr = later ++ Got now (Result t p) :: earlier ->
    later = rev (map Did ds) ++ map Did y /\ now = clock s /\ b = Result t p /\ earlier = x \/
    exists z, x = z ++ Got now (Result t p) :: earlier /\ later = (rev (map Did ds) ++ map Did y ++ [Got (clock s) b]) ++ z).
  { intros later now t p earlier X. unfold after in X. rewrite <- map_rev, E in X.
    apply got_after_split in X as (z & X & ->). apply got_after_split in X as (z' & X & ->). destruct z' as [|l z'].
    - left. injection X as -> -> ->. rewrite app_nil_r, map_rev. auto.
    - right. injection X as <- ->. exists z'. split; auto. rewrite map_rev, <- !app_assoc. reflexivity. }
  constructor.
  - intros later now t p earlier due X Ar L. destruct (Sp _ _ _ _ _ X) as [(-> & -> & -> & ->)|(z & Z & ->)].
    2:{ apply soon_more. eapply (c_late _ _ S); eauto. }
    cbn [apply] in A. unfold arrive in A. destruct (first_reason _) as [why|] eqn:F.
    + injection A as <- <-. exists [], (Drop (clock s) t p why), y. split; eauto.
    + apply f3_none in F as (sl & Lk & P & _). destruct (pending_arrives cfg tr s t p sl G Cu (AR t p eq_refl) Lk P)
        as (y' & x' & now & E' & _ & _ & Due & _). rewrite E in E'. apply got_once in E' as (_ & <- & _ & <-).
      specialize (Due due Ar). lia.
  - intros t q (later & earlier & now & X & It). destruct (Sp _ _ _ _ _ X) as [(-> & -> & -> & ->)|(z & Z & _)].
    2:{ destruct (c_came _ _ S t q) as [H|[[NP H]|[Pr (m & Lm & H)]]]; [exists z, earlier, now; auto|left|right; left|right; right].
        - now apply says_more, Old.
        - split; auto. now apply says_more, Old.
        - split; auto. exists m. split; auto. now apply says_more, Old. }
    destruct It as (O & R & Due & NG). assert (In_ := l_input _ _ _ _ K _ eq_refl).
    assert (NGt : ~ says tr (gives_out t q)).
    { intros (d & I & H). apply in_split in I as (u & v & Ed). assert (W := Ke _ _ _ Ed). rewrite E in Ed.
      apply did_split in Ed as [(c & -> & Sub)|(u' & Ed)].
      2:{ destruct u' as [|l u']; [discriminate|]. injection Ed as _ Ed. apply NG. exists d. split; auto.
          rewrite Ed. apply in_elt. }
      assert (Qc : forall e, In e c -> arming e = false) by (intros e J; apply Q, Sub, J).
      assert (Ic : input_of (map Did c ++ Got (clock s) (Result t q) :: x) = Some (Result t q)).
      { clear. induction c; cbn; auto. }
      assert (Cc : clock_of (map Did c ++ Got (clock s) (Result t q) :: x) = clock s) by (clear; induction c; cbn; auto).
      destruct d as [|n w p|n w p| | | | | | | |]; try contradiction; destruct H as [-> ->]; destruct W as [_ W]; cbn in W.
      - destruct W as [W _]. congruence.
      - destruct W as [(due & Ar & L) _]. assert (Z := older _ _ _ (arms_arming t q due) Qc Ar).
        rewrite says_got in Z. specialize (Due due Z). lia. }
    assert (Ot := Old _ O). cbn [apply] in A. unfold arrive in A. destruct (first_reason _) as [why|] eqn:F.
    + assert (An := proj2 (answer_same _ _ (Some why) (f3_same cfg tr s G (l_newest _ _ _ _ K) t q)) F).
      assert (Rq : asked tr t q) by (destruct (N.eq_dec q 0); [left; auto|right; now apply Old, R]).
      assert (More := fun Y => says_more ds tr Y). cbn in An.
      destruct An as [[[[Z U]|U] _]|[_ [[[U|[U|[Pr (m & Lm & U)]]] _]|[_ [[U _]|[_ [[U _]|[_ [[U _]|[_ [=]]]]]]]]]]].
      * destruct (requests_cloud cfg tr t q Ke (Old _ (R Z))). congruence.
      * elim (U t); [apply N.le_refl|exact Ot].
      * contradiction.
      * destruct (is_progressive cfg) eqn:Pr; [|right; left; auto].
        assert (Lk : lookup t (opened s) = None).
        { destruct (lookup t (opened s)) as [sl|] eqn:Lk; auto. now elim (open_not_retired cfg tr s G t sl Lk). }
        destruct (g_drained _ _ _ G t Pr Ot Lk q Rq) as (d & I & C).
        destruct d as [|n w p|n w p| | |n w p| |n w p| | |]; cbn in C; try contradiction.
        -- elim NGt. exists (Failed n w p). auto.
        -- elim NGt. exists (Timer n w p). auto.
        -- left. apply More. exists (Hold n w p). split; auto. now left.
        -- destruct C as [-> [->|[_ Lq]]]; [left; apply More; exists (Emit n t q); split; auto; right; cbn; auto|].
           right. right. split; auto. exists p. split; auto. apply More. exists (Emit n t p). split; auto. cbn. auto.
      * right. right. split; auto. exists m. split; auto.
      * contradiction.
      * left. auto.
      * contradiction.
    + left. apply f3_none in F as (sl & Lk & P & _). rewrite (slot_of_open _ _ _ Lk) in A. injection A as _ <-.
      apply says_after. left. unfold result, improve.
      destruct (is_progressive cfg); [|destruct (any_above q (pending sl))]; cbn [snd].
      * exists (Emit (clock s) t q). split; [destruct (filter (N.ltb q) (pending sl)); now left|right; cbn; auto].
      * exists (Hold (clock s) t q). split; [now left|left; cbn; auto].
      * exists (Emit (clock s) t q). split; [now left|right; cbn; auto].
Qed.
Lemma begun_fire cfg tr s b due t s' ds : begun cfg tr s b ->
  update s t (fire cfg (clock s) t due (slot_of s t)) = (s', ds) -> begun cfg (after ds tr) s' b.
Proof.
  intros (y & x & -> & Q & S) U. assert (A : forall d, In d ds -> arming d = false).
  { unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se. injection U as _ <-. cbn. intros d I.
    apply in_app_or in I as [I|I]; [apply in_map_iff in I as (q & <- & _); reflexivity|]. eapply settle_quiet; eauto. }
  exists (rev ds ++ y), x. unfold update in U. injection U as <- _. split; [|split; auto].
  - unfold after. now rewrite map_app, map_rev, app_assoc.
  - intros d I. apply in_app_or in I as [I|I]; auto. apply A. now apply in_rev.
Qed.
Lemma settled_start cfg : settled cfg [].
Proof. constructor; [intros later now t p earlier due E|intros t q (later & earlier & now & E & _)]; destruct later; discriminate. Qed.
Lemma reach_settled cfg tr s cur : reach cfg tr s cur -> F7_cancels cfg tr /\
  match cur with None => settled cfg tr | Some b => begun cfg tr s b end.
Proof.
  induction 1 as [|tr s n b R IH|tr s b due t s' ds R IH E L U|tr s b s' ds R IH A U].
  - split; [intros later now t m earlier q E; destruct later; discriminate|apply settled_start].
  - destruct IH as [F S]. split; [|exists [], tr; split; [reflexivity|split; [intros d []|exact S]]].
    intros later now t m earlier q E. destruct later as [|l later]; [discriminate|]. injection E as <- E. intros.
    apply (soon_more [_]). eapply F; eauto.
  - assert (G := reach_good _ _ _ _ R). destruct (due_lookup _ _ _ _ _ G E) as (sl & q & Lt & _). destruct IH as [F S].
    split; [eapply cancels_fire; eauto; apply (l_each _ _ _ _ (reach_lines _ _ _ _ R))|eapply begun_fire; eauto].
  - assert (G := reach_good _ _ _ _ R). assert (K := reach_lines _ _ _ _ R). destruct IH as [F S].
    split; [exact (cancels_apply cfg tr s b s' ds G (l_each _ _ _ _ K) U F)|].
    exact (settled_apply cfg tr s b s' ds G K S (fun t p _ => A t) U).
Qed.

(** ** P3, of many threads too *)
Section Of.
Variables (cfg : config) (tr : trace).
(** Each beginning of it ends with an input. *)
Hypothesis beginnings : forall later now b earlier, tr = later ++ Got now b :: earlier -> settled cfg earlier.
Hypotheses (each_line : each (line_ok cfg) tr) (once : P1_once cfg tr) (rising : P1_progressive cfg tr).
Hypothesis best : forall t m q, says tr (emits t m) -> says tr (holds t q) -> q <= m.
Lemma settled_best : P3_best_available tr.
Proof.
  intros later now t m earlier q E [H|H].
  - apply (best t m q); [exists (Emit now t m); split; [rewrite E; apply in_elt|cbn; auto]|].
    destruct H as (d & I & H). exists d. split; auto. rewrite E. apply in_or_app. right. now right.
  - assert (X : exists ds n b, earlier = map Did ds ++ Got n b :: before_input earlier).
    { clear - H. destruct H as (y & x & n & H & _). revert y H. induction earlier as [|[k b|d] l IH]; cbn; intros y H.
      - destruct y; discriminate.
      - exists [], k, b. reflexivity.
      - destruct (IH y H) as (ds & k & b & X). exists (d :: ds), k, b. cbn. now rewrite <- X. }
    destruct X as (ds & n & b & X). set (x := before_input earlier) in *. clearbody x.
    assert (Ex : tr = (later ++ Did (Emit now t m) :: map Did ds) ++ Got n b :: x).
    { rewrite E, X at 1. now rewrite <- app_assoc. }
    assert (Old : forall Y, says x Y -> says earlier Y).
    { intros Y (d & I & D). exists d. split; auto. rewrite X. apply in_or_app. right. now right. }
    assert (Tr : forall Y, says earlier Y -> says tr Y).
    { intros Y (d & I & D). exists d. split; auto. rewrite E. apply in_or_app. right. now right. }
    assert (Before : forall k, says earlier (emits t k) -> is_progressive cfg = true /\ k < m).
    { intros k Sk. apply sent_in in Sk. assert (En : endings t tr = endings t later ++ Sent m :: endings t earlier).
      { rewrite E. unfold endings. rewrite flat_map_app. cbn. now rewrite N.eqb_refl. }
      destruct (is_progressive cfg) eqn:Pr.
      - split; auto. assert (Fall : exists a ps, falling ps /\ endings t tr = a ++ map Sent ps /\ (forall e, In e a -> exists p, e = Ended p)).
        { destruct (rising t Pr) as [(ps & Y & F)|[Y|(p & ps & Y & F)]].
          - exists [], ps. rewrite Y. split; auto. split; auto. intros e [].
          - exfalso. rewrite Y in En. destruct (endings t later) as [|e l]; [discriminate|]. injection En as _ En.
            destruct l; discriminate.
          - exists [Ended p], (p :: ps). rewrite Y. split; auto. split; auto. intros e [<-|[]]. eauto. }
        destruct Fall as (a & ps & F & Y & Ends). rewrite En in Y. clear - F Y Ends Sk.
        assert (Z : exists l, map Sent ps = l ++ Sent m :: endings t earlier).
        { revert a Y Ends. induction (endings t later) as [|e l IH]; intros a Y Ends.
          - destruct a as [|e a]; [exists []; auto|]. injection Y as <- _. destruct (Ends _ (or_introl eq_refl)) as (p & [=]).
          - destruct a as [|f a]; [exists (e :: l); auto|]. injection Y as <- Y. apply (IH a Y). intros e' I. apply Ends. now right. }
        destruct Z as (l & Z). clear Y Ends a. revert ps F Z. induction l as [|e l IH]; intros [|p ps] F Z; try discriminate.
        + injection Z as -> Z. rewrite <- Z in Sk. apply in_map_iff in Sk as (y & [= ->] & I).
          inversion F as [|? ? _ Fa]; subst. rewrite Forall_forall in Fa. now apply Fa.
        + injection Z as _ Z. inversion F; subst. eapply IH; eauto.
      - exfalso. destruct (once t Pr) as [Y|[Y|(p & Y)]]; rewrite En in Y; destruct (endings t later) as [|e l];
          try discriminate; injection Y as _ Y; try (rewrite Y in Sk; contradiction); destruct l; discriminate. }
    destruct (c_came _ _ (beginnings _ _ _ _ Ex) t q H) as [(d & I & [A|A])|[[NP (d & I & R)]|[_ (k & Lk & A)]]].
    + apply (best t m q); [exists (Emit now t m); split; [rewrite E; apply in_elt|cbn; auto]|]. apply Tr, Old. exists d. auto.
    + destruct (Before q) as [_ L]; [apply Old; exists d; auto|lia].
    + exfalso. assert (J : exists e, In e (end_of t d)).
      { destruct d; cbn in R; try contradiction; cbn; [destruct R as [-> _]|subst|subst]; rewrite N.eqb_refl; eexists; now left. }
      destruct J as (e & J). assert (Ie : In e (endings t earlier)).
      { apply in_flat_map. exists (Did d). split; auto. rewrite X. apply in_or_app. right. now right. }
      assert (En : endings t tr = endings t later ++ Sent m :: endings t earlier).
      { rewrite E. unfold endings. rewrite flat_map_app. cbn. now rewrite N.eqb_refl. }
      destruct (once t NP) as [Y|[Y|(p & Y)]]; rewrite En in Y; destruct (endings t later) as [|f l];
        try discriminate; injection Y as _ Y; try (rewrite Y in Ie; contradiction); destruct l; discriminate.
    + destruct (Before k) as [_ L]; [now apply Old|lia].
Qed.
Hypothesis ended : settled cfg tr.
Lemma settled_progressive : P3_progressive cfg tr.
Proof.
  intros t q Pr H. destruct (c_came _ _ ended t q H) as [(d & I & [A|A])|[[NP _]|[_ (m & L & A)]]].
  - apply in_split in I as (y & x & E). apply each_line in E as [_ E]. destruct d; try contradiction. destruct E as [[E _] _]. congruence.
  - exists q. split; [apply N.le_refl|]. exists d. auto.
  - congruence.
  - exists m. split; [lia|auto].
Qed.
End Of.
