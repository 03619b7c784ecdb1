(** * T3 worth it and T5 censored: the deadline of least mean loss, and what it is computed from

    Ages and deadlines are whole nanoseconds, shares and losses are rationals. *)
From Coq Require Import List QArith Lqa Bool Arith Lia Sorted.
From Fuseline Require Import Guard.
Import ListNotations.
Open Scope Q_scope.

(** ** T5: the estimate of Kaplan and Meier *)

(** A call that was answered at an age, or given up at it: then it was seen until that age. *)
Record call := { age : nat; answered : bool }.
Definition given_up (c : call) : Prop := answered c = false.
Definition seen (u : nat) (calls : list call) : nat := length (filter (fun c => (u <=? age c)%nat) calls).
Definition came (u : nat) (calls : list call) : nat := length (filter (fun c => answered c && (age c =? u)%nat) calls).
Definition factor (calls : list call) (u : nat) : Q := 1 - count (came u calls) / count (seen u calls).
(** The share that is not answered by [t]: the product of the factors of all ages up to [t]. Where no answer came the
    factor is 1, so these are the distinct answers. *)
Fixpoint survival (calls : list call) (t : nat) : Q :=
  factor calls t * match t with O => 1 | S u => survival calls u end.

Lemma count_succ n : count (S n) == 1 + count n.
Proof. unfold count. rewrite Nat2Z.inj_succ. unfold Z.succ. rewrite inject_Z_plus. ring. Qed.
Lemma count_plus a b : count (a + b) == count a + count b.
Proof. unfold count. rewrite Nat2Z.inj_add, inject_Z_plus. reflexivity. Qed.
Lemma count_pos n : n <> O -> 0 < count n.
Proof. intros N. unfold count. change 0 with (inject_Z 0). rewrite <- Zlt_Qlt. lia. Qed.
Lemma seen_less u calls : (forall c, In c calls -> given_up c -> age c <> u) ->
  seen u calls = (came u calls + seen (S u) calls)%nat.
Proof.
  unfold seen, came. induction calls as [|[g a] calls IH]; intros H; auto. cbn [filter age answered].
  assert (X := H _ (or_introl eq_refl)). cbn in X. specialize (IH (fun c I => H c (or_intror I))).
  destruct (Nat.leb_spec u g), (Nat.eqb_spec g u), (Nat.leb_spec (S u) g); try lia; destruct a; cbn [andb length];
    try lia; elim X; auto; reflexivity.
Qed.
Lemma seen_all calls : seen 0 calls = length calls.
Proof. unfold seen. induction calls as [|c calls IH]; cbn; auto. Qed.
(* ANCHOR: T5 *)
(** Where nothing was given up by [t], the estimate is the share of the calls that were not answered by then. *)
Theorem t5_share calls t : (forall c, In c calls -> given_up c -> (t < age c)%nat) ->
  survival calls t * count (length calls) == count (seen (S t) calls).
(* ANCHOR_END: T5 *)
Proof.
  intros H. assert (F : forall u, (u <= t)%nat -> factor calls u * count (seen u calls) == count (seen (S u) calls)).
  { intros u U. assert (E := seen_less u calls). specialize (E ltac:(intros c I G; specialize (H c I G); lia)).
    unfold factor. destruct (Nat.eq_dec (seen u calls) 0) as [Z|Z].
    - assert (seen (S u) calls = O) as -> by lia. rewrite Z. unfold count. cbn. ring.
    - assert (P := count_pos _ Z). assert (X : count (seen u calls) == count (came u calls) + count (seen (S u) calls))
        by (rewrite E at 1; apply count_plus).
      setoid_replace ((1 - count (came u calls) / count (seen u calls)) * count (seen u calls))
        with (count (seen u calls) - count (came u calls)) by (field; lra). lra. }
  rewrite <- (seen_all calls). clear H. induction t as [|t IH]; cbn [survival].
  - rewrite <- (F O) by lia. ring.
  - rewrite <- (F (S t)) by lia. rewrite <- IH by auto. ring.
Qed.
(** Until it was given up, a call counts as any that was answered later: it was not fast, and nothing says it was lost. *)
Theorem t5_until g calls t later : (t <= g)%nat -> (t < age later)%nat ->
  survival ({| age := g; answered := false |} :: calls) t == survival (later :: calls) t.
Proof.
  intros G L. assert (F : forall u, (u <= t)%nat -> factor ({| age := g; answered := false |} :: calls) u == factor (later :: calls) u).
  { intros u U. unfold factor, seen, came. cbn [filter age answered andb].
    destruct (Nat.leb_spec u g), (Nat.leb_spec u (age later)), (Nat.eqb_spec (age later) u); try lia.
    rewrite andb_false_r. reflexivity. }
  clear G L. induction t as [|t IH]; cbn [survival]; rewrite F by lia; [|rewrite IH by auto]; reflexivity.
