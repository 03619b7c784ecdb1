(** * Section 8: many threads

    A call names one timestamp and bears an instant of its caller's own clock: it fires what is due by then of its own
    timestamp, then its input is applied. No call sees another one half done, since what it computes from the slot that
    it looked at is exchanged for that slot if it is there still. *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules Sets Trace Statements Slots Invariant Runs Accounts Tables Lines Arrivals Promises Ticks.
Import ListNotations.
Open Scope N_scope.
Arguments after : simpl never.
Arguments timers : simpl never.

(** ** A call *)
(* ANCHOR: calls *)
(** [names] is the timestamp; an open expires nothing. A tick is for its timestamp alone. *)
Record call := { names : N; instant : N; does : body }.
Definition fits_call (c : call) : Prop :=
  match does c with Open t _ | Offer t _ _ _ | Result t _ | Fail t _ => names c = t | Tick => True end.
Definition expires (c : call) : bool := match does c with Open _ _ => false | _ => true end.
(** The earliest due instant of one timestamp. *)
Definition earliest_of (sl : slot) : option N :=
  fold_right (fun a best => match best with Some d => Some (N.min (snd a) d) | None => Some (snd a) end) None (armed sl).
Fixpoint expire_own (rounds : nat) (cfg : config) (t : N) (s : state) : state * list decision :=
  match rounds, option_map earliest_of (lookup t (opened s)) with
  | S n, Some (Some due) =>
      if due <=? clock s then
        let (s1, ds1) := update s t (fire cfg (clock s) t due (slot_of s t)) in
        let (s2, ds2) := expire_own n cfg t s1 in (s2, ds1 ++ ds2)
      else (s, [])
  | _, _ => (s, [])
  end.
(** What a call does at one instant. The clock is its caller's: that of another one binds it not. *)
Definition execute (cfg : config) (s : state) (c : call) : state * list decision :=
  let s0 := at_clock (instant c) s in
  let (s1, ds1) := if expires c then expire_own (length (armed (slot_of s0 (names c)))) cfg (names c) s0 else (s0, []) in
  let (s2, ds2) := apply cfg s1 (does c) in (s2, ds1 ++ ds2).
Fixpoint in_order (cfg : config) (s : state) (tr : trace) (cs : list call) : state * trace :=
  match cs with
  | [] => (s, tr)
  | c :: rest => let (s1, ds) := execute cfg s c in in_order cfg s1 (after ds (Got (instant c) (does c) :: tr)) rest
  end.
(* ANCHOR_END: calls *)

(** ** In the order of the calls the invariant holds: whatever instants they bear *)
Lemma earliest_of_some sl due : earliest_of sl = Some due -> (exists p, In (p, due) (armed sl)) /\
  forall p d, In (p, d) (armed sl) -> due <= d.
Proof.
  unfold earliest_of. revert due. induction (armed sl) as [|[p d] l IH]; cbn; [discriminate|]. intros due.
  destruct (fold_right _ None l) as [x|] eqn:F; intros [= <-].
  - destruct (IH x eq_refl) as [(q & Q) M]. split.
    + destruct (N.min_spec d x) as [[_ ->]|[_ ->]]; [exists p; auto|exists q; auto].
    + intros r e [[= <- <-]|I]; [lia|]. specialize (M r e I). lia.
  - split; [exists p; auto|]. destruct l as [|y l]; [|cbn in F; destruct (fold_right _ None l); discriminate].
    intros r e [[= <- <-]|[]]. lia.
Qed.
Lemma earliest_of_none sl : earliest_of sl = None -> armed sl = [].
Proof. unfold earliest_of. destruct (armed sl) as [|a l]; auto. cbn. destruct (fold_right _ None l); discriminate. Qed.
Lemma expire_own_good cfg t b n : forall tr s s' ds, good cfg tr s -> current tr s b ->
  (length (armed (slot_of s t)) <= n)%nat -> expire_own n cfg t s = (s', ds) ->
  good cfg (after ds tr) s' /\ current (after ds tr) s' b /\ rest_of s' t.
Proof.
  assert (Rest : forall s : state, (forall sl due, lookup t (opened s) = Some sl -> earliest_of sl = Some due ->
    clock s < due) -> rest_of s t).
  { intros s H sl p d L I. destruct (earliest_of sl) as [e|] eqn:E.
    - specialize (H sl e L E). apply earliest_of_some in E as [_ M]. specialize (M p d I). lia.
    - apply earliest_of_none in E. rewrite E in I. contradiction. }
  induction n as [|n IH]; intros tr s s' ds G C F; cbn [expire_own].
  - intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros sl due L E. rewrite (slot_of_open _ _ _ L) in F.
    apply earliest_of_some in E as [(p & I) _]. destruct (armed sl); [contradiction|cbn in F; lia].
  - destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [option_map].
    2:{ intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros x due E. congruence. }
    destruct (earliest_of sl) as [due|] eqn:E.
    2:{ intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros x d Lx Ex. congruence. }
    destruct (N.leb_spec due (clock s)) as [D|D].
    2:{ intros [= <- <-]. split; [exact G|split; [exact C|]]. apply Rest. intros x d Lx Ex. congruence. }
    destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= <- <-].
    assert (G1 := good_fire cfg tr s due t sl s1 ds1 G L U). assert (C1 := current_fire cfg tr s b due t s1 ds1 C U).
    rewrite after_app. apply (IH _ s1 s2 ds2 G1 C1); auto.
    rewrite (slot_of_open _ _ _ L) in F, U. unfold update, fire in U. destruct (settle _ _ _ _ _) as [o e] eqn:Se.
    injection U as <- _. unfold slot_of. cbn [fst opened set_opened].
    rewrite (lookup_replace t o _ sl (g_nodup _ _ _ G) L). destruct o as [x|]; [|cbn; lia].
    apply settle_keeps in Se as ->. apply earliest_of_some in E as [(p & I) _].
    assert (Fw := filter_fewer (fun e0 : N * N => negb (mem (fst e0) (fired due sl))) (p, due) (armed sl) I).
    assert (M : mem p (fired due sl) = true) by now apply mem_iff, fired_in. cbn in Fw. rewrite M in Fw.
    specialize (Fw eq_refl). cbn. lia.
Qed.
Lemma expire_own_clock cfg t n : forall s s' ds, expire_own n cfg t s = (s', ds) -> clock s' = clock s.
Proof.
  induction n as [|n IH]; intros s s' ds; cbn [expire_own]; [now intros [= <- _]|].
  destruct (option_map _ _) as [[due|]|]; try now intros [= <- _].
  destruct (due <=? clock s); [|now intros [= <- _]]. destruct (update _ _ _) as [s1 ds1] eqn:U.
  destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= <- _]. apply IH in X. rewrite X.
  unfold update in U. injection U as <- _. reflexivity.
