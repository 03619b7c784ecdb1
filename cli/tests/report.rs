//! `fuseline report`, run as a user runs it. What the page does with its data is tried by `.ci/report`.

#[expect(dead_code, reason = "no test here presses Ctrl-C")]
mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{err, out, run};
use serde_json::Value;
use tempfile::TempDir;

fn corpus(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus").join(name)
}

/// The page of these traces, and how the command ended.
fn page(dir: &TempDir, traces: &[&Path], more: &[&str]) -> (String, Option<i32>) {
    let path = dir.path().join("report.html");
    let mut args = vec!["report", "-o", path.to_str().unwrap()];
    args.extend(more);
    args.extend(traces.iter().map(|trace| trace.to_str().unwrap()));
    let done = run(&args, "");
    assert_eq!(err(&done), "");
    (fs::read_to_string(path).unwrap(), done.status.code())
}

/// The element that holds the data.
fn element(page: &str) -> &str {
    let (_, rest) = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap();
    rest.split_once("</script>").unwrap().0
}

fn data(page: &str) -> Value {
    serde_json::from_str(element(page)).unwrap()
}

/// The sums of a column of differences.
fn sums(column: &Value) -> Vec<i64> {
    let sum = |sum: &mut i64, step: &Value| {
        *sum += step.as_i64()?;
        Some(*sum)
    };
    column.as_array().unwrap().iter().scan(0, sum).collect()
}

#[test]
fn a_page_holds_its_trace_in_columns() {
    let dir = tempfile::tempdir().unwrap();
    let trace = corpus("f5-due-order-then-timestamp.jsonl");
    let (page, code) = page(&dir, &[&trace], &[]);
    let told = &data(&page)[0];
    assert_eq!((code, &told["conforms"]), (Some(0), &Value::Bool(true)));
    let text = fs::read_to_string(&trace).unwrap();
    let events: Vec<Value> =
        text.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(told["lines"], events.len() + 1);
    let (timestamps, at, t) = (sums(&told["timestamps"]), sums(&told["at"]), sums(&told["t"]));
    let origin = told["origin"].as_i64().unwrap();
    for (i, event) in events.iter().enumerate() {
        assert_eq!(event["at"], at[i] + origin, "{event}");
        if event["ev"] != "tick" {
            assert_eq!(event["t"], timestamps[usize::try_from(t[i]).unwrap()], "{event}");
        }
        let source = told["p"][i].as_u64().unwrap().checked_sub(1);
        let source = source.map(|place| &told["sources"][usize::try_from(place).unwrap()]["p"]);
        assert_eq!(event.get("p"), source, "{event}");
    }
    let letters: String =
        events.iter().map(|event| letter(event["ev"].as_str().unwrap())).collect();
    assert_eq!(told["ev"], letters);
}

fn letter(ev: &str) -> char {
    match ev {
        "offer" => 'f',
        "fail" => 'x',
        "tick" => '.',
        "refuse" => 'n',
        "request" => 'q',
        other => other.chars().next().unwrap(),
    }
}

#[test]
fn a_violation_stands_in_the_page_with_its_rule() {
    let dir = tempfile::tempdir().unwrap();
    let good = corpus("f3-forwarded-at-once.jsonl");
    let bad = corpus("bad/f3-first-response-wins.jsonl");
    let (page, code) = page(&dir, &[&good, &bad], &[]);
    assert_eq!(code, Some(1));
    let told = data(&page);
    assert_eq!(told.as_array().unwrap().len(), 2);
    let violation = &told[1]["violations"][0];
    assert_eq!((&violation["line"], &violation["rule"]), (&8.into(), &"F3".into()));
    let sentence = violation["sentence"].as_str().unwrap();
    assert!(sentence.starts_with("A result is dropped for the first of"), "{sentence}");
    assert_eq!((&violation["t"], sums(&told[1]["timestamps"])), (&0.into(), vec![1]));
}

#[test]
fn a_page_is_small_and_asks_for_nothing_from_outside() {
    let dir = tempfile::tempdir().unwrap();
    let (page, _) = page(&dir, &[&corpus("f3-forwarded-at-once.jsonl")], &[]);
    assert!(page.len() < 160 * 1024, "{} bytes", page.len());
    for address in ["http:", "https:", "src=", "@import", "url("] {
        assert!(!page.contains(address), "{address}");
    }
    assert!(page.contains("default-src 'none'"));
    assert!(page.contains("The MIT License"));
    assert!(!page.contains("@@"));
}

#[test]
fn names_cannot_break_out_of_the_data() {
    let dir = tempfile::tempdir().unwrap();
    let name = "</script><script>alert(1)</script><!--\u{2028}@@data@@";
    let trace = dir.path().join("hostile.jsonl");
    let quoted = serde_json::to_string(name).unwrap();
    let header = format!(
        r#"{{"fuseline":1,"operator":{quoted},"window":1,"clouds":[{{"p":1,"name":{quoted},"limit":1}}]}}"#
    );
    fs::write(&trace, header + "\n").unwrap();
    let (page, code) = page(&dir, &[&trace], &[]);
    assert_eq!(code, Some(0));
    assert!(!element(&page).contains('<'));
    let told = data(&page);
    assert_eq!(told[0]["operator"], name);
    assert_eq!(told[0]["sources"][1]["name"], name);
    assert_eq!(page.matches("<script").count(), 2);
}

#[test]
fn numbers_that_a_script_cannot_hold_are_texts() {
    let dir = tempfile::tempdir().unwrap();
    let trace = dir.path().join("great.jsonl");
    fs::write(
        &trace,
        "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n\
         {\"ev\":\"open\",\"at\":18446744073709551600,\"t\":18446744073709551615}\n\
         {\"ev\":\"result\",\"at\":18446744073709551603,\"t\":18446744073709551615,\"p\":0}\n\
         {\"ev\":\"emit\",\"at\":18446744073709551603,\"t\":18446744073709551615,\"p\":0}\n",
    )
    .unwrap();
    let (page, code) = page(&dir, &[&trace], &[]);
    assert_eq!(code, Some(0));
    let told = &data(&page)[0];
    assert_eq!(told["timestamps"][0], "18446744073709551615");
    assert_eq!(told["origin"], "18446744073709551600");
    assert_eq!(sums(&told["at"]), [0, 3, 3]);
}

#[test]
fn a_trace_is_judged_as_observed_if_wanted() {
    let dir = tempfile::tempdir().unwrap();
    let trace = corpus("bad/f3-first-response-wins.jsonl");
    let slack = ["--observed", "--tolerance", "2ms", "--lateness", "5ms"];
    let (page, _) = page(&dir, &[&trace], &slack);
    assert_eq!(data(&page)[0]["observed"], serde_json::json!([2_000_000, 5_000_000]));
}

#[test]
fn without_a_readable_trace_there_is_no_page() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("report.html");
    let path = output.to_str().unwrap();
    let bad = run(&["report", "-", "-o", path], "{\"fuseline\":1}\n");
    assert_eq!((bad.status.code(), out(&bad)), (Some(2), ""));
    assert!(err(&bad).starts_with("error: stdin:1:"), "{}", err(&bad));
    assert_eq!(err(&bad).lines().count(), 1);
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    let nowhere = run(&["report", "-", "-o", dir.path().to_str().unwrap()], header);
    assert_eq!(nowhere.status.code(), Some(2));
    assert_eq!(fs::read_dir(&dir).unwrap().count(), 0);
}
