//! `fuseline convert`, run as a user runs it.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Write};
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use tempfile::{TempDir, tempdir};

const HEADER: &str = r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"name":"west","limit":31}]}"#;

const ROWS: &str = "\
stamp_ms,kind,t,p,deadline,comment
1,open,7,,,a row an event
1.5,send,7,1,50,
40,response,7,0,,\"local, at last\"
51.500001,emit,7,0,,
";

const TRACE: &str = r#"{"fuseline":1,"window":4,"commit":"eager","clouds":[{"p":1,"name":"west","limit":31}]}
{"ev":"open","at":1000000,"t":7}
{"ev":"request","at":1500000,"t":7,"p":1,"due":51500000}
{"ev":"result","at":40000000,"t":7,"p":0}
{"ev":"emit","at":51500001,"t":7,"p":0}
"#;

/// A folder with a header and these rows.
fn folder(rows: &str) -> TempDir {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("header.jsonl"), format!("{HEADER}\n")).unwrap();
    fs::write(dir.path().join("events.csv"), rows).unwrap();
    dir
}

fn convert(dir: &TempDir, more: &[&str]) -> std::process::Output {
    let path = |name: &str| dir.path().join(name).display().to_string();
    let (header, events) = (path("header.jsonl"), path("events.csv"));
    let columns = ["--column", "at=stamp_ms,ev=kind", "--event", "send=request,response=result"];
    let start = ["convert", "--header", &header, "--unit", "ms", &events];
    run(&[&start[..], &columns, more].concat(), "")
}

#[test]
fn rows_become_a_trace_that_is_judged() {
    let converted = convert(&folder(ROWS), &[]);
    assert_eq!((out(&converted), err(&converted)), (TRACE, ""));
    let check = ["check", "--observed", "--tolerance", "1us", "--lateness", "0s"];
    let judged = run(&check, TRACE);
    assert!(out(&judged).contains(": no violation found, "), "{}", out(&judged));
}

#[test]
fn rows_are_put_in_order_with_a_note() {
    let mut rows: Vec<&str> = ROWS.lines().collect();
    rows.swap(2, 4);
    let dir = folder(&rows.join("\n"));
    let noted = convert(&dir, &[]);
    assert_eq!(out(&noted), TRACE);
    let note = "events that came after later ones and were sorted: 2 (first line 4: 11.5 ms before line 3)";
    assert!(err(&noted).contains(note), "{}", err(&noted));
    let sorted = convert(&dir, &["--sort"]);
    assert_eq!((out(&sorted), err(&sorted)), (TRACE, ""));
}

