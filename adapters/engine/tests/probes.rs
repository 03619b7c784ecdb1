//! Checks that a policy decides only about requests that are admitted, and that its cap holds.

use std::fs;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::tested::config;
use fuseline_deadline::{Accuracy, Chosen, Constant, End, Expected, Reason};
use fuseline_engine::{
    Cloud, Commit, Effect, Engine, Header, Local, Offer, OfferRefusal, Policy, Recorder, Recording,
    Situation,
};
use fuseline_traces::judge;

type Tested = Engine<(), ()>;

const MS: u64 = 1_000_000;
const WEST: u16 = 1;
/// A cloud that outranks west.
const EAST: u16 = 2;
const CAP: Duration = Duration::from_millis(90);

/// Returns an engine in which west has one call at a time, and its gate shuts when one request
/// waits.
fn engine(policy: impl Policy + Send + 'static) -> Tested {
    beside(&header(&[WEST]), policy)
}

/// Returns such an engine with the clouds of a header.
fn beside(header: &Header, policy: impl Policy + Send + 'static) -> Tested {
    let local = Local { at_once: 64, waiting: Some(0), ..Local::default() };
    let mut config = config(header, &[1], local);
    config.clouds[0].policy = Some(Box::new(policy));
    Engine::new(config).unwrap()
}

fn header(clouds: &[u16]) -> Header {
    let cloud = |p: &u16| Cloud { p: *p, name: None, limit: 1, resume: 0 };
    let clouds = clouds.iter().map(cloud).collect();
    Header { operator: None, window: 64, commit: Commit::Eager, clouds }
}

const fn offer() -> Offer<()> {
    Offer { priority: WEST, deadline: CAP, request: () }
}

/// A policy that stores why each deadline was chosen.
struct RecordingPolicy<P> {
    policy: P,
    reasons: Arc<Mutex<Vec<Reason>>>,
}

impl<P: Policy> Policy for RecordingPolicy<P> {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let chosen = self.policy.decide(situation, cap);
        self.reasons.lock().unwrap().push(chosen.reason);
        chosen
    }

    fn ended(&mut self, end: End) {
        self.policy.ended(end);
    }
}

fn noting<P: Policy>(policy: P) -> (RecordingPolicy<P>, Arc<Mutex<Vec<Reason>>>) {
    let reasons = Arc::default();
    (RecordingPolicy { policy, reasons: Arc::clone(&reasons) }, reasons)
}

/// A policy is not called for requests that will be refused (T6).
#[test]
fn a_policy_is_not_called_for_what_will_be_refused() {
    let (policy, reasons) = noting(Constant(CAP));
    let mut engine = engine(policy);
    // One request is sent, one waits, and two find the gate shut. Then one offer is repeated, one
    // has a deadline of 0, and one comes too late.
    for t in 0..4 {
        assert!(engine.open(0, t, None, (), [offer()]));
    }
    engine.offer(0, 1, WEST, CAP, ());
    engine.offer(0, 2, WEST, Duration::ZERO, ());
    engine.result(MS, 3, 0, ());
    engine.offer(MS, 3, WEST, CAP, ());
    let west = engine.counts().tally().sources.remove(1);
    assert_eq!((west.admitted, reasons.lock().unwrap().len()), (2, 2));
    let refused = |why| west.refused.get(&why).copied().unwrap_or_default();
    assert_eq!((refused(OfferRefusal::Queue), refused(OfferRefusal::Duplicate)), (2, 1));
    assert_eq!((refused(OfferRefusal::Deadline), refused(OfferRefusal::Closed)), (1, 1));
}

