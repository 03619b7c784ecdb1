(** * How a trace that breaks a promise is found by computing

    Each lemma takes a question that Coq answers with [true] by computing,
      about one trace and what to look at in it, and
    concludes that the promise does not hold of that trace. Examples.v and the seeded faults (faults.toml) use them.
    *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Words Trace Statements.
From Fuseline Require Export Computed.
Import ListNotations.
Open Scope N_scope.

Section Of.
Variables (cfg : config) (tr : trace).
Local Notation says_it A := (proj2 (sayb_iff tr _ _ A)).
Local Notation says_not A := (not_sayb tr _ _ A).
Ltac parts H := repeat lazymatch type of H with is _ _ _ _ = true => fail | _ => apply andb_true_iff in H as [H ?] end.

Lemma broken_p1 t : negb (is_progressive cfg) && match endings t tr with [] | [Missed] | [Sent _] => false |
  _ => true end = true ->
  ~ P1_once cfg tr.
Proof.
  intros H P. parts H. apply negb_true_iff in H.
  destruct (P t H) as [E|[E|(p & E)]]; rewrite E in *; discriminate.
Qed.
Fixpoint sents (newer : option N) (l : list ending) : bool :=
  match l with
  | [] => true
  | Sent p :: rest => match newer with Some n => p <? n | None => true end && sents (Some p) rest
  | _ => false
  end.
Lemma sents_falling ps : falling ps -> forall n, (forall p, In p ps -> p < n) ->
  sents (Some n) (map Sent ps) = true /\ sents None (map Sent ps) = true.
Proof.
  induction ps as [|p ps IH]; intros F n B; cbn; auto. inversion F as [|? ? F1 F2]; subst.
  rewrite Forall_forall in F2.
  destruct (IH F1 p F2) as [A _]. rewrite A. assert (X := B p (or_introl eq_refl)). apply N.ltb_lt in X.
  now rewrite X.
Qed.
Lemma falling_bound ps : exists n, forall p : N, In p ps -> p < n.
Proof.
  induction ps as [|x ps (n & IH)]; [exists 0; intros p []|]. exists (N.max n (x + 1)). intros p [<-|I]; [lia|].
  specialize (IH p I). lia.
Qed.
Lemma broken_p1_progressive t : is_progressive cfg && negb (match endings t tr with
    | [Missed] => true | Ended p :: Sent q :: rest => (p =? q) &&
      sents None (Sent q :: rest) | l => sents None l end) = true ->
  ~ P1_progressive cfg tr.
Proof.
  intros H P. parts H. destruct (P t H) as [(ps & E & F)|[E|(p & ps & E & F)]]; rewrite E in *; cbn in *.
  - destruct (falling_bound ps) as (n & B). destruct (sents_falling ps F n B) as [_ S].
    destruct ps as [|x ps]; cbn in *; [discriminate|]. rewrite S in H0. discriminate.
  - discriminate.
  - destruct (falling_bound (p :: ps)) as (n & B). destruct (sents_falling (p :: ps) F n B) as [_ S]. cbn in S.
    rewrite N.eqb_refl, S in H0. discriminate.
Qed.
Lemma broken_p2 t p : some_line (fun earlier d => b_holds t p d && negb (b_arrives t p earlier) ||
  b_emits t p d && negb (b_arrives t p earlier) && negb (sayb earlier (b_holds t p))) tr = true -> ~ P2_never_late tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). destruct (P y d x t p E) as [A B].
  apply orb_true_iff in H as [H|H]; parts H.
  - apply holds_b, A, arrives_b in H. rewrite H in *. discriminate.
  - apply emits_b, B in H as [H|H]; [apply arrives_b in H|apply (sayb_iff x _ _ (holds_b t p)) in H]; rewrite H in *; discriminate.
Qed.
Lemma broken_p2_late t p : some_split (fun later l earlier => match l with
    | Got now (Result u q) => is t p u q && existsb (fun a => (fst a =? p) && (snd a <=? now)) (armed_in t earlier) &&
        forallb (fun d => match d with Drop n v r _ => negb (is t p v r && (n =? now)) | _ => true end) (next_run [] later)
    | _ => false end) [] tr = true -> ~ P2_late_dropped tr.
