//! Tests what `check` and `report` say about a trace beside their verdict.

use std::fs;

use crate::common::{err, out, run};
use tempfile::tempdir;

/// As several threads record it: requests without offers, decisions without holds and timers.
const RECORDED: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":31}]}
{"ev":"open","at":0,"t":1}
{"ev":"request","at":1000000,"t":1,"p":1,"due":31000000}
{"ev":"result","at":2000000,"t":1,"p":0}
{"ev":"emit","at":31000000,"t":1,"p":0}
"#;

#[test]
fn a_tolerance_that_swallows_deadlines_is_in_doubt() {
    let dir = tempdir().unwrap();
    let (trace, page) = (dir.path().join("run.jsonl"), dir.path().join("page.html"));
    fs::write(&trace, RECORDED).unwrap();
    let (trace, page) = (trace.to_str().unwrap(), page.to_str().unwrap());
    for (tolerance, lateness, is_warned) in [("10ms", "10ms", true), ("1ms", "10ms", false)] {
        let observed = ["--observed", "--tolerance", tolerance, "--lateness", lateness, trace];
        for command in [&["check"][..], &["report", "--force", "-o", page]] {
            let judged = run(&[command, &observed[..]].concat(), "");
            // The cloud answers nothing, either.
            assert_eq!(judged.status.code(), Some(3), "{}", err(&judged));
            let doubt = "coarse: 1 of 1 deadlines are no longer than 30 ms (the lateness plus twice the \
                         tolerance)";
            assert_eq!(out(&judged).contains(doubt), is_warned, "{}", out(&judged));
        }
    }
}

#[test]
fn strictly_an_observed_trace_has_a_remedy() {
    let judged = run(&["check"], RECORDED);
    assert_eq!(judged.status.code(), Some(1));
    assert!(err(&judged).contains("judge it with --observed --tolerance"), "{}", err(&judged));
    let attempt = RECORDED.replace(",\"due\"", ",\"try\":1,\"due\"");
    let refused = run(&["check"], &attempt);
    assert_eq!(refused.status.code(), Some(2));
    assert!(err(&refused).contains("--observed"), "{}", err(&refused));
    let nothing = "{\"fuseline\":1,\"window\":4,\"clouds\":[]}\n{\"ev\":\"tick\",\"at\":1}\n";
    assert_eq!(err(&run(&["check"], nothing)), "");
}
