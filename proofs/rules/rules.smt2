; The rules of SPEC.md (its sections 1 to 3) as formulas: for any number of clouds, of timestamps and of places in the
; window, at any instants. `promises.smt2` goes on from here; `../README.md` says how both are run.
(set-logic ALL)

; ---- 1 Words

(declare-sort Timestamp 0)
(declare-fun number (Timestamp) Int)
; Whatever an input can name by a priority: local, a registered cloud, or neither.
(declare-sort Source 0)
(declare-const local Source)
(declare-fun priority (Source) Int)
; An entry is room for one open timestamp; the window is how many there are.
(declare-sort Entry 0)

(define-fun outranks ((a Source) (b Source)) Bool (> (priority a) (priority b)))
(define-fun end-of-time () Int 18446744073709551615)

; ---- 2 Configuration and state

(declare-datatype Commit ((eager) (patient) (progressive)))
(declare-fun registered (Source) Bool)
(declare-fun limit (Source) Int)
(declare-fun resume (Source) Int)

(define-fun configuration () Bool (and
  (forall ((a Timestamp) (b Timestamp)) (=> (= (number a) (number b)) (= a b)))
  (forall ((a Source) (b Source)) (=> (= (priority a) (priority b)) (= a b)))
  (= (priority local) 0)
  (forall ((c Source)) (>= (priority c) 0))
  (forall ((c Source)) (=> (registered c)
    (and (<= 1 (priority c) 65535) (<= 0 (resume c)) (< (resume c) (limit c)))))))

(declare-sort State 0)
(declare-fun commit (State) Commit) ; the commit rule, which no step changes: P13 is about two states that differ in it
(declare-fun clock (State) Int)
(declare-fun began (State) Bool) ; something was opened
(declare-fun newest (State) Timestamp) ; the greatest that was
(declare-fun shut (State Source) Bool)
(declare-fun requested (State Timestamp Source) Bool)
(declare-fun pending (State Timestamp Source) Bool)
(declare-fun armed (State Timestamp Source) Bool)
(declare-fun cached (State Timestamp Source) Bool) ; held; under progressive, forwarded last
(declare-fun due (State Timestamp Source) Int) ; of what is or was armed
(declare-fun entry (State Timestamp) Entry) ; of what is open

(define-fun is-open ((s State) (u Timestamp)) Bool (requested s u local))

; What happened to a timestamp. No rule looks at these; promises speak of them.
(declare-fun opened (State Timestamp) Bool) ; its open was accepted
(declare-fun timed (State Timestamp) Bool) ; and had a deadline
(declare-fun local-came (State Timestamp) Bool) ; local's result was accepted
(declare-fun sent (State Timestamp Source) Bool) ; this result went downstream
(declare-fun forwarded (State Timestamp) Bool) ; it was retired with a result: under progressive it is final
(declare-fun missed (State Timestamp) Bool)
(declare-fun latest (State Timestamp) Int) ; the latest due instant ever armed for it
(declare-fun came (State Timestamp Source) Int) ; the instant at which this result was accepted

(define-fun made ((s State)) Bool (and ; just now
  (= (clock s) 0) (not (began s))
  (forall ((c Source)) (not (shut s c)))
  (forall ((u Timestamp)) (not (or (opened s u) (timed s u) (local-came s u) (forwarded s u) (missed s u))))
  (forall ((u Timestamp) (c Source))
    (not (or (requested s u c) (pending s u c) (armed s u c) (cached s u c) (sent s u c))))))

; ---- The input: a trace's input is a tick, then firings until nothing is due, then the input itself (F0).

(declare-datatype Kind ((a-tick) (a-firing) (an-open) (an-offer) (a-result) (a-failure)))
(declare-const input Kind)
(declare-const now Int) ; of a tick
(declare-const t Timestamp) ; of all others
(declare-const p Source) ; of an offer, a result, a failure
(declare-const with-deadline Bool) ; of an open
(declare-const d Int) ; the deadline of an open or an offer
(declare-const backlog Int) ; of an offer
(declare-const firing Int) ; the due instant of a firing
(declare-const free Entry) ; which an open takes; any, if all are taken

