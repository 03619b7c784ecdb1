//! Drawn logs: a clean run of a correct operator, in a drawn shape, with one drawn kind of dirt.
//! Each is read rightly, or it is refused or noted with its place. `FUSELINE_DIRTY_LOGS=400` draws
//! more than the default.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::io::Write as _;
use std::path::Path;

use crate::common::{err, out, run};
use flate2::Compression;
use flate2::write::GzEncoder;
use fuseline_testkit::Rng;
use fuseline_traces::{Cloud, Commit, Decision, ExpectedDecisions, Header, Input, Reference};
use serde_json::{Value, json};

const MS: u64 = 1_000_000;
const START: u64 = 1_795_629_600_000_000_000;
const DEADLINE: u64 = 80 * MS;
/// The number of logs that are drawn if nobody says how many.
const COUNT: u64 = 130;

/// One message of a run, with the instants of what became of it.
#[derive(Clone, Default, Debug)]
struct Frame {
    t: u64,
    open: u64,
    sent: u64,
    done: Option<u64>,
    failed: Option<u64>,
    own: u64,
    out: Option<(u64, u64)>,
    missed: Option<u64>,
}

/// Returns a run of the reference machine: messages come every 200 ms, and the cloud answers in
/// time, late, or not at all.
fn clean_run(rng: &mut Rng, first: u64, start: u64) -> Vec<Frame> {
    let mut frames: Vec<Frame> = Vec::new();
    for number in 0..rng.u64(5..12) {
        let open = start + number * 200 * MS + rng.u64(0..900) * 1_000;
        let sent = open + MS + rng.u64(0..900) * 1_000;
        let answer = sent + rng.u64(10..150) * MS + rng.u64(1..900) * 1_000;
        let mut frame = Frame { t: first + number, open, sent, ..Frame::default() };
        frame.own = open + rng.u64(20..60) * MS + rng.u64(1..900) * 1_000;
        match rng.u64(0..5) {
            0 => frame.failed = Some(answer.min(sent + DEADLINE - MS)),
            1 => {}
            _ => frame.done = Some(answer),
        }
        frames.push(frame);
    }
    let mut inputs = Vec::new();
    for Frame { t, open, sent, done, failed, own, .. } in frames.clone() {
        inputs.push(Input::Open { at: open, t, deadline: None });
        inputs.push(Input::Offer { at: sent, t, p: 1, deadline: DEADLINE, backlog: 0 });
        inputs.push(Input::Result { at: own, t, p: 0 });
        inputs.push(Input::Tick { at: sent + DEADLINE });
        inputs.extend(done.map(|at| Input::Result { at, t, p: 1 }));
        inputs.extend(failed.map(|at| Input::Fail { at, t, p: 1 }));
    }
    inputs.sort_by_key(Input::at);
    let (mut reference, mut decisions) = (Reference::new(&header()), ExpectedDecisions::new());
    for input in &inputs {
        reference.apply(input, &mut decisions);
        for (decision, _) in decisions.drain(..) {
            let of = |t: u64| usize::try_from(t - first).unwrap();
            match decision {
                Decision::Emit { at, t, p } => frames[of(t)].out = Some((at, p)),
                Decision::Miss { at, t } => frames[of(t)].missed = Some(at),
                _ => {}
            }
        }
    }
    frames
}

fn header() -> Header {
    let west = Cloud { p: 1, name: Some("west".to_owned()), limit: 31, resume: 30 };
    Header { operator: None, window: 16, commit: Commit::Eager, clouds: vec![west] }
}

