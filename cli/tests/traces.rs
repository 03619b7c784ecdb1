//! `fuseline check`, run as a user runs it.

use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use crate::common::sample::{Lines, TRACE, files, text};
use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;

#[test]
fn check_reports_a_conforming_trace_with_how_much_was_judged() {
    let (_dir, paths) = files(&[("trace.jsonl", TRACE)]);
    let checked = run(&["check", text(&paths[0])], "");
    assert!(out(&checked).ends_with("conforms, 1 timestamp judged in 12 lines\n"));
    assert_eq!(checked.status.code(), Some(0));
    assert_eq!(run(&["check"], TRACE).status.code(), Some(0));
    assert_eq!(run(&["check", "-"], TRACE).status.code(), Some(0));
}

#[test]
fn check_reports_a_violation_with_line_rule_and_story() {
    let (_dir, paths) = files(&[("bad.jsonl", &TRACE.replace("\"emit\"", "\"hold\""))]);
    let checked = run(&["check", text(&paths[0])], "");
    assert_eq!(checked.status.code(), Some(1));
    let printed = out(&checked);
    for part in [
        "bad.jsonl: does not conform (1 violation)",
        "bad.jsonl:11: timestamp 0 breaks F6\n",
        "\n  rule      After a failure or a timer the best available result is forwarded",
        r#"  found     {"ev":"hold","at":500,"t":0,"p":1}"#,
        r#"  expected  {"ev":"emit","at":500,"t":0,"p":1}"#,
        r#"  lines     2: {"ev":"open","at":0,"t":0}"#,
    ] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
}

#[test]
fn check_prints_one_json_object_a_file_with_the_keys_of_the_format() {
    let bad = TRACE.replace("\"emit\"", "\"hold\"");
    let (_dir, paths) = files(&[("good.jsonl", TRACE), ("bad.jsonl", &bad)]);
    let checked = run(&["check", "--json", text(&paths[0]), text(&paths[1])], "");
    assert_eq!(checked.status.code(), Some(1));
    let verdicts: Vec<Value> =
        out(&checked).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(verdicts.len(), 2);
    assert_eq!(verdicts[0]["file"], text(&paths[0]));
    assert_eq!(verdicts[0]["conforms"], true);
    assert_eq!((&verdicts[0]["judged"], &verdicts[0]["lines"]), (&1.into(), &12.into()));
    let violation = &verdicts[1]["violations"][0];
    assert_eq!((&violation["line"], &violation["t"]), (&11.into(), &0.into()));
    assert_eq!(violation["rule"], "F6");
    assert!(violation["found"].is_string() && violation["expected"].is_string());
}

#[test]
fn what_cannot_be_read_outweighs_what_does_not_conform() {
    let bad = TRACE.replace("\"emit\"", "\"hold\"");
    let cut = TRACE.trim_end();
    let (_dir, paths) = files(&[("bad.jsonl", &bad), ("cut.jsonl", cut), ("good.jsonl", TRACE)]);
    let all: Vec<&str> = ["check"].into_iter().chain(paths.iter().map(|path| text(path))).collect();
    let checked = run(&all, "");
    assert_eq!(checked.status.code(), Some(2));
    assert!(err(&checked).contains("cut.jsonl:12:"), "{}", err(&checked));
    // The files after it were judged all the same.
    assert!(out(&checked).contains("good.jsonl: conforms"));
    assert_eq!(run(&["check", "no-such-file"], "").status.code(), Some(2));
}

#[test]
fn check_says_line_and_column_of_what_it_cannot_read() {
    for (text, location) in [
        ("", "stdin:1:1:"),
        ("{\"ev\":\"tick\",\"at\":1}\n", "stdin:1:1:"),
        (&TRACE.replace("\"at\":1,", "\"at\":null,"), "stdin:5:20:"),
        (&TRACE.replace('\n', "\r\n"), "stdin:1:"),
    ] {
        let checked = run(&["check"], text);
        assert_eq!(checked.status.code(), Some(2), "{text}");
        let printed = err(&checked);
        assert!(printed.starts_with(&format!("error: {location}")), "{printed} for {text}");
        assert_eq!(printed.lines().count(), 1);
    }
}

