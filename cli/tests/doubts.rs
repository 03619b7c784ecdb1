//! Things that the judge could not see are part of the verdict: kinds of doubt, exit code 3, and
//! `--accept`.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::tempdir;

use crate::common::{err, fuseline, out, run};

const OBSERVED: [&str; 5] = ["--observed", "--tolerance", "1ms", "--lateness", "5ms"];
/// A judge's sidecar and its trace.
type Case = (String, Value, PathBuf);

/// The corpus' cases of doubts.
fn cases() -> Vec<Case> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus/doubts");
    let mut cases: Vec<Case> = fs::read_dir(folder)
        .unwrap()
        .map(|file| file.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
        .map(|path| {
            let sidecar = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, sidecar, path.with_extension("jsonl"))
        })
        .collect();
    cases.sort_by(|one, other| one.0.cmp(&other.0));
    assert!(cases.len() > 12);
    cases
}

/// The options that a sidecar asks for.
fn options(sidecar: &Value) -> Vec<String> {
    let mut options = Vec::new();
    if let Some(slack) = sidecar.get("observed") {
        let [tolerance, lateness] =
            ["tolerance", "lateness"].map(|key| format!("{}ns", slack[key]));
        let observed = ["--observed", "--tolerance", &tolerance, "--lateness", &lateness];
        options.extend(observed.map(str::to_owned));
    }
    for key in ["ended", "truncated"] {
        options.extend((sidecar.get(key) == Some(&true.into())).then(|| format!("--{key}")));
    }
    options
}

fn doubts(verdict: &Value) -> Vec<(String, u64, bool)> {
    let doubts = verdict["doubts"].as_array().unwrap();
    let of = |doubt: &Value| {
        let kind = doubt["kind"].as_str().unwrap().to_owned();
        assert!(!doubt["found"].as_str().unwrap().is_empty());
        (kind, doubt["count"].as_u64().unwrap(), doubt["accepted"].as_bool().unwrap())
    };
    doubts.iter().map(of).collect()
}

#[test]
fn each_kind_is_told_and_can_be_accepted() {
    for (name, sidecar, path) in cases() {
        let options = options(&sidecar);
        let trace = path.to_str().unwrap();
        let with = |more: &[&str]| {
            let args: Vec<&str> = options.iter().map(String::as_str).collect();
            run(&[&["check"], &args[..], more, &[trace]].concat(), "")
        };
        let expected = sidecar["doubts"].as_object().unwrap();
        let plain = with(&[]);
        let code = if expected.is_empty() { 0 } else { 3 };
        assert_eq!(plain.status.code(), Some(code), "{name}: {}{}", out(&plain), err(&plain));
        let told = if code == 0 { ": conforms, " } else { ": no violation found, " };
        assert!(out(&plain).contains(told), "{name}: {}", out(&plain));
        for (kind, count) in expected {
            assert!(out(&plain).contains(&format!("{count} {kind}")), "{name}: {}", out(&plain));
            assert!(out(&plain).contains(&format!("  in doubt  {kind}: ")), "{}", out(&plain));
        }
        let kinds = expected.keys().map(String::as_str).collect::<Vec<_>>().join(",");
        let json: Value = serde_json::from_str(out(&with(&["--json"]))).unwrap();
        let of_sidecar: Vec<_> =
            expected.iter().map(|(kind, n)| (kind.clone(), n.as_u64().unwrap(), false)).collect();
        let mut found = doubts(&json);
        found.sort();
        assert_eq!(found, of_sidecar, "{name}");
        assert_eq!(json["conforms"], expected.is_empty(), "{name}");
        if !expected.is_empty() {
            let accepted = with(&["--accept", &kinds]);
            assert_eq!(accepted.status.code(), Some(0), "{name}: {}", out(&accepted));
            assert!(out(&accepted).contains("conforms, accepting "), "{}", out(&accepted));
            let other = if kinds == "cut" { "silent" } else { "cut" };
            assert_eq!(with(&["--accept", other]).status.code(), Some(3), "{name}");
        }
    }
}

