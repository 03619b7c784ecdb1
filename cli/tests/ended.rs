//! `fuseline check` and `fuseline report` where more is known of a run than its trace: that it has
//! ended, its period.

use std::fs;

use crate::common::{OBSERVED, err, fuseline, out, run};
use serde_json::Value;
use tempfile::tempdir;

/// The operator hangs over its second message: local's result is held, and the cloud's timer is
/// never served.
const HANG: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":31}]}
{"ev":"open","at":0,"t":0}
{"ev":"result","at":3000000,"t":0,"p":0}
{"ev":"emit","at":3000000,"t":0,"p":0}
{"ev":"open","at":100000000,"t":1}
{"ev":"request","at":100000000,"t":1,"p":1,"due":140000000}
{"ev":"result","at":103000000,"t":1,"p":0}
"#;

fn observed(more: &[&str], trace: &str) -> (Option<i32>, String) {
    let checked = run(&[&OBSERVED[..], more].concat(), trace);
    (checked.status.code(), format!("{}{}", out(&checked), err(&checked)))
}

/// A44.
#[test]
fn a_hang_conforms_until_it_is_known_that_the_run_has_ended() {
    assert_eq!(observed(&[], HANG).0, Some(0));
    let (code, printed) = observed(&["--ended"], HANG);
    assert_eq!(code, Some(1));
    for part in ["stdin:7: timestamp 1 breaks P5\n", "2 timestamps judged in 7 lines\n"] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
    assert!(!printed.contains("late by"), "{printed}");
    // A last tick says the same, and how late it is by then.
    let (code, printed) = observed(&[], &format!("{HANG}{{\"ev\":\"tick\",\"at\":200000000}}\n"));
    assert_eq!((code, printed.contains("breaks P5\n")), (Some(1), true), "{printed}");
}

/// A44, P7.
#[test]
fn what_only_waits_for_local_is_unfinished_and_not_judged() {
    let hang: String = HANG.split_inclusive('\n').take(6).collect();
    let (code, printed) = observed(&["--ended"], &hang);
    let line = "stdin: no violation found, 1 timestamp judged in 6 lines; in doubt: 1 unfinished\n";
    assert_eq!((code, printed.starts_with(line)), (Some(3), true), "{printed}");
    let (_, printed) = observed(&["--ended", "--json"], &hang);
    let printed: Value = serde_json::from_str(&printed).unwrap();
    let (judged, doubt) = (&printed["judged"], &printed["doubts"][0]);
    assert_eq!(
        (judged, &doubt["kind"], &doubt["count"]),
        (&1.into(), &"unfinished".into(), &1.into())
    );
}

/// A44: strictly the timers that are left are missing.
#[test]
fn a_hang_is_seen_strictly_too() {
    let inputs: String = HANG
        .replace("\"request\"", "\"offer\"")
        .replace("\"due\":140000000", "\"deadline\":40000000,\"backlog\":0");
    let trace = out(&run(&["replay"], &inputs)).to_owned();
    let checked = run(&["check"], &trace);
    assert_eq!(checked.status.code(), Some(0), "{}", out(&checked));
    let checked = run(&["check", "--ended"], &trace);
    assert_eq!(checked.status.code(), Some(1), "{}", out(&checked));
    for part in [
        "timestamp 1 breaks F5\n",
        "  found     no decision; the run has ended\n",
        "  expected  {\"ev\":\"timer\",\"at\":140000000,\"t\":1,\"p\":1}\n",
    ] {
        assert!(out(&checked).contains(part), "{part} is not in\n{}", out(&checked));
    }
}

/// J1.
#[test]
fn gaps_between_opens_are_reported_where_a_period_is() {
    let answered = format!("{HANG}{{\"ev\":\"emit\",\"at\":140000000,\"t\":1,\"p\":0}}\n");
    assert_eq!(observed(&["--period", "93ms"], &answered).0, Some(0));
    let (code, printed) = observed(&["--period", "92ms"], &answered);
    assert_eq!(code, Some(1));
    for part in [
        "stdin:5: timestamp 1 breaks J1\n",
        "  found     no open for 100000000 ns after the open of timestamp 0 at 0\n",
        "  late by   1ms\n",
        "does not conform (1 violation), 2 timestamps judged in 8 lines\n",
    ] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
    // And at the end, which --ended does not move.
    assert_eq!(observed(&["--period", "93ms", "--ended"], &answered).0, Some(0));
    let idle = format!("{answered}{{\"ev\":\"tick\",\"at\":200000001}}\n");
    let (code, printed) = observed(&["--period", "93ms"], &idle);
    assert_eq!(
        (code, printed.contains("stdin:9: timestamp 1 breaks J1\n")),
        (Some(1), true),
        "{printed}"
    );
}

#[test]
fn files_for_other_tools_and_the_page_report_both() {
    let dir = tempdir().unwrap();
    let hang: String = HANG.split_inclusive('\n').take(6).collect();
    fs::write(dir.path().join("t.jsonl"), hang).unwrap();
    let options = [&OBSERVED[1..], &["--ended", "--period", "50ms", "t.jsonl"]].concat();
    let files = ["check", "--sarif", "t.sarif", "--junit", "t.xml"];
    for command in [&files[..], &["report", "-o", "t.html"]] {
        let args = [command, &options].concat();
        let ran = fuseline(&args).current_dir(dir.path()).output().unwrap();
        assert_eq!(ran.status.code(), Some(1), "{}", err(&ran));
        assert!(out(&ran).contains("1 unfinished"), "{}", out(&ran));
    }
    let read = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap();
    let sarif: Value = serde_json::from_str(&read("t.sarif")).unwrap();
    assert_eq!(sarif["runs"][0]["results"][0]["ruleId"], "J1");
    for (name, part) in [
        ("t.xml", "breaks J1"),
        ("t.xml", "1 unfinished"),
        ("t.html", "\"kind\":\"unfinished\",\"count\":1"),
        ("t.html", "\"J1\""),
    ] {
        assert!(read(name).contains(part), "{part} is not in {name}");
    }
}

#[test]
fn options_that_contradict_each_other_are_refused() {
    for (args, expected) in [
        (&["check", "--ended", "--truncated"][..], "--truncated"),
        (&["check", "--ended", "--follow", "t.jsonl"], "--follow"),
        (&["check", "--period", "10ms"], "--observed"),
        (&["check", "--observed", "--period", "10"], "--period"),
    ] {
        let refused = run(args, HANG);
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert_eq!((err(&refused).lines().count(), out(&refused)), (1, ""), "{args:?}");
        assert!(err(&refused).contains(expected), "{args:?}: {}", err(&refused));
    }
}
