//! A part of a trace: `--from`, `--to` and `--timestamps`.

use std::fmt::Write as _;
use std::fs;

use crate::common::{err, out, run};
use serde_json::Value;
use tempfile::tempdir;

const MESSAGES: u64 = 300;

/// A trace of messages 100 ms apart, each forwarded at once but each third, which stays without its
/// emit.
fn trace() -> String {
    let mut trace = "{\"fuseline\":1,\"window\":16,\"clouds\":[]}\n".to_owned();
    for t in 0..MESSAGES {
        let at = 1_000_000_000 + t * 100_000_000;
        writeln!(trace, "{{\"ev\":\"open\",\"at\":{at},\"t\":{t}}}").unwrap();
        writeln!(trace, "{{\"ev\":\"result\",\"at\":{at},\"t\":{t},\"p\":0}}").unwrap();
        if t % 3 > 0 {
            writeln!(trace, "{{\"ev\":\"emit\",\"at\":{at},\"t\":{t},\"p\":0}}").unwrap();
        }
    }
    trace
}

fn verdict(args: &[&str]) -> Value {
    let done = run(&[&["check", "--json"], args].concat(), &trace());
    serde_json::from_str(out(&done)).unwrap_or_else(|_| panic!("{args:?}: {}", err(&done)))
}

#[test]
fn a_verdict_on_a_part_lists_its_violations_however_many_came_before() {
    let whole = verdict(&[]);
    assert_eq!((&whole["judged"], &whole["conforms"]), (&MESSAGES.into(), &false.into()));
    // 100 violations: those of the last messages would not be listed if the first ones took their
    // place.
    let last = verdict(&["--timestamps", "291.."]);
    let found: Vec<u64> = last["violations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|violation| violation["t"].as_u64().unwrap())
        .collect();
    assert_eq!((&last["judged"], &found[..]), (&9.into(), &[291, 294, 297][..]));
    assert_eq!(last["lines"], whole["lines"]);
    let second = verdict(&["--from", "1s", "--to", "2s"]);
    let found: Vec<&Value> =
        second["violations"].as_array().unwrap().iter().map(|violation| &violation["t"]).collect();
    assert_eq!((&second["judged"], found), (&10.into(), vec![&12.into(), &15.into(), &18.into()]));
    let none = verdict(&["--from", "100ms", "--to", "300ms"]);
    assert_eq!((&none["judged"], &none["conforms"]), (&2.into(), &true.into()));
    let observed =
        verdict(&["--observed", "--tolerance", "0ns", "--lateness", "1ms", "--timestamps", "5..6"]);
    assert_eq!(
        (&observed["judged"], observed["violations"].as_array().unwrap().len()),
        (&2.into(), 1)
    );
}

#[test]
fn a_page_and_an_export_hold_the_part_alone() {
    let dir = tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (input, page, viewer) = (path("trace.jsonl"), path("page.html"), path("viewer.json"));
    fs::write(&input, trace()).unwrap();
    let part = ["--timestamps", "12..13", &input, "-o"];
    let done = run(&[&["report"], &part[..], &[&page]].concat(), "");
    assert_eq!(done.status.code(), Some(1), "{}", err(&done));
    let page = fs::read_to_string(page).unwrap();
    let data = page.split("id=\"data\">").nth(1).unwrap().split("</script>").next().unwrap();
    let data: Value = serde_json::from_str(data).unwrap();
    let trace = &data["traces"][0];
    assert_eq!((&trace["ev"], &trace["account"]["messages"]), (&"orore".into(), &2.into()));
    // The number is that of the whole file: 2 + 12 × 3 − 4 missing emits come before.
    assert_eq!(trace["line"], serde_json::json!([34, 1, 1, 1, 1]));
    assert_eq!(trace["violations"][0]["line"], 35);
    let done = run(&[&["export", "--perfetto"], &part[..], &[&viewer]].concat(), "");
    assert_eq!(done.status.code(), Some(0), "{}", err(&done));
    let viewer = fs::read_to_string(viewer).unwrap();
    assert!(viewer.contains("\"t\":12") && !viewer.contains("\"t\":14"), "{viewer}");
}

#[test]
fn what_is_no_part_is_refused() {
    for args in [
        ["--from", "soon"],
        ["--to", "-1s"],
        ["--timestamps", "6..5"],
        ["--timestamps", "a.."],
        ["--timestamps", ""],
    ] {
        let done = run(&[&["check"], &args[..]].concat(), &trace());
        assert_eq!(done.status.code(), Some(2), "{args:?}");
        assert_eq!(err(&done).lines().count(), 1, "{}", err(&done));
    }
}

#[test]
fn a_part_that_no_message_can_be_in_is_refused() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("t.jsonl");
    fs::write(&path, trace()).unwrap();
    let path = path.to_str().unwrap();
    let page = folder.path().join("out");
    let output = ["-o", page.to_str().unwrap()];
    for command in [&["check"][..], &["report"], &["export", "--perfetto"]] {
        let output = if command == ["check"] { &[][..] } else { &output };
        for (from, to) in [("2s", "1s"), ("1s", "1s")] {
            let args = [command, &["--from", from, "--to", to, path], output].concat();
            let done = run(&args, "");
            let expected = format!(
                "error: --from {from} is not before --to {to}: no message begins between them\n"
            );
            assert_eq!((done.status.code(), err(&done)), (Some(2), &*expected), "{args:?}");
            assert!(!page.exists(), "{args:?}");
        }
    }
}
