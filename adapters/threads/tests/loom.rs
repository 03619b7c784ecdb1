//! Explores all interleavings of a few threads at the machine, with at most three preemptions. Each
//! is some order of the pure step, and each order of the calls occurs. Run with
//! `RUSTFLAGS="--cfg loom"`.
#![cfg(loom)]

mod common;

use std::collections::HashSet;
use std::sync::atomic::AtomicBool as Flag;
use std::sync::{Arc, Mutex};

use common::{
    CallAnswer, CallHistory, CallInput, CallOrder, Sequential, ThreadHandle, Timed, open, result,
    tick,
};
use fuseline_core::{
    Admission, Cloud, Commit, Deadline, Gate, Instant, Outcome, Priority, Timestamp,
};
use fuseline_threads::Shared;
use loom::model::Builder;
use loom::sync::atomic::{AtomicU64, Ordering};
use loom::thread;

/// Returns an open with a deadline.
const fn limited(now: u64, t: u64, deadline: u64) -> Timed {
    (now, CallInput::Open { t, deadline: Some(deadline) })
}

/// Returns an offer with an empty queue.
const fn offer(now: u64, t: u64, p: u8, deadline: u64) -> Timed {
    (now, CallInput::Offer { t, p, deadline, backlog: 0 })
}

/// Returns an offer with a queue.
const fn queued(now: u64, t: u64, p: u8, deadline: u64, backlog: u64) -> Timed {
    (now, CallInput::Offer { t, p, deadline, backlog })
}

const fn fail(now: u64, t: u64, p: u8) -> Timed {
    (now, CallInput::Fail { t, p })
}

/// Returns the query for the next due instant.
const fn next_due(t: u64) -> Timed {
    (0, CallInput::NextDue { t })
}

/// The calls of threads: first the owner alone, then all at once, with the owner first among them,
/// then the owner alone.
struct Race {
    before: &'static [Timed],
    threads: &'static [&'static [Timed]],
    after: &'static [Timed],
}

impl Race {
    /// Explores the race under each commit rule. Exactly the answers that some order of the pure
    /// step gives must occur.
    fn check<const CLOUDS: usize, const WINDOW: usize>(&'static self) {
        for commit in EVERY_RULE {
            let ends: Arc<Mutex<HashSet<Vec<CallAnswer>>>> = Arc::default();
            let results = Arc::clone(&ends);
            explore(move || {
                results.lock().unwrap().insert(self.run::<CLOUDS, WINDOW>(commit));
            });
            let gates = vec![Gate::new(2, 0).unwrap(); CLOUDS];
            let orders = self.orders(&Sequential::new(commit, WINDOW, gates));
            assert!(orders.len() > 1, "nothing races under {commit:?}");
            assert_eq!(*ends.lock().unwrap(), orders, "under {commit:?}");
        }
    }

    /// Returns the answers for each order in which the calls can be made one after the other.
    fn orders(&self, machine: &Sequential) -> HashSet<Vec<CallAnswer>> {
        let mut alone = Order::new(machine, self.threads.len());
        self.before.iter().for_each(|call| alone.make(0, *call));
        let opened = alone.opened[0].clone();
        alone.opened.fill(opened);
        let mut ends = HashSet::new();
        let mut left = vec![alone];
        while let Some(mut order) = left.pop() {
            let mut is_over = true;
            for (thread, calls) in self.threads.iter().enumerate() {
                if let Some(call) = calls.get(order.made[thread]) {
                    let mut next = order.clone();
                    next.made[thread] += 1;
                    next.make(thread, *call);
                    left.push(next);
                    is_over = false;
                }
            }
            if is_over {
                self.after.iter().for_each(|call| order.make(0, *call));
                ends.insert(answers(order.calls));
            }
        }
        ends
    }