const OBSERVED: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":31}]}
{"ev":"open","at":1000000,"t":0}
{"ev":"request","at":1100000,"t":0,"p":1,"deadline":50000000}
{"ev":"result","at":40000000,"t":0,"p":0}
{"ev":"emit","at":65000000,"t":0,"p":0}
"#;

/// D16.
#[test]
fn check_observed_judges_within_the_tolerance_and_reports_how_late_it_was() {
    let check = |tolerance: &str, lateness: &str, json: &[&str]| {
        let args = ["check", "--observed", "--tolerance", tolerance, "--lateness", lateness];
        run(&[&args[..], json].concat(), OBSERVED)
    };
    let within = check("2ms", "12ms", &[]);
    assert_eq!(within.status.code(), Some(3), "{}", out(&within));
    let line = "stdin: no violation found, 1 timestamp judged in 5 lines; in doubt: 1 silent\n";
    assert!(out(&within).starts_with(line), "{}", out(&within));

    let late = check("0ms", "5ms", &[]);
    assert_eq!(late.status.code(), Some(1));
    for part in [
        "stdin: does not conform (1 violation), 1 timestamp judged in 5 lines; in doubt: 1 silent\n",
        "stdin:5: timestamp 0 breaks P4\n",
        "  rule      While anything is held, something pending outranks all of it; under progressive each\n",
        "  expected  emit p 0, at 51100000 to 61100000\n",
        "  late by   3ms 900us\n",
    ] {
        assert!(out(&late).contains(part), "{part} is not in\n{}", out(&late));
    }
    let printed: Value = serde_json::from_str(out(&check("0ms", "5ms", &["--json"]))).unwrap();
    assert_eq!(
        (&printed["judged"], &printed["violations"][0]["late"]),
        (&1.into(), &3_900_000.into())
    );
    // Strictly a request has its due instant.
    assert_eq!(run(&["check"], OBSERVED).status.code(), Some(2));
}

/// D11: the exit code agrees with the verdict.
#[test]
fn check_observed_needs_its_tolerances_and_something_to_judge() {
    for args in [
        &["check", "--observed"][..],
        &["check", "--tolerance", "2ms"],
        &["check", "--observed", "--tolerance", "2", "--lateness", "5ms"],
    ] {
        let refused = run(args, OBSERVED);
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert_eq!(err(&refused).lines().count(), 1, "{}", err(&refused));
    }
    let start: String = OBSERVED.split_inclusive('\n').take(3).collect();
    let args = ["check", "--observed", "--tolerance", "2ms", "--lateness", "5ms"];
    let nothing = run(&args, &start);
    assert_eq!(nothing.status.code(), Some(3));
    assert!(out(&nothing).contains("no violation found, 0 timestamps judged"));
    let disorder = OBSERVED.replace("40000000", "60000000000");
    let refused = run(&args, &disorder);
    assert_eq!(refused.status.code(), Some(2));
    assert!(err(&refused).starts_with("error: stdin:5:1: the line at 65000000 follows a line at"));
}

/// The example of several threads, which needs a Python; none without one.
fn recorded(args: &[&str]) -> Option<String> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/examples/threaded.py");
    let Ok(recorded) = Command::new("python3").arg(script).args(args).output() else {
        println!("skipped: python3 is not installed");
        return None;
    };
    assert!(recorded.status.success(), "{}", err(&recorded));
    Some(out(&recorded).to_owned())
}

#[test]
fn threads_that_take_turns_conform_as_observed_and_those_that_race_do_not() {
    // So loose, for a host under load, that nothing is certain.
    let accept = ["--accept", "coarse,blurred"];
    let check = ["check", "--observed", "--tolerance", "50ms", "--lateness", "50ms"];
    let check = [&check[..], &accept].concat();
    let Some(trace) = recorded(&[]) else { return };
    let sound = run(&check, &trace);
    assert_eq!(sound.status.code(), Some(0), "{}{trace}", out(&sound));
    assert!(out(&sound).contains("conforms, accepting coarse"), "{}", out(&sound));
    assert!(out(&sound).contains(", 30 timestamps judged"), "{}", out(&sound));
    let Some(trace) = recorded(&["--racy"]) else { return };
    let racy = run(&check, &trace);
    assert_eq!(racy.status.code(), Some(1), "{trace}");
    assert!(out(&racy).contains("breaks P1\n"), "{}", out(&racy));
}

