//! `fuseline run`, run as a user runs it: real sockets, real time.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::running::{adds_up, report, run_in, sum};
use crate::common::signal::{self, interrupt};
use crate::common::{err, fuseline, out, run};
use serde_json::{Value, json};
use tempfile::tempdir;

/// The doubts that a short run leaves if a busy host gives it no time.
const BUSY: &str = "silent,unjudged,unanswered";

/// The names in a directory.
fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_run_adds_up_and_leaves_a_trace_that_conforms() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &["--for", "2s", "--json", "--accept", BUSY]);
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
    let report = report(&ran);
    adds_up(&report);
    assert_eq!(report["messages"], 20);
    assert_eq!(report["trace"]["conforms"], true);
    assert_eq!(report["trace"]["judged"], 20);
    assert_eq!(names(dir.path()), ["fuseline-trace.jsonl"]);

    let trace = dir.path().join("fuseline-trace.jsonl");
    let trace = trace.to_str().unwrap();
    assert_eq!(run(&["check", trace], "").status.code(), Some(0));
    assert_eq!(out(&run(&["replay", trace], "")), fs::read_to_string(trace).unwrap());

    // Within what this machine took at most to serve a timer, the trace conforms as an observed one
    // too.
    let lag_ms = report["timer_lag_ms"].as_f64().unwrap_or(0.0);
    let lateness = format!("{}us", (lag_ms * 1000.0).ceil() + 1.0);
    let observed = ["check", "--observed", "--tolerance", "1us", "--lateness", &lateness, trace];
    let checked = run(&observed, "");
    assert_eq!(checked.status.code(), Some(0), "{}", out(&checked));
    assert!(out(&checked).contains("conforms, 20 timestamps judged"), "{}", out(&checked));
}

/// The rows of one cloud alone.
fn cloud_only(report: &Value) -> Vec<&Value> {
    let policies = report["policies"].as_array().unwrap().iter();
    policies.filter(|row| row["policy"].as_str().unwrap().starts_with("cloud only: ")).collect()
}

/// Nothing answers within a second from these places on.
const LOST: [&str; 7] = ["--for", "1s", "--json", "--start", "west=75s", "--start", "east=165s"];

/// D16: the commit rule, the policy and the deadline are those that were chosen.
#[test]
fn when_both_networks_are_lost_local_answers_everything_and_nobody_waits_for_them() {
    let dir = tempdir().unwrap();
    for (commit, policy) in [("eager", "expected"), ("patient", "expected"), ("eager", "constant")]
    {
        let chosen = ["--commit", commit, "--policy", policy, "--force", "--trace", "t.jsonl"];
        let ran = run_in(dir.path(), &[&LOST[..], &chosen].concat());
        let report = report(&ran);
        adds_up(&report);
        assert_eq!(report["sources"][0]["forwarded"], 10, "{report}");
        let alone = cloud_only(&report);
        for cloud in [1, 2] {
            let requests = &report["sources"][cloud]["requests"];
            assert_eq!(sum([&requests["late"], &requests["superseded"]]), 10, "{report}");
            assert_eq!(alone[cloud - 1]["mean_ap"], 0.0, "{report}");
        }
        assert_eq!((&report["outage_messages"], &report["policy"]), (&json!(10), &json!(policy)));
        let trace = lines(&dir.path().join("t.jsonl"));
        assert_eq!((&trace[0]["commit"], &report["commit"]), (&json!(commit), &json!(commit)));
        // Local's runtime is 301.7 ms, up to 5 % less.
        let expected = if policy == "constant" { 500_000_000 } else { 286_615_000 };
        assert_eq!(deadlines(&trace), [expected; 20]);
    }
}

