//! No file that exists is replaced without a message.
#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::common::{err, fuseline, out};

const TRACE: &str = "\
{\"fuseline\":1,\"window\":4,\"clouds\":[]}
{\"ev\":\"open\",\"at\":0,\"t\":1}
{\"ev\":\"result\",\"at\":1,\"t\":1,\"p\":0}
{\"ev\":\"emit\",\"at\":1,\"t\":1,\"p\":0}
";
const EVENTS: &str = "at,ev,t\n0,open,1\n";

fn command(dir: &Path, args: &[&str]) -> Command {
    let mut command = fuseline(args);
    command.current_dir(dir);
    command
}

fn run(dir: &Path, args: &[&str]) -> Output {
    command(dir, args).output().unwrap()
}

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("t.jsonl"), TRACE).unwrap();
    fs::write(dir.path().join("events.csv"), EVENTS).unwrap();
    dir
}

#[test]
fn a_file_that_is_named_and_exists_is_replaced_by_force_alone() {
    let dir = folder();
    let file = dir.path().join("there");
    let name = "there";
    let plotted = ["probe", "--plot", "probed.csv", "-o", "plots"];
    fs::write(dir.path().join("probed.csv"), "sent_ms,rtt_ms\n0,1\n33,1\n").unwrap();
    fs::create_dir(dir.path().join("plots")).unwrap();
    fs::write(dir.path().join("plots/index.html"), "as it was").unwrap();
    for args in [
        &["report", "t.jsonl", "-o", name][..],
        &["export", "--perfetto", "t.jsonl", "-o", name],
        &["convert", "--header", "t.jsonl", "events.csv", "-o", name],
        &["check", "t.jsonl", "--junit", name],
        &["check", "t.jsonl", "--sarif", name],
        &["run", "--for", "0.2s", "--trace", name],
        &["run", "--for", "0.2s", "--trace", "new.jsonl", "--report=there"],
        &["drive", "--cases", "1", "--junit", name, "--", env!("CARGO_BIN_EXE_fuseline"), "impl"],
        &plotted,
    ] {
        let existing =
            if args == plotted { dir.path().join("plots/index.html") } else { file.clone() };
        fs::write(&existing, "as it was").unwrap();
        let refused = run(dir.path(), args);
        assert_eq!(refused.status.code(), Some(2), "{args:?}: {}", out(&refused));
        let expected =
            if args == plotted { "plots: the folder is not empty; " } else { "there: it exists; " };
        assert!(err(&refused).starts_with(&format!("error: {expected}")), "{}", err(&refused));
        assert!(err(&refused).contains("--force"), "{}", err(&refused));
        assert_eq!(fs::read_to_string(&existing).unwrap(), "as it was", "{args:?}");
        let forced = run(dir.path(), &[&args[..1], &["--force"], &args[1..]].concat());
        assert_ne!(forced.status.code(), Some(2), "{args:?}: {}", err(&forced));
        assert_ne!(fs::read_to_string(&existing).unwrap(), "as it was", "{args:?}");
        let _ = fs::remove_file(dir.path().join("new.jsonl"));
    }
}

#[test]
fn a_name_that_is_not_given_is_numbered_and_reported() {
    let dir = folder();
    let names = ["report.html", "report-2.html", "report-3.html"];
    for name in names {
        let printed = run(dir.path(), &["report", "t.jsonl"]);
        assert!(out(&printed).contains(&format!("{name}: ")), "{}", out(&printed));
        assert!(dir.path().join(name).is_file());
    }
    for name in ["fuseline-trace.jsonl", "fuseline-trace-2.jsonl"] {
        let printed = run(dir.path(), &["run", "--for", "0.2s"]);
        // A busy host may leave a cloud without a result, which is a doubt.
        assert_ne!(printed.status.code(), Some(2), "{}", err(&printed));
        assert!(out(&printed).contains(name), "{}", out(&printed));
        assert!(dir.path().join(name).is_file());
    }
    let first = fs::read(dir.path().join("report.html")).unwrap();
    fs::write(dir.path().join("report.html"), "as it was").unwrap();
    assert_eq!(run(dir.path(), &["report", "--force", "t.jsonl"]).status.code(), Some(0));
    assert_eq!(fs::read(dir.path().join("report.html")).unwrap(), first);
}

#[test]
fn a_device_is_written_to_as_it_is() {
    let dir = folder();
    for args in [
        &["report", "t.jsonl", "-o", "/dev/null"][..],
        &["export", "--perfetto", "t.jsonl", "-o", "/dev/null"],
        &["check", "t.jsonl", "--sarif", "/dev/null"],
    ] {
        let printed = run(dir.path(), args);
        assert_eq!(printed.status.code(), Some(0), "{args:?}: {}", err(&printed));
    }
    let piped = run(dir.path(), &["export", "--perfetto", "t.jsonl", "-o", "/dev/stdout"]);
    assert!(out(&piped).contains("traceEvents"), "{}", err(&piped));
}

/// The second run is refused while the first one writes; neither mixes with the other.
#[test]
fn two_runs_on_one_trace_are_told_apart() {
    let dir = folder();
    let args = ["run", "--for", "60s", "--trace", "one.jsonl", "--force"];
    let mut first = command(dir.path(), &args).stdout(Stdio::null()).spawn().unwrap();
    let trace: PathBuf = dir.path().join("one.jsonl");
    while fs::metadata(&trace).map_or(0, |file| file.len()) == 0 {
        assert!(first.try_wait().unwrap().is_none(), "it ended");
        sleep(Duration::from_millis(5));
    }
    let second = run(dir.path(), &["run", "--for", "0.2s", "--trace", "one.jsonl", "--force"]);
    assert!(first.try_wait().unwrap().is_none(), "it ended");
    first.kill().unwrap();
    first.wait().unwrap();
    assert_eq!(second.status.code(), Some(2), "{}", out(&second));
    assert!(err(&second).starts_with("error: one.jsonl: another run is writing to it; "));
    let text = fs::read_to_string(trace).unwrap();
    assert_eq!(text.matches("\"fuseline\":1").count(), 1);
}
