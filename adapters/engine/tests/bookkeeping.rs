//! Checks that the engine and a naive one agree on effects, items, calls of policies, gauges,
//! metrics and tally.

use std::collections::BTreeMap;
use std::mem;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::naive::{EngineSettings, MarkedValue, NaiveEngine, choice, shown};
use fuseline_deadline::{Chosen, End, Reason};
use fuseline_engine::{
    Cloud, Commit, Effect, Engine, EngineConfig, Header, Lineage, Local, Offer, Overflow, Policy,
    Reserve, Situation, Tally,
};
use metrics_util::debugging::{DebugValue, DebuggingRecorder, Snapshotter};
use proptest::prelude::*;

/// A policy that logs its calls for the test.
struct LoggingPolicy {
    p: u16,
    log: Arc<Mutex<Vec<String>>>,
}

impl Policy for LoggingPolicy {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let Self { p, log } = self;
        log.lock().unwrap().push(format!("{p} decide {:?} {cap:?}", situation.under_way));
        Chosen { deadline: choice(situation.under_way, cap), reason: Reason::Constant }
    }

    fn ended(&mut self, end: End) {
        self.log.lock().unwrap().push(format!("{} {end:?}", self.p));
    }
}

/// The next step of the engine.
#[derive(Clone, Debug)]
enum EngineStep {
    Wait(u64),
    /// The next input comes this much later, without a tick before.
    Pass(u64),
    /// The clock advances until something is due.
    ToNextDue,
    GoBack(u64),
    Open {
        deadline: Option<u64>,
        within: Option<u64>,
        offers: Vec<(u16, u64)>,
    },
    Offer {
        back: u64,
        p: u16,
        deadline: u64,
    },
    /// The `nth` of the running calls ends, well or not.
    End {
        nth: usize,
        well: bool,
    },
    /// A completion of any kind.
    Any {
        back: u64,
        p: u16,
        well: bool,
    },
}

fn step() -> impl Strategy<Value = EngineStep> {
    let offers = proptest::collection::vec((1..=3_u16, 1..60_u64), 0..3);
    let (deadline, within) =
        (proptest::option::of(0..60_u64), proptest::option::weighted(0.3, 1..90_u64));
    prop_oneof![
        4 => (0..20_u64).prop_map(EngineStep::Wait),
        4 => (0..40_u64).prop_map(EngineStep::Pass),
        4 => Just(EngineStep::ToNextDue),
        1 => (0..100_u64).prop_map(EngineStep::GoBack),
        12 => (deadline, within, offers)
            .prop_map(|(deadline, within, offers)| EngineStep::Open { deadline, within, offers }),
        6 => (0..4_u64, 0..=4_u16, 0..60_u64)
            .prop_map(|(back, p, deadline)| EngineStep::Offer { back, p, deadline }),
        12 => (0..8_usize, proptest::bool::weighted(0.7))
            .prop_map(|(nth, well)| EngineStep::End { nth, well }),
        4 => (0..6_u64, 0..=4_u16, any::<bool>())
            .prop_map(|(back, p, well)| EngineStep::Any { back, p, well }),
    ]
}

fn settings() -> impl Strategy<Value = EngineSettings> {
    let cloud = || (1..3_usize, prop_oneof![Just(0), 1..60_u64], any::<bool>());
    let overflow = proptest::sample::select(&[Overflow::DropOldest, Overflow::DropNewest][..]);
    let local = (1..3_usize, 0..4_usize, overflow, 0..3_usize, any::<bool>(), any::<bool>());
    let local = local.prop_map(
        |(at_once, waiting, overflow, replaceable, skip_answered, may_lose_results)| {
            let waiting = Some(waiting);
            Local { at_once, waiting, overflow, replaceable, skip_answered, may_lose_results }
        },
    );
    let commit = proptest::sample::select(&Commit::ALL[..]);
    (commit, local, [cloud(), cloud(), cloud()], 0..30_u64, 1..6_u16).prop_map(
        |(commit, local, clouds, reserve, window)| {
            let cloud = |p, name: &str| Cloud { p, name: Some(name.into()), limit: 3, resume: 1 };
            let named = vec![cloud(2, "east"), cloud(1, "west"), cloud(3, "north")];
            let operator = Some("tested".into());
            let header = Header { operator, window, commit, clouds: named };
            let clouds = clouds.to_vec();
            EngineSettings { header, local, clouds, reserve }
        },
    )
}