/// The lines of a trace.
fn lines(trace: &Path) -> Vec<Value> {
    let trace = fs::read_to_string(trace).unwrap();
    trace.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Returns how long each request of a trace had, in nanoseconds.
fn deadlines(trace: &[Value]) -> Vec<u64> {
    let requests = trace.iter().filter(|line| line["ev"] == "request");
    requests.map(|it| it["due"].as_u64().unwrap() - it["at"].as_u64().unwrap()).collect()
}

#[test]
fn the_constant_is_reported_beside_what_is_expected() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &[&LOST[..], &["--deadline", "2s"]].concat());
    let report = report(&ran);
    let [expected, constant, ..] = &report["policies"].as_array().unwrap()[..] else { panic!() };
    assert_eq!(
        (&expected["policy"], &constant["policy"]),
        (&json!("fusion"), &json!("constant 2000 ms"))
    );
    // On the same arrivals, by the machine: timers fire when they are due.
    assert_eq!(constant["response_ms"]["p50"], 2000.0, "{report}");
    assert_eq!(constant["outage_response_ms"], 2000.0, "{report}");
}

/// D11.
#[test]
fn what_a_full_window_refuses_is_counted() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &["--for", "1s", "--window", "1", "--json"]);
    let report = report(&ran);
    adds_up(&report);
    assert_ne!(report["refused"], 0, "{report}");
}

/// D11.
#[test]
fn the_tables_report_what_the_trace_does() {
    let dir = tempdir().unwrap();
    let ran = run_in(dir.path(), &["--for", "1s", "--window", "1", "--trace", "t.jsonl"]);
    let trace = lines(&dir.path().join("t.jsonl"));
    let count = |is: &dyn Fn(&Value) -> bool| {
        u32::try_from(trace.iter().filter(|line| is(line)).count()).unwrap()
    };
    let refused = count(&|line| line["ev"] == "refuse" && line.get("p").is_none());
    let messages = count(&|line| line["ev"] == "open");
    for (seq, open) in (0..).zip(trace.iter().filter(|line| line["ev"] == "open")) {
        assert_eq!((&open["origin"], &open["seq"]), (&json!("camera"), &json!(seq)));
        assert!(open["age"].is_u64(), "{open}");
    }
    let taken_on = messages - refused;
    let printed = format!("{messages} messages: {taken_on} forwarded, 0 missed, {refused} refused");
    assert!(out(&ran).lines().any(|line| line == printed), "{printed}: {}", out(&ran));
    assert!(refused > 0 && taken_on > 0, "{printed}");
    for (p, name) in [(0, "local"), (1, "west"), (2, "east")] {
        let forwarded = count(&|line| line["ev"] == "emit" && line["p"] == p);
        let share = format!("{:.1}", 100.0 * f64::from(forwarded) / f64::from(messages));
        let (forwarded, p) = (forwarded.to_string(), p.to_string());
        let row = out(&ran).lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
        let row = row.filter(|row| row.starts_with(&[&p, name]) && row.get(3) == Some(&"%"));
        let cells: Vec<Vec<&str>> = row.map(|row| vec![row[2], row[5]]).collect();
        assert_eq!(cells, [[&*share, &*forwarded]], "{name}: {}", out(&ran));
    }
}

#[test]
fn all_policies_have_the_same_limits() {
    let dir = tempdir().unwrap();
    let full = ["--for", "2s", "--rate", "100", "--window", "256", "--workers", "64"];
    for policy in ["constant", "expected"] {
        let args = [&full[..], &["--calls", "1", "--policy", policy, "--json"]].concat();
        let report = report(&run_in(dir.path(), &args));
        adds_up(&report);
        assert_eq!(report["calls"], 1);
        // A shorter deadline may keep the queue below its limit.
        if policy == "constant" {
            assert_ne!(report["sources"][2]["requests"]["refused"], 0, "{report}");
        }
        let clouds = &report["sources"].as_array().unwrap()[1..];
        let in_time = |policy: &Value| policy["in_time"].as_u64().unwrap();
        for (cloud, alone) in clouds.iter().zip(cloud_only(&report)) {
            let count =
                |request_outcome: &str| cloud["requests"][request_outcome].as_u64().unwrap();
            let admitted = sum(cloud["requests"].as_object().unwrap().values()) - count("refused");
            // No cloud answered what was never requested of it.
            assert!(in_time(alone) <= admitted, "{report}");
            // An answered request was sent whole; an aborted one, in part.
            let sent = alone["sent_bytes"].as_u64().unwrap();
            let answered = count("forwarded") + count("discarded");
            assert!((33_300 * answered..33_340 * admitted).contains(&sent), "{report}");
        }
    }
}