#[test]
fn packed_piped_and_reported_are_in_doubt_alike() {
    let dir = tempdir().unwrap();
    for (name, sidecar, path) in cases() {
        if sidecar.get("truncated").is_some() {
            continue;
        }
        let options = options(&sidecar);
        let args: Vec<&str> = options.iter().map(String::as_str).collect();
        let code = if sidecar["doubts"].as_object().unwrap().is_empty() { 0 } else { 3 };
        let text = fs::read_to_string(&path).unwrap();
        let piped = run(&[&["check"], &args[..]].concat(), &text);
        assert_eq!(piped.status.code(), Some(code), "{name}");
        let gzip = dir.path().join("trace.gz");
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, text.as_bytes()).unwrap();
        fs::write(&gzip, packed.finish().unwrap()).unwrap();
        let packed = run(&[&["check"], &args[..], &[gzip.to_str().unwrap()]].concat(), "");
        assert_eq!(packed.status.code(), Some(code), "{name}");
        let page = dir.path().join("page.html");
        let page = page.to_str().unwrap();
        let of = [path.to_str().unwrap(), "--force", "-o", page];
        let reported = run(&[&["report"], &args[..], &of].concat(), "");
        assert_eq!(reported.status.code(), Some(code), "{name}: {}", err(&reported));
    }
}

#[test]
fn a_violation_outweighs_a_doubt_and_bad_input_both() {
    let dir = tempdir().unwrap();
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../traces/corpus");
    let doubtful = corpus.join("doubts/unjudged-strictly.jsonl");
    let bad = corpus.join("bad/f3-first-response-wins.jsonl");
    let none = dir.path().join("none");
    for (files, code) in [
        (vec![&doubtful, &bad], 1),
        (vec![&bad, &doubtful], 1),
        (vec![&doubtful, &none, &bad], 2),
        (vec![&none, &doubtful], 2),
    ] {
        let files: Vec<&str> = files.iter().map(|file| file.to_str().unwrap()).collect();
        let checked = run(&[&["check", "--accept", "silent"], &files[..]].concat(), "");
        assert_eq!(checked.status.code(), Some(code), "{files:?}");
    }
}

#[test]
fn a_part_without_messages_is_unjudged() {
    let (_, sidecar, path) =
        cases().into_iter().find(|(name, ..)| name.starts_with("none-though")).unwrap();
    let options = options(&sidecar);
    let args: Vec<&str> = options.iter().map(String::as_str).collect();
    for (part, code) in
        [(["--timestamps", "9.."], 3), (["--from", "1s"], 3), (["--timestamps", "1..2"], 0)]
    {
        let checked = run(&[&["check"], &args[..], &part, &[path.to_str().unwrap()]].concat(), "");
        assert_eq!(checked.status.code(), Some(code), "{part:?}: {}", out(&checked));
        assert_eq!(out(&checked).contains("1 unjudged"), code == 3, "{}", out(&checked));
    }
    // Doubts about other messages are not those of the part.
    let unanswered = path.with_file_name("unanswered-though-later-ones-were.jsonl");
    for (part, code) in [("1", 0), ("2..3", 3), ("4..", 0)] {
        let part = ["--timestamps", part, unanswered.to_str().unwrap()];
        let checked = run(&[&["check"], &args[..], &part].concat(), "");
        assert_eq!(checked.status.code(), Some(code), "{part:?}: {}", out(&checked));
    }
}

#[test]
fn machines_read_doubts_as_no_success() {
    let dir = tempdir().unwrap();
    let trace = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../traces/corpus/doubts/unanswered-strictly.jsonl");
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (sarif, junit) = (at("t.sarif"), at("t.xml"));
    let files = ["--force", "--sarif", &sarif, "--junit", &junit];
    let trace = trace.to_str().unwrap();
    for (more, level, fails) in
        [(&[][..], "warning", true), (&["--accept", "unanswered"], "note", false)]
    {
        run(&[&["check"], more, &files, &[trace]].concat(), "");
        let read = |path: &str| fs::read_to_string(path).unwrap();
        let log: Value = serde_json::from_str(&read(&sarif)).unwrap();
        let result = &log["runs"][0]["results"][0];
        assert_eq!((&result["level"], &result["ruleId"]), (&level.into(), &"unanswered".into()));
        assert!(log["runs"][0]["tool"]["driver"]["rules"].to_string().contains("\"unanswered\""));
        assert_eq!(read(&junit).contains("<failure"), fails);
        assert!(!fails || !read(&junit).contains(": conforms"), "{}", read(&junit));
        assert!(!fails || read(&junit).contains("type=\"doubt\""), "{}", read(&junit));
    }
}

