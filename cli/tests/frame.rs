//! `fuseline frame`, run as a user runs it.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;

use crate::common::drawn::DrawnTrace;
use crate::common::recount::{RecountedCall, RecountedEnd, RecountedSpan};
use crate::common::{err, out, run};
use fuseline_traces::{Annotations, Decision, Event, Input};
use tempfile::tempdir;

const DETECTOR: &str = r#"{"fuseline":1,"operator":"detector","window":9,"commit":"eager","clouds":[{"p":1,"name":"west","limit":9}]}
{"ev":"open","at":1000000,"t":4,"within":500000000,"age":1000000,"origin":"camera","seq":41}
{"ev":"offer","at":1000000,"t":4,"p":1,"deadline":200000000,"backlog":0}
{"ev":"request","at":1000000,"t":4,"p":1,"due":201000000}
{"ev":"result","at":61000000,"t":4,"p":0}
{"ev":"hold","at":61000000,"t":4,"p":0}
{"ev":"open","at":90000000,"t":5,"age":0,"origin":"camera","seq":42}
{"ev":"tick","at":201000000}
{"ev":"timer","at":201000000,"t":4,"p":1}
{"ev":"emit","at":201000000,"t":4,"p":0}
"#;
const TRACKER: &str = r#"{"fuseline":1,"operator":"tracker<1>","window":9,"commit":"eager","clouds":[]}
{"ev":"open","at":7000000000,"t":0,"age":205000000,"origin":"camera","seq":41}
{"ev":"result","at":7020000000,"t":0,"p":0}
{"ev":"emit","at":7020000000,"t":0,"p":0}
"#;

#[test]
fn a_frame_is_followed_through_the_traces_of_all_operators() {
    let dir = tempdir().unwrap();
    let [detector, tracker] = ["d.jsonl", "t.jsonl"].map(|it| dir.path().join(it));
    fs::write(&detector, DETECTOR).unwrap();
    fs::write(&tracker, TRACKER).unwrap();
    let [detector, tracker] = [&detector, &tracker].map(|it| it.to_str().unwrap());
    let followed = run(&["frame", "--seq", "41", tracker, detector], "");
    assert_eq!((followed.status.code(), err(&followed)), (Some(0), ""));
    let expected = "camera 41: 225.0 ms old at its last answer
  detector                 1.0 ms to   201.0 ms  local
    local                  1.0 ms to    61.0 ms  answered
    west                   1.0 ms to   201.0 ms  late
  tracker<1>             205.0 ms to   225.0 ms  local
    local                205.0 ms to   225.0 ms  answered
  most went to: detector, 200.0 ms or 89 %
";
    assert_eq!(out(&followed), expected);
}

#[test]
fn without_a_frame_the_one_that_most_operators_missed_is_followed() {
    let dir = tempdir().unwrap();
    let path = dir.path().join("d.jsonl");
    let missed = r#"{"ev":"fail","at":90000000,"t":5,"p":0}
{"ev":"miss","at":90000000,"t":5}
"#;
    fs::write(&path, DETECTOR.replace("{\"ev\":\"tick", &format!("{missed}{{\"ev\":\"tick")))
        .unwrap();
    let followed = run(&["frame", path.to_str().unwrap()], "");
    let expected = "camera 42: 0.0 ms old at its last answer
  detector                 0.0 ms to     0.0 ms  missed: a substitute, or nothing, was sent
    local                  0.0 ms to     0.0 ms  failed
";
    assert!(out(&followed).starts_with(expected), "{}", out(&followed));
}

#[test]
fn a_frame_that_no_trace_or_several_streams_have_is_refused() {
    let dir = tempdir().unwrap();
    let path = dir.path().join("d.jsonl");
    fs::write(&path, DETECTOR).unwrap();
    let trace = path.to_str().unwrap();
    let unknown = run(&["frame", "--seq", "7", trace], "");
    assert_eq!(unknown.status.code(), Some(2));
    assert!(
        err(&unknown).starts_with("error: no trace has a message of seq 7"),
        "{}",
        err(&unknown)
    );
    let other = dir.path().join("o.jsonl");
    fs::write(&other, TRACKER.replace("camera", "lidar")).unwrap();
    let other = other.to_str().unwrap();
    let both = run(&["frame", "--seq", "41", trace, other], "");
    assert_eq!(both.status.code(), Some(2));
    assert!(err(&both).contains("--stream with one of camera, lidar"), "{}", err(&both));
    let one = run(&["frame", "--seq", "41", "--stream", "lidar", trace, other], "");
    assert!(out(&one).starts_with("lidar 41: 225.0 ms"), "{}", out(&one));
}

/// A message of a frame: when it was taken in and answered since the capture, and its lines.
type FrameLines = (String, u64, Option<u64>, String);

fn ms(nanos: u64) -> String {
    format!("{:.1} ms", std::time::Duration::from_nanos(nanos).as_secs_f64() * 1000.0)
}

