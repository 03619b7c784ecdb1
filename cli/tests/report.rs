//! `fuseline report`, run as a user runs it. What the page does with its data is tried by
//! `.ci/run report`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};
use serde_json::Value;
use tempfile::TempDir;

fn corpus(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus").join(name)
}

/// The page of these traces, and how the command ended.
fn page(dir: &TempDir, traces: &[&Path], more: &[&str]) -> (String, Option<i32>) {
    let path = dir.path().join("report.html");
    let mut args = vec!["report", "--force", "-o", path.to_str().unwrap()];
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

/// D11.
#[test]
fn a_page_holds_its_trace_in_columns() {
    let dir = tempfile::tempdir().unwrap();
    let trace = corpus("f5-due-order-then-timestamp.jsonl");
    let (page, code) = page(&dir, &[&trace], &[]);
    let printed = &data(&page)["traces"][0];
    assert_eq!((code, &printed["conforms"]), (Some(0), &Value::Bool(true)));
    let text = fs::read_to_string(&trace).unwrap();
    let events: Vec<Value> =
        text.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(printed["lines"], events.len() + 1);
    let (timestamps, at, t) =
        (sums(&printed["timestamps"]), sums(&printed["at"]), sums(&printed["t"]));
    let origin = printed["origin"].as_i64().unwrap();
    for (i, event) in events.iter().enumerate() {
        assert_eq!(event["at"], at[i] + origin, "{event}");
        if event["ev"] != "tick" {
            assert_eq!(event["t"], timestamps[usize::try_from(t[i]).unwrap()], "{event}");
        }
        let source = printed["p"][i].as_u64().unwrap().checked_sub(1);
        let source = source.map(|index| &printed["sources"][usize::try_from(index).unwrap()]["p"]);
        assert_eq!(event.get("p"), source, "{event}");
    }
    let letters: String =
        events.iter().map(|event| letter(event["ev"].as_str().unwrap())).collect();
    assert_eq!(printed["ev"], letters);
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
    let printed = &data(&page)["traces"];
    assert_eq!(printed.as_array().unwrap().len(), 2);
    let violation = &printed[1]["violations"][0];
    assert_eq!((&violation["line"], &violation["rule"]), (&8.into(), &"F3".into()));
    let sentence = violation["sentence"].as_str().unwrap();
    assert!(sentence.starts_with("A result is dropped for the first of"), "{sentence}");
    assert_eq!((&violation["t"], sums(&printed[1]["timestamps"])), (&0.into(), vec![1]));
}

#[test]
fn a_failure_that_comes_after_its_timer_is_reported_as_late() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = r#"{"fuseline":1,"window":2,"clouds":[{"p":1,"limit":9},{"p":2,"limit":9}]}
{"ev":"open","at":0,"t":0}
{"ev":"offer","at":0,"t":0,"p":1,"deadline":50,"backlog":0}
{"ev":"offer","at":0,"t":0,"p":2,"deadline":90,"backlog":0}
{"ev":"result","at":9,"t":0,"p":0}
{"ev":"fail","at":50,"t":0,"p":1}
"#;
    let trace = dir.path().join("trace.jsonl");
    fs::write(&trace, out(&run(&["replay"], inputs))).unwrap();
    let (page, _) = page(&dir, &[&trace], &[]);
    let printed = &data(&page);
    let words: Vec<&str> = printed["columns"]
        .as_array()
        .unwrap()
        .iter()
        .map(|word| word[0].as_str().unwrap())
        .collect();
    // The timer, local's emit and the cancel stand between the failure and its drop.
    let counts = |index: usize| -> Vec<(&str, u64)> {
        let row = &printed["traces"][0]["account"]["rows"][index];
        assert_eq!(row["place"], index);
        let counts = row["counts"].as_array().unwrap().iter().map(|count| count.as_u64().unwrap());
        words.iter().copied().zip(counts).filter(|(_, count)| *count > 0).collect()
    };
    assert_eq!(counts(0), [("requests", 1), ("forwarded", 1)]);
    assert_eq!(counts(1), [("requests", 1), ("late", 1)]);
    assert_eq!(counts(2), [("requests", 1), ("superseded", 1)]);
    assert_eq!(printed["traces"][0]["fates"], "135");
    assert_eq!(printed["traces"][0]["outcome"], serde_json::json!([0]));
    assert_eq!(printed["traces"][0]["deadlines"], serde_json::json!([50, 90]));
}

#[test]
fn a_page_has_its_reasons_words_from_the_command() {
    let dir = tempfile::tempdir().unwrap();
    let (page, _) = page(&dir, &[&corpus("f8-every-input-has-an-outcome.jsonl")], &[]);
    let printed = data(&page);
    for reasons in ["refusals", "drops"] {
        for reason in printed[reasons].as_array().unwrap() {
            assert!(reason["sentence"].as_str().unwrap().len() > 9, "{reason}");
        }
    }
    // The places stand in the columns; each decision's word is the one of its line.
    let text = fs::read_to_string(corpus("f8-every-input-has-an-outcome.jsonl")).unwrap();
    let printed_words = |kind: &str| -> Vec<String> {
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        lines
            .filter(|line| line["ev"] == kind)
            .map(|line| line["why"].as_str().unwrap().to_owned())
            .collect()
    };
    for (kind, letter, reasons) in [("refuse", 'n', "refusals"), ("drop", 'd', "drops")] {
        let words = words_of(&printed["traces"][0], letter, &printed[reasons]);
        assert_eq!(words, printed_words(kind));
        assert!(!words.is_empty(), "{kind}");
    }
}