Qed.
(** And for later answers it counts no longer. *)
Theorem t5_no_longer g calls u : (g < u)%nat -> factor ({| age := g; answered := false |} :: calls) u == factor calls u.
Proof. intros L. unfold factor, seen, came. cbn. destruct (Nat.leb_spec u g); [lia|reflexivity]. Qed.

(** Three calls are answered at 10, 30 and 40, and one is given up at 20. *)
Definition calls_of (given : list call) : list call :=
  [{| age := 10; answered := true |}; {| age := 30; answered := true |}; {| age := 40; answered := true |}] ++ given.
Example t5_happens : survival (calls_of [{| age := 20; answered := false |}]) 30 == 3 # 8.
Proof. vm_compute. reflexivity. Qed.
(** An estimate that takes it for fast, or for lost, or leaves it out, is another one. *)
Example t5_can_break : map (fun given => Qeq_bool (survival (calls_of given) 30) (3 # 8))
  [[{| age := 20; answered := true |}]; [{| age := 1000; answered := false |}]; []] = [false; false; false].
Proof. vm_compute. reflexivity. Qed.

(** ** T3: the deadline of least mean loss *)
Section T3.
(** The observed answers, in ascending order, each with the share of calls that are answered then; what a result costs
    that is sent at an age, of the cloud and of local; local's least and greatest response, and the cap. *)
Variables (steps : list (nat * Q)) (cloud local : nat -> Q) (shortest greatest cap : nat).
Definition before (d : nat) : list (nat * Q) := filter (fun s => (fst s <? d)%nat) steps.
Definition total (f : nat * Q -> Q) (l : list (nat * Q)) : Q := fold_right (fun s sum => f s + sum) 0 l.
Definition late (d : nat) : Q := 1 - total snd (before d).
(** What is answered before the deadline has the cloud's result, all else local's. *)
Definition mean (d : nat) : Q := total (fun s => snd s * cloud (fst s)) (before d) + late d * local (Nat.max d greatest).
(** What [Expected] looks at: local's least response, and one nanosecond after each answer. *)
Definition candidates : list nat :=
  filter (fun d => (shortest <? d)%nat && (d <=? cap)%nat) (map (fun s => S (fst s)) steps).
Fixpoint choose (best : nat) (l : list nat) : nat :=
  match l with [] => best | d :: rest => choose (if ltb (mean d) (mean best) then d else best) rest end.
Definition chosen : nat := choose shortest candidates.

Hypothesis ascending : Sorted (fun a b => (fst a < fst b)%nat) steps.
(** Shares are shares, and a later result of local is worth no more. *)
Hypothesis shares : forall d, 0 <= late d.
Hypothesis later_costs : forall x y, (x <= y)%nat -> local x <= local y.

Lemma before_same c d : (forall s, In s steps -> (fst s < c <-> fst s < d)%nat) -> before c = before d.
Proof.
  unfold before. clear ascending. induction steps as [|s l IH]; intros H; auto. cbn [filter]. rewrite IH by (intros; apply H; now right).
  specialize (H s (or_introl eq_refl)). destruct (Nat.ltb_spec (fst s) c), (Nat.ltb_spec (fst s) d); auto; lia.
Qed.
(** Between two answers a longer deadline gains nothing. *)
Lemma looked_at d : (shortest <= d <= cap)%nat -> exists c, (c = shortest \/ In c candidates) /\ (c <= d)%nat /\
  forall s, In s steps -> (fst s < c <-> fst s < d)%nat.
Proof.
  induction d as [|d IH]; intros [L C].
  - exists O. split; [left; lia|]. split; [auto|tauto].
  - destruct (Nat.eq_dec shortest (S d)) as [E|E]; [exists (S d); split; auto; split; [auto|tauto]|].
    destruct (in_dec Nat.eq_dec (S d) (map (fun s => S (fst s)) steps)) as [I|I].
    + exists (S d). split; [right|split; [auto|tauto]]. apply filter_In. split; auto.
      apply andb_true_iff. split; [apply Nat.ltb_lt|apply Nat.leb_le]; lia.
    + destruct IH as (c & K & Le & N); [lia|]. exists c. split; auto. split; [lia|]. intros s J. specialize (N s J).
      assert (fst s <> d) by (intros X; apply I; apply in_map_iff; exists s; split; auto). lia.
Qed.
Lemma looked_mean c d : (c <= d)%nat -> (forall s, In s steps -> (fst s < c <-> fst s < d)%nat) -> mean c <= mean d.
Proof.
  intros L N. unfold mean, late. rewrite (before_same c d N). assert (P := shares d). unfold late in P.
  assert (Q := later_costs (Nat.max c greatest) (Nat.max d greatest) ltac:(lia)).
  assert (X := Qmult_le_compat_r _ _ _ Q P). lra.
Qed.
Lemma ltb_not x y : ltb x y = false -> y <= x.
Proof. unfold ltb. intros H. apply negb_false_iff in H. now apply Qle_bool_iff. Qed.
Lemma choose_least l : forall best, StronglySorted lt (best :: l) -> forall d, In d (best :: l) ->
  mean (choose best l) <= mean d /\ (mean (choose best l) == mean d -> (choose best l <= d)%nat).
Proof.
  induction l as [|x l IH]; intros best So d I; cbn [choose].
  - destruct I as [<-|[]]. split; [apply Qle_refl|auto].
  - inversion So as [|? ? Sx B]; subst. inversion B as [|? ? Bx Bl]; subst. inversion Sx as [|? ? Sl Xl]; subst.
    destruct (ltb (mean x) (mean best)) eqn:L.
    + apply ltb_iff in L. destruct I as [<-|I]; [|now apply IH].
      destruct (IH x Sx x (or_introl eq_refl)) as [A _]. split; lra.
    + apply ltb_not in L. assert (Sb : StronglySorted lt (best :: l)) by (constructor; auto).
      destruct I as [<-|[<-|I]]; [apply IH; cbn; auto| |apply IH; cbn; auto].
      destruct (IH best Sb best (or_introl eq_refl)) as [A O]. split; [lra|]. intros E.
      assert (X : mean (choose best l) == mean best) by lra. specialize (O X). lia.
Qed.
Lemma candidates_sorted : StronglySorted lt (shortest :: candidates).
Proof.
  assert (T : StronglySorted (fun a b => (fst a < fst b)%nat) steps).
  { apply Sorted_StronglySorted; auto. intros a b c. lia. }
  unfold candidates. clear ascending shares. constructor.
  - induction T as [|s l T IH F]; [constructor|]. cbn. destruct (_ && _); auto. constructor; auto.
    apply Forall_forall. intros d I. apply filter_In in I as [I _]. apply in_map_iff in I as (x & <- & I).
    rewrite Forall_forall in F. specialize (F x I). lia.
  - apply Forall_forall. intros d I. apply filter_In in I as [_ I]. apply andb_true_iff in I as [I _].
    now apply Nat.ltb_lt in I.
Qed.
(* ANCHOR: T3 *)
(** T3: no deadline from local's least response to the cap has a lesser mean loss, and none that is shorter has as little. *)
Theorem t3_least_loss d : (shortest <= d <= cap)%nat ->
  mean chosen <= mean d /\ (mean chosen == mean d -> (chosen <= d)%nat).
(* ANCHOR_END: T3 *)
Proof.
  intros L. destruct (looked_at d L) as (c & K & Le & N). assert (M := looked_mean c d Le N).
  destruct (choose_least candidates shortest candidates_sorted c) as [A B]; [destruct K as [->|K]; cbn; auto|].
  unfold chosen. split; [lra|]. intros E. assert (X : mean (choose shortest candidates) == mean c) by lra.
  specialize (B X). lia.
Qed.
(** And it lies between them. *)
Theorem t3_within : (shortest <= cap)%nat -> (shortest <= chosen <= cap)%nat.
Proof.
  intros L. assert (C : forall l best, (shortest <= best <= cap)%nat -> (forall d, In d l -> (shortest <= d <= cap)%nat) ->
    (shortest <= choose best l <= cap)%nat).
  { induction l as [|x l IH]; intros best B H; cbn; auto. apply IH; [|intros; apply H; cbn; auto].
    destruct (ltb _ _); auto. apply H. cbn. auto. }
  apply C; [lia|]. intros d I. apply filter_In in I as [_ I]. apply andb_true_iff in I as [A B].
  apply Nat.ltb_lt in A. apply Nat.leb_le in B. lia.
Qed.
End T3.

(** Half of the calls are answered after 30 ns, a quarter after 90; the cloud's results cost 1, local's 4 and a tenth for
    each nanosecond after 20: it is worth to wait for the first, and not for the second. *)
Definition answers_at : list (nat * Q) := [(30%nat, 1 # 2); (90%nat, 1 # 4)].
Definition local_costs (d : nat) : Q := 4 + (1 # 10) * count (d - 20).
Example t3_happens : chosen answers_at (fun _ => 1) local_costs 10 20 100 = 31%nat.
Proof. vm_compute. reflexivity. Qed.
(** A choice that looks at an answer's own instant, at which it is late, loses more. *)
Example t3_can_break : mean answers_at (fun _ => 1) local_costs 20 31 < mean answers_at (fun _ => 1) local_costs 20 30.
Proof. vm_compute. reflexivity. Qed.
