//! Commands never write to a file that they read, they write a file whole or not at all, and they
//! report by the names that the user gave.
#![cfg(unix)]

use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::common::{err, fuseline, out, run};
use tempfile::{TempDir, tempdir};

const TRACE: &str = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n{\"ev\":\"tick\",\"at\":7}\n";

/// A directory with a trace that has several names, as MCAP too.
fn directory() -> TempDir {
    let dir = tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    fs::write(path("t.jsonl"), TRACE).unwrap();
    fs::write(path("other.jsonl"), TRACE).unwrap();
    fs::create_dir(path("folder")).unwrap();
    symlink("t.jsonl", path("link.jsonl")).unwrap();
    symlink("../t.jsonl", path("folder/far.jsonl")).unwrap();
    fs::hard_link(path("t.jsonl"), path("hard.jsonl")).unwrap();
    let args = ["export", "--mcap", "t.jsonl", "-o", "t.mcap"];
    assert!(in_directory(dir.path(), &args).status.success());
    dir
}

fn in_directory(directory: &Path, args: &[&str]) -> Output {
    fuseline(args).current_dir(directory).stdin(Stdio::null()).output().unwrap()
}

fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// D10: a trace that was written onto is lost.
#[test]
fn an_output_onto_its_input_is_refused_however_it_is_named() {
    let dir = directory();
    let before = names(dir.path());
    for output in ["t.jsonl", "./folder/../t.jsonl", "link.jsonl", "folder/far.jsonl", "hard.jsonl"]
    {
        for command in [
            &["export", "--perfetto", "t.jsonl"][..],
            &["export", "--mcap", "link.jsonl"],
            &["report", "t.jsonl"],
            &["report", "other.jsonl", "hard.jsonl"],
            &["convert", "--from", "csv", "t.jsonl"],
            &["convert", "--header", "t.jsonl", "t.mcap"],
        ] {
            let refused = in_directory(dir.path(), &[command, &["-o", output]].concat());
            assert_eq!(refused.status.code(), Some(2), "{command:?} -o {output}");
            let printed = err(&refused);
            assert!(
                printed
                    .starts_with(&format!("error: {output}: this is the same file as the input ")),
                "{printed}"
            );
            assert_eq!((printed.lines().count(), out(&refused)), (1, ""), "{printed}");
            assert_eq!(fs::read_to_string(dir.path().join("t.jsonl")).unwrap(), TRACE);
        }
    }
    assert_eq!(names(dir.path()), before);
}

#[test]
fn standard_input_and_output_are_files_too() {
    let dir = directory();
    let path = dir.path().join("t.jsonl");
    let onto_input = fuseline(&["export", "--perfetto", "-o", "link.jsonl"])
        .current_dir(dir.path())
        .stdin(File::open(&path).unwrap())
        .output()
        .unwrap();
    assert_eq!(onto_input.status.code(), Some(2));
    let expected = "error: link.jsonl: this is the same file as the input stdin; ";
    assert!(err(&onto_input).starts_with(expected), "{}", err(&onto_input));
    for command in [&["replay", "t.jsonl"][..], &["convert", "--header", "hard.jsonl", "t.mcap"]] {
        let appended = fuseline(command)
            .current_dir(dir.path())
            .stdout(OpenOptions::new().append(true).open(&path).unwrap())
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(appended.status.code(), Some(2));
        assert!(
            err(&appended).contains("standard output: this is the same file as "),
            "{command:?}"
        );
        assert_eq!(fs::read_to_string(&path).unwrap(), TRACE);
    }
}

#[test]
fn a_trace_does_not_go_onto_what_the_run_reads() {
    let dir = tempdir().unwrap();
    let drive = "sent_ms,rtt_ms\n0,1\n50,1\n";
    fs::write(dir.path().join("my.csv"), drive).unwrap();
    symlink("my.csv", dir.path().join("link")).unwrap();
    let args = ["run", "--for", "1s", "--drive", "west=my.csv", "--trace", "link"];
    let refused = in_directory(dir.path(), &args);
    assert_eq!(refused.status.code(), Some(2));
    let expected = "error: link: this is the same file as the input my.csv";
    assert!(err(&refused).starts_with(expected), "{}", err(&refused));
    assert_eq!(fs::read_to_string(dir.path().join("my.csv")).unwrap(), drive);
}

#[test]
fn a_dash_is_standard_output() {
    let dir = directory();
    let before = names(dir.path());
    for command in [
        &["export", "--perfetto", "t.jsonl"][..],
        &["export", "--mcap", "t.jsonl"],
        &["report", "t.jsonl"],
        &["convert", "t.mcap"],
    ] {
        let file = dir.path().join("out");
        let named = in_directory(dir.path(), &[command, &["-o", "out"]].concat());
        // Nothing is judged in it.
        let code = if command[0] == "report" { 3 } else { 0 };
        assert_eq!(named.status.code(), Some(code), "{}", err(&named));
        let printed = in_directory(dir.path(), &[command, &["-o", "-"]].concat());
        assert_eq!(printed.status.code(), Some(code), "{}", err(&printed));
        assert!(printed.stdout == fs::read(&file).unwrap(), "{command:?}");
        fs::remove_file(file).unwrap();
        assert_eq!(names(dir.path()), before, "{command:?}");
    }
}

#[test]
fn a_link_as_output_is_followed_and_stays() {
    let dir = directory();
    let path = |name: &str| dir.path().join(name);
    fs::write(path("folder/far.json"), "as it was").unwrap();
    symlink("folder/far.json", path("out")).unwrap();
    symlink("nowhere", path("dangling")).unwrap();
    let export = |output| {
        in_directory(dir.path(), &["export", "--force", "--perfetto", "t.jsonl", "-o", output])
    };
    assert_eq!(export("out").status.code(), Some(0));
    assert!(path("out").is_symlink());
    assert!(fs::read_to_string(path("folder/far.json")).unwrap().contains("traceEvents"));
    let refused = export("dangling");
    assert_eq!(refused.status.code(), Some(2));
    assert!(err(&refused).contains("dangling: this is a link to a file that does not exist"));
    assert!(path("dangling").is_symlink() && !path("nowhere").exists());
}

/// D10.
#[test]
fn what_cannot_be_written_is_reported_by_its_own_name_and_a_plain_cause() {
    let dir = directory();
    for (output, expected) in [
        ("none/x.json", "none/x.json: No such file or directory; "),
        ("folder", "folder: this is a directory; "),
        ("/dev/full", "/dev/full: No space left on device; make room"),
    ] {
        for command in [&["export", "--mcap", "t.jsonl"][..], &["report", "t.jsonl"]] {
            let refused = in_directory(dir.path(), &[command, &["-o", output]].concat());
            assert_eq!(refused.status.code(), Some(2));
            assert!(err(&refused).starts_with(&format!("error: {expected}")), "{}", err(&refused));
        }
    }
    let header = TRACE.lines().next().unwrap();
    let mut long = format!("{header}\n");
    for at in 0..200_000 {
        // To a string: it cannot fail.
        let _ = writeln!(long, "{{\"ev\":\"tick\",\"at\":{at}}}");
    }
    fs::write(dir.path().join("long.jsonl"), long).unwrap();
    for viewer in ["--mcap", "--perfetto"] {
        let trace = if viewer == "--mcap" { "long.jsonl" } else { "t.jsonl" };
        let limit = if viewer == "--mcap" { 8 } else { 0 };
        let full = limited(dir.path(), limit, &["export", viewer, trace, "-o", "x"]);
        assert_eq!(full.status.code(), Some(2), "{}", err(&full));
        assert!(err(&full).starts_with("error: x: File too large; "), "{}", err(&full));
        assert!(names(dir.path()).iter().all(|name| name != "x" && !name.starts_with(".x")));
    }
    for results in ["--junit", "--sarif"] {
        let full = limited(dir.path(), 0, &["check", "t.jsonl", results, "x"]);
        assert_eq!(full.status.code(), Some(2), "{results}: {}", err(&full));
        assert!(err(&full).starts_with("error: x: File too large; "), "{}", err(&full));
        assert!(names(dir.path()).iter().all(|name| name != "x" && !name.starts_with(".x")));
    }
}

/// D10.
#[test]
fn what_standard_output_does_not_take_is_reported() {
    let dir = directory();
    for command in [
        &["check", "t.jsonl"][..],
        &["replay", "t.jsonl"],
        &["convert", "t.mcap"],
        &["export", "--perfetto", "t.jsonl", "-o", "-"],
        &["report", "t.jsonl", "-o", "-"],
    ] {
        let full = fuseline(command)
            .current_dir(dir.path())
            .stdout(OpenOptions::new().write(true).open("/dev/full").unwrap())
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(full.status.code(), Some(2), "{command:?}");
        let expected = "error: standard output: No space left on device\n";
        assert!(err(&full).ends_with(expected), "{command:?}: {}", err(&full));
    }
}

/// Runs it where no file may be longer than this many blocks of 512 bytes.
fn limited(directory: &Path, blocks: u32, args: &[&str]) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_fuseline")])
        .args(args)
        .current_dir(directory)
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

#[test]
fn nobody_has_to_read_standard_error() {
    let dir = directory();
    for (args, code) in [
        (&["check", "no-such-file"][..], 2),
        (&["no-such-command"], 2),
        (&["run", "--for", "6s", "--rate", "1", "--json", "--accept", "silent"], 0),
    ] {
        let mut child = fuseline(args)
            .current_dir(dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(code), "{args:?}");
    }
}

#[test]
fn logs_in_a_file_have_no_colours() {
    let mut command = fuseline(&["run", "--for", "0.1s", "--json", "--trace"]);
    let dir = tempdir().unwrap();
    let logged = command.arg(dir.path().join("t.jsonl")).env("RUST_LOG", "trace").output().unwrap();
    let log = err(&logged);
    assert!(log.contains("TRACE") || log.contains("DEBUG"), "{log}");
    assert!(!log.contains('\u{1b}'), "{log}");
}

#[test]
fn a_negative_time_is_refused_with_what_it_must_be() {
    let times = ["check", "--observed", "--tolerance", "-2ms", "--lateness", "5ms"];
    let refused = run(&times, "");
    assert_eq!(refused.status.code(), Some(2));
    assert!(err(&refused).contains("it must be 0 or more with a unit"), "{}", err(&refused));
    for option in ["--for", "--rate", "--deadline", "--window", "--workers"] {
        let refused = run(&["run", option, "-1"], "");
        assert_eq!(refused.status.code(), Some(2), "{option}");
        assert!(!err(&refused).contains("-- -1"), "{}", err(&refused));
    }
}
