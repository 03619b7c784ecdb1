//! Tests how the judge reports, counts and continues. The corpus tests which rule it names.

use std::fmt::Write;

use fuseline_traces::{
    Cloud, Commit, Decision, DoubtKind, DropReason, Event, Header, Input, Judge, Rule, Verdict,
    judge,
};
use serde_json::json;

const HEADER: &str = "{\"fuseline\":1,\"window\":4,\"clouds\":[{\"p\":1,\"limit\":31}]}\n";

/// Returns the parsed header.
fn header() -> Header {
    let cloud = Cloud { p: 1, name: None, limit: 31, resume: 30 };
    Header { operator: None, window: 4, commit: Commit::Eager, clouds: vec![cloud] }
}

/// Judges a trace whose events are written in a few words: `open 0 1` and so on, with values in the
/// format's order.
fn verdict(events: &[&str]) -> Verdict {
    let mut trace = HEADER.to_owned();
    for event in events {
        let mut words = event.split(' ');
        let name = words.next().unwrap_or_default();
        let keys = match name {
            "offer" => ["at", "t", "p", "deadline", "backlog"],
            "request" => ["at", "t", "p", "due", ""],
            "miss" | "open" => ["at", "t", "deadline", "", ""],
            "drop" | "refuse" => ["at", "t", "p", "why", ""],
            _ => ["at", "t", "p", "", ""],
        };
        let _ = write!(trace, "{{\"ev\":\"{name}\"");
        for (key, value) in keys.into_iter().zip(words) {
            let quote = if value.parse::<u64>().is_ok() { "" } else { "\"" };
            let _ = write!(trace, ",\"{key}\":{quote}{value}{quote}");
        }
        trace += "}\n";
    }
    judge("a.jsonl", trace.as_bytes()).expect("it is well formed")
}

#[test]
fn verdict_names_rule_found_expected_and_story() {
    let verdict = verdict(&[
        "open 0 7",
        "offer 0 7 1 100 0",
        "request 0 7 1 100",
        "result 100 7 1",
        "emit 100 7 1",
    ]);
    assert_eq!(
        verdict.to_string(),
        "a.jsonl: does not conform; 1 timestamps judged in 6 lines\n\
         a.jsonl:6: timestamp 7 breaks F5: Before an input everything due fires, by due instant, \
         then timestamp; the due instant itself is past; a live timer fires once and not earlier, \
         any other never.\n  \
           found    {\"ev\":\"emit\",\"at\":100,\"t\":7,\"p\":1}\n  \
           expected {\"ev\":\"timer\",\"at\":100,\"t\":7,\"p\":1}\n  \
           | 2: {\"ev\":\"open\",\"at\":0,\"t\":7}\n  \
           | 3: {\"ev\":\"offer\",\"at\":0,\"t\":7,\"p\":1,\"deadline\":100,\"backlog\":0}\n  \
           | 4: {\"ev\":\"request\",\"at\":0,\"t\":7,\"p\":1,\"due\":100}\n  \
           | 5: {\"ev\":\"result\",\"at\":100,\"t\":7,\"p\":1}\n  \
           | 6: {\"ev\":\"emit\",\"at\":100,\"t\":7,\"p\":1}"
    );
}

#[test]
fn a_verdict_in_json_has_the_keys_of_the_format() {
    let verdict = verdict(&["open 0 7", "result 1 7 0"]);
    let json = serde_json::to_value(&verdict).unwrap();
    let violation = json!({
        "line": 3,
        "t": 7,
        "rule": "F3",
        "found": "no decision; the trace ends",
        "expected": "{\"ev\":\"emit\",\"at\":1,\"t\":7,\"p\":0}",
    });
    let expected = json!({
        "file": "a.jsonl", "conforms": false, "judged": 1, "lines": 3, "doubts": [],
        "violations": [violation],
    });
    assert_eq!(json, expected);
}

#[test]
fn missing_decision_is_reported_at_the_line_before() {
    let verdict = verdict(&["open 0 1", "result 1 1 0", "tick 2", "tick 3"]);
    let [violation] = &verdict.violations[..] else { panic!("{verdict}") };
    assert_eq!((violation.line, violation.rule), (3, Rule::F3));
    assert_eq!(violation.found, "no decision; the next input follows");
    assert!(violation.story.iter().all(|line| !line.contains("tick")), "{verdict}");
}