(declare-datatype Why ((none) (order) (full) (deadline) (unknown) (closed) (duplicate) (outranked) (queue)
  (superseded) (unsolicited) (late)))

; ---- 3 Rules: what is decided in state `s`

; F0. What arrives exactly at its due instant is late.
(define-fun due-then ((s State)) Int
  (ite (<= (+ (clock s) d) end-of-time) (+ (clock s) d) end-of-time))
(define-fun passed ((s State) (instant Int)) Bool (<= instant (clock s)))
(define-fun not-due ((s State) (u Timestamp) (c Source)) Bool
  (=> (armed s u c) (not (passed s (due s u c)))))
(define-fun at-rest ((s State)) Bool (forall ((u Timestamp) (c Source)) (not-due s u c)))

; F1
(define-fun reached ((s State) (u Timestamp)) Bool (and (began s) (<= (number u) (number (newest s)))))
(define-fun taken ((s State) (x Entry)) Bool
  (exists ((u Timestamp)) (and (is-open s u) (= (entry s u) x))))
(define-fun open-refused ((s State)) Why
  (ite (reached s t) order
  (ite (taken s free) full
  (ite (and with-deadline (passed s (due-then s))) deadline
  none))))
(define-fun opens ((s State)) Bool (and (= input an-open) (= (open-refused s) none)))

; F2g. Whether the gate of `p` is shut once it decided about the offer.
(define-fun shut-then ((s State)) Bool
  (ite (shut s p) (not (<= backlog (resume p))) (>= backlog (limit p))))

; F2, F9. Under progressive the greatest cached is the last output.
(define-fun below-cached ((s State)) Bool (exists ((c Source)) (and (cached s t c) (outranks c p))))

; F2
(define-fun offer-refused ((s State)) Why
  (ite (not (and (registered p) (reached s t))) unknown
  (ite (not (is-open s t)) closed
  (ite (requested s t p) duplicate
  (ite (below-cached s) outranked
  (ite (passed s (due-then s)) deadline
  (ite (shut-then s) queue
  none)))))))
(define-fun admits ((s State)) Bool (and (= input an-offer) (= (offer-refused s) none)))
(define-fun asks-gate ((s State)) Bool
  (and (= input an-offer) (or (= (offer-refused s) none) (= (offer-refused s) queue))))

; F3, F4, F9
(define-fun dropped ((s State)) Why
  (ite (not (and (or (= p local) (registered p)) (reached s t))) unknown
  (ite (not (is-open s t)) superseded
  (ite (and (= (commit s) progressive) (below-cached s)) superseded
  (ite (not (requested s t p)) unsolicited
  (ite (cached s t p) duplicate
  (ite (not (pending s t p)) late
  none)))))))
(define-fun result-accepted ((s State)) Bool (and (= input a-result) (= (dropped s) none)))
(define-fun failure-accepted ((s State)) Bool (and (= input a-failure) (= (dropped s) none)))

; F5. The earliest due instant of all, and the smallest timestamp that has one then.
(define-fun not-before ((s State) (u Timestamp) (c Source)) Bool (=> (armed s u c)
    (or (< firing (due s u c)) (and (= firing (due s u c)) (<= (number t) (number u))))))
(define-fun next-firing ((s State)) Bool (and
  (passed s firing)
  (exists ((c Source)) (and (armed s t c) (= (due s t c) firing)))
  (forall ((u Timestamp) (c Source)) (not-before s u c))))
(define-fun fires ((s State) (c Source)) Bool
  (and (= input a-firing) (armed s t c) (= (due s t c) firing)))
(define-fun a-timer ((s State)) Bool (exists ((c Source)) (and (fires s c) (not (= c local)))))

