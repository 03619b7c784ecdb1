//! Tests which lines are in a recording's file while the operator runs, and what happens when the
//! disk is full.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{self, Command};
use std::thread;
use std::time::{Duration, Instant};

use crate::tested::config;
use fuseline_engine::{Commit, Engine, Header, Local, Recorder, Recording};
use fuseline_traces::judge;
use tempfile::TempDir;

type Tested = Engine<u64, u64>;

/// Longer than any write takes. A line that is missing after this time was never written.
const NEVER: Duration = Duration::from_secs(60);

fn header() -> Header {
    Header { operator: None, window: 4, commit: Commit::Eager, clouds: Vec::new() }
}

fn engine(path: &Path, recording: Recording) -> Tested {
    let local = Local { waiting: Some(4), ..Local::default() };
    let mut engine = Engine::new(config(&header(), &[], local)).unwrap();
    engine.record(Recorder::create(path, &header(), recording).unwrap()).unwrap();
    engine
}

fn answer(engine: &mut Tested, t: u64) {
    let _ = engine.open(10 * t, t, None, t, []);
    engine.result(10 * t + 1, t, 0, t);
    while engine.next_effect().is_some() {}
}

/// Waits until `holds` returns `true`.
fn until(mut holds: impl FnMut() -> bool) {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < NEVER, "it never came");
        thread::yield_now();
    }
}

/// Waits until the file contains these words.
fn until_written(path: &Path, words: &str) -> String {
    let mut text = String::new();
    until(|| {
        text = fs::read_to_string(path).unwrap();
        text.contains(words)
    });
    text
}

/// Returns `true` if the file has the decision about message `t`, for which [`answer`] was called.
fn is_written(path: &Path, t: u64) -> bool {
    let emitted = format!(r#"{{"ev":"emit","at":{},"t":{t},"p":0}}"#, 10 * t + 1);
    fs::read_to_string(path).unwrap().contains(&emitted)
}

fn folder() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("trace.jsonl");
    (folder, path)
}

#[test]
fn idle_operator_has_everything_in_its_file() {
    for every_input in [false, true] {
        let (_folder, path) = folder();
        let mut engine = engine(&path, Recording { every_input, ..Recording::default() });
        answer(&mut engine, 0);
        let text = until_written(&path, r#"{"ev":"emit","at":1,"t":0,"p":0}"#);
        assert_eq!(text.lines().count(), 4, "{text}");
        answer(&mut engine, 1);
        until_written(&path, r#"{"ev":"emit","at":11,"t":1,"p":0}"#);
        engine.finish().unwrap();
        assert!(judge("trace", &fs::read(&path).unwrap()[..]).unwrap().violations.is_empty());
    }
}

/// A miss is in the file even if the process is killed right after it (D10).
#[test]
fn a_killed_process_leaves_the_miss_that_it_died_of() {
    const PATH: &str = "RECORDING_TEST_PATH";
    if let Some(path) = env::var_os(PATH) {
        let mut engine = engine(Path::new(&path), Recording::default());
        for t in 0..3 {
            answer(&mut engine, t);
        }
        let _ = engine.open(30, 3, None, 3, []);
        engine.fail(31, 3, 0, &"on purpose");
        until_written(Path::new(&path), r#"{"ev":"miss","at":31,"t":3}"#);
        process::abort();
    }
    let (_folder, path) = folder();
    let killed = Command::new(env::current_exe().unwrap())
        .arg("a_killed_process_leaves_the_miss_that_it_died_of")
        .env(PATH, &path)
        .output()
        .unwrap();
    assert_eq!(killed.status.code(), None, "it was no signal that ended it");
    let verdict = judge("trace", &fs::read(&path).unwrap()[..]).unwrap();
    assert!(verdict.violations.is_empty() && verdict.judged == 4, "{verdict}");
}

/// A lost file is reported when it happens (D10).
#[test]
fn lost_file_is_reported_when_it_happens() {
    for what in ["removed", "replaced", "shortened"] {
        let (_folder, path) = folder();
        let mut engine = engine(&path, Recording::default());
        answer(&mut engine, 0);
        until(|| is_written(&path, 0));
        match what {
            "removed" => fs::remove_file(&path),
            "replaced" => fs::rename(&path, path.with_extension("old"))
                .and_then(|()| fs::write(&path, "somebody's")),
            _ => fs::write(&path, ""),
        }
        .unwrap();
        let counts = engine.counts();
        until(|| counts.tally().recording_error.is_some());
        let error = engine.finish().unwrap_err().to_string();
        assert!(
            error.ends_with(&format!("trace.jsonl was {what} while it was written")),
            "{error}"
        );
    }
}

/// A disk that fills is reported when it happens, and the operator continues (D10).
#[test]
fn full_disk_is_reported_and_the_operator_continues() {
    const SMALL_DISK: &str = "RECORDING_TEST_SMALL_DISK";
    const NAME: &str = "full_disk_is_reported_and_the_operator_continues";
    if env::var_os(SMALL_DISK).is_none() {
        // A process that may write no file of more than 16 KiB.
        let ended = Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f 32; exec \"$@\"", "sh"])
            .arg(env::current_exe().unwrap())
            .arg(NAME)
            .env(SMALL_DISK, "")
            .output()
            .unwrap();
        assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stdout));
        return;
    }
    let (_folder, path) = folder();
    let mut engine = engine(&path, Recording::default());
    let counts = engine.counts();
    let mut t = 0;
    while counts.tally().recording_error.is_none() {
        answer(&mut engine, t);
        t += 1;
        // At most 40 messages wait for the disk, however slow it is.
        if t.is_multiple_of(40) {
            until(|| is_written(&path, t - 1) || counts.tally().recording_error.is_some());
        }
    }
    let why = counts.tally().recording_error.unwrap();
    assert!(why.contains("trace.jsonl") && why.contains("File too large"), "{why}");
    for later in t..t + 100 {
        answer(&mut engine, later);
    }
    assert_eq!(counts.tally().forwarded(), t + 100);
    let error = engine.finish().unwrap_err();
    assert_eq!(error.to_string(), *why);
    let verdict = judge("trace", &fs::read(&path).unwrap()[..]).unwrap();
    assert!(verdict.violations.is_empty() && verdict.judged > 100, "{verdict}");
}