Qed.
Lemma apply_clock cfg s b s' ds : apply cfg s b = (s', ds) -> clock s' = clock s.
Proof.
  destruct b as [t d|t p d bl|t p|t p|]; cbn [apply]; unfold open, offer, arrive; try (now intros [= <- _]);
    destruct (first_reason _); try (now intros [= <- _]). destruct (gate_shut cfg s p bl); now intros [= <- _].
Qed.
(** What is kept of each call, beside the invariant. *)
Record kept (cfg : config) (tr : trace) (s : state) : Prop := {
  k_good : good cfg tr s;
  k_lines : lines cfg tr s None;
  k_cancels : F7_cancels cfg tr;
  k_settled : settled cfg tr;
  k_beginnings : forall later now b earlier, tr = later ++ Got now b :: earlier -> settled cfg earlier
}.
(** A call, from where its input is to be applied. *)
Lemma execute_begins cfg tr s c s1 ds1 : fits_call c -> good cfg tr s -> let s0 := at_clock (instant c) s in
  let tr0 := Got (instant c) (does c) :: tr in
  (if expires c then expire_own (length (armed (slot_of s0 (names c)))) cfg (names c) s0 else (s0, [])) = (s1, ds1) ->
  good cfg (after ds1 tr0) s1 /\ current (after ds1 tr0) s1 (does c) /\
  (expires c = true -> rest_of s1 (names c)) /\ forall t p, does c = Result t p -> rest_of s1 t.