/// An event of a run: its instant, its name, its message, its source, its deadline.
type Fact = (u64, &'static str, u64, Option<u64>, Option<u64>);

fn facts(frames: &[Frame]) -> Vec<Fact> {
    let mut facts = Vec::new();
    for frame in frames {
        let t = frame.t;
        facts.push((frame.open, "open", t, None, None));
        facts.push((frame.sent, "request", t, Some(1), Some(DEADLINE)));
        facts.push((frame.own, "result", t, Some(0), None));
        facts.extend(frame.done.map(|at| (at, "result", t, Some(1), None)));
        facts.extend(frame.failed.map(|at| (at, "fail", t, Some(1), None)));
        facts.extend(frame.out.map(|(at, p)| (at, "emit", t, Some(p), None)));
        facts.extend(frame.missed.map(|at| (at, "miss", t, None, None)));
    }
    facts.sort_by_key(|(at, ..)| *at);
    facts
}

/// The facts of a converted trace.
fn read_facts(trace: &str) -> Vec<Fact> {
    let events = ["open", "request", "result", "fail", "emit", "miss"];
    let fact = |line: &str| {
        let line: Value = serde_json::from_str(line).unwrap();
        let ev = *events.iter().find(|ev| line["ev"] == **ev).unwrap();
        let at = line["at"].as_u64().unwrap();
        let due = line["due"].as_u64().map(|due| due - at);
        (at, ev, line["t"].as_u64().unwrap(), line["p"].as_u64(), due)
    };
    trace.lines().skip(1).map(fact).collect()
}

/// Returns whether two traces say the same, up to another beginning of time, other numbers of
/// messages, and a microsecond of rounding.
fn is_same(found: &[Fact], clean: &[Fact]) -> bool {
    let (Some(one), Some(other)) = (found.first(), clean.first()) else { return false };
    let (first, begin) = (one.2.min(other.2), other.0);
    let near = |found: u64, clean: u64| found.abs_diff(clean) <= 1_000;
    let mut sorted: Vec<Fact> = found.to_vec();
    // Within a microsecond rounding may change the order.
    let key = |fact: &Fact, first: u64| (fact.2 - first, fact.1, fact.3);
    let mut clean: Vec<Fact> = clean.to_vec();
    let (own, others) = (found.iter().map(|it| it.2).min(), clean.iter().map(|it| it.2).min());
    sorted.sort_by_key(|fact| key(fact, own.unwrap_or(first)));
    clean.sort_by_key(|fact| key(fact, others.unwrap_or(first)));
    found.len() == clean.len()
        && sorted.iter().zip(&clean).all(|(found, clean)| {
            let at = near(found.0 - one.0, clean.0 - begin);
            let due = match (found.4, clean.4) {
                (Some(found), Some(clean)) => near(found, clean),
                (found, clean) => found == clean,
            };
            let (own, others) = (own.unwrap_or(0), others.unwrap_or(0));
            at && due && key(found, own) == key(clean, others)
        })
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Shape {
    CsvEvents,
    JsonEvents,
    CsvFrames,
    JsonFrames,
    Spans,
}

/// The required outcome for a log.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Fate {
    /// It is read rightly.
    Read,
    /// It is read rightly, with a note.
    ReadWithNote,
    /// It is read otherwise, with a note that names the place.
    Noted,
    Refused,
}

/// A log with the options that a user gives, and what must come of it.
struct DirtyLog {
    name: &'static str,
    bytes: Vec<u8>,
    options: Vec<String>,
    fate: Fate,
    /// A part of the message about the dirt.
    says: &'static str,
    /// Options by which it is read rightly after all.
    remedy: &'static [&'static str],
}

/// The style in which a log of rows writes values.
struct Style {
    separator: char,
    time: fn(u64) -> String,
    id: fn(u64) -> String,
    deadline: fn(usize) -> String,
    /// True if times and ids are texts in JSON.
    is_quoted: bool,
    unit: &'static [&'static str],
}

fn plain() -> Style {
    Style {
        separator: ',',
        time: |at| format!("{}.{:09}", at / 1_000_000_000, at % 1_000_000_000),
        id: |t| t.to_string(),
        deadline: |_| "80".to_owned(),
        is_quoted: false,
        unit: &["--unit", "s", "--unit", "deadline=ms"],
    }
}

fn iso(at: u64) -> String {
    let instant = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(at);
    humantime::format_rfc3339_nanos(instant).to_string().trim_end_matches('Z').replace('T', " ")
}

