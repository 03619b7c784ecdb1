; The promises of SPEC.md (its section 4), and what else is shown, about the formulas of `rules.smt2`.
;
; An obligation is a sentence after ";;" and a formula (=> GIVEN THEN). The solvers look for a case in which GIVEN holds
; and THEN does not: there must be none. `NAME.case`, described after ";; for instance", is a case in which GIVEN does
; hold: there must be one, or the obligation says nothing. `faults.toml` breaks a rule for each obligation.

(declare-const before State)
(declare-const after State)
(declare-const other State)
(declare-const later State)
(declare-const u Timestamp) ; any
(declare-const m Source) ; any
(declare-const n Source) ; any
(declare-const x Entry) ; any

; ---- The invariant: what holds of every state that inputs lead to

(define-fun consistent ((s State) (u Timestamp)) Bool (and
  (=> (is-open s u) (reached s u))
  (forall ((c Source)) (and
    (=> (requested s u c) (and (is-open s u) (or (= c local) (registered c))))
    (=> (or (pending s u c) (cached s u c)) (requested s u c))
    (not (and (pending s u c) (cached s u c)))))))
(define-fun waiting ((s State) (u Timestamp)) Bool
  (=> (is-open s u) (exists ((c Source)) (pending s u c))))
; Of what is held one is the best: priorities are whole numbers up to 65535. No step could change that.
(define-fun has-best ((s State) (u Timestamp)) Bool
  (=> (exists ((c Source)) (cached s u c)) (exists ((b Source)) (and (cached s u b)
    (forall ((c Source)) (=> (cached s u c) (not (outranks c b))))))))
(define-fun prompt ((s State) (u Timestamp)) Bool
  (=> (exists ((c Source)) (cached s u c)) (exists ((q Source)) (and (pending s u q)
    (forall ((c Source)) (=> (cached s u c) (outranks q c)))))))
; F9: under progressive the last output is cached alone, and all that is pending outranks it.
(define-fun one-sent ((s State) (u Timestamp)) Bool (=> (= (commit s) progressive)
  (forall ((m Source)) (=> (cached s u m) (forall ((c Source)) (and
    (=> (pending s u c) (outranks c m)) (=> (cached s u c) (= c m))))))))
(define-fun timers ((s State) (u Timestamp)) Bool (and
  (= (armed s u local) (and (pending s u local) (timed s u)))
  (forall ((c Source)) (=> (not (= c local))
    (= (armed s u c) (or (pending s u c) (and (= (commit s) eager) (cached s u c))))))))
(define-fun valid-sets ((s State) (u Timestamp)) Bool (and
  (consistent s u) (waiting s u) (has-best s u) (prompt s u) (one-sent s u) (timers s u)))
; What was sent ended its timestamp; under progressive what is cached was sent, and what else was sent is outranked by it.
(define-fun rising ((s State) (u Timestamp)) Bool (forall ((c Source)) (and
  (=> (and (sent s u c) (not (cached s u c))) (and (reached s u) (or (forwarded s u)
    (and (= (commit s) progressive) (exists ((m Source)) (and (cached s u m) (outranks m c)))))))
  (=> (cached s u c) (= (sent s u c) (= (commit s) progressive))))))
(define-fun ended-once ((s State) (u Timestamp)) Bool (and
  (not (and (forwarded s u) (missed s u)))
  (=> (or (forwarded s u) (missed s u)) (and (reached s u) (not (is-open s u))))))
(define-fun owns-due ((s State) (u Timestamp) (c Source)) Bool ; a timer was armed for it
  (and (requested s u c) (or (not (= c local)) (timed s u))))
(define-fun in-time ((s State) (u Timestamp)) Bool (forall ((c Source))
  (=> (and (cached s u c) (owns-due s u c)) (< (came s u c) (due s u c)))))
(define-fun until-latest ((s State) (u Timestamp)) Bool (forall ((c Source))
  (=> (owns-due s u c) (<= (due s u c) (latest s u)))))
(define-fun floored ((s State) (u Timestamp)) Bool (=> (local-came s u) (and
  (reached s u) (or (forwarded s u) (cached s u local)
    (and (= (commit s) progressive) (exists ((c Source)) (cached s u c)))))))
(define-fun opened-ends ((s State) (u Timestamp)) Bool (and
  (=> (opened s u) (and (reached s u) (or (is-open s u) (forwarded s u) (missed s u))))
  (=> (or (is-open s u) (timed s u)) (opened s u))))