Proof.
  intros Fit G s0 tr0 E. assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
  assert (C0 : current tr0 s0 (does c)) by (exists [], tr; split; [reflexivity|intros d []]).
  destruct (expires c) eqn:X.
  - apply (expire_own_good cfg (names c) (does c) _ tr0) in E as (A1 & A2 & A3); auto. split; [exact A1|split; [exact A2|]].
    split; auto. intros t p B. unfold fits_call in Fit. rewrite B in Fit. now rewrite <- Fit.
  - injection E as <- <-. split; [exact G0|split; [exact C0|]]. split; [discriminate|].
    intros t p B. unfold expires in X. rewrite B in X. discriminate.
Qed.
Lemma execute_good cfg tr s c s' ds : fits_call c -> good cfg tr s -> execute cfg s c = (s', ds) ->
  good cfg (after ds (Got (instant c) (does c) :: tr)) s' /\ (expires c = true -> rest_of s' (names c)) /\ clock s' = instant c.
Proof.
  intros Fit G. unfold execute. destruct (if expires c then _ else _) as [s1 ds1] eqn:E.
  destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A. intros [= <- <-]. rewrite after_app.
  destruct (execute_begins cfg tr s c s1 ds1 Fit G E) as (G1 & _ & Re & _).
  assert (Cl : clock s1 = instant c).
  { destruct (expires c); [|now injection E as <- _]. apply expire_own_clock in E. exact E. }
  split; [eapply good_apply; eauto|]. split; [intros X; eapply a20_rest; eauto|]. rewrite <- Cl.
  now apply (apply_clock cfg s1 (does c) s2 ds2).
Qed.
Lemma expire_own_more cfg t b n : forall tr s s' ds, good cfg tr s -> lines cfg tr s (Some b) -> F7_cancels cfg tr ->
  begun cfg tr s b -> expire_own n cfg t s = (s', ds) ->
  lines cfg (after ds tr) s' (Some b) /\ F7_cancels cfg (after ds tr) /\ begun cfg (after ds tr) s' b.
Proof.
  induction n as [|n IH]; intros tr s s' ds G K F B; cbn [expire_own]; [now intros [= <- <-]|].
  destruct (lookup t (opened s)) as [sl|] eqn:L; cbn [option_map]; [|now intros [= <- <-]].
  destruct (earliest_of sl) as [due|]; [|now intros [= <- <-]]. destruct (N.leb_spec due (clock s)); [|now intros [= <- <-]].
  destruct (update _ _ _) as [s1 ds1] eqn:U. destruct (expire_own n cfg t s1) as [s2 ds2] eqn:X. intros [= <- <-].
  rewrite after_app. apply (IH _ s1 s2); auto; [eapply good_fire|eapply lines_fire|eapply cancels_fire|eapply begun_fire]; eauto.
  apply (l_each _ _ _ _ K).
Qed.
Lemma execute_keeps cfg tr s c s' ds : fits_call c -> kept cfg tr s -> execute cfg s c = (s', ds) ->
  kept cfg (after ds (Got (instant c) (does c) :: tr)) s'.
