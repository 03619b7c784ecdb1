//! Keys of a trace beside the machine's, on the command line: whose value, which attempt, own
//! deadlines, clocks that differ.

use std::fs;

use crate::common::{OBSERVED, err, out, run};
use serde_json::Value;
use tempfile::tempdir;

/// The reply to message 4 comes while message 5 waits for its own, and is sent for it.
const STALE: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"name":"server","limit":9}]}
{"ev":"open","at":0,"t":5,"within":50000000,"age":1000000,"origin":"camera/front","seq":81}
{"ev":"offer","at":0,"t":5,"p":1,"deadline":40000000,"backlog":0}
{"ev":"result","at":3000000,"t":5,"p":1,"of":4}
"#;

fn printed(args: &[&str], trace: &str) -> String {
    out(&run(args, trace)).to_owned()
}

/// D2.
#[test]
fn a_replay_copies_of_and_the_judge_finds_the_value_of_another_message() {
    let replayed = printed(&["replay"], STALE);
    let lines: Vec<&str> = replayed.lines().collect();
    assert_eq!(lines[1], STALE.lines().nth(1).unwrap());
    assert_eq!(lines.last(), Some(&r#"{"ev":"emit","at":3000000,"t":5,"p":1,"of":4}"#));
    for check in [&["check"][..], &OBSERVED] {
        let checked = run(check, &replayed);
        let printed = out(&checked);
        assert_eq!(checked.status.code(), Some(1));
        for part in ["stdin:6: timestamp 5 breaks D2\n", "a value of timestamp 5"] {
            assert!(printed.contains(part), "{part} is not in\n{printed}");
        }
    }
    let json = printed(&["check", "--json"], &replayed);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["violations"][0]["rule"], "D2");
    // One message old is what this cloud may be.
    let allowed = replayed.replacen("\"limit\":9", "\"limit\":9,\"max_age\":1", 1);
    assert_eq!(run(&["check"], &allowed).status.code(), Some(0));
    assert_eq!(run(&OBSERVED, &allowed).status.code(), Some(0));
    assert_eq!(printed(&["replay"], &allowed), allowed);
}

/// J2, with its name and rule wherever verdicts are written.
#[test]
fn an_output_after_the_messages_own_deadline_is_reported_as_observed() {
    let late = r#"{"fuseline":1,"window":4,"clouds":[]}
{"ev":"open","at":0,"t":5,"within":50000000}
{"ev":"result","at":90000000,"t":5,"p":0}
{"ev":"emit","at":90000000,"t":5,"p":0}
"#;
    assert_eq!(run(&["check"], late).status.code(), Some(0), "strictly it is carried");
    let checked = run(&OBSERVED, late);
    assert_eq!(checked.status.code(), Some(1));
    let printed = out(&checked);
    assert!(printed.contains("breaks J2\n") && printed.contains("late by   33ms"), "{printed}");
    let folder = tempdir().unwrap();
    let sarif = folder.path().join("t.sarif");
    let sarif = sarif.to_str().unwrap();
    run(&[&OBSERVED[..], &["--sarif", sarif]].concat(), late);
    let sarif: Value = serde_json::from_slice(&fs::read(sarif).unwrap()).unwrap();
    assert_eq!(sarif["runs"][0]["results"][0]["ruleId"], "J2");
}

/// A47: hedged, and only as observed.
#[test]
fn attempts_are_of_observed_traces() {
    let hedged = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"name":"server","limit":9}]}
{"ev":"open","at":0,"t":5}
{"ev":"request","at":0,"t":5,"p":1,"due":40000000,"try":0}
{"ev":"request","at":10000000,"t":5,"p":1,"due":50000000,"try":1}
{"ev":"result","at":13000000,"t":5,"p":1,"try":1}
{"ev":"emit","at":13000000,"t":5,"p":1}
"#;
    assert_eq!(run(&OBSERVED, hedged).status.code(), Some(0));
    for command in [&["check"][..], &["replay"]] {
        let refused = run(command, hedged);
        assert_eq!(refused.status.code(), Some(2));
        let message =
            "stdin:3:51: key \"try\" is allowed only in traces that are judged as observed";
        assert!(err(&refused).contains(message), "{}", err(&refused));
    }
}

