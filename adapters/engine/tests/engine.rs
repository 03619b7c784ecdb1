//! Drives the engine by hand, with inputs at chosen instants, and looks at each effect.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::tested::{Tested, config, header};
use fuseline_engine::{
    Commit, DropReason, Effect, Ending, Engine, EngineConfig, Hint, Item, Local, Offer,
    OfferRefusal, SourceTally, Trigger,
};
use metrics_util::debugging::{DebugValue, DebuggingRecorder};

const NS: Duration = Duration::from_nanos(1);

fn engine() -> Tested {
    under(Commit::Eager)
}

fn under(commit: Commit) -> Tested {
    let local = Local { waiting: Some(2), ..Local::default() };
    Engine::new(config(&header(commit), &[1, 1], local)).unwrap()
}

fn effects(engine: &mut Tested) -> Vec<String> {
    std::iter::from_fn(|| engine.next_effect()).map(|effect| to_text(&effect)).collect()
}

fn to_text(effect: &Effect<&'static str, u64>) -> String {
    match effect {
        Effect::Start { priority, timestamp, until, request } => {
            format!("start {priority} {timestamp} due {until:?} with {request}")
        }
        Effect::Abort { priority, timestamp } => format!("abort {priority} {timestamp}"),
        Effect::Replace { timestamp } => format!("replace {timestamp}"),
        Effect::Hint(Hint { timestamp, source, value, age, why }) => {
            format!("hint {timestamp} {value} of {source} after {age:?}: {why}")
        }
        Effect::Output(Item { timestamp, decided, revision, ending, .. }) => {
            let at = decided.as_nanos();
            match ending {
                Ending::Preliminary(f) => {
                    format!("{at}: {timestamp} preliminary {revision}: {} of {}", f.value, f.source)
                }
                Ending::Forwarded(f) => {
                    format!("{at}: {timestamp} {} of {} by {}", f.value, f.source, f.trigger)
                }
                Ending::Final(source) => format!("{at}: {timestamp} final {revision}: {source}"),
                Ending::Missed => format!("{at}: {timestamp} missed"),
                Ending::Refused(why) => format!("{at}: {timestamp} refused {why}"),
            }
        }
    }
}

#[test]
fn better_result_aborts_and_late_ones_change_nothing() {
    let mut engine = engine();
    assert!(engine.open(10, 0, None, 70, []));
    engine.offer(11, 0, 1, 100 * NS, 71);
    engine.offer(12, 0, 2, 50 * NS, 72);
    assert_eq!(engine.next_due(), Some(62));
    assert_eq!(
        effects(&mut engine),
        [
            "start 0 0 due None with 70",
            "start 1 0 due Some(111) with 71",
            "start 2 0 due Some(62) with 72"
        ]
    );
    engine.result(20, 0, 2, "boxes");
    assert_eq!(effects(&mut engine), ["20: 0 boxes of east by arrival", "abort 1 0"]);
    // West's result was on its way when its call was aborted.
    engine.result(21, 0, 1, "boxes");
    engine.result(22, 0, 0, "boxes");
    assert_eq!(effects(&mut engine), [""; 0]);
    assert!(engine.is_idle());
    let tally = engine.counts().tally();
    assert_eq!(tally.sources[2].dropped, BTreeMap::from([(DropReason::Superseded, 1)]));
    assert_eq!(tally.sources[2].cancelled, 1);
    assert_eq!(tally.sources[1].outputs, BTreeMap::from([(Trigger::Arrival, 1)]));
}

/// A due timer forwards a held result before the input, another message's result, is handled (D2).
#[test]
fn timer_forwards_before_the_input_that_brings_it() {
    let mut engine = engine();
    for t in 0..2 {
        assert!(engine.open(t, t, None, 0, []));
        engine.offer(t, t, 1, 100 * NS, 0);
    }
    engine.result(50, 0, 0, "zero");
    effects(&mut engine);
    // At 100 the first message's timer is due. Its decision comes before the result's.
    engine.result(100, 1, 0, "one");
    assert_eq!(
        effects(&mut engine),
        ["abort 1 0", "100: 0 zero of local by timer", "start 1 1 due Some(101) with 0"]
    );
}