Proof.
  intros H P. apply some_split_if in H as (y & l & x & E & H). destruct l as [now [| |u q| |]|]; try discriminate.
  parts H. apply is_iff in H as [-> ->]. apply existsb_exists in H1 as ([q due] & I & H). apply andb_true_iff in H as [Eq L].
  apply N.eqb_eq in Eq. cbn in Eq, L. subst q. apply N.leb_le in L. apply armed_in_iff in I.
  destruct (soon_run _ _ (P y now t p x due E I L)) as (d & J & why & ->). rewrite forallb_forall in H0.
  specialize (H0 _ J). cbn in H0. unfold is in H0. rewrite !N.eqb_refl in H0. discriminate.
Qed.
Lemma broken_p3 t m q : some_line (fun earlier d => b_emits t m d &&
  (sayb earlier (b_holds t q) || b_in_time t q (before_input earlier))) tr && (m <? q) = true -> ~ P3_best_available tr.
Proof.
  intros H P. apply andb_true_iff in H as [H L]. apply some_line_if in H as (y & d & x & E & H). parts H.
  destruct d; try discriminate. apply is_iff in H as [-> ->]. apply N.ltb_lt in L.
  assert (X : says x (holds t q) \/ in_time (before_input x) t q); [|specialize (P y _ t m x q E X); lia].
  apply orb_true_iff in H0 as [H0|H0]; [left; now apply (sayb_iff x _ _ (holds_b t q))|right; now apply in_time_b].
Qed.
Lemma broken_p3_progressive t q : is_progressive cfg && b_in_time t q tr &&
  forallb (fun e => match e with Sent m => m <? q | _ => true end) (endings t tr) = true -> ~ P3_progressive cfg tr.
Proof.
  intros H P. parts H. apply in_time_b in H1. destruct (P t q H H1) as (m & L & E). apply sent_in in E.
  rewrite forallb_forall in H0. specialize (H0 _ E). apply N.ltb_lt in H0. lia.
Qed.
Lemma broken_p4 t c : sayb tr (b_holds t c) && negb (sayb tr (b_retires cfg t)) &&
    forallb (fun q => (q <=? c) || sayb tr (b_closes cfg t q)) (requested_in t tr) = true -> ~ P4_prompt cfg tr.
Proof.
  intros H P. parts H. apply (says_it (holds_b t c)) in H. apply (says_not (retires_b cfg t)) in H1.
  destruct (P t c H H1) as (q & R & C & M). specialize (M c H). apply requested_in_if in R.
  rewrite forallb_forall in H0.
  specialize (H0 q R). cbn in H0. apply orb_true_iff in H0 as [H0|H0]; [apply N.leb_le in H0; lia|].
  now apply C, (says_it (closes_b cfg t q)).
Qed.
Definition no_output (t : N) : bool := forallb (fun e => match e with Sent _ => false | _ => true end) (endings t tr).
Lemma broken_p5 t p : sayb tr (b_accepts t p) && past true t tr && no_output t = true -> ~ P5_local_floor tr.
Proof.
  intros H P. parts H. apply (says_it (accepts_b t p)) in H. destruct (P t p H (past_cloud t tr H1)) as (m & E).
  apply sent_in in E. unfold no_output in H0. rewrite forallb_forall in H0. now apply H0 in E.
Qed.
Lemma broken_p6 t : sayb tr (b_holds t 0) && match requested_in t tr with [] => true | _ => false end = true ->
  ~ P6_free_without_cloud tr.
Proof.
  intros H P. parts H. apply (says_it (holds_b t 0)) in H. destruct (P t H) as (p & R). apply requested_in_if in R.
  destruct (requested_in t tr); [contradiction|discriminate].
Qed.
Lemma broken_p7 t : negb (sayb tr (b_retires cfg t)) && sayb tr (b_closes cfg t 0) && no_live cfg t tr = true ->
  ~ P7_no_stall cfg tr.
