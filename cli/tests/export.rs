//! `fuseline export`, run as a user runs it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::signal::interrupt;
use crate::common::{err, fuseline, out, run};
use fuseline_traces::parse;
use serde_json::Value;
use tempfile::tempdir;

fn corpus() -> Vec<PathBuf> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/corpus"));
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.extension().is_some_and(|name| name == "jsonl")).collect()
}

fn export(viewer: &str, trace: &Path) -> Vec<u8> {
    let dir = tempdir().unwrap();
    let output = dir.path().join("out");
    let args = ["export", viewer, trace.to_str().unwrap(), "-o", output.to_str().unwrap()];
    let exported = run(&args, "");
    assert_eq!((exported.status.code(), err(&exported)), (Some(0), ""), "{}", trace.display());
    fs::read(output).unwrap()
}

/// As the writer writes them: without `x`, keys in its order.
fn lines(trace: &str) -> Vec<String> {
    trace.lines().map(|line| parse(line.as_bytes()).unwrap().to_string()).collect()
}

#[test]
fn what_is_written_as_mcap_is_converted_back() {
    for path in corpus() {
        let dir = tempdir().unwrap();
        let packed = dir.path().join("trace.mcap");
        fs::write(&packed, export("--mcap", &path)).unwrap();
        let converted = run(&["convert", packed.to_str().unwrap()], "");
        let trace = fs::read_to_string(&path).unwrap();
        assert_eq!(lines(out(&converted)), lines(&trace), "{}", path.display());
    }
}

#[test]
fn slices_for_perfetto_are_on_their_sources_tracks_and_do_not_overlap_there() {
    let mut kinds = BTreeSet::new();
    for path in corpus() {
        let bytes = export("--perfetto", &path);
        serde_json::from_slice::<Value>(&bytes).unwrap();
        let exported = String::from_utf8(bytes).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let header: Value = serde_json::from_str(text.lines().next().unwrap()).unwrap();
        let (mut names, mut slices, mut outputs) = (BTreeMap::new(), BTreeMap::new(), 0);
        for line in exported.lines().filter(|line| line.contains("\"tid\"")) {
            let event: Value = serde_json::from_str(line.trim_end_matches(',')).unwrap();
            let track = event["tid"].as_u64().unwrap();
            match event["ph"].as_str().unwrap() {
                "X" => {
                    let (begin, duration) = (nanos(line, "ts"), nanos(line, "dur"));
                    let p = event["args"]["p"].as_u64().unwrap();
                    let end = event["args"]["end"].as_str().unwrap();
                    let t = &event["args"]["t"];
                    assert_eq!(event["name"], format!("timestamp {t}: {end}"));
                    kinds.insert(end.to_owned());
                    let slices: &mut Vec<_> = slices.entry(track).or_default();
                    slices.push((p, begin, begin + duration));
                }
                "i" => outputs += u32::from(names[&track] == "outputs"),
                "M" if event["name"] == "thread_name" => {
                    names.insert(track, event["args"]["name"].as_str().unwrap().to_owned());
                }
                "M" => assert!(event.get("ts").is_none()),
                other => panic!("{other}"),
            }
        }
        for (track, slices) in &mut slices {
            let p = slices[0].0;
            let cloud = header["clouds"].as_array().unwrap().iter().find(|cloud| cloud["p"] == p);
            let source = match cloud {
                Some(cloud) => cloud["name"].as_str().map_or(format!("cloud {p}"), str::to_owned),
                None => "local".to_owned(),
            };
            assert!(names[track].starts_with(&source), "{} for {source}", names[track]);
            assert!(slices.iter().all(|slice| slice.0 == p), "{slices:?} of {}", path.display());
            slices.sort_by_key(|slice| (slice.1, slice.2));
            let nest = slices.windows(2).all(|pair| pair[0].2 <= pair[1].1);
            assert!(nest, "{slices:?} of {}", path.display());
        }
        let shown =
            ["emit", "final", "miss"].map(|ev| text.matches(&format!("\"ev\":\"{ev}\"")).count());
        assert_eq!(outputs as usize, shown.iter().sum::<usize>(), "{}", path.display());
    }
    let kinds: Vec<&str> = kinds.iter().map(String::as_str).collect();
    let all = [
        "cancelled",
        "failure",
        "no longer needed",
        "refused",
        "result",
        "still open",
        "timer fired",
    ];
    assert_eq!(kinds, all);
}

/// An event's microseconds with three decimals, which no float would hold.
fn nanos(line: &str, key: &str) -> u64 {
    let (_, rest) = line.split_once(&format!("\"{key}\":")).unwrap();
    let (micros, _) = rest.split_once(',').unwrap();
    let (whole, part) = micros.split_once('.').unwrap();
    assert_eq!(part.len(), 3);
    format!("{whole}{part}").parse().unwrap()
}