/// A waiting request leaves the queue when its timer fires (D4).
#[test]
fn waiting_request_leaves_when_its_timer_fires() {
    let mut engine = engine();
    for t in 0..3 {
        assert!(engine.open(t, t, None, 0, []));
        engine.offer(t, t, 1, if t == 1 { 10 * NS } else { 100 * NS }, t);
    }
    effects(&mut engine);
    engine.tick(11);
    // The second request is gone, and the call of the first continues.
    assert_eq!(effects(&mut engine), [""; 0]);
    engine.result(20, 0, 1, "boxes");
    assert_eq!(
        effects(&mut engine),
        ["20: 0 boxes of west by arrival", "start 1 2 due Some(102) with 2"]
    );
}

/// The gate sees the true length of the queue (D4).
#[test]
fn the_gate_sees_the_true_length_of_the_queue() {
    let mut engine = engine();
    for t in 0..4 {
        assert!(engine.open(t, t, None, 0, []), "{t}");
        engine.result(t, t, 0, "local");
        engine.offer(t, t, 1, 100 * NS, t);
    }
    // Nothing was offered for a message that already had its output.
    assert_eq!(
        engine.counts().tally().sources[2].refused,
        BTreeMap::from([(OfferRefusal::Closed, 4)])
    );
    for t in 4..8 {
        assert!(engine.open(t, t, None, 0, []), "{t}");
        engine.offer(t, t, 1, 100 * NS, t);
        engine.result(t, t, 0, "local");
    }
    // One request is under way and two wait. The fourth was refused, so that message's local result
    // was forwarded at once.
    let west = &engine.counts().tally().sources[2];
    assert_eq!(west.refused[&OfferRefusal::Queue], 1);
    assert_eq!(west.admitted, 3);
}

#[test]
fn local_beyond_its_queue_fails_and_cloud_answers() {
    let mut engine = engine();
    for t in 0..3 {
        assert!(engine.open(t, t, None, t, []));
    }
    let offer = Offer { priority: 2, deadline: 100 * NS, request: 3 };
    assert!(engine.open(3, 3, None, 3, [offer]));
    let local = &engine.counts().tally().sources[0];
    assert_eq!(local.reasons.to_string(), "1 × too many computations wait");
    engine.result(6, 3, 2, "boxes");
    let all = effects(&mut engine);
    assert_eq!(all.last().unwrap(), "6: 3 boxes of east by arrival");
    assert!(!engine.open(7, 3, None, 0, []));
    assert_eq!(effects(&mut engine), ["7: 3 refused order"]);
}

/// Under progressive each better result is sent at once and aborts the calls that it outranks (F9,
/// D1).
#[test]
fn progressive_sends_better_results_and_aborts() {
    let mut engine = under(Commit::Progressive);
    assert!(engine.open(10, 0, None, 70, []));
    engine.offer(11, 0, 1, 100 * NS, 71);
    engine.offer(12, 0, 2, 50 * NS, 72);
    effects(&mut engine);
    engine.result(20, 0, 0, "local's");
    assert_eq!(effects(&mut engine), ["20: 0 preliminary 0: local's of local"]);
    engine.fail(25, 0, 2, &"reset");
    engine.result(30, 0, 1, "west's");
    let item = engine.next_effect().unwrap();
    assert_eq!(to_text(&item), "30: 0 west's of west by arrival");
    let Effect::Output(item) = item else { panic!("{item:?}") };
    assert_eq!((item.revision, item.failures.len(), item.is_last()), (1, 1, true));
    assert!(engine.is_idle());

    assert!(engine.open(110, 1, None, 70, []));
    engine.offer(111, 1, 1, 100 * NS, 71);
    engine.offer(112, 1, 2, 50 * NS, 72);
    effects(&mut engine);
    engine.result(120, 1, 1, "west's");
    // Nobody waits for local any more, but it is not aborted (A52).
    assert_eq!(effects(&mut engine), ["120: 1 preliminary 0: west's of west"]);
    engine.result(130, 1, 0, "local's");
    assert_eq!(effects(&mut engine), [""; 0]);
    engine.tick(162);
    assert_eq!(effects(&mut engine), ["abort 2 1", "162: 1 final 1: west"]);
    assert!(engine.is_idle());

    assert!(engine.open(210, 2, None, 70, []));
    for p in [1, 2] {
        engine.offer(211, 2, p, 100 * NS, 71);
    }
    effects(&mut engine);
    engine.result(220, 2, 2, "east's");
    assert_eq!(effects(&mut engine), ["220: 2 east's of east by arrival", "abort 1 2"]);
    engine.fail(230, 2, 0, &"on purpose");
    assert!(engine.is_idle() && effects(&mut engine).is_empty());
}

