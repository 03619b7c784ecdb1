//! Compares what `fuseline export` shows with a recount of the same traces that uses plain lists.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::common::drawn::DrawnTrace;
use crate::common::recount::{RecountedCall, RecountedEnd, RecountedSpan};
use crate::common::{err, micros, out, run};
use fuseline_traces::{Annotations, Decision, Event, Input, ValueKeys};
use serde_json::{Value, json};
use tempfile::tempdir;

/// The number of traces that are drawn.
const TRACES: u64 = 30;

/// Exports files with these options; what is written, and what is noted on standard error.
fn exported(viewer: &str, files: &[&str]) -> (String, String) {
    let dir = tempdir().unwrap();
    let output = dir.path().join("out").to_str().unwrap().to_owned();
    let exported = run(&[&["export", viewer], files, &["-o", &output]].concat(), "");
    assert_eq!(exported.status.code(), Some(0), "{}", err(&exported));
    (fs::read_to_string(output).unwrap(), err(&exported).to_owned())
}

/// An event of Perfetto's file: its process, the name of its track without the number behind it,
/// and all that it says.
type ShownEvent = (u64, String, String);

/// A shown event's times are exact as text alone.
fn shown(pid: u64, track: &str, times: &str, event: &Value) -> ShownEvent {
    (pid, track.to_owned(), format!("{times} {event}"))
}

/// The events of a file but for those that name processes and tracks, and what those say of each
/// process.
fn of_perfetto(text: &str) -> (Vec<ShownEvent>, BTreeMap<u64, String>) {
    serde_json::from_str::<Value>(text).unwrap();
    let (mut names, mut processes, mut events) = (BTreeMap::new(), BTreeMap::new(), Vec::new());
    for line in text.lines().map(|line| line.trim_end_matches(',')) {
        let Ok(mut event) = serde_json::from_str::<Value>(line) else { continue };
        let object = event.as_object_mut().unwrap();
        let pid = object.remove("pid").unwrap().as_u64().unwrap();
        let tid = object.remove("tid").unwrap().as_u64().unwrap();
        let (value, ph) = (event["args"].clone(), event["ph"].clone());
        match event["name"].as_str().unwrap() {
            "process_name" if ph == "M" => {
                processes.insert(pid, value["name"].as_str().unwrap().to_owned());
            }
            "thread_name" => {
                let name = value["name"].as_str().unwrap();
                let name = name.rsplit_once(" (").map_or(name, |(name, _)| name).to_owned();
                assert_eq!(names.insert((pid, tid), name), None);
            }
            "thread_sort_index" => assert_eq!(value["sort_index"], tid),
            _ => {
                let times: Vec<&str> = ["ts", "dur"]
                    .iter()
                    .filter_map(|key| {
                        event.as_object_mut().unwrap().remove(*key)?;
                        let (_, rest) = line.split_once(&format!("\"{key}\":")).unwrap();
                        rest.split(',').next()
                    })
                    .collect();
                events.push(shown(pid, &names[&(pid, tid)], &times.join(" for "), &event));
            }
        }
    }
    events.sort();
    (events, processes)
}

fn at(event: &Event) -> u64 {
    match event {
        Event::Input(input) => input.at(),
        Event::Decision(decision) => decision.at(),
    }
}

