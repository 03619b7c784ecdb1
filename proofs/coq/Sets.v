(** * Facts about the lists of Rules.v; nothing here is about fusion *)
From Coq Require Import List NArith Bool Lia.
From Fuseline Require Import Rules.
Import ListNotations.
Open Scope N_scope.

Lemma mem_iff p l : mem p l = true <-> In p l.
Proof.
  unfold mem. rewrite existsb_exists. split; [intros (q & I & E); apply N.eqb_eq in E; now subst|].
  intros I. exists p. now rewrite N.eqb_refl.
Qed.
Lemma mem_not p l : mem p l = false <-> ~ In p l.
Proof. rewrite <- mem_iff. destruct (mem p l); split; congruence. Qed.
Lemma above_iff p l : any_above p l = true <-> exists q, In q l /\ p < q.
Proof.
  unfold any_above. rewrite existsb_exists.
  split; intros (q & I & E); exists q; split; auto; now apply N.ltb_lt.
Qed.
Lemma above_not p l : any_above p l = false <-> forall q, In q l -> q <= p.
Proof.
  split.
  - intros H q I. apply N.le_ngt. intros L. assert (any_above p l = true) by (apply above_iff; eauto). congruence.
  - intros H. destruct (any_above p l) eqn:E; auto. apply above_iff in E as (q & I & L). specialize (H q I). lia.
Qed.
Lemma add_in {A} (key : A -> N) x y l : In y (add key x l) <-> y = x \/ In y l.
Proof.
  induction l as [|z l IH]; cbn; [intuition congruence|].
  destruct (key x <? key z); cbn; [intuition congruence|]. rewrite IH. intuition congruence.
Qed.
Lemma greatest_some l : forall m, greatest l = Some m -> In m l /\ forall q, In q l -> q <= m.
Proof.
  induction l as [|x l IH]; cbn; [discriminate|]. fold (greatest l). intros m.
  destruct (greatest l) as [n|] eqn:G; intros [= <-].
  - destruct (IH n eq_refl) as [I M]. split.
    + destruct (N.max_spec x n) as [[_ ->]|[_ ->]]; auto.
    + intros q [<-|Q]; [lia|]. specialize (M q Q). lia.
  - split; auto. intros q [<-|Q]; [lia|]. destruct l as [|y l]; [contradiction|].
    cbn in G. destruct (fold_right _ None l) in G; discriminate.
Qed.
Lemma greatest_none l : greatest l = None -> l = [].
Proof. destruct l as [|y l]; auto. cbn. destruct (fold_right _ None l); discriminate. Qed.
Lemma filter_nil {A} (f : A -> bool) l : filter f l = [] -> forall x, In x l -> f x = false.
Proof.
  intros H x I. destruct (f x) eqn:E; auto. assert (X : In x (filter f l)) by (apply filter_In; auto).
  rewrite H in X. contradiction.
Qed.
Lemma clouds_in q l : In q (clouds_of l) <-> In q l /\ q <> 0.
Proof. unfold clouds_of. rewrite filter_In, negb_true_iff, N.eqb_neq. tauto. Qed.
Lemma fired_in p due sl : In p (fired due sl) <-> In (p, due) (armed sl).
Proof.
  unfold fired. rewrite in_map_iff. split.
  - intros ([q e] & <- & I). apply filter_In in I as [I E]. apply N.eqb_eq in E. cbn in *. now subst.
  - intros I. exists (p, due). split; auto. apply filter_In. split; auto. apply N.eqb_refl.
Qed.

(** ** The open timestamps *)
Lemma lookup_in t l sl : lookup t l = Some sl -> In (t, sl) l.
Proof.
  induction l as [|[k x] l IH]; cbn; [discriminate|].
  destruct (N.eqb_spec k t) as [->|]; auto. intros [= ->]. auto.
Qed.
Lemma in_lookup t l sl : NoDup (map fst l) -> In (t, sl) l -> lookup t l = Some sl.
Proof.
  induction l as [|[k x] l IH]; cbn; [contradiction|]. intros D [[= -> ->]|I]; [now rewrite N.eqb_refl|].
  inversion D as [|? ? F D2]; subst. destruct (N.eqb_spec k t) as [->|]; auto.
  elim F. change t with (fst (t, sl)). now apply in_map.
Qed.
Lemma lookup_none t l : lookup t l = None <-> ~ In t (map fst l).
Proof.
  induction l as [|[k x] l IH]; cbn; [tauto|].
  destruct (N.eqb_spec k t) as [->|]; [split; [discriminate|tauto]|]. rewrite IH. tauto.
Qed.
Lemma replace_keys t o l k : In k (map fst (replace t o l)) -> In k (map fst l).
Proof.
  induction l as [|[j x] l IH]; cbn; auto. destruct (j =? t); [destruct o; cbn; auto|].
  cbn. intros [?|?]; auto.
