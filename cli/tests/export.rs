//! `fuseline export`, run as a user runs it.

mod common;
#[path = "common/signal.rs"]
mod signal;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use common::{err, fuseline, out, run};
use fuseline_traces::parse;
use serde_json::Value;
use signal::interrupt;
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
