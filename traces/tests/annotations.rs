//! Tests the keys beside the machine's: reading, writing, and refusing them.

use std::fs;
use std::sync::Arc;

use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{
    Annotations, Cloud, Commit, Decision, Event, Events, Header, HeaderAnnotations, Input, Origin,
    ReadError, Recorder, Recording, Rule, judge,
};
use proptest::option;
use proptest::prelude::*;

const HEADER: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9}]}"#;
const WITHOUT_LOCAL: &str =
    r#"{"fuseline":1,"window":4,"local":"none","clouds":[{"p":1,"limit":9,"max_age":3}]}"#;

/// Returns the annotations of the second line.
fn second_line(is_observed: bool, header: &str, line: &str) -> Result<Annotations, ReadError> {
    let trace = format!("{header}\n{line}\n");
    let read = if is_observed { Events::observed } else { Events::new };
    let mut reader = read("a.jsonl", trace.as_bytes())?;
    reader.next_event()?;
    Ok(reader.annotations().clone())
}

/// Returns the error about the first line that is refused.
fn refused(is_observed: bool, header: &str, line: &str) -> String {
    second_line(is_observed, header, line).expect_err(line).to_string()
}

#[test]
fn what_stands_beside_the_rules_is_read_with_its_line() {
    let trace = [
        WITHOUT_LOCAL,
        r#"{"ev":"open","at":9,"t":7,"within":50,"age":3,"origin":"camera/\u0066ront","seq":41,"missing":["right","p\u006cace"]}"#,
        r#"{"ev":"request","at":9,"t":7,"p":1,"due":20,"try":0}"#,
        r#"{"try":255,"of":6,"ev":"result","at":12,"t":7,"p":1}"#,
        r#"{"ev":"emit","at":12,"t":7,"p":1,"of":6}"#,
        r#"{"ev":"tick","at":12}"#,
        "",
    ];
    let trace = trace.join("\n");
    let mut reader = Events::observed("a.jsonl", trace.as_bytes()).unwrap();
    let header = reader.header_annotations();
    assert_eq!((header.without_local, header.values_of(7, 1)), (true, (4, 7)));
    assert_eq!((header.values_of(7, 0), header.values_of(2, 1)), ((7, 7), (0, 2)));
    let origin = Some(Origin { stream: "camera/front".into(), seq: Some(41) });
    let missing = vec!["right".into(), "place".into()];
    let opened =
        Annotations { within: Some(50), age: Some(3), origin, missing, ..Annotations::NONE };
    let expected = [
        opened,
        Annotations { attempt: Some(0), ..Annotations::NONE },
        Annotations { attempt: Some(255), of: Some(6), ..Annotations::NONE },
        Annotations { of: Some(6), ..Annotations::NONE },
        Annotations::NONE,
    ];
    for annotations in expected {
        reader.next_event().unwrap().unwrap();
        assert_eq!(*reader.annotations(), annotations);
    }
    let none = r#"{"ev":"open","at":9,"t":7,"missing":[ ]}"#;
    assert_eq!(second_line(false, HEADER, none).unwrap(), Annotations::NONE);
    // An age alone says how old the message is.
    let alone = r#"{"ev":"open","at":9,"t":7,"age":0}"#;
    assert_eq!(second_line(false, HEADER, alone).unwrap().age, Some(0));
}

