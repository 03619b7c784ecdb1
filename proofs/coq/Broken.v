(** * How a trace that breaks a promise is found by computing

    Each lemma takes a question that Coq answers with [true] by computing,
      about one trace and what to look at in it, and
    concludes that the promise does not hold of that trace. Examples.v and the seeded faults (faults.toml) use them.
    *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Words Trace Statements.
Import ListNotations.
Open Scope N_scope.

Definition sayb (tr : trace) (f : decision -> bool) : bool :=
  existsb (fun l => match l with Did d => f d | Got _ _ => false end) tr.
Lemma sayb_iff tr X f : (forall d, X d <-> f d = true) -> (says tr X <-> sayb tr f = true).
Proof.
  intros H. unfold says, sayb. rewrite existsb_exists. split.
  - intros (d & I & D). exists (Did d). split; auto. now apply H.
  - intros ([n b|d] & I & D); [discriminate|]. exists d. split; auto. now apply H.
Qed.
Lemma not_sayb tr X f : (forall d, X d <-> f d = true) -> negb (sayb tr f) = true -> ~ says tr X.
Proof. intros H N S. rewrite (sayb_iff tr X f H) in S. rewrite S in N. discriminate. Qed.

Definition is (t p u q : N) : bool := (u =? t) && (q =? p).
Lemma is_iff t p u q : u = t /\ q = p <-> is t p u q = true.
Proof. unfold is. now rewrite andb_true_iff, !N.eqb_eq. Qed.
Definition b_opens t d := match d with Opened _ u _ => u =? t | _ => false end.
Definition b_requests t p d := match d with Request _ u q _ => is t p u q | _ => false end.
Definition b_holds t p d := match d with Hold _ u q => is t p u q | _ => false end.
Definition b_emits t p d := match d with Emit _ u q => is t p u q | _ => false end.
Definition b_accepts t p d := b_holds t p d || b_emits t p d.
Definition b_retires cfg t d :=
  match d with Miss _ u | Final _ u _ => u =? t | Emit _ u _ => (u =? t) &&
    negb (is_progressive cfg) | _ => false end.
Definition b_outdone cfg p q := (q =? p) || is_progressive cfg && (p <? q).
Definition b_closes cfg t p d :=
  match d with
  | Timer _ u q | Hold _ u q | Failed _ u q => is t p u q | Emit _ u q => (u =? t) && b_outdone cfg p q | _ => false
  end.
Definition b_disarms cfg t p d :=
  match d with
  | Timer _ u q | Failed _ u q => is t p u q | Hold _ u q => is t p u q && ((p =? 0) || is_patient cfg)
  | Emit _ u q => (u =? t) && b_outdone cfg p q | _ => false
  end.
Ltac compute_iff := intros d; destruct d; cbn; rewrite ?andb_true_iff, ?orb_true_iff, ?negb_true_iff, <- ?is_iff,
  ?N.eqb_eq; try tauto;
  try (split; [tauto|discriminate]).
Lemma opens_b t d : opens t d <-> b_opens t d = true. Proof. revert d. compute_iff. Qed.
Lemma requests_b t p d : requests t p d <-> b_requests t p d = true. Proof. revert d. compute_iff. Qed.
Lemma holds_b t p d : holds t p d <-> b_holds t p d = true. Proof. revert d. compute_iff. Qed.
Lemma emits_b t p d : emits t p d <-> b_emits t p d = true. Proof. revert d. compute_iff. Qed.
Lemma accepts_b t p d : accepts t p d <-> b_accepts t p d = true.
Proof. unfold accepts, b_accepts. now rewrite orb_true_iff, holds_b, emits_b. Qed.
Lemma retires_b cfg t d : retires cfg t d <-> b_retires cfg t d = true. Proof. revert d. compute_iff. Qed.
Lemma outdone_b cfg p q : outdone cfg p q <-> b_outdone cfg p q = true.
Proof. unfold outdone, b_outdone. now rewrite orb_true_iff, andb_true_iff, N.eqb_eq, N.ltb_lt. Qed.
Lemma closes_b cfg t p d : closes cfg t p d <-> b_closes cfg t p d = true.
Proof. revert d. compute_iff. now rewrite outdone_b. Qed.
Lemma disarms_b cfg t p d : disarms cfg t p d <-> b_disarms cfg t p d = true.
Proof. revert d. compute_iff. now rewrite outdone_b. Qed.

(** What was armed for [t], and what was requested. *)
Definition armed_in (t : N) (tr : trace) : list (N * N) :=
  flat_map (fun l => match l with
    | Did (Opened _ u (Some due)) => if u =? t then [(0, due)] else []
    | Did (Request _ u p due) => if u =? t then [(p, due)] else []
    | _ => [] end) tr.
Lemma armed_in_iff t tr p due : says tr (arms t p due) <-> In (p, due) (armed_in t tr).
Proof.
  unfold says, armed_in. rewrite in_flat_map. split.
  - intros (d & I & A). exists (Did d). split; auto.
    destruct d as [n u [e|]| | | |n u q e| | | | | | ]; cbn in *; try contradiction;
      destruct A as (-> & -> & ->); rewrite N.eqb_refl; now left.
  - intros ([n b|d] & I & A); [contradiction|]. exists d. split; auto.
    destruct d as [n u [e|]| | | |n u q e| | | | | | ]; cbn in *; try contradiction;
      destruct (N.eqb_spec u t) as [->|]; cbn in A; intuition congruence.
Qed.
Definition requested_in (t : N) (tr : trace) : list N :=
  flat_map (fun l => match l with Did (Request _ u p _) => if u =? t then [p] else [] | _ => [] end) tr.
Lemma requested_in_if t tr p : says tr (requests t p) -> In p (requested_in t tr).
Proof.
  intros (d & I & R). unfold requested_in. apply in_flat_map. exists (Did d). split; auto.
  destruct d; cbn in *; try contradiction. destruct R as [-> ->]. rewrite N.eqb_refl. now left.
Qed.
(** No due instant of [t], local's apart if so asked, is later than the clock. *)
Definition past (cloud_only : bool) (t : N) (tr : trace) : bool :=
  forallb (fun a => (snd a <=? clock_of tr) || cloud_only && (fst a =? 0)) (armed_in t tr).
Lemma past_cloud t tr : past true t tr = true -> forall p due, p <> 0 -> says tr (arms t p due) -> due <= clock_of tr.
Proof.
  unfold past. rewrite forallb_forall. intros H p due Z A. apply armed_in_iff in A. apply H in A. cbn in A.
  apply orb_true_iff in A as [A|A]; [now apply N.leb_le|]. now apply N.eqb_eq in A.
Qed.
Lemma past_all t tr : past false t tr = true -> forall p due, says tr (arms t p due) -> due <= clock_of tr.
Proof.
  unfold past. rewrite forallb_forall. intros H p due A. apply armed_in_iff in A. apply H in A. cbn in A.
  rewrite orb_false_r in A. now apply N.leb_le.
Qed.
(** No timer of [t] is live and due later. *)
Definition no_live (cfg : config) (t : N) (tr : trace) : bool :=
  forallb (fun a => (snd a <=? clock_of tr) || sayb tr (b_disarms cfg t (fst a))) (armed_in t tr).
Lemma no_live_not cfg t tr : no_live cfg t tr = true ->
  ~ exists p due, says tr (arms t p due) /\ ~ says tr (disarms cfg t p) /\ clock_of tr < due.
Proof.
  unfold no_live. rewrite forallb_forall. intros H (p & due & A & D & L). apply armed_in_iff in A. apply H in A.
  cbn in A.
  apply orb_true_iff in A as [A|A]; [apply N.leb_le in A; lia|]. apply D. eapply sayb_iff; [apply disarms_b|exact A].
Qed.

(** Some decision, beside the trace before it. *)
Fixpoint some_line (f : trace -> decision -> bool) (tr : trace) : bool :=
  match tr with
  | [] => false
  | Got _ _ :: rest => some_line f rest
  | Did d :: rest => f rest d || some_line f rest
  end.
Lemma some_line_if f tr : some_line f tr = true -> exists later d earlier, tr = later ++ Did d :: earlier /\ f earlier d = true.
Proof.
  induction tr as [|[n b|d] tr IH]; cbn; [discriminate| |].
  - intros H. destruct (IH H) as (y & d & x & -> & F). exists (Got n b :: y), d, x. auto.
  - intros H. apply orb_true_iff in H as [H|H]; [exists [], d, tr; auto|].
    destruct (IH H) as (y & e & x & -> & F). exists (Did d :: y), e, x. auto.
Qed.
Definition opened_in (tr : trace) : list N :=
  flat_map (fun l => match l with Did (Opened _ u _) => [u] | _ => [] end) tr.
Lemma opened_in_iff u tr : says tr (opens u) <-> In u (opened_in tr).
Proof.
  unfold says, opened_in. rewrite in_flat_map. split.
  - intros (d & I & O). exists (Did d). split; auto. destruct d; cbn in *; try contradiction. auto.
  - intros ([n b|d] & I & O); [contradiction|]. exists d. split; auto. destruct d; cbn in *; try contradiction. tauto.
Qed.

Section Of.
Variables (cfg : config) (tr : trace).
Local Notation says_it A := (proj2 (sayb_iff tr _ _ A)).
Local Notation says_not A := (not_sayb tr _ _ A).
Ltac parts H := repeat (apply andb_true_iff in H as [H ?]).

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
Fixpoint b_in_time (t p : N) (l : trace) : bool :=
  match l with
  | [] => false
  | Got now (Result u q) :: earlier =>
      is t p u q && sayb earlier (b_opens t) && ((p =? 0) || sayb earlier (b_requests t p)) &&
      forallb (fun a => negb (fst a =? p) || (now <? snd a)) (armed_in t earlier) || b_in_time t p earlier
  | _ :: earlier => b_in_time t p earlier
  end.
Lemma in_time_b t p : in_time tr t p -> b_in_time t p tr = true.
Proof.
  intros (y & x & now & -> & O & R & D).
  assert (B : b_in_time t p (Got now (Result t p) :: x) = true).
  { cbn. apply orb_true_iff. left. rewrite !andb_true_iff. repeat split.
    - now apply is_iff.
    - eapply sayb_iff; [apply opens_b|exact O].
    - apply orb_true_iff. destruct (N.eq_dec p 0) as [->|Z]; [now left|right].
      eapply sayb_iff; [apply requests_b|now apply R].
    - apply forallb_forall. intros [q due] I. cbn. destruct (N.eqb_spec q p) as [->|]; cbn; auto.
      apply N.ltb_lt. apply D. now apply armed_in_iff. }
  induction y as [|[n b|d] y IH]; cbn [app b_in_time]; auto. destruct b; auto. rewrite IH. apply orb_true_r.
Qed.
Lemma broken_p2 t p : sayb tr (b_emits t p) && negb (b_in_time t p tr) = true -> ~ P2_never_late tr.
Proof.
  intros H P. parts H. apply (says_it (emits_b t p)) in H. apply P, in_time_b in H. rewrite H in *. discriminate.
Qed.
Lemma broken_p3 t m q : sayb tr (b_emits t m) && sayb tr (b_holds t q) && (m <? q) = true -> ~ P3_best_available tr.
Proof.
  intros H P. parts H. apply (says_it (emits_b t m)) in H. apply (says_it (holds_b t q)) in H1.
  specialize (P t m q H H1).
  apply N.ltb_lt in H0. lia.
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
Lemma broken_p7 t : sayb tr (b_opens t) && negb (sayb tr (b_retires cfg t)) && sayb tr (b_closes cfg t 0) &&
  no_live cfg t tr = true ->
  ~ P7_no_stall cfg tr.
Proof.
  intros H P. parts H. apply (says_it (opens_b t)) in H. apply (says_not (retires_b cfg t)) in H2.
  destruct (P t H H2) as [C|L]; [now apply C, (says_it (closes_b cfg t 0))|now apply no_live_not in L].
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
Lemma broken_p8_fires now t p : existsb (fun l => match l with Did (Timer n u q) => is t p u q &&
  (n =? now) | _ => false end) tr &&
    forallb (fun a => negb (fst a =? p) || (now <? snd a)) (armed_in t tr) = true -> ~ P8_fires tr.
Proof.
  intros H P. parts H. apply existsb_exists in H as ([n b|d] & I & E); [discriminate|]. destruct d; try discriminate.
  apply andb_true_iff in E as [E1 E2]. apply is_iff in E1 as [-> ->]. apply N.eqb_eq in E2 as ->.
  destruct (P now t p I) as (due & A & L). apply armed_in_iff in A. rewrite forallb_forall in H0.
  specialize (H0 _ A). cbn in H0.
  rewrite N.eqb_refl in H0. cbn in H0. apply N.ltb_lt in H0. lia.
Qed.
Lemma broken_p8_while_live t p : some_line (fun earlier d =>
    match d with Timer _ u q => is t p u q && sayb earlier (b_disarms cfg t p) | _ => false end) tr = true ->
  ~ P8_while_live cfg tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H). destruct d; try discriminate.
  apply andb_true_iff in H as [H D]. apply is_iff in H as [-> ->]. apply (P y x now t p E). now apply (sayb_iff x _ _ (disarms_b cfg t p)).
Qed.
Lemma broken_f1 : some_line (fun earlier d => match d with
    | Opened _ t _ => existsb (N.leb t) (opened_in earlier)
    | Refuse _ t None Order => negb (existsb (N.leb t) (opened_in earlier))
    | _ => false end) tr = true -> ~ F1_order tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H).
  destruct d as [n t due| | |n t [q|] []| | | | | | |]; try discriminate; destruct (P y _ x n t E) as [A B].
  - apply existsb_exists in H as (u & I & L). apply opened_in_iff in I. specialize (A due eq_refl u I).
    apply N.leb_le in L. lia.
  - destruct (B eq_refl) as (u & L & O). apply negb_true_iff in H. apply opened_in_iff in O. apply N.leb_le in L.
    assert (X : existsb (N.leb t) (opened_in x) = true) by (apply existsb_exists; eauto). congruence.