fn engine(settings: &EngineSettings, log: &Arc<Mutex<Vec<String>>>) -> Engine<MarkedValue, u64> {
    let mut config = EngineConfig { local: settings.local, ..EngineConfig::from(&settings.header) };
    config.takes_hints = true;
    for (cloud, (calls, linger, has_policy)) in config.clouds.iter_mut().zip(&settings.clouds) {
        (cloud.calls, cloud.linger) = (*calls, Duration::from_nanos(*linger));
        if *has_policy {
            let policy = LoggingPolicy { p: cloud.priority, log: Arc::clone(log) };
            cloud.policy = Some(Box::new(policy));
        }
    }
    let mut engine = Engine::new(config).unwrap();
    let reserve = Duration::from_nanos(settings.reserve);
    engine.set_reserve(Reserve::new(reserve, reserve));
    engine
}

fn effects(engine: &mut Engine<MarkedValue, u64>) -> Vec<String> {
    let effects = std::iter::from_fn(|| engine.next_effect());
    let shown = |effect| match effect {
        Effect::Output(item) => shown(&item),
        Effect::Start { priority, timestamp, until, request } => {
            assert_eq!(request, timestamp);
            format!("start {priority} {timestamp} until {until:?}")
        }
        Effect::Abort { priority, timestamp } => format!("abort {priority} {timestamp}"),
        Effect::Replace { timestamp } => format!("replace {timestamp}"),
        Effect::Hint(hint) => {
            assert_eq!(hint.value, (hint.timestamp, hint.source.priority));
            let (t, p) = hint.value;
            format!("hint {t} {p} {} {}", hint.age.as_nanos(), hint.why.as_str())
        }
    };
    effects.map(shown).collect()
}

/// Returns the gauges, except the deadlines in force, and the counters, by metric and labels
/// without the operator's label.
fn metered(snapshotter: &Snapshotter) -> (BTreeMap<String, usize>, BTreeMap<String, u64>) {
    let (mut gauges, mut counters) = (BTreeMap::new(), BTreeMap::new());
    for (key, _, _, value) in snapshotter.snapshot().into_vec() {
        let name = key.key().name().strip_prefix("fuseline_").unwrap();
        let labels = key.key().labels().filter(|label| label.key() != "operator");
        let labels: Vec<&str> = labels.flat_map(|label| [" ", label.value()]).collect();
        let name = format!("{}{}", name.strip_suffix("_total").unwrap_or(name), labels.concat());
        match value {
            DebugValue::Gauge(value) if !name.starts_with("deadline_seconds") => {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "a count"
                )]
                gauges.insert(name, value.0 as usize);
            }
            DebugValue::Counter(count) if count > 0 => {
                counters.insert(name, count);
            }
            _ => {}
        }
    }
    (gauges, counters)
}

/// Returns the tally's counts under the names of the metrics.
fn tallied(tally: &Tally) -> BTreeMap<String, u64> {
    let mut all =
        vec![("messages".to_owned(), tally.messages), ("missed_messages".into(), tally.missed)];
    let refused = tally.refused.iter();
    all.extend(refused.map(|(why, count)| (format!("refused_messages {}", why.as_str()), *count)));
    for source in &tally.sources {
        let name = &source.source.name;
        let mut put = |metric: &str, outcome: &str, count: u64| {
            all.push((format!("{metric} {name}{outcome}"), count));
        };
        put("requests", " admitted", source.admitted);
        source
            .refused
            .iter()
            .for_each(|(why, n)| put("requests", &format!(" {}", why.as_str()), *n));
        source.outputs.iter().for_each(|(why, n)| put("outputs", &format!(" {why}"), *n));
        put("outputs", " final", source.finals);
        put("results", " preliminary", source.preliminary);
        put("results", " held", source.held);
        source
            .dropped
            .iter()
            .for_each(|(why, n)| put("results", &format!(" {}", why.as_str()), *n));
        put("failures", " accepted", source.failed);
        let dropped = source.failures_dropped.iter();
        dropped.for_each(|(why, n)| put("failures", &format!(" {}", why.as_str()), *n));
        put("lost", "", source.lost);
        put("timers", "", source.timers);
        put("cancelled", "", source.cancelled);
        let reasons: u64 = source.reasons.iter().map(|(_, count)| count).sum();
        assert_eq!(reasons + source.reasons.others(), source.failed);
    }
    all.into_iter().filter(|(_, count)| *count > 0).collect()
}