Qed.
Lemma replace_nodup t o l : NoDup (map fst l) -> NoDup (map fst (replace t o l)).
Proof.
  induction l as [|[j x] l IH]; cbn; auto. intros D. inversion D; subst. destruct (j =? t).
  - destruct o; cbn; auto.
  - cbn. constructor; auto. intros I. apply replace_keys in I. auto.
Qed.
Lemma lookup_replace t o l sl : NoDup (map fst l) -> lookup t l = Some sl -> lookup t (replace t o l) = o.
Proof.
  induction l as [|[j x] l IH]; cbn; [discriminate|]. intros D. inversion D; subst.
  destruct (N.eqb_spec j t) as [->|E].
  - intros _. destruct o; cbn; [now rewrite N.eqb_refl|]. now apply lookup_none.
  - intros H. cbn. apply N.eqb_neq in E. rewrite E. auto.
Qed.
Lemma lookup_replace_other t u o l : u <> t -> lookup u (replace t o l) = lookup u l.
Proof.
  intros N. induction l as [|[j x] l IH]; cbn; auto. destruct (N.eqb_spec j t) as [->|E]; cbn.
  - destruct o; cbn; destruct (N.eqb_spec t u); congruence.
  - now rewrite IH.
Qed.
Lemma lookup_app u l t sl : ~ In t (map fst l) ->
  lookup u (l ++ [(t, sl)]) = if t =? u then Some sl else lookup u l.
Proof.
  intros N. induction l as [|[j x] l IH]; cbn; auto. cbn in N.
  destruct (N.eqb_spec j u) as [->|E]; [|apply IH; tauto]. destruct (N.eqb_spec t u) as [->|]; auto. elim N. auto.
Qed.
Lemma replace_length t o l : (length (replace t o l) <= length l)%nat.
Proof. induction l as [|[k x] l IH]; cbn; auto. destruct (k =? t); [destruct o|]; cbn; lia. Qed.

(** ** Timers *)
Lemma sooner_iff x y : sooner x y = true <-> fst x < fst y \/ fst x = fst y /\ snd x <= snd y.
Proof. unfold sooner. rewrite orb_true_iff, andb_true_iff, N.ltb_lt, N.eqb_eq, N.leb_le. tauto. Qed.
Lemma earliest_none l : earliest l = None -> l = [].
Proof.
  destruct l as [|v l]; cbn; auto. fold (earliest l). destruct (earliest l); [|discriminate].
  destruct (sooner v p); discriminate.
Qed.
Lemma earliest_some l : forall x, earliest l = Some x ->
  In x l /\ forall y, In y l -> fst x < fst y \/ fst x = fst y /\ snd x <= snd y.
Proof.
  induction l as [|z l IH]; cbn; [discriminate|]. fold (earliest l). intros x.
  destruct (earliest l) as [y|] eqn:E.
  - destruct (IH y eq_refl) as [I M]. assert (S := sooner_iff z y).
    destruct (sooner z y); intros [= <-]; split; auto; intros w [<-|W]; try (specialize (M w W)); try lia.
  - intros [= <-]. apply earliest_none in E. subst. split; auto. intros w [<-|[]]. lia.
Qed.
Lemma timers_in d t l : In (d, t) (timers l) <-> exists sl p, In (t, sl) l /\ In (p, d) (armed sl).
Proof.
  unfold timers. rewrite in_flat_map. split.
  - intros ([u sl] & I & H). apply in_map_iff in H as ([p e] & [= <- <-] & X). cbn in *. eauto.
  - intros (sl & p & I & A). exists (t, sl). split; auto. apply in_map_iff. now exists (p, d).
Qed.
Lemma replace_timers t o l sl : lookup t l = Some sl ->
  (length (timers (replace t o l)) + length (armed sl) =
   length (timers l) + match o with Some x => length (armed x) | None => 0 end)%nat.
Proof.
  unfold timers. induction l as [|[k x] l IH]; cbn; [discriminate|]. destruct (k =? t).
  - intros [= ->]. destruct o; cbn; rewrite ?app_length, ?map_length; lia.
  - intros L. specialize (IH L). cbn. rewrite !app_length, !map_length. lia.
Qed.
Lemma filter_fewer {A} (f : A -> bool) x l : In x l -> f x = false -> (length (filter f l) < length l)%nat.
Proof.
  assert (LE : forall k, (length (filter f k) <= length k)%nat).
  { induction k as [|z k IH]; cbn; auto. destruct (f z); cbn; lia. }
  induction l as [|z l IH]; cbn; [contradiction|]. intros [<-|I] F; [rewrite F; cbn; specialize (LE l); lia|].
  specialize (IH I F). destruct (f z); cbn; lia.
Qed.
