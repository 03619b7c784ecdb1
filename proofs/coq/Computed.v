(** * What a trace says, computed

    Each lemma takes a question that Coq answers with [true] by computing to a word of Trace.v or a table of
    Statements.v. *)
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
Definition b_gives_out t p d := match d with Timer _ u q | Failed _ u q => is t p u q | _ => false end.
Definition b_answers t p d :=
  match d with Timer _ u q | Hold _ u q | Failed _ u q | Emit _ u q => is t p u q | _ => false end.
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
Lemma gives_out_b t p d : gives_out t p d <-> b_gives_out t p d = true. Proof. revert d. compute_iff. Qed.
Lemma answers_b t p d : answers t p d <-> b_answers t p d = true. Proof. revert d. compute_iff. Qed.
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
(** No due instant of [t], local's apart if [cloud_only], is later than the clock. *)
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

(** Some line, beside what follows it and the trace before it. *)
Fixpoint some_split (f : trace -> line -> trace -> bool) (later tr : trace) : bool :=
  match tr with [] => false | l :: rest => f later l rest || some_split f (later ++ [l]) rest end.
Lemma some_split_if f tr : forall before, some_split f before tr = true -> exists later l earlier,
  before ++ tr = later ++ l :: earlier /\ f later l earlier = true.
Proof.
  induction tr as [|l tr IH]; cbn; [discriminate|]. intros before H. apply orb_true_iff in H as [H|H]; [eauto|].
  destruct (IH _ H) as (y & k & x & E & F). exists y, k, x. rewrite <- E, <- app_assoc. auto.
Qed.
(** The decisions before the next input. *)
Fixpoint next_run (found : list decision) (later : trace) : list decision :=
  match later with [] => found | Got _ _ :: rest => next_run [] rest | Did d :: rest => next_run (found ++ [d]) rest end.
Lemma next_run_app a b : forall found, next_run found (a ++ b) = next_run (next_run found a) b.
Proof. induction a as [|[n x|d] a IH]; intros found; cbn; auto. Qed.
Lemma next_run_did ds : forall found, next_run found (map Did ds) = found ++ ds.
Proof. induction ds as [|d ds IH]; intros found; cbn; [now rewrite app_nil_r|]. now rewrite IH, <- app_assoc. Qed.
Lemma soon_run later X : soon later X -> exists d, In d (next_run [] later) /\ X d.
Proof.
  intros (y & d & ds & -> & H). exists d. split; auto. change (Did d :: map Did ds) with (map Did (d :: ds)).
  rewrite next_run_app, next_run_did. apply in_elt.
Qed.

(** ** In time, computed *)
Definition b_comes (earlier : trace) (now t p : N) : bool :=
  sayb earlier (b_opens t) && ((p =? 0) || sayb earlier (b_requests t p)) &&
  forallb (fun a => negb (fst a =? p) || (now <? snd a)) (armed_in t earlier) && negb (sayb earlier (b_gives_out t p)).
Lemma comes_b earlier now t p : comes_in_time earlier now t p <-> b_comes earlier now t p = true.
Proof.
  unfold comes_in_time, b_comes. rewrite !andb_true_iff, orb_true_iff, N.eqb_eq, negb_true_iff, <- not_true_iff_false, forallb_forall.
  rewrite <- !(sayb_iff earlier _ _ (opens_b t)), <- !(sayb_iff earlier _ _ (requests_b t p)),
    <- !(sayb_iff earlier _ _ (gives_out_b t p)).
  assert (D : (forall due, says earlier (arms t p due) -> now < due) <->
    forall a, In a (armed_in t earlier) -> negb (fst a =? p) || (now <? snd a) = true).
  { split.
    - intros H [q due] I. cbn. destruct (N.eqb_spec q p) as [->|]; cbn; auto. apply N.ltb_lt, H. now apply armed_in_iff.
    - intros H due A. apply armed_in_iff in A. apply H in A. cbn in A. rewrite N.eqb_refl in A. now apply N.ltb_lt. }
  rewrite D. destruct (N.eq_dec p 0); tauto.
Qed.
Fixpoint b_arrives (t p : N) (l : trace) : bool :=
  match l with
  | Did _ :: rest => b_arrives t p rest
  | Got now (Result u q) :: earlier => is t p u q && b_comes earlier now t p
  | _ => false
  end.
Lemma arrives_b tr t p : arrives tr t p -> b_arrives t p tr = true.
Proof.
  intros (ds & x & now & -> & C). induction ds as [|d ds IH]; cbn; auto. apply comes_b in C. rewrite C.
  unfold is. now rewrite !N.eqb_refl.
Qed.
Fixpoint b_in_time (t p : N) (l : trace) : bool :=
  match l with
  | [] => false
  | Got now (Result u q) :: earlier => is t p u q && b_comes earlier now t p || b_in_time t p earlier
  | _ :: earlier => b_in_time t p earlier
  end.
Lemma in_time_b tr t p : b_in_time t p tr = true -> in_time tr t p.
Proof.
  assert (More : forall l tr, in_time tr t p -> in_time (l :: tr) t p).
  { intros l x (y & z & now & -> & C). exists (l :: y), z, now. auto. }
  induction tr as [|[now b|d] tr IH]; cbn; [discriminate| |auto]. destruct b; auto. intros H.
  apply orb_true_iff in H as [H|H]; auto. apply andb_true_iff in H as [H C]. apply is_iff in H as [-> ->].
  exists [], tr, now. split; auto. now apply comes_b.
Qed.

(** ** The tables, computed *)

(** Row by row, as far as none above it holds. *)
Fixpoint same (rows : list (reason * Prop)) (computed : list (reason * bool)) : Prop :=
  match rows, computed with
  | [], [] => True
  | (why, P) :: rest, (w, b) :: more => why = w /\ (P <-> b = true) /\ (b = false -> same rest more)
  | _, _ => False
  end.
Fixpoint first_of (rows : list (reason * bool)) : option reason :=
  match rows with [] => None | (why, holds) :: rest => if holds then Some why else first_of rest end.
Lemma answer_first rows : forall computed o, same rows computed -> (answer rows o <-> first_of computed = o).
Proof.
  induction rows as [|[why P] rows IH]; intros [|[w b] computed] o H; try contradiction; cbn in *.
  - split; congruence.
  - destruct H as (-> & E & R). destruct b.
    + split; [intros [[_ ->]|[N _]]; [reflexivity|elim N; now apply E]|]. intros <-. left. split; auto. now apply E.
    + rewrite <- (IH computed o (R eq_refl)). assert (N : ~ P) by (rewrite E; discriminate). tauto.
Qed.
Definition open_now (cfg : config) (tr : trace) : list N :=
  nodup N.eq_dec (filter (fun u => negb (sayb tr (b_retires cfg u))) (opened_in tr)).
Lemma open_now_in cfg tr u : In u (open_now cfg tr) <-> says tr (opens u) /\ ~ says tr (retires cfg u).
Proof.
  unfold open_now. rewrite nodup_In, filter_In, <- opened_in_iff, negb_true_iff.
  rewrite (sayb_iff tr _ _ (retires_b cfg u)). destruct (sayb tr _); intuition congruence.
Qed.
Section Tables.
Variables (cfg : config) (tr : trace).
Definition b_reached t := existsb (N.leb t) (opened_in tr).
Definition b_f1_rows now t (deadline : option N) : list (reason * bool) := [
  (Order, b_reached t); (Full, window cfg <=? N.of_nat (length (open_now cfg tr)));
  (Deadline, match deadline with Some d => due_at now d <=? now | None => false end)].
Definition b_closed t := negb (sayb tr (b_opens t)) || sayb tr (b_retires cfg t).
Definition b_asked t p := (p =? 0) || sayb tr (b_requests t p).
Definition said_above (emitted : bool) t p :=
  sayb tr (fun d => match d with Emit _ u q => (u =? t) && (p <? q) | Hold _ u q => negb emitted && ((u =? t) && (p <? q)) | _ => false end).
Definition b_shuts p backlog :=
  match registered cfg p with Some c => if gate_of p tr then resume c <? backlog else limit c <=? backlog | None => false end.
Definition b_f2_rows now t p deadline backlog : list (reason * bool) := [
  (Unknown, negb (is_cloud cfg p) || negb (b_reached t)); (Closed, b_closed t); (Duplicate, b_asked t p);
  (Outranked, said_above false t p); (Deadline, due_at now deadline <=? now); (Queue, b_shuts p backlog)].
Definition b_f3_rows t p : list (reason * bool) := [
  (Unknown, negb (p =? 0) && negb (is_cloud cfg p) || negb (b_reached t));
  (Superseded, b_closed t || is_progressive cfg && said_above true t p); (Unsolicited, negb (b_asked t p));
  (Duplicate, sayb tr (b_accepts t p)); (Late, sayb tr (b_gives_out t p))].
Lemma reached_b t : (exists u, t <= u /\ says tr (opens u)) <-> b_reached t = true.
Proof.
  unfold b_reached. rewrite existsb_exists. split; intros (u & A & B).
  - exists u. split; [now apply opened_in_iff|now apply N.leb_le].
  - exists u. split; [now apply N.leb_le|now apply opened_in_iff].
Qed.
Lemma not_reached_b t : not_reached tr t <-> b_reached t = false.
Proof.
  rewrite <- not_true_iff_false, <- reached_b. unfold not_reached. split; [intros H (u & L & O); now apply (H u)|].
  intros H u L O. apply H. eauto.
Qed.
Lemma closed_b t : ~ says tr (opens t) \/ says tr (retires cfg t) <-> b_closed t = true.
Proof.
  unfold b_closed. rewrite orb_true_iff, negb_true_iff, <- not_true_iff_false.
  now rewrite (sayb_iff tr _ _ (opens_b t)), (sayb_iff tr _ _ (retires_b cfg t)).
Qed.
Lemma asked_b t p : asked tr t p <-> b_asked t p = true.
Proof. unfold asked, b_asked. now rewrite orb_true_iff, N.eqb_eq, (sayb_iff tr _ _ (requests_b t p)). Qed.
Lemma above_b t p : (exists q, p < q /\ says tr (accepts t q)) <-> said_above false t p = true.
Proof.
  unfold said_above. rewrite <- (sayb_iff tr (fun d => exists q, p < q /\ accepts t q d)).
  - split; [intros (q & L & d & I & A); exists d; eauto|intros (d & I & q & L & A); exists q; split; auto; exists d; auto].
  - intros d. unfold accepts. split.
    + intros (q & L & A). apply N.ltb_lt in L. destruct d; destruct A as [A|A]; try contradiction; destruct A as [-> ->];
        cbn; now rewrite N.eqb_refl, L.
    + destruct d; cbn; try discriminate; intros H; apply andb_true_iff in H as [E L]; apply N.eqb_eq in E as ->;
        apply N.ltb_lt in L; eexists; split; eauto.
Qed.
Lemma outdone_above_b t p : (exists q, p < q /\ says tr (emits t q)) <-> said_above true t p = true.
Proof.
  unfold said_above. rewrite <- (sayb_iff tr (fun d => exists q, p < q /\ emits t q d)).
  - split; [intros (q & L & d & I & A); exists d; eauto|intros (d & I & q & L & A); exists q; split; auto; exists d; auto].
  - intros d. split.
    + intros (q & L & A). apply N.ltb_lt in L. destruct d; try contradiction; destruct A as [-> ->]. cbn. now rewrite N.eqb_refl, L.
    + destruct d; cbn; try discriminate. intros H; apply andb_true_iff in H as [E L]; apply N.eqb_eq in E as ->;
        apply N.ltb_lt in L; eexists; split; eauto.
Qed.
Lemma full_b n : at_least_open cfg tr n <-> (n <=? N.of_nat (length (open_now cfg tr))) = true.
Proof.
  rewrite N.leb_le. split.
  - intros (ts & D & L & H). assert (X := NoDup_incl_length (l' := open_now cfg tr) D).
    enough (incl ts (open_now cfg tr)) as I by (specialize (X I); lia). intros u I. now apply open_now_in, H.
  - intros L. exists (open_now cfg tr). split; [apply NoDup_nodup|]. split; auto. intros u I. now apply open_now_in.
Qed.
Lemma shuts_b p backlog : shuts cfg tr p backlog <-> b_shuts p backlog = true.
Proof.
  unfold shuts, b_shuts. destruct (registered cfg p) as [c|]; [|split; [intros (c & [=] & _)|discriminate]].
  destruct (gate_of p tr); rewrite ?N.ltb_lt, ?N.leb_le;
    (split; [intros (d & [= <-] & L); exact L|intros L; exists c; auto]).
Qed.
Lemma f1_rows_b now t deadline : same (f1_rows cfg tr now t deadline) (b_f1_rows now t deadline).
Proof.
  cbn. split; [auto|]. split; [apply reached_b|]. intros _. split; [auto|]. split; [apply full_b|]. intros _. split; [auto|].
  split; [|auto]. split; [intros (d & -> & L); now apply N.leb_le|]. destruct deadline as [d|]; [|discriminate].
  intros L. exists d. split; auto. now apply N.leb_le.
Qed.
Lemma f2_rows_b now t p deadline backlog : same (f2_rows cfg tr now t p deadline backlog) (b_f2_rows now t p deadline backlog).
Proof.
  cbn. repeat (split; [auto|]; split; [|intros _]); [|apply closed_b|apply asked_b|apply above_b|symmetry; apply N.leb_le|
    apply shuts_b|auto]. now rewrite not_reached_b, orb_true_iff, !negb_true_iff.
Qed.
Lemma f3_rows_b t p : same (f3_rows cfg tr t p) (b_f3_rows t p).
Proof.
  cbn. repeat (split; [auto|]; split; [|intros _]); [| | | |apply (sayb_iff tr _ _ (gives_out_b t p))|auto].
  - now rewrite not_reached_b, orb_true_iff, andb_true_iff, !negb_true_iff, N.eqb_neq.
  - now rewrite <- or_assoc, closed_b, orb_true_iff, andb_true_iff, outdone_above_b.
  - now rewrite asked_b, negb_true_iff, not_true_iff_false.
  - apply (sayb_iff tr _ _ (accepts_b t p)).
Qed.
Definition reason_dec (a b : option reason) : {a = b} + {a <> b}. Proof. repeat decide equality. Defined.
Definition due_dec (a b : option N) : {a = b} + {a <> b}. Proof. repeat decide equality. Defined.
Definition is_answer (rows : list (reason * bool)) (o : option reason) : bool := if reason_dec (first_of rows) o then true else false.
Lemma answer_b rows computed o : same rows computed -> answer rows o -> is_answer computed o = true.
Proof. intros S A. unfold is_answer. apply (answer_first rows computed o S) in A. now destruct (reason_dec _ _). Qed.
Definition b_f1_line (d : decision) : bool :=
  match d with
  | Opened now t due => match input_of tr with
      | Some (Open u x) => (u =? t) && (if due_dec due (option_map (due_at now) x) then true else false) &&
          is_answer (b_f1_rows now t x) None
      | _ => false end
  | Refuse now t None why => match input_of tr with
      | Some (Open u x) => (u =? t) && is_answer (b_f1_rows now t x) (Some why) | _ => false end
  | _ => true
  end.
Definition b_f2_line (d : decision) : bool :=
  match d with
  | Request now t p due => match input_of tr with
      | Some (Offer u q x bl) => is t p u q && (due =? due_at now x) && is_answer (b_f2_rows now t p x bl) None | _ => false end
  | Refuse now t (Some p) why => match input_of tr with
      | Some (Offer u q x bl) => is t p u q && is_answer (b_f2_rows now t p x bl) (Some why) | _ => false end
  | _ => true
  end.
Definition b_came (results failures : bool) t p : bool :=
  match input_of tr with Some (Result u q) => results && is t p u q | Some (Fail u q) => failures && is t p u q | _ => false end.
Definition b_f3_line (d : decision) : bool :=
  match d with
  | Drop _ t p why => b_came true true t p && is_answer (b_f3_rows t p) (Some why)
  | Hold _ t p => negb (is_progressive cfg) && b_came true false t p && is_answer (b_f3_rows t p) None
  | Failed _ t p => b_came false true t p && is_answer (b_f3_rows t p) None
  | Emit _ t p => sayb tr (b_holds t p) || b_came true false t p && is_answer (b_f3_rows t p) None
  | _ => true
  end.
Lemma f1_line_b d : f1_line cfg tr d -> b_f1_line d = true.
Proof.
  destruct d as [now t due| | |now t [|] why| | | | | | |]; cbn [f1_line b_f1_line]; auto.
  - intros (x & -> & -> & A). rewrite N.eqb_refl, (answer_b _ _ _ (f1_rows_b now t x) A). now destruct (due_dec _ _).
  - intros (x & -> & A). now rewrite N.eqb_refl, (answer_b _ _ _ (f1_rows_b now t x) A).
Qed.
Lemma f2_line_b d : f2_line cfg tr d -> b_f2_line d = true.
Proof.
  destruct d as [| | |now t [p|] why|now t p due| | | | | |]; cbn [f2_line b_f2_line]; auto; unfold is.
  - intros (x & bl & -> & A). now rewrite !N.eqb_refl, (answer_b _ _ _ (f2_rows_b now t p x bl) A).
  - intros (x & bl & -> & -> & A). now rewrite !N.eqb_refl, (answer_b _ _ _ (f2_rows_b now t p x bl) A).
Qed.
Lemma f3_line_b d : f3_line cfg tr d -> b_f3_line d = true.
Proof.
  destruct d as [|now t p| | | |now t p|now t p why|now t p| | |]; cbn [f3_line b_f3_line]; auto; unfold b_came, is.
  - intros [-> A]. now rewrite !N.eqb_refl, (answer_b _ _ _ (f3_rows_b t p) A).
  - intros (-> & -> & A). now rewrite !N.eqb_refl, (answer_b _ _ _ (f3_rows_b t p) A).
  - intros [[-> | ->] A]; now rewrite !N.eqb_refl, (answer_b _ _ _ (f3_rows_b t p) A).
  - intros [H|[-> A]]; [now rewrite (proj1 (sayb_iff tr _ _ (holds_b t p)) H)|].
    rewrite !N.eqb_refl, (answer_b _ _ _ (f3_rows_b t p) A). apply orb_true_r.
Qed.
End Tables.