struct EnginePair {
    engine: Engine<MarkedValue, u64>,
    naive: NaiveEngine,
    log: Arc<Mutex<Vec<String>>>,
    snapshotter: Snapshotter,
    now: u64,
    next: u64,
}

impl EnginePair {
    fn new(settings: &EngineSettings) -> Self {
        let recorder = DebuggingRecorder::new();
        let log = Arc::default();
        let engine = metrics::with_local_recorder(&recorder, || engine(settings, &log));
        let (snapshotter, naive) = (recorder.snapshotter(), NaiveEngine::new(settings));
        Self { engine, naive, log, snapshotter, now: 1000, next: 0 }
    }

    fn step(&mut self, step: &EngineStep) {
        let (now, next) = (self.now, self.next);
        match step {
            EngineStep::Wait(nanos) => self.tick(now + nanos),
            EngineStep::Pass(nanos) => self.now += nanos,
            EngineStep::ToNextDue => self.tick(now.max(self.naive.next_due().unwrap_or(now))),
            EngineStep::GoBack(nanos) => self.tick(now.saturating_sub(*nanos)),
            EngineStep::Open { deadline, within, offers } => {
                let of = |nanos| Arc::new(Lineage::default().within(Duration::from_nanos(nanos)));
                let to = |(priority, deadline): &(u16, u64)| Offer {
                    priority: *priority,
                    deadline: Duration::from_nanos(*deadline),
                    request: next,
                };
                let (limit, offered) = (deadline.map(Duration::from_nanos), offers.iter().map(to));
                self.engine.open_with(now, next, limit, within.map(of), next, offered);
                self.naive.open(now, next, *deadline, *within, offers);
                self.next += 1;
            }
            EngineStep::Offer { back, p, deadline } => {
                let t = next.saturating_sub(*back);
                self.engine.offer(now, t, *p, Duration::from_nanos(*deadline), t);
                self.naive.offer(now, t, *p, *deadline);
            }
            EngineStep::End { nth, well } => {
                if let Some((p, t)) = self.naive.running().into_iter().nth(*nth) {
                    self.complete(t, p, *well);
                }
            }
            EngineStep::Any { back, p, well } => {
                self.complete(next.saturating_sub(*back), *p, *well);
            }
        }
    }

    fn tick(&mut self, now: u64) {
        self.now = now;
        self.engine.tick(now);
        self.naive.tick(now);
    }

    fn complete(&mut self, t: u64, p: u16, well: bool) {
        if well {
            self.engine.result(self.now, t, p, (t, p));
            self.naive.result(self.now, t, p);
        } else {
            self.engine.fail(self.now, t, p, &"on purpose");
            self.naive.fail(self.now, t, p, "on purpose");
        }
    }

    fn compare(&mut self, step: &EngineStep) -> Result<(), TestCaseError> {
        let expected = mem::take(&mut self.naive.effects);
        prop_assert_eq!(effects(&mut self.engine), expected, "{:?}", step);
        let expected = mem::take(&mut self.naive.reports);
        prop_assert_eq!(mem::take(&mut *self.log.lock().unwrap()), expected, "{:?}", step);
        prop_assert_eq!(self.engine.next_due(), self.naive.next_due(), "{:?}", step);
        Ok(())
    }
}

proptest! {
    /// The engine and the naive one do and count the same, whatever happens (D3, D5, D8, D11, D13,
    /// D17, T5, T6).
    #[test]
    fn engine_agrees_with_a_naive_one(
        settings in settings(),
        steps in proptest::collection::vec(step(), 1..120),
    ) {
        let mut pair = EnginePair::new(&settings);
        for step in &steps {
            pair.step(step);
            pair.compare(step)?;
        }
        let EnginePair { engine, naive, snapshotter, .. } = pair;
        // Taking a snapshot resets the counters, so there is only one.
        let (gauges, counters) = metered(&snapshotter);
        prop_assert_eq!(gauges, naive.gauges());
        prop_assert_eq!(&counters, &naive.counts);
        let mut tallied = tallied(&engine.counts().tally());
        for (name, count) in counters {
            if name.starts_with("deadlines ") || name.ends_with(" forwarded") {
                tallied.insert(name, count);
            }
        }
        prop_assert_eq!(&tallied, &naive.counts);
    }
}
