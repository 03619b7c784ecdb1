(** * What a trace says of a timestamp, in words of its lines alone *)
From Coq Require Import List NArith Bool Lia Sorted.
From Fuseline Require Import Words.
Import ListNotations.
Open Scope N_scope.

(* ANCHOR: words *)
(** Some decision of the trace is one of [X]. *)
Definition says (tr : trace) (X : decision -> Prop) : Prop := exists d, In (Did d) tr /\ X d.

Section Of.
Variable cfg : config.

Definition opens (t : N) (d : decision) : Prop := match d with Opened _ u _ => u = t | _ => False end.
Definition requests (t p : N) (d : decision) : Prop :=
  match d with Request _ u q _ => u = t /\ q = p | _ => False end.
(** The timer of [(t, p)] is armed, due then. *)
Definition arms (t p due : N) (d : decision) : Prop :=
  match d with
  | Opened _ u (Some e) => u = t /\ p = 0 /\ due = e
  | Request _ u q e => u = t /\ q = p /\ due = e
  | _ => False
  end.
Definition holds (t p : N) (d : decision) : Prop := match d with Hold _ u q => u = t /\ q = p | _ => False end.
Definition emits (t p : N) (d : decision) : Prop := match d with Emit _ u q => u = t /\ q = p | _ => False end.
(** The result of [(t, p)] is accepted. *)
Definition accepts (t p : N) (d : decision) : Prop := holds t p d \/ emits t p d.
Definition retires (t : N) (d : decision) : Prop :=
  match d with
  | Miss _ u | Final _ u _ => u = t
  | Emit _ u _ => u = t /\ is_progressive cfg = false
  | _ => False
  end.
(** An output of [q] outranks [p] or is its own. *)
Definition outdone (p q : N) : Prop := q = p \/ is_progressive cfg = true /\ p < q.
(** [(t, p)] is pending no more. *)
Definition closes (t p : N) (d : decision) : Prop :=
  match d with
  | Timer _ u q | Hold _ u q | Failed _ u q => u = t /\ q = p
  | Emit _ u q => u = t /\ outdone p q
  | _ => False
  end.
(** What came of [(t, p)]: its result, its failure or its timer. *)
Definition answers (t p : N) (d : decision) : Prop :=
  match d with Timer _ u q | Hold _ u q | Failed _ u q | Emit _ u q => u = t /\ q = p | _ => False end.
(** The timer of [(t, p)] is live no more. *)
Definition disarms (t p : N) (d : decision) : Prop :=
  match d with
  | Timer _ u q | Failed _ u q => u = t /\ q = p
  | Hold _ u q => u = t /\ q = p /\ (p = 0 \/ is_patient cfg = true)
  | Emit _ u q => u = t /\ outdone p q
  | _ => False
  end.

(** The timer of [(t, p)] fired, or its failure was accepted. *)
Definition gives_out (t p : N) (d : decision) : Prop :=
  match d with Timer _ u q | Failed _ u q => u = t /\ q = p | _ => False end.
(** A result of [(t, p)] that comes [now], after [earlier], is in time (section 1): its timestamp was opened, it had been
    requested, its due instant is later, if it has one, and neither its timer nor a failure of it has closed it. *)
Definition comes_in_time (earlier : trace) (now t p : N) : Prop :=
  says earlier (opens t) /\ (p <> 0 -> says earlier (requests t p)) /\
  (forall due, says earlier (arms t p due) -> now < due) /\ ~ says earlier (gives_out t p).
(** Some copy of it came in time. *)
Definition in_time (tr : trace) (t p : N) : Prop := exists later earlier now,
  tr = later ++ Got now (Result t p) :: earlier /\ comes_in_time earlier now t p.
(** The input under way is such a copy. *)
Definition arrives (tr : trace) (t p : N) : Prop := exists ds earlier now,
  tr = map Did ds ++ Got now (Result t p) :: earlier /\ comes_in_time earlier now t p.
(** Before the next input comes some decision that is one of [X]; [later] is what follows an input or a decision. *)
Definition soon (later : trace) (X : decision -> Prop) : Prop := exists newer d ds,
  later = newer ++ Did d :: map Did ds /\ X d.

(* ANCHOR_END: words *)
(** What a timestamp sent and how it ended. *)
Inductive ending := Sent (p : N) | Ended (p : N) | Missed.
Definition end_of (t : N) (d : decision) : list ending :=
  match d with
  | Emit _ u p => if u =? t then [Sent p] else []
  | Final _ u p => if u =? t then [Ended p] else []
  | Miss _ u => if u =? t then [Missed] else []
  | _ => []
  end.
(** The newest first, as the trace. *)
Definition endings (t : N) (tr : trace) : list ending :=
  flat_map (fun l => match l with Did d => end_of t d | Got _ _ => [] end) tr.
Definition falling (ps : list N) : Prop := StronglySorted (fun newer older => older < newer) ps.
(** Of an open timestamp. *)
Definition running (cache : list N) (l : list ending) : Prop :=
  if is_progressive cfg then exists ps, l = map Sent ps /\ falling ps /\ cache = firstn 1 ps else l = [].