/// D11: the exit code is that of the worst of them.
#[test]
fn many_files_are_judged_at_once_and_reported_in_their_order() {
    let bad = TRACE.replace("\"emit\"", "\"hold\"");
    let names: Vec<String> = (0..40).map(|i| format!("{i:02}.jsonl")).collect();
    let files: Vec<(&str, &str)> = (names.iter().enumerate())
        .map(|(i, name)| (name.as_str(), if i % 7 == 0 { bad.as_str() } else { TRACE }))
        .collect();
    let (_dir, paths) = self::files(&files);
    let all: Vec<&str> = ["check"].into_iter().chain(paths.iter().map(|path| text(path))).collect();
    let checked = run(&all, "");
    assert_eq!(checked.status.code(), Some(1));
    let printed: Vec<&str> =
        out(&checked).lines().filter(|line| line.contains(" judged in ")).collect();
    assert_eq!(printed.len(), 40);
    for (i, (name, line)) in names.iter().zip(printed).enumerate() {
        let word = if i % 7 == 0 { ": does not conform" } else { ": conforms" };
        assert!(line.contains(&format!("{name}{word}")), "{line}");
    }
}

/// D11.
#[cfg(unix)]
#[test]
fn the_exit_code_reports_the_verdict_that_nobody_reads() {
    let bad = TRACE.replace("\"emit\"", "\"hold\"");
    let (_dir, paths) = files(&[("good.jsonl", TRACE), ("bad.jsonl", &bad)]);
    let page = paths[0].with_extension("html");
    for command in [
        &["check"][..],
        &["check", "--json"],
        &["check", "--sarif", "-"],
        &["check", "--junit", "-"],
        &["report", "--force", "--output", text(&page)],
        &["report", "--output", "-"],
    ] {
        for (path, code) in paths.iter().zip([0, 1]) {
            let (reader, writer) = std::io::pipe().unwrap();
            drop(reader);
            let args = [command, &[text(path)]].concat();
            let ended = fuseline(&args).stdout(writer).stderr(Stdio::piped()).output().unwrap();
            // Beside a page on standard output, that is where the verdict is printed.
            let has_failed = err(&ended).contains("error");
            let printed = (ended.status.code(), has_failed);
            assert_eq!(printed, (Some(code), false), "{args:?}: {}", err(&ended));
        }
    }
}

#[test]
fn check_reads_a_gzipped_trace() {
    let (_dir, paths) = files(&[("trace.jsonl.gz", "")]);
    fs::write(&paths[0], packed(TRACE)).unwrap();
    assert_eq!(run(&["check", text(&paths[0])], "").status.code(), Some(0));
    assert_eq!(out(&run(&["replay", text(&paths[0])], "")), TRACE);
}

#[test]
fn check_reads_what_export_made_for_viewers() {
    let (_dir, paths) = files(&[("trace.jsonl", TRACE), ("trace.mcap", "")]);
    let (trace, recording) = (text(&paths[0]), text(&paths[1]));
    assert_eq!(
        run(&["export", "--force", "--mcap", trace, "-o", recording], "").status.code(),
        Some(0)
    );
    assert_eq!(
        out(&run(&["check", recording], "")),
        out(&run(&["check", trace], "")).replace(trace, recording)
    );
    // Written as a recorder would: what is free to be left out, or in another order, is as an
    // export has it.
    assert_eq!(run(&["replay", recording], "").status.code(), Some(0));
    let whole = fs::read(&paths[1]).unwrap();
    fs::write(&paths[1], &whole[..whole.len() / 2]).unwrap();
    let cut = run(&["check", recording], "");
    assert_eq!(cut.status.code(), Some(2));
    assert!(err(&cut).contains("; --truncated judges everything before it"), "{}", err(&cut));
}

fn packed(text: &str) -> Vec<u8> {
    let mut packer = GzEncoder::new(Vec::new(), Compression::default());
    packer.write_all(text.as_bytes()).unwrap();
    packer.finish().unwrap()
}