#[test]
fn a_request_is_a_picture_and_a_few_bytes_around_it() {
    let dir = tempdir().unwrap();
    let alone = "name=east,priority=1,model=DINO-SWIN-Tiny,drive=cicv5g/rural_n8_v0";
    let patient = ["--for", "1s", "--policy", "constant", "--deadline", "20s", "--json"];
    let report = report(&run_in(dir.path(), &[&patient[..], &["--cloud", alone]].concat()));
    adds_up(&report);
    let [_, east] = &report["sources"].as_array().unwrap()[..] else { panic!("{report}") };
    let requests = &east["requests"];
    let answered = requests["forwarded"].as_u64().unwrap();
    assert_eq!(sum(requests.as_object().unwrap().values()), answered, "{requests}");
    let [sent, policy] =
        [&report["policies"][2], east].map(|it| it["sent_bytes"].as_u64().unwrap());
    assert_eq!(sent, policy, "{report}");
    assert!(answered > 5 && (33_300..33_340).contains(&(sent / answered)), "{report}");
}

#[test]
fn a_run_leaves_its_page_if_wanted_and_never_in_place_of_its_trace() {
    let dir = tempdir().unwrap();
    let short = ["--force", "--for", "0.3s", "--trace", "t.jsonl", "--accept", BUSY];
    let ran = run_in(dir.path(), &[&short[..], &["--report"]].concat());
    assert_eq!(ran.status.code(), Some(0), "{}", err(&ran));
    assert_eq!(out(&ran).lines().last(), Some("report.html: the page of this run"));
    let page = fs::read_to_string(dir.path().join("report.html")).unwrap();
    assert!(page.contains(r#""file":"t.jsonl""#));
    let named = run_in(dir.path(), &[&short[..], &["--json", "--report=mine.html"]].concat());
    report(&named);
    assert!(dir.path().join("mine.html").is_file());

    let trace = fs::read(dir.path().join("t.jsonl")).unwrap();
    for same in ["--report=t.jsonl", "--report=./t.jsonl"] {
        let refused = run_in(dir.path(), &[&short[..], &[same]].concat());
        assert_eq!(refused.status.code(), Some(2), "{}", out(&refused));
        assert!(err(&refused).contains("give the page"));
    }
    assert_eq!(fs::read(dir.path().join("t.jsonl")).unwrap(), trace);
    let alone = run_in(dir.path(), &["--open"]);
    assert!(err(&alone).contains("--report"), "{}", err(&alone));
}

#[test]
fn people_read_tables_of_at_most_100_columns() {
    let dir = tempdir().unwrap();
    // A file that existed before is named as it was given, too.
    fs::write(dir.path().join("mine.jsonl"), "earlier").unwrap();
    let args = ["--force", "--for", "1s", "--trace", "mine.jsonl", "--accept", BUSY];
    let ran = run_in(dir.path(), &args);
    for part in [
        "DETR-ResNet-50 on Orin",
        "pipelined over 4 workers",
        "emulated",
        "requests   forwarded   discarded   late   failed   superseded   refused",
        "10 messages: ",
        "fusion",
        "constant 500 ms",
        "in outages",
        "local only",
        "cloud only: west",
        "first response wins",
        "\nmine.jsonl: conforms, ",
        "10 timestamps judged",
    ] {
        assert!(out(&ran).contains(part), "{part} is not in\n{}", out(&ran));
    }
    assert!(out(&ran).lines().all(|line| line.chars().count() <= 100), "{}", out(&ran));
    assert_eq!(names(dir.path()), ["mine.jsonl"]);
}

/// D10.
#[test]
fn ctrl_c_and_termination_end_a_run_with_its_tables_and_a_whole_trace() {
    for signal in ["INT", "TERM"] {
        let dir = tempdir().unwrap();
        let mut child = fuseline(&["run", "--for", "3600s"])
            .current_dir(dir.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.next().unwrap().contains("a second for 3600 s"));
        signal::send(&child, signal);
        let printed: Vec<String> = lines.collect();
        assert!(printed.iter().any(|line| line.starts_with("Interrupted")), "{printed:?}");
        // If the signal came before any message was judged, the verdict is in doubt.
        assert_breaks_nothing(&printed, child.wait().unwrap().code());
        assert_eq!(names(dir.path()), ["fuseline-trace.jsonl"]);
    }
}

/// D8: frames come much faster than before while the operator makes up for two seconds; neither a
/// frame nor an output may wait for the other.
#[cfg(unix)]
#[test]
fn a_run_that_stood_still_goes_on_and_ctrl_c_ends_it() {
    for presses in [false, true] {
        let dir = tempdir().unwrap();
        let seconds = if presses { "3600s" } else { "4s" };
        let args = ["run", "--rate", "100", "--window", "128", "--workers", "64", "--for"];
        let mut child = fuseline(&[&args[..], &[seconds]].concat())
            .current_dir(dir.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.next().unwrap().contains("takes 100 frames"));
        // A run that was interrupted before its first output judges nothing.
        let trace = dir.path().join("fuseline-trace.jsonl");
        let started = Instant::now();
        while presses && !fs::read_to_string(&trace).is_ok_and(|text| text.contains("\"emit\"")) {
            assert!(started.elapsed() < Duration::from_secs(60), "no output within a minute");
            thread::sleep(Duration::from_millis(50));
        }
        signal::send(&child, "STOP");
        thread::sleep(Duration::from_secs(2));
        signal::send(&child, "CONT");
        if presses {
            interrupt(&child);
        }
        // On a busy host a cloud may answer nothing in time, which is in doubt.
        let (printed, code) = ended(child, lines);
        assert_breaks_nothing(&printed, code);
    }
}

/// The verdict names no violation, and the exit code fits the verdict.
fn assert_breaks_nothing(printed: &[String], code: Option<i32>) {
    let verdict = printed.iter().find(|line| line.starts_with("fuseline-trace.jsonl: ")).unwrap();
    let conforms = verdict.contains(": conforms, ");
    assert!(conforms || verdict.contains(": no violation found, "), "{printed:?}");
    assert_eq!(code, Some(if conforms { 0 } else { 3 }), "{printed:?}");
}

/// Returns what the command still prints, and its exit code. A command that does not end within a
/// minute is killed, and fails the test.
#[cfg(unix)]
fn ended(mut child: Child, lines: impl Iterator<Item = String>) -> (Vec<String>, Option<i32>) {
    let (id, (done, is_done)) = (child.id(), channel());
    let guard = thread::spawn(move || {
        let hangs = is_done.recv_timeout(Duration::from_secs(60)).is_err();
        if hangs {
            let killed = Command::new("kill").args(["-9", &id.to_string()]).status();
            assert!(killed.unwrap().success());
        }
        hangs
    });
    let printed: Vec<String> = lines.collect();
    // The guard may have stopped listening.
    let _ = done.send(());
    assert!(!guard.join().unwrap(), "it hangs: {printed:?}");
    (printed, child.wait().unwrap().code())
}

#[test]
fn bad_options_are_one_line_and_exit_2_and_write_nothing() {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("bad.csv"), "sent_ms,rtt_ms\n0,1\n50,x\n").unwrap();
    let remote = "name=a,priority=1,url=";
    for (args, expected) in [
        (&["--for", "0s"][..], "'--for <TIME>': it must be more than 0 and up to 1day"),
        (&["--for", "30"], "such as 30s: write 30s; see --help"),
        (&["--seconds", "8"], "such as 30s: write 8s; see --help"),
        (&["--rate", "1001"], "'--rate <HZ>': it must be from 0.1 to 1000"),
        (&["--for", "86400s", "--rate", "1000"], "86400000 frames are too many"),
        (&["--deadline", "0s"], "--deadline"),
        (&["--deadline", "500"], "such as 500ms: write 500ms; see --help"),
        (&["--deadline", "0.5ms"], "--deadline"),
        (&["--deadline", "1.5ms"], "it must be whole milliseconds"),
        (&["--local", "mine,runtime=45ms,ap=0.52"], "write 52 if 0.52 is a fraction"),
        (&["--policy", "guard"], "[possible values: expected, constant]"),
        (&["--price-per-ms", "-1"], "'--price-per-ms <AP>': it must be from 0 to 1"),
        (&["--window", "1025"], "--window"),
        (&["--commit", "lazy"], "--commit"),
        (&["--local", "yolo"], "no model \"yolo\""),
        (&["--drive", "west"], "is not KEY=VALUE"),
        (&["--drive", "north=bad.csv"], "there are west, east"),
        (&["--drive", "west=bad.csv"], "bad.csv:3: rtt_ms is \"x\""),
        (&["--drive", "west=none.csv"], "no readable file \"none.csv\""),
        (&["--drive", "west=vnperf/highway"], "has several networks"),
        (&["--start", "west=1000000s"], "beyond the drive"),
        (&["--cloud", "name=a"], "priority is missing"),
        (&["--cloud", &format!("{remote}ftp://h")], "the cloud's URL must be http"),
        (&["--cloud", &format!("{remote}https://h,ca=none.pem")], "none.pem: No such file"),
        (&["--trace", "."], "error: .: this is a directory; name a file in it"),
        (&["--trace", "none/t.jsonl"], "error: none/t.jsonl: No such file or directory; "),
        (
            &["--trace", "/dev/null"],
            "error: /dev/null: this is a device or a pipe, which cannot be read again; name a file",
        ),
        (&["--trace", "-"], "error: --trace -: "),
    ] {
        let refused = run_in(dir.path(), args);
        assert_eq!(refused.status.code(), Some(2), "{args:?}: {}", out(&refused));
        let printed = err(&refused);
        assert!(
            printed.starts_with("error: ") && printed.contains(expected),
            "{args:?}: {printed}"
        );
        assert_eq!((printed.lines().count(), out(&refused)), (1, ""), "{args:?}: {printed}");
        assert_eq!(names(dir.path()), ["bad.csv"], "{args:?}");
    }
    let same = format!("{remote}http://127.0.0.1:1");
    let two = run_in(dir.path(), &["--cloud", &same, "--cloud", &same.replace("=a", "=b")]);
    assert!(err(&two).contains("two clouds with priority 1"), "{}", err(&two));
    assert_eq!(names(dir.path()), ["bad.csv"]);
}

#[test]
fn a_failed_run_leaves_an_earlier_trace_as_it_was() {
    let dir = tempdir().unwrap();
    let trace = dir.path().join("fuseline-trace.jsonl");
    fs::write(&trace, "earlier").unwrap();
    assert_eq!(run_in(dir.path(), &["--drive", "west=none.csv"]).status.code(), Some(2));
    assert_eq!(fs::read_to_string(&trace).unwrap(), "earlier");
}

/// A run of one frame a second: what is gathered takes minutes to be as much as is written at once.
#[cfg(unix)]
fn slow_run(directory: &Path) -> Child {
    fuseline(&["run", "--for", "3600s", "--rate", "1", "--trace", "t.jsonl"])
        .current_dir(directory)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits until this many messages are answered in a trace; returns how many bytes it has then.
#[cfg(unix)]
fn until_recorded(trace: &Path, messages: usize) -> usize {
    let mut text = String::new();
    until(|| {
        text = fs::read_to_string(trace).unwrap_or_default();
        text.matches(r#""ev":"emit""#).count() >= messages
    });
    text.len()
}

#[cfg(unix)]
fn until(mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(60), "it never is");
        thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
#[test]
fn what_is_lost_when_a_run_is_killed_is_its_last_second() {
    let dir = tempdir().unwrap();
    let mut child = slow_run(dir.path());
    until_recorded(&dir.path().join("t.jsonl"), 4);
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(names(dir.path()), ["t.jsonl"]);
    let trace = dir.path().join("t.jsonl");
    let checked = run(&["check", "--truncated", "--json", trace.to_str().unwrap()], "");
    assert_eq!(checked.status.code(), Some(0), "{}", err(&checked));
    let verdict: Value = serde_json::from_str(out(&checked)).unwrap();
    assert!(verdict["judged"].as_u64().unwrap() >= 4, "{verdict}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_under_way_is_followed() {
    let dir = tempdir().unwrap();
    let trace = dir.path().join("t.jsonl");
    let mut run = slow_run(dir.path());
    until_recorded(&trace, 1);
    let follower = fuseline(&["check", "--follow", "--json", "t.jsonl"])
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // All messages are judged for certain except the last ones.
    let recorded = until_recorded(&trace, 6);
    let positions = format!("/proc/{}/fdinfo", follower.id());
    until(|| {
        let files = fs::read_dir(&positions).unwrap().flatten();
        let known = files.filter_map(|file| fs::read_to_string(file.path()).ok());
        let read =
            known.filter_map(|file| file.strip_prefix("pos:\t")?.lines().next()?.parse().ok());
        read.max() >= Some(recorded)
    });
    interrupt(&follower);
    let printed = follower.wait_with_output().unwrap();
    interrupt(&run);
    run.wait().unwrap();
    assert_eq!(printed.status.code(), Some(0), "{}", out(&printed));
    let verdict: Value = serde_json::from_str(out(&printed)).unwrap();
    assert!(verdict["judged"].as_u64().unwrap() >= 3, "{verdict}");
}

/// D10, D15: no file may be longer than 16 KiB here, so that the disk is full then.
#[cfg(unix)]
#[test]
fn a_full_disk_is_reported_and_the_run_goes_on_to_its_tables() {
    let dir = tempdir().unwrap();
    let script = "trap '' XFSZ; ulimit -f 32; exec \"$0\" \"$@\"";
    let ran = Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_fuseline")])
        .args(["run", "--for", "8s", "--rate", "20", "--trace", "t.jsonl"])
        .current_dir(dir.path())
        .env_remove("RUST_LOG")
        .output()
        .unwrap();
    assert_eq!(ran.status.code(), Some(2), "{}", err(&ran));
    assert!(out(&ran).contains("superseded") && out(&ran).contains("mean AP"), "{}", out(&ran));
    let printed: Vec<&str> = err(&ran).lines().collect();
    let when = printed.iter().position(|line| line.starts_with("warning: t.jsonl: File too large"));
    let progress = printed.iter().rposition(|line| line.contains(" of 8 s"));
    assert!(when.unwrap() < progress.unwrap(), "{printed:?}");
    assert!(printed.last().unwrap().starts_with("error: t.jsonl: File too large; "), "{printed:?}");
    let trace = dir.path().join("t.jsonl");
    assert!(fs::metadata(&trace).unwrap().len() > 8192);
    let checked = run(&["check", trace.to_str().unwrap()], "");
    assert_eq!(checked.status.code(), Some(0), "{}{}", out(&checked), err(&checked));
}
