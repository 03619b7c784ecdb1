//! Gives the engine random inputs. Checks that its bounds hold, that each message has one output,
//! and that the trace conforms.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::time::Duration;

use crate::tested::{Tested, config, header};
use fuseline_engine::{Commit, Effect, Ending, Engine, Item, Local, Recorder, Recording};
use fuseline_traces::judge;
use proptest::prelude::*;

/// Counts the computations that freed their places without a completion.
fn lost(engine: &Tested) -> usize {
    usize::try_from(engine.counts().tally().sources[0].lost).unwrap()
}

/// One step of a random run.
#[derive(Clone, Copy, Debug)]
enum Step {
    Wait(u64),
    /// The caller's clock goes back (F0).
    GoBack(u64),
    Open {
        deadline: Option<u64>,
    },
    Offer {
        back: u64,
        p: u16,
        deadline: u64,
    },
    /// The `nth` of the calls under way ends, well or not.
    End {
        nth: usize,
        well: bool,
    },
    /// A completion of any kind.
    Stray {
        back: u64,
        p: u16,
        well: bool,
    },
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        9 => (0..20_u64).prop_map(Step::Wait),
        1 => prop_oneof![Just(1 << 40), Just(u64::MAX)].prop_map(Step::Wait),
        2 => prop_oneof![0..100_u64, Just(u64::MAX)].prop_map(Step::GoBack),
        10 => proptest::option::of(1..60_u64).prop_map(|deadline| Step::Open { deadline }),
        10 => (0..4_u64, 1..=2_u16, 0..60_u64).prop_map(|(back, p, deadline)| Step::Offer {
            back,
            p,
            deadline
        }),
        10 => (0..8_usize, proptest::bool::weighted(0.8)).prop_map(|(nth, well)| Step::End { nth, well }),
        10 => (0..6_u64, 0..=3_u16, any::<bool>()).prop_map(|(back, p, well)| Step::Stray {
            back,
            p,
            well
        }),
    ]
}