Proof.
  intros H P. parts H. apply (says_not (retires_b cfg t)) in H.
  destruct (P t H) as [C|L]; [now apply C, (says_it (closes_b cfg t 0))|now apply no_live_not in L].
Qed.
Lemma broken_p7_with_deadline t : existsb (fun a => fst a =? 0) (armed_in t tr) &&
  negb (sayb tr (b_retires cfg t)) && no_live cfg t tr = true ->
  ~ P7_with_deadline cfg tr.
Proof.
  intros H P. parts H. apply existsb_exists in H as ([p x] & I & E). apply N.eqb_eq in E. cbn in E. subst.
  apply armed_in_iff in I. apply (says_not (retires_b cfg t)) in H1. specialize (P t x I H1).
  now apply no_live_not in P.
Qed.
Lemma broken_p7_retired t : existsb (fun a => fst a =? 0) (armed_in t tr) && past false t tr &&
  negb (sayb tr (b_retires cfg t)) = true ->
  ~ P7_retired cfg tr.
Proof.
  intros H P. parts H. apply existsb_exists in H as ([p x] & I & E). apply N.eqb_eq in E. cbn in E. subst.
  apply armed_in_iff in I. apply (says_not (retires_b cfg t)) in H0. apply H0, (P t x I). now apply past_all.
Qed.
Lemma broken_p8_one t p a b : existsb (fun x => is p a (fst x) (snd x)) (armed_in t tr) &&
  existsb (fun x => is p b (fst x) (snd x)) (armed_in t tr) &&
    negb (a =? b) = true -> ~ P8_one_timer tr.
Proof.
  intros H P. parts H. apply negb_true_iff, N.eqb_neq in H0. apply H0, (P t p); apply armed_in_iff.
  - apply existsb_exists in H as ([q x] & I & E). apply is_iff in E as [E1 E2]. cbn in *. now subst.
  - apply existsb_exists in H1 as ([q x] & I & E). apply is_iff in E as [E1 E2]. cbn in *. now subst.
Qed.
Lemma broken_p8_served t p due : existsb (fun x => is p due (fst x) (snd x)) (armed_in t tr) &&
  (due <=? clock_of tr) &&
    negb (sayb tr (b_retires cfg t)) && negb (sayb tr (b_disarms cfg t p)) = true -> ~ P8_served cfg tr.
Proof.
  intros H P. parts H. apply existsb_exists in H as ([q x] & I & E). apply is_iff in E as [E1 E2]. cbn in *. subst.
  apply armed_in_iff in I. apply N.leb_le in H2. apply (says_not (retires_b cfg t)) in H1.
  apply (says_not (disarms_b cfg t p)) in H0.
  now apply H0, (P t p due).
Qed.
Lemma broken_p8_fires t p : some_line (fun earlier d => match d with
    | Timer _ u q => is t p u q && forallb (fun a => negb (fst a =? p) || (clock_of earlier <? snd a)) (armed_in t earlier)
    | _ => false end) tr = true -> ~ P8_fires tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). destruct d; try discriminate. parts H.
  apply is_iff in H as [-> ->]. destruct (P y now t p x E) as (due & A & L). apply armed_in_iff in A.
  rewrite forallb_forall in H0. specialize (H0 _ A). cbn in H0. rewrite N.eqb_refl in H0. cbn in H0. apply N.ltb_lt in H0. lia.
Qed.
Lemma broken_p8_while_live t p : some_line (fun earlier d => match d with
    | Timer _ u q => is t p u q && (sayb earlier (b_disarms cfg t p) || sayb earlier (b_retires cfg t))
    | _ => false end) tr = true -> ~ P8_while_live cfg tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). destruct d; try discriminate.
  apply andb_true_iff in H as [H D]. apply is_iff in H as [-> ->]. destruct (P y now t p x E) as [A B].
  apply orb_true_iff in D as [D|D]; [apply A; now apply (sayb_iff x _ _ (disarms_b cfg t p))|].
  apply B. now apply (sayb_iff x _ _ (retires_b cfg t)).
