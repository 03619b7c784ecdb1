//! Tests origins, ages and the messages that values are of (`of`), in items and in the trace (A46,
//! A51, D2).

use std::fs;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::tested::config;
use fuseline_engine::{
    Cloud, Commit, Effect, Ending, Engine, Forwarded, Header, HeaderAnnotations, Item, Lineage,
    Local, Offer, Recorder, Recording, StampedValue,
};
use fuseline_traces::judge;

type Tested = Engine<&'static str, u64>;

const NS: Duration = Duration::from_nanos(1);

/// An engine that records, with the folder of its trace.
struct RecordedEngine {
    engine: Tested,
    start: Instant,
    folder: tempfile::TempDir,
}

impl RecordedEngine {
    /// Creates an engine. Cloud 1 may send values of messages up to `max_age` before the current
    /// one.
    fn new(commit: Commit, max_age: u64) -> Self {
        let cloud = Cloud { p: 1, name: None, limit: 9, resume: 0 };
        let header = Header { operator: None, window: 4, commit, clouds: vec![cloud] };
        let local = Local { at_once: 9, waiting: Some(9), ..Local::default() };
        let mut config = config(&header, &[9], local);
        config.clouds[0].max_age = max_age;
        let mut engine = Tested::new(config).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let max_ages = [(1, max_age)].into_iter().filter(|(_, age)| *age > 0).collect();
        let annotations = HeaderAnnotations { max_ages, ..HeaderAnnotations::default() };
        let path = folder.path().join("trace");
        let recorder =
            Recorder::create_annotated(path, &header, &annotations, Recording::default());
        engine.record(recorder.unwrap()).unwrap();
        // A start long ago, so that earlier captures can be expressed.
        let start = Instant::now();
        engine.set_start(start);
        Self { engine, start, folder }
    }

    /// Returns the lineage of a camera's message `seq`, which was captured `age` before it is
    /// opened at `at`.
    fn lineage(&self, at: u64, seq: u64, age: u64) -> Arc<Lineage> {
        let opened = self.start + Duration::from_nanos(at);
        let captured = opened.checked_sub(Duration::from_nanos(age)).unwrap();
        Arc::new(Lineage::new("camera", seq, captured).within(Duration::from_nanos(500)))
    }

    fn open(&mut self, at: u64, t: u64, age: u64) {
        let offer = Offer { priority: 1, deadline: 100 * NS, request: t };
        let lineage = self.lineage(at, t + 40, age);
        self.engine.open_with(at, t, None, Some(lineage), t, [offer]);
    }

    fn items(&mut self) -> Vec<Item<&'static str>> {
        let effects = std::iter::from_fn(|| self.engine.next_effect());
        let items = effects.filter_map(|effect| match effect {
            Effect::Output(item) => Some(item),
            Effect::Start { .. }
            | Effect::Abort { .. }
            | Effect::Replace { .. }
            | Effect::Hint(_) => None,
        });
        items.collect()
    }

    /// Returns the lines of the trace with one of these words, after checking that all of it
    /// conforms.
    fn lines(mut self, words: &[&str]) -> Vec<String> {
        self.engine.finish().unwrap();
        let text = fs::read_to_string(self.folder.path().join("trace")).unwrap();
        let verdict = judge("trace", text.as_bytes()).unwrap();
        assert!(verdict.violations.is_empty(), "{verdict}\n{text}");
        let wanted = text.lines().filter(|line| words.iter().any(|word| line.contains(word)));
        wanted.map(str::to_owned).collect()
    }
}

fn forwarded<V>(item: &Item<V>) -> &Forwarded<V> {
    item.forwarded().expect("a value")
}