/// D10.
#[test]
fn what_a_crash_cut_off_is_judged_as_far_as_it_goes_if_that_is_requested() {
    let ends: Vec<usize> = TRACE.match_indices('\n').map(|(at, _)| at + 1).collect();
    for end in &ends[..ends.len() - 1] {
        let cut = &TRACE[..end + 5];
        let refused = run(&["check"], cut);
        assert_eq!(refused.status.code(), Some(2), "{cut}");
        assert!(err(&refused).contains("; --truncated judges everything before it"), "{cut}");
        let (_dir, paths) = files(&[("cut.jsonl", cut)]);
        let page = paths[0].with_extension("html");
        for args in [&["check", "--truncated"][..], &["report", "-o", text(&page), "--truncated"]] {
            let judged = run(&[args, &[text(&paths[0])]].concat(), "");
            assert_eq!(judged.status.code(), Some(3), "{cut}{}{}", out(&judged), err(&judged));
            let line = cut.matches('\n').count() + 1;
            let printed = format!("cut: line {line} is cut short and was ignored");
            assert!(out(&judged).contains(&printed), "{}", out(&judged));
        }
    }
    // Line 7, a result, led to a hold: it is not missing, but nor is it passed over in silence.
    let unanswered = run(&["check", "--truncated"], &TRACE[..ends[6]]);
    assert_eq!(unanswered.status.code(), Some(3), "{}", out(&unanswered));
    assert!(
        out(&unanswered).contains("the trace ends with line 7, before"),
        "{}",
        out(&unanswered)
    );
    assert_eq!(run(&["check"], &TRACE[..ends[6]]).status.code(), Some(1));
    // A violation stays one.
    let bad = TRACE.replace("\"hold\"", "\"emit\"");
    assert_eq!(run(&["check", "--truncated"], &bad[..bad.len() - 3]).status.code(), Some(1));
    let (_dir, paths) = files(&[("cut.jsonl.gz", "")]);
    let whole = packed(TRACE);
    fs::write(&paths[0], &whole[..whole.len() - 12]).unwrap();
    assert_eq!(run(&["check", text(&paths[0])], "").status.code(), Some(2));
    let judged = run(&["check", "--truncated", text(&paths[0])], "");
    assert_eq!(judged.status.code(), Some(3), "{}{}", out(&judged), err(&judged));
    assert!(out(&judged).contains("cut short"), "{}", out(&judged));
}

#[cfg(unix)]
mod follow {
    use super::*;

    #[test]
    fn a_violation_is_reported_while_the_file_grows_and_ctrl_c_gives_the_verdict() {
        let (_dir, paths) = files(&[("growing.jsonl", "")]);
        let mut file = fs::OpenOptions::new().append(true).open(&paths[0]).unwrap();
        let mut child = fuseline(&["check", "--follow", text(&paths[0])])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = Lines::of(child.stdout.take().unwrap());
        let bad = TRACE.replace("\"hold\"", "\"emit\"");
        let (start, rest) = bad.split_at(bad.find("emit").unwrap());
        file.write_all(start.as_bytes()).unwrap();
        file.write_all(rest.as_bytes()).unwrap();
        assert_eq!(lines.next(), "");
        assert!(lines.next().ends_with("growing.jsonl:8: timestamp 0 breaks F3"));
        // A line that has no end yet is not judged.
        file.write_all(b"{\"ev\":").unwrap();
        interrupt(&child);
        let printed: Vec<String> = lines.0.iter().collect();
        assert!(printed.iter().any(|line| line.contains("does not conform (")), "{printed:?}");
        let output = child.wait_with_output().unwrap();
        assert_eq!((output.status.code(), err(&output)), (Some(1), ""));
    }

    #[test]
    fn in_json_a_followed_file_has_its_verdict_alone() {
        let found = followed(&TRACE.replace("\"hold\"", "\"emit\""), &["--json"]);
        assert_eq!((found.status.code(), out(&found).lines().count()), (Some(1), 1));
        let verdict: serde_json::Value = serde_json::from_str(out(&found)).unwrap();
        assert_eq!(verdict["violations"][0]["rule"], "F3");
    }