Proof.
  intros Fit K X. assert (G := k_good _ _ _ K). assert (G' := proj1 (execute_good cfg tr s c s' ds Fit G X)). revert X.
  unfold execute. destruct (if expires c then _ else _) as [s1 ds1] eqn:E.
  destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A. intros [= <- <-].
  destruct (execute_begins cfg tr s c s1 ds1 Fit G E) as (G1 & C1 & _ & Re). set (s0 := at_clock (instant c) s) in *.
  set (tr0 := Got (instant c) (does c) :: tr) in *. assert (G0 : good cfg tr0 s0) by now apply (good_at cfg tr s).
  assert (K0 : lines cfg tr0 s0 (Some (does c))).
  { destruct (k_lines _ _ _ K) as [K1 K2 K3 K4 K5 _]. constructor; auto; [now apply each_got|].
    intros m M. apply says_got. now apply K4. }
  assert (F0 : F7_cancels cfg tr0).
  { intros [|l later] now t m earlier q Y; [discriminate|]. injection Y as <- Y. intros. apply (soon_more [_]).
    eapply (k_cancels _ _ _ K); eauto. }
  assert (B0 : begun cfg tr0 s0 (does c)).
  { exists [], tr. split; [reflexivity|split; [intros d []|apply (k_settled _ _ _ K)]]. }
  assert (M : lines cfg (after ds1 tr0) s1 (Some (does c)) /\ F7_cancels cfg (after ds1 tr0) /\
    begun cfg (after ds1 tr0) s1 (does c)).
  { destruct (expires c); [eapply expire_own_more; eauto|injection E as <- <-; auto]. }
  destruct M as (K1 & F1 & B1). rewrite after_app in *. constructor; auto.
  - now apply (lines_apply cfg (after ds1 tr0) s1 (does c)).
  - exact (cancels_apply cfg _ s1 _ s2 ds2 G1 (l_each _ _ _ _ K1) A F1).
  - exact (settled_apply cfg _ s1 _ s2 ds2 G1 K1 B1 Re A).
  - intros later now b earlier Y. rewrite <- after_app in Y. unfold after in Y. rewrite <- map_rev in Y.
    apply got_after_split in Y as ([|l y] & Y & _).
    + injection Y as _ _ <-. apply (k_settled _ _ _ K).
    + injection Y as _ Y. eapply (k_beginnings _ _ _ K); eauto.
Qed.
Lemma in_order_keeps cfg cs : forall s tr, Forall fits_call cs -> kept cfg tr s ->
  kept cfg (snd (in_order cfg s tr cs)) (fst (in_order cfg s tr cs)).
Proof.
  induction cs as [|c cs IH]; intros s tr F K; cbn; auto. inversion F; subst.
  destruct (execute cfg s c) as [s1 ds] eqn:E. apply IH; auto. eapply execute_keeps; eauto.