(** Of a retired one. *)
Definition done (l : list ending) : Prop :=
  if is_progressive cfg then l = [Missed] \/ exists p ps, l = Ended p :: Sent p :: map Sent ps /\ falling (p :: ps)
  else l = [Missed] \/ exists p, l = [Sent p].

(** ** After more decisions *)
Lemma says_after ds tr X : says (after ds tr) X <-> (exists d, In d ds /\ X d) \/ says tr X.
Proof.
  unfold says, after. setoid_rewrite in_app_iff. setoid_rewrite <- in_rev. setoid_rewrite in_map_iff. split.
  - intros (d & [(e & E & I)|I] & H); [injection E as ->|]; eauto.
  - intros [(d & I & H)|(d & I & H)]; exists d; split; auto. left. eauto.
Qed.
Lemma says_got now b tr X : says (Got now b :: tr) X <-> says tr X.
Proof. split; intros (d & I & H); exists d; split; auto; [destruct I as [[=]|I]; auto|right; auto]. Qed.
Lemma arrives_after ds tr t p : arrives tr t p -> arrives (after ds tr) t p.
Proof.
  intros (y & x & now & -> & H). exists (rev ds ++ y), x, now. unfold after. rewrite map_app, <- map_rev, app_assoc. auto.
Qed.
Lemma soon_more newer later X : soon later X -> soon (newer ++ later) X.
Proof. intros (y & d & ds & -> & H). exists (newer ++ y), d, ds. rewrite app_assoc. auto. Qed.
(** Where a line of a longer trace stands. *)
Lemma in_after_split d ds tr later earlier : after ds tr = later ++ Did d :: earlier ->
  (exists a b, ds = a ++ d :: b /\ earlier = after a tr /\ later = map Did (rev b)) \/
  exists y, tr = y ++ Did d :: earlier /\ later = rev (map Did ds) ++ y.
Proof.
  revert later. induction ds as [|e ds IH] using rev_ind; intros later E; [right; exists later; auto|].
  unfold after in E. rewrite map_app, rev_app_distr in E. cbn in E. destruct later as [|l later].
  - injection E as -> <-. left. exists ds, []. auto.
  - injection E as <- E. destruct (IH later E) as [(a & b & -> & -> & ->)|(y & -> & ->)].
    + left. exists a, (b ++ [e]). rewrite <- app_assoc, rev_app_distr. auto.
    + right. exists y. rewrite map_app, rev_app_distr. auto.
Qed.
Lemma got_after_split now b ds tr later earlier : map Did ds ++ tr = later ++ Got now b :: earlier ->
  exists y, tr = y ++ Got now b :: earlier /\ later = map Did ds ++ y.
Proof.
  revert later. induction ds as [|d ds IH]; intros later E; [exists later; auto|].
  destruct later as [|l later]; [discriminate|]. injection E as <- E. destruct (IH later E) as (y & -> & ->).
  exists y. auto.
Qed.
Lemma end_of_short t d : rev (end_of t d) = end_of t d.
Proof. destruct d; cbn; auto; destruct (_ =? _); auto. Qed.
Lemma endings_after t ds tr : endings t (after ds tr) = rev (flat_map (end_of t) ds) ++ endings t tr.
Proof.
  unfold endings, after. rewrite flat_map_app. f_equal. induction ds as [|d ds IH]; cbn; auto.
  rewrite flat_map_app, IH, rev_app_distr. cbn. now rewrite app_nil_r, end_of_short.
Qed.
Lemma no_endings t ds : (forall d, In d ds -> end_of t d = []) -> flat_map (end_of t) ds = [].
Proof. induction ds as [|d ds IH]; intros H; cbn; auto. rewrite H, IH; cbn; auto. intros; apply H; cbn; auto. Qed.

Lemma sent_in t m tr : says tr (emits t m) <-> In (Sent m) (endings t tr).
Proof.
  unfold says, endings. rewrite in_flat_map. split.
  - intros (d & I & H). exists (Did d). split; auto. destruct d; cbn in *; try tauto. destruct H as [-> ->].
    rewrite N.eqb_refl. now left.
  - intros ([n b|d] & I & H); [contradiction|]. exists d. split; auto.
    destruct d; cbn in *; try tauto; destruct (N.eqb_spec t0 t) as [->|]; cbn in H; intuition congruence.
Qed.
Lemma closes_how t p d : closes t p d -> answers t p d \/ exists q, emits t q d /\ p < q.
Proof. destruct d; cbn; try tauto. unfold outdone. intros [-> [->|[_ ?]]]; eauto. Qed.
Lemma disarms_closes t p d : disarms t p d -> closes t p d.
Proof. destruct d; cbn; tauto. Qed.

(** What a trace says can be read from it. *)
Lemma opens_dec t d : {opens t d} + {~ opens t d}.
Proof. destruct d; cbn; auto. apply N.eq_dec. Qed.
Lemma retires_dec t d : {retires t d} + {~ retires t d}.
Proof. destruct d; cbn; auto; try apply N.eq_dec. destruct (N.eq_dec t0 t), (is_progressive cfg); try tauto; right;
  intros [_ ?]; discriminate. Qed.