    fn run<const CLOUDS: usize, const WINDOW: usize>(&self, commit: Commit) -> Vec<CallAnswer> {
        let numbers: [u16; CLOUDS] = std::array::from_fn(|i| u16::try_from(i).unwrap() + 1);
        let clouds = numbers.map(|p| Cloud { priority: Priority::new(p), limit: 2, resume: 0 });
        let shared = Shared::<CLOUDS, WINDOW>::new(WINDOW, commit, &clouds).unwrap();
        // Loom's threads cannot borrow.
        let (shared, history) =
            (Box::leak(Box::new(shared)), &*Box::leak(Box::<CallHistory>::default()));
        let (intake, handle) = shared.split();
        let mut owner = ThreadHandle::owner(history, handle, intake);
        owner.make(self.before, || {});
        let turn = CallOrder::default();
        let others: Vec<_> = self.threads[1..]
            .iter()
            .map(|calls| {
                let (mut member, turn) = (owner.other(), turn.clone());
                thread::spawn(move || member.make(calls, || turn.take()))
            })
            .collect();
        owner.make(self.threads[0], || turn.take());
        for other in others {
            other.join().unwrap();
        }
        owner.make(self.after, || {});
        let gates = vec![Gate::new(2, 0).unwrap(); CLOUDS];
        let explained = history.is_explained_by(&Sequential::new(commit, WINDOW, gates));
        assert!(explained, "no order of the pure step explains {:#?}", history.calls());
        answers(history.calls().iter().map(|call| (call.input, call.answer)).collect())
    }
}

/// Calls that were made one after the other.
#[derive(Clone)]
struct Order {
    machine: Sequential,
    /// The number of calls that each thread has made.
    made: Vec<usize>,
    /// The timestamps that each thread knows to have been opened.
    opened: Vec<HashSet<u64>>,
    calls: Vec<(Timed, CallAnswer)>,
}

impl Order {
    fn new(machine: &Sequential, threads: usize) -> Self {
        let (made, opened) = (vec![0; threads], vec![HashSet::new(); threads]);
        Self { machine: machine.clone(), made, opened, calls: Vec::new() }
    }

    /// Makes a call, unless the thread does not know that the timestamp was opened.
    /// [`ThreadHandle::make`] leaves out the same calls.
    fn make(&mut self, thread: usize, call: Timed) {
        let (now, input) = call;
        let t = input.timestamp();
        if !matches!(input, CallInput::Open { .. }) && !self.opened[thread].contains(&t) {
            return;
        }
        let answer = self.machine.apply(now, input);
        if answer == CallAnswer::Opened(Ok(())) {
            self.opened[thread].insert(t);
        }
        self.calls.push((call, answer));
    }
}

/// Returns the answers, sorted by their calls.
fn answers(mut calls: Vec<(Timed, CallAnswer)>) -> Vec<CallAnswer> {
    calls.sort_by_key(|(call, _)| format!("{call:?}"));
    calls.into_iter().map(|(_, answer)| answer).collect()
}

const EVERY_RULE: [Commit; 3] = [Commit::Eager, Commit::Patient, Commit::Progressive];

fn explore(run: impl Fn() + Sync + Send + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(3);
    builder.check(run);
}

/// Cloud 2's result is forwarded. If cloud 1's comes after it, cloud 1's is superseded (P1).
#[test]
fn p1_two_clouds_race() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10), offer(0, 0, 2, 20)],
        threads: &[&[result(5, 0, 1)], &[result(5, 0, 2)]],
        after: &[tick(20, 0)],
    };
    RACE.check::<2, 1>();
}

/// The result is in time by its caller's clock, or late by the timer's caller's clock (P2, A1).
#[test]
fn p2_a_result_races_its_own_timer() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10), offer(0, 0, 2, 20), result(1, 0, 0)],
        threads: &[&[tick(10, 0), next_due(0)], &[result(9, 0, 1)]],
        after: &[tick(20, 0)],
    };
    RACE.check::<2, 1>();
}

/// Local's result is forwarded, by the timer or by itself (P5–P7).
#[test]
fn f6_local_races_the_last_timer() {
    static RACE: Race = Race {
        before: &[limited(0, 0, 30), offer(0, 0, 1, 10)],
        threads: &[&[tick(10, 0)], &[result(9, 0, 0)]],
        after: &[tick(30, 0)],
    };
    RACE.check::<1, 1>();
}