Qed.
Lemma broken_f0 : some_line (fun earlier d => negb (instant_of d =? clock_of earlier)) tr = true -> ~ F0_instants tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). rewrite (P y d x E), N.eqb_refl in H. discriminate.
Qed.
Lemma broken_f1 : some_line (fun earlier d => negb (b_f1_line cfg earlier d)) tr = true -> ~ F1_open cfg tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). rewrite (f1_line_b cfg x d (P y d x E)) in H. discriminate.
Qed.
Lemma broken_f2 : some_line (fun earlier d => negb (b_f2_line cfg earlier d)) tr = true -> ~ F2_offer cfg tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). rewrite (f2_line_b cfg x d (P y d x E)) in H. discriminate.
Qed.
Lemma broken_f3 : some_line (fun earlier d => negb (b_f3_line cfg earlier d)) tr = true -> ~ F3_arrival cfg tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). rewrite (f3_line_b cfg x d (P y d x E)) in H. discriminate.
Qed.
Lemma broken_f6 t m q : some_line (fun earlier d => match d with
    | Emit now u k => is t m u k && sayb earlier (b_requests t q) && negb (sayb earlier (b_closes cfg t q)) &&
        (negb (is_eager cfg) || forallb (fun e => match e with Timer n v r => negb (is t r v r && (n =? now)) || (r =? 0) | _ => true end)
          (since_input earlier))
    | _ => false end) tr && negb (is_progressive cfg) && (m <? q) = true -> ~ F6_commits cfg tr.
Proof.
  intros H P. parts H. apply some_line_if in H as (y & d & x & E & H). destruct d as [| | | | | | |now u k| | |]; try discriminate.
  parts H. apply is_iff in H as [-> ->]. apply (sayb_iff x _ _ (requests_b t q)) in H4. apply (not_sayb x _ _ (closes_b cfg t q)) in H3.
  apply negb_true_iff in H1. apply N.ltb_lt in H0. destruct (P y now t m x q E H1 H0 H4 H3) as (Ea & p & Z & I).
  rewrite Ea in H2. cbn [negb orb] in H2. rewrite forallb_forall in H2. specialize (H2 _ I). cbn in H2. unfold is in H2.
  rewrite !N.eqb_refl in H2. now apply N.eqb_eq in H2.
Qed.
Lemma broken_f7 t q : some_line (fun earlier d => match d with
    | Cancel _ u r => is t q u r && ((q =? 0) || negb (sayb earlier (b_requests t q)) || sayb earlier (b_answers t q))
    | _ => false end) tr = true -> ~ F7_cancelled tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). destruct d; try discriminate.
  apply andb_true_iff in H as [H D]. apply is_iff in H as [-> ->]. destruct (P y now t q x E) as (Z & R & A).
  apply orb_true_iff in D as [D|D]; [apply orb_true_iff in D as [D|D]; [now apply N.eqb_eq in D|]|].
  - now rewrite (proj1 (sayb_iff x _ _ (requests_b t q)) R) in D.
  - apply A. now apply (sayb_iff x _ _ (answers_b t q)).
Qed.
Lemma broken_f7_cancels t m q : some_split (fun later l earlier => match l with
    | Did (Emit now u k) => is t m u k && sayb earlier (b_requests t q) && negb (sayb earlier (b_closes cfg t q)) &&
        forallb (fun d => match d with Cancel n v r => negb (is t q v r && (n =? now)) | _ => true end) (next_run [] later)
    | _ => false end) [] tr && negb (q =? m) && (negb (is_progressive cfg) || (q <? m)) = true -> ~ F7_cancels cfg tr.
