//! The observed judge: which rule or promise it names, what it says was allowed, and what it does not judge.

use std::fmt::Write;

use fuseline_traces::corpus;
use fuseline_traces::observed::{JudgeError, Slack, Verdict, judge};
use serde_json::json;

const EXACT: Slack = Slack { tolerance: 0, lateness: 0 };
const LOOSE: Slack = Slack { tolerance: 2, lateness: 5 };

/// A trace whose events are told in a few words: `open 0 1` and so on, values in the format's order.
fn trace(commit: &str, events: &[&str]) -> String {
    let mut trace = format!(
        "{{\"fuseline\":1,\"window\":4,\"commit\":\"{commit}\",\"clouds\":[{{\"p\":1,\"limit\":9}},{{\"p\":2,\"limit\":9}}]}}\n"
    );
    for event in events {
        let mut words = event.split(' ');
        let name = words.next().unwrap_or_default();
        let keys = match name {
            "ask" => ["at", "t", "p", "deadline"],
            "request" => ["at", "t", "p", "due"],
            "miss" | "open" => ["at", "t", "deadline", ""],
            "refuse" => ["at", "t", "why", ""],
            "drop" => ["at", "t", "p", "why"],
            _ => ["at", "t", "p", ""],
        };
        let name = if name == "ask" { "request" } else { name };
        let _ = write!(trace, "{{\"ev\":\"{name}\"");
        for (key, value) in keys.into_iter().zip(words) {
            let quote = if value.parse::<u64>().is_ok() { "" } else { "\"" };
            let _ = write!(trace, ",\"{key}\":{quote}{value}{quote}");
        }
        trace += "}\n";
    }
    trace
}

fn verdict(slack: Slack, events: &[&str]) -> Verdict {
    judge("a.jsonl", slack, trace("eager", events).as_bytes()).expect("it is well formed")
}

/// The rule broken and by how much it came too late, of each violation.
fn broken(slack: Slack, events: &[&str]) -> Vec<(u64, String, Option<u64>)> {
    let verdict = verdict(slack, events);
    assert_eq!(verdict.conforms, verdict.violations.is_empty());
    let told = |found: fuseline_traces::observed::Violation| {
        (found.line, found.rule.to_string(), found.late)
    };
    verdict.violations.into_iter().map(told).collect()
}

fn is_broken(events: &[&str], line: u64, rule: &str, late: Option<u64>) {
    assert_eq!(broken(EXACT, events), [(line, rule.to_owned(), late)], "{events:?}");
}

#[test]
fn the_traces_of_the_corpus_conform_in_this_mode_too() {
    let slack = Slack { tolerance: 0, lateness: 2000 };
    let mut judged = 0;
    for case in corpus::CASES {
        match judge(case.name, slack, case.trace.as_bytes()) {
            Ok(verdict) => {
                assert_eq!(verdict.violations, [], "{}", case.name);
                judged += verdict.judged;
            }
            Err(JudgeError::Disorder(disorder)) => {
                // F0: the clock went back.
                assert!(disorder.at < disorder.greatest, "{}", case.name);
            }
            Err(JudgeError::Read(error)) => panic!("{error}"),
        }
    }
    assert!(judged > 100, "{judged} timestamps were judged");
}

#[test]
fn p1_once() {
    let start = ["open 0 1", "result 5 1 0", "emit 5 1 0"];
    is_broken(&[&start[..], &["emit 6 1 0"]].concat(), 5, "P1", None);
    is_broken(&[&start[..], &["miss 5 1"]].concat(), 5, "P1", None);
    // Long after nothing more of it is held.
    is_broken(&[&start[..], &["tick 900", "emit 950 1 0"]].concat(), 6, "P1", None);
}

#[test]
fn p2_never_late() {
    let events = ["open 0 1", "ask 0 1 1 10", "result 12 1 1", "emit 12 1 1"];
    is_broken(&events, 5, "P2", Some(2));
    assert_eq!(broken(LOOSE, &events), [], "it may have been in time");
    is_broken(&["open 0 1 10", "result 12 1 0", "emit 12 1 0"], 4, "P2", Some(2));
}

#[test]
fn p3_best_in_hand() {
    let events =
        ["open 0 1", "request 0 1 1 10", "request 0 1 2 10", "result 3 1 0", "result 4 1 1"];
    is_broken(&[&events[..], &["emit 10 1 0"]].concat(), 7, "P3", None);
    is_broken(&["open 0 1", "request 0 1 1 10", "emit 5 1 1"], 4, "P3", None);
    is_broken(&["open 0 1", "emit 5 1 0", "result 6 1 0"], 3, "P3", None);
}

#[test]
fn f3_nothing_goes_while_something_pending_outranks_it() {
    let events = ["open 0 1", "request 0 1 1 10", "result 3 1 0", "emit 3 1 0", "tick 40"];
    is_broken(&events, 5, "F3", None);
    is_broken(&["open 0 1", "result 3 1 1", "emit 3 1 1"], 4, "F3", None);
}

#[test]
fn p4_p6_p7_what_comes_too_late_is_told_by_how_much() {
    let asked = ["open 0 1", "request 0 1 1 10", "result 3 1 0"];
    is_broken(&[&asked[..], &["emit 17 1 0"]].concat(), 5, "P4", Some(7));
    is_broken(&["open 0 1", "result 3 1 0", "emit 5 1 0"], 4, "P6", Some(2));
    is_broken(&["open 0 1 10", "miss 13 1"], 3, "P7", Some(3));
    let late: Vec<_> = [&asked[..], &["tick 90", "emit 90 1 0"]].concat();
    assert_eq!(broken(LOOSE, &late), [(6, "P4".to_owned(), Some(66))]);
}