proptest! {
    #[test]
    fn random_inputs_keep_bounds_and_conform(
        steps in proptest::collection::vec(step(), 1..200),
        commit in proptest::sample::select(&Commit::ALL[..]),
        skip_answered in any::<bool>(),
        may_lose_results in any::<bool>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.jsonl");
        let header = header(commit);
        let local = Local { at_once: 2, waiting: Some(4), skip_answered, may_lose_results, ..Local::default() };
        let mut engine: Tested = Engine::new(config(&header, &[2, 1], local)).unwrap();
        let recorder = Recorder::create(&path, &header, Recording::default()).unwrap();
        engine.record(recorder).unwrap();
        let at_once = [2, 1, 2];
        let (mut now, mut next) = (0_u64, 0);
        // The machine's clock, which is the greatest instant that the caller has given.
        let mut latest = 0;
        let mut in_flight: BTreeSet<(u16, u64)> = BTreeSet::new();
        let mut answered: BTreeSet<u64> = BTreeSet::new();
        // The last output of each open message, and the number of its outputs.
        let mut sent: BTreeMap<u64, (u16, u32)> = BTreeMap::new();
        let mut preliminary = 0;
        for step in steps {
            match step {
                Step::Wait(nanos) => {
                    now = now.saturating_add(nanos);
                    engine.tick(now);
                }
                Step::GoBack(nanos) => {
                    now = now.saturating_sub(nanos);
                    engine.tick(now);
                }
                Step::Open { deadline } => {
                    engine.open(now, next, deadline.map(Duration::from_nanos), next, []);
                    next += 1;
                }
                Step::Offer { back, p, deadline } => {
                    let t = u64::saturating_sub(next, back);
                    engine.offer(now, t, p, Duration::from_nanos(deadline), t);
                }
                Step::End { nth, well } => {
                    let Some((p, t)) = in_flight.iter().nth(nth).copied() else { continue };
                    in_flight.remove(&(p, t));
                    if well {
                        engine.result(now, t, p, "boxes");
                    } else {
                        engine.fail(now, t, p, &"on purpose");
                    }
                }
                Step::Stray { back, p, well } => {
                    let t = u64::saturating_sub(next, back);
                    in_flight.remove(&(p, t));
                    if well {
                        engine.result(now, t, p, "boxes");
                    } else {
                        engine.fail(now, t, p, &"on purpose");
                    }
                }
            }
            latest = latest.max(now);
            while let Some(effect) = engine.next_effect() {
                match effect {
                    Effect::Output(item) => {
                        let before = sent.get(&item.timestamp).copied();
                        prop_assert_eq!(item.revision, before.map_or(0, |(_, sent)| sent));
                        match &item.ending {
                            Ending::Final(source) => {
                                prop_assert_eq!(before.map(|(p, _)| p), Some(source.priority));
                            }
                            Ending::Missed | Ending::Refused(_) => prop_assert!(before.is_none()),
                            Ending::Preliminary(result) | Ending::Forwarded(result) => {
                                let p = result.source.priority;
                                prop_assert!(before.is_none_or(|(before, _)| before < p));
                                sent.insert(item.timestamp, (p, item.revision + 1));
                            }
                        }
                        if item.is_last() {
                            prop_assert!(answered.insert(item.timestamp));
                        } else {
                            prop_assert_eq!(commit, Commit::Progressive);
                            prop_assert!(!answered.contains(&item.timestamp));
                            preliminary += 1;
                        }
                    }
                    Effect::Start { priority, timestamp, until, request } => {
                        prop_assert_eq!(request, timestamp);
                        prop_assert!(until.is_none_or(|until| until > latest));
                        prop_assert!(in_flight.insert((priority, timestamp)));
                        let calls = in_flight.iter().filter(|(p, _)| *p == priority).count();
                        let lost = if priority > 0 { 0 } else { lost(&engine) };
                        prop_assert!(calls <= at_once[usize::from(priority)] + lost);
                    }
                    Effect::Abort { priority, timestamp } => {
                        prop_assert!(priority > 0);
                        prop_assert!(in_flight.remove(&(priority, timestamp)));
                    }
                    Effect::Replace { timestamp } => {
                        prop_assert!(false, "{timestamp} is replaced");
                    }
                    Effect::Hint(hint) => prop_assert!(false, "nobody takes {hint:?}"),
                }
            }
        }
        prop_assert_eq!(engine.is_idle(), u64::try_from(answered.len()).unwrap() == next);
        let tally = engine.counts().tally();
        let refused: u64 = tally.refused.values().sum();
        prop_assert_eq!(tally.messages + refused, next);
        let answers = tally.forwarded() + tally.missed + refused;
        prop_assert_eq!(answers, u64::try_from(answered.len()).unwrap());
        prop_assert_eq!(tally.sources.iter().map(|source| source.preliminary).sum::<u64>(), preliminary);
        engine.finish().unwrap();
        let verdict = judge("trace", BufReader::new(File::open(&path).unwrap())).unwrap();
        prop_assert!(verdict.violations.is_empty(), "{:#?}", verdict.violations);
    }

    /// Both engines get every input and have room for every call, so that queues make no difference
    /// (P13, D2).
    #[test]
    fn progressive_ends_as_patient_at_the_same_instants(
        steps in proptest::collection::vec(step(), 1..200),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.jsonl");
        let mut engines = [Commit::Patient, Commit::Progressive].map(|commit| {
            let local = Local { at_once: 200, waiting: Some(0), ..Local::default() };
            Engine::<(u64, u16), ()>::new(config(&header(commit), &[200, 200], local)).unwrap()
        });
        let recorder = Recorder::create(&path, &header(Commit::Progressive), Recording::default());
        engines[1].record(recorder.unwrap()).unwrap();
        let (mut now, mut next) = (0_u64, 0);
        let mut last: [BTreeMap<u64, Item<(u64, u16)>>; 2] = Default::default();
        for step in steps {
            for (engine, last) in engines.iter_mut().zip(&mut last) {
                match step {
                    Step::Wait(nanos) => engine.tick(now.saturating_add(nanos)),
                    Step::GoBack(nanos) => engine.tick(now.saturating_sub(nanos)),
                    Step::Open { deadline } => {
                        engine.open(now, next, deadline.map(Duration::from_nanos), (), []);
                    }
                    Step::Offer { back, p, deadline } => {
                        let t = u64::saturating_sub(next, back);
                        engine.offer(now, t, p, Duration::from_nanos(deadline), ());
                    }
                    Step::End { .. } => {}
                    Step::Stray { back, p, well } => {
                        let t = u64::saturating_sub(next, back);
                        if well {
                            engine.result(now, t, p, (t, p));
                        } else {
                            engine.fail(now, t, p, &"on purpose");
                        }
                    }
                }
                while let Some(effect) = engine.next_effect() {
                    let Effect::Output(item) = effect else { continue };
                    let t = item.timestamp;
                    let earlier = last.remove(&t);
                    prop_assert!(earlier.as_ref().is_none_or(|earlier| !earlier.is_last()));
                    let item = match earlier {
                        Some(earlier) => item.instead_of(earlier),
                        None => item,
                    };
                    let value = item.forwarded().map(|it| (it.value, (t, it.source.priority)));
                    prop_assert!(value.is_none_or(|(value, own)| value == own));
                    last.insert(t, item);
                }
            }
            match step {
                Step::Wait(nanos) => now = now.saturating_add(nanos),
                Step::GoBack(nanos) => now = now.saturating_sub(nanos),
                Step::Open { .. } => next += 1,
                Step::Offer { .. } | Step::End { .. } | Step::Stray { .. } => {}
            }
        }
        let ends = last.map(|items| {
            let ends = items.into_values().filter(Item::is_last);
            let end = |item: Item<(u64, u16)>| {
                (item.timestamp, item.decided, item.forwarded().map(|it| (it.value, it.arrived)))
            };
            ends.map(end).collect::<Vec<_>>()
        });
        prop_assert_eq!(&ends[0], &ends[1]);
        engines[1].finish().unwrap();
        let verdict = judge("trace", BufReader::new(File::open(&path).unwrap())).unwrap();
        prop_assert!(verdict.violations.is_empty(), "{:#?}", verdict.violations);
    }
}