#[test]
fn options_that_are_kinds_now_are_refused() {
    for (args, part) in [
        (&["check", "--require-judged"][..], "in doubt"),
        (&["run", "--require-clouds"], "in doubt"),
        (&["check", "--accept", "unheard", "x"], "unanswered"),
    ] {
        let refused = run(args, "");
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert!(err(&refused).contains(part), "{args:?}: {}", err(&refused));
        assert_eq!(err(&refused).lines().count(), 1, "{}", err(&refused));
    }
}

/// A log of `n` messages, each answered by the cloud; `lines` makes the lines of a message from its
/// opening.
fn log(n: u64, lines: impl Fn(u64, u64) -> Vec<String>) -> String {
    let header =
        "{\"fuseline\":1,\"window\":8,\"clouds\":[{\"p\":1,\"name\":\"west\",\"limit\":9}]}\n";
    let mut all: Vec<(u64, String)> = Vec::new();
    for t in 1..=n {
        for line in lines(t, 1_000_000_000 + 200_000_000 * t) {
            let at = line.split("\"at\":").nth(1).unwrap().split(',').next().unwrap();
            all.push((at.parse().unwrap(), line));
        }
    }
    all.sort();
    all.into_iter().fold(header.to_owned(), |text, (_, line)| text + &line + "\n")
}

/// An event of message `t`, with keys after its instant.
fn event(ev: &str, at: u64, t: u64, more: &str) -> String {
    format!("{{\"ev\":\"{ev}\",\"at\":{at},\"t\":{t}{more}}}")
}

/// A message that the cloud answers after 40 ms, whose stamps are off by so much.
fn message(t: u64, at: u64, off: i64) -> Vec<String> {
    const MS: u64 = 1_000_000;
    vec![
        event("open", at, t, ""),
        event("request", at + MS, t, ",\"p\":1,\"deadline\":100000000"),
        event("result", at + 9 * MS, t, ",\"p\":0"),
        event("result", (at + 40 * MS).checked_add_signed(off).unwrap(), t, ",\"p\":1"),
        event("emit", at + 41 * MS, t, ",\"p\":1"),
    ]
}

#[test]
fn the_one_cause_of_most_violations_is_named() {
    let observed = |text: &str| {
        let checked = run(&[&["check"], &OBSERVED[..]].concat(), text);
        (checked.status.code(), format!("{}{}", out(&checked), err(&checked)))
    };
    assert_eq!(observed(&log(20, |t, at| message(t, at, 0))).0, Some(0));
    let hour = 3_600_000_000_000_i64;
    for (off, parts) in [
        (300_000_000, ["results of west come 299 ms after the outputs", "is its clock ahead?"]),
        (-300_000_000, ["results of west come 261 ms before their requests", "clock behind?"]),
        (hour, ["after the outputs that contain them", "does its clock use another time zone?"]),
    ] {
        let (code, printed) =
            observed(&log(20, |t, at| message(t, at + 2 * hour.unsigned_abs(), off)));
        assert_eq!(code, Some(1), "{printed}");
        let second = printed.lines().nth(1).unwrap();
        assert!(parts.iter().all(|part| second.contains(part)), "{off}: {printed}");
    }
    // Each line stands twice.
    let twice =
        |t, at| message(t, at, 0).into_iter().flat_map(|line| [line.clone(), line]).collect();
    let (code, printed) = observed(&log(20, twice));
    assert_eq!(code, Some(1));
    assert!(printed.lines().nth(1).unwrap().contains("stand twice"), "{printed}");
    assert!(printed.contains("a second open of timestamp 1; the first is line 2"), "{printed}");
    // The log begins again, with a clock that goes on.
    let first = log(12, |t, at| message(t, at, 0));
    let again = log(12, |t, at| message(t, at + 5_000_000_000, 0));
    let lines = first.lines().count();
    let (code, printed) = observed(&(first.clone() + again.split_once('\n').unwrap().1));
    assert_eq!(code, Some(1));
    let restart = format!("the log restarts at line {}", lines + 1);
    assert!(printed.lines().nth(1).unwrap().contains(&restart), "{printed}");
    // With a clock that begins again there is no order of the lines.
    let (code, printed) = observed(&(first.clone() + first.split_once('\n').unwrap().1));
    assert_eq!((code, printed.contains("the log restarts here")), (Some(2), true), "{printed}");
    // One stamp is years off.
    let off = first.replacen("\"at\":1601000000", "\"at\":18446744073709551615", 1);
    let (code, printed) = observed(&off);
    assert_eq!(code, Some(2));
    let line = off.lines().position(|line| line.contains("18446744073709551615")).unwrap() + 1;
    assert!(printed.contains(&format!("line {line} is 584.5")), "{printed}");
}