#[test]
fn no_nanosecond_is_lost_for_perfetto() {
    let dir = tempdir().unwrap();
    let path = dir.path().join("trace.jsonl");
    let open = "{\"ev\":\"open\",\"at\":18446744073709551615,\"t\":1}\n";
    fs::write(&path, format!("{{\"fuseline\":1,\"window\":1,\"clouds\":[]}}\n{open}")).unwrap();
    let text = String::from_utf8(export("--perfetto", &path)).unwrap();
    assert!(text.contains("\"ts\":18446744073709551.615,\"dur\":0.000,"), "{text}");
}

#[test]
fn bad_input_is_one_line_and_leaves_the_output_as_it_was() {
    let dir = tempdir().unwrap();
    let output = dir.path().join("out");
    fs::write(&output, "as it was").unwrap();
    let output = output.to_str().unwrap();
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    let cut = run(&["export", "--force", "--mcap", "-o", output], &format!("{header}{{\"ev\":"));
    assert_eq!(cut.status.code(), Some(2));
    assert!(err(&cut).starts_with("error: stdin:2:"), "{}", err(&cut));
    assert_eq!(fs::read_to_string(output).unwrap(), "as it was");
    for args in [&["export", "-o", output][..], &["export", "--mcap", "--perfetto", "-o", output]] {
        let refused = run(args, header);
        assert_eq!((refused.status.code(), err(&refused).lines().count()), (Some(2), 1));
    }
}

/// F1: a timestamp that comes once more is refused, and what is shown of the message that is open
/// stays.
#[test]
fn a_repeated_timestamp_leaves_the_slices_of_the_open_message_as_they_are() {
    let dir = tempdir().unwrap();
    let (path, out) = (dir.path().join("trace.jsonl"), dir.path().join("out.json"));
    let trace = |repeated: &str| {
        [
            r#"{"fuseline":1,"window":4,"clouds":[]}"#,
            r#"{"ev":"open","at":1000,"t":7,"age":300,"origin":"camera","seq":41}"#,
            repeated,
            r#"{"ev":"result","at":9000,"t":7,"p":0}"#,
            r#"{"ev":"emit","at":9000,"t":7,"p":0}"#,
        ]
        .map(|line| format!("{line}\n"))
        .concat()
    };
    let shown = |trace: String| -> Vec<Value> {
        fs::write(&path, trace.replace("\n\n", "\n")).unwrap();
        let (trace, out) = (path.to_str().unwrap(), out.to_str().unwrap());
        let exported = run(&["export", "--force", "--perfetto", trace, "-o", out], "");
        assert_eq!(exported.status.code(), Some(0), "{}", err(&exported));
        let events: Value = serde_json::from_slice(&fs::read(out).unwrap()).unwrap();
        events["traceEvents"].as_array().unwrap().clone()
    };
    let repeated = "{\"ev\":\"open\",\"at\":5000,\"t\":7,\"origin\":\"other\",\"seq\":1}\n\
                    {\"ev\":\"refuse\",\"at\":5000,\"t\":7,\"why\":\"order\"}";
    let (mut with, without) = (shown(trace(repeated)), shown(trace("")));
    let refusals: Vec<_> =
        with.extract_if(.., |event| event["name"] == "timestamp 7: refused, order").collect();
    assert_eq!((refusals.len(), with), (1, without));
}