/// The messages of a frame that a trace has, with what became of them.
fn messages_of(trace: &DrawnTrace, operator: &str, stream: &str, seq: u64) -> Vec<FrameLines> {
    let (messages, calls) = trace.recount(|_, _| false);
    let age_of = |of: &Annotations| {
        of.age.filter(|_| {
            of.origin.as_ref().is_some_and(|it| &*it.stream == stream && it.seq == Some(seq))
        })
    };
    let mut lines = Vec::new();
    let mut add = |age, answered: Option<u64>, outcome: &str, own: &str, of: &Annotations| {
        let to = answered.map_or("?".to_owned(), ms);
        let missing = if of.missing.is_empty() { "" } else { ", without " };
        let missing = format!("{missing}{}", of.missing.join(" "));
        let line = format!("  {operator:20} {:>10} to {to:>10}  {outcome}MORE{missing}\n", ms(age));
        lines.push((operator.to_owned(), age, answered, line + own));
    };
    let since = |age: u64, opened: u64, at: u64| {
        u64::try_from(i128::from(at) - i128::from(opened) + i128::from(age)).unwrap_or(0)
    };
    for RecountedSpan { t, opened, annotations, .. } in &messages {
        let Some(age) = age_of(annotations) else { continue };
        let since = |at: u64| since(age, *opened, at);
        let mut own = String::new();
        for call in calls.iter().filter(|it| it.t == *t) {
            let RecountedCall { p, begun, end, .. } = call;
            let (to, how) = match end {
                Some((_, RecountedEnd::Refused)) => continue,
                Some((at, end)) => (ms(since(*at)), how(*end)),
                None => ("?".to_owned(), "no answer in the trace"),
            };
            let name = trace.name(*p, "cloud-");
            writeln!(own, "    {name:18} {:>10} to {to:>10}  {how}", ms(since(*begun))).unwrap();
        }
        let (mut answered, mut outcome) = (None, "not answered in the trace".to_owned());
        for (event, _) in &trace.events {
            match event {
                Event::Decision(Decision::Emit { at, t: of, p }) if of == t => {
                    (answered, outcome) = (Some(since(*at)), trace.name(*p, "cloud-"));
                }
                Event::Decision(Decision::Miss { at, t: of }) if of == t => {
                    answered = Some(since(*at));
                    "missed: a substitute, or nothing, was sent".clone_into(&mut outcome);
                }
                _ => {}
            }
        }
        add(age, answered, &outcome, &own, annotations);
    }
    for (index, (event, annotations)) in trace.events.iter().enumerate() {
        let (Event::Input(Input::Open { at: opened, t, .. }), Some(age)) =
            (event, age_of(annotations))
        else {
            continue;
        };
        // What repeats a message of the frame changes nothing.
        let is_first = |it: &RecountedSpan| {
            it.t == *t && it.index < index && age_of(&it.annotations).is_some()
        };
        if !trace.is_refused(index) || messages.iter().any(is_first) {
            continue;
        }
        let refusal = trace.events[index..].iter().find_map(|(event, _)| match event {
            Event::Decision(Decision::RefuseOpen { at, why, .. }) => Some((*at, *why)),
            _ => None,
        });
        let (at, why) = refusal.unwrap();
        let outcome = format!("refused {why}: a substitute, or nothing, was sent");
        add(age, Some(since(age, *opened, at)), &outcome, "", annotations);
    }
    lines
}

const fn how(end: RecountedEnd) -> &'static str {
    match end {
        RecountedEnd::Result(_) => "answered",
        RecountedEnd::Failure => "failed",
        RecountedEnd::Timer => "late",
        RecountedEnd::Cancelled => "not needed",
        RecountedEnd::Refused | RecountedEnd::Retired => unreachable!(),
    }
}

#[test]
fn each_frame_has_the_messages_and_calls_of_a_recount() {
    let (dir, mut refused) = (tempdir().unwrap(), 0);
    for vehicle in 0..3 {
        let (mut traces, mut frames) = (Vec::new(), BTreeSet::new());
        for number in 3 * vehicle..3 * vehicle + 3 {
            let mut trace = DrawnTrace::draw(number);
            for (_, annotations) in &mut trace.events {
                if let Some(origin) = &mut annotations.origin {
                    origin.stream = origin.stream.replace(&format!("{number}/"), "").into();
                    frames.extend(origin.seq.map(|seq| (origin.stream.clone(), seq)));
                }
            }
            let path = dir.path().join(number.to_string());
            fs::write(&path, trace.text()).unwrap();
            traces.push((path.to_str().unwrap().to_owned(), trace));
        }
        let files: Vec<&str> = traces.iter().map(|(file, _)| file.as_str()).collect();
        for (stream, seq) in frames {
            let of = traces.iter().flat_map(|(file, trace)| {
                let operator = trace.header.operator.as_deref().unwrap_or(file);
                messages_of(trace, operator, &stream, seq)
            });
            let mut of: Vec<FrameLines> = of.collect();
            of.sort_by_key(|(_, taken_in, answered, _)| (*taken_in, *answered));
            let seq = seq.to_string();
            let followed =
                run(&[&["frame", "--seq", &seq, "--stream", &stream], &files[..]].concat(), "");
            if of.is_empty() {
                assert_eq!(followed.status.code(), Some(2));
                continue;
            }
            // Of several messages in one operator the first is shown.
            let (mut expected, mut age) = (String::new(), 0);
            for (index, (operator, _, answered, lines)) in of.iter().enumerate() {
                if of[..index].iter().any(|(before, ..)| before == operator) {
                    continue;
                }
                let more = of[index + 1..].iter().filter(|(other, ..)| other == operator).count();
                let more = match more {
                    0 => String::new(),
                    more => format!(", and {more} more of this frame"),
                };
                expected += &lines.replace("MORE", &more);
                age = age.max(answered.unwrap_or(0));
                refused += usize::from(lines.contains("refused "));
            }
            let shown: Vec<&str> = out(&followed).lines().collect();
            let [first, shown @ .., _] = &shown[..] else { panic!("{}", err(&followed)) };
            assert_eq!(shown, expected.lines().collect::<Vec<_>>(), "{stream} {seq}");
            assert_eq!(*first, format!("{stream} {seq}: {} old at its last answer", ms(age)));
        }
    }
    assert!(refused > 0);
}