/// The rows of a log by their columns.
fn rows(shape: Shape, frames: &[Frame], style: &Style) -> Vec<Vec<(&'static str, String)>> {
    let time = |at: Option<u64>| at.map_or_else(String::new, style.time);
    let source = |p: u64| if p == 0 { "local" } else { "west" }.to_owned();
    if matches!(shape, Shape::CsvFrames | Shape::JsonFrames) {
        let row = |(number, frame): (usize, &Frame)| {
            vec![
                ("frame", (style.id)(frame.t)),
                ("recv", (style.time)(frame.open)),
                ("sent", (style.time)(frame.sent)),
                ("budget", (style.deadline)(number)),
                ("done", time(frame.done)),
                ("failed", time(frame.failed)),
                ("own", (style.time)(frame.own)),
                ("out", time(frame.out.map(|(at, _)| at))),
                ("winner", frame.out.map_or_else(String::new, |(_, p)| source(p))),
                ("given_up", time(frame.missed)),
            ]
        };
        return frames.iter().enumerate().map(row).collect();
    }
    let row = |(number, (at, ev, t, p, due)): (usize, Fact)| {
        let budget = due.map_or_else(String::new, |_| (style.deadline)(number));
        vec![
            ("stamp", (style.time)(at)),
            ("what", format!("has_{ev}")),
            ("frame", (style.id)(t)),
            ("source", p.map_or_else(String::new, source)),
            ("budget", budget),
        ]
    };
    facts(frames).into_iter().enumerate().map(row).collect()
}

fn options(shape: Shape, style: &Style) -> Vec<String> {
    let columns = "at=stamp,ev=what,t=frame,p=source,deadline=budget";
    let events = "has_open=open,has_request=request,has_result=result,has_fail=fail,has_emit=emit,has_miss=miss";
    let frame = "t=frame,open=recv,west.request=sent,west.deadline=budget,west.result=done,west.fail=failed,local.result=own,\
                 emit=out,by=winner,miss=given_up";
    let named = match shape {
        Shape::CsvEvents | Shape::JsonEvents => vec!["--column", columns, "--event", events],
        Shape::CsvFrames | Shape::JsonFrames => vec!["--frame", frame],
        Shape::Spans => {
            vec!["--span", "message=decide,local=plan", "--attribute", "t=frame.id,by=winner"]
        }
    };
    let separator = style.separator.to_string();
    let all = named.into_iter().chain(style.unit.iter().copied()).map(str::to_owned);
    all.chain(
        (shape != Shape::Spans)
            .then(|| vec!["--separator".to_owned(), separator])
            .into_iter()
            .flatten(),
    )
    .collect()
}

