//! Tests the reader: what a whole file may not contain, and that it stores one line at a time.

use std::io::{self, BufRead, BufReader, Read, Write};

use flate2::Compression;
use flate2::write::GzEncoder;
use fuseline_traces::{Decision, Defect, Event, Events, Input, LINE, ReadError, unpack};

const HEADER: &str = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}";
const TICK: &str = "{\"ev\":\"tick\",\"at\":1}";

/// Reads to the end in small portions.
fn read(trace: &[u8]) -> Result<Vec<Event>, ReadError> {
    let mut reader = Events::new("a.jsonl", BufReader::with_capacity(7, trace))?;
    let mut events = Vec::new();
    while let Some(event) = reader.next_event()? {
        events.push(event);
    }
    Ok(events)
}

fn error(trace: &[u8]) -> String {
    read(trace).expect_err("it should be refused").to_string()
}

#[test]
fn events_come_with_their_line_and_its_bytes() {
    let spaced = " { \"at\":2 , \"x\":[], \"ev\":\"tick\"} ";
    let trace = format!("{HEADER}\n{TICK}\n{spaced}\n");
    let mut reader = Events::new("a.jsonl", trace.as_bytes()).unwrap();
    assert_eq!((reader.line(), reader.raw()), (1, HEADER.as_bytes()));
    assert_eq!(reader.header().window, 1);
    assert_eq!(reader.next_event().unwrap(), Some(Event::Input(Input::Tick { at: 1 })));
    assert_eq!((reader.line(), reader.raw()), (2, TICK.as_bytes()));
    assert_eq!(reader.next_event().unwrap(), Some(Event::Input(Input::Tick { at: 2 })));
    assert_eq!((reader.line(), reader.raw()), (3, spaced.as_bytes()));
    assert_eq!(reader.next_event().unwrap(), None);
    assert_eq!(reader.line(), 3);
}

#[test]
fn a_trace_without_a_header_is_refused() {
    assert_eq!(error(b""), "a.jsonl:1:1: the trace is empty; its first line must be a header");
    assert_eq!(
        error(format!("{TICK}\n").as_bytes()),
        "a.jsonl:1:1: the first line is an event, but a trace begins with a header: {\"fuseline\":1,…}"
    );
}

#[test]
fn a_second_header_is_refused() {
    let trace = format!("{HEADER}\n{TICK}\n{HEADER}\n{TICK}\n");
    assert_eq!(
        error(trace.as_bytes()),
        "a.jsonl:3:1: the file has a second header; put each trace in its own file"
    );
}

#[test]
fn a_last_line_without_its_end_is_refused() {
    let end = "the last line does not end in LF; it may be cut short";
    assert_eq!(error(HEADER.as_bytes()), format!("a.jsonl:1:38: {end}"));
    assert_eq!(error(format!("{HEADER}\n{TICK}").as_bytes()), format!("a.jsonl:2:21: {end}"));
    assert_eq!(error(format!("{HEADER}\n ").as_bytes()), format!("a.jsonl:2:2: {end}"));
}

#[test]
fn errors_of_a_line_bear_file_line_and_column() {
    let with = |line: &str| error(format!("{HEADER}\n{TICK}\n{line}\n").as_bytes());
    assert_eq!(with(""), "a.jsonl:3:1: the line is blank; remove it");
    assert_eq!(
        with(&format!("{TICK}\r")),
        "a.jsonl:3:21: the line ends in CR LF; end it in LF alone"
    );
    assert_eq!(
        with(&format!("\u{feff}{TICK}")),
        "a.jsonl:3:1: the line begins with a byte-order mark; remove it"
    );
    assert_eq!(
        error(format!("\u{feff}{HEADER}\n").as_bytes()),
        "a.jsonl:1:1: the line begins with a byte-order mark; remove it"
    );
    let mut bytes = format!("{HEADER}\n{TICK}\n").into_bytes();
    bytes.extend_from_slice(b"{\"ev\":\"t\xffck\"}\n");
    assert_eq!(error(&bytes), "a.jsonl:3:9: invalid UTF-8; a trace is UTF-8 text");
}

#[test]
fn reads_64_kib_lines_and_refuses_longer_ones() {
    let line = |len: usize| {
        let rest = "{\"ev\":\"tick\",\"at\":1,\"x\":\"\"}".len();
        format!("{{\"ev\":\"tick\",\"at\":1,\"x\":\"{}\"}}", "x".repeat(len - rest))
    };
    assert_eq!(line(LINE).len(), 65_536);
    let trace = |len| format!("{HEADER}\n{}\n{TICK}\n", line(len));
    assert_eq!(read(trace(LINE).as_bytes()).unwrap().len(), 2);
    assert_eq!(
        error(trace(LINE + 1).as_bytes()),
        "a.jsonl:2:65537: the line is longer than 64 KiB, the most that a trace allows"
    );
    // The error about the length comes before any other error of the line.
    assert!(
        error(format!("{HEADER}\n{}", line(LINE + 1)).as_bytes()).contains("longer than 64 KiB")
    );
}