/// D10: a line that leaves its place stands among another's decisions.
#[test]
fn rows_of_one_instant_keep_their_order_when_they_are_sorted() {
    let row = |at: u64| format!("{at},tick");
    let opens = |t: u64| format!("2,open,{t}");
    let mut rows = vec!["at,ev,t".to_owned()];
    let mut lines = vec![TRACE.lines().next().unwrap().to_owned()];
    rows.extend((0..64).flat_map(|t| [opens(t), row(1) + ","]));
    lines.extend((0..64).map(|_| r#"{"ev":"tick","at":1}"#.to_owned()));
    lines.extend((0..64).map(|t| format!(r#"{{"ev":"open","at":2,"t":{t}}}"#)));
    let dir = folder(&rows.join("\n"));
    let [header, events] = ["header.jsonl", "events.csv"].map(|name| dir.path().join(name));
    let [header, events] = [&header, &events].map(|path| path.to_str().unwrap());
    let sorted = run(&["convert", "--sort", "--header", header, events], "");
    assert_eq!(out(&sorted).lines().collect::<Vec<_>>(), lines, "{}", err(&sorted));
}

/// D10.
#[test]
fn a_row_that_is_none_is_reported_with_its_line_and_writes_nothing() {
    for (row, line, printed) in [
        ("40,answer,7,0,,", 4, "unknown event \"answer\""),
        ("40,result,7,,,", 4, "column \"p\" of this result is empty"),
        (
            "soon,result,7,0,,",
            4,
            "column \"stamp_ms\": \"soon\" is not an instant; write a number of ms,",
        ),
        ("40,result,-7,0,,", 4, "column \"t\": \"-7\" is a negative number"),
        ("40,result", 4, "2 cells, where the first row has 6"),
    ] {
        let rows: Vec<&str> = ROWS.lines().take(3).chain([row]).collect();
        let dir = folder(&rows.join("\n"));
        let output = dir.path().join("trace.jsonl");
        fs::write(&output, "as it was").unwrap();
        let refused = convert(&dir, &["--force", "-o", output.to_str().unwrap()]);
        assert_eq!(refused.status.code(), Some(2), "{row}");
        let location = format!("events.csv:{line}: ");
        assert!(
            err(&refused).contains(&location) && err(&refused).contains(printed),
            "{}",
            err(&refused)
        );
        assert_eq!(err(&refused).lines().count(), 1);
        assert_eq!(fs::read_to_string(&output).unwrap(), "as it was");
    }
    let dir = folder(ROWS);
    let header = dir.path().join("header.jsonl").display().to_string();
    let unnamed = run(&["convert", "--from", "csv", "--header", &header, "-"], "a,b\n1,2\n");
    assert!(
        err(&unnamed).contains("stdin:2: this row has no key \"ev\"; name it with"),
        "{}",
        err(&unnamed)
    );
    let headless = run(&["convert", "--from", "csv", "-"], "at,ev\n1,tick\n");
    assert!(err(&headless).contains("give --header FILE"), "{}", err(&headless));
    assert_eq!(run(&["convert", "what"], "").status.code(), Some(2));
}

/// D10.
#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_half_written() {
    let dir = folder(ROWS);
    let names = || fs::read_dir(dir.path()).unwrap().count();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let (header, output) = (path("header.jsonl"), path("trace.jsonl"));
    let args = ["convert", "--from", "csv", "--header", &header, "-o", &output, "-"];
    let mut child = fuseline(&args).stdin(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    input.write_all(b"at,ev\n1,tick\n").unwrap();
    let start = Instant::now();
    while names() == 2 && start.elapsed() < Duration::from_secs(20) {
        thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(names(), 3, "it writes");
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(names(), 2);
    drop(input);
}

/// An MCAP file with a message a line, and a stranger's beside each.
fn recording(compression: Option<Compression>, lines: &[(u64, &str)]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(compression);
    let mut writer = options.create(&mut bytes).unwrap();
    let none = BTreeMap::new();
    let channel = writer.add_channel(0, "/fuseline/trace", "json", &none).unwrap();
    let stranger = writer.add_channel(0, "/camera", "cdr", &none).unwrap();
    for (at, line) in lines {
        for (channel_id, data) in [(stranger, "raw"), (channel, *line)] {
            let header =
                MessageHeader { channel_id, sequence: 0, log_time: *at, publish_time: *at };
            writer.write_to_known_channel(&header, data.as_bytes()).unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// The lines that a recorder wrote, each with its log time.
const LINES: [(u64, &str); 5] = [
    (0, HEADER),
    (1_000_000, r#"{"ev":"open","t":7}"#),
    (0, r#"{"ev":"request","at":1500000,"t":7,"p":1,"deadline":50000000}"#),
    (40_000_000, r#" {"t":7,"ev":"result","p":0}"#),
    (51_500_001, r#"{"ev":"emit","t":7,"p":0}"#),
];

/// D10.
#[test]
fn a_recording_without_a_header_loses_no_event() {
    let dir = tempdir().unwrap();
    let [path, header] = ["drive.mcap", "header.jsonl"].map(|name| dir.path().join(name));
    fs::write(&path, recording(None, &LINES[1..])).unwrap();
    fs::write(&header, format!("{HEADER}\n")).unwrap();
    let [path, header] = [&path, &header].map(|path| path.to_str().unwrap());
    let converted = run(&["convert", "--header", header, path], "");
    assert_eq!((out(&converted), err(&converted)), (TRACE, ""));
    let refused = run(&["convert", path], "");
    assert!(err(&refused).contains("give --header FILE"), "{}", err(&refused));
}

#[test]
fn messages_become_a_trace_however_they_are_packed() {
    for compression in [None, Some(Compression::Zstd), Some(Compression::Lz4)] {
        let dir = tempdir().unwrap();
        let path = dir.path().join("drive.mcap");
        fs::write(&path, recording(compression, &LINES)).unwrap();
        let converted = run(&["convert", path.to_str().unwrap()], "");
        assert_eq!((out(&converted), err(&converted)), (TRACE, ""));

        // A header of one's own goes before the recording's.
        let header = dir.path().join("header.jsonl");
        fs::write(&header, format!("{}\n", HEADER.replace("west", "east"))).unwrap();
        let args = ["convert", "--header", header.to_str().unwrap(), path.to_str().unwrap()];
        assert_eq!(out(&run(&args, "")), TRACE.replace("west", "east"));
    }
}

#[test]
fn a_message_that_is_none_and_a_file_cut_short_are_reported() {
    let refused = |bytes: &[u8], more: &[&str]| {
        let dir = tempdir().unwrap();
        let path = dir.path().join("drive.mcap");
        fs::write(&path, bytes).unwrap();
        let refused = run(&[&["convert", path.to_str().unwrap()], more].concat(), "");
        assert_eq!(refused.status.code(), Some(2));
        assert_eq!(err(&refused).lines().count(), 1, "{}", err(&refused));
        err(&refused).to_owned()
    };
    let lines = [(0, HEADER), (1, r#"{"ev":"open","t":7}"#), (2, r#"{"ev":"open"}"#)];
    let whole = recording(None, &lines);
    let printed = refused(&whole, &[]);
    assert!(printed.contains("drive.mcap: message 3: column"), "{printed}");
    assert!(refused(&whole, &["--topic", "/none"]).contains("there is no message on topic /none"));
    assert!(refused(&whole, &["--topic", "/camera"]).contains("is encoded as \"cdr\""));
    let half = recording(Some(Compression::Zstd), &lines[..2]);
    assert!(refused(&half[..half.len() / 2], &[]).contains("drive.mcap: "));
    assert!(refused(b"no recording at all", &[]).contains("drive.mcap: "));
}