/// Returns what Perfetto is to show of a trace.
fn recounted_for_perfetto(trace: &DrawnTrace, pid: u64) -> Vec<ShownEvent> {
    let (messages, calls) =
        trace.recount(|own, by| by.is_none_or(|by| !trace.is_progressive() || own <= by));
    let latest = trace.events.iter().map(|(event, _)| at(event)).max().unwrap_or(0);
    let mut events = Vec::new();
    for RecountedCall { t, p, begun, due, end, annotations, .. } in calls {
        let (at, label) = match end {
            None => (latest, "still open"),
            Some((at, end)) => {
                let label = match end {
                    RecountedEnd::Result(_) => "result",
                    RecountedEnd::Failure => "failure",
                    RecountedEnd::Timer => "timer fired",
                    RecountedEnd::Refused => "refused",
                    RecountedEnd::Retired if p == 0 => "no longer needed",
                    RecountedEnd::Cancelled | RecountedEnd::Retired => "cancelled",
                };
                (at, label)
            }
        };
        let mut args = json!({"t": t, "p": p, "due": due, "end": label});
        if let (0, Some(origin)) = (p, &annotations.origin) {
            args["origin"] = json!(&*origin.stream);
            args["seq"] = json!(origin.seq);
            args["age"] = json!(annotations.age);
            let missing: Vec<&str> = annotations.missing.iter().map(|it| &**it).collect();
            if !missing.is_empty() {
                args["missing"] = json!(missing.join(" "));
            }
        }
        let name = format!("timestamp {t}: {label}");
        let times = format!("{} for {}", micros(begun), micros(at.max(begun) - begun));
        let event = json!({"ph": "X", "cat": "call", "name": name, "args": args});
        events.push(shown(pid, &trace.name(p, "cloud "), &times, &event));
    }
    let mut message = messages.iter();
    let mut open = BTreeMap::new();
    for (index, (event, _)) in trace.events.iter().enumerate() {
        if let Event::Input(Input::Open { t, .. }) = event
            && !open.contains_key(t)
            && !trace.is_refused(index)
        {
            open.insert(*t, message.next().unwrap());
        }
        let Event::Decision(decision) = event else { continue };
        let Some((at, t, row, label)) = instant(trace, decision) else { continue };
        let mut args = json!({"t": t});
        if row == "outputs" {
            let RecountedSpan { opened, annotations, .. } = open[&t];
            if let Some(age) = annotations.age {
                args["age"] = json!(age.saturating_add(at.saturating_sub(*opened)));
            }
            if !trace.is_progressive() || !label.starts_with("from ") {
                open.remove(&t);
            }
        }
        let event =
            json!({"ph": "i", "s": "t", "name": format!("timestamp {t}: {label}"), "args": args});
        events.push(shown(pid, &row, &micros(at), &event));
    }
    events
}

/// The instant that shows a decision: when, about what, on which track and in which words.
fn instant(trace: &DrawnTrace, decision: &Decision) -> Option<(u64, u64, String, String)> {
    let outputs = "outputs".to_owned();
    Some(match *decision {
        Decision::Hold { at, t, p } => (at, t, trace.name(p, "cloud "), "result held".to_owned()),
        Decision::Drop { at, t, p, why } => {
            (at, t, trace.name(p, "cloud "), format!("dropped, {why}"))
        }
        Decision::RefuseOpen { at, t, why } => {
            (at, t, trace.name(0, ""), format!("refused, {why}"))
        }
        Decision::RefuseOffer { at, t, p, why } => {
            (at, t, trace.name(p, "cloud "), format!("refused, {why}"))
        }
        Decision::Emit { at, t, p } => {
            (at, t, outputs, format!("from {}", trace.name(p, "cloud ")))
        }
        Decision::Final { at, t, .. } => (at, t, outputs, "final".to_owned()),
        Decision::Miss { at, t } => (at, t, outputs, "missed".to_owned()),
        Decision::Request { .. } | Decision::Timer { .. } | Decision::Cancel { .. } => return None,
    })
}