/// The error of each recording is reported, and the others are whole (D10).
#[test]
fn each_recording_reports_its_own_error() {
    for broken in [0, 1] {
        let folders = [folder(), folder()];
        let local = Local { waiting: Some(4), ..Local::default() };
        let mut engine: Tested = Engine::new(config(&header(), &[], local)).unwrap();
        for (_, path) in &folders {
            let recording = Recording { rotate: Some(1 << 12), ..Recording::default() };
            engine.record(Recorder::create(path, &header(), recording).unwrap()).unwrap();
        }
        // The second part cannot be created, because a folder is in its place.
        fs::create_dir(Recorder::part(&folders[broken].1, 1)).unwrap();
        for t in 0..100 {
            answer(&mut engine, t);
        }
        assert!(engine.finish().is_err());
        let lines = |index: usize| {
            let parts =
                (0..9).map(|part| fs::read_to_string(Recorder::part(&folders[index].1, part)));
            parts.flatten().map(|part| part.lines().count()).sum::<usize>()
        };
        assert!(lines(1 - broken) > 300 && lines(broken) <= 300);
    }
}

/// Returns the lines of a run that ends at 90 with an open message.
fn ended(deadline: Option<Duration>) -> Vec<String> {
    let (_folder, path) = folder();
    let mut engine = engine(&path, Recording::default());
    answer(&mut engine, 0);
    engine.end(5);
    let _ = engine.open(10, 1, deadline, 1, []);
    engine.end(90);
    engine.finish().unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert!(judge("trace", text.as_bytes()).unwrap().violations.is_empty(), "{text}");
    text.lines().skip(4).map(str::to_owned).collect()
}

/// A run that ends with an open message has a tick as its last line (A44).
#[test]
fn run_with_an_open_message_ends_with_a_tick() {
    let open = r#"{"ev":"open","at":10,"t":1}"#;
    assert_eq!(ended(None), [open, r#"{"ev":"tick","at":90}"#]);
}

#[test]
fn a_last_tick_decides_nothing() {
    let lines = ended(Some(Duration::from_nanos(30)));
    assert_eq!(lines.last().unwrap(), r#"{"ev":"tick","at":39}"#);
    let lines = ended(Some(Duration::from_nanos(81)));
    assert_eq!(lines.last().unwrap(), r#"{"ev":"tick","at":90}"#);
}

/// Inputs that come while the disk is too slow are missing, and the tally and `finish` both report
/// it (D10).
#[test]
fn slow_disk_ends_the_trace_and_is_reported() {
    let (_folder, path) = folder();
    assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
    // A pipe that is not read at first stands for a disk that is stuck.
    let (read_on, may_read) = std::sync::mpsc::channel::<()>();
    let slow = path.clone();
    let reader = thread::spawn(move || {
        let mut pipe = fs::File::open(slow).unwrap();
        may_read.recv().unwrap();
        let mut all = Vec::new();
        std::io::Read::read_to_end(&mut pipe, &mut all).unwrap();
        all
    });
    let mut engine = engine(&path, Recording::default());
    let counts = engine.counts();
    let mut t = 0;
    while counts.tally().recording_error.is_none() {
        answer(&mut engine, t);
        t += 1;
        assert!(t < 1_000_000, "a million messages wait for the disk");
    }
    read_on.send(()).unwrap();
    // Recording these would leave a gap.
    for later in t..t + 100 {
        answer(&mut engine, later);
    }
    assert_eq!(engine.finish().unwrap_err().to_string(), "the disk is too slow for the trace");
    assert_eq!(counts.tally().recording_error.as_deref(), Some("the disk is too slow"));
    let verdict = judge("trace", &reader.join().unwrap()[..]).unwrap();
    assert!(verdict.violations.is_empty() && verdict.judged > 100, "{verdict}");
}
