//! `fuseline drive` and `fuseline impl`, run as a user runs them.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};

use fuseline_traces::corpus::CASES;
use serde_json::Value;

const FUSELINE: &str = env!("CARGO_BIN_EXE_fuseline");

/// The mistakes of `mistakes.py`, each with the rule that it breaks.
const MISTAKES: [(&str, &str); 21] = [
    ("first-response-wins", "F3"),
    ("any-then-local", "F3"),
    ("lowest-number-wins", "F3"),
    ("one-deadline", "F5"),
    ("deadline-is-the-end", "F6"),
    ("in-time-at-due", "F5"),
    ("forwards-twice", "P1"),
    ("only-the-best-timer", "F6"),
    ("held-timer-disarmed", "F5"),
    ("late-revives", "F3"),
    ("no-hysteresis", "F2g"),
    ("failure-is-a-result", "F4"),
    ("local-not-kept", "F3"),
    ("reopens", "F1"),
    ("cancels-local", "F7"),
    ("clock-goes-back", "F0"),
    ("gate-first", "F2g"),
    ("unbounded-window", "F1"),
    ("first-output-ends", "F9"),
    ("copies-the-call", "D18"),
    ("splices-chunks", "D18"),
];

/// An example's path.
fn example(name: &str) -> String {
    format!("{}/../traces/examples/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Drives a command with these options. It may answer as late as on a busy host: what is wrong with
/// it is not that.
fn drive(options: &[&str], command: &[&str]) -> Output {
    run(&[&["drive", "--wait", "120s"], options, &["--"], command].concat(), "")
}

/// Drives a command and reads the report.
fn report(options: &[&str], command: &[&str]) -> Value {
    let driven = drive(&[&["--json"], options].concat(), command);
    serde_json::from_slice(&driven.stdout).unwrap_or_else(|_| panic!("{}", err(&driven)))
}

/// Returns whether a program is there; says so if not.
fn has(program: &str) -> bool {
    let findings = Command::new(program).arg("--version").stdout(Stdio::null()).status().is_ok();
    if !findings {
        println!("skipped: {program} is not installed");
    }
    findings
}

/// Everything passes in the corpus and in 150 runs, which reach all that runs reach.
fn assert_conforms(command: &[&str]) {
    assert_conforms_by(&[], command);
}

fn assert_conforms_by(options: &[&str], command: &[&str]) {
    let driven = drive(&[&["--cases", "150"], options].concat(), command);
    assert_eq!(driven.status.code(), Some(0), "{}{}", out(&driven), err(&driven));
    let printed = out(&driven);
    for part in [": conforms\n", "150 runs with ", "11 of 11 rules", "34 of 34 pairs"] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
}

#[test]
fn the_core_conforms() {
    assert_conforms(&[FUSELINE, "impl"]);
    assert_conforms_by(&["--values"], &[FUSELINE, "impl"]);
}

#[test]
fn the_example_in_python_conforms() {
    if has("python3") {
        assert_conforms_by(&["--values"], &["python3", &example("arbiter.py")]);
    }
}

#[test]
fn the_example_in_cpp_conforms() {
    if !has("g++") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let binary = dir.path().join("arbiter");
    let built = Command::new("g++")
        .args(["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror", "-o"])
        .arg(&binary)
        .arg(example("arbiter.cpp"))
        .status();
    assert!(built.unwrap().success());
    assert_conforms(&[binary.to_str().unwrap()]);
}

#[test]
fn each_mistake_is_found_and_reported_in_a_few_inputs() {
    if !has("python3") {
        return;
    }
    let script = example("mistakes.py");
    let listed = Command::new("python3").args([&script, "--list"]).output().unwrap();
    let listed = out(&listed).lines().filter_map(|line| line.split_whitespace().next());
    assert!(listed.eq(MISTAKES.iter().map(|(name, _)| *name)), "the list has changed");
    for (mistake, rule) in MISTAKES {
        // A busy host gets to few runs in the 30 s of the default.
        let options = ["--for", "10m", "--values"];
        let options = if rule == "D18" { &options } else { &options[..2] };
        let report = report(options, &["python3", &script, "--mistake", mistake]);
        assert_eq!(report["conforms"], false, "{mistake}");
        let failed =
            report["fixed"].as_array().unwrap().iter().any(|case| case["result"] != "pass");
        assert!(failed, "{mistake}: the corpus passes");
        assert!(report["generated"]["failed"].is_string(), "{mistake}: all runs pass");
        let findings = report["found"].as_array().unwrap();
        assert_eq!(findings.len(), 2, "{mistake}");
        assert_eq!(findings[0]["violation"]["rule"], rule, "{mistake}: {}", findings[0]);
        for findings in findings {
            assert!(findings["violation"]["rule"].is_string(), "{mistake}: {findings}");
            assert!(findings["inputs"].as_u64().unwrap() <= 12, "{mistake}: {findings}");
        }
    }
}

#[test]
fn a_difference_is_reported_saved_judged_and_shown_again() {
    if !has("python3") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let save = dir.path().join("found");
    let junit = dir.path().join("drive.xml");
    let script = example("mistakes.py");
    let command = ["python3", &script, "--mistake", "in-time-at-due"];
    let [save_to, junit_to] = [&save, &junit].map(|path| path.to_str().unwrap());
    let driven = drive(&["--save", save_to, "--junit", junit_to], &command);
    assert_eq!(driven.status.code(), Some(1));
    let printed = out(&driven);
    for part in [
        "does not conform",
        "breaks F5",
        "rule      Before an input everything due fires",
        "found     no decision",
        "expected  {\"ev\":\"timer\"",
        "in words  at 0: message 1 comes",
        "replay    fuseline drive --run",
    ] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
    let saved = fs::read_dir(&save).unwrap().next().unwrap().unwrap().path();
    let checked = run(&["check", saved.to_str().unwrap()], "");
    assert!(out(&checked).contains("breaks F5"), "{}", out(&checked));
    let again = drive(&["--run", saved.to_str().unwrap()], &command);
    assert!(out(&again).contains("breaks F5"), "{}", out(&again));
    assert!(fs::read_to_string(&junit).unwrap().contains("message=\"fail, F5\""));
}

/// The example with faults that need many clouds, unusual priorities, a long run, or a refusal that
/// should have moved nothing.
const WIDE_FAULTS: &str = r#"
import sys
sys.path.insert(0, sys.argv[1])
from arbiter import Arbiter, serve

class PrioritiesAsText(Arbiter):
    def is_outranked(self, p, others):
        return any(str(q) > str(p) for q in others)
    def best(self, cached):
        return max(cached, key=str)

class FourPending(Arbiter):
    def is_outranked(self, p, others):
        return any(q > p for q in sorted(others)[:4])

class PatientWhenOld(Arbiter):
    count = 0
    def apply(self, event):
        self.count += 1
        if self.count > 600:
            self.eager = False
        return super().apply(event)

class MovedByRefusal(Arbiter):
    reason = "deadline"
    def refuses_offer(self, t, p, due, backlog):
        why = super().refuses_offer(t, p, due, backlog)
        if why == self.reason and p in self.gates:
            self.gates[p].admits(backlog)
        return why

class MovedByUnknown(MovedByRefusal):
    reason = "unknown"

serve(globals()[sys.argv[2]])
"#;

#[test]
fn faults_that_need_many_clouds_long_runs_or_refusals_are_found() {
    if !has("python3") {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let script = directory.path().join("faults.py");
    fs::write(&script, WIDE_FAULTS).unwrap();
    let examples = example("");
    for fault in
        ["PrioritiesAsText", "FourPending", "PatientWhenOld", "MovedByRefusal", "MovedByUnknown"]
    {
        let command = ["python3", script.to_str().unwrap(), &examples, fault];
        let report = report(&["--cases", "500"], &command);
        assert!(report["generated"]["failed"].is_string(), "{fault}: {}", report["generated"]);
    }
    let right = ["python3", script.to_str().unwrap(), &examples, "Arbiter"];
    // A busy host may get to no generated run in the shorter ones.
    let mut reports = [2, 8, 32, 128].into_iter().map(|seconds| {
        let report = report(&["--for", &format!("{seconds}s")], &right);
        assert_eq!(report["conforms"], true, "{report}");
        report
    });
    assert!(reports.any(|report| report["generated"]["passed"].as_u64().unwrap() > 0));
}

#[test]
fn verdict_says_how_far_runs_went() {
    let driven = drive(&["--inputs", "60000"], &[FUSELINE, "impl"]);
    let printed = out(&driven).split_whitespace().collect::<Vec<_>>().join(" ");
    for part in [
        "(generator 2, seed 1)",
        "eager, ",
        " progressive; up to ",
        "15 clouds, priorities to 65535; ",
        "with the header of the run before",
        "clock forward by 1 ns to ",
        "results held for one message, up to ",
        "inputs in a row with a shut gate",
        "bits of timestamps 64, instants 64, deadlines 64,",
        "not driven: ",
        "runs of more than 65,536 inputs (--inputs 1000000)",
    ] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
    let report = report(&["--cases", "150", "--clouds", "3"], &[FUSELINE, "impl"]);
    assert!(report["extent"]["inputs"].as_u64().unwrap() > 1000, "{report}");
    assert_eq!(report["extent"]["clouds"], 3);
    let options = report["not_driven"].as_array().unwrap().iter();
    let clouds = options.filter(|it| it["option"] == "--clouds 15").collect::<Vec<_>>();
    assert_eq!(clouds[0]["what"], "more than 3 clouds");
}

#[test]
fn one_commit_rule_leaves_the_others_out() {
    // The paper's rule alone: it refuses a header of another one.
    let script = "import json, sys\nsys.path.insert(0, sys.argv[1])\nfrom arbiter import Arbiter, serve\n\
                  def eager(header):\n    assert header.get('commit', 'eager') == 'eager'\n    \
                  return Arbiter(header)\nserve(eager)\n";
    let command = ["python3", "-c", script, &example("")];
    if !has("python3") {
        return;
    }
    let driven = drive(&["--commit", "eager", "--inputs", "20000"], &command);
    let printed = out(&driven);
    assert_eq!(driven.status.code(), Some(0), "{printed}");
    assert!(printed.contains(" skipped because of --commit"), "{printed}");
    assert!(printed.contains("the commit rule patient, the commit rule progressive"), "{printed}");
    assert!(printed.contains("(--commit all)"), "{printed}");
    let report = report(&["--commit", "eager", "--cases", "9"], &command);
    assert!(report["suite"]["left_out"].as_u64().unwrap() > 10, "{}", report["suite"]);
}

#[test]
fn time_bound_says_what_it_left() {
    let driven = drive(&["--for", "1ms", "--inputs", "5000"], &[FUSELINE, "impl"]);
    let printed = out(&driven).split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(driven.status.code(), Some(0), "{printed}");
    assert!(printed.contains("--for ended them after 1ms, before all 5,000 inputs"), "{printed}");
}

/// A machine that goes wrong in a way that only other runs of its process show.
const ACROSS_RUNS: &str = r#"
import sys
sys.path.insert(0, sys.argv[1])
from arbiter import Arbiter, serve

gates = {}

class KeepsGates(Arbiter):
    def __init__(self, header):
        super().__init__(header)
        for p, gate in self.gates.items():
            gate.is_open = gates.get(p, gate).is_open
        gates.update(self.gates)

made = {}

def by_header(header):
    return made.setdefault(str(header), Arbiter(header))

serve({"gates": KeepsGates, "header": by_header}[sys.argv[2]])
"#;

#[test]
fn fault_across_runs_is_saved_with_them() {
    if !has("python3") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let script = dir.path().join("across.py");
    fs::write(&script, ACROSS_RUNS).unwrap();
    for fault in ["gates", "header"] {
        let examples = example("");
        let command = ["python3", script.to_str().unwrap(), &examples, fault];
        let save = dir.path().join(fault);
        let found = report(&["--save", save.to_str().unwrap()], &command);
        let finding = &found["found"][0];
        assert_eq!(finding["shows"], "after other runs", "{finding}");
        let saved: Vec<&str> =
            finding["saved"].as_array().unwrap().iter().map(|it| it.as_str().unwrap()).collect();
        assert_eq!(saved.len(), finding["before"].as_array().unwrap().len() + 1);
        assert!((2..=4).contains(&saved.len()), "{saved:?}");
        let again = drive(&[&["--run"], &saved[..]].concat(), &command);
        assert_eq!(again.status.code(), Some(1), "{}", out(&again));
        assert!(out(&again).contains("It passes in a process of its own and fails after"));
        let alone = drive(&["--run", saved[saved.len() - 1]], &command);
        assert_eq!(alone.status.code(), Some(0), "{}", out(&alone));
        // Without files, the cases are named, or the option that saves them.
        let unsaved = drive(&[], &command);
        let replay = out(&unsaved).lines().filter(|it| it.starts_with("  replay")).count();
        assert!(replay > 0, "{}", out(&unsaved));
    }
}

#[test]
fn fault_in_a_number_is_found_at_any_scale() {
    if !has("python3") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let script = dir.path().join("narrow.py");
    let text = "import sys\nsys.path.insert(0, sys.argv[1])\nfrom arbiter import Arbiter, serve\n\
                class Ticks(Arbiter):\n    def apply(self, event):\n        \
                return super().apply({**event, 'at': event['at'] // 1000 * 1000})\n\
                class Short(Arbiter):\n    def due(self, deadline):\n        \
                return super().due(deadline & 0xffffffff)\n\
                class Double(Arbiter):\n    def opened(self, t, deadline):\n        \
                super().opened(int(float(t)), deadline)\n\
                class Held(Arbiter):\n    def hold(self, t, message, p):\n        \
                super().hold(t, message, p)\n        \
                message.cached = set(sorted(message.cached)[:9])\n\
                class Window(Arbiter):\n    def __init__(self, header):\n        \
                super().__init__(header)\n        self.window = min(self.window, 300)\n\
                serve(globals()[sys.argv[2]])\n";
    fs::write(&script, text).unwrap();
    for fault in ["Ticks", "Short", "Double", "Held", "Window"] {
        let command = ["python3", script.to_str().unwrap(), &example(""), fault];
        let report = report(&["--inputs", "150000"], &command);
        assert!(report["generated"]["failed"].is_string(), "{fault}: {}", report["generated"]);
    }
}

#[test]
fn second_save_gets_other_names() {
    if !has("python3") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let save = dir.path().join("found");
    let script = example("mistakes.py");
    let command = ["python3", &script, "--mistake", "reopens"];
    for count in [2, 4] {
        let driven = drive(&["--save", save.to_str().unwrap(), "--inputs", "5000"], &command);
        assert_eq!(driven.status.code(), Some(1), "{}", err(&driven));
        assert!(out(&driven).contains("does not conform"), "{}", out(&driven));
        assert_eq!(fs::read_dir(&save).unwrap().count(), count);
    }
}

#[test]
fn stray_prints_stop_after_three_cases() {
    let stray = r#"while read -r line; do echo 'started'; echo '{"ev":"done"}'; done"#;
    let since = Instant::now();
    let driven = drive(&[], &["sh", "-c", stray]);
    let printed = out(&driven);
    assert_eq!(driven.status.code(), Some(1), "{printed}");
    for part in [
        "it answered \"started\"",
        "sent last {\"fuseline\":1",
        "expected  its decisions, one a line, then {\"ev\":\"done\"}",
        "it does not follow the protocol, so no other case was tried",
        &format!("{} not run", CASES.len() - 3),
    ] {
        assert!(printed.contains(part), "{part} is not in\n{printed}");
    }
    assert!(since.elapsed() < Duration::from_secs(60));
}

#[test]
fn command_that_dies_leaves_no_verdict() {
    let dir = tempfile::tempdir().unwrap();
    let junit = dir.path().join("drive.xml");
    let options = ["--junit", junit.to_str().unwrap(), "--force"];
    for command in [&["sh", "-c", "echo oops >&2; exit 3"][..], &["./no-such-command"]] {
        let driven = drive(&options, command);
        assert_eq!((driven.status.code(), out(&driven)), (Some(2), ""), "{command:?}");
        let junit = fs::read_to_string(&junit).unwrap();
        assert!(junit.contains("<error") && junit.contains("errors=\"1\""), "{junit}");
    }
}

/// The answers of a command that does nothing but answer `done`.
const DONE: &str = r#"while read -r line; do echo '{"ev":"done"}'; done"#;

#[test]
fn each_way_to_misbehave_has_its_words() {
    let garbage = r#"read -r line; echo '{"ev":"dne"}'; sleep 600"#;
    let echo = r#"read -r line; echo "$line""#;
    let endless = r#"read -r line; yes '{"ev":"miss","at":0,"t":0}'"#;
    let long = "read -r line; head -c 100000 /dev/zero | tr '\\0' x; sleep 600";
    let twice = r#"while read -r line; do echo '{"ev":"done"}'; echo '{"ev":"done"}'; done"#;
    let closes = "read -r line; exec >&-; sleep 600";
    let lingers = &format!("{DONE}; sleep 600");
    let fails = &format!("{DONE}; exit 3");
    let crashes = &format!("{DONE}; kill -ABRT $$");
    let dies = r#"read -r line; echo '{"ev":"done"}'; kill -9 $$"#;
    // On a busy host a shell may take seconds to begin, so only who never answers has little time.
    for (script, wait, words) in [
        ("sleep 600", "500ms", "it did not answer within 0.5 s; check that it flushes"),
        (dies, "60s", "it ended before it answered: signal: 9"),
        (closes, "60s", "it closed its output before it answered"),
        (garbage, "60s", "it answered \"{\\\"ev\\\":\\\"dne\\\"}\", column 7:"),
        (echo, "60s", "it answered with a line that is not a decision: {\"fuseline\":1"),
        (endless, "60s", "it answered more than 1000 lines without {\"ev\":\"done\"}"),
        (long, "60s", "it answered a line over 64 KiB"),
        (twice, "60s", "it wrote \"{\\\"ev\\\":\\\"done\\\"}\" after {\"ev\":\"done\"}"),
        (lingers, "10s", "it was still running after 10 s, although its input had ended"),
        (fails, "60s", "it ended with a failure: exit status: 3"),
        (crashes, "60s", "it ended with a failure: signal: 6"),
    ] {
        // Nothing is demanded of an open that is accepted, so `done` alone can conform.
        let options = ["--wait", wait, "--run", "-"];
        let inputs =
            "{\"fuseline\":1,\"window\":4,\"clouds\":[]}\n{\"ev\":\"open\",\"at\":0,\"t\":0}\n";
        let args = [&["drive"], &options[..], &["--", "sh", "-c", script]].concat();
        let since = Instant::now();
        let driven = run(&args, inputs);
        assert_eq!(driven.status.code(), Some(1), "{script}: {}", err(&driven));
        assert!(out(&driven).contains(words), "{script}: {words} is not in\n{}", out(&driven));
        let waits_less = since.elapsed() < Duration::from_secs(300);
        assert!(waits_less, "{script}: it was waited for");
    }
}

#[test]
fn dying_command_complains_once() {
    // It answers one header and then dies at each.
    let dir = tempfile::tempdir().unwrap();
    let mark = dir.path().join("answered");
    let script = format!(
        "read -r line; [ -e {0} ] || {{ touch {0}; echo '{{\"ev\":\"done\"}}'; }}; echo oops >&2; exit 4",
        mark.display()
    );
    let driven = drive(&["--json"], &["sh", "-c", &script]);
    assert_eq!((err(&driven), driven.status.code()), ("oops\n", Some(1)));
    let report: Value = serde_json::from_slice(&driven.stdout).unwrap();
    let cases = report["fixed"].as_array().unwrap();
    let misbehaved = cases.iter().filter(|case| case["result"] == "fail, misbehaves").count();
    assert_eq!((misbehaved, &report["gave_up"]), (3, &Value::Bool(true)), "{cases:?}");
}

#[test]
fn a_command_that_answers_nothing_is_given_five_seconds() {
    let since = Instant::now();
    let driven = run(&["drive", "--", "sh", "-c", "sleep 600"], "");
    assert_eq!(driven.status.code(), Some(1));
    assert!(out(&driven).contains("it did not answer within 5 s"), "{}", out(&driven));
    assert!(out(&driven).contains("sent last {\"fuseline\":1"), "{}", out(&driven));
    assert!((5..300).contains(&since.elapsed().as_secs()));
}

#[test]
fn what_cannot_be_started_or_read_is_one_line_and_exit_2() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path().to_str().unwrap();
    for args in [
        &["drive", "--", "./no-such-command"][..],
        &["drive", "--", here],
        &["drive", "--run", "no-such-case", "--", "true"],
        &["drive", "--wait", "5", "--", "true"],
        &["drive"],
    ] {
        let refused = run(args, "");
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert!(err(&refused).starts_with("error: "), "{}", err(&refused));
        assert_eq!((err(&refused).lines().count(), out(&refused)), (1, ""), "{}", err(&refused));
    }
}

#[test]
fn a_command_without_its_dashes_has_a_remedy() {
    for (args, typed) in [
        (&["drive", "python3", "my arbiter.py"][..], "drive -- python3 'my arbiter.py'"),
        (&["drive", "--cases", "7", "./arbiter"], "drive --cases 7 -- ./arbiter"),
        (&["drive", "--seed", "2"], "drive --seed 2 -- COMMAND"),
    ] {
        let refused = run(args, "");
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert!(
            err(&refused).ends_with(&format!("; type fuseline {typed}\n")),
            "{}",
            err(&refused)
        );
    }
    // A mistaken option is no command.
    let mistaken = run(&["drive", "--sed", "2"], "");
    let printed = err(&mistaken);
    assert!(printed.contains("; a similar argument exists: '--seed' tip: "), "{printed}");
}

#[test]
fn results_do_not_go_onto_what_is_driven() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("case.jsonl");
    let case = "{\"fuseline\":1,\"window\":4,\"clouds\":[]}\n";
    fs::write(&path, case).unwrap();
    let (file, here) = (path.to_str().unwrap(), dir.path().to_str().unwrap());
    for options in [&["--junit", file][..], &["--force", "--save", here]] {
        let refused = drive(&[options, &["--run", file]].concat(), &["sh", "-c", "exit 3"]);
        assert_eq!(refused.status.code(), Some(2), "{}", out(&refused));
        assert!(err(&refused).contains("this is the same file as the input"), "{}", err(&refused));
        assert_eq!(fs::read_to_string(&path).unwrap(), case);
    }
}

#[test]
fn ctrl_c_kills_the_command_with_its_children_and_reports_the_verdict_so_far() {
    let dir = tempfile::tempdir().unwrap();
    let pids = dir.path().join("pids");
    let script = format!("sleep 600 & echo $$ $! > {0}.new; mv {0}.new {0}; wait", pids.display());
    let junit = dir.path().join("drive.xml");
    let files = ["--junit", junit.to_str().unwrap()];
    let options = [&["drive", "--wait", "600s"], &files[..], &["--", "sh", "-c", &script]].concat();
    let mut command = fuseline(&options);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let pids = wait_for(|| fs::read_to_string(&pids).ok());
    interrupt(&child);
    let driven = child.wait_with_output().unwrap();
    assert_eq!(driven.status.code(), Some(2), "{}", out(&driven));
    assert!(out(&driven).contains("no difference so far, interrupted"), "{}", out(&driven));
    let junit = fs::read_to_string(&junit).unwrap();
    let interrupted = format!("<error message=\"interrupted; 0 of {} cases pass", CASES.len());
    assert!(junit.contains(&interrupted), "{junit}");
    for pid in pids.split_whitespace() {
        wait_for(|| has_gone(pid).then_some(()));
    }
}

/// Waits for something that comes soon.
fn wait_for<T>(ready: impl Fn() -> Option<T>) -> T {
    for _ in 0..3000 {
        if let Some(value) = ready() {
            return value;
        }
        thread::sleep(Duration::from_millis(10));
    }
    panic!("it did not come in 30 s");
}

/// Returns whether a process is no more, or waits to be reaped by whoever adopted it.
fn has_gone(pid: &str) -> bool {
    let stat = fs::read_to_string(Path::new("/proc").join(pid).join("stat"));
    stat.map_or(true, |stat| stat.contains(") Z "))
}

#[test]
fn nothing_of_a_command_is_left_when_it_ends_by_itself() {
    let dir = tempfile::tempdir().unwrap();
    let pid = dir.path().join("pid");
    let script = format!("sleep 600 >/dev/null & echo $! > {}; {DONE}", pid.display());
    let driven = drive(&["--run", "f8-every-input-has-an-outcome"], &["sh", "-c", &script]);
    assert_eq!(driven.status.code(), Some(1));
    let pid = fs::read_to_string(&pid).unwrap();
    wait_for(|| has_gone(pid.trim()).then_some(()));
}

#[test]
fn impl_answers_line_by_line_and_begins_afresh_with_a_header() {
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    let open = "{\"ev\":\"open\",\"at\":5,\"t\":7}\n";
    let answered = run(&["impl"], &format!("{header}{open}{open}{header}{open}"));
    let done = "{\"ev\":\"done\"}\n";
    let refused = "{\"ev\":\"refuse\",\"at\":5,\"t\":7,\"why\":\"order\"}\n";
    assert_eq!(out(&answered), [done, done, refused, done, done, done].concat());
    assert_eq!((err(&answered), answered.status.code()), ("", Some(0)));
}

#[test]
fn impl_says_line_and_column_of_what_it_cannot_read() {
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    let long = "x".repeat(70_000);
    for (text, location) in [
        ("{\"ev\":\"tick\",\"at\":1}\n", "stdin:1:1:"),
        ("{\"fuseline\":2}\n", "stdin:1:"),
        (&format!("{header}{{\"ev\":\"tick\"}}\n"), "stdin:2:"),
        (&format!("{header}{{\"ev\":\"miss\",\"at\":1,\"t\":1}}\n"), "stdin:2:1:"),
        (&format!("{header}{{\"ev\":\"tick\",\"at\":1}}"), "stdin:2:21:"),
        (&format!("{header}{long}\n"), "stdin:2:65538:"),
    ] {
        let answered = run(&["impl"], text);
        assert_eq!(answered.status.code(), Some(2), "{location}");
        let printed = err(&answered);
        assert!(printed.starts_with(&format!("error: {location}")), "{printed} for {location}");
        assert_eq!(printed.lines().count(), 1, "{printed}");
    }
}