/// Calls one after the other are on one track, those at once on one each, and both are used again.
#[test]
fn perfetto_has_as_many_tracks_of_a_source_as_calls_were_under_way_at_once() {
    let dir = tempdir().unwrap();
    let path = dir.path().join("trace.jsonl");
    let mut trace =
        r#"{"fuseline":1,"window":4,"clouds":[{"p":1,"limit":4,"resume":0}]}"#.to_owned();
    for t in 0..40_u64 {
        let (at, due) = (500 * t, 500 * t + 1200);
        for line in [
            format!(r#"{{"ev":"open","at":{at},"t":{t}}}"#),
            format!(r#"{{"ev":"request","at":{at},"t":{t},"p":1,"due":{due}}}"#),
        ] {
            trace.extend(["\n", line.as_str()]);
        }
        // Two messages are open at once: this one, and the one before until now.
        if let Some(t) = t.checked_sub(1) {
            for ev in ["result", "emit"] {
                trace.extend(["\n", &format!(r#"{{"ev":"{ev}","at":{at},"t":{t},"p":1}}"#)]);
            }
        }
    }
    fs::write(&path, trace + "\n").unwrap();
    let exported: Value = serde_json::from_slice(&export("--perfetto", &path)).unwrap();
    let events = exported["traceEvents"].as_array().unwrap();
    let names = events.iter().filter(|event| event["name"] == "thread_name");
    let names: Vec<_> = names.map(|event| event["args"]["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["outputs", "local", "cloud 1", "local (2)", "cloud 1 (2)"]);
}

/// A detector and a tracker that began 1 ms after it: frame 41, which the tracker gets as its
/// second message, and frame 40.
#[test]
fn a_frame_is_followed_through_several_operators_on_one_clock() {
    let dir = tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let lineage = |age: u64, seq: u64| {
        format!(r#""within":9000000,"age":{age},"origin":"camera/front","seq":{seq}"#)
    };
    let header = r#"{"fuseline":1,"operator":"NAME","window":4,"clouds":[]}"#;
    let detector = [
        header.replace("NAME", "detector"),
        format!(r#"{{"ev":"open","at":2000000,"t":0,{}}}"#, lineage(500_000, 40)),
        format!(r#"{{"ev":"open","at":2100000,"t":1,{}}}"#, lineage(100_000, 41)),
        r#"{"ev":"result","at":2200000,"t":1,"p":0,"of":1}"#.into(),
        r#"{"ev":"emit","at":2200000,"t":1,"p":0,"of":1}"#.into(),
        r#"{"ev":"result","at":2300000,"t":0,"p":0}"#.into(),
        r#"{"ev":"emit","at":2300000,"t":0,"p":0}"#.into(),
    ];
    let tracker = [
        header.replace("NAME", "tracker"),
        r#"{"ev":"open","at":1,"t":0}"#.into(),
        format!(r#"{{"ev":"open","at":1250000,"t":1,{}}}"#, lineage(250_000, 41)),
        r#"{"ev":"result","at":1900000,"t":1,"p":0}"#.into(),
        r#"{"ev":"emit","at":1900000,"t":1,"p":0}"#.into(),
    ];
    for (name, lines) in [("detector", &detector[..]), ("tracker", &tracker)] {
        fs::write(path(name), lines.join("\n") + "\n").unwrap();
    }
    let traces = [path("tracker"), path("detector"), path("out.json")];
    let [tracker, detector, out] = traces.each_ref().map(String::as_str);
    let exported = run(&["export", "--perfetto", tracker, detector, "-o", out], "");
    assert_eq!(exported.status.code(), Some(0), "{}", err(&exported));
    let events: Value = serde_json::from_slice(&fs::read(out).unwrap()).unwrap();
    let events = events["traceEvents"].as_array().unwrap();
    // The tracker is process 1 and began 1 ms later: all are on the detector's clock.
    let of = |ph: &str| {
        let found = events.iter().filter(|event| event["ph"] == ph);
        let fields =
            |event: &Value| (event["pid"].clone(), event["ts"].clone(), event["name"].clone());
        found.map(fields).collect::<Vec<_>>()
    };
    let flow = |pid: u64, ts: f64| vec![(pid.into(), ts.into(), "camera/front 41".into())];
    assert_eq!((of("s"), of("t"), of("f")), (flow(2, 2100.0), vec![], flow(1, 2250.0)));
    let ids =
        events.iter().filter(|event| event["cat"] == "frame").map(|event| event["id"].as_u64());
    assert_eq!(ids.collect::<BTreeSet<_>>().len(), 1);
    let ages = events.iter().filter(|event| event["ph"] == "i").map(|event| &event["args"]["age"]);
    let ages: Vec<_> = ages.map(Value::as_u64).collect();
    assert_eq!(ages, [Some(900_000), Some(200_000), Some(800_000)]);
    let slice = events.iter().find(|event| event["ph"] == "X" && event["args"]["seq"] == 40);
    assert_eq!(slice.unwrap()["args"]["origin"], "camera/front");
    for (args, why) in [
        (["export", "--mcap", tracker, detector, "-o"], "MCAP and OTLP take one trace"),
        (["export", "--perfetto", tracker, "-", "-o"], "read twice"),
    ] {
        let other = path("other");
        let refused = run(&[&args[..], &[&other]].concat(), "");
        assert_eq!(refused.status.code(), Some(2));
        assert!(err(&refused).contains(why), "{}", err(&refused));
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_half_written() {
    use std::io::Write as _;
    use std::process::Stdio;
    use std::time::{Duration, Instant};

    let dir = tempdir().unwrap();
    let names = || fs::read_dir(dir.path()).unwrap().count();
    let output = dir.path().join("out").display().to_string();
    let mut child =
        fuseline(&["export", "--mcap", "-o", &output]).stdin(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    input.write_all(b"{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n").unwrap();
    let start = Instant::now();
    while names() == 0 && start.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(names(), 1, "it writes");
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(names(), 0);
    drop(input);
}