/// The lines of a log of rows.
fn lines(shape: Shape, rows: &[Vec<(&'static str, String)>], style: &Style) -> Vec<String> {
    if matches!(shape, Shape::CsvEvents | Shape::CsvFrames) {
        let separator = style.separator.to_string();
        let names = rows[0].iter().map(|(name, _)| *name).collect::<Vec<_>>().join(&separator);
        let cells = |row: &Vec<(&str, String)>| {
            row.iter().map(|(_, cell)| cell.as_str()).collect::<Vec<_>>().join(&separator)
        };
        return [names].into_iter().chain(rows.iter().map(cells)).collect();
    }
    let value = |(name, cell): &(&str, String)| {
        let is_text = style.is_quoted || ["what", "source", "winner"].contains(name);
        let cell = match cell.as_str() {
            "" => "null".to_owned(),
            cell if is_text => format!("\"{cell}\""),
            cell => cell.to_owned(),
        };
        format!("\"{name}\": {cell}")
    };
    let object = |row: &Vec<(&str, String)>| {
        format!("{{{}}}", row.iter().map(value).collect::<Vec<_>>().join(", "))
    };
    rows.iter().map(object).collect()
}

const KINDS: u64 = 25;

/// A log of rows with a kind of dirt.
fn dirty_rows(rng: &mut Rng, shape: Shape, kind: u64, frames: &[Frame]) -> DirtyLog {
    let is_csv = matches!(shape, Shape::CsvEvents | Shape::CsvFrames);
    let mut log = DirtyLog {
        name: if is_csv { "log.csv" } else { "log.jsonl" },
        bytes: Vec::new(),
        options: Vec::new(),
        fate: Fate::Read,
        says: "",
        remedy: &[],
    };
    let style = dirty_style(kind, &mut log);
    let mut rows = rows(shape, frames, &style);
    soil_rows(rng, shape, kind, &mut rows, &mut log);
    let mut text = lines(shape, &rows, &style);
    log.options = options(shape, &style);
    soil_lines(rng, kind, &mut text, &mut log);
    if matches!(kind, 14 | 15) {
        let again = lines(shape, &self::rows(shape, &run_again(kind, frames), &style), &style);
        text.extend(again.into_iter().skip(usize::from(is_csv)));
        (log.fate, log.says) = (Fate::Refused, "the log restarts here");
    }
    pack(kind, &text, &mut log);
    log
}

/// Returns how values are written where that is the dirt.
fn dirty_style(kind: u64, log: &mut DirtyLog) -> Style {
    let mut style = plain();
    match kind {
        1 => {
            style.time = |at| {
                let seconds = u32::try_from((at - START + MS) / 1000).unwrap();
                format!("{:?}", f64::from(seconds) / 1e6 + 1e-12)
            };
            (log.fate, log.says) = (Fate::ReadWithNote, "rounded to a nanosecond");
        }
        2 => style.time = |at| format!("{}e-9", at - START),
        3 => {
            style.separator = ';';
            style.is_quoted = true;
            style.time = |at| format!("{}", at - START).as_str().to_owned() + ",25";
            style.unit = &["--unit", "ns", "--unit", "deadline=ms"];
            (log.fate, log.says) = (Fate::ReadWithNote, "with a decimal comma");
        }
        4 => {
            style.is_quoted = true;
            style.time = |at| iso(at) + " UTC";
        }
        5 => {
            style.is_quoted = true;
            style.time = iso;
            (log.fate, log.says) = (Fate::ReadWithNote, "without a zone, read as UTC");
        }
        6 => {
            style.time = |at| {
                let at = i128::from(at) - i128::from(START) - 350_000_000;
                format!("{}{}", if at < 0 { "-" } else { "" }, at.unsigned_abs()) + "e-9"
            };
            (log.fate, log.says) = (Fate::ReadWithNote, "instants before 0");
        }
        7 => {
            style.is_quoted = true;
            style.id = |t| format!("run7-{}", t * 7919 % 1000);
            (log.fate, log.says) = (Fate::ReadWithNote, "because their ids are texts");
        }
        8 => style.id = |t| format!("{t}.0"),
        17 => {
            style.deadline =
                |number| if number == 6 || number == 1 { "-1" } else { "80" }.to_owned();
            (log.fate, log.says) = (Fate::Refused, "--missing");
            log.remedy = &["--missing", "-1", "--deadline", "80ms"];
        }
        22 => {
            style.unit = &["--unit", "s"];
            (log.fate, log.says) = (Fate::Noted, "no deadline ends within the log");
        }
        _ => {}
    }
    style
}

/// Dirt in values.
fn soil_rows(
    rng: &mut Rng,
    shape: Shape,
    kind: u64,
    rows: &mut [Vec<(&'static str, String)>],
    log: &mut DirtyLog,
) {
    let is_frames = matches!(shape, Shape::CsvFrames | Shape::JsonFrames);
    match kind {
        9 => {
            for (number, row) in rows.iter_mut().enumerate() {
                let own = [
                    ("seq", number.to_string()),
                    ("age", "7".to_owned()),
                    ("origin", "9".to_owned()),
                ];
                row.extend(own);
            }
        }
        13 => {
            let stamps = |at: usize| rows[at][0].1 != rows[at + 1][0].1;
            let places: Vec<usize> = (0..rows.len() - 1).filter(|at| stamps(*at)).collect();
            let at = places[rng.index(places.len())];
            rows.swap(at, at + 1);
            if !is_frames {
                (log.fate, log.says) = (Fate::ReadWithNote, "were sorted");
            }
        }
        16 => {
            let at = rng.index(rows.len());
            let cell = rows[at].iter_mut().find(|(name, _)| *name == "frame").unwrap();
            cell.1.clear();
            (log.fate, log.says) = (Fate::Refused, "is empty");
        }
        _ => {}
    }
}

/// The run once more: its clock begins again, or its counter alone.
fn run_again(kind: u64, frames: &[Frame]) -> Vec<Frame> {
    if kind == 14 {
        return frames.iter().map(|frame| Frame { t: frame.t + 100, ..frame.clone() }).collect();
    }
    let by = |at: u64| at + 20_000 * MS;
    let later = |frame: &Frame| Frame {
        t: frame.t,
        open: by(frame.open),
        sent: by(frame.sent),
        done: frame.done.map(by),
        failed: frame.failed.map(by),
        own: by(frame.own),
        out: frame.out.map(|(at, p)| (by(at), p)),
        missed: frame.missed.map(by),
    };
    frames.iter().map(later).collect()
}

/// Dirt in lines.
fn soil_lines(rng: &mut Rng, kind: u64, text: &mut Vec<String>, log: &mut DirtyLog) {
    let is_csv = log.name == "log.csv";
    let is_frames = log.options[0] == "--frame";
    match kind {
        10 if !is_csv => {
            for line in text.iter_mut() {
                line.insert_str(1, "\"gap\": NaN, ");
            }
        }
        18 => {
            let name = ["frame", "budget"][rng.index(2)];
            let wrong = format!("{}{}", &name[..name.len() - 2], &name[name.len() - 1..]);
            for option in &mut log.options {
                *option = option.replace(&format!("={name}"), &format!("={wrong}"));
            }
            (log.fate, log.says) = (Fate::Refused, ": the file has no ");
        }
        19 => {
            let at = 1 + rng.index(text.len() - 1);
            text.insert(at, "Traceback (most recent call last):".to_owned());
            log.fate = Fate::Refused;
            log.says = if is_csv { "cells, where the first row has" } else { "not a JSON object" };
            log.remedy = &["--skip-bad"];
        }
        21 if !is_frames => {
            let at = 1 + rng.index(text.len() - 1);
            text.insert(at, text[at].clone());
            (log.fate, log.says) = (Fate::Noted, "repeat an earlier one");
            log.remedy = &["--unique"];
        }
        23 => {
            let at = 1 + rng.index(text.len() - 1);
            text.insert(at, String::new());
        }
        24 if is_csv => {
            text.insert(text.len() / 2, text[0].clone());
            (log.fate, log.says) = (Fate::Refused, "the row repeats the names of the columns");
            log.remedy = &["--skip-bad"];
        }
        _ => {}
    }
}

/// Dirt in bytes.
fn pack(kind: u64, text: &[String], log: &mut DirtyLog) {
    let is_csv = log.name == "log.csv";
    let end = if kind == 12 && is_csv { "\r\n" } else { "\n" };
    let mut joined = text.join(end) + end;
    if kind == 11 {
        joined.insert(0, '\u{feff}');
    }
    log.bytes = joined.into_bytes();
    match kind {
        12 if !is_csv => {
            let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
            packed.write_all(&log.bytes).unwrap();
            log.bytes = packed.finish().unwrap();
            log.name = "log.jsonl.gz";
        }
        // A short cell of CSV may be a whole one.
        20 if !is_csv => {
            log.bytes.truncate(log.bytes.len() - 9);
            (log.fate, log.says) = (Fate::Refused, "--truncated");
        }
        _ => {}
    }
}

/// Spans with a kind of dirt.
fn dirty_spans(rng: &mut Rng, kind: u64, frames: &[Frame]) -> DirtyLog {
    let mut fate = (Fate::Read, "");
    let mut remedy: &'static [&'static str] = &[];
    let mut spans: Vec<Value> = Vec::new();
    let lost = rng.index(frames.len());
    for (number, frame) in frames.iter().enumerate() {
        let id = |what: u64| format!("{:016x}", frame.t * 8 + what + 1);
        let span = |what: u64, name: &str, kind: u64, ends: [u64; 2], attributes: Value| {
            let parent = if what == 0 { Value::from("") } else { id(0).into() };
            json!({"traceId": format!("{:032x}", frame.t + 1), "spanId": id(what), "parentSpanId": parent, "name": name,
                "kind": kind, "startTimeUnixNano": ends[0].to_string(), "endTimeUnixNano": ends[1].to_string(),
                "attributes": attributes, "status": {}})
        };
        let text = |key: &str, value: &str| json!({"key": key, "value": {"stringValue": value}});
        let frame_id = match kind {
            2 => json!({"doubleValue": frame.t}),
            3 => {
                fate = (Fate::ReadWithNote, "because their ids are texts");
                json!({"stringValue": format!("frame-{}", frame.t)})
            }
            _ => json!({"intValue": frame.t.to_string()}),
        };
        let mut attributes = vec![json!({"key": "frame.id", "value": frame_id})];
        let (end, p) = frame.out.unwrap_or((frame.missed.unwrap_or(0), 9));
        if p != 9 {
            attributes.push(text("winner", if p == 0 { "local" } else { "west" }));
        }
        if kind == 4 && number == lost {
            attributes.remove(0);
            fate = (Fate::Refused, "no attribute \"frame.id\"");
        }
        let mut message = span(0, "decide", 1, [frame.open, end], attributes.into());
        if frame.missed.is_some() {
            message["status"] = json!({"code": 2});
        }
        let own = span(1, "plan", 1, [frame.open, frame.own], json!([]));
        let answer = frame.done.or(frame.failed);
        let mut call =
            span(2, "west", 3, [frame.sent, answer.unwrap_or(frame.sent + DEADLINE)], json!([]));
        if frame.failed.is_some() {
            call["status"] = json!({"code": 2});
            call["attributes"] = json!([text("rpc.status_code", "UNAVAILABLE")]);
        } else if frame.done.is_none() {
            call["status"] = json!({"code": 2});
            call["attributes"] = json!([text("rpc.status_code", "DEADLINE_EXCEEDED")]);
        }
        if kind == 5 && number == lost {
            fate = (Fate::Noted, "no message is above them");
            spans.extend([own, call]);
            continue;
        }
        if kind == 6 && number == lost {
            message["endTimeUnixNano"] = (frame.open - 5).to_string().into();
            fate = (Fate::Noted, "ends before it begins");
        }
        spans.extend([message, own, call]);
    }
    if kind == 7 {
        let more: Vec<Value> = spans.iter().take(6).cloned().collect();
        spans.extend(more);
        fate = (Fate::ReadWithNote, "exported twice");
    }
    if kind == 8 {
        for span in &mut spans {
            for key in ["links", "events", "traceState"] {
                span[key] = Value::Null;
            }
        }
    }
    let mut options = options(Shape::Spans, &plain());
    options.truncate(4);
    options.extend(["--deadline".to_owned(), "80ms".to_owned()]);
    if kind == 9 {
        let wrong = [("=decide", "=decied"), ("=winner", "=winer"), ("=frame.id", "=frameid")];
        let (right, wrong) = wrong[rng.index(3)];
        for option in &mut options {
            *option = option.replace(right, wrong);
        }
        fate = (Fate::Refused, ": the file has no ");
    }
    let scopes = json!([{"spans": spans}]);
    let mut text = match kind {
        10 => json!({"batches": [{"scopeSpans": scopes}]}).to_string(),
        11 => json!({"result": {"resourceSpans": [{"scopeSpans": scopes}]}}).to_string(),
        12 => format!("{}\n", json!({"resource": {}, "scopeSpans": scopes})),
        13 => serde_json::to_string_pretty(&json!({"resourceSpans": [{"scopeSpans": scopes}]}))
            .unwrap(),
        _ => json!({"resourceSpans": [{"scopeSpans": scopes}]}).to_string(),
    };
    if kind == 14 {
        text.truncate(text.len() - 40);
        fate = (Fate::Refused, "--truncated");
        remedy = &[];
    }
    let (fate, says) = fate;
    DirtyLog { name: "spans.json", bytes: text.into_bytes(), options, fate, says, remedy }
}

const SPAN_KINDS: u64 = 15;

fn convert(folder: &Path, log: &DirtyLog, more: &[&str]) -> std::process::Output {
    let path = |name: &str| folder.join(name).display().to_string();
    let (header, file) = (path("header.jsonl"), path(log.name));
    let options: Vec<&str> = log.options.iter().map(String::as_str).collect();
    run(&[&["convert", "--header", &header, &file], &options[..], more].concat(), "")
}

/// Returns what is wrong with how a log was read; none if it was read rightly, refused or noted as
/// it must be.
fn mistake(folder: &Path, log: &DirtyLog, clean: &[Fact]) -> Option<String> {
    let done = convert(folder, log, &[]);
    let is_read = |done: &std::process::Output| {
        done.status.code() == Some(0) && is_same(&read_facts(out(done)), clean)
    };
    let printed = err(&done);
    let names_place = printed.contains(log.name);
    let is_right = match log.fate {
        Fate::Read => is_read(&done) && printed.is_empty(),
        Fate::ReadWithNote => is_read(&done) && printed.contains(log.says) && names_place,
        Fate::Noted => done.status.code() == Some(0) && printed.contains(log.says) && names_place,
        Fate::Refused => {
            done.status.code() == Some(2)
                && printed.contains(log.says)
                && names_place
                && out(&done).is_empty()
        }
    };
    if !is_right {
        return Some(format!("{:?} with {:?}: {printed}{}", log.fate, log.says, out(&done)));
    }
    if log.remedy.is_empty() {
        return None;
    }
    let after = convert(folder, log, log.remedy);
    (!is_read(&after)).then(|| format!("with {:?}: {}{}", log.remedy, err(&after), out(&after)))
}

#[test]
fn no_drawn_log_is_misread_in_silence() {
    let count = env::var("FUSELINE_DIRTY_LOGS").ok().and_then(|text| text.parse().ok());
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("header.jsonl"), format!("{}\n", header())).unwrap();
    let shapes =
        [Shape::CsvEvents, Shape::JsonEvents, Shape::CsvFrames, Shape::JsonFrames, Shape::Spans];
    let (mut mistakes, mut fates) = (Vec::new(), BTreeMap::<String, u64>::new());
    for number in 0..count.unwrap_or(COUNT) {
        let mut rng = Rng::with_seed(number);
        let first = rng.u64(0..50);
        let frames = clean_run(&mut rng, first, START);
        let shape = shapes[usize::try_from(number % 5).unwrap()];
        let kind = number / 5;
        let log = match shape {
            Shape::Spans => dirty_spans(&mut rng, kind % SPAN_KINDS, &frames),
            shape => dirty_rows(&mut rng, shape, kind % KINDS, &frames),
        };
        fs::write(dir.path().join(log.name), &log.bytes).unwrap();
        *fates.entry(format!("{:?}", log.fate)).or_default() += 1;
        if let Some(mistake) = mistake(dir.path(), &log, &facts(&frames)) {
            mistakes.push(format!("log {number}, {shape:?}, kind {kind}: {mistake}"));
        }
    }
    assert!(mistakes.is_empty(), "{} mistakes\n{}", mistakes.len(), mistakes.join("\n"));
    assert_eq!(fates.len(), 4, "{fates:?}");
    eprintln!("{fates:?}");
}