(define-fun has-own-entry ((s State)) Bool (forall ((u Timestamp) (v Timestamp))
  (=> (and (is-open s u) (is-open s v) (= (entry s u) (entry s v))) (= u v))))

(define-fun valid-clock ((s State)) Bool (<= 0 (clock s) end-of-time))
(define-fun valid-of ((s State) (u Timestamp)) Bool (and (valid-sets s u)
  (rising s u) (ended-once s u) (in-time s u) (until-latest s u) (floored s u) (opened-ends s u)))
(define-fun valid ((s State)) Bool (and
  (valid-clock s) (has-own-entry s) (forall ((u Timestamp)) (valid-of s u))))
(define-fun same-of ((s State) (e State) (u Timestamp)) Bool (and
  (= (entry s u) (entry e u)) (= (opened s u) (opened e u)) (= (timed s u) (timed e u)) (= (local-came s u) (local-came e u))
  (= (forwarded s u) (forwarded e u)) (= (missed s u) (missed e u)) (= (latest s u) (latest e u))
  (forall ((c Source)) (and
    (= (requested s u c) (requested e u c)) (= (pending s u c) (pending e u c))
    (= (armed s u c) (armed e u c)) (= (cached s u c) (cached e u c)) (= (sent s u c) (sent e u c))
    (= (due s u c) (due e u c)) (= (came s u c) (came e u c))))))
(define-fun one-of ((a Bool) (b Bool) (c Bool) (d Bool)) Bool
  (= (+ (ite a 1 0) (ite b 1 0) (ite c 1 0) (ite d 1 0)) 1))
(define-fun rest () Bool (and configuration (valid before) (at-rest before)))
; A part of a step is what it says of `t` and `u` alone: most obligations need no more, and solvers are lost among all others.
; Their cases, and those of the faults that break them, are looked for among whole steps.
(define-fun step-of ((known Bool) (led Bool)) Bool (and configuration (valid-clock before) known (may before)
  (becomes-machine before after) led))
(define-fun step.part () Bool (step-of (and (valid-of before t) (valid-of before u))
  (and (becomes-of before after t) (becomes-of before after u))))
(define-fun step () Bool (and (has-own-entry before) (takes-free before)
  (step-of (forall ((u Timestamp)) (valid-of before u)) (forall ((u Timestamp)) (becomes-of before after u)))))
; Two states that differ in their clocks alone, both at or after a due instant. What is shown of one it is shown of the other:
; so => is = here.
(define-fun two-clocks () Bool (and configuration (= input a-firing) (= (commit before) (commit later))
  (passed before firing) (passed later firing) (forall ((v Timestamp)) (same-of before later v))))

;; F0: A machine that was just made is valid; from there on each obligation of a step keeps one part of that.
(define-fun f0-just-made-is-valid () Bool
  (=> (and configuration (made before)) (valid before)))
;; for instance: two clouds are registered
(define-fun f0-just-made-is-valid.case () Bool (and (registered m) (registered n) (outranks m n)))

;; F0: The clock never goes back, and ends at the end of time.
(define-fun f0-clock () Bool
  (=> step.part (and (<= (clock before) (clock after)) (<= (clock after) end-of-time))))
;; for instance: a tick moves it while two timestamps have timers
(define-fun f0-clock.case () Bool (and
  (< (clock before) (clock after)) (armed before t m) (armed before u n) (not (= t u))))

;; F0, A20: What an input arms is due later: inputs of one instant fire nothing of each other.
(define-fun f0-at-rest () Bool
  (=> (and step.part (not (= input a-tick)) (not (= input a-firing))) (not-due after u m)))
;; for instance: a request is admitted beside one whose timer is armed
(define-fun f0-at-rest.case () Bool (and (admits before) (armed before t m)))

;; F1, F2: Of what is open local is requested and registered clouds alone; what is pending or cached is requested, not both.
(define-fun f1-consistent () Bool (=> step.part (consistent after u)))
;; for instance: a request is admitted
(define-fun f1-consistent.case () Bool (and (= t u) (admits before)))

;; F2, A17: A request is admitted only if its result could still be forwarded.
(define-fun f2-could-win () Bool
  (=> (and step.part (admits before)) (not (exists ((c Source)) (and (cached after t c) (outranks c p))))))
;; for instance: two results are held
(define-fun f2-could-win.case () Bool (and (cached before t m) (cached before t n) (outranks m n)))

;; F2g: A gate moves only when it decides about an offer; it never admits at its limit, and never refuses at its resume.
(define-fun f2g-gate () Bool (=> step.part (and
  (=> (not (= (shut before m) (shut after m))) (and (= m p) (or (admits before)
    (and (= input an-offer) (= (offer-refused before) queue)))))
  (=> (admits before) (and (not (shut after p)) (< backlog (limit p))))
  (=> (and (= input an-offer) (= (offer-refused before) queue)) (and (shut after p) (< (resume p) backlog))))))