/// A consumer that did not get the preliminary item gets its value with the last item (D1).
#[test]
fn final_item_can_take_over_the_earlier_value() {
    let mut engine = under(Commit::Progressive);
    assert!(engine.open(0, 0, None, 0, []));
    engine.offer(0, 0, 1, 100 * NS, 0);
    engine.result(20, 0, 0, "local's");
    engine.tick(100);
    let items: Vec<_> = std::iter::from_fn(|| engine.next_effect()).collect();
    let [_, _, Effect::Output(first), _, Effect::Output(last)] = &items[..] else {
        panic!("{items:?}")
    };
    assert_eq!(last.forwarded(), None);
    let whole = last.clone().instead_of(first.clone());
    let value = whole.forwarded().unwrap();
    assert_eq!((value.value, &value.arrived), ("local's", &(20 * NS)));
    assert_eq!((whole.revision, whole.decided, whole.is_last()), (1, 100 * NS, true));
    let better = Item { revision: 7, ..first.clone() };
    assert_eq!(better.clone().instead_of(first.clone()), better);
}

/// Meters and tally agree (D11).
#[test]
fn meters_say_what_the_tally_says() {
    let recorder = DebuggingRecorder::new();
    let mut engine = metrics::with_local_recorder(&recorder, engine);
    let _ = engine.open(0, 0, None, 0, []);
    engine.offer(0, 0, 1, 100 * NS, 0);
    engine.offer(0, 0, 7, 100 * NS, 0);
    engine.result(30, 0, 0, "boxes");
    engine.counts().sent(1, 333);
    engine.tick(150);
    let _ = engine.open(160, 1, None, 0, []);
    engine.offer(160, 1, 2, 100 * NS, 0);
    engine.fail(170, 1, 2, &"on purpose");
    engine.fail(180, 1, 0, &"on purpose");
    engine.fail(190, 1, 0, &"on purpose");
    let expected = [
        ("deadlines_total tested east offered", "1"),
        ("deadlines_total tested west offered", "1"),
        ("failures_total tested east accepted", "1"),
        ("failures_total tested local accepted", "1"),
        ("failures_total tested local superseded", "1"),
        ("messages_total tested", "2"),
        ("missed_messages_total tested", "1"),
        ("output_seconds tested local", "[150.0] ns"),
        ("outputs_total tested local timer", "1"),
        ("requests_total tested east admitted", "1"),
        ("requests_total tested local admitted", "2"),
        ("requests_total tested west admitted", "1"),
        ("response_seconds tested east", "[10.0] ns"),
        ("response_seconds tested local", "[30.0, 20.0] ns"),
        ("results_total tested local held", "1"),
        ("sent_bytes_total tested west", "333"),
        ("timer_lag_seconds tested", "[50.0] ns"),
        ("timers_total tested west", "1"),
    ];
    assert_eq!(
        metered(&recorder),
        expected.map(|(key, value)| (key.to_owned(), value.to_owned())).into()
    );
}

