//! Tests an end-to-end deadline at one operator: the time for requests and local, and the reports
//! to policies (E2, E3, E4).

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::tested::config;
use fuseline_deadline::{Chosen, End, Policy, Reason};
use fuseline_engine::{
    Cloud, Commit, Effect, Ending, Engine, EngineConfig, Header, Latency, Lineage, Local, Offer,
    OfferRefusal, Overflow, Reserve, Situation,
};

type Tested = Engine<&'static str, u64>;

const MS: Duration = Duration::from_millis(1);

fn engine() -> (Tested, Instant) {
    changed(|_| ())
}

/// Returns an engine with a changed configuration.
fn changed(change: impl FnOnce(&mut EngineConfig)) -> (Tested, Instant) {
    let cloud = Cloud { p: 1, name: None, limit: 9, resume: 0 };
    let commit = Commit::Eager;
    let header = Header { operator: None, window: 9, commit, clouds: vec![cloud] };
    let mut config = config(&header, &[9], Local::default());
    change(&mut config);
    let mut engine = Tested::new(config).unwrap();
    let start = Instant::now();
    engine.set_start(start);
    (engine, start)
}

const fn ms(ms: u64) -> u64 {
    ms * 1_000_000
}

/// Opens a message that is `age_ms` old and due 500 ms after its capture, and offers it to a cloud
/// for 400 ms.
fn open(engine: &mut Tested, start: Instant, at_ms: u64, t: u64, age_ms: u64) {
    let captured =
        (start + Duration::from_millis(at_ms)).checked_sub(Duration::from_millis(age_ms));
    let lineage = Arc::new(Lineage::new("camera", t, captured.unwrap()).within(500 * MS));
    let offer = Offer { priority: 1, deadline: 400 * MS, request: t };
    engine.open_with(ms(at_ms), t, None, Some(lineage), t, [offer]);
}

/// Describes what was started and how messages ended, with instants in ms.
fn effects(engine: &mut Tested) -> Vec<String> {
    let effects = std::iter::from_fn(|| engine.next_effect());
    let words = effects.filter_map(|effect| match effect {
        Effect::Start { priority, timestamp, until, .. } => {
            let until = until.map(|until| until / ms(1));
            Some(format!("start {priority} {timestamp} until {until:?}"))
        }
        Effect::Output(item) => {
            let what = match item.ending {
                Ending::Forwarded(it) => it.value.to_owned(),
                Ending::Missed => "missed".to_owned(),
                ending => format!("{ending:?}"),
            };
            Some(format!("{}: {} {what}", item.decided.as_millis(), item.timestamp))
        }
        Effect::Abort { .. } | Effect::Replace { .. } | Effect::Hint(_) => None,
    });
    words.collect()
}

/// A deadline does not move with an age from a wall clock, which may step (D13).
#[test]
fn a_doubtful_age_moves_no_deadline() {
    let (mut engine, start) = changed(|config| config.has_doubtful_ages = true);
    engine.set_reserve(Reserve::new(150 * MS, 150 * MS));
    open(&mut engine, start, 1000, 1, 300);
    assert_eq!(
        effects(&mut engine),
        ["start 0 1 until None", "start 1 1 until Some(1350)"],
        "the request has 500 ms less the reserve"
    );
    engine.tick(ms(1350));
    engine.tick(ms(1499));
    assert!(effects(&mut engine).is_empty());
    engine.tick(ms(1500));
    assert_eq!(effects(&mut engine), ["1500: 1 missed"]);
}

/// A request ends where the reserve of the operators downstream begins (E3).
#[test]
fn request_ends_where_the_reserve_begins() {
    let (mut engine, start) = engine();
    engine.set_reserve(Reserve::new(150 * MS, 150 * MS));
    open(&mut engine, start, 1000, 0, 100);
    assert_eq!(effects(&mut engine), ["start 0 0 until None", "start 1 0 until Some(1250)"]);
    // The request's own deadline is earlier.
    engine.set_reserve(Reserve::default());
    open(&mut engine, start, 1001, 1, 0);
    assert_eq!(effects(&mut engine), ["start 1 1 until Some(1401)"]);
}