; F9: what an accepted result outranks is closed with it.
(define-fun outran ((s State) (c Source)) Bool
  (and (= (commit s) progressive) (result-accepted s) (outranks p c)))

; F3 to F5: what leaves pending, and what then remains.
(define-fun closes ((s State) (c Source)) Bool
  (or (fires s c) (and (or (result-accepted s) (failure-accepted s)) (= c p)) (outran s c)))
(define-fun still-pending ((s State) (c Source)) Bool (and (pending s t c) (not (closes s c))))
(define-fun better-pending ((s State) (m Source)) Bool
  (exists ((c Source)) (and (still-pending s c) (outranks c m))))

; F3, F9
(define-fun holds ((s State)) Bool
  (and (result-accepted s) (better-pending s p) (not (= (commit s) progressive))))
(define-fun sends ((s State)) Bool ; and its timestamp stays open
  (and (result-accepted s) (better-pending s p) (= (commit s) progressive)))
(define-fun forwards-at-once ((s State)) Bool (and (result-accepted s) (not (better-pending s p))))

; F6
(define-fun settles ((s State)) Bool (or (= input a-firing) (failure-accepted s)))
(define-fun best-held ((s State) (m Source)) Bool
  (and (cached s t m) (forall ((c Source)) (=> (cached s t c) (not (outranks c m))))))
(define-fun commits ((s State) (m Source)) Bool (and (settles s) (best-held s m)
  (not (= (commit s) progressive))
  (or (not (better-pending s m)) (and (= (commit s) eager) (a-timer s)))))
(define-fun finals ((s State) (m Source)) Bool (and (settles s) (cached s t m)
  (= (commit s) progressive)
  (not (exists ((c Source)) (still-pending s c)))))
(define-fun misses ((s State)) Bool (and (settles s)
  (not (exists ((c Source)) (cached s t c)))
  (not (exists ((c Source)) (still-pending s c)))))

; F7
(define-fun forwards ((s State) (m Source)) Bool (or (and (forwards-at-once s) (= m p)) (commits s m)))
(define-fun forwards-any ((s State)) Bool (exists ((m Source)) (forwards s m)))
(define-fun finals-any ((s State)) Bool (exists ((m Source)) (finals s m)))
(define-fun outputs ((s State) (m Source)) Bool (or (forwards s m) (and (sends s) (= m p))))
(define-fun last-output ((s State) (m Source)) Bool (or (forwards s m) (finals s m)))
(define-fun retires ((s State)) Bool (or (forwards-any s) (finals-any s) (misses s)))
(define-fun waits ((s State)) Bool (and (settles s) (not (retires s))))
(define-fun cancels ((s State) (c Source)) Bool (and (not (= c local))
  (or (and (forwards-any s) (still-pending s c)) (and (outran s c) (pending s t c)))))

; ---- The state after it, of any timestamp `u` and source `c`

(define-fun gone ((s State) (u Timestamp)) Bool (and (= u t) (retires s)))
(define-fun joins ((s State) (u Timestamp) (c Source)) Bool
  (and (= u t) (or (and (opens s) (= c local)) (and (admits s) (= c p)))))
(define-fun arms ((s State) (u Timestamp) (c Source)) Bool
  (and (joins s u c) (or (admits s) with-deadline)))
(define-fun disarms ((s State) (c Source)) Bool
  (and (closes s c) (not (and (holds s) (= (commit s) eager) (not (= c local))))))

(define-fun clock-then ((s State)) Int (ite (and (= input a-tick) (< (clock s) now)) now (clock s)))
(define-fun began-then ((s State)) Bool (or (began s) (opens s)))
(define-fun newest-then ((s State)) Timestamp (ite (opens s) t (newest s)))
(define-fun gate-then ((s State) (c Source)) Bool
  (ite (and (asks-gate s) (= c p)) (shut-then s) (shut s c)))
(define-fun requested-then ((s State) (u Timestamp) (c Source)) Bool
  (or (joins s u c) (and (requested s u c) (not (gone s u)))))