;; for instance: a shut gate opens
(define-fun f2g-gate.case () Bool (and (shut before p) (not (shut after p))))

;; F6: What is open still waits for a source.
(define-fun f6-waiting () Bool (=> step.part (waiting after u)))
;; for instance: a failure leaves one of two requests
(define-fun f6-waiting.case () Bool (and
  (= t u) (failure-accepted before) (not (retires before)) (not (= p local))))

;; F6: Something is forwarded over a better one that is pending only under eager, and by a cloud's timer.
(define-fun f6-patience () Bool
  (=> (and step.part (last-output before m) (better-pending before m)) (and (= (commit before) eager) (a-timer before))))
;; for instance: the timer of a held result commits another one
(define-fun f6-patience.case () Bool (and (fires before n) (cached before t n) (outranks m n)))

;; F7, A24: Forwarding ends all that its timestamp had, and cancels each cloud that was pending and returned nothing.
(define-fun f7-forward () Bool (=> (and step.part (forwards before m)) (and
  (not (exists ((c Source)) (or (requested after t c) (pending after t c) (armed after t c) (cached after t c))))
  (= (cancels before n) (and (pending before t n) (not (= n local)) (not (fires before n))
    (or (= input a-firing) (not (= n p))))))))
;; for instance: one result is discarded, a request is cancelled
(define-fun f7-forward.case () Bool (and
  (cached before t n) (not (= n m)) (exists ((c Source)) (cancels before c))))

;; F8: An input changes nothing of a timestamp that it is not for.
(define-fun f8-no-other () Bool (=> (and step.part (not (= u t))) (and
  (= (is-open after u) (is-open before u)) (same-of before after u))))
;; for instance: one of two is forwarded, of the other a result is held
(define-fun f8-no-other.case () Bool (and (forwards-any before) (cached before u m)))

;; F9: An output that is not the last closes all up to its source, cancels the clouds among them, and is cached alone.
(define-fun f9-output () Bool (=> (and step.part (sends before)) (and
  (= (pending after t n) (and (pending before t n) (outranks n p)))
  (= (armed after t n) (and (armed before t n) (outranks n p)))
  (= (cached after t n) (= n p))
  (= (cancels before n) (and (pending before t n) (not (= n local)) (outranks p n))))))
;; for instance: a lower cloud is cancelled, and local was sent before
(define-fun f9-output.case () Bool (and (cancels before m) (cached before t local)))

;; F9: Under progressive the last output is cached alone, and all that is pending outranks it.
(define-fun f9-one-sent () Bool (=> step.part (one-sent after u)))
;; for instance: a request joins after an output
(define-fun f9-one-sent.case () Bool (and (= t u) (= (commit before) progressive) (admits before) (cached before u m)))

;; F9: A final ends its timestamp when nothing is pending any more, whatever closed it, and cancels nothing.
(define-fun f9-final () Bool (=> (and step.part (finals before m)) (and
  (not (still-pending before n)) (not (cancels before n))
  (not (exists ((c Source)) (or (requested after t c) (pending after t c) (armed after t c) (cached after t c)))))))
;; for instance: a failure leaves the last output
(define-fun f9-final.case () Bool (failure-accepted before))

;; F9: What an output outranks is superseded, whether it was requested or not.
(define-fun f9-superseded () Bool (=> (and step.part (= (commit before) progressive) (cached before t m) (outranks m p)
    (registered p) (or (= input a-result) (= input a-failure)))
  (= (dropped before) superseded)))
;; for instance: it was never requested
(define-fun f9-superseded.case () Bool (not (requested before t p)))

;; P1 once: What is forwarded or missed was not before, and is one of the two.
(define-fun p1-once () Bool (=> (and step.part (retires before)) (and
  (not (forwarded before t)) (not (missed before t)) (not (= (forwarded after t) (missed after t))))))
;; for instance: a timestamp is forwarded after another one was missed
(define-fun p1-once.case () Bool (and (forwards-any before) (missed before u)))

;; P1 once: What is sent was not before: once alone, or under progressive after lower ones alone.
(define-fun p1-rises () Bool (=> (and step.part (outputs before m) (sent before t n))
  (and (= (commit before) progressive) (outranks m n))))
;; for instance: it is the third
(define-fun p1-rises.case () Bool (exists ((c Source)) (and (sent before t c) (outranks n c))))