#[test]
fn p5_p6_p7_something_comes_out() {
    let asked = ["open 0 1", "request 0 1 1 10", "result 3 1 0"];
    is_broken(&[&asked[..], &["tick 50"]].concat(), 4, "P5", Some(40));
    is_broken(&["open 0 1", "result 3 1 0", "tick 8"], 3, "P6", Some(5));
    is_broken(&["open 0 1 10", "fail 3 1 0", "tick 20"], 3, "P7", Some(17));
    // It waits for local; it ends before it must come out.
    assert_eq!(broken(EXACT, &["open 0 1", "request 0 1 1 10", "result 9 1 1", "emit 9 1 1"]), []);
    assert_eq!(broken(LOOSE, &[&asked[..], &["tick 16"]].concat()), []);
}

#[test]
fn f6_nothing_is_missed_with_something_in_hand_or_pending() {
    let events = ["open 0 1", "request 0 1 1 10", "result 3 1 0", "miss 10 1"];
    is_broken(&events, 5, "F6", None);
    is_broken(&["open 0 1 10", "miss 5 1"], 3, "F6", None);
}

#[test]
fn f4_a_failure_closes_its_request() {
    let events =
        ["open 0 1", "request 0 1 1 10", "fail 3 1 1", "result 4 1 1", "emit 4 1 1", "tick 50"];
    is_broken(&events, 6, "F4", None);
}

#[test]
fn f1_f2_what_contradicts_itself_is_named() {
    is_broken(&["open 0 1", "open 3 1", "result 4 1 0", "emit 4 1 0"], 3, "F1", None);
    let twice = ["open 0 1", "request 0 1 1 9", "request 1 1 1 9", "result 2 1 1", "emit 2 1 1"];
    is_broken(&twice, 6, "F2", None);
    is_broken(&["open 0 1", "request 0 1 7 9", "result 2 1 0", "emit 2 1 0"], 3, "F2", None);
    let retired = ["open 0 1", "result 2 1 0", "emit 2 1 0", "request 3 1 1 9", "tick 90"];
    is_broken(&retired, 5, "F2", None);
    let long_ago =
        ["open 0 1", "result 2 1 0", "emit 2 1 0", "tick 90", "request 93 1 1 99", "tick 500"];
    is_broken(&long_ago, 6, "F2", None);
}

#[test]
fn what_was_refused_or_skipped_is_not_judged() {
    let refused = ["open 0 1", "refuse 0 1 full", "result 3 1 0", "open 2 2", "result 4 2 0"];
    let events = [&refused[..], &["emit 4 2 0", "tick 50"]].concat();
    let verdict = verdict(LOOSE, &events);
    assert_eq!((verdict.conforms, verdict.judged), (true, 1));
    let out = [&refused[..3], &["emit 3 1 0"]].concat();
    is_broken(&out, 5, "F1", None);
    // A42: the second open was refused, the first stands.
    let again = ["open 0 1", "open 3 1", "refuse 3 1 order", "result 4 1 0", "emit 4 1 0"];
    assert_eq!(broken(EXACT, &again), []);
    // A43: the trace records opens, and none of this.
    let skipped =
        ["open 0 3", "result 1 2 0", "drop 1 2 0 superseded", "result 4 3 0", "emit 4 3 0"];
    assert_eq!(broken(EXACT, &skipped), []);
    let unknown = ["result 1 9 0", "drop 1 9 0 unknown", "open 2 3", "result 4 3 0", "emit 4 3 0"];
    assert_eq!(broken(EXACT, &unknown), []);
}

#[test]
fn a_trace_of_which_nothing_was_judged_does_not_conform() {
    let verdict = verdict(LOOSE, &["open 0 1", "tick 50"]);
    assert_eq!((verdict.conforms, verdict.judged, verdict.lines), (false, 0, 3));
    assert_eq!(verdict.violations, []);
}

#[test]
fn lines_are_out_of_order_by_twice_the_tolerance_at_most() {
    let out = |before: u64| {
        let tick = format!("tick {}", 100 - before);
        let trace = trace("eager", &["tick 100", &tick]);
        judge("a.jsonl", LOOSE, trace.as_bytes())
    };
    assert!(out(4).is_ok());
    let error = out(5).expect_err("it is out of order").to_string();
    assert!(error.starts_with("a.jsonl:3:1: at 95 after a line at 100"), "{error}");
}

#[test]
fn a_violation_tells_what_was_allowed_and_the_story() {
    let events = ["open 0 1", "request 0 1 1 10", "hold 3 1 0", "result 3 1 0", "emit 17 1 0"];
    let verdict = verdict(EXACT, &events);
    let violation = &verdict.violations[0];
    assert_eq!(violation.found, r#"{"ev":"emit","at":17,"t":1,"p":0}"#);
    assert_eq!(violation.expected, "emit p 0, at 10 to 10");
    assert_eq!(violation.story.len(), 5);
    let told = serde_json::to_value(&verdict).unwrap();
    let expected = json!({"line": 6, "t": 1, "rule": "P4", "found": violation.found,
        "expected": violation.expected, "late": 7});
    assert_eq!(told["violations"][0], expected);
}

#[test]
fn the_commit_rule_of_the_header_counts() {
    let events = [
        "open 0 1",
        "request 0 1 1 10",
        "request 0 1 2 20",
        "result 3 1 0",
        "emit 10 1 0",
        "tick 90",
    ];
    for (commit, violations) in [("eager", 0), ("patient", 1)] {
        let verdict = judge("a.jsonl", EXACT, trace(commit, &events).as_bytes()).unwrap();
        assert_eq!(verdict.violations.len(), violations, "{commit}");
    }
}