(define-fun pending-then ((s State) (u Timestamp) (c Source)) Bool
  (or (joins s u c) (and (pending s u c) (not (gone s u)) (not (and (= u t) (closes s c))))))
(define-fun armed-then ((s State) (u Timestamp) (c Source)) Bool
  (or (arms s u c) (and (armed s u c) (not (gone s u)) (not (and (= u t) (disarms s c))))))
(define-fun cached-then ((s State) (u Timestamp) (c Source)) Bool
  (or (and (= u t) (or (holds s) (sends s)) (= c p))
    (and (cached s u c) (not (gone s u)) (not (and (= u t) (sends s))))))
(define-fun due-of-then ((s State) (u Timestamp) (c Source)) Int
  (ite (arms s u c) (due-then s) (due s u c)))
(define-fun entry-then ((s State) (u Timestamp)) Entry (ite (and (opens s) (= u t)) free (entry s u)))

(define-fun opened-then ((s State) (u Timestamp)) Bool (or (opened s u) (and (opens s) (= u t))))
(define-fun timed-then ((s State) (u Timestamp)) Bool
  (or (timed s u) (and (opens s) (= u t) with-deadline)))
(define-fun local-came-then ((s State) (u Timestamp)) Bool
  (or (local-came s u) (and (result-accepted s) (= u t) (= p local))))
(define-fun sent-then ((s State) (u Timestamp) (c Source)) Bool
  (or (sent s u c) (and (= u t) (outputs s c))))
(define-fun forwarded-then ((s State) (u Timestamp)) Bool
  (or (forwarded s u) (and (= u t) (or (forwards-any s) (finals-any s)))))
(define-fun missed-then ((s State) (u Timestamp)) Bool (or (missed s u) (and (= u t) (misses s))))
(define-fun latest-then ((s State) (u Timestamp)) Int
  (ite (and (exists ((c Source)) (arms s u c)) (< (latest s u) (due-then s))) (due-then s) (latest s u)))
(define-fun came-then ((s State) (u Timestamp) (c Source)) Int
  (ite (and (result-accepted s) (= u t) (= c p)) (clock s) (came s u c)))

(define-fun becomes-machine ((s State) (e State)) Bool (and
  (= (commit e) (commit s))
  (= (clock e) (clock-then s))
  (= (began e) (began-then s))
  (= (newest e) (newest-then s))
  (forall ((c Source)) (= (shut e c) (gate-then s c)))))
(define-fun becomes-of ((s State) (e State) (u Timestamp)) Bool (and
  (= (entry e u) (entry-then s u))
  (= (opened e u) (opened-then s u))
  (= (timed e u) (timed-then s u))
  (= (local-came e u) (local-came-then s u))
  (= (forwarded e u) (forwarded-then s u))
  (= (missed e u) (missed-then s u))
  (= (latest e u) (latest-then s u))
  (forall ((c Source)) (and
    (= (requested e u c) (requested-then s u c))
    (= (pending e u c) (pending-then s u c))
    (= (armed e u c) (armed-then s u c))
    (= (cached e u c) (cached-then s u c))
    (= (sent e u c) (sent-then s u c))
    (= (due e u c) (due-of-then s u c))
    (= (came e u c) (came-then s u c))))))
(define-fun becomes ((s State) (e State)) Bool (and
  (becomes-machine s e) (forall ((u Timestamp)) (becomes-of s e u))))

; When it may come: a firing is the next one, an input finds nothing due. An open takes a free entry, if there is one.
(define-fun may ((s State)) Bool (and
  (<= 0 now end-of-time) (<= 0 d) (<= 0 backlog)
  (=> (= input a-firing) (next-firing s))
  (=> (not (or (= input a-tick) (= input a-firing))) (at-rest s))))
(define-fun takes-free ((s State)) Bool (=> (taken s free) (forall ((x Entry)) (taken s x))))