#[test]
fn an_endless_line_is_refused_without_being_held() {
    let endless = BufReader::new(io::repeat(b' '));
    let mut requested = Counted { inner: endless, taken: 0 };
    let error = Events::new("a.jsonl", &mut requested).expect_err("it never ends");
    assert!(matches!(error.defect, Defect::TooLong));
    assert_eq!(requested.taken, LINE + 1);
}

#[test]
fn reports_read_errors_but_not_interruptions() {
    let trace = format!("{HEADER}\n{TICK}\n");
    let interrupted = Faulty { faults: vec![io::ErrorKind::Interrupted] };
    let mut reader =
        Events::new("a.jsonl", BufReader::new(trace.as_bytes().chain(interrupted))).unwrap();
    assert!(reader.next_event().unwrap().is_some());
    assert!(reader.next_event().unwrap().is_none());

    let broken = Faulty { faults: vec![io::ErrorKind::TimedOut] };
    let mut reader =
        Events::new("a.jsonl", BufReader::new(trace.as_bytes().chain(broken))).unwrap();
    assert!(reader.next_event().unwrap().is_some());
    let error = reader.next_event().expect_err("the source broke");
    assert_eq!(error.to_string(), "a.jsonl:3:1: timed out");
}

#[test]
fn observed_request_has_due_or_deadline() {
    const HEAD: &str = r#"{"ev":"request","t":1,"p":2"#;
    let read = |rest: &str, observed: bool| {
        let trace = format!("{HEADER}\n{HEAD}{rest}}}\n");
        let make = if observed { Events::observed } else { Events::new };
        let mut reader = make("a.jsonl", trace.as_bytes()).unwrap();
        reader.next_event().map_err(|error| error.to_string())
    };
    let due = |at, due| Event::Decision(Decision::Request { at, t: 1, p: 2, due });
    assert_eq!(read(r#","deadline":5,"at":7"#, true), Ok(Some(due(7, 12))));
    assert_eq!(read(r#","at":7,"due":9"#, true), Ok(Some(due(7, 9))));
    let never = format!(r#","at":7,"deadline":{}"#, u64::MAX);
    assert_eq!(read(&never, true), Ok(Some(due(7, u64::MAX))));
    for (rest, observed, error) in [
        (r#","at":7,"deadline":5,"due":12"#, true, "key \"deadline\" is not allowed"),
        (r#","at":7"#, true, "key \"due\" is missing"),
        (r#","deadline":5"#, true, "key \"at\" is missing"),
        (r#","at":7,"deadline":5"#, false, "key \"deadline\" is not allowed"),
    ] {
        let reported = read(rest, observed).expect_err(rest);
        assert!(reported.contains(error), "{reported}");
    }
}

#[test]
fn packed_and_plain_traces_are_read_alike() {
    let trace = format!("{HEADER}\n{TICK}\n");
    let mut packed = Vec::new();
    for line in trace.split_inclusive('\n') {
        // Each line is a gzip member of its own, as if files were concatenated.
        let mut member = GzEncoder::new(Vec::new(), Compression::fast());
        member.write_all(line.as_bytes()).unwrap();
        packed.extend(member.finish().unwrap());
    }
    for bytes in [trace.as_bytes(), &packed] {
        let mut reader = Events::new("a.jsonl", unpack(bytes).unwrap()).unwrap();
        assert!(reader.next_event().unwrap().is_some());
        assert!(reader.next_event().unwrap().is_none());
    }
    let cut = &packed[..packed.len() - 9];
    let mut reader = Events::new("a.jsonl", unpack(cut).unwrap()).unwrap();
    let error = (0..2).find_map(|_| reader.next_event().err()).expect("it is cut short");
    assert!(matches!(error.defect, Defect::Io(_)));
}

/// Counts the bytes that are taken.
#[derive(Debug)]
struct Counted<R> {
    inner: R,
    taken: usize,
}

impl<R: BufRead> Read for Counted<R> {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        unreachable!("lines are read from the buffer")
    }
}

impl<R: BufRead> BufRead for Counted<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, len: usize) {
        self.taken += len;
        self.inner.consume(len);
    }
}

/// Fails on purpose, then ends.
struct Faulty {
    faults: Vec<io::ErrorKind>,
}

impl Read for Faulty {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        self.faults.pop().map_or(Ok(0), |kind| Err(kind.into()))
    }
}