fn file(dir: &Path, name: &str, text: &str) -> String {
    let path = dir.join(name);
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn perfetto_shows_each_call_and_each_decision_of_several_traces_once() {
    let dir = tempdir().unwrap();
    let traces: Vec<DrawnTrace> = (0..TRACES).map(DrawnTrace::draw).collect();
    let files: Vec<String> = (0..)
        .zip(&traces)
        .map(|(number, trace): (u64, _)| file(dir.path(), &number.to_string(), &trace.text()))
        .collect();
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    let (text, noted) = exported("--perfetto", &files);
    let (events, processes) = of_perfetto(&text);
    let mut expected = Vec::new();
    for (trace, pid) in traces.iter().zip(1..) {
        expected.extend(recounted_for_perfetto(trace, pid));
        assert_eq!(processes[&pid], trace.header.operator.as_deref().unwrap_or("operator"));
    }
    assert_eq!(processes.len(), traces.len());
    expected.sort();
    for (shown, expected) in events.iter().zip(&expected) {
        assert_eq!(shown, expected);
    }
    assert_eq!(events.len(), expected.len());
    // Keys that have no place there are noted, for each trace that has such keys.
    let has_more = |(_, annotations): &(Event, Annotations)| {
        let Annotations { attempt, within, .. } = annotations;
        !annotations.value().is_empty() || attempt.is_some() || within.is_some()
    };
    let with_more =
        traces.iter().zip(&files).filter(|(trace, _)| trace.events.iter().any(has_more));
    let noted_files = noted.lines().map(|line| line.split(": ").nth(1).unwrap());
    assert!(noted_files.eq(with_more.map(|(_, file)| *file)), "{noted}");
}

#[test]
fn mcap_has_each_line_with_all_its_keys() {
    let dir = tempdir().unwrap();
    for number in 0..TRACES / 4 {
        let text = DrawnTrace::draw(number).text();
        let trace = file(dir.path(), "trace", &text);
        let packed = dir.path().join("trace.mcap").to_str().unwrap().to_owned();
        let exported = run(&["export", "--force", "--mcap", &trace, "-o", &packed], "");
        assert_eq!((exported.status.code(), err(&exported)), (Some(0), ""));
        assert_eq!(out(&run(&["convert", &packed], "")), text, "run {number}");
    }
}

/// A span: its name and kind, its times, its status, and its attributes by the alphabet.
fn span(name: &str, kind: u64, times: [u64; 2], code: u64, mut more: Vec<(&str, Value)>) -> String {
    more.retain(|(_, value)| !value.is_null());
    more.sort_by_key(|(key, _)| *key);
    format!("{name} {kind} {times:?} {code} {more:?}")
}

/// Returns what OTLP is to have of a trace: each message with its calls, in any order.
fn recounted_for_otlp(trace: &DrawnTrace) -> Vec<(String, Vec<String>)> {
    let (messages, mut calls) = trace.recount(|_, by| by.is_none() || !trace.is_progressive());
    let number = |value: Option<u64>| json!(value.map(|value| value.to_string()));
    let name = trace.header.operator.as_deref().unwrap_or("operator");
    calls.retain(|call| call.end.is_none_or(|(_, end)| end != RecountedEnd::Refused));
    let spans = messages.iter().map(|message| {
        let RecountedSpan { t, opened, deadline, annotations, by, sent, end, .. } = message;
        let Annotations { within, age, origin, .. } = annotations;
        let ValueKeys { of, meant_for } = end.map(|(_, value)| value).unwrap_or_default();
        let end_at = end.map(|(at, _)| at);
        let took = sent.filter(|sent| Some(*sent) != end_at).map(|sent| sent - opened);
        let attributes = vec![
            ("fuseline.t", number(Some(*t))),
            ("fuseline.within", number(*within)),
            ("fuseline.age", number(*age)),
            ("fuseline.origin", json!(origin.as_ref().map(|origin| &*origin.stream))),
            ("fuseline.seq", number(origin.as_ref().and_then(|origin| origin.seq))),
            ("fuseline.deadline", number(*deadline)),
            ("fuseline.latency", number(took)),
            ("fuseline.by", number(*by)),
            ("fuseline.of", number(of)),
            ("fuseline.for", number(meant_for)),
        ];
        let code = if end.is_some() && by.is_none() { 2 } else { 1 };
        let times = [*opened, end.map_or(0, |(at, _)| at)];
        // A timestamp is opened once, whatever is refused.
        let own = calls.iter().filter(|call| call.t == *t);
        let mut own: Vec<String> = own.map(|call| of_call(trace, call)).collect();
        own.sort();
        (span(name, 1, times, code, attributes), own)
    });
    let mut spans: Vec<_> = spans.collect();
    spans.sort();
    spans
}

fn of_call(trace: &DrawnTrace, call: &RecountedCall) -> String {
    let RecountedCall { p, begun, due, end, ref annotations, .. } = *call;
    let text = |value: u64| json!(value.to_string());
    let mut attributes = vec![("fuseline.p", text(p))];
    let name = trace.name(p, "cloud-");
    if p > 0 {
        attributes.push(("fuseline.deadline", text(due.unwrap().saturating_sub(begun))));
        attributes.push(("fuseline.try", json!(annotations.attempt.map(|it| it.to_string()))));
    }
    let (at, code) = match end {
        None => (0, 0),
        Some((at, end)) => {
            let (code, ended) = match end {
                RecountedEnd::Result(ValueKeys { of, meant_for }) => {
                    attributes.push(("fuseline.of", json!(of.map(|of| of.to_string()))));
                    let meant = json!(meant_for.map(|it| it.to_string()));
                    attributes.push(("fuseline.for", meant));
                    (1, None)
                }
                RecountedEnd::Failure => (2, None),
                RecountedEnd::Timer => (0, Some("due")),
                RecountedEnd::Cancelled => (0, Some("cancelled")),
                RecountedEnd::Retired => (0, Some("retired")),
                RecountedEnd::Refused => unreachable!(),
            };
            attributes.push(("fuseline.ended", json!(ended)));
            (at, code)
        }
    };
    span(&name, if p == 0 { 1 } else { 3 }, [begun, at], code, attributes)
}

/// A span as the file has it: what is compared, its id, its parent's and its trace's, and the frame
/// that it is of.
fn read_span(span_value: &Value) -> (String, [Option<String>; 3], Option<[Value; 2]>) {
    let number = |key: &str| span_value[key].as_str().unwrap().parse().unwrap();
    let attributes = span_value["attributes"].as_array().unwrap().iter().map(|it| {
        let value = it["value"].as_object().unwrap().values().next().unwrap();
        (it["key"].as_str().unwrap(), value.clone())
    });
    let attributes: Vec<(&str, Value)> = attributes.collect();
    let value = |of: &str| attributes.iter().find(|(key, _)| *key == of).map(|it| it.1.clone());
    let frame = value("fuseline.origin").zip(value("fuseline.seq")).map(|(of, seq)| [of, seq]);
    let text = span(
        span_value["name"].as_str().unwrap(),
        span_value["kind"].as_u64().unwrap(),
        [number("startTimeUnixNano"), number("endTimeUnixNano")],
        span_value["status"]["code"].as_u64().unwrap(),
        attributes,
    );
    let ids = ["spanId", "parentSpanId", "traceId"];
    (text, ids.map(|key| span_value[key].as_str().map(ToOwned::to_owned)), frame)
}

#[test]
fn otlp_has_each_message_with_its_calls() {
    let dir = tempdir().unwrap();
    for number in 0..TRACES {
        let trace = DrawnTrace::draw(number);
        let (text, notes) = exported("--otlp", &[&file(dir.path(), "trace", &trace.text())]);
        // Spans cannot say where the last tick of the trace is, and have one output.
        let is_beside = trace.is_progressive() && notes.contains(" outputs beyond");
        let is_tick = notes.contains("cannot express them: 1 instants");
        assert!(notes.is_empty() || is_beside || is_tick, "{notes}");
        assert!(!notes.contains("opens of messages"), "{notes}");
        let export: Value = serde_json::from_str(&text).unwrap();
        let of_operator = &export["resourceSpans"][0];
        assert_eq!(
            of_operator["resource"]["attributes"][0]["value"]["stringValue"],
            trace.header.operator.as_deref().unwrap_or("operator")
        );
        let spans = of_operator["scopeSpans"][0]["spans"].as_array().unwrap();
        let (mut messages, mut calls, mut ids) = (Vec::new(), Vec::new(), BTreeSet::new());
        for (text, [id, parent, trace_id], frame) in spans.iter().map(read_span) {
            let (id, trace_id) = (id.unwrap(), trace_id.unwrap());
            assert_eq!((id.len(), trace_id.len()), (16, 32));
            assert!(ids.insert(id.clone()), "{id} is twice in run {number}");
            match parent {
                None => messages.push((text, id, trace_id, frame)),
                Some(parent) => calls.push((text, parent, trace_id)),
            }
        }
        // A frame of one origin and seq is one trace, any other message is one of its own.
        for (index, (text, _, trace_id, frame)) in messages.iter().enumerate() {
            for (other, _, other_trace, other_frame) in &messages[..index] {
                let is_one = frame.is_some() && frame == other_frame;
                assert_eq!(trace_id == other_trace, is_one, "{text} and {other} of run {number}");
            }
        }
        let mut shown = Vec::new();
        for (text, id, trace_id, _) in messages {
            let own = calls.extract_if(.., |(_, parent, _)| *parent == id);
            let mut own: Vec<String> = own
                .map(|(text, _, of)| {
                    assert_eq!(of, trace_id);
                    text
                })
                .collect();
            own.sort();
            shown.push((text, own));
        }
        shown.sort();
        assert!(calls.is_empty(), "{calls:?}");
        assert_eq!(shown, recounted_for_otlp(&trace), "run {number}: {}", trace.text());
    }
}
