//! Tests what the recorder leaves on disk after an end, a drop, a panic, a kill and an error.

use std::env;
use std::fs;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Command;

use fuseline_traces::{
    Cloud, Commit, ExpectedDecisions, Header, Input, Recorder, Recording, Reference, Verdict,
    judge, unpack,
};
use tempfile::TempDir;

fn header() -> Header {
    let cloud = Cloud { p: 1, name: Some("west".into()), limit: 31, resume: 30 };
    Header { operator: None, window: 4, commit: Commit::Eager, clouds: vec![cloud] }
}

/// Records this many messages with the rules' decisions. Each forwards local at the cloud's due
/// instant.
fn record(recorder: &mut Recorder, messages: u64) {
    let mut reference = Reference::new(&header());
    let mut demands = ExpectedDecisions::new();
    for t in 0..messages {
        let at = 10 * t;
        let inputs = [
            Input::Open { at, t, deadline: None },
            Input::Offer { at, t, p: 1, deadline: 5, backlog: 0 },
            Input::Result { at: at + 1, t, p: 0 },
            Input::Tick { at: at + 5 },
        ];
        for input in inputs {
            recorder.input(&input);
            demands.clear();
            reference.apply(&input, &mut demands);
            for (decision, _) in &demands {
                recorder.decision(decision);
            }
        }
    }
}

fn folder() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("trace.jsonl");
    (folder, path)
}

fn verdict(path: &Path) -> Verdict {
    let packed = fs::read(path).unwrap();
    judge("trace", unpack(&packed[..]).unwrap()).unwrap()
}

#[test]
fn a_finished_recording_conforms() {
    let (_folder, path) = folder();
    let mut recorder = Recorder::create(&path, &header(), Recording::default()).unwrap();
    record(&mut recorder, 1000);
    recorder.finish().unwrap();
    let verdict = verdict(&path);
    assert!(verdict.violations.is_empty());
    assert_eq!((verdict.judged, verdict.lines), (1000, 1 + 8 * 1000));
}

#[test]
fn recording_starts_with_its_header_and_replaces() {
    let (_folder, path) = folder();
    fs::write(&path, "an older trace, longer than the header ".repeat(9)).unwrap();
    let _recorder = Recorder::create(&path, &header(), Recording::default()).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), format!("{}\n", header()));
}

#[test]
fn a_dropped_recorder_leaves_a_whole_trace() {
    for gzip in [false, true] {
        let (_folder, path) = folder();
        let recording = Recording { gzip, ..Recording::default() };
        let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
        record(&mut recorder, 3);
        drop(recorder);
        assert_eq!(verdict(&path).judged, 3);
        assert_eq!(fs::read(&path).unwrap().starts_with(b"\x1f\x8b"), gzip);
    }
}

#[test]
fn a_panic_leaves_a_whole_trace() {
    for gzip in [false, true] {
        let (_folder, path) = folder();
        let recording = Recording { gzip, ..Recording::default() };
        let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
        let panicked = catch_unwind(AssertUnwindSafe(move || {
            record(&mut recorder, 3);
            panic!("the operator's own bug");
        }));
        assert!(panicked.is_err());
        assert_eq!(verdict(&path).judged, 3);
    }
}

#[test]
fn a_killed_process_leaves_whole_inputs() {
    let (_folder, path) = folder();
    let mut recorder = Recorder::create(&path, &header(), Recording::default()).unwrap();
    record(&mut recorder, 1000);
    // Leaves what a kill would leave: nothing more is written.
    std::mem::forget(recorder);
    let verdict = verdict(&path);
    assert!(verdict.violations.is_empty(), "{verdict}");
    assert!(verdict.judged > 100);
}

#[test]
fn a_flushed_recording_can_be_read_along() {
    for gzip in [false, true] {
        let (_folder, path) = folder();
        let recording = Recording { gzip, ..Recording::default() };
        let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
        record(&mut recorder, 2);
        recorder.flush();
        let bytes = fs::read(&path).unwrap();
        let mut reader =
            fuseline_traces::Events::new("trace", unpack(&bytes[..]).unwrap()).unwrap();
        for _ in 0..16 {
            assert!(reader.next_event().unwrap().is_some());
        }
    }
}