/// A policy is called for an admitted offer, but not if there is any reason to refuse the offer
/// (T6, F2).
#[test]
fn policy_is_called_only_for_admitted_offers() {
    const NORTH: u16 = 3;
    type Inputs = fn(&mut Tested);
    let cases: [(OfferRefusal, Inputs); 7] = [
        (OfferRefusal::Unknown, |engine| engine.offer(MS, 8, WEST, CAP, ())),
        (OfferRefusal::Closed, |engine| {
            engine.result(MS, 7, 0, ());
            engine.offer(MS, 7, WEST, CAP, ());
        }),
        (OfferRefusal::Duplicate, |engine| {
            engine.offer(MS, 7, WEST, CAP, ());
            engine.offer(MS, 7, WEST, CAP, ());
        }),
        (OfferRefusal::Outranked, |engine| {
            // North is still pending, so east's result is held.
            for p in [NORTH, EAST] {
                engine.offer(MS, 7, p, CAP, ());
            }
            engine.result(MS, 7, EAST, ());
            engine.offer(MS, 7, WEST, CAP, ());
        }),
        (OfferRefusal::Deadline, |engine| engine.offer(MS, 7, WEST, Duration::ZERO, ())),
        (OfferRefusal::Deadline, |engine| {
            // At the end of the clock's range no due instant can be later than now.
            engine.tick(u64::MAX);
            engine.offer(u64::MAX, 7, WEST, CAP, ());
        }),
        (OfferRefusal::Queue, |engine| {
            // One is sent, one waits, and the gate is shut.
            for t in 8..11 {
                assert!(engine.open(MS, t, None, (), []));
                engine.offer(MS, t, WEST, CAP, ());
            }
        }),
    ];
    for (why, inputs) in cases {
        let (policy, reasons) = noting(Constant(CAP));
        let mut engine = beside(&header(&[WEST, EAST, NORTH]), policy);
        assert!(engine.open(0, 7, None, (), []));
        inputs(&mut engine);
        let west = engine.counts().tally().sources.remove(1);
        assert_eq!(west.refused, [(why, 1)].into());
        assert_eq!(reasons.lock().unwrap().len() as u64, west.admitted, "{why}");
    }
}

/// An engine and its sources. Local takes 20 ms, and west takes 60 ms from when it is called.
struct Run {
    engine: Tested,
    now: u64,
    is_west_gone: bool,
    /// The instants, messages and sources of the results that are still to come.
    answers: Vec<(u64, u64, u16)>,
    /// The messages that were forwarded with west's results.
    wests: Vec<u64>,
}

impl Run {
    /// Opens these messages at once.
    fn burst(&mut self, timestamps: std::ops::Range<u64>) {
        for t in timestamps {
            assert!(self.engine.open(self.now, t, None, (), [offer()]));
        }
    }

    fn until(&mut self, end: u64) {
        loop {
            self.act();
            let answer = self.answers.iter().min().copied();
            let due = self.engine.next_due().into_iter();
            let next = due.chain(answer.map(|(at, ..)| at)).min().filter(|at| *at <= end);
            self.now = next.unwrap_or(end);
            match answer.filter(|(at, ..)| Some(*at) == next) {
                Some((at, t, p)) => {
                    self.answers.retain(|other| *other != (at, t, p));
                    self.engine.result(at, t, p, ());
                }
                None if next.is_some() => self.engine.tick(self.now),
                None => return,
            }
        }
    }

    fn act(&mut self) {
        while let Some(effect) = self.engine.next_effect() {
            match effect {
                Effect::Start { priority: WEST, .. } if self.is_west_gone => {}
                Effect::Start { priority, timestamp, .. } => {
                    let takes = if priority == WEST { 60 } else { 20 };
                    self.answers.push((self.now + takes * MS, timestamp, priority));
                }
                Effect::Abort { timestamp, priority } => {
                    self.answers.retain(|(_, t, p)| (*t, *p) != (timestamp, priority));
                }
                Effect::Output(item) => {
                    let is_wests = item.forwarded().is_some_and(|it| it.source.priority == WEST);
                    self.wests.extend(is_wests.then_some(item.timestamp));
                }
                Effect::Replace { .. } | Effect::Hint(_) => {}
            }
        }
    }
}

