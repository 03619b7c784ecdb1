//! Tests the observed judge: which rule or promise it names, what it says was allowed, and what it
//! does not judge.

use std::fmt::Write;

use fuseline_traces::corpus;
use fuseline_traces::observed::{Judge, JudgeError, Slack, judge};
use fuseline_traces::{DoubtKind, Events, Rule, Verdict, Violation};
use serde_json::json;

const EXACT: Slack = Slack { tolerance: 0, lateness: 0 };
const LOOSE: Slack = Slack { tolerance: 2, lateness: 5 };

/// Returns a trace whose events are written in a few words: `open 0 1` and so on, with values in
/// the format's order.
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

/// Returns the broken rule of each violation, and the time by which its output was too late.
fn broken(slack: Slack, events: &[&str]) -> Vec<(u64, String, Option<u64>)> {
    let verdict = verdict(slack, events);
    assert_eq!(verdict.conforms, verdict.violations.is_empty() && verdict.doubts.is_empty());
    let reported = |found: Violation| (found.line, found.rule.to_string(), found.late);
    verdict.violations.into_iter().map(reported).collect()
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
            Err(JudgeError::TimeOrderError(disorder)) => {
                // The clock went back (F0).
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
    // Long afterwards no more of it is stored than that it is done.
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
fn p3_best_available() {
    let events =
        ["open 0 1", "request 0 1 1 10", "request 0 1 2 10", "result 3 1 0", "result 4 1 1"];
    is_broken(&[&events[..], &["emit 10 1 0"]].concat(), 7, "P3", None);
    is_broken(&["open 0 1", "request 0 1 1 10", "emit 5 1 1"], 4, "P3", None);
    is_broken(&["open 0 1", "emit 5 1 0", "result 6 1 0"], 3, "P3", None);
}

#[test]
fn f3_holds_while_something_better_is_pending() {
    let events = ["open 0 1", "request 0 1 1 10", "result 3 1 0", "emit 3 1 0", "tick 40"];
    is_broken(&events, 5, "F3", None);
    is_broken(&["open 0 1", "result 3 1 1", "emit 3 1 1"], 4, "F3", None);
}

#[test]
fn p4_p6_p7_delay_of_late_outputs_is_reported() {
    let requested = ["open 0 1", "request 0 1 1 10", "result 3 1 0"];
    is_broken(&[&requested[..], &["emit 17 1 0"]].concat(), 5, "P4", Some(7));
    is_broken(&["open 0 1", "result 3 1 0", "emit 5 1 0"], 4, "P6", Some(2));
    is_broken(&["open 0 1 10", "miss 13 1"], 3, "P7", Some(3));
    let late: Vec<_> = [&requested[..], &["tick 90", "emit 90 1 0"]].concat();
    assert_eq!(broken(LOOSE, &late), [(6, "P4".to_owned(), Some(66))]);
}

#[test]
fn p5_p6_p7_something_comes_out() {
    let requested = ["open 0 1", "request 0 1 1 10", "result 3 1 0"];
    is_broken(&[&requested[..], &["tick 50"]].concat(), 4, "P5", Some(40));
    is_broken(&["open 0 1", "result 3 1 0", "tick 8"], 3, "P6", Some(5));
    is_broken(&["open 0 1 10", "fail 3 1 0", "tick 20"], 3, "P7", Some(17));
    // The timestamp waits for local, and the trace ends before its output is owed.
    assert_eq!(broken(EXACT, &["open 0 1", "request 0 1 1 10", "result 9 1 1", "emit 9 1 1"]), []);
    assert_eq!(broken(LOOSE, &[&requested[..], &["tick 16"]].concat()), []);
}

#[test]
fn f6_misses_only_with_nothing_left() {
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
    // The second open was refused, and the first stands (A42).
    let again = ["open 0 1", "open 3 1", "refuse 3 1 order", "result 4 1 0", "emit 4 1 0"];
    assert_eq!(broken(EXACT, &again), []);
    // The trace records opens, but none of this timestamp (A43).
    let skipped =
        ["open 0 3", "result 1 2 0", "drop 1 2 0 superseded", "result 4 3 0", "emit 4 3 0"];
    assert_eq!(broken(EXACT, &skipped), []);
    let unknown = ["result 1 9 0", "drop 1 9 0 unknown", "open 2 3", "result 4 3 0", "emit 4 3 0"];
    assert_eq!(broken(EXACT, &unknown), []);
}

#[test]
fn unjudged_trace_does_not_conform() {
    let verdict = verdict(LOOSE, &["open 0 1", "tick 50"]);
    assert_eq!((verdict.conforms, verdict.judged, verdict.lines), (false, 0, 3));
    assert_eq!(verdict.violations, []);
}

/// Returns a judge that has read these events.
fn read(slack: Slack, period: Option<u64>, events: &[&str]) -> Judge {
    read_under("eager", slack, period, events)
}

fn read_under(commit: &str, slack: Slack, period: Option<u64>, events: &[&str]) -> Judge {
    let trace = trace(commit, events);
    let mut reader = Events::observed("a.jsonl", trace.as_bytes()).expect("it has a header");
    let mut judge = Judge::new("a.jsonl", reader.header(), slack);
    if let Some(period) = period {
        judge = judge.with_period(period);
    }
    while let Some(event) = reader.next_event().expect("it is well formed") {
        judge.line(reader.line(), &event).expect("it is in order");
    }
    judge
}

#[test]
fn a44_all_but_unbounded_local_is_overdue_at_the_end() {
    let done = ["open 0 1", "result 1 1 0", "emit 1 1 0"];
    let ended = |more: &[&str]| read(LOOSE, None, &[&done[..], more].concat()).finish_ended();
    let requested = ["open 2 2", "request 2 2 1 1000"];
    for (more, judged, unfinished, broken) in [
        (&requested[..], 1, 1, None),
        (&["open 2 2"], 1, 1, None),
        (&["open 2 2", "request 2 2 1 9", "fail 3 2 1"], 1, 1, None),
        (&["open 2 2 900"], 1, 0, Some("P7")),
        (&["open 2 2", "result 3 2 0"], 2, 0, Some("P6")),
        (&["open 2 2", "request 2 2 1 1000", "result 3 2 0"], 2, 0, Some("P5")),
        (&["open 2 2", "fail 3 2 0", "tick 3"], 2, 0, Some("P7")),
        (&["open 2 2", "request 2 2 1 1000", "fail 3 2 0"], 2, 0, Some("P7")),
        // A result that was sent is not such a case, and neither is a refused message.
        (&["open 2 2", "result 3 2 0", "emit 4 2 0"], 2, 0, None),
        (&["open 2 2", "refuse 2 2 full"], 1, 0, None),
    ] {
        let verdict = ended(more);
        assert_eq!((verdict.judged, left_unfinished(&verdict)), (judged, unfinished), "{more:?}");
        let rules: Vec<String> = verdict.violations.iter().map(|it| it.rule.to_string()).collect();
        assert_eq!(rules, broken.into_iter().collect::<Vec<_>>(), "{more:?}");
        // The output never came, so its delay is unknown.
        assert!(verdict.violations.iter().all(|it| it.late.is_none()), "{more:?}");
    }
    let open = read(LOOSE, None, &requested).finish();
    assert_eq!(left_unfinished(&open), 0);
}

/// Returns the number of messages that were open when the run ended.
fn left_unfinished(verdict: &Verdict) -> u64 {
    let mut of_kind = verdict.doubts.iter().filter(|it| it.kind == DoubtKind::Unfinished);
    of_kind.next().map_or(0, |doubt| doubt.count)
}

#[test]
fn j1_gaps_between_opens_and_at_the_end_are_reported() {
    // At most 100 + 5 + 2 · 2 apart.
    let period = |events: &[&str]| {
        let verdict = read(LOOSE, Some(100), events).finish();
        let reported = verdict.violations.iter().filter(|it| it.rule == Rule::J1);
        reported.map(|it| (it.line, it.t, it.late)).collect::<Vec<_>>()
    };
    assert_eq!(period(&["open 50 1", "open 159 2"]), []);
    assert_eq!(period(&["open 50 1", "open 160 2"]), [(3, Some(2), Some(1))]);
    assert_eq!(period(&["open 50 1", "tick 159"]), []);
    assert_eq!(period(&["open 50 1", "tick 160"]), [(3, Some(1), Some(1))]);
    // The lines are out of order within the tolerance, and the time before the first open is no
    // gap.
    assert_eq!(period(&["tick 0", "open 204 2", "open 200 1", "open 309 3", "tick 310"]), []);
    // Only instants count, whatever the timestamps are.
    assert_eq!(period(&["open 50 9", "open 150 2", "open 250 1"]), []);
    // Refused opens end no gap, whether the refusal comes before or after.
    let refused = [(3, Some(2), Some(91)), (7, Some(4), Some(1))];
    let later = ["open 100 1", "open 300 2", "open 350 3", "refuse 350 3 full", "tick 350"];
    assert_eq!(period(&[&later[..], &["open 410 4"]].concat()), refused);
    let sooner = ["open 100 1", "open 300 2", "refuse 350 3 full", "open 350 3", "tick 350"];
    assert_eq!(period(&[&sooner[..], &["open 410 4"]].concat()), refused);
    // Knowing that the run has ended does not move its end (A45).
    let ended =
        read(LOOSE, Some(100), &["open 50 1", "result 50 1 0", "emit 50 1 0"]).finish_ended();
    assert_eq!(ended.violations, []);
    // No timestamp is opened at all.
    assert_eq!(period(&["tick 10", "result 60 1 0", "emit 60 1 0", "tick 119"]), []);
    assert_eq!(
        period(&["tick 10", "result 60 1 0", "emit 60 1 0", "tick 120"]),
        [(5, None, Some(1))]
    );
}

#[test]
fn j1_gap_is_reported_once_certain_with_its_length() {
    let judge = read(LOOSE, Some(100), &["open 0 1", "open 1000 2", "tick 1014"]);
    let [violation] = &judge.so_far().violations[..] else { panic!("{judge:?}") };
    assert_eq!(violation.found, "no open for 1000 ns after the open of timestamp 1 at 0");
    let expected =
        "an open at 109 at the latest: a period, the lateness and twice the tolerance later";
    assert_eq!(violation.expected, expected);
    assert_eq!(violation.story, [r#"3: {"ev":"open","at":1000,"t":2}"#]);
    // At an early end, an output that may still come is not missing.
    let early =
        |end: &str| read(LOOSE, Some(100), &["open 0 1", end]).finish_early().violations.len();
    assert_eq!((early("tick 116"), early("tick 117")), (0, 1));
}

#[test]
fn lines_may_be_out_of_order_by_two_tolerances() {
    let out = |before: u64| {
        let tick = format!("tick {}", 100 - before);
        let trace = trace("eager", &["tick 100", &tick]);
        judge("a.jsonl", LOOSE, trace.as_bytes())
    };
    assert!(out(4).is_ok());
    let error = out(5).expect_err("it is out of order").to_string();
    assert!(error.starts_with("a.jsonl:3:1: the line at 95 follows a line at 100"), "{error}");
}

#[test]
fn a_violation_reports_what_was_allowed_and_the_story() {
    let events = ["open 0 1", "request 0 1 1 10", "hold 3 1 0", "result 3 1 0", "emit 17 1 0"];
    let verdict = verdict(EXACT, &events);
    let violation = &verdict.violations[0];
    assert_eq!(violation.found, r#"{"ev":"emit","at":17,"t":1,"p":0}"#);
    assert_eq!(violation.expected, "emit p 0, at 10 to 10");
    assert_eq!(violation.story.len(), 5);
    let reported = serde_json::to_value(&verdict).unwrap();
    let expected = json!({"line": 6, "t": 1, "rule": "P4", "found": violation.found,
        "expected": violation.expected, "late": 7});
    assert_eq!(reported["violations"][0], expected);
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

/// The timestamp broke a rule before it was opened, so it does not count as waiting for local.
#[test]
fn refused_timestamp_with_output_is_not_unfinished() {
    let trace = concat!(
        "{\"fuseline\":1,\"window\":4,\"clouds\":[]}\n",
        "{\"ev\":\"refuse\",\"at\":22,\"t\":5,\"why\":\"order\"}\n",
        "{\"ev\":\"miss\",\"at\":31,\"t\":5}\n",
        "{\"ev\":\"open\",\"at\":60,\"t\":5}\n",
    );
    let mut events = Events::observed("trace", trace.as_bytes()).unwrap();
    let mut judge = Judge::new("trace", events.header(), EXACT);
    while let Some(event) = events.next_event().unwrap() {
        judge.line(events.line(), &event).unwrap();
    }
    let verdict = judge.finish_ended();
    assert_eq!((verdict.violations.len(), left_unfinished(&verdict)), (1, 0));
}

/// Judges under progressive without tolerance. Returns the line, the rule, the delay and what was
/// expected.
fn progressive(events: &[&str]) -> Option<(u64, String, Option<u64>, String)> {
    let trace = trace("progressive", events);
    let verdict = judge("a.jsonl", EXACT, trace.as_bytes()).expect("it is well formed");
    assert!(verdict.violations.len() < 2, "{:?}", verdict.violations);
    let found = verdict.violations.into_iter().next()?;
    Some((found.line, found.rule.to_string(), found.late, found.expected))
}

/// Checks the violation of two requests, due at 10 and 20, with further events from line 5 on.
fn is_broken_progressively(events: &[&str], line: u64, rule: &str, late: Option<u64>, text: &str) {
    let start = ["open 0 1", "request 0 1 1 10", "request 0 1 2 20"];
    let events = [&start[..], events, &["tick 90"]].concat();
    let found = progressive(&events);
    assert_eq!(found, Some((line, rule.to_owned(), late, text.to_owned())), "{events:?}");
}

#[test]
fn f9_each_better_result_is_an_output() {
    let start = ["open 0 1", "request 0 1 1 10", "request 0 1 2 20", "result 3 1 0", "emit 3 1 0"];
    let better = ["result 5 1 2", "emit 5 1 2"];
    for rest in [
        &[&better[..], &["final 5 1 2"]].concat()[..],
        // A result that is outranked is superseded (A52).
        &[&better[..], &["result 7 1 1", "tick 90"]].concat(),
        &["result 4 1 1", "emit 4 1 1", "final 20 1 1"],
        &["fail 6 1 2", "final 10 1 0"],
        // The trace ends before.
        &["tick 9"],
    ] {
        assert_eq!(progressive(&[&start[..], rest].concat()), None, "{rest:?}");
    }
}

#[test]
fn p1_outputs_rise_and_one_end_follows() {
    let text = "outputs that rise in priority, and a final after them; or one miss alone";
    let local = ["result 3 1 0", "emit 3 1 0"];
    for (rest, line) in [
        (&["emit 4 1 0"][..], 7),
        (&["miss 20 1"], 7),
        (&["final 20 1 0", "final 20 1 0"], 8),
        (&["final 5 1 0", "result 6 1 2", "emit 6 1 2"], 9),
        (&["result 5 1 2", "emit 5 1 2", "result 6 1 1", "emit 6 1 1", "final 6 1 2"], 10),
    ] {
        is_broken_progressively(&[&local[..], rest].concat(), line, "P1", None, text);
    }
    // Long afterwards no more of it is stored than that it is done.
    let again = ["open 0 1", "result 3 1 0", "emit 3 1 0", "tick 900", "final 950 1 0"];
    let text = "nothing more: it was forwarded or missed before".to_owned();
    assert_eq!(progressive(&again), Some((6, "P1".to_owned(), None, text)));
}

#[test]
fn p3_to_p6_late_or_missing_progressive_is_reported() {
    let local = ["result 3 1 0", "emit 3 1 0"];
    let after_local = |rest: &[&'static str]| [&local[..], rest].concat();
    let of_p = |p: u64, at: u64| format!("emit p {p}, at {at} to {at}");
    let late = ["result 3 1 0", "emit 10 1 0", "final 20 1 0"];
    is_broken_progressively(&late, 6, "P4", Some(7), &of_p(0, 3));
    // The judge waits for the output that comes too late, and reports it once.
    let late = after_local(&["result 5 1 2", "tick 50", "emit 51 1 2"]);
    is_broken_progressively(&late, 9, "P4", Some(46), &of_p(2, 5));
    let better = after_local(&["result 5 1 2", "final 20 1 0"]);
    is_broken_progressively(&better, 8, "P3", Some(85), &of_p(2, 5));
    let between = after_local(&["result 4 1 1", "result 5 1 2", "emit 5 1 2"]);
    is_broken_progressively(&between, 9, "P4", Some(86), &of_p(1, 4));
    let passed_over = ["result 3 1 0", "result 5 1 2", "emit 5 1 2"];
    is_broken_progressively(&passed_over, 7, "P5", Some(87), &of_p(0, 3));
    is_broken_progressively(&["result 3 1 0"], 5, "P5", Some(87), &of_p(0, 3));
    is_broken_progressively(&["result 3 1 0", "final 20 1 0"], 6, "P5", Some(87), &of_p(0, 3));
    let several = ["result 3 1 0", "result 4 1 1", "result 5 1 2", "emit 5 1 2"];
    let text = "emit p 0, at 3 to 3; or emit p 1, at 4 to 4";
    is_broken_progressively(&several, 8, "P4", None, text);
    let alone = ["open 0 1", "result 3 1 0", "emit 5 1 0"];
    assert_eq!(progressive(&alone), Some((4, "P6".to_owned(), Some(2), of_p(0, 3))));
}

#[test]
fn what_has_no_explanation_under_progressive_is_named() {
    let local = ["result 3 1 0", "emit 3 1 0"];
    for (rest, line, rule, late, text) in [
        (&["final 5 1 0"][..], 7, "F9", None, "final p 0, at 20 to 20"),
        (&["final 25 1 0"], 7, "F9", Some(5), "final p 0, at 20 to 20"),
        (&["final 20 1 2"], 7, "F9", None, "final p 0, at 20 to 20"),
        (
            &["result 22 1 2", "emit 22 1 2"],
            8,
            "P2",
            Some(2),
            "no output of p 2: its result was due at 20",
        ),
        (&["emit 5 1 2"], 7, "P3", None, "no output of p 2"),
        (&["emit 5 1 2", "result 7 1 2"], 7, "P3", None, "emit p 2, at 7 to 7"),
        (&["fail 4 1 2", "result 5 1 2", "emit 5 1 2"], 9, "F4", None, "no output of p 2"),
        (&["emit 5 1 7"], 7, "P3", None, "no output of p 7"),
    ] {
        is_broken_progressively(&[&local[..], rest].concat(), line, rule, late, text);
    }
    is_broken_progressively(&["fail 3 1 0"], 5, "P7", Some(70), "miss, at 20 to 20");
    is_broken_progressively(&["fail 3 1 0", "miss 10 1"], 6, "F6", None, "miss, at 20 to 20");
    is_broken_progressively(&["result 3 1 0", "miss 20 1"], 6, "F6", None, "emit p 0, at 3 to 3");
    is_broken_progressively(&["final 20 1 0"], 5, "F9", None, "nothing yet of timestamp 1");
    // The last output ended the timestamp.
    let outranked = ["result 3 1 0", "result 3 1 2", "emit 3 1 2", "request 5 1 1 10", "tick 90"];
    let found = progressive(&[&["open 0 1", "request 0 1 2 20"][..], &outranked].concat());
    assert_eq!(found.map(|(_, rule, ..)| rule).as_deref(), Some("F2"));
}

#[test]
fn a44_progressive_final_may_be_missing_at_the_end() {
    let start = ["open 0 1", "request 0 1 2 900", "result 1 1 0", "emit 1 1 0"];
    for (rest, unfinished, broken) in [
        (&[][..], 0, None),
        (&["open 2 2", "request 2 2 1 900"], 1, None),
        (&["result 3 1 2"], 0, Some("P3")),
        (&["fail 3 1 2", "final 4 1 0"], 0, None),
    ] {
        let judge = read_under("progressive", LOOSE, None, &[&start[..], rest].concat());
        let verdict = judge.finish_ended();
        assert_eq!((verdict.judged, left_unfinished(&verdict)), (1, unfinished), "{rest:?}");
        let found = verdict.violations.first().map(|it| (it.rule.id(), it.late));
        // The output never came, so its delay is unknown.
        assert_eq!(found, broken.map(|rule| (rule, None)), "{rest:?}");
    }
}

#[test]
fn f9_no_other_rule_has_a_final() {
    for commit in ["eager", "patient"] {
        let trace = trace(commit, &["open 0 1", "result 3 1 0", "emit 3 1 0", "final 3 1 0"]);
        let verdict = judge("a.jsonl", EXACT, trace.as_bytes()).unwrap();
        let [violation] = &verdict.violations[..] else { panic!("{verdict:?}") };
        assert_eq!((violation.line, violation.rule.id()), (5, "F9"));
        assert_eq!(violation.expected, format!("no final: the rule is {commit}"));
    }
}