Qed.
(** After the last call nothing of its timestamp is due by its caller's clock. *)
Lemma in_order_last cfg c cs : forall s tr, Forall fits_call (cs ++ [c]) -> good cfg tr s -> expires c = true ->
  let (s', tr') := in_order cfg s tr (cs ++ [c]) in rest_of s' (names c) /\ clock s' = clock_of tr'.
Proof.
  induction cs as [|b cs IH]; intros s tr F G X; cbn; inversion F; subst.
  - destruct (execute cfg s c) as [s1 ds] eqn:E. destruct (execute_good cfg tr s c s1 ds) as (_ & Re & Cl); auto.
    split; auto. now rewrite clock_after.
  - destruct (execute cfg s b) as [s1 ds] eqn:E. apply IH; auto. eapply execute_good; eauto.
Qed.
Lemma start_good cfg : good cfg [] initial.
Proof. exact (reach_good _ _ _ _ (at_start cfg)). Qed.
Lemma start_kept cfg : kept cfg [] initial.
Proof.
  assert (R := at_start cfg). constructor; [apply start_good|now apply reach_lines|apply (reach_settled cfg [] initial None R)|
    apply settled_start|]. intros later now b earlier E. destruct later; discriminate.
Qed.

(** ** What is promised of many threads *)
(* ANCHOR: promises *)
Section Calls.
Variables (cfg : config) (cs : list call).
Hypothesis F : Forall fits_call cs.
Local Notation tr := (snd (in_order cfg initial [] cs)).
Local Notation Kept := (in_order_keeps cfg cs initial [] F (start_kept cfg)).
Local Notation G := (k_good _ _ _ Kept).
Local Notation Ok := (l_each _ _ _ _ (k_lines _ _ _ Kept)).
(** In the order of the calls of any threads a timestamp is forwarded once at most, or missed. *)
Theorem s8_p1_once : P1_once cfg tr. Proof. exact (good_p1_once _ _ _ G). Qed.
(** So do the outputs of one rise strictly under progressive, with one end. *)
Theorem s8_p1_progressive : P1_progressive cfg tr. Proof. exact (good_p1_progressive _ _ _ G). Qed.
(** What is forwarded came in time, by the clock of the caller who gave the result. *)
Theorem s8_p2_never_late : P2_never_late tr. Proof. exact (each_p2_never_late cfg tr Ok). Qed.
(** And each copy that is late by that clock is dropped. *)
Theorem s8_p2_late_dropped : P2_late_dropped tr. Proof. exact (c_late _ _ (k_settled _ _ _ Kept)). Qed.
(** No result that any thread had held or given in time outranks the one that is forwarded. *)
Theorem s8_p3_best_available : P3_best_available tr.
Proof. exact (settled_best cfg tr (k_beginnings _ _ _ Kept) Ok s8_p1_once s8_p1_progressive (g_best _ _ _ G)). Qed.
(** Under progressive what any thread gave in time is an output, or a better one is. *)
Theorem s8_p3_progressive : P3_progressive cfg tr. Proof. exact (settled_progressive cfg tr Ok (k_settled _ _ _ Kept)). Qed.
(** Results are held only for one that outranks them all and may still come. *)
Theorem s8_p4_prompt : P4_prompt cfg tr. Proof. exact (good_p4_prompt _ _ _ G). Qed.
(** Local's result is held only where the request of some thread was admitted. *)
Theorem s8_p6_free_without_cloud : P6_free_without_cloud tr. Proof. exact (good_p6_free_without_cloud _ _ _ G). Qed.
(** Whatever threads race, a request arms one due instant at most. *)
Theorem s8_p8_one_timer : P8_one_timer tr. Proof. exact (good_p8_one_timer _ _ _ G). Qed.
(** A timer fires only at its due instant or later, by the clock of the caller who fired it. *)
Theorem s8_p8_fires : P8_fires tr. Proof. exact (each_p8_fires cfg tr Ok). Qed.
(** A timer fires only while it is live, so one of several threads fires it. *)
Theorem s8_p8_while_live : P8_while_live cfg tr. Proof. exact (each_p8_while_live cfg tr Ok). Qed.
(** A decision bears the instant of the call that made it. *)
Theorem s8_f0_instants : F0_instants tr. Proof. exact (each_f0_instants cfg tr Ok). Qed.
(** Opens are accepted and refused by the table of F1, in the order of the calls. *)
Theorem s8_f1_open : F1_open cfg tr. Proof. exact (each_f1_open cfg tr Ok). Qed.
(** Offers are admitted and refused by the table of F2 and the gates, in the order of the calls. *)
Theorem s8_f2_offer : F2_offer cfg tr. Proof. exact (each_f2_offer cfg tr Ok). Qed.
(** Results and failures of any threads are accepted and dropped by the table of F3. *)
Theorem s8_f3_arrival : F3_arrival cfg tr. Proof. exact (each_f3_arrival cfg tr Ok). Qed.
(** A worse result goes early only under eager, and by the call that fired a cloud's timer. *)
Theorem s8_f6_commits : F6_commits cfg tr. Proof. exact (each_f6_commits cfg tr Ok). Qed.
(** Neither local nor what has ended is cancelled, whichever thread commits. *)
Theorem s8_f7_cancelled : F7_cancelled tr. Proof. exact (each_f7_cancelled cfg tr Ok). Qed.
(** And what is pending then is cancelled by the call that forwards. *)
Theorem s8_f7_cancels : F7_cancels cfg tr. Proof. exact (k_cancels _ _ _ Kept). Qed.
End Calls.
(** ** What holds as far as somebody ticks *)
Section Last.
(** The last call so far, which is no open: by its instant, of the timestamp that it names. *)
Variables (cfg : config) (cs : list call) (c : call).
Hypotheses (F : Forall fits_call (cs ++ [c])) (X : expires c = true).
Local Notation tr := (snd (in_order cfg initial [] (cs ++ [c]))).
Local Notation G := (k_good _ _ _ (in_order_keeps cfg (cs ++ [c]) initial [] F (start_kept cfg))).
Local Lemma rests : rest_of (fst (in_order cfg initial [] (cs ++ [c]))) (names c) /\
  clock (fst (in_order cfg initial [] (cs ++ [c]))) = clock_of tr.
Proof.
  assert (L := in_order_last cfg c cs initial [] F (start_good cfg) X). now destruct (in_order _ _ _ _).
Qed.
(** Once any result was accepted, an output is there at the latest at the first call for its timestamp at or after the
    latest due instant of its requests. *)
Theorem s8_p5_local_floor : P5_output tr (names c). Proof. exact (rest_p5 _ _ _ G _ (proj1 rests) (proj2 rests)). Qed.
(** After a call its timestamp is retired, or waits for local, or has a timer that is due later by its instant. *)
Theorem s8_p7_no_stall : P7_waits cfg tr (names c). Proof. exact (rest_p7 _ _ _ G _ (proj1 rests) (proj2 rests)). Qed.
(** With a deadline it has such a timer as long as it is open. *)
Theorem s8_p7_with_deadline : P7_timed cfg tr (names c). Proof. exact (rest_p7_timed _ _ _ G _ (proj1 rests) (proj2 rests)). Qed.
(** And is retired by the first call for it at or after its latest due instant. *)
Theorem s8_p7_retired : P7_ends cfg tr (names c). Proof. exact (rest_p7_ends _ _ _ G _ (proj1 rests) (proj2 rests)). Qed.
(** After a call no timer of its timestamp is overdue by its instant. *)
Theorem s8_p8_served : P8_punctual cfg tr (names c). Proof. exact (rest_p8 _ _ _ G _ (proj1 rests) (proj2 rests)). Qed.
(** Where local arrived and all due instants of requests are past, a call retires its timestamp. *)
Theorem s8_p12_bounded_wait : P12_over cfg tr (names c). Proof. exact (rest_p12 _ _ _ G _ (proj1 rests) (proj2 rests)). Qed.
End Last.
(** P11: the input itself has the decisions that its kind may have. *)
Theorem s8_p11_accounted cfg s c : exists of_due of_input, snd (execute cfg s c) = of_due ++ of_input /\
  own cfg (instant c) (does c) of_input.
(* ANCHOR_END: promises *)
Proof.
  unfold execute. destruct (if expires c then _ else _) as [s1 ds1] eqn:E.
  destruct (apply cfg s1 (does c)) as [s2 ds2] eqn:A. cbn. exists ds1, ds2. split; auto.
  assert (C : clock s1 = instant c) by (destruct (expires c); [now apply expire_own_clock in E|now injection E as <- _]).
  rewrite <- C. change ds2 with (snd (s2, ds2)). rewrite <- A. apply apply_own.
Qed.

(** ** Exchanges *)

(** A thread looks at the slot of a timestamp, computes what its call makes of it, and exchanges the one for the other;
    between the two any others may do the same. The exchange succeeds if the slot that it looked at is there, and else
    changes nothing. A call goes by the slot that was looked at; the greatest timestamp and the gates are the owner's,
    whose calls come one after the other. *)
Definition slot_same (x y : option slot) : {x = y} + {x <> y}.
Proof. repeat decide equality. Defined.
Definition with_slot (s : state) (t : N) (o : option slot) : state :=
  set_opened (map (fun e => if fst e =? t then match o with Some sl => (t, sl) | None => e end else e) (opened s)) s.
Inductive act := Look (thread : nat) (t : N) | Exchange (thread : nat) (c : call).
Record moment := {
  machine : state;
  seen : nat -> option (N * option slot); (* what each thread looked at last, until its exchange uses it up *)
  history : trace
}.
Definition at_first : moment := {| machine := initial; seen := fun _ => None; history := [] |}.
Definition remember (i : nat) (o : option (N * option slot)) (m : moment) : nat -> option (N * option slot) :=
  fun j => if Nat.eqb j i then o else seen m j.
(** Thread [i] looked at [t], and its slot is another one now. *)
Definition stale (i : nat) (t : N) (m : moment) : bool :=
  match seen m i with
  | Some (u, o) => (u =? t) && if slot_same o (lookup t (opened (machine m))) then false else true
  | None => false
  end.
(** [does_call] is what a call does, as [execute] says. *)
Definition perform (does_call : state -> call -> state * list decision) (m : moment) (a : act) : moment :=
  match a with
  | Look i t => {| machine := machine m; seen := remember i (Some (t, lookup t (opened (machine m)))) m; history := history m |}
  | Exchange i c =>
      match seen m i with
      | Some (t, o) =>
          if (t =? names c) && negb (stale i t m) then
            let (s, ds) := does_call (with_slot (machine m) t o) c in
            {| machine := s; seen := remember i None m; history := after ds (Got (instant c) (does c) :: history m) |}
          else {| machine := machine m; seen := remember i None m; history := history m |}
      | None => m
      end
  end.
Definition interleave does_call (m : moment) (acts : list act) : moment := fold_left (perform does_call) acts m.
Definition fits_act (a : act) : Prop := match a with Exchange _ c => fits_call c | Look _ _ => True end.
Lemma with_same s t : NoDup (map fst (opened s)) -> with_slot s t (lookup t (opened s)) = s.
Proof.
  intros D. unfold with_slot. destruct s as [c n g l]. cbn in *. unfold set_opened. cbn. f_equal.
  destruct (lookup t l) as [sl|] eqn:L.
  - rewrite <- (map_id l) at 2. apply map_ext_in. intros [u x] I. cbn. destruct (N.eqb_spec u t) as [->|]; auto.
    apply in_lookup in I; auto. congruence.
  - rewrite <- (map_id l) at 2. apply map_ext. intros [u x]. cbn. now destruct (u =? t).
Qed.
Lemma fresh_same m i t o : seen m i = Some (t, o) -> stale i t m = false -> o = lookup t (opened (machine m)).
Proof. unfold stale. intros ->. rewrite N.eqb_refl. cbn. now destruct (slot_same _ _). Qed.
(** An act changes nothing but what its thread has seen, or does a call as a whole. *)
Lemma perform_cases cfg m a : NoDup (map fst (opened (machine m))) -> fits_act a ->
  machine (perform (execute cfg) m a) = machine m /\ history (perform (execute cfg) m a) = history m \/
  exists i c s ds, a = Exchange i c /\ fits_call c /\ stale i (names c) m = false /\ execute cfg (machine m) c = (s, ds) /\
    perform (execute cfg) m a = {| machine := s; seen := remember i None m;
      history := after ds (Got (instant c) (does c) :: history m) |}.
Proof.
  intros D F. destruct a as [i t|i c]; cbn; auto. destruct (seen m i) as [[t o]|] eqn:S; auto.
  destruct (t =? names c) eqn:E; cbn; auto. apply N.eqb_eq in E as ->.
  destruct (stale i (names c) m) eqn:St; cbn; auto. right.
  rewrite (fresh_same m i (names c) o S St), with_same by auto. destruct (execute cfg (machine m) c) as [s ds] eqn:X.
  exists i, c, s, ds. auto.
Qed.
(* ANCHOR: order *)
(** Any interleaving of looks and exchanges is a run of whole calls, one after the other: those whose exchanges
    succeeded, in the order of these. So all that is promised above holds of it. *)
Theorem s8_one_order cfg acts : forall m, good cfg (history m) (machine m) -> Forall fits_act acts ->
  exists cs, Forall fits_call cs /\
    (machine (interleave (execute cfg) m acts), history (interleave (execute cfg) m acts)) =
    in_order cfg (machine m) (history m) cs.
(* ANCHOR_END: order *)
Proof.
  induction acts as [|a acts IH]; intros m G F; cbn [interleave fold_left].
  - exists []. split; [constructor|reflexivity].
  - inversion F as [|? ? Fa Fr]; subst.
    destruct (perform_cases cfg m a (g_nodup _ _ _ G) Fa) as [(M & L)|(i & c & s & ds & -> & Fc & _ & X & P)].
    + destruct (IH (perform (execute cfg) m a)) as (cs & Fs & Y); [now rewrite M, L|auto|].
      exists cs. split; auto. unfold interleave in Y. now rewrite Y, M, L.
    + rewrite P. destruct (IH {| machine := s; seen := remember i None m;
        history := after ds (Got (instant c) (does c) :: history m) |}) as (cs & Fs & Y); auto.
      { eapply execute_good; eauto. }
      exists (c :: cs). split; [constructor; auto|]. unfold interleave in Y. rewrite Y. cbn. now rewrite X.
Qed.