/// An operator whose budget is used up asks no cloud (E3).
#[test]
fn an_operator_whose_budget_is_gone_asks_no_cloud() {
    let (mut engine, start) = engine();
    engine.set_reserve(Reserve::new(150 * MS, 150 * MS));
    open(&mut engine, start, 1000, 0, 349);
    open(&mut engine, start, 1000, 1, 350);
    open(&mut engine, start, 1000, 2, 700);
    let refused = &engine.counts().tally().sources[1].refused;
    assert_eq!(refused.get(&OfferRefusal::Deadline), Some(&2));
    assert_eq!(effects(&mut engine), ["start 0 0 until None", "start 1 0 until Some(1001)"]);
}

/// A message is closed by its end-to-end deadline or, with a substitute, by the end of its budget
/// (E2, E4).
#[test]
fn no_message_is_open_after_its_budget() {
    for (has_substitute, due) in [(false, 1400), (true, 1250)] {
        let (mut engine, start) = changed(|config| config.has_substitutes = has_substitute);
        engine.set_reserve(Reserve::new(150 * MS, 150 * MS));
        open(&mut engine, start, 1000, 0, 100);
        effects(&mut engine);
        engine.tick(ms(due) - 1);
        assert_eq!(effects(&mut engine), [""; 0]);
        engine.tick(ms(due));
        assert_eq!(effects(&mut engine), [format!("{due}: 0 missed")]);
        // A message that is too old when it comes is missed at once.
        open(&mut engine, start, 2000, 1, 500);
        engine.tick(ms(2000) + 1);
        assert_eq!(effects(&mut engine), ["2000: 1 missed"]);
    }
}

/// Without an end-to-end deadline, requests and local keep their own deadlines (E3).
#[test]
fn no_end_to_end_deadline_ends_nothing_earlier() {
    let (mut engine, start) = changed(|config| config.has_substitutes = true);
    engine.set_reserve(Reserve::new(150 * MS, 150 * MS));
    let lineage = Arc::new(Lineage::new("camera", 0, start));
    let offer = Offer { priority: 1, deadline: 400 * MS, request: 0 };
    engine.open_with(ms(1000), 0, None, Some(lineage), 0, [offer]);
    assert_eq!(effects(&mut engine), ["start 0 0 until None", "start 1 0 until Some(1400)"]);
    engine.tick(ms(1400));
    assert_eq!(effects(&mut engine), [""; 0]);
}

/// A policy that chooses its cap, but at most 450 ms, and stores the reports that it gets.
struct EndToEnd(Arc<Mutex<Vec<String>>>);

impl Policy for EndToEnd {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let ages: Vec<_> = situation.under_way.iter().map(Duration::as_millis).collect();
        self.0.lock().unwrap().push(format!("at most {cap:?}, under way {ages:?}"));
        Chosen { deadline: cap.min(450 * MS), reason: Reason::Constant }
    }

    fn ended(&mut self, end: End) {
        self.0.lock().unwrap().push(format!("{end:?}"));
    }
}

/// A policy's figures cover the whole way from the capture to the last output (E3).
#[test]
fn policy_decides_from_capture_to_last_output() {
    let reported = Arc::new(Mutex::new(Vec::new()));
    let policy = Box::new(EndToEnd(Arc::clone(&reported)));
    let (mut engine, start) = changed(|config| config.clouds[0].policy = Some(policy));
    engine.set_reserve(Reserve::new(150 * MS, 150 * MS));
    open(&mut engine, start, 1000, 0, 100);
    // Of the 450 ms, 100 ms have passed and 150 ms are the reserve.
    assert_eq!(effects(&mut engine), ["start 0 0 until None", "start 1 0 until Some(1200)"]);
    open(&mut engine, start, 1020, 1, 100);
    engine.result(ms(1070), 0, 1, "boxes");
    engine.fail(ms(1080), 1, 1, &"broken");
    let expected = [
        "at most 500ms, under way []",
        "at most 500ms, under way [270]",
        "Answered(320ms)",
        "Failed(310ms)",
    ];
    assert_eq!(*reported.lock().unwrap(), expected);
}