Lemma outdone_dec p q : {outdone p q} + {~ outdone p q}.
Proof.
  unfold outdone. destruct (N.eq_dec q p); [left; auto|]. destruct (is_progressive cfg); [|right; intros [?|[? _]];
    congruence].
  destruct (p <? q) eqn:L; [apply N.ltb_lt in L; left; auto|apply N.ltb_ge in L; right; intros [?|[_ ?]]; [auto|lia]].
Qed.
Lemma disarms_dec t p d : {disarms t p d} + {~ disarms t p d}.
Proof.
  assert (A : forall u q (X : Prop), {X} + {~ X} -> {u = t /\ q = p /\ X} + {~ (u = t /\ q = p /\ X)}).
  { intros u q X [?|?]; destruct (N.eq_dec u t), (N.eq_dec q p); tauto. }
  destruct d as [? ? ?|? u q|? u q|? ? ? ?|? ? ? ?|? u q|? ? ? ?|? u q|? ? ?|? ?|? ? ?]; cbn [disarms]; auto.
  - destruct (N.eq_dec u t), (N.eq_dec q p); tauto.
  - destruct (N.eq_dec u t), (N.eq_dec q p); tauto.
  - apply A. destruct (N.eq_dec p 0); [tauto|]. destruct (is_patient cfg); [tauto|right; intros [?|?]; congruence].
  - destruct (N.eq_dec u t), (outdone_dec p q); tauto.
Qed.
Lemma closes_dec t p d : {closes t p d} + {~ closes t p d}.
Proof.
  destruct d as [? ? ?|? u q|? u q|? ? ? ?|? ? ? ?|? u q|? ? ? ?|? u q|? ? ?|? ?|? ? ?]; cbn [closes]; auto;
    destruct (N.eq_dec u t); try tauto; [destruct (N.eq_dec q p); tauto..|destruct (outdone_dec p q); tauto].
Qed.
Lemma says_dec tr (X : decision -> Prop) : (forall d, {X d} + {~ X d}) -> {says tr X} + {~ says tr X}.
Proof.
  intros D. induction tr as [|[n b|d] tr [H|H]].
  - right. intros (d & [] & _).
  - left. now apply says_got.
  - right. now rewrite says_got.
  - left. destruct H as (e & I & E). exists e. split; auto. now right.
  - destruct (D d) as [E|E]; [left; exists d; split; auto; now left|right].
    intros (e & [[= ->]|I] & F); auto. apply H. exists e. auto.
Qed.

(** ** What is kept of one open timestamp *)

(** Its sets by themselves. *)
Record slot_ok (sl : slot) : Prop := {
  ok_zero : In 0 (requested sl);
  ok_pending : forall p, In p (pending sl) -> In p (requested sl);
  ok_cached : forall p, In p (cached sl) -> In p (requested sl);
  ok_apart : forall p, In p (cached sl) -> ~ In p (pending sl);
  ok_waits : exists p, In p (pending sl);
  ok_prompt : forall c, In c (cached sl) -> exists q, In q (pending sl) /\ c < q;
  ok_better : is_progressive cfg = true -> forall c q, In c (cached sl) -> In q (pending sl) -> c < q;
  ok_timer : forall p, In p (pending sl) -> p <> 0 -> exists due, In (p, due) (armed sl);
  ok_armed : forall p due, In (p, due) (armed sl) ->
    In p (pending sl) \/ In p (cached sl) /\ is_eager cfg = true /\ p <> 0
}.
(** Its sets beside the trace: each is what the trace says. *)
Record traced (tr : trace) (t : N) (sl : slot) : Prop := {
  a_open : says tr (opens t);
  a_requested : forall p, In p (requested sl) <-> p = 0 \/ says tr (requests t p);
  a_pending : forall p, In p (pending sl) <-> In p (requested sl) /\ ~ says tr (closes t p);
  a_cached : is_progressive cfg = false -> forall p, In p (cached sl) <-> says tr (holds t p);
  a_never : is_progressive cfg = true -> forall p, ~ says tr (holds t p);
  a_armed : forall p due, In (p, due) (armed sl) <-> says tr (arms t p due) /\ ~ says tr (disarms t p);
  a_got : forall p, says tr (accepts t p) -> exists c, In c (cached sl) /\ p <= c;
  a_known : forall p, says tr (answers t p) -> In p (requested sl);
  a_running : running (cached sl) (endings t tr)
}.
End Of.

(** The timestamp that a decision is about, if it moves anything. *)
Definition topic (d : decision) : option N :=
  match d with
  | Opened _ t _ | Failed _ t _ | Timer _ t _ | Request _ t _ _ | Hold _ t _ | Emit _ t _ | Final _ t _ | Miss _ t
  | Cancel _ t _ => Some t
  | Refuse _ _ _ _ | Drop _ _ _ _ => None
  end.
Definition about (t : N) (d : decision) : Prop := topic d = Some t.