Proof.
  intros H P. parts H. apply some_split_if in H as (y & l & x & E & H).
  destruct l as [|[| | | | | | |now u k| | |]]; try discriminate. parts H. apply is_iff in H as [-> ->].
  apply (sayb_iff x _ _ (requests_b t q)) in H4. apply (not_sayb x _ _ (closes_b cfg t q)) in H3.
  apply negb_true_iff, N.eqb_neq in H1. assert (L : is_progressive cfg = true -> q < m).
  { intros Pr. rewrite Pr in H0. now apply N.ltb_lt. }
  destruct (soon_run _ _ (P y now t m x q E H4 H3 H1 L)) as (d & J & ->). rewrite forallb_forall in H2.
  specialize (H2 _ J). cbn in H2. unfold is in H2. rewrite !N.eqb_refl in H2. discriminate.
Qed.
Lemma broken_p12 t : sayb tr (b_closes cfg t 0) && past true t tr && negb (sayb tr (b_retires cfg t)) = true ->
  ~ P12_bounded_wait cfg tr.
Proof.
  intros H P. parts H. apply (says_it (closes_b cfg t 0)) in H.
  apply (says_not (retires_b cfg t)) in H0. apply H0, (P t H). now apply past_cloud.
Qed.
End Of.

Lemma broken_p11_result cfg now t p ds : match ds with [] => true | _ => false end = true ->
  ~ own cfg now (Result t p) ds.
Proof.
  destruct ds as [|d ds]; [|discriminate]. intros _ [(w & E)|[(E & _)|(cs & last & E & _)]]; discriminate.
Qed.
(** Two lists, of which one has more of some kind. *)
Lemma apart {A} (kind : A -> bool) (a b : list A) : negb (Nat.eqb (length (filter kind a)) (length (filter kind b)))
  = true -> a <> b.
Proof. intros H ->. now rewrite PeanoNat.Nat.eqb_refl in H. Qed.
Lemma broken_t1 tr now t : existsb (fun l => match l with Did (Hold n u q) => is t 0 u q &&
  (n =? now) | _ => false end) tr &&
    forallb (fun a => (snd a <=? now) || (fst a =? 0)) (armed_in t tr) = true -> ~ Local_goes_at_once tr.
Proof.
  intros H P. apply andb_true_iff in H as [H F]. apply existsb_exists in H as ([n b|d] & I & E); [discriminate|].
  destruct d; try discriminate. apply andb_true_iff in E as [E1 E2]. apply is_iff in E1 as [-> ->].
  apply N.eqb_eq in E2 as ->.
  destruct (P now t I) as (p & due & Z & A & L). apply armed_in_iff in A. rewrite forallb_forall in F.
  specialize (F _ A). cbn in F.
  apply orb_true_iff in F as [F|F]; [apply N.leb_le in F; lia|]. apply N.eqb_eq in F. contradiction.
Qed.
(** ** E1 to E3 *)
Definition b_budgeted (tr : trace) (t a due reserve : N) : bool :=
  match open_inputs t tr with [(x, Some d)] => (x =? a) && (d <=? N.max 1 (due - reserve - a)) | _ => false end &&
  forallb (fun l => match l with Got now (Offer u _ d _) => negb (u =? t) || (d <=? due - reserve - now) | _ => true end) tr.
Lemma budgeted_b tr t a due reserve : b_budgeted tr t a due reserve = true -> budgeted tr t a due reserve.
Proof.
  intros H. apply andb_true_iff in H as [O F]. split.
  - destruct (open_inputs t tr) as [|[x [d|]] [|y l]]; try discriminate. apply andb_true_iff in O as [E L].
    apply N.eqb_eq in E as ->. apply N.leb_le in L. eauto.
  - intros now p d bl I. rewrite forallb_forall in F. specialize (F _ I). cbn in F. rewrite N.eqb_refl in F.
    now apply N.leb_le in F.
Qed.
Definition b_punctual (late : N) (tr : trace) : bool :=
  forallb (fun l => match l with
    | Did (Opened _ _ (Some due)) | Did (Request _ _ _ due) => negb (due <=? clock_of tr) ||
        existsb (fun i => match i with Got now _ => (due <=? now) && (now <=? due + late) | Did _ => false end) tr
    | _ => true end) tr.