Qed.
Lemma broken_f2_registered t p : sayb tr (b_requests t p) && negb (is_cloud cfg p) = true -> ~ F2_registered cfg tr.
Proof. intros H P. parts H. apply (says_it (requests_b t p)) in H. rewrite (P t p H) in *. discriminate. Qed.
Lemma broken_f2_outranks t p q : some_line (fun earlier d => b_requests t p d && sayb earlier (b_accepts t q)) tr &&
  (p <=? q) = true -> ~ F2_outranks tr.
Proof.
  intros H P. apply andb_true_iff in H as [H L]. apply some_line_if in H as (y & d & x & E & H).
  apply andb_true_iff in H as [H A]. destruct d; try discriminate. apply is_iff in H as [-> ->].
  apply N.leb_le in L. apply (sayb_iff x _ _ (accepts_b t q)) in A. specialize (P y x now t p due q E A). lia.
Qed.
Lemma broken_f2g : some_line (fun earlier d =>
    match input_of earlier with
    | Some (Offer t p _ backlog) =>
        match registered cfg p, d with
        | Some c, Request _ u q _ => is t p u q &&
            negb (if gate_of p earlier then backlog <=? resume c else backlog <? limit c)
        | Some c, Refuse _ u (Some q) Queue => is t p u q &&
            negb (if gate_of p earlier then resume c <? backlog else limit c <=? backlog)
        | _, _ => false
        end
    | _ => false end) tr = true -> ~ F2g_gate cfg tr.