#[test]
fn parts_have_headers_and_join_to_the_trace() {
    for gzip in [false, true] {
        let (folder, path) = folder();
        let whole = folder.path().join("whole.jsonl");
        let mut recorder = Recorder::create(&whole, &header(), Recording::default()).unwrap();
        record(&mut recorder, 100);
        recorder.finish().unwrap();

        let recording = Recording { rotate: Some(4096), gzip, ..Recording::default() };
        let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
        record(&mut recorder, 100);
        recorder.finish().unwrap();

        let head = format!("{}\n", header());
        let mut joined = head.clone();
        let parts = (0..).map(|part| Recorder::part(&path, part)).take_while(|part| part.exists());
        let parts: Vec<_> = parts.collect();
        assert!(parts.len() > 5);
        for (place, part) in parts.iter().enumerate() {
            let mut text = String::new();
            let packed = fs::read(part).unwrap();
            std::io::Read::read_to_string(&mut unpack(&packed[..]).unwrap(), &mut text).unwrap();
            joined += text.strip_prefix(&head).expect("each part has the header");
            // A part is full when the next one begins, and exceeds its size by at most an input
            // with its decisions.
            assert!(text.len() < 4096 + 300);
            assert!(text.len() >= 4096 || place + 1 == parts.len());
        }
        assert_eq!(joined, fs::read_to_string(&whole).unwrap());
    }
}

#[test]
fn parts_are_numbered_before_the_first_dot() {
    let part = |path: &str, part| Recorder::part(Path::new(path), part);
    assert_eq!(part("a/trace.jsonl", 0), Path::new("a/trace.jsonl"));
    assert_eq!(part("a/trace.jsonl", 1), Path::new("a/trace.1.jsonl"));
    assert_eq!(part("a.b/trace.jsonl.gz", 12), Path::new("a.b/trace.12.jsonl.gz"));
    assert_eq!(part("trace", 1), Path::new("trace.1"));
    assert_eq!(part(".trace", 1), Path::new(".trace.1"));
}

#[test]
fn a_file_that_cannot_be_made_is_an_error_at_once() {
    let (folder, _) = folder();
    let path = folder.path().join("no/such/folder.jsonl");
    assert!(Recorder::create(path, &header(), Recording::default()).is_err());
}

#[test]
fn error_waits_for_finish_and_trace_stays_whole() {
    let (_folder, path) = folder();
    // The second part cannot be created, because a folder is in its place.
    fs::create_dir(Recorder::part(&path, 1)).unwrap();
    let recording = Recording { rotate: Some(1000), ..Recording::default() };
    let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
    record(&mut recorder, 1000);
    assert!(recorder.finish().is_err());
    let verdict = verdict(&path);
    assert!(verdict.violations.is_empty() && verdict.judged > 0, "{verdict}");
}

/// Runs a test of this file again in a process that may write no file of more than 16 KiB. Like a
/// full disk, it takes part of one write and refuses the next.
fn on_a_small_disk(test: &str) {
    let ended = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 32; exec \"$@\"", "sh"])
        .arg(env::current_exe().unwrap())
        .arg(test)
        .env(SMALL_DISK, "")
        .output()
        .unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stdout));
}

/// The environment variable that marks such a process.
const SMALL_DISK: &str = "RECORD_TEST_SMALL_DISK";

#[test]
fn full_disk_leaves_whole_inputs() {
    if env::var_os(SMALL_DISK).is_none() {
        return on_a_small_disk("full_disk_leaves_whole_inputs");
    }
    for (gzip, every_input, least) in
        [(false, false, 16_000), (false, true, 16_000), (true, false, 8000)]
    {
        let (_folder, path) = folder();
        let recording = Recording { gzip, every_input, ..Recording::default() };
        let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
        record(&mut recorder, 4000);
        assert_eq!(recorder.error().unwrap().kind(), ErrorKind::FileTooLarge);
        assert_eq!(recorder.finish().unwrap_err().kind(), ErrorKind::FileTooLarge);
        let size = fs::metadata(&path).unwrap().len();
        assert!((least..=16_384).contains(&size), "{size}");
        let verdict = verdict(&path);
        assert!(verdict.violations.is_empty() && verdict.judged > 30, "{verdict}");
    }
}

#[test]
fn writes_each_input_when_the_next_one_comes() {
    for (gzip, sync) in [(false, false), (false, true), (true, false)] {
        let (_folder, path) = folder();
        let recording = Recording { gzip, every_input: true, sync, rotate: None };
        let mut recorder = Recorder::create(&path, &header(), recording).unwrap();
        record(&mut recorder, 20);
        // Leaves what a kill would leave: nothing more is written.
        std::mem::forget(recorder);
        let verdict = verdict(&path);
        assert!(verdict.violations.is_empty(), "{verdict}");
        // Everything except the last input, which is the tick that fires the last timer.
        assert_eq!((verdict.judged, verdict.lines), (20, 1 + 8 * 20 - 3));
    }
}