    /// Follows a file with this text until it was read, and gives the verdict.
    fn followed(text_so_far: &str, args: &[&str]) -> Output {
        let (_dir, paths) = files(&[("growing.jsonl", text_so_far)]);
        let child = fuseline(&[&["check", "--follow", text(&paths[0])], args].concat())
            .env("RUST_LOG", "debug")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let position = format!("/proc/{}/fdinfo", child.id());
        let end = format!("pos:\t{}\n", text_so_far.len());
        for _ in 0..3000 {
            let files = fs::read_dir(&position).unwrap().flatten();
            let mut known = files.filter_map(|file| fs::read_to_string(file.path()).ok());
            if known.any(|file| file.starts_with(&end)) {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        interrupt(&child);
        child.wait_with_output().unwrap()
    }

    #[test]
    fn what_is_not_answered_at_the_end_of_a_followed_file_is_not_judged() {
        // Each prefix of a conforming trace conforms, as far as it goes.
        let ends: Vec<usize> = TRACE.match_indices('\n').map(|(at, _)| at + 1).collect();
        for (end, cut) in ends.iter().flat_map(|end| [(*end, false), (*end + 5, true)]) {
            let Some(start) = TRACE.get(..end) else { continue };
            let checked = followed(start, &[]);
            let code = if out(&checked).contains("in doubt: 1 unjudged") { 3 } else { 0 };
            assert_eq!(checked.status.code(), Some(code), "{start}{}", out(&checked));
            let lines = start.matches('\n').count();
            let printed = format!("judged in {lines} line");
            assert!(out(&checked).contains(&printed), "{cut} {lines}: {}", out(&checked));
        }
        let observed = ["--observed", "--tolerance", "0ms", "--lateness", "0ms"];
        let answered = OBSERVED.replace("65000000", "51100000");
        let more = "{\"ev\":\"open\",\"at\":60000000,\"t\":1}\n\
                    {\"ev\":\"result\",\"at\":70000000,\"t\":1,\"p\":0}\n";
        let checked = followed(&format!("{answered}{more}"), &observed);
        assert!(out(&checked).contains("in doubt: 1 silent\n"), "{}", out(&checked));
        assert_eq!(checked.status.code(), Some(3), "{}", out(&checked));
    }

    #[test]
    fn a_gzipped_file_is_not_followed() {
        let (_dir, paths) = files(&[("trace.jsonl.gz", "")]);
        fs::write(&paths[0], packed(TRACE)).unwrap();
        let refused = run(&["check", "--follow", text(&paths[0])], "");
        assert_eq!(refused.status.code(), Some(2));
        assert!(err(&refused).contains("trace.jsonl.gz: this file is packed"), "{}", err(&refused));
    }

    #[test]
    fn it_takes_one_file_that_is_no_standard_input() {
        for args in [&["check", "--follow"][..], &["check", "--follow", "-"]] {
            let refused = run(args, TRACE);
            assert_eq!(refused.status.code(), Some(2));
            assert!(err(&refused).starts_with("error: --follow"), "{}", err(&refused));
        }
    }
}

#[test]
fn a_mistake_on_the_command_line_is_one_line_and_exit_2() {
    for args in [&["chekc"][..], &["check", "--jsno"], &["replay", "a", "b"]] {
        let refused = run(args, "");
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert!(err(&refused).starts_with("error: "), "{}", err(&refused));
        assert_eq!(err(&refused).lines().count(), 1, "{}", err(&refused));
        assert_eq!(out(&refused), "");
    }
}

#[test]
fn help_and_version_are_no_errors() {
    for args in [&["--help"][..], &["--version"], &["check", "--help"], &["help", "run"]] {
        let helped = run(args, "");
        assert_eq!(helped.status.code(), Some(0), "{args:?}");
        assert!(!out(&helped).is_empty() && err(&helped).is_empty());
    }
    assert!(out(&run(&["--help"], "")).contains("Exit codes:"));
}

/// A good trace, a bad one whose name must be written otherwise in a URI and in XML, and one that
/// cannot be read.
fn three() -> (tempfile::TempDir, Vec<PathBuf>) {
    let bad = TRACE.replace("\"ev\":\"hold\"", "\"ev\":\"emit\"");
    files(&[("good.jsonl", TRACE), ("bad <& ü>.jsonl", &bad), ("none.jsonl", "{}\n")])
}

/// D11.
#[test]
fn code_hosts_get_each_violation_with_its_rule_and_place() {
    let (dir, paths) = three();
    let sarif = dir.path().join("found.sarif");
    let args =
        ["check", "--sarif", text(&sarif), text(&paths[0]), text(&paths[1]), text(&paths[2])];
    assert_eq!(run(&args, "").status.code(), Some(2));
    let log: Value = serde_json::from_str(&fs::read_to_string(&sarif).unwrap()).unwrap();
    assert_eq!(log["version"], "2.1.0");
    let run = &log["runs"][0];
    let first = &run["results"][0];
    assert_eq!((&first["ruleId"], &first["level"]), (&"F3".into(), &"error".into()));
    let location = first["ruleIndex"].as_u64().and_then(|it| usize::try_from(it).ok()).unwrap();
    let rule = &run["tool"]["driver"]["rules"][location];
    assert_eq!(rule["id"], "F3");
    assert!(rule["shortDescription"]["text"].as_str().unwrap().starts_with("A result"), "{rule}");
    let location = &first["locations"][0]["physicalLocation"];
    assert_eq!(location["region"]["startLine"], 8);
    let uri = location["artifactLocation"]["uri"].as_str().unwrap();
    assert!(uri.ends_with("/bad%20%3C%26%20%C3%BC%3E.jsonl"), "{uri}");
    let message = first["message"]["text"].as_str().unwrap();
    assert!(
        message.contains("expected  {\"ev\":\"hold\"") && !message.contains('\x1b'),
        "{message}"
    );
    let printed = &run["invocations"][0];
    assert_eq!(printed["executionSuccessful"], false);
    let unread = printed["toolExecutionNotifications"][0]["message"]["text"].as_str().unwrap();
    assert!(unread.contains("none.jsonl:1"), "{unread}");
}

/// D11.
#[test]
fn junit_has_each_trace_with_its_verdict() {
    let (dir, paths) = three();
    let junit = dir.path().join("found.xml");
    let traces = paths.iter().map(|path| text(path));
    let args = ["check", "--junit", text(&junit)].into_iter().chain(traces);
    assert_eq!(run(&args.collect::<Vec<_>>(), "").status.code(), Some(2));
    let junit = fs::read_to_string(&junit).unwrap();
    assert!(junit.contains(r#"tests="3" skipped="0" failures="1" errors="1""#), "{junit}");
}

#[test]
fn no_results_go_onto_a_trace() {
    let (_dir, paths) = three();
    for option in ["--sarif", "--junit"] {
        let refused = run(&["check", option, text(&paths[0]), text(&paths[0])], "");
        assert_eq!(refused.status.code(), Some(2));
        assert!(err(&refused).contains("this is the same file as the input"), "{}", err(&refused));
        assert_eq!(fs::read_to_string(&paths[0]).unwrap(), TRACE);
    }
}

/// A37.
#[test]
fn a_trace_without_anything_to_judge_is_in_doubt() {
    let header = TRACE.lines().next().unwrap();
    let (dir, paths) = files(&[("empty.jsonl", &format!("{header}\n")), ("full.jsonl", TRACE)]);
    let (empty, full) = (text(&paths[0]), text(&paths[1]));
    let (page, junit) = (dir.path().join("page.html"), dir.path().join("junit.xml"));
    for command in [
        &["check", "--force", "--junit", text(&junit)][..],
        &["check", "--json"],
        &["report", "--force", "-o", text(&page)],
    ] {
        let of = |more: &[&str]| run(&[command, more].concat(), "");
        assert_eq!(of(&[full]).status.code(), Some(0), "{command:?}");
        assert_eq!(of(&["--accept", "unjudged", full, empty]).status.code(), Some(0));
        assert_eq!(of(&[full, empty]).status.code(), Some(3), "{command:?}");
        if command.contains(&"--junit") {
            assert_eq!(fs::read_to_string(&junit).unwrap().matches("<failure").count(), 1);
        }
    }
}