Proof.
  intros H P. apply some_line_if in H as (y & d & x & E & H).
  destruct (input_of x) as [[|t p z b| | |]|] eqn:I; try discriminate. destruct (registered cfg p) as [c|] eqn:C; [|discriminate].
  destruct d as [| | |n u [q|] []|n u q due| | | | | |]; try discriminate;
    apply andb_true_iff in H as [H H0]; apply is_iff in H as [-> ->]; destruct (P y _ x n t p z b c E I C) as [A B]; apply negb_true_iff in H0.
  - specialize (B eq_refl). destruct (gate_of p x); [apply N.ltb_ge in H0|apply N.leb_gt in H0]; lia.
  - specialize (A due eq_refl). destruct (gate_of p x); [apply N.leb_gt in H0|apply N.ltb_ge in H0]; lia.
Qed.
Lemma broken_f7 t : existsb (fun l => match l with Did (Cancel _ u q) => is t 0 u q | _ => false end) tr = true ->
  ~ F7_local tr.
Proof.
  intros H P. apply existsb_exists in H as ([n b|d] & I & E); [discriminate|]. destruct d; try discriminate.
  apply is_iff in E as [-> ->]. now apply P in I.
Qed.
Lemma broken_p12 t : sayb tr (b_opens t) && sayb tr (b_closes cfg t 0) && past true t tr &&
  negb (sayb tr (b_retires cfg t)) = true ->
  ~ P12_bounded_wait cfg tr.