#[test]
fn what_has_no_place_there_is_refused_where_it_stands() {
    let observed = "is allowed only in traces that are judged as observed";
    for (name, column) in [("request", 44), ("result", 35), ("fail", 33)] {
        let due = if name == "request" { r#","due":9"# } else { "" };
        let line = format!(r#"{{"ev":"{name}","at":1,"t":2,"p":1{due},"try":0}}"#);
        let expected = format!("a.jsonl:2:{column}: key \"try\" {observed}");
        assert_eq!(refused(false, HEADER, &line), expected);
        assert!(second_line(true, HEADER, &line).is_ok());
    }
    let expected = format!("a.jsonl:1:26: key \"local\" {observed}");
    assert_eq!(refused(false, WITHOUT_LOCAL, ""), expected);
    let some = WITHOUT_LOCAL.replace("none", "some");
    let expected = "a.jsonl:1:34: unknown local \"some\"; it is one of none; leave the key out if \
                    the operator has a local";
    assert_eq!(refused(true, &some, ""), expected);
    let old = WITHOUT_LOCAL.replace("\"max_age\":3", "\"max_age\":-3");
    assert!(refused(true, &old, "").starts_with("a.jsonl:1:78: expected a whole number"));
    let cases = [
        (
            r#"{"ev":"result","at":1,"t":2,"p":1,"try":256}"#,
            "2:41: try is 256; it must be from 0 to 255",
        ),
        (
            r#"{"ev":"fail","at":1,"t":2,"p":0,"try":1}"#,
            "2:33: key \"try\" is in a line of p 0; local gets no requests, so it has no attempts",
        ),
        (
            r#"{"ev":"open","at":1,"t":2,"seq":7}"#,
            "2:27: key \"seq\" is given without key \"origin\"; name the stream that it counts in",
        ),
        (r#"{"ev":"open","at":1,"t":2,"origin":7}"#, "2:36: expected a name in quotes, found `7`"),
        (
            r#"{"ev":"open","at":1,"t":2,"missing":"left"}"#,
            "2:37: expected `[` at the start of missing, found `\"left\"`",
        ),
        (
            r#"{"ev":"open","at":1,"t":2,"missing":["left",2]}"#,
            "2:45: expected a name in quotes, found `2`",
        ),
        (
            r#"{"ev":"open","at":1,"t":2,"missing":["left"],"missing":[]}"#,
            "2:46: key \"missing\" is given twice; give it once",
        ),
        (
            r#"{"ev":"emit","at":1,"t":2,"p":1,"try":1}"#,
            "2:33: key \"try\" is not allowed in an emit line; it takes ev, at, t, p, of, for, x",
        ),
        (
            r#"{"ev":"miss","at":1,"t":2,"of":1}"#,
            "2:27: key \"of\" is not allowed in a miss line; it takes ev, at, t, x",
        ),
        (
            r#"{"ev":"open","at":1,"t":2,"deadline":5}"#,
            "2:27: key \"deadline\" is local's deadline, but the header says that there is no \
             local; the message's own deadline is \"within\"",
        ),
    ];
    for (line, message) in cases {
        assert_eq!(refused(true, WITHOUT_LOCAL, line), format!("a.jsonl:{message}"));
    }
    for key in ["of", "for", "within", "age"] {
        let event = if ["of", "for"].contains(&key) { r#""emit","p":1"# } else { r#""open""# };
        for value in ["null", "-1", "1.5", "\"1\"", "18446744073709551616"] {
            let line = format!(r#"{{"ev":{event},"at":1,"t":2,"{key}":{value}}}"#);
            assert!(refused(false, HEADER, &line).contains("a whole number"), "{line}");
        }
    }
}

#[test]
fn message_deadline_counts_from_its_capture() {
    let due = |at, within, age| Annotations { within, age, ..Annotations::NONE }.due(at);
    assert_eq!(due(100, None, Some(7)), None);
    assert_eq!(due(100, Some(50), None), Some(150));
    assert_eq!(due(100, Some(50), Some(20)), Some(130));
    // It was too late from the start.
    assert_eq!(due(100, Some(50), Some(60)), Some(90));
    assert_eq!(due(100, Some(50), Some(u64::MAX)), Some(0));
    // The ends of the range.
    assert_eq!(due(u64::MAX, Some(u64::MAX), None), Some(u64::MAX));
    assert_eq!(due(u64::MAX, Some(u64::MAX), Some(u64::MAX)), Some(u64::MAX));
}

fn any_annotations() -> impl Strategy<Value = (Annotations, bool)> {
    let n = || option::of(any::<u64>());
    let origin =
        option::of((".{0,9}", n()).prop_map(|(stream, seq)| Origin { stream: stream.into(), seq }));
    let missing = proptest::collection::vec(".{0,9}".prop_map(Arc::from), 0..3);
    (n(), n(), option::of(any::<u8>()), n(), n(), origin, missing, any::<bool>()).prop_map(
        |(of, meant_for, attempt, within, age, origin, missing, is_open)| {
            if is_open {
                let opened = Annotations { within, age, origin, missing, ..Annotations::NONE };
                (opened, true)
            } else {
                (Annotations { of, meant_for, attempt, ..Annotations::NONE }, false)
            }
        },
    )
}

proptest! {
    #[test]
    fn what_is_written_is_read_again((annotations, is_open) in any_annotations(), at in any::<u64>()) {
        let input = if is_open {
            Input::Open { at, t: 3, deadline: None }
        } else {
            Input::Result { at, t: 3, p: 1 }
        };
        let line = Event::Input(input).annotated(&annotations);
        prop_assert_eq!(second_line(true, HEADER, &line).unwrap(), annotations);
        // Without annotations the line is unchanged.
        prop_assert_eq!(Event::Input(input).annotated(&Annotations::NONE), input.to_string());
    }

    #[test]
    fn a_header_that_is_written_is_read_again(max_age in any::<u64>(), without_local in any::<bool>()) {
        let clouds = vec![Cloud { p: 7, name: None, limit: 3, resume: 0 }];
        let header = Header { operator: None, window: 2, commit: Commit::Eager, clouds };
        let annotations = HeaderAnnotations { without_local, max_ages: [(7, max_age)].into() };
        let mut trace = Vec::new();
        header.write_annotated(&annotations, &mut trace);
        trace.push(b'\n');
        let reader = Events::observed("a.jsonl", &trace[..]).unwrap();
        prop_assert_eq!((reader.header(), reader.header_annotations()), (&header, &annotations));
    }
}

#[test]
fn a_recorder_writes_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.jsonl");
    let clouds = vec![Cloud { p: 1, name: None, limit: 3, resume: 2 }];
    let header = Header { operator: None, window: 2, commit: Commit::Eager, clouds };
    let terms = HeaderAnnotations { max_ages: [(1, 2)].into(), ..HeaderAnnotations::default() };
    let of = Annotations { of: Some(8), ..Annotations::NONE };
    let mut recorder =
        Recorder::create_annotated(&path, &header, &terms, Recording::default()).unwrap();
    recorder.input(&Input::Open { at: 0, t: 9, deadline: None });
    recorder.annotated_input(&Input::Result { at: 1, t: 9, p: 0 }, &of);
    recorder.annotated_decision(&Decision::Emit { at: 1, t: 9, p: 0 }, &of);
    drop(recorder);
    let written = fs::read(&path).unwrap();
    let verdict = judge("a.jsonl", &written[..]).unwrap();
    // Local's values have no age at all.
    let [violation] = &verdict.violations[..] else { panic!("{verdict}") };
    assert_eq!((violation.rule, violation.line), (Rule::D2, 4));
    assert_eq!(violation.found, r#"{"ev":"emit","at":1,"t":9,"p":0,"of":8}"#);
    assert_eq!(violation.expected, "a value of timestamp 9");
    assert_eq!(violation.story[1], r#"3: {"ev":"result","at":1,"t":9,"p":0,"of":8}"#);
}

/// A value of another message is reported as such (D2), and not as a missing result (P3) if no
/// result is recorded at all.
#[test]
fn a_value_of_another_message_is_reported_as_that() {
    let trace = [
        r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9,"max_age":2}]}"#,
        r#"{"ev":"open","at":0,"t":5}"#,
        r#"{"ev":"request","at":0,"t":5,"p":1,"due":40}"#,
        r#"{"ev":"emit","at":9,"t":5,"p":1,"of":1}"#,
        "",
    ];
    let slack = Slack { tolerance: 1, lateness: 2 };
    let verdict = observed::judge("a.jsonl", slack, trace.join("\n").as_bytes()).unwrap();
    let [violation] = &verdict.violations[..] else { panic!("{verdict:?}") };
    assert_eq!((violation.rule, violation.line), (Rule::D2, 4));
    assert_eq!(violation.expected, "a value of timestamp 3 to 5");
    assert_eq!(violation.found, r#"{"ev":"emit","at":9,"t":5,"p":1,"of":1}"#);
}

/// Only results that may have come before an output say whose value it can be (D2).
#[test]
fn a_value_is_none_of_a_result_that_came_by_then() {
    let slack = Slack { tolerance: 1, lateness: 2 };
    for (came, rule) in [(11, Rule::D2), (12, Rule::P3)] {
        let trace = [
            r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9,"max_age":2}]}"#.to_owned(),
            r#"{"ev":"open","at":0,"t":5}"#.to_owned(),
            r#"{"ev":"request","at":0,"t":5,"p":1,"due":40}"#.to_owned(),
            r#"{"ev":"emit","at":9,"t":5,"p":1,"of":5}"#.to_owned(),
            format!(r#"{{"ev":"result","at":{came},"t":5,"p":1,"of":3}}"#),
            String::new(),
        ];
        let verdict = observed::judge("a.jsonl", slack, trace.join("\n").as_bytes()).unwrap();
        let [violation] = &verdict.violations[..] else { panic!("{verdict:?}") };
        assert_eq!(violation.rule, rule, "{came}");
    }
}

/// An action that a chunk holds for a later tick breaks D18 at this tick, for either judge.
#[test]
fn action_of_a_later_tick_breaks_d18() {
    let header = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9}]}"#;
    let strict = [
        header,
        r#"{"ev":"open","at":0,"t":5}"#,
        r#"{"ev":"result","at":8,"t":5,"p":0,"for":21}"#,
        r#"{"ev":"emit","at":8,"t":5,"p":0,"for":21}"#,
        "",
    ];
    let verdict = judge("a.jsonl", strict.join("\n").as_bytes()).unwrap();
    let [violation] = &verdict.violations[..] else { panic!("{verdict}") };
    assert_eq!((violation.rule, violation.line), (Rule::D18, 4));

    // Only the emit says it here.
    let observed = strict.map(|line| line.replace(r#""p":0,"for":21}"#, r#""p":0}"#));
    let mut observed = observed.to_vec();
    observed[3] = r#"{"ev":"emit","at":9,"t":5,"p":0,"for":21}"#.to_owned();
    let slack = Slack { tolerance: 1, lateness: 2 };
    let verdict = observed::judge("a.jsonl", slack, observed.join("\n").as_bytes()).unwrap();
    let [violation] = &verdict.violations[..] else { panic!("{verdict:?}") };
    assert_eq!((violation.rule, violation.line), (Rule::D18, 4));
    assert_eq!(violation.expected, "a value that is meant for timestamp 5");
}

/// An emit names the message of the result that was held, and not that of a later result that was
/// dropped (D2, A46).
#[test]
fn d2_emit_has_the_value_that_was_held() {
    for (of, rules) in [(4, vec![]), (3, vec![Rule::D2])] {
        let trace = [
            r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":9,"max_age":3},{"p":2,"limit":9}]}"#,
            r#"{"ev":"open","at":0,"t":5}"#,
            r#"{"ev":"offer","at":0,"t":5,"p":2,"deadline":90,"backlog":0}"#,
            r#"{"ev":"request","at":0,"t":5,"p":2,"due":90}"#,
            r#"{"ev":"offer","at":0,"t":5,"p":1,"deadline":50,"backlog":0}"#,
            r#"{"ev":"request","at":0,"t":5,"p":1,"due":50}"#,
            r#"{"ev":"result","at":5,"t":5,"p":1,"of":4}"#,
            r#"{"ev":"hold","at":5,"t":5,"p":1}"#,
            r#"{"ev":"result","at":6,"t":5,"p":1,"of":3}"#,
            r#"{"ev":"drop","at":6,"t":5,"p":1,"why":"duplicate"}"#,
            r#"{"ev":"tick","at":50}"#,
            r#"{"ev":"timer","at":50,"t":5,"p":1}"#,
            &format!(r#"{{"ev":"emit","at":50,"t":5,"p":1,"of":{of}}}"#),
            r#"{"ev":"cancel","at":50,"t":5,"p":2}"#,
            "",
        ];
        let verdict = judge("a.jsonl", trace.join("\n").as_bytes()).unwrap();
        let found: Vec<Rule> = verdict.violations.iter().map(|it| it.rule).collect();
        assert_eq!(found, rules, "{verdict}");
    }
}

/// A message with its own deadline is reported with its delay and the instant by which it was due.
#[test]
fn j2_says_by_how_much_an_output_is_late() {
    let trace = [
        HEADER,
        r#"{"ev":"open","at":100,"t":5,"within":50,"age":20}"#,
        r#"{"ev":"result","at":140,"t":5,"p":0}"#,
        r#"{"ev":"emit","at":141,"t":5,"p":0}"#,
        "",
    ];
    let slack = Slack { tolerance: 1, lateness: 2 };
    let verdict = observed::judge("a.jsonl", slack, trace.join("\n").as_bytes()).unwrap();
    let [violation] = &verdict.violations[..] else { panic!("{verdict:?}") };
    assert_eq!((violation.rule, violation.late), (Rule::J2, Some(7)));
    assert_eq!(violation.expected, "an output at 134 at the latest: the message's own deadline");
}

/// Lines of two sources may be out of order by the sum of both errors, and no more (A50).
#[test]
fn sources_may_be_out_of_order_by_both_tolerances() {
    let header: Header =
        Events::new("a", format!("{HEADER}\n").as_bytes()).unwrap().header().clone();
    let judged = |before: u64| {
        let slack = Slack { tolerance: 2, lateness: 5 };
        let mut judge = observed::Judge::new("a.jsonl", &header, slack).with_tolerance_of(1, 10);
        judge.line(2, &Event::Input(Input::Tick { at: 100 })).unwrap();
        judge.line(3, &Event::Input(Input::Result { at: 100 - before, t: 1, p: 1 }))
    };
    assert!(judged(12).is_ok());
    let error = judged(13).unwrap_err();
    assert_eq!((error.tolerance, error.greatest), (12, 100));
    // Conversely, a stamp that is too late brings nothing nearer.
    let slack = Slack { tolerance: 2, lateness: 5 };
    let mut judge = observed::Judge::new("a.jsonl", &header, slack).with_tolerance_of(1, 10);
    judge.line(2, &Event::Input(Input::Result { at: 100, t: 1, p: 1 })).unwrap();
    assert!(judge.line(3, &Event::Input(Input::Tick { at: 88 })).is_ok());
    assert!(judge.line(4, &Event::Input(Input::Tick { at: 87 })).is_err());
}