;; P1 once: Nothing is sent of what was retired, nor better than what is cached, and what is cached was sent.
(define-fun p1-sent () Bool (=> step.part (rising after u)))
;; for instance: a better one takes the place of the last
(define-fun p1-sent.case () Bool (and (= t u) (sends before) (cached before u m)))

;; P1 once: A timestamp is missed only if nothing of it was sent; only progressive has a final, of what was sent last.
(define-fun p1-final () Bool (=> step.part (and
  (=> (misses before) (not (sent after t m)))
  (=> (finals before m) (and (= (commit before) progressive) (sent before t m) (not (outputs before n))
    (=> (sent before t n) (not (outranks n m))))))))
;; for instance: a timer ends what two outputs were sent for
(define-fun p1-final.case () Bool (and (finals before m) (sent before t n) (not (= m n)) (a-timer before)))

;; P1 once: What was forwarded or missed is not open, and never opens again.
(define-fun p1-closed-for-ever () Bool (=> step.part (ended-once after u)))
;; for instance: it is opened once more, and refused
(define-fun p1-closed-for-ever.case () Bool (and (= t u) (= input an-open) (forwarded before u)))

;; P2 never late: A forwarded result arrived before its due instant, if it had one.
(define-fun p2-never-late () Bool
  (=> (and step.part (or (outputs before m) (finals before m)) (owns-due before t m))
    (< (came after t m) (due before t m))))
;; for instance: a held result is forwarded at a later instant
(define-fun p2-never-late.case () Bool (and
  (= input a-firing) (not (= m local)) (< (came before t m) (clock before))))

;; P2 never late: So did every result that is held.
(define-fun p2-held-in-time () Bool (=> step.part (in-time after u)))
;; for instance: a cloud's result is held
(define-fun p2-held-in-time.case () Bool (and (= t u) (holds before) (not (= p local))))

;; P3 best available: A forwarded result, or the last output, outranks every other available result for its timestamp.
(define-fun p3-best-available () Bool (=> (and step.part (or (outputs before m) (finals before m))) (and
  (=> (cached before t n) (or (= n m) (outranks m n)))
  (=> (result-accepted before) (or (= p m) (outranks m p))))))
;; for instance: two results are held, and one of them is forwarded
(define-fun p3-best-available.case () Bool (and (cached before t n) (cached before t m) (not (= n m))))

;; P4 prompt: While anything is held, something pending outranks all of it.
(define-fun p4-prompt () Bool (=> step.part (prompt after u)))
;; for instance: a failure leaves something to wait for
(define-fun p4-prompt.case () Bool (and
  (= t u) (failure-accepted before) (cached after u m) (cached after u n) (outranks n m)))

;; P4, P5, P6, F9: Under progressive nothing is held: a result that is accepted is sent as it comes.
(define-fun p4-at-once () Bool (=> (and step.part (= (commit before) progressive)) (and
  (=> (result-accepted before) (outputs before p)) (not (holds before)))))
;; for instance: local's while two clouds are pending
(define-fun p4-at-once.case () Bool (and
  (sends before) (= p local) (pending before t m) (pending before t n) (outranks m n) (outranks n p)))

;; P5 local floor: Once local's result was accepted, its timestamp was forwarded, or the result is still held.
(define-fun p5-floor-holds () Bool (=> step.part (floored after u)))
;; for instance: local's result stays held when a timer fires
(define-fun p5-floor-holds.case () Bool (and (= t u) (= input a-firing) (cached after u local)))

;; P5 local floor: When nothing is due and the latest due instant ever armed for it has come, it was forwarded.
(define-fun p5-local-floor () Bool
  (=> (and rest (local-came before u) (<= (latest before u) (clock before))) (forwarded before u)))
;; for instance: beside it another one waits
(define-fun p5-local-floor.case () Bool (and (cached before t local) (cached before t m) (not (= m local))))

;; P6 free without cloud: With no request admitted, local's accepted result is forwarded as it arrives.
(define-fun p6-free-without-cloud () Bool
  (=> (and step.part (result-accepted before) (= p local) (not (exists ((c Source))
      (and (requested before t c) (not (= c local))))))
    (forwards before local)))
;; for instance: another timestamp does wait for a cloud
(define-fun p6-free-without-cloud.case () Bool (and (pending before u m) (not (= m local))))

;; P7 no stall: An open timestamp waits for local or has an armed timer; one opened with a deadline has one always.
(define-fun p7-no-stall () Bool (=> (and step.part (is-open after u)) (and
  (or (pending after u local) (exists ((c Source)) (armed after u c)))
  (=> (timed after u) (exists ((c Source)) (armed after u c))))))