/// A cloud that returns is found although the gate refuses half of the messages (T6).
#[test]
fn finds_returned_cloud_behind_a_busy_gate() {
    let loss = Accuracy { local: 42.0, cloud: 58.0, price_per_ms: 0.01 };
    let (policy, reasons) =
        noting(Expected::<_, 16>::new(loss, Duration::from_millis(20), Some(4)).unwrap());
    let (answers, wests) = (Vec::new(), Vec::new());
    let mut run = Run { engine: engine(policy), now: 0, is_west_gone: true, answers, wests };
    run.burst(0..2);
    run.until(100 * MS);
    run.is_west_gone = false;
    // Four messages come at once. The first request is sent, the second waits, and the others find
    // the gate shut. If the policy counted messages instead of requests, every probe would be a
    // third request, which is refused.
    for burst in 0..30 {
        let first = 2 + 4 * burst;
        run.burst(first..first + 4);
        run.until((200 + 100 * burst) * MS);
    }
    // Sixteen requests after the cloud's return, the policy remembers only calls since then.
    let found: Vec<_> = (8..30).map(|burst| 2 + 4 * burst).collect();
    assert!(found.iter().all(|first| run.wests.contains(first)), "{:?}", run.wests);
    let reasons = reasons.lock().unwrap();
    assert_eq!(reasons.len(), 2 + 2 * 30);
    let probes = reasons.iter().enumerate().filter(|(_, reason)| **reason == Reason::Probe);
    let probes: Vec<_> = probes.map(|(index, _)| index).collect();
    assert_eq!(probes, (0..reasons.len()).step_by(4).collect::<Vec<_>>());
}

/// Due timers come first. They close the message, so the policy is not asked about the offer (T6,
/// F0).
#[test]
fn policy_is_not_called_after_a_closing_timer() {
    for late_by in [0, 1] {
        let (policy, reasons) = noting(Constant(CAP));
        let mut engine = beside(&header(&[WEST, EAST]), policy);
        assert!(engine.open(0, 7, None, (), [Offer { priority: EAST, ..offer() }]));
        engine.result(MS, 7, 0, ());
        // East's timer commits local's result, which is held.
        let due = engine.next_due().unwrap();
        engine.offer(due + late_by, 7, WEST, CAP, ());
        assert_eq!(*reasons.lock().unwrap(), [], "late by {late_by} ns");
        let west = engine.counts().tally().sources.remove(1);
        assert_eq!(west.refused, [(OfferRefusal::Closed, 1)].into());
    }
}

/// The tally shows the deadline that the request gets, which is at most the cap (D11).
#[test]
fn policy_above_its_cap_is_shown_with_the_cap() {
    struct Beyond;
    impl Policy for Beyond {
        fn decide(&mut self, _: &Situation<'_>, cap: Duration) -> Chosen {
            Chosen { deadline: 2 * cap, reason: Reason::Constant }
        }
        fn ended(&mut self, _: End) {}
    }
    let mut engine = engine(Beyond);
    assert!(engine.open(0, 0, None, (), [offer()]));
    assert_eq!(engine.next_due(), Some(90 * MS));
    let in_force = engine.counts().tally().sources.remove(1).in_force.unwrap();
    assert_eq!(in_force.deadline, CAP);
}

/// Due timers are recorded before the offer, even if the policy panics and nothing is offered.
#[test]
fn records_due_timer_although_the_policy_panics() {
    struct Broken;
    impl Policy for Broken {
        fn decide(&mut self, _: &Situation<'_>, _: Duration) -> Chosen {
            panic!("its own bug");
        }
        fn ended(&mut self, _: End) {}
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let header = header(&[WEST, EAST]);
    let mut engine = beside(&header, Broken);
    engine.record(Recorder::create(&path, &header, Recording::default()).unwrap()).unwrap();
    assert!(engine.open(0, 0, None, (), [Offer { priority: EAST, ..offer() }]));
    assert!(engine.open(0, 1, None, (), []));
    engine.result(MS, 0, 0, ());
    let due = engine.next_due().unwrap();
    engine.offer(due, 1, WEST, CAP, ());
    engine.result(due + MS, 1, 0, ());
    engine.finish().unwrap();
    let verdict = judge("trace", &fs::read(&path).unwrap()[..]).unwrap();
    assert!(verdict.violations.is_empty() && verdict.judged == 2, "{verdict}");
}