/// Under progressive each message counts once, and each output counts as a result (D11, F9).
#[test]
fn progressive_counts_messages_once() {
    let recorder = DebuggingRecorder::new();
    let mut engine = metrics::with_local_recorder(&recorder, || under(Commit::Progressive));
    for t in 0..2 {
        assert!(engine.open(0, t, None, 0, []));
        engine.offer(0, t, 1, 100 * NS, 0);
        engine.offer(0, t, 2, 100 * NS, 0);
    }
    for t in 0..2 {
        engine.result(30, t, 0, "local's");
    }
    engine.result(40, 0, 1, "west's");
    engine.result(50, 0, 2, "east's");
    engine.fail(60, 1, 2, &"on purpose");
    engine.fail(60, 1, 1, &"on purpose");
    let tally = engine.counts().tally();
    assert_eq!((tally.messages, tally.forwarded(), tally.missed), (2, 2, 0));
    let [local, east, west] = &tally.sources[..] else { panic!("{tally:?}") };
    let counts = |it: &SourceTally| (it.forwarded(), it.finals, it.preliminary, it.held);
    assert_eq!([local, west, east].map(counts), [(1, 1, 2, 0), (0, 0, 1, 0), (1, 0, 0, 0)]);
    let metered = metered(&recorder);
    for (key, value) in [
        ("outputs_total tested local final", "1"),
        ("outputs_total tested east arrival", "1"),
        ("results_total tested local preliminary", "2"),
        ("results_total tested west preliminary", "1"),
        ("results_total tested east forwarded", "1"),
        ("output_seconds tested local", "[30.0, 30.0] ns"),
    ] {
        assert_eq!(metered.get(key).map(String::as_str), Some(value), "{key} in {metered:#?}");
    }
    assert_eq!(metered.keys().filter(|key| key.starts_with("outputs_total")).count(), 2);
}

/// Returns what was metered, without zeros and gauges.
fn metered(recorder: &DebuggingRecorder) -> BTreeMap<String, String> {
    let mut metrics = BTreeMap::new();
    let snapshotter = recorder.snapshotter();
    for (key, _, _, value) in snapshotter.snapshot().into_vec() {
        let key = key.key();
        let labels: Vec<&str> = key.labels().map(metrics::Label::value).collect();
        let name = format!("{} {}", key.name().trim_start_matches("fuseline_"), labels.join(" "));
        match value {
            DebugValue::Counter(0) | DebugValue::Gauge(_) => {}
            DebugValue::Counter(count) => drop(metrics.insert(name, count.to_string())),
            DebugValue::Histogram(values) if values.is_empty() => {}
            DebugValue::Histogram(values) => {
                let nanos: Vec<f64> = values.iter().map(|v| (v.0 * 1e9).round()).collect();
                metrics.insert(name, format!("{nanos:?} ns"));
            }
        }
    }
    metrics
}

/// Returns an engine whose local results may be lost, as they may over ROS topics, with four
/// computations at once.
fn over_topics() -> Tested {
    let local = Local { at_once: 4, waiting: Some(4), may_lose_results: true, ..Local::default() };
    Engine::new(config(&header(Commit::Eager), &[64, 64], local)).unwrap()
}

/// Returns the computations that were started.
fn started(engine: &mut Tested) -> Vec<u64> {
    let starts = std::iter::from_fn(|| engine.next_effect()).filter_map(|effect| match effect {
        Effect::Start { priority: 0, timestamp, .. } => Some(timestamp),
        Effect::Start { .. }
        | Effect::Abort { .. }
        | Effect::Replace { .. }
        | Effect::Output(_)
        | Effect::Hint(_) => None,
    });
    starts.collect()
}

/// A lost computation frees its place although its message already has its output (D13).
#[test]
fn lost_computation_frees_its_place_after_an_output() {
    let mut engine = over_topics();
    for t in 0..6 {
        assert!(engine.open(t, t, Some(100 * NS), t, []));
        engine.offer(t, t, 2, 50 * NS, t);
        engine.result(t, t, 2, "east's");
    }
    // All messages have ended, so the machine has no timer left.
    assert!(engine.is_idle());
    assert_eq!(started(&mut engine), [0, 1, 2, 3]);
    assert_eq!(engine.next_due(), Some(100));
    engine.tick(99);
    assert_eq!(started(&mut engine), [0; 0]);
    engine.tick(100);
    assert_eq!((started(&mut engine), engine.next_due()), (vec![4], Some(101)));
    assert_eq!(engine.counts().tally().sources[0].lost, 1);
    engine.tick(101);
    // Nothing waits any more, so further losses are noticed only when another computation needs a
    // place.
    assert_eq!((started(&mut engine), engine.next_due()), (vec![5], None));
    assert!(engine.open(300, 6, Some(100 * NS), 6, []));
    assert_eq!(started(&mut engine), [6]);
    assert_eq!(engine.counts().tally().sources[0].lost, 6);
}