Lemma punctual_b late tr : b_punctual late tr = true -> punctual late tr.
Proof.
  unfold b_punctual. rewrite forallb_forall. intros F t p due (d & I & A) L. apply N.leb_le in L.
  assert (E : existsb (fun i => match i with Got now _ => (due <=? now) && (now <=? due + late) | Did _ => false end) tr
    = true).
  { specialize (F _ I). destruct d as [n u [e|]| | | |n u q e| | | | | |]; cbn in A; try contradiction;
      destruct A as (_ & _ & ->); rewrite L in F; exact F. }
  apply existsb_exists in E as ([now b|x] & J & E); [|discriminate]. apply andb_true_iff in E as [E1 E2].
  apply N.leb_le in E1. apply N.leb_le in E2. eauto.
Qed.
Lemma broken_e1 cfg tr t a due reserve late : b_budgeted tr t a due reserve && b_punctual late tr &&
  (ends a due reserve <=? clock_of tr) &&
  negb (match last_items cfg t tr with [d] => instant_of d <=? ends a due reserve + late | _ => false end) = true ->
  ~ E1_one_item cfg tr.
Proof.
  intros H P. apply andb_true_iff in H as [H N]. apply andb_true_iff in H as [H C]. apply andb_true_iff in H as [B T].
  apply N.leb_le in C. destruct (P t a due reserve late (budgeted_b _ _ _ _ _ B) (punctual_b _ _ T) C) as (d & E & L).
  rewrite E in N. apply N.leb_le in L. now rewrite L in N.
Qed.
Lemma broken_e2 cfg1 cfg2 tr1 tr2 t u a b due reserve1 reserve2 late gap :
  b_budgeted tr1 t a due reserve1 && b_punctual late tr1 && (ends a due reserve1 <=? clock_of tr1) &&
  match last_items cfg1 t tr1 with [d] => (instant_of d <=? b) && (b <=? instant_of d + gap) | _ => true end &&
  b_budgeted tr2 u b due reserve2 && b_punctual late tr2 && (ends b due reserve2 <=? clock_of tr2) &&
  negb (match last_items cfg2 u tr2 with [d] => instant_of d <=? due | _ => false end) &&
  (late <=? reserve2) && (reserve2 + late + gap + 1 <=? reserve1) && (reserve1 + a <? due) = true ->
  ~ E2_by_the_deadline cfg1 cfg2 tr1 tr2.
Proof.
  intros H P. apply andb_true_iff in H as [H L3]. apply andb_true_iff in H as [H L2]. apply andb_true_iff in H as [H L1].
  apply andb_true_iff in H as [H N]. apply andb_true_iff in H as [H C2]. apply andb_true_iff in H as [H T2].
  apply andb_true_iff in H as [H B2]. apply andb_true_iff in H as [H Gap]. apply andb_true_iff in H as [H C1].
  apply andb_true_iff in H as [B1 T1]. apply N.leb_le in L1. apply N.leb_le in L2. apply N.ltb_lt in L3.
  apply N.leb_le in C1. apply N.leb_le in C2.
  destruct (P t u a b due reserve1 reserve2 late gap) as (d & E & _ & L); auto using budgeted_b, punctual_b.
  - intros d E. rewrite E in Gap. apply andb_true_iff in Gap as [X1 X2]. apply N.leb_le in X1. apply N.leb_le in X2. auto.
  - rewrite E in N. specialize (L L1 L2 L3). apply N.leb_le in L. now rewrite L in N.
Qed.
Lemma broken_e3 tr t a due reserve : b_budgeted tr t a due reserve &&
  existsb (fun x => negb (fst x =? 0) && (due - reserve <? snd x)) (armed_in t tr) = true -> ~ E3_budget tr.
Proof.
  intros H P. apply andb_true_iff in H as [H E]. apply existsb_exists in E as ([p x] & I & E). cbn in E.
  apply andb_true_iff in E as [Z L]. apply negb_true_iff, N.eqb_neq in Z. apply N.ltb_lt in L. apply armed_in_iff in I.
  specialize (P t a due reserve p x (budgeted_b _ _ _ _ _ H) Z I). lia.
Qed.
