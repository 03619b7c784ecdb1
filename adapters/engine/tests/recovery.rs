//! Checks that the engine recovers from any disturbance. Afterwards nothing runs, waits or is due,
//! all gauges are 0, and the next message is served.

use std::time::Duration;

use crate::tested::{Tested, config, header};
use fuseline_engine::{Commit, Effect, Engine, EngineConfig, Local, Offer};
use metrics_util::debugging::{DebugValue, DebuggingRecorder};

const NS: Duration = Duration::from_nanos(1);

fn engine(change: impl FnOnce(&mut EngineConfig)) -> Tested {
    let local = Local { waiting: Some(2), ..Local::default() };
    let mut config = config(&header(Commit::Eager), &[1, 1], local);
    change(&mut config);
    Engine::new(config).unwrap()
}

fn offer(t: u64) -> [Offer<u64>; 1] {
    [Offer { priority: 1, deadline: 100 * NS, request: t }]
}

/// Returns the priorities and timestamps of the calls to start.
fn started(engine: &mut Tested) -> Vec<(u16, u64)> {
    let effects = std::iter::from_fn(|| engine.next_effect());
    effects
        .filter_map(|effect| match effect {
            Effect::Start { priority, timestamp, .. } => Some((priority, timestamp)),
            _ => None,
        })
        .collect()
}

/// A call that lingers ends when it has lingered long enough, even if nothing else happens (D8).
#[test]
fn lingering_call_ends_without_any_other_input() {
    let mut engine = engine(|config| config.clouds[1].linger = 50 * NS);
    for t in 0..100 {
        let at = t * 1000;
        assert!(engine.open(at, t, None, t, offer(t)));
        engine.result(at + 20, t, 0, "local's");
        assert_eq!(started(&mut engine), [(0, t), (1, t)]);
        assert_eq!(engine.next_due(), Some(at + 100));
        engine.tick(at + 100);
        assert!(matches!(engine.next_effect(), Some(Effect::Output(_))));
        assert_eq!(engine.next_due(), Some(at + 150), "it lingers");
        engine.tick(at + 149);
        assert!(engine.next_effect().is_none());
        engine.tick(at + 150);
        let ended = engine.next_effect();
        assert!(
            matches!(ended, Some(Effect::Abort { priority: 1, timestamp }) if timestamp == t),
            "{t}"
        );
        assert_eq!(engine.next_due(), None);
        assert!(engine.next_effect().is_none() && engine.is_idle());
    }
}

/// Late results are passed on as hints even after more than 1024 messages.
#[test]
fn late_results_stay_hints_after_many_messages() {
    let mut engine = engine(|config| config.takes_hints = true);
    for t in 0..5000 {
        let at = t * 1000;
        assert!(engine.open(at, t, None, t, offer(t)));
        engine.result(at + 20, t, 0, "local's");
        engine.tick(at + 100);
        engine.result(at + 130, t, 1, "west's");
        let hint = std::iter::from_fn(|| engine.next_effect()).find_map(|effect| match effect {
            Effect::Hint(hint) => Some((hint.timestamp, hint.value, hint.age)),
            _ => None,
        });
        assert_eq!(hint, Some((t, "west's", 130 * NS)));
    }
}

/// All gauges return to zero, whatever the sources do (D8, D11, D13).
#[test]
fn serves_as_at_first_after_any_disturbance() {
    let recorder = DebuggingRecorder::new();
    let mut engine = metrics::with_local_recorder(&recorder, || {
        engine(|config| {
            config.clouds[0].linger = 70 * NS;
            config.local.replaceable = 1;
        })
    });
    let offers = |t| [1, 2].map(|priority| Offer { priority, deadline: 100 * NS, request: t });
    let mut at = 0;
    for round in 0..300_u64 {
        // More messages come than there is room for, and they end in different ways.
        let first = round * 10;
        assert!(engine.open(at, first, Some(400 * NS), first, offers(first)));
        assert_eq!(started(&mut engine), [(0, first), (1, first), (2, first)], "round {round}");
        for t in first + 1..first + 10 {
            at += 7;
            let is_taken_on = engine.open(at, t, Some(400 * NS), t, offers(t));
            match (round + t) % 6 {
                0 => engine.fail(at, t, 1, &"on purpose"),
                1 => engine.result(at, t, 2, "east's"),
                2 => engine.result(at, t, 1, "west's"),
                3 => engine.tick(at + 90),
                4 if is_taken_on => engine.fail(at, t, 0, &"on purpose"),
                _ => {}
            }
        }
        // Local finishes the computations that it began, perhaps late. Clouds never answer.
        let mut ended = vec![(0, first)];
        loop {
            while let Some(effect) = engine.next_effect() {
                if let Effect::Start { priority, timestamp, .. } = effect {
                    ended.push((priority, timestamp));
                }
            }
            match engine.next_due() {
                Some(due) => at = at.max(due),
                None if ended.is_empty() => break,
                None => {}
            }
            engine.tick(at);
            for (priority, t) in ended.drain(..).filter(|(priority, _)| *priority == 0) {
                at += 500;
                engine.tick(at);
                engine.result(at, t, priority, "local's");
            }
        }
        assert!(engine.is_idle() && engine.open_len() == 0);
        let snapshot = recorder.snapshotter().snapshot().into_vec();
        for (key, _, _, value) in snapshot {
            let name = key.key().name();
            if let DebugValue::Gauge(value) = value
                && name != "fuseline_deadline_seconds"
            {
                assert!(value.0 == 0.0, "{key:?} is {value} after round {round}");
            }
        }
        at += 1000;
    }
}

/// Computations are metered if they hang or if their results are lost (D11, D13).
#[test]
fn each_lost_computation_is_metered() {
    for may_lose_results in [false, true] {
        let recorder = DebuggingRecorder::new();
        let local = Local { at_once: 2, waiting: Some(2), may_lose_results, ..Local::default() };
        let mut engine: Tested = metrics::with_local_recorder(&recorder, || {
            Engine::new(config(&header(Commit::Eager), &[1, 1], local)).unwrap()
        });
        for t in 0..2 {
            assert!(engine.open(1000 * t, t, Some(100 * NS), t, []));
            engine.tick(1000 * t + 500);
        }
        assert_eq!(engine.counts().tally().sources[0].lost, 2);
        let metered = recorder.snapshotter().snapshot().into_vec();
        let lost = metered.into_iter().find_map(|(key, _, _, value)| {
            let is_local = key.key().labels().any(|label| label.value() == "local");
            (key.key().name() == "fuseline_lost_total" && is_local).then_some(value)
        });
        assert_eq!(lost, Some(DebugValue::Counter(2)), "may_lose_results: {may_lose_results}");
    }
}