Proof.
  intros H P. parts H. apply (says_it (opens_b t)) in H. apply (says_it (closes_b cfg t 0)) in H2.
  apply (says_not (retires_b cfg t)) in H0. apply H0, (P t H H2). now apply past_cloud.
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
    forallb (fun a => (snd a <=? now) || (fst a =? 0)) (armed_in t tr) = true -> ~ goes_at_once tr.
Proof.
  intros H P. apply andb_true_iff in H as [H F]. apply existsb_exists in H as ([n b|d] & I & E); [discriminate|].
  destruct d; try discriminate. apply andb_true_iff in E as [E1 E2]. apply is_iff in E1 as [-> ->].
  apply N.eqb_eq in E2 as ->.
  destruct (P now t I) as (p & due & Z & A & L). apply armed_in_iff in A. rewrite forallb_forall in F.
  specialize (F _ A). cbn in F.
  apply orb_true_iff in F as [F|F]; [apply N.leb_le in F; lia|]. apply N.eqb_eq in F. contradiction.
Qed.
Lemma broken_p11_offer cfg now t p x bl ds : match ds with
    | [Request n u q due] => negb (is t p u q && (n =? now) && (due =? due_at now x)) | [Refuse _ _ _ _] => false | _ => true
    end = true -> ~ own cfg now (Offer t p x bl) ds.
Proof.
  intros H [->|(w & ->)]; [|discriminate]. unfold is in H. rewrite !N.eqb_refl in H. discriminate.
Qed.
(** A drop says that a result is late, and an output outranked it before. *)
Lemma broken_p11_reason cfg tr now t p q ds :
  existsb (fun d => match d with Drop n u r Late => is t p u r && (n =? now) | _ => false end) ds &&
    sayb tr (b_emits t q) && (p <? q) = true ->
  ~ forall why, In (Drop now t p why) ds -> meaning cfg tr t p why.
Proof.
  intros H P. apply andb_true_iff in H as [H L]. apply andb_true_iff in H as [H E]. apply N.ltb_lt in L.
  apply existsb_exists in H as (d & I & D). destruct d as [| | | | | |n u r []| | | |]; try discriminate.
  apply andb_true_iff in D as [D N]. apply is_iff in D as [-> ->]. apply N.eqb_eq in N as ->.
  apply (sayb_iff tr _ _ (emits_b t q)) in E. apply P in I as [_ M]. now apply (M q).
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