/// A late duplicate is a duplicate or superseded (P1, F3).
#[test]
fn f3_a_forward_races_a_late_duplicate() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10), offer(0, 0, 2, 20)],
        threads: &[&[result(9, 0, 1)], &[result(10, 0, 1)], &[result(9, 0, 2)]],
        after: &[tick(20, 0)],
    };
    RACE.check::<2, 1>();
}

/// Either the failure or the timer closes the request, never both (F4, F5).
#[test]
fn f4_a_failure_races_the_timer() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10), offer(0, 0, 2, 20)],
        threads: &[&[fail(9, 0, 1)], &[tick(10, 0)], &[result(9, 0, 0)]],
        after: &[tick(20, 0)],
    };
    RACE.check::<2, 1>();
}

/// A stale result or tick never meets a later message in its slot (F3, F5).
#[test]
fn f3_stale_result_and_tick_race_the_reuse_of_a_slot() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10)],
        threads: &[
            &[result(5, 0, 1), open(6, 1), offer(6, 1, 1, 60)],
            &[result(9, 0, 1)],
            &[tick(10, 0)],
        ],
        after: &[result(20, 0, 0), tick(65, 1), result(65, 1, 1)],
    };
    RACE.check::<1, 1>();
}

/// Even an input that changes nothing is answered from its own message's state (P11).
#[test]
fn p11_a_drop_races_the_reuse_of_its_place() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10)],
        threads: &[
            &[result(5, 0, 1), open(6, 1), offer(6, 1, 1, 60)],
            &[result(10, 0, 2)],
            &[next_due(0)],
        ],
        after: &[tick(65, 1), result(65, 1, 1)],
    };
    RACE.check::<2, 1>();
}

/// The request's timer is live from the instant at which it counts, with its own due instant (F2,
/// P8).
#[test]
fn p8_an_offer_races_a_tick() {
    static RACE: Race = Race {
        before: &[open(0, 0)],
        threads: &[
            &[offer(0, 0, 1, 10), offer(0, 0, 1, 5)],
            &[tick(9, 0), tick(10, 0)],
            &[result(9, 0, 0)],
        ],
        after: &[tick(10, 0)],
    };
    RACE.check::<1, 1>();
}

/// An input that comes during the offer outranks it, closes it, or is held for it (F2).
#[test]
fn f2_offers_race_results_and_a_failure() {
    static RACE: Race = Race {
        before: &[limited(0, 0, 30), offer(0, 0, 3, 20)],
        threads: &[
            &[offer(1, 0, 1, 10), offer(1, 0, 1, 10), offer(2, 0, 4, 10)],
            &[result(5, 0, 3)],
            &[fail(5, 0, 0)],
        ],
        after: &[tick(30, 0)],
    };
    RACE.check::<4, 1>();
}

/// An offer that finds its message retired has not changed the gate (F2g).
#[test]
fn f2g_an_offer_races_what_retires_its_message() {
    static RACE: Race = Race {
        before: &[open(0, 0), open(0, 1)],
        threads: &[&[queued(0, 0, 1, 10, 2), queued(0, 1, 1, 10, 1)], &[result(0, 0, 0)]],
        after: &[],
    };
    RACE.check::<1, 2>();
}

/// An open is refused only if no slot was free when it began (F1).
#[test]
fn f1_opens_race_what_frees_their_places() {
    static RACE: Race = Race {
        before: &[open(0, 0), limited(0, 1, 10)],
        threads: &[
            &[open(9, 2), open(9, 3), open(9, 2), offer(9, 2, 1, 10)],
            &[result(9, 0, 0)],
            &[tick(10, 1)],
        ],
        after: &[tick(10, 0), tick(10, 1), tick(20, 2)],
    };
    RACE.check::<1, 2>();
}

/// A caller still gets its answer if its timestamp changes as often as possible (F8).
#[test]
fn f8_a_failure_meets_every_change_of_its_timestamp() {
    static RACE: Race = Race {
        before: &[open(0, 0)],
        threads: &[&[offer(0, 0, 1, 10)], &[fail(1, 0, 1)], &[result(2, 0, 0)], &[result(3, 0, 1)]],
        after: &[tick(10, 0)],
    };
    RACE.check::<1, 1>();
}