/// The oldest waiting computation is discarded, unless each message is needed (D17).
#[test]
fn discards_the_oldest_computation_unless_needed() {
    for (overflow, lost) in [(Overflow::DropOldest, 1), (Overflow::DropNewest, 3)] {
        let local = Local { waiting: Some(2), overflow, ..Local::default() };
        let (mut engine, _) = changed(|config| config.local = local);
        for t in 0..3 {
            engine.open(t, t, None, t, []);
        }
        let offer = Offer { priority: 1, deadline: MS, request: 3 };
        engine.open(3, 3, None, 3, [offer]);
        engine.result(4, 0, 0, "boxes");
        let mut expected =
            vec!["start 0 0 until None".to_owned(), "start 1 3 until Some(1)".into()];
        if lost == 1 {
            expected.insert(1, "start 1 3 until Some(1)".into());
            expected[2] = "0: 1 missed".into();
        }
        expected.push("0: 0 boxes".into());
        let next = if lost == 1 { 2 } else { 1 };
        expected.push(format!("start 0 {next} until None"));
        assert_eq!(effects(&mut engine), expected);
        // A message whose local computation was discarded may still get a cloud's result.
        engine.result(5, 3, 1, "the cloud's");
        assert_eq!(effects(&mut engine), ["0: 3 the cloud's"]);
    }
}

/// A latency measures local's results and last items, whatever is sent first or refused (E3, E11).
#[test]
fn latency_counts_local_and_last_items() {
    let latency = Latency::measured(1, Duration::ZERO);
    let (mut engine, start) = changed(|config| {
        config.commit = Commit::Progressive;
        config.latency = Some(latency.clone());
    });
    for t in 0..16 {
        let at = 1000 + 100 * t;
        open(&mut engine, start, at, t, 0);
        // These are refused for their order and take no time.
        open(&mut engine, start, at, t, 0);
        engine.result(ms(at + 20), t, 0, "local's");
        engine.result(ms(at + 60), t, 1, "a cloud's");
    }
    assert_eq!(latency.estimate(), Reserve::new(20 * MS, 60 * MS));
    // Local's result is measured although a better one was sent.
    open(&mut engine, start, 5000, 99, 0);
    engine.result(ms(5010), 99, 1, "a cloud's");
    engine.result(ms(5015), 99, 0, "local's");
    assert_eq!(latency.estimate(), Reserve::new(15 * MS, 15 * MS));
    // The wait for the worker does not count.
    open(&mut engine, start, 6000, 100, 0);
    open(&mut engine, start, 6000, 101, 0);
    engine.result(ms(6030), 100, 0, "local's");
    engine.result(ms(6035), 101, 0, "local's");
    assert_eq!(latency.estimate().on_board(), 5 * MS);
}

/// The time that is kept for a cloud downstream does not shorten local's time (E11).
#[test]
fn local_ends_at_the_reserve_on_board() {
    let (mut engine, start) = changed(|config| config.has_substitutes = true);
    engine.set_reserve(Reserve::new(50 * MS, 150 * MS));
    open(&mut engine, start, 1000, 0, 100);
    assert_eq!(effects(&mut engine), ["start 0 0 until None", "start 1 0 until Some(1250)"]);
    engine.tick(ms(1349));
    assert!(effects(&mut engine).is_empty());
    engine.tick(ms(1350));
    assert_eq!(effects(&mut engine), ["1350: 0 missed"]);
}