;; for instance: local is given up by its deadline, a cloud is still waited for
(define-fun p7-no-stall.case () Bool (and (= t u) (fires before local)))

;; P5, P7: No timer is armed for an instant after the latest.
(define-fun p7-until-latest () Bool (=> step.part (until-latest after u)))
;; for instance: a request prolongs the wait
(define-fun p7-until-latest.case () Bool (and (= t u) (admits before) (< (latest before u) (latest after u))))

;; P7 no stall: When nothing is due and the latest due instant has come, one opened with a deadline is retired.
(define-fun p7-retired-by-the-latest-due () Bool
  (=> (and rest (timed before u) (<= (latest before u) (clock before))) (or (forwarded before u) (missed before u))))
;; for instance: beside it another one has time
(define-fun p7-retired-by-the-latest-due.case () Bool (and (timed before t) (pending before t m) (not (= m local))))

;; P5, P7: The rank is how many timers are armed: each firing takes some of them and adds none.
(define-fun p7-firing-lowers-the-rank () Bool (=> (and step.part (= input a-firing)) (and
  (=> (armed after u m) (armed before u m))
  (exists ((c Source)) (and (armed before t c) (not (armed after t c)))))))
;; for instance: its timestamp waits on
(define-fun p7-firing-lowers-the-rank.case () Bool (armed after t n))

;; P8 timers: A request has a timer while it is pending, under eager also while it is held; local has that of its deadline alone.
(define-fun p8-timers () Bool (=> step.part (timers after u)))
;; for instance: a cloud's result is held beside local's
(define-fun p8-timers.case () Bool (and (= t u) (holds before) (cached before u local)))