/// Returns what the second line of the verdict on a log with violations says.
fn cause(log: &str) -> String {
    let checked = run(&[&["check"], &OBSERVED[..]].concat(), log);
    assert_eq!(checked.status.code(), Some(1), "{}", out(&checked));
    out(&checked).lines().take(3).collect::<Vec<_>>().join("\n")
}

/// Returns the log in the order of its instants.
fn in_order(log: &str) -> String {
    let at = |line: &&str| {
        serde_json::from_str::<Value>(line).unwrap()["at"].as_u64().unwrap_or_default()
    };
    let mut lines: Vec<&str> = log.lines().collect();
    lines.sort_by_key(at);
    lines.join("\n") + "\n"
}

#[test]
fn outputs_of_another_clock_are_told() {
    let hour = 3_600_000_000_000_u64;
    let off = |by: i64| {
        let stamped = log(20, |t, at| {
            let mut lines = message(t, at + 2 * hour, 0);
            let at = (at + 2 * hour + 41_000_000).checked_add_signed(by).unwrap();
            lines[4] = event("emit", at, t, ",\"p\":1");
            lines
        });
        cause(&in_order(&stamped))
    };
    // An open that comes after its output is no second one, and its message is no message without
    // an open.
    let told = off(-300_000_000);
    assert!(told.contains("(20 violations), 20 timestamps judged"), "{told}");
    assert!(told.contains("outputs come 259 ms before the opens of their messages"), "{told}");
    assert!(!told.contains("unopened"), "{told}");
    let told = off(-hour.cast_signed());
    assert!(told.contains("do they use another time zone? (20 of 20 violations)"), "{told}");
    let told = off(hour.cast_signed());
    assert!(
        told.contains("s late; do they use another time zone? (20 of 20 violations)"),
        "{told}"
    );
}

#[test]
fn outputs_of_other_timestamps_are_told() {
    let stamped = log(20, |t, at| {
        let mut lines = message(t, at, 0);
        lines[4] = event("emit", at + 41_000_000, at + 41_000_000, ",\"p\":1");
        lines
    });
    let told = cause(&stamped);
    assert!(told.contains("outputs have timestamps that no open has, 1241000000 first"), "{told}");
    assert!(told.contains("20 unopened"), "{told}");
    let told = cause(&log(20, |t, at| message(t, at, 0)[..4].to_vec()));
    assert!(told.contains("the trace has no output at all"), "{told}");
}

/// A message goes on waiting for the cloud after local's output.
#[test]
fn a_silent_cloud_is_told_under_progressive() {
    let text = log(20, |t, at| {
        let mut lines = message(t, at, 0);
        lines.truncate(3);
        lines.push(event("emit", at + 9_000_000, t, ",\"p\":0"));
        lines
    });
    let header =
        r#"{"fuseline":1,"window":16,"commit":"progressive","clouds":[{"p":1,"limit":15}]}"#;
    let text = text.replacen(text.lines().next().unwrap(), header, 1);
    let checked = run(&[&["check"], &OBSERVED[..]].concat(), &text);
    assert_eq!(checked.status.code(), Some(3), "{}", out(&checked));
    assert!(out(&checked).contains("in doubt: 20 silent"), "{}", out(&checked));
    // A result that is ahead of the cloud's ends the waiting.
    let two = header.replace("}]", "},{\"p\":2,\"limit\":15}]");
    let ahead = |t: u64, at: u64| {
        let mut lines = message(t, at, 0);
        lines.insert(1, event("request", at + 1_000_000, t, ",\"p\":2,\"deadline\":100000000"));
        lines[4] = event("result", at + 40_000_000, t, ",\"p\":2");
        lines[5] = event("emit", at + 41_000_000, t, ",\"p\":2");
        lines.insert(4, event("emit", at + 9_000_000, t, ",\"p\":0"));
        lines
    };
    let text = log(20, ahead);
    let text = text.replacen(text.lines().next().unwrap(), &two, 1);
    let checked = run(&[&["check"], &OBSERVED[..]].concat(), &text);
    assert_eq!(checked.status.code(), Some(0), "{}", out(&checked));
}