#[test]
fn story_contains_the_tick_that_breaks_a_rule() {
    let verdict = verdict(&["open 0 1 5", "tick 4", "timer 4 1 0"]);
    let [violation] = &verdict.violations[..] else { panic!("{verdict}") };
    assert_eq!(violation.expected, "no decision");
    assert_eq!(violation.story.len(), 3);
    assert!(violation.story[1].contains("tick"), "{verdict}");
}

#[test]
fn after_a_violation_it_goes_on_with_the_next_input() {
    let verdict = verdict(&[
        "open 0 1",
        "result 1 1 0",
        "hold 1 1 0", // it should be emitted
        "miss 1 1",   // and so is this wrong, but reported already
        "open 2 2",
        "result 3 2 0",
        "emit 3 2 0",
        "open 4 3",
        "result 5 3 0",
        "emit 6 3 0", // another one
    ]);
    let reported: Vec<_> =
        verdict.violations.iter().map(|reported| (reported.line, reported.rule)).collect();
    assert_eq!(reported, [(4, Rule::F3), (11, Rule::F0)]);
    assert_eq!(verdict.judged, 3);
}

#[test]
fn extra_decision_breaks_the_rule_that_makes_it() {
    let opened = ["open 0 1", "offer 0 1 1 100 0", "request 0 1 1 100"];
    let cases: [(&[&str], &str, Rule); 14] = [
        (&["open 1 2"], "refuse 1 2 0 queue", Rule::F2g),
        (&["open 1 2"], "refuse 1 2 0 unknown", Rule::F2),
        (&["open 1 2"], "request 1 2 1 9", Rule::F2),
        (&["result 1 1 0", "hold 1 1 0"], "hold 1 1 0", Rule::F3),
        (&["result 1 1 0", "hold 1 1 0"], "drop 1 1 0 late", Rule::F3),
        (&["result 1 1 0", "hold 1 1 0"], "emit 1 1 0", Rule::F3),
        (&["result 1 1 0", "hold 1 1 0"], "miss 1 1", Rule::F6),
        (&["fail 1 1 0"], "hold 1 1 0", Rule::F4),
        (&["fail 1 1 0"], "drop 1 1 0 late", Rule::F4),
        (&["fail 1 1 0"], "emit 1 1 0", Rule::F6),
        (&["fail 1 1 0"], "miss 1 1", Rule::F6),
        (&["tick 1"], "emit 1 1 0", Rule::F6),
        (&["tick 1"], "timer 1 1 1", Rule::F5),
        (&["tick 1"], "cancel 1 1 1", Rule::F7),
    ];
    for (events, extra, rule) in cases {
        let verdict = verdict(&[&opened, events, &[extra]].concat());
        let [violation] = &verdict.violations[..] else { panic!("{extra}: {verdict}") };
        assert_eq!(violation.rule, rule, "{extra}: {verdict}");
        let wanted = if events.len() == 1 { "no decision" } else { "no further decision" };
        assert_eq!(violation.expected, wanted);
    }
}

#[test]
fn a_decision_before_any_input_is_a_violation() {
    let verdict = verdict(&["emit 0 1 0", "open 1 1"]);
    let [violation] = &verdict.violations[..] else { panic!("{verdict}") };
    assert_eq!((violation.line, &*violation.expected), (2, "an input first"));
}

#[test]
fn nothing_judged_is_in_doubt() {
    let verdict = verdict(&[]);
    assert_eq!((verdict.conforms, verdict.judged, verdict.lines), (false, 0, 1));
    let lines = "a.jsonl: no violation found; 0 timestamps judged in 1 lines\n  \
                 unjudged: no timestamp was judged";
    assert_eq!(verdict.to_string(), lines);
    let verdict = verdict.accepting(&[DoubtKind::Unjudged]);
    assert!(verdict.conforms);
    let lines = "a.jsonl: conforms, accepting unjudged; 0 timestamps judged in 1 lines\n  \
                 unjudged: no timestamp was judged";
    assert_eq!(verdict.to_string(), lines);
}

#[test]
fn accepting_excuses_no_violation() {
    let verdict = verdict(&["open 0 7", "result 1 7 0"]).accepting(&DoubtKind::ALL);
    assert_eq!((verdict.conforms, verdict.in_short().as_str()), (false, "does not conform"));
}