#[test]
fn lost_computations_result_counts_when_it_comes() {
    let mut engine = over_topics();
    for t in 0..4 {
        assert!(engine.open(0, t, Some(100 * NS), t, []));
    }
    engine.tick(100);
    assert_eq!(started(&mut engine), [0, 1, 2, 3]);
    for t in 4..8 {
        assert!(engine.open(100, t, Some(100 * NS), t, []));
    }
    assert_eq!(started(&mut engine), [4, 5, 6, 7]);
    engine.result(110, 0, 0, "local's of 0");
    assert_eq!(engine.counts().tally().sources[0].dropped[&DropReason::Superseded], 1);
    assert!(!engine.open(120, 8, Some(100 * NS), 8, []));
    engine.result(130, 4, 0, "local's of 4");
    assert!(engine.open(140, 8, Some(100 * NS), 8, []));
    assert_eq!(started(&mut engine), [8]);
}

#[test]
fn a_computation_that_still_runs_keeps_its_place() {
    let local = Local { waiting: Some(2), ..Local::default() };
    let mut engine: Tested = Engine::new(config(&header(Commit::Eager), &[1, 1], local)).unwrap();
    for t in 0..2 {
        assert!(engine.open(t, t, Some(100 * NS), t, []));
    }
    assert_eq!(engine.next_due(), Some(100));
    engine.tick(1000);
    assert_eq!((started(&mut engine), engine.next_due()), (vec![0], None));
    // The loss is counted only once.
    engine.tick(2000);
    assert_eq!(engine.counts().tally().sources[0].lost, 1);
    engine.result(2001, 0, 0, "local's of 0");
    assert_eq!(started(&mut engine), [1]);
}

/// Two computations hang, and one of them may be replaced (D13).
#[test]
fn replaces_hung_computations_up_to_a_bound() {
    let local = Local { waiting: Some(3), replaceable: 1, ..Local::default() };
    let mut engine: Tested = Engine::new(config(&header(Commit::Eager), &[1, 1], local)).unwrap();
    for t in 0..3 {
        assert!(engine.open(0, t, Some(100 * NS), t, []));
    }
    engine.tick(100);
    let effects: Vec<_> = std::iter::from_fn(|| engine.next_effect())
        .filter_map(|effect| match effect {
            Effect::Start { timestamp, .. } => Some((timestamp, false)),
            Effect::Replace { timestamp } => Some((timestamp, true)),
            Effect::Abort { .. } | Effect::Output(_) | Effect::Hint(_) => None,
        })
        .collect();
    assert_eq!(effects, [(0, false), (0, true), (1, false)]);
    engine.tick(200);
    assert_eq!(started(&mut engine), [0; 0], "the bound is reached");
    assert_eq!(engine.counts().tally().sources[0].lost, 2);
    // The replaced computation ends. Another one may be replaced now, but no place is free.
    engine.result(300, 0, 0, "local's of 0");
    assert_eq!(started(&mut engine), [0; 0]);
    engine.result(301, 1, 0, "local's of 1");
    assert_eq!(started(&mut engine), [2]);
    engine.tick(401);
    assert!(engine.open(402, 3, Some(100 * NS), 3, []));
    assert_eq!(started(&mut engine), [3]);
}