;; P8 timers: A timer lives until it fires, its failure is accepted, its result is held (patient or local's), an output ends it, or it is retired.
(define-fun p8-lives () Bool (=> (and step.part (armed before u m) (not (armed after u m))) (and (= u t) (or
  (fires before m) (retires before) (and (= m p) (failure-accepted before))
  (and (= m p) (holds before) (or (not (= (commit before) eager)) (= m local)))
  (and (sends before) (not (outranks m p)))))))
;; for instance: that of a held result ends under patient
(define-fun p8-lives.case () Bool (and (holds before) (not (= p local))))

;; P8 timers: Nothing arms a timer but an open with a deadline, for local, and an admitted offer, for its cloud.
(define-fun p8-no-other () Bool (=> (and step.part (armed after u m) (not (armed before u m))) (and (= u t)
  (= (due after u m) (due-then before)) (or (and (opens before) with-deadline (= m local)) (and (admits before) (= m p))))))
;; for instance: a request joins while local's result is held
(define-fun p8-no-other.case () Bool (cached before u local))

;; P9 bounded: At most `window` timestamps are open: each has an entry of its own, of `window` entries.
(define-fun p9-bounded () Bool (=> step (has-own-entry after)))
;; for instance: one is opened beside another one
(define-fun p9-bounded.case () Bool (and (opens before) (is-open before u)))

;; P9 bounded: An open is refused `full` only if there is an open timestamp for each entry.
(define-fun p9-full () Bool
  (=> (and step.part (takes-free before) (= input an-open) (= (open-refused before) full))
    (exists ((v Timestamp)) (and (is-open before v) (= (entry before v) x)))))
;; for instance: two are open
(define-fun p9-full.case () Bool (and (is-open before u) (is-open before (newest before)) (not (= u (newest before)))))

;; P10 deterministic: An input has one outcome and leads to one state.
(define-fun p10-deterministic () Bool (=> (and step.part (becomes-machine before other) (becomes-of before other u)) (and
  (=> (and (outputs before m) (outputs before n)) (= m n))
  (=> (and (last-output before m) (last-output before n)) (= m n))
  (= (clock after) (clock other)) (= (shut after m) (shut other m)) (= (entry after u) (entry other u))
  (same-of after other u))))
;; for instance: one of several available results is forwarded
(define-fun p10-deterministic.case () Bool (and (forwards before m) (cached before t n) (outranks m n)))

;; P10 deterministic: What fires next is the same however late the tick is.
(define-fun p10-lateness-fires-the-same () Bool (=> (and two-clocks (next-firing before)) (next-firing later)))
;; for instance: two timestamps have a timer at one instant
(define-fun p10-lateness-fires-the-same.case () Bool (and
  (armed before t m) (armed before u n) (not (= t u)) (= (due before t m) (due before u n))))

;; P10 deterministic: What comes of a firing is the same however late the tick is.
(define-fun p10-lateness-decides-nothing () Bool (=> two-clocks (and
  (=> (forwards before m) (forwards later m)) (=> (finals before m) (finals later m))
  (=> (misses before) (misses later))
  (=> (cancels before m) (cancels later m)))))
;; for instance: a firing commits one of two held results
(define-fun p10-lateness-decides-nothing.case () Bool (and (valid before)
  (forwards before m) (cached before t n) (not (= n m)) (< (clock before) (clock later))))

;; P10 deterministic: What a firing leaves behind is the same however late the tick is.
(define-fun p10-lateness-leaves-the-same () Bool (=> two-clocks (and
  (=> (requested-then before u m) (requested-then later u m))
  (=> (pending-then before u m) (pending-then later u m))
  (=> (armed-then before u m) (armed-then later u m))
  (=> (cached-then before u m) (cached-then later u m))
  (= (due-of-then before u m) (due-of-then later u m)))))
;; for instance: the timestamp waits on, and another timer of it has passed
(define-fun p10-lateness-leaves-the-same.case () Bool (and (valid before)
  (waits before) (armed-then before t m) (passed later (due later t m))))

;; F8, P11 accounted: Each input has one outcome, and no second one.
(define-fun p11-one-outcome () Bool (=> step.part (and
  (=> (= input an-open) (xor (opens before) (not (= (open-refused before) none))))
  (=> (= input an-offer) (xor (admits before) (not (= (offer-refused before) none))))
  (=> (= input a-result) (and (not (finals-any before))
    (one-of (not (= (dropped before) none)) (holds before) (forwards-any before) (sends before))))
  (=> (= input a-failure) (one-of (not (= (dropped before) none)) (waits before)
    (xor (forwards-any before) (finals-any before)) (misses before)))
  (=> (= input a-firing) (one-of false (waits before)
    (xor (forwards-any before) (finals-any before)) (misses before)))
  (=> (and (settles before) (= (commit before) progressive)) (not (forwards-any before))))))
;; for instance: a failure forwards what is held
(define-fun p11-one-outcome.case () Bool (and (failure-accepted before) (commits before m)))

;; F2, F3, P11 accounted: What is refused or dropped changes nothing of any timestamp.
(define-fun p11-refused-changes-nothing () Bool (=> (and step.part (or
    (and (= input an-open) (not (= (open-refused before) none)))
    (and (= input an-offer) (not (= (offer-refused before) none)))
    (and (or (= input a-result) (= input a-failure)) (not (= (dropped before) none)))))
  (and (= (newest after) (newest before)) (same-of before after u))))
;; for instance: a result is late while another one is held
(define-fun p11-refused-changes-nothing.case () Bool (and (= t u) (= (dropped before) late) (cached before u m)))

;; P11 accounted: A held result stays held until its timestamp is forwarded, by it or by a better one; so does the last output.
(define-fun p11-held () Bool (=> (and step.part (cached before u m) (not (cached after u m))) (and (= u t)
  (=> (= input a-result) (and (outputs before p) (not (outranks m p))))
  (=> (not (= input a-result)) (exists ((b Source)) (and (last-output before b) (not (outranks m b))))))))
;; for instance: a result that comes replaces it
(define-fun p11-held.case () Bool (= input a-result))

;; P11 accounted: What was opened is open, or was forwarded or missed; nothing is open that was not opened.
(define-fun p11-opened-ends () Bool (=> step.part (opened-ends after u)))
;; for instance: it is missed
(define-fun p11-opened-ends.case () Bool (and (= t u) (timed before u) (missed after u)))

;; P12 bounded wait: At local's arrival, or the last due instant of a request if that is later, its timestamp has ended.
(define-fun p12-bounded-wait () Bool
  (=> (and rest (opened before u) (not (pending before u local)) (forall ((c Source))
      (=> (and (requested before u c) (not (= c local))) (<= (due before u c) (clock before)))))
    (and (or (forwarded before u) (missed before u)) (=> (local-came before u) (forwarded before u))
      (=> (sent before u m) (forwarded before u)))))
;; for instance: beside it another one waits for a request
(define-fun p12-bounded-wait.case () Bool (and (cached before t local) (pending before t m)))

;; P12 bounded wait: Local arrives when its result or failure is accepted or its timer fires, and never again.
(define-fun p12-local-arrives () Bool (=> (and step.part (opened before u)) (and
  (=> (and (pending before u local) (not (pending after u local))) (and (= u t) (or
    (retires before) (fires before local) (sends before)
    (and (= p local) (or (result-accepted before) (failure-accepted before))))))
  (=> (not (pending before u local)) (not (pending after u local))))))
;; for instance: its deadline has ended, a request is awaited
(define-fun p12-local-arrives.case () Bool (and (fires before local) (waits before)))

; ---- P13: before under patient and other under progressive, after the same inputs

; What patient alone holds, or has pending, the last output outranks.
(define-fun sent-for ((s State) (e State) (u Timestamp) (c Source)) Bool
  (=> (and (or (cached s u c) (pending s u c)) (not (or (cached e u c) (pending e u c))))
    (exists ((m Source)) (and (cached e u m) (outranks m c)))))
(define-fun as-of-source ((s State) (e State) (u Timestamp) (c Source)) Bool (and
  (= (requested s u c) (requested e u c)) (= (due s u c) (due e u c))
  (=> (pending e u c) (pending s u c)) (=> (armed e u c) (armed s u c)) (=> (cached e u c) (cached s u c))
  (sent-for s e u c)))
(define-fun same-history ((s State) (e State) (u Timestamp)) Bool (and
  (= (entry s u) (entry e u)) (= (opened s u) (opened e u)) (= (timed s u) (timed e u))
  (= (forwarded s u) (forwarded e u)) (= (missed s u) (missed e u))))
(define-fun same-clock ((s State) (e State) (c Source)) Bool (and
  (= (clock s) (clock e)) (= (began s) (began e)) (= (newest s) (newest e)) (= (shut s c) (shut e c))))
(define-fun as-patient-of ((s State) (e State) (u Timestamp)) Bool (and
  (same-history s e u) (forall ((c Source)) (as-of-source s e u c))))
(define-fun as-machine ((s State) (e State)) Bool (and
  (= (commit s) patient) (= (commit e) progressive) (forall ((c Source)) (same-clock s e c))))
(define-fun as-patient ((s State) (e State)) Bool (and
  (as-machine s e) (forall ((u Timestamp)) (as-patient-of s e u))))
(define-fun pair-of ((u Timestamp)) Bool (and (as-patient-of before other u) (valid-sets before u) (valid-sets other u)))
(define-fun pair.part () Bool (and configuration (as-machine before other) (pair-of t) (pair-of u)))
(define-fun pair () Bool (and configuration (as-machine before other) (forall ((u Timestamp)) (pair-of u))))
; The same input, or a firing that both have. By `p13-room` an entry is free for both or neither.
(define-fun both-of ((known Bool)) Bool (and known (may before) (= (taken before free) (taken other free))
  (=> (= input a-firing) (exists ((c Source)) (fires other c)))))
(define-fun both.part () Bool (both-of pair.part))
(define-fun both () Bool (both-of pair))
; A firing that patient alone has, of what an output outranks.
(define-fun alone-of ((known Bool)) Bool (and known (may before) (= input a-firing)
  (not (exists ((c Source)) (fires other c)))))
(define-fun alone.part () Bool (alone-of pair.part))
(define-fun alone () Bool (alone-of pair))

;; P13 as patient: Two machines just made are where the same inputs lead.
(define-fun p13-begins () Bool (=> (and (made before) (made other) (= (commit before) patient) (= (commit other) progressive)
    (= (newest before) (newest other)) (forall ((u Timestamp)) (= (entry before u) (entry other u)))
    (forall ((u Timestamp) (c Source)) (= (due before u c) (due other u c))))
  (as-patient before other)))
;; for instance: two clouds are registered
(define-fun p13-begins.case () Bool (and (registered m) (registered n) (outranks m n)))

;; P13 as patient: The same entries are taken.
(define-fun p13-room () Bool (=> pair (= (taken before x) (taken other x))))
;; for instance: all are
(define-fun p13-room.case () Bool (forall ((y Entry)) (taken other y)))

;; P13 as patient: What may come to patient may come to progressive, which refuses the same for the same reasons.
(define-fun p13-refuses () Bool (=> both.part (and
  (=> (at-rest before) (not-due other u m))
  (=> (= input a-firing) (and (passed other firing) (not-before other u m)))
  (=> (= input an-open) (= (open-refused before) (open-refused other)))
  (=> (= input an-offer) (= (offer-refused before) (offer-refused other))))))
;; for instance: a request is outranked
(define-fun p13-refuses.case () Bool (and (= (offer-refused before) outranked) (cached before t m) (outranks p m)))

;; P13 as patient: Progressive retires what patient retires, at the same input, and its last output is what patient forwards.
(define-fun p13-retires () Bool (=> both.part (and
  (= (misses before) (misses other))
  (= (last-output before m) (last-output other m)))))
;; for instance: a final is what patient forwards
(define-fun p13-retires.case () Bool (and (finals other m) (cached before t n) (not (= m n))))

;; P13 as patient: Each better result that patient holds is an output.
(define-fun p13-improves () Bool (=> both.part (= (sends other) (and (holds before)
  (forall ((c Source)) (=> (cached before t c) (outranks p c)))))))
;; for instance: it is the second
(define-fun p13-improves.case () Bool (and (sends other) (cached before t m)))

; Where they lead is said by what `becomes` gives the state after; `f8-no-other` says of other timestamps that they stay.
;; P13 as patient: What is retired under both leaves the same behind.
(define-fun p13-ends () Bool (=> (and both.part
    (or (and (last-output before m) (last-output other m)) (and (misses before) (misses other))))
  (and (= (forwarded-then before t) (forwarded-then other t)) (= (missed-then before t) (missed-then other t))
    (not (or (requested-then before t n) (pending-then before t n) (armed-then before t n) (cached-then before t n)))
    (not (or (requested-then other t n) (pending-then other t n) (armed-then other t n) (cached-then other t n))))))
;; for instance: a final
(define-fun p13-ends.case () Bool (finals other m))

; Of `sent-for`: what patient alone has then.
(define-fun patient-alone-then ((c Source)) Bool (and (or (cached-then before t c) (pending-then before t c))
  (not (or (cached-then other t c) (pending-then other t c)))))
;; P13 as patient: What neither retires is where the same inputs lead.
(define-fun p13-goes-on () Bool (=> (and both.part (not (retires before)) (not (retires other)))
  (and (= (requested-then before t m) (requested-then other t m))
    (= (forwarded-then before t) (forwarded-then other t)) (= (missed-then before t) (missed-then other t))
    (=> (pending-then other t m) (pending-then before t m)) (=> (armed-then other t m) (armed-then before t m))
    (=> (cached-then other t m) (cached-then before t m))
    (=> (sends other) (cached-then other t p))
    (=> (not (sends other)) (= (cached-then other t m) (cached other t m)))
    (=> (and (sends other) (patient-alone-then m)) (outranks p m))
    (=> (and (not (sends other)) (patient-alone-then m)) (exists ((c Source)) (and (cached other t c) (outranks c m)))))))
;; for instance: an output closes a lower request
(define-fun p13-goes-on.case () Bool (and (sends other) (outran other m) (pending before t m)))

;; P13 as patient: In either case clocks, gates and due instants stay the same.
(define-fun p13-clock () Bool (=> both.part (and
  (= (clock-then before) (clock-then other)) (= (began-then before) (began-then other)) (= (newest-then before) (newest-then other))
  (= (gate-then before m) (gate-then other m)) (= (due-of-then before t m) (due-of-then other t m))
  (= (entry-then before t) (entry-then other t)) (= (opened-then before t) (opened-then other t))
  (= (timed-then before t) (timed-then other t)))))
;; for instance: a gate shuts
(define-fun p13-clock.case () Bool (and (asks-gate before) (gate-then before m) (not (shut before m))))

;; P13 as patient: A firing that patient alone has retires nothing.
(define-fun p13-waits () Bool (=> alone.part (waits before)))
;; for instance: a timer of two lower requests
(define-fun p13-waits.case () Bool (and (fires before m) (fires before n) (not (= m n))))

;; P13 as patient: It closes what an output outranks, and leaves patient where the same inputs lead.
(define-fun p13-follows () Bool (=> alone.part (and
  (= (clock-then before) (clock other)) (= (began-then before) (began other)) (= (newest-then before) (newest other))
  (= (gate-then before n) (shut other n)) (= (entry-then before u) (entry other u)) (= (opened-then before u) (opened other u))
  (= (timed-then before u) (timed other u)) (= (missed-then before u) (missed other u))
  (= (forwarded-then before u) (forwarded other u)) (= (requested-then before u n) (requested other u n))
  (= (due-of-then before u n) (due other u n)) (=> (pending other u n) (pending-then before u n))
  (=> (armed other u n) (armed-then before u n)) (=> (cached other u n) (cached-then before u n))
  (=> (and (or (cached-then before u n) (pending-then before u n)) (not (or (cached other u n) (pending other u n))))
    (exists ((c Source)) (and (cached other u c) (outranks c n)))))))
;; for instance: what an output outranks is held
(define-fun p13-follows.case () Bool (and (cached before t m) (not (cached other t m))))
