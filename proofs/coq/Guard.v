(** * T2 and T4: the deadline of the guard

    [guard] is what `Guard::judge` of `fuseline-deadline` computes, over the rationals: no axiom is needed, and every
    number of a computer is one. SPEC.md has the conditions, and the
    book's chapter of safe deadlines the proof in prose. *)
From Coq Require Import List QArith Qminmax Lqa Bool Lia.
Import ListNotations.
Open Scope Q_scope.

(** A figure that is not known exactly. *)
Record span := { least : Q; greatest : Q }.
Definition within (x : Q) (s : span) : Prop := least s <= x <= greatest s.
Definition exactly (x : Q) : span := {| least := x; greatest := x |}.
Definition count (n : nat) : Q := inject_Z (Z.of_nat n).

(** A class of hazards: from how far away local and the cloud report it. *)
Record hazard := { range_local : span; range_cloud : span }.
Record figures := {
  deceleration : span; brake_delay : span; frames : nat; period_local : span; period_cloud : span;
  local_response : span; lateness : Q; margin : Q; classes : list hazard
}.

(** ** What the guard computes *)

(** How long after its capture a result may come, if all goes well; [rows] is the time that the row of frames takes. *)
Definition budget (range speed brakes delay rows : Q) : Q := range / speed - speed / (2 * brakes) - delay - rows.
Definition in_sight (range : Q) (reveal : option Q) : Q :=
  match reveal with Some nearest => Qmin range nearest | None => range end.
Section Guard.
Variables (f : figures) (speed : span) (reveal : option Q).
(** Until when local's results surely suffice, from when on they surely do not, and until when the cloud's may. *)
Definition surely (h : hazard) : Q :=
  budget (in_sight (least (range_local h)) reveal) (greatest speed) (least (deceleration f)) (greatest (brake_delay f))
    (count (frames f) * greatest (period_local f)).
Definition lost (h : hazard) : Q :=
  budget (greatest (range_local h)) (least speed) (greatest (deceleration f)) (least (brake_delay f))
    ((count (frames f) - 1) * least (period_local f)).
Definition perhaps (h : hazard) : Q :=
  budget (in_sight (greatest (range_cloud h)) reveal) (least speed) (greatest (deceleration f)) (least (brake_delay f))
    (count (frames f) * least (period_cloud f)).
Definition ltb (x y : Q) : bool := negb (Qle_bool y x).
Definition local_stops (h : hazard) : bool := Qle_bool (greatest (local_response f)) (surely h - lateness f).
Definition local_collides (h : hazard) : bool :=
  negb (local_stops h) && ltb 0 (least speed) && ltb (lost h) (least (local_response f)).
Definition guard : Q :=
  let shortest := least (local_response f) in
  if existsb (fun h => negb (local_stops h || local_collides h)) (classes f) then shortest (* case 3 *)
  else match map surely (filter local_stops (classes f)) with
  | b :: bs => (* case 1 *)
      Qmax (greatest (local_response f)) (fold_right Qmin b bs - lateness f - margin f / greatest speed)
  | [] => (* case 2 *)
      match map perhaps (classes f) with
      | c :: cs => let d := fold_right Qmax c cs - lateness f in if ltb shortest d then d else shortest
      | [] => shortest
      end
  end.
End Guard.

(** ** What a vehicle does *)
Section Vehicle.
(** It drives at [v]; an obstacle comes into sight [range] away, and the first frame that shows it is captured [t]
    later. Its brakes act [tau] after the decision. *)
Variables (v a tau period range t : Q) (n : nat).
(** The output for the [k]th frame that shows the obstacle is there [out k] after its capture: the vehicle decides when
    the outputs of [n] frames are there, and stops in time if it does not need more than the range. *)
Definition stops (out : nat -> Q) : Prop := exists decision,
  (forall k, (k < n)%nat -> t + count k * period + out k <= decision) /\
  v * (decision + tau) + v * v / (2 * a) <= range.
End Vehicle.

Lemma div_le a b c d : 0 < b -> 0 < d -> a * d <= c * b -> a / b <= c / d.
Proof.
  intros B D H. apply Qle_shift_div_l; auto. setoid_replace (a / b * d) with (a * d / b) by (field; lra).
  apply Qle_shift_div_r; auto.
Qed.
Lemma count_less k n : (k < n)%nat -> count k <= count n - 1.
Proof. intros L. unfold count. assert (X : (Z.of_nat k + 1 <= Z.of_nat n)%Z) by lia.
  rewrite Zle_Qle, inject_Z_plus in X. change (inject_Z 1) with 1 in X. lra. Qed.
(** Each figure at the end that leaves less time gives the lesser budget. *)
Lemma budget_least x v' a' d' f' r v a d f : 0 <= r -> x <= r -> 0 < v -> v <= v' -> 0 < a' -> a' <= a -> d <= d' ->
  f <= f' -> budget x v' a' d' f' <= budget r v a d f.
Proof.
  intros R X V V' A A' D F. unfold budget.
  assert (P : x / v' <= r / v) by (apply div_le; [lra|lra|nra]).
  assert (Q : v / (2 * a) <= v' / (2 * a')) by (apply div_le; [lra|lra|nra]). lra.
Qed.
(** The lemma of the budget: what comes within it after capture is in time, wherever the first frame lies. *)
Lemma t2_in_time v a tau period range t n r : 0 < v -> 0 < a -> t <= period ->
  r <= budget range v a tau (n * period) ->
  v * (t + (n - 1) * period + r + tau) + v * v / (2 * a) <= range.
Proof.
  unfold budget. intros V A T B.
  assert (X : v * r <= v * (range / v - v / (2 * a) - tau - n * period)) by (apply Qmult_le_l; assumption).
  assert (Y : v * (range / v - v / (2 * a) - tau - n * period) == range - v * v / (2 * a) - v * tau - v * (n *
    period)) by (field; split; lra).
  assert (Z : v * t <= v * period) by (apply Qmult_le_l; assumption).
  rewrite Y in X. clear Y B. set (k := v * v / (2 * a)) in *. clearbody k. lra.
Qed.
(** And what comes more than a period after it is surely not. *)
Lemma t2_too_late v a tau period range t n r : 0 < v -> 0 < a -> 0 <= t ->
  budget range v a tau ((n - 1) * period) < r ->
  range < v * (t + (n - 1) * period + r + tau) + v * v / (2 * a).
Proof.
  unfold budget. intros V A T B.
  assert (X : v * (range / v - v / (2 * a) - tau - (n - 1) * period) < v * r) by (apply Qmult_lt_l; assumption).
  assert (Y : v * (range / v - v / (2 * a) - tau - (n - 1) * period) == range - v * v / (2 * a) - v * tau - v *
    ((n - 1) * period)) by (field; split; lra).
  assert (Z : v * 0 <= v * t) by (apply Qmult_le_l; assumption).
  rewrite Y in X. clear Y B. set (k := v * v / (2 * a)) in *. clearbody k. lra.
Qed.

Lemma ltb_iff x y : ltb x y = true -> x < y.
Proof. unfold ltb. intros H. apply negb_true_iff in H. apply Qnot_le_lt. intros L. apply Qle_bool_iff in L. congruence. Qed.
Lemma min_below l : forall b x, In x (b :: l) -> fold_right Qmin b l <= x.
Proof.
  induction l as [|y l IH]; cbn; intros b x I.
  - destruct I as [->|[]]. apply Qle_refl.
  - assert (A := Q.le_min_l y (fold_right Qmin b l)). assert (B := Q.le_min_r y (fold_right Qmin b l)).
    destruct I as [->|[->|I]]; [|exact A|]; (eapply Qle_trans; [exact B|]; apply IH; cbn; auto).
Qed.
(** In cases 2 and 3 of a class the guard's deadline is not in the way: local alone collides, or nobody waits. *)
Lemma guard_cases f speed reveal h : In h (classes f) -> 0 < greatest speed -> 0 <= margin f ->
  greatest (local_response f) <= surely f speed reveal h - lateness f /\
    guard f speed reveal <= surely f speed reveal h - lateness f \/
  0 < least speed /\ lost f speed h < least (local_response f) \/
  guard f speed reveal == least (local_response f).
Proof.
  intros I V M. unfold guard. destruct (existsb _ _) eqn:E; [right; right; apply Qeq_refl|].
  assert (K : local_stops f speed reveal h || local_collides f speed reveal h = true).
  { destruct (_ || _) eqn:K; auto. rewrite <- E. apply existsb_exists. exists h. now rewrite K. }
  apply orb_true_iff in K as [K|K].
  2:{ unfold local_collides in K. rewrite !andb_true_iff in K. destruct K as [[_ P] L].
      apply ltb_iff in P. apply ltb_iff in L. auto. }
  assert (F : In (surely f speed reveal h) (map (surely f speed reveal) (filter (local_stops f speed reveal) (classes f)))).
  { apply in_map, filter_In. auto. }
  destruct (map _ _) as [|b bs]; [contradiction|]. apply min_below in F. unfold local_stops in K.
  apply Qle_bool_iff in K. left. split; auto. apply Q.max_lub; auto.
  assert (X : 0 <= margin f / greatest speed) by (apply Qle_shift_div_l; [auto|lra]). lra.
Qed.

(* ANCHOR: T2 *)
(** T2: with the guard's deadline or any shorter one, the vehicle stops wherever local alone would. [truth] is within
    the spans that the guard was given, and so is local's response [r] for each frame. Fusion's output for a frame is
    there no later than local's result, if the deadline is past by then, else soon after the deadline (T1's lemma). *)
Theorem t2_as_safe_as_local f speed reveal h v a tau period range t deadline (r fused : nat -> Q) :
  In h (classes f) -> (1 <= frames f)%nat -> 0 <= lateness f -> 0 <= margin f -> 0 < least (deceleration f) ->
  0 < v -> within v speed -> within a (deceleration f) -> within tau (brake_delay f) ->
  within period (period_local f) ->
  0 <= range -> in_sight (least (range_local h)) reveal <= range <= greatest (range_local h) ->
  0 <= t <= period -> (forall k, within (r k) (local_response f)) -> deadline <= guard f speed reveal ->
  (forall k, deadline <= r k -> fused k <= r k) -> (forall k, r k < deadline -> fused k <= deadline + lateness f) ->
  stops v a tau period range t (frames f) r -> stops v a tau period range t (frames f) fused.
(* ANCHOR_END: T2 *)
Proof.
  intros I N La M De V [V1 V2] [A1 A2] [T1 T2] [P1 P2] R [R1 R2] [F0 F1] Re D Past Soon Alone.
  assert (N1 : 0 <= count (frames f) - 1) by (apply (count_less 0); lia).
  destruct (guard_cases f speed reveal h I ltac:(lra) M) as [[L G]|[[S C]|E]].
  - exists (t + (count (frames f) - 1) * period + surely f speed reveal h). split.
    + intros k K. apply count_less in K. assert (X : count k * period <= (count (frames f) - 1) * period) by nra.
      assert (Y : fused k <= surely f speed reveal h).
      { destruct (Qlt_le_dec (r k) deadline) as [Z|Z]; [specialize (Soon k Z); lra|specialize (Past k Z)].
        destruct (Re k). lra. }
      lra.
    + apply t2_in_time; auto; [lra|]. apply budget_least; auto; try lra.
      assert (X : count (frames f) * period <= count (frames f) * greatest (period_local f)) by nra. exact X.
  - exfalso. destruct Alone as (x & O & St). specialize (O (frames f - 1)%nat ltac:(lia)).
    assert (Eq : count (frames f - 1) == count (frames f) - 1).
    { unfold count. rewrite Nat2Z.inj_sub by auto. unfold Z.sub. now rewrite inject_Z_plus, inject_Z_opp. }
    rewrite Eq in O. destruct (Re (frames f - 1)%nat) as [Least _].
    assert (B : budget range v a tau ((count (frames f) - 1) * period) < r (frames f - 1)%nat).
    { eapply Qle_lt_trans; [|eapply Qlt_le_trans; [exact C|exact Least]]. unfold lost. apply budget_least; try lra.
      assert (X : (count (frames f) - 1) * least (period_local f) <= (count (frames f) - 1) * period) by nra. exact X. }
    apply (t2_too_late _ _ _ _ _ t) in B; auto; [|lra].
    assert (X : v * (t + (count (frames f) - 1) * period + r (frames f - 1)%nat + tau) <= v * (x + tau)) by nra. lra.
  - destruct Alone as (x & O & St). exists x. split; auto. intros k K. specialize (O k K).
    destruct (Re k) as [Least _]. specialize (Past k ltac:(lra)). lra.
Qed.
(** What may come into sight nearer, [reveal] away, is as far off in every frame: while the vehicle drives on, the
    instant by which the output must be there stays where it is. *)
Theorem t2_reveal_stays reveal v a tau rows captured : 0 < v -> 0 < a ->
  captured + budget (reveal - v * captured) v a tau rows == budget reveal v a tau rows.
Proof. intros V A. unfold budget. field. lra. Qed.

(** ** Cases *)

(** The default vehicle, which `fuseline deadline` has figures for too. *)
Definition default : figures := {|
  deceleration := exactly (75 # 10); brake_delay := exactly (1 # 10); frames := 3;
  period_local := {| least := 33333333 # 1000000000; greatest := 33333334 # 1000000000 |};
  period_cloud := {| least := 33333333 # 1000000000; greatest := 33333334 # 1000000000 |};
  local_response := exactly (3017 # 10000); lateness := 5 # 1000; margin := 2;
  classes := [{| range_local := exactly 39; range_cloud := exactly 57 |}] |}.
Definition about (x y : Q) : bool := Qle_bool (x - (1 # 20000)) y && Qle_bool y (x + (1 # 20000)).
(** Its three cases, as the book's chapter of policies has them. *)
Example t2_as_safe_as_local_happens : map (fun x : Q * Q => about (snd x) (guard default (exactly (fst x)) None))
  [(11, 24253 # 10000); (18, 6506 # 10000); (20, 3117 # 10000); (22, 9192 # 10000); (24, 57 # 100)]
  = [true; true; true; true; true].
Proof. vm_compute. reflexivity. Qed.
Example t2_unsure_happens : guard default (exactly (208 # 10)) None == 3017 # 10000. Proof. vm_compute. reflexivity. Qed.
(** A guard that waits as long as it likes breaks it: at 18 m/s local alone stops, and after 0.7 s of waiting nobody. *)
Ltac drives := intros k K; do 3 (destruct k; [vm_compute; discriminate|]); lia.
Example t2_as_safe_as_local_can_break : stops 18 (75 # 10) (1 # 10) (1 # 30) 39 (1 # 30) 3 (fun _ => 3017 # 10000) /\
  ~ stops 18 (75 # 10) (1 # 10) (1 # 30) 39 (1 # 30) 3 (fun _ => 9 # 10).
Proof.
  split.
  - exists (11 # 20). split; [drives|vm_compute; discriminate].
  - intros (x & O & S). specialize (O 2%nat ltac:(lia)). unfold count in O. cbn in O.
    assert (X : (1 # 30) + 2 * (1 # 30) + (9 # 10) <= x) by exact O.
    assert (Y : 18 * (x + (1 # 10)) + 18 * 18 / (2 * (75 # 10)) <= 39) by exact S.
    assert (Z : 18 * 18 / (2 * (75 # 10)) == 216 # 10) by reflexivity. rewrite Z in Y. lra.
Qed.
(** T4, nearer than the range: 20 m away, without a word of it, local alone stops and the guard's 2.4 s do not. *)
Example t4_nearer : stops 11 (75 # 10) (1 # 10) (1 # 30) 20 0 3 (fun _ => 3017 # 10000) /\
  ~ stops 11 (75 # 10) (1 # 10) (1 # 30) 20 0 3 (fun _ => guard default (exactly 11) None) /\
  guard default (exactly 11) (Some 20) < 1.
Proof.
  split; [|split].
  - exists (1 # 2). split; [drives|vm_compute; discriminate].
  - intros (x & O & S). specialize (O 0%nat ltac:(lia)).
    assert (G : 24 # 10 <= guard default (exactly 11) None) by (vm_compute; discriminate).
    set (g := guard default (exactly 11) None) in *. clearbody g. unfold count in O. cbn in O.
    assert (X : 0 + 0 * (1 # 30) + g <= x) by exact O.
    assert (Y : 11 * (x + (1 # 10)) + 11 * 11 / (2 * (75 # 10)) <= 20) by exact S.
    assert (Z : 11 * 11 / (2 * (75 # 10)) == 121 # 15) by reflexivity. rewrite Z in Y. lra.
  - vm_compute. reflexivity.
Qed.
(** The square of the speed at which it hits. *)
Definition impact (v a tau range decision : Q) : Q := v * v - 2 * a * (range - v * (decision + tau)).
(** T4, how hard: at 22 m/s local alone collides, and a vehicle that waits for a silent cloud drives faster then. *)
Example t4_harder : impact 22 (75 # 10) (1 # 10) 39 ((2 # 30) + (3017 # 10000)) <
  impact 22 (75 # 10) (1 # 10) 39 ((2 # 30) + guard default (exactly 22) None).
Proof. vm_compute. reflexivity. Qed.