#[test]
fn what_is_late_has_one_figure() {
    let late = |t, at| {
        let mut lines = message(t, at, 0);
        if t == 3 {
            lines[3] = event("result", at + 140_000_000, t, ",\"p\":1");
            lines[4] = event("emit", at + 141_000_000, t, ",\"p\":1");
        }
        lines
    };
    let checked = run(&[&["check"], &OBSERVED[..]].concat(), &log(9, late));
    assert_eq!(checked.status.code(), Some(1));
    for part in
        ["late by   39ms", "its result was due at 1701000000, and one up to 7 ms late may pass"]
    {
        assert!(out(&checked).contains(part), "{}", out(&checked));
    }
}

#[test]
fn the_late_result_stands_in_the_story() {
    let checked = run(
        &[&["check"], &OBSERVED[..]].concat(),
        &log(6, |t, at| message(t, at, if t == 2 { 500_000_000 } else { 0 })),
    );
    assert!(
        out(&checked).contains("{\"ev\":\"result\",\"at\":1940000000,\"t\":2,\"p\":1}"),
        "{}",
        out(&checked)
    );
}

/// The page has a green badge only where nothing is in doubt, and says of violations what was
/// found.
#[test]
fn the_page_has_the_doubts() {
    let dir = tempdir().unwrap();
    let trace = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../traces/corpus/doubts/unanswered-strictly.jsonl");
    let args = ["report", trace.to_str().unwrap(), "-o", "page.html"];
    let reported = fuseline(&args).current_dir(dir.path()).output().unwrap();
    assert_eq!(reported.status.code(), Some(3), "{}", err(&reported));
    let page = fs::read_to_string(dir.path().join("page.html")).unwrap();
    assert!(page.contains("\"doubts\":[{\"kind\":\"unanswered\",\"count\":1"), "no doubt");
}

/// Messages 1 to 3, then 11 to 13, whose requests the cloud does not answer.
fn answered_at_first() -> String {
    let mut lines = vec![CLOUD.to_owned()];
    for t in [1, 2, 3, 11, 12, 13_u64] {
        let at = t * 100_000_000;
        let (sent, came, due) = (at + 1_000_000, at + 20_000_000, at + 60_000_000);
        lines.push(format!(r#"{{"ev":"open","at":{at},"t":{t}}}"#));
        lines.push(format!(r#"{{"ev":"request","at":{sent},"t":{t},"p":1,"due":{due}}}"#));
        lines.push(format!(r#"{{"ev":"result","at":{came},"t":{t},"p":0}}"#));
        if t < 10 {
            lines.push(format!(r#"{{"ev":"result","at":{came},"t":{t},"p":1}}"#));
            lines.push(format!(r#"{{"ev":"emit","at":{came},"t":{t},"p":1}}"#));
        } else {
            lines.push(format!(r#"{{"ev":"emit","at":{due},"t":{t},"p":0}}"#));
        }
    }
    lines.join("\n") + "\n"
}

const CLOUD: &str = r#"{"fuseline":1,"window":16,"clouds":[{"p":1,"name":"west","limit":9}]}"#;

#[test]
fn a_part_is_in_doubt_by_its_own_messages() {
    let trace = answered_at_first();
    let of = |part: &[&str]| {
        let ran = run(&[&["check", "--json"], &OBSERVED[..], part].concat(), &trace);
        let verdict: Value = serde_json::from_str(out(&ran)).unwrap();
        let found = verdict["doubts"].as_array().unwrap().iter().map(|it| it["found"].to_string());
        (doubts(&verdict), found.collect::<String>(), ran.status.code())
    };
    assert_eq!(of(&[]), (vec![], String::new(), Some(0)));
    let silent = |count| vec![("silent".to_owned(), count, false)];
    let (found, text, code) = of(&["--from", "1s"]);
    assert_eq!((found, code), (silent(3), Some(3)));
    assert_eq!(text, "\"west answered none of its 3 requests\"");
    assert_eq!(of(&["--timestamps", "12..13"]).0, silent(2));
    assert_eq!(of(&["--timestamps", "2..2"]), (vec![], String::new(), Some(0)));
    // The part's own lines end before the deadline would.
    assert_eq!(of(&["--timestamps", "13..13"]).0, silent(1));
}