/// Late timers and blocking handlers are counted (D9).
#[test]
fn counts_late_timers_and_blocking_handlers() {
    let local = Local { waiting: Some(3), ..Local::default() };
    let config = config(&header(Commit::Eager), &[1, 1], local);
    let mut engine = Tested::new(EngineConfig { lag_warning: 20 * NS, ..config }).unwrap();
    let counting = engine.counts();
    for (t, late) in [(0, 20), (1, 90), (2, 21)] {
        let at = t * 1000;
        assert!(engine.open(at, t, Some(100 * NS), t, []));
        engine.tick(at + 100 + late);
        engine.fail(at + 200, t, 0, &"hung");
    }
    let tally = counting.tally();
    assert_eq!((tally.late_timers, tally.greatest_lag), (2, 90 * NS));
    counting.check_handler_time(Some(2), 20 * NS);
    counting.check_handler_time(Some(2), 300 * NS);
    counting.check_handler_time(None, 40 * NS);
    counting.handler_failed(Some(2));
    counting.handler_failed(None);
    let tally = counting.tally();
    assert_eq!((tally.sources[1].held_up, tally.greatest_lag), (1, 300 * NS));
    assert_eq!((tally.sources[1].handler_failures, tally.handler_failures), (1, 1));
}

#[test]
fn skip_answered_frees_places_of_ended_messages() {
    let local = Local { waiting: Some(1), skip_answered: true, ..Local::default() };
    let mut engine: Tested = Engine::new(config(&header(Commit::Eager), &[8, 8], local)).unwrap();
    for t in 0..8 {
        assert!(engine.open(t, t, None, t, []), "{t}");
        engine.offer(t, t, 2, 50 * NS, t);
        engine.result(t, t, 2, "east's");
    }
    engine.result(10, 0, 0, "local's of 0");
    assert_eq!(started(&mut engine), [0]);
    assert!(engine.open(11, 8, None, 8, []));
    assert_eq!(started(&mut engine), [8]);
}

#[test]
fn skip_answered_frees_outranked_computations() {
    let local = Local { waiting: Some(0), skip_answered: true, ..Local::default() };
    let mut engine: Tested =
        Engine::new(config(&header(Commit::Progressive), &[8, 8], local)).unwrap();
    assert!(engine.open(0, 0, None, 0, []));
    let offers = [1, 2].map(|priority| Offer { priority, deadline: 50 * NS, request: 1 });
    assert!(engine.open(1, 1, None, 1, offers));
    engine.result(2, 1, 1, "west's");
    engine.result(3, 0, 0, "local's of 0");
    assert!(engine.open(4, 2, None, 2, []));
    assert_eq!(started(&mut engine), [0, 2]);
}

#[test]
fn failure_reasons_are_in_the_item_and_counted() {
    let mut engine = engine();
    for t in 0..3 {
        assert!(engine.open(t, t, None, t, []));
        engine.offer(t, t, 2, 50 * NS, t);
        engine.fail(t, t, 2, if t == 1 { &"reset" } else { &"connection refused" });
        engine.fail(t, t, 0, &"x".repeat(1000));
        // This failure is superseded, because the message has ended.
        engine.fail(t, t, 0, &"too late to matter");
    }
    let mut items = std::iter::from_fn(|| engine.next_effect()).filter_map(|effect| match effect {
        Effect::Output(item) => Some(item),
        Effect::Start { .. } | Effect::Abort { .. } | Effect::Replace { .. } | Effect::Hint(_) => {
            None
        }
    });
    let item = items.nth(1).unwrap();
    let why: Vec<_> = item.failures.iter().map(|f| (f.source.priority, f.why.len())).collect();
    assert_eq!((item.timestamp, why), (1, vec![(2, "reset".len()), (0, 200)]));
    drop(items);
    let tally = engine.counts().tally();
    assert_eq!(tally.sources[1].reasons.to_string(), "2 × connection refused, 1 × reset");
    assert_eq!(tally.sources[0].reasons.iter().next().unwrap().1, 3);
    for n in 0..20 {
        let t = n + 3;
        let _ = engine.open(t, t, None, t, []);
        engine.fail(t, t, 0, &format!("reason {n}"));
    }
    let reasons = engine.counts().tally().sources[0].reasons.clone();
    assert_eq!((reasons.iter().count(), reasons.others()), (8, 15));
}