fn of(value: &'static str, of: u64) -> StampedValue<&'static str> {
    StampedValue { value, of: Some(of), meant_for: None }
}

#[test]
fn item_has_its_messages_lineage_and_age() {
    let mut run = RecordedEngine::new(Commit::Eager, 0);
    run.open(10, 0, 7);
    run.engine.result(30, 0, 1, "boxes");
    let item = run.items().remove(0);
    assert_eq!(item.lineage, Some(run.lineage(10, 40, 7)));
    assert_eq!(item.age, Some(27 * NS));
    // A clock that runs ahead says that this message was captured after it was opened. Its age is
    // 0, never less.
    run.open(40, 1, 0);
    let ahead = Arc::new(Lineage::new("camera", 9, run.start + 60 * NS));
    run.engine.open_with(40, 1, None, Some(ahead), 1, []);
    let refused = run.items().remove(0);
    assert!(matches!(refused.ending, Ending::Refused(_)), "{refused:?}");
    let origin = refused.lineage.unwrap().origin.clone().unwrap();
    assert_eq!(
        (&*origin.stream, origin.seq, refused.age),
        ("camera", Some(9), Some(Duration::ZERO))
    );
    // A message without a lineage has no age and no origin.
    run.engine.open(50, 2, None, 2, []);
    run.engine.result(51, 2, 0, "boxes");
    let item = run.items().remove(0);
    assert_eq!((item.lineage, item.age), (None, None));
    assert_eq!(
        run.lines(&["open"]),
        [
            r#"{"ev":"open","at":10,"t":0,"deadline":493,"within":500,"age":7,"origin":"camera","seq":40}"#,
            r#"{"ev":"open","at":40,"t":1,"deadline":500,"within":500,"age":0,"origin":"camera","seq":41}"#,
            r#"{"ev":"open","at":40,"t":1,"age":0,"origin":"camera","seq":9}"#,
            r#"{"ev":"open","at":50,"t":2}"#,
        ]
    );
}

#[test]
fn engine_without_start_writes_no_age() {
    let mut run = RecordedEngine::new(Commit::Eager, 0);
    let header = Header { operator: None, window: 4, commit: Commit::Eager, clouds: Vec::new() };
    let local = Local { waiting: Some(9), ..Local::default() };
    run.engine = Tested::new(config(&header, &[], local)).unwrap();
    let path = run.folder.path().join("trace");
    let recorder = Recorder::create(path, &header, Recording::default()).unwrap();
    run.engine.record(recorder).unwrap();
    run.open(10, 0, 7);
    run.engine.result(30, 0, 0, "boxes");
    assert_eq!(run.items().remove(0).age, None);
    let opened =
        r#"{"ev":"open","at":10,"t":0,"deadline":500,"within":500,"origin":"camera","seq":40}"#;
    assert_eq!(run.lines(&["open"]), [opened]);
}

/// The `emit` names the message that its value is of (D2).
#[test]
fn emit_names_the_message_of_its_value() {
    let mut run = RecordedEngine::new(Commit::Eager, 0);
    // One result is sent at once, one is held until a timer fires, and one does not state its
    // message.
    for t in 0..3 {
        run.open(t, t, 0);
    }
    run.engine.result(10, 0, 1, of("zero", 0));
    run.engine.result(11, 1, 0, of("one", 1));
    run.engine.result(12, 2, 1, "two");
    run.engine.tick(101);
    let items = run.items();
    let reported: Vec<_> =
        items.iter().map(|item| (forwarded(item).value, forwarded(item).of)).collect();
    assert_eq!(reported, [("zero", Some(0)), ("two", None), ("one", Some(1))]);
    assert_eq!(
        run.lines(&["result", "emit"]),
        [
            r#"{"ev":"result","at":10,"t":0,"p":1,"of":0}"#,
            r#"{"ev":"emit","at":10,"t":0,"p":1,"of":0}"#,
            r#"{"ev":"result","at":11,"t":1,"p":0,"of":1}"#,
            r#"{"ev":"result","at":12,"t":2,"p":1}"#,
            r#"{"ev":"emit","at":12,"t":2,"p":1}"#,
            r#"{"ev":"emit","at":101,"t":1,"p":0,"of":1}"#,
        ]
    );
}

/// A value of another message is a failure (D2).
#[test]
fn a_value_of_another_message_is_a_failure() {
    let mut run = RecordedEngine::new(Commit::Eager, 0);
    for t in 0..2 {
        run.open(t, t, 0);
    }
    run.engine.result(10, 1, 1, of("stale", 0));
    run.engine.result(11, 0, 1, of("of the future", 1));
    run.engine.result(12, 1, 0, "local");
    run.engine.result(13, 0, 0, of("no message's", 7));
    let items = run.items();
    assert_eq!(forwarded(&items[0]).value, "local");
    assert_eq!(
        &*items[0].failures[0].why,
        "the value was computed from message 0; it must be from messages 1 to 1"
    );
    assert_eq!(items[1].ending, Ending::Missed);
    assert_eq!(run.lines(&["fail", "result"]).len(), 4);
}

/// An action that is meant for another tick is a failure (D18). A chunk of observation 0 has one
/// for each tick.
#[test]
fn action_meant_for_another_tick_is_a_failure() {
    let mut run = RecordedEngine::new(Commit::Eager, 3);
    for t in 0..4 {
        run.open(t, t, 0);
    }
    let action = |meant_for| StampedValue { value: "reach", of: Some(0), meant_for };
    run.engine.result(10, 0, 1, action(Some(0)));
    run.engine.result(11, 1, 1, action(Some(3)));
    run.engine.result(12, 2, 1, action(Some(1)));
    run.engine.result(13, 3, 1, action(None));
    run.engine.result(14, 1, 0, "on board");
    let items = run.items();
    let sent = items.iter().map(|item| (item.timestamp, forwarded(item).meant_for));
    assert_eq!(sent.collect::<Vec<_>>(), [(0, Some(0)), (3, None), (1, None)]);
    assert_eq!(&*items[2].failures[0].why, "the value is meant for message 3");
    assert_eq!(
        run.lines(&["result", "emit", "fail"]),
        [
            r#"{"ev":"result","at":10,"t":0,"p":1,"of":0,"for":0}"#,
            r#"{"ev":"emit","at":10,"t":0,"p":1,"of":0,"for":0}"#,
            r#"{"ev":"fail","at":11,"t":1,"p":1}"#,
            r#"{"ev":"fail","at":12,"t":2,"p":1}"#,
            r#"{"ev":"result","at":13,"t":3,"p":1,"of":0}"#,
            r#"{"ev":"emit","at":13,"t":3,"p":1,"of":0}"#,
            r#"{"ev":"result","at":14,"t":1,"p":0}"#,
            r#"{"ev":"emit","at":14,"t":1,"p":0}"#,
        ]
    );
}

/// A cloud's value may be up to `max_age` messages old, and its item has the age of the value's
/// message (D2).
#[test]
fn a_value_may_be_as_old_as_the_cloud_may_send_and_is_as_old_as_its_message() {
    let mut run = RecordedEngine::new(Commit::Eager, 2);
    for t in 0..4 {
        run.open(10 * t, t, 5);
    }
    run.engine.result(40, 2, 1, of("of 0", 0));
    run.engine.result(41, 3, 1, of("of 0", 0));
    run.engine.result(42, 1, 1, of("of 1", 1));
    let items = run.items();
    // Message 0 was captured 5 ns before it was opened at 0.
    assert_eq!((forwarded(&items[0]).of, items[0].age), (Some(0), Some(45 * NS)));
    assert_eq!(items[0].lineage, Some(run.lineage(20, 42, 5)), "it is passed on as it is");
    assert_eq!((forwarded(&items[1]).of, items[1].age), (Some(1), Some(37 * NS)));
    assert_eq!(items.len(), 2, "3's was too old");
    let header = run.lines(&["fuseline"]).remove(0);
    assert!(
        header.ends_with(r#""clouds":[{"p":1,"limit":9,"resume":0,"max_age":2}]}"#),
        "{header}"
    );
}

/// A final item that takes over a value has the age that the value has reached (D2, F9).
#[test]
fn final_item_has_the_age_of_its_earlier_value() {
    let mut run = RecordedEngine::new(Commit::Progressive, 1);
    run.open(0, 0, 3);
    run.open(10, 1, 3);
    run.engine.result(20, 1, 0, of("local's", 1));
    run.engine.fail(50, 1, 1, &"on purpose");
    let mut items = run.items();
    let (last, first) = (items.pop().unwrap(), items.pop().unwrap());
    assert_eq!((first.age, last.age), (Some(13 * NS), Some(43 * NS)));
    let last = last.instead_of(first);
    assert_eq!((forwarded(&last).value, last.age), ("local's", Some(43 * NS)));
    let emitted = run.lines(&["emit", "final"]);
    assert_eq!(emitted[0], r#"{"ev":"emit","at":20,"t":1,"p":0,"of":1}"#);
}