/// D18: as a robot acts on the chunk of observation 0, which holds an action for each tick.
#[test]
fn a_spliced_chunk_breaks_d18() {
    let mut lines = vec![WITH_CHUNKS.to_owned()];
    for t in 1..=12_u64 {
        let at = t * 33_000_000;
        let came = at + 5_000_000;
        lines.push(format!(r#"{{"ev":"open","at":{at},"t":{t}}}"#));
        lines.push(format!(r#"{{"ev":"request","at":{at},"t":{t},"p":1,"deadline":30000000}}"#));
        let value = |meant: u64| format!(r#""at":{came},"t":{t},"p":1,"of":0,"for":{meant}"#);
        let meant = if t < 9 { t } else { t + 12 };
        lines.push(format!(r#"{{"ev":"result",{}}}"#, value(meant)));
        lines.push(format!(r#"{{"ev":"emit",{}}}"#, value(meant)));
    }
    let judged = |trace: &str| {
        let slack = ["--observed", "--tolerance", "1ms", "--lateness", "5ms"];
        let ran = run(&[&["check", "--json"], &slack[..]].concat(), trace);
        let verdict: Value = serde_json::from_str(out(&ran)).unwrap();
        let broken = verdict["violations"].as_array().unwrap().iter();
        (
            broken.map(|it| (it["rule"].clone(), it["t"].clone())).collect::<Vec<_>>(),
            ran.status.code(),
        )
    };
    let spliced = lines.join("\n") + "\n";
    let expected = [9, 10, 11, 12].map(|t| ("D18".into(), t.into())).to_vec();
    assert_eq!(judged(&spliced), (expected, Some(1)));
    let right = (21..=24).fold(spliced.clone(), |trace, meant| {
        trace.replace(&format!("\"for\":{meant}"), &format!("\"for\":{}", meant - 12))
    });
    assert_eq!(judged(&right), (Vec::new(), Some(0)));
    // Without the key it is judged as ever.
    let silent = |line: &str| line.split_once(",\"for\"").map(|(of, _)| format!("{of}}}"));
    let without = spliced.lines().map(|line| silent(line).unwrap_or_else(|| line.to_owned()));
    let without = without.collect::<Vec<_>>().join("\n") + "\n";
    assert_eq!(judged(&without), (Vec::new(), Some(0)));
}

/// D18: a robot's log says for which step an action was computed, in a column of its own.
#[test]
fn a_log_with_a_spliced_chunk_breaks_d18() {
    let log = |splice: u64| {
        let rows = (1..=4_u64).flat_map(|t| {
            let (sent, step) = (t * 33_000, if t < 3 { t } else { t + splice });
            let came = sent + 5_000;
            [
                format!("{sent},open,{t},,,,"),
                format!("{sent},request,{t},policy,30000,,"),
                format!("{came},result,{t},policy,,0,{step}"),
                format!("{came},emit,{t},policy,,,"),
            ]
        });
        let rows = rows.collect::<Vec<_>>().join("\n");
        format!("at,ev,t,p,deadline,observation,step\n{rows}\n")
    };
    let folder = tempdir().unwrap();
    let header = folder.path().join("header.jsonl");
    std::fs::write(&header, format!("{WITH_CHUNKS}\n")).unwrap();
    let header = header.to_str().unwrap();
    let judged = |splice: u64, columns: &str| {
        let command = ["convert", "--from", "csv", "--header", header, "--unit", "us", "-"];
        let converted = run(&[&command[..], &["--column", columns]].concat(), &log(splice));
        assert_eq!(converted.status.code(), Some(0), "{}", err(&converted));
        let checked = run(&OBSERVED, out(&converted));
        (out(&checked).matches("D18").count(), checked.status.code())
    };
    assert_eq!(judged(12, "of=observation,for=step"), (2, Some(1)));
    assert_eq!(judged(0, "of=observation,for=step"), (0, Some(0)));
    assert_eq!(judged(12, "of=observation"), (0, Some(0)));
}

const WITH_CHUNKS: &str = concat!(
    r#"{"fuseline":1,"window":16,"local":"none","#,
    r#""clouds":[{"p":1,"name":"policy","limit":8,"max_age":30}]}"#
);

/// A50.
#[test]
fn a_tolerance_may_be_that_of_one_source() {
    let trace = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"name":"server","limit":9},{"p":2,"limit":9}]}
{"ev":"open","at":100000000,"t":5}
{"ev":"request","at":100000000,"t":5,"p":1,"due":140000000}
{"ev":"result","at":95000000,"t":5,"p":1}
{"ev":"emit","at":104000000,"t":5,"p":1}
"#;
    let code = |more: &[&str]| {
        let checked = run(&[&OBSERVED[..], more].concat(), trace);
        (checked.status.code(), err(&checked).to_owned())
    };
    assert_eq!(code(&[]).0, Some(2), "it is out of order");
    assert_eq!(code(&["--tolerance", "server=10ms"]), (Some(0), String::new()));
    assert_eq!(code(&["--tolerance", "server=10ms", "--tolerance", "2=1us"]).0, Some(0));
    assert_eq!(code(&["--tolerance", "local=10ms"]).0, Some(2));
    let (exit, message) = code(&["--tolerance", "west=10ms"]);
    let expected = "stdin: the header has no source \"west\", which --tolerance names; it has \
                    local, server, 2";
    assert!(exit == Some(2) && message.contains(expected), "{message}");
    let (exit, message) = code(&["--tolerance", "3ms"]);
    assert!(exit == Some(2) && message.contains("is given twice; give it once"), "{message}");
    let alone = ["check", "--observed", "--tolerance", "server=10ms", "--lateness", "5ms"];
    let refused = run(&alone, trace);
    assert_eq!(refused.status.code(), Some(2));
    assert!(err(&refused).contains("give a --tolerance without a source"), "{}", err(&refused));
    let unit = run(&[&OBSERVED[..], &["--tolerance", "server=10"]].concat(), trace);
    assert!(err(&unit).contains("with a unit, such as 2ms"), "{}", err(&unit));
    // The page is judged in the same way.
    let folder = tempdir().unwrap();
    let page = folder.path().join("t.html");
    let page = page.to_str().unwrap();
    let report = ["report", "-", "-o", page, "--tolerance", "server=10ms"];
    let report = [&report[..], &OBSERVED[1..]].concat();
    assert_eq!(run(&report, trace).status.code(), Some(0));
}

/// Lines are read ahead of the judge.
#[test]
fn of_two_lines_with_something_wrong_the_earlier_one_is_reported() {
    let trace = r#"{"fuseline":1,"window":4,"clouds":[]}
{"ev":"open","at":100000000,"t":5}
{"ev":"tick","at":1}
"#;
    let unread = format!("{trace}{{\"ev\":\"tock\"}}\n");
    for text in [trace, &unread] {
        let refused = run(&OBSERVED, text);
        assert_eq!(refused.status.code(), Some(2));
        assert!(err(&refused).starts_with("error: stdin:3:"), "{}", err(&refused));
    }
    let early = format!("{trace}{}", "{\"ev\":\"tick\",\"at\":1}\n".repeat(100_000));
    assert!(err(&run(&OBSERVED, &early)).starts_with("error: stdin:3:"));
    let unread = unread.replace("{\"ev\":\"tick\",\"at\":1}\n", "");
    assert!(err(&run(&OBSERVED, &unread)).starts_with("error: stdin:3:"));
}

/// A49.
#[test]
fn an_operator_without_local_owes_no_local_result() {
    let trace = r#"{"fuseline":1,"window":4,"local":"none","clouds":[{"p":1,"name":"server","limit":9}]}
{"ev":"open","at":0,"t":5}
{"ev":"request","at":0,"t":5,"p":1,"due":40000000}
{"ev":"miss","at":41000000,"t":5}
"#;
    assert_eq!(run(&OBSERVED, trace).status.code(), Some(0));
    let with_local = trace.replace("\"local\":\"none\",", "");
    let checked = run(&OBSERVED, &with_local);
    assert!(out(&checked).contains("breaks F6\n"), "{}", out(&checked));
}

#[test]
fn a_conversion_keeps_the_keys_that_are_named() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let header = r#"{"fuseline":1,"window":4,"commit":"eager","local":"none","clouds":[{"p":1,"limit":9,"max_age":2}]}"#;
    fs::write(path("header.jsonl"), format!("{header}\n")).unwrap();
    let rows = "ev,at,t,p,due,of,try,within,age,origin,seq\n\
                open,1,5,,,,,50,0.5,camera/front,81\n\
                request,1,5,1,41,,0,,,,\n\
                result,2,5,1,,4,0,,,,\n\
                emit,2,5,1,,4,,,,,\n";
    fs::write(path("t.csv"), rows).unwrap();
    let (header_file, log) = (path("header.jsonl"), path("t.csv"));
    let named = "of=of,try=try,within=within,age=age,origin=origin,seq=seq";
    let convert = ["convert", "--header", &header_file, "--unit", "us", &log, "--sort"];
    let converted = printed(&[&convert[..], &["--column", named]].concat(), "");
    let expected = [
        header,
        r#"{"ev":"open","at":1000,"t":5,"within":50000,"age":500,"origin":"camera/front","seq":81}"#,
        r#"{"ev":"request","at":1000,"t":5,"p":1,"due":41000,"try":0}"#,
        r#"{"ev":"result","at":2000,"t":5,"p":1,"of":4,"try":0}"#,
        r#"{"ev":"emit","at":2000,"t":5,"p":1,"of":4}"#,
        "",
    ];
    assert_eq!(converted, expected.join("\n"));
    fs::write(path("t.jsonl"), converted).unwrap();
    let exported = run(&["export", "--perfetto", &path("t.jsonl"), "-o", &path("t.json")], "");
    assert_eq!(exported.status.code(), Some(0));
    assert!(err(&exported).contains("are omitted"), "{}", err(&exported));
}