/// The words of the reasons that the events of this letter bear.
fn words_of(printed: &Value, letter: char, reasons: &Value) -> Vec<String> {
    let mut x = printed["x"].as_array().unwrap().iter();
    let mut words = Vec::new();
    for ev in printed["ev"].as_str().unwrap().chars() {
        let more = match ev {
            'f' => 2,
            'o' | 'q' | 'n' | 'd' => 1,
            _ => 0,
        };
        let more: Vec<&Value> = x.by_ref().take(more).collect();
        if ev == letter {
            let index = usize::try_from(more[0].as_u64().unwrap()).unwrap();
            words.push(reasons[index]["word"].as_str().unwrap().to_owned());
        }
    }
    words
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
    assert_eq!(code, Some(3));
    assert!(!element(&page).contains('<'));
    let printed = &data(&page)["traces"];
    assert_eq!(printed[0]["operator"], name);
    assert_eq!(printed[0]["sources"][1]["name"], name);
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
    let printed = &data(&page)["traces"][0];
    assert_eq!(printed["timestamps"][0], "18446744073709551615");
    assert_eq!(printed["origin"], "18446744073709551600");
    assert_eq!(sums(&printed["at"]), [0, 3, 3]);
}

#[test]
fn a_trace_is_judged_as_observed_if_wanted() {
    let dir = tempfile::tempdir().unwrap();
    let trace = corpus("bad/f3-first-response-wins.jsonl");
    let slack = ["--observed", "--tolerance", "2ns", "--lateness", "5ns"];
    let (page, _) = page(&dir, &[&trace], &slack);
    assert_eq!(data(&page)["traces"][0]["observed"], serde_json::json!([2, 5]));
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

/// All violations are on the page, though only the first hundred in full.
#[test]
fn the_page_marks_every_violation() {
    const MESSAGES: u64 = 250;
    let dir = tempfile::tempdir().unwrap();
    let trace = dir.path().join("many.jsonl");
    let mut text = "{\"fuseline\":1,\"window\":9,\"clouds\":[]}\n".to_owned();
    for n in 0..MESSAGES {
        let (open, miss) = ("{\"ev\":\"open\"", "{\"ev\":\"miss\"");
        text.extend([format!("{open},\"at\":{n},\"t\":{n}}}\n{miss},\"at\":{n},\"t\":{n}}}\n")]);
    }
    fs::write(&trace, text).unwrap();
    for more in [&[][..], &["--observed", "--tolerance", "0s", "--lateness", "0s"]] {
        let (page, code) = page(&dir, &[&trace], more);
        let printed = &data(&page)["traces"][0];
        let (full, places) = (printed["violations"].as_array().unwrap(), &printed["places"]);
        let lines = sums(&places["line"]);
        assert_eq!((code, full.len() + lines.len()), (Some(1), usize::try_from(MESSAGES).unwrap()));
        assert_eq!(lines.last(), Some(&i64::try_from(2 * MESSAGES + 1).unwrap()), "{more:?}");
        for column in ["rule", "t"] {
            assert_eq!(places[column].as_array().unwrap().len(), lines.len());
        }
        assert!(places["rules"][0][0].as_str().unwrap().starts_with(['F', 'P']), "{places}");
    }
}

#[test]
fn a_page_is_made_again_when_its_trace_has_grown() {
    let dir = tempfile::tempdir().unwrap();
    let [trace, page] = ["t.jsonl", "t.html"].map(|name| dir.path().join(name));
    let events = |count: u64| -> String {
        let open = |t| format!("{{\"ev\":\"open\",\"at\":{t},\"t\":{t}}}\n");
        (0..count).map(open).collect()
    };
    let header = "{\"fuseline\":1,\"window\":9,\"clouds\":[]}\n";
    fs::write(&trace, format!("{header}{}", events(1))).unwrap();
    let args = ["report", "--watch", trace.to_str().unwrap(), "-o", page.to_str().unwrap()];
    let mut child = fuseline(&args).stdout(Stdio::null()).spawn().unwrap();
    let mut wait_for = |lines: u64| {
        let start = Instant::now();
        while !fs::read_to_string(&page)
            .is_ok_and(|page| data(&page)["traces"][0]["lines"] == lines)
        {
            if start.elapsed() > Duration::from_secs(60) {
                child.kill().unwrap();
                panic!("no page with {lines} lines");
            }
            thread::sleep(Duration::from_millis(20));
        }
    };
    wait_for(2);
    fs::write(&trace, format!("{header}{}", events(5))).unwrap();
    wait_for(6);
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(3));
}