#[test]
fn judges_opened_timestamps_with_an_ending_or_result() {
    let verdict = verdict(&[
        "open 0 1", // nothing comes: not judged
        "open 0 2", // a result, forwarded
        "result 1 2 0",
        "emit 1 2 0",
        "open 2 3", // a failure alone, still open
        "offer 2 3 1 100 0",
        "request 2 3 1 102",
        "fail 3 3 0",
        "open 4 4 5", // missed
        "tick 9",
        "timer 9 4 0",
        "miss 9 4",
        "open 10 5", // an offer alone: not judged
        "offer 10 5 1 100 0",
        "request 10 5 1 110",
    ]);
    assert_eq!(verdict.violations, [], "{verdict}");
    assert_eq!(verdict.judged, 3);
}

/// In an ended run, each timer that is left was to fire (A44).
#[test]
fn of_an_ended_run_timers_that_are_left_are_missing() {
    let mut judge = Judge::new("a.jsonl", &header());
    let events = [
        Input::Open { at: 0, t: 1, deadline: None },
        Input::Open { at: 0, t: 2, deadline: Some(7) },
        Input::Open { at: 0, t: 3, deadline: Some(5) },
        Input::Fail { at: 1, t: 1, p: 9 },
    ];
    for (line, input) in (2..).zip(events) {
        judge.line(line, &Event::Input(input));
    }
    let unknown = Decision::Drop { at: 1, t: 1, p: 9, why: DropReason::Unknown };
    judge.line(6, &Event::Decision(unknown));
    let verdict = judge.finish_ended();
    let reported: Vec<_> =
        verdict.violations.iter().map(|it| (it.line, it.t, &*it.expected)).collect();
    let expected = [
        (6, Some(3), r#"{"ev":"timer","at":5,"t":3,"p":0}"#),
        (6, Some(2), r#"{"ev":"timer","at":7,"t":2,"p":0}"#),
    ];
    assert_eq!(reported, expected);
    assert_eq!(verdict.violations[0].found, "no decision; the run has ended");
    assert_eq!((verdict.judged, verdict.doubts[0].count), (2, 1));
    assert!(verdict.to_string().starts_with(
        "a.jsonl: does not conform; 2 timestamps judged in 6 lines\n  \
             unfinished: message 1 was open when the run ended\n"
    ));
}

/// Local may still be computing for a message of which nothing came, so it breaks nothing (A44,
/// P7).
#[test]
fn a44_message_without_a_result_is_unfinished() {
    let mut judge = Judge::new("a.jsonl", &header());
    judge.line(2, &Event::Input(Input::Open { at: 0, t: 1, deadline: None }));
    let verdict = judge.finish_ended();
    assert_eq!(verdict.violations, []);
    let counts: Vec<_> = verdict.doubts.iter().map(|it| (it.kind, it.count)).collect();
    assert!(counts.contains(&(DoubtKind::Unfinished, 1)), "{counts:?}");
}

/// A judge's memory is bounded, whatever the trace's length.
#[test]
fn a_story_looks_so_many_lines_back_and_no_further() {
    for (between, lines) in [(16 * 1024 - 2, 2), (16 * 1024 - 1, 1)] {
        let mut events = vec!["open 0 1"];
        events.extend(std::iter::repeat_n("tick 0", between));
        events.push("fail 1 1 9");
        let verdict = verdict(&events);
        assert_eq!(verdict.violations.len(), 1);
        assert_eq!(verdict.violations[0].story.len(), lines, "{between} lines between");
    }
}

#[test]
fn violations_beyond_a_hundred_are_counted() {
    let events: Vec<String> =
        (0..150).flat_map(|t| [format!("open 0 {t}"), format!("result 0 {t} 0")]).collect();
    let events: Vec<&str> = events.iter().map(String::as_str).collect();
    let verdict = verdict(&events);
    assert_eq!((verdict.violations.len(), verdict.more), (100, 50));
    assert!(verdict.to_string().ends_with("\n50 more violations"));
    assert_eq!(serde_json::to_value(&verdict).unwrap()["more"], 50);
}

#[test]
fn a_long_story_reports_its_last_lines() {
    let mut events = vec!["open 0 1", "offer 0 1 1 100 0", "request 0 1 1 100"];
    let drops: Vec<_> = (0..20).map(|_| "fail 1 1 9").collect();
    events.extend(&drops);
    let verdict = verdict(&events);
    let story = &verdict.violations.last().expect("a drop is missing").story;
    assert_eq!(story.len(), 13);
    assert_eq!((&story[0][..3], &*story[1]), ("2: ", "(11 lines left out)"));
    assert!(story[12].starts_with("24: "));
}