/// An output races a better one, and the timer that makes the last one final (F9).
#[test]
fn f9_outputs_race_what_makes_them_final() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 10), offer(0, 0, 2, 10)],
        threads: &[&[result(5, 0, 0)], &[result(9, 0, 1)], &[tick(10, 0)]],
        after: &[result(9, 0, 2)],
    };
    RACE.check::<2, 1>();
}

/// The last failure makes the last output final, whichever source sent it (F9, F4).
#[test]
fn f9_failures_race_an_output() {
    static RACE: Race = Race {
        before: &[open(0, 0), offer(0, 0, 1, 20), offer(0, 0, 2, 20)],
        threads: &[&[fail(5, 0, 1)], &[fail(5, 0, 2)], &[result(5, 0, 0), next_due(0)]],
        after: &[tick(20, 0)],
    };
    RACE.check::<2, 1>();
}

/// Values that were stored before a result was held are visible to whoever forwards it (P1).
#[test]
fn p1_forwarder_sees_work_before_the_hold() {
    static BY_TIMER: Flag = Flag::new(false);
    for commit in [Commit::Eager, Commit::Patient] {
        explore(move || {
            let shared = Box::leak(Box::new(Shared::<1, 1>::new(1, commit, &CLOUD).unwrap()));
            let value = Arc::new(AtomicU64::new(0));
            let (mut intake, handle) = shared.split();
            let message_id = intake.open(at(0), Timestamp::new(0), None).unwrap();
            let (_, admission) = intake.offer(at(0), message_id, P1, Deadline::from_nanos(10), 0);
            assert_eq!(admission, Admission::Admitted { due: at(10) });
            let (theirs, turn) = (Arc::clone(&value), CallOrder::default());
            let their_turn = turn.clone();
            let other = thread::spawn(move || {
                their_turn.take();
                theirs.store(7, Ordering::Relaxed);
                handle.result(at(9), message_id, Priority::LOCAL).1
            });
            turn.take();
            let fired = handle.expire(at(10), message_id).expect("nobody else ticks");
            let by_timer = matches!(fired.outcome, Outcome::Forwarded { .. });
            if by_timer {
                assert_eq!(value.load(Ordering::Relaxed), 7);
                BY_TIMER.store(true, Ordering::Relaxed);
            }
            let outcome = other.join().unwrap();
            assert_eq!(by_timer, outcome == Outcome::Held);
        });
    }
    assert!(BY_TIMER.load(Ordering::Relaxed), "the timer never forwarded");
}

/// Everything done before a message was retired is done before its slot is used again (F1).
#[test]
fn f1_open_sees_work_before_its_slot_was_retired() {
    static REUSED: Flag = Flag::new(false);
    for commit in [Commit::Eager, Commit::Patient] {
        explore(move || {
            let shared = Box::leak(Box::new(Shared::<1, 1>::new(1, commit, &CLOUD).unwrap()));
            let value = Arc::new(AtomicU64::new(0));
            let (mut intake, handle) = shared.split();
            let message_id = intake.open(at(0), Timestamp::new(0), None).unwrap();
            let (theirs, turn) = (Arc::clone(&value), CallOrder::default());
            let their_turn = turn.clone();
            let other = thread::spawn(move || {
                their_turn.take();
                theirs.store(7, Ordering::Relaxed);
                handle.result(at(9), message_id, Priority::LOCAL).1
            });
            turn.take();
            if intake.open(at(9), Timestamp::new(1), None).is_ok() {
                assert_eq!(value.load(Ordering::Relaxed), 7);
                REUSED.store(true, Ordering::Relaxed);
            }
            let outcome = other.join().unwrap();
            assert!(matches!(outcome, Outcome::Forwarded { .. }));
        });
    }
    assert!(REUSED.load(Ordering::Relaxed), "the place was never used again");
}

const P1: Priority = Priority::new(1);
const CLOUD: [Cloud; 1] = [Cloud::new(P1, 1)];

fn at(nanos: u64) -> Instant {
    Instant::from_nanos(nanos)
}
