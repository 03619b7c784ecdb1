//! `fuseline export`, run as a user runs it.

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use common::{err, fuseline, interrupt, out, run};
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
fn each_slice_for_perfetto_ends_and_no_nanosecond_is_lost() {
    let mut ends: BTreeMap<String, u32> = BTreeMap::new();
    for path in corpus() {
        let bytes = export("--perfetto", &path);
        let trace: Value = serde_json::from_slice(&bytes).unwrap();
        let (mut open, mut outputs) = (BTreeMap::new(), 0);
        for event in trace["traceEvents"].as_array().unwrap() {
            let id = event["id"].as_str().unwrap_or_default().to_owned();
            match event["ph"].as_str().unwrap() {
                "b" => assert!(open.insert(id, event["ts"].as_f64().unwrap()).is_none()),
                "e" => {
                    let began = open.remove(&id).expect("it began");
                    assert!(began <= event["ts"].as_f64().unwrap());
                    *ends.entry(event["args"]["end"].as_str().unwrap().to_owned()).or_default() +=
                        1;
                }
                "i" => outputs += u32::from(event["tid"] == 1 << 16),
                "M" => assert!(event.get("ts").is_none()),
                other => panic!("{other}"),
            }
        }
        assert!(open.is_empty(), "{open:?} of {}", path.display());
        let text = fs::read_to_string(&path).unwrap();
        let forwarded =
            text.matches("\"ev\":\"emit\"").count() + text.matches("\"ev\":\"miss\"").count();
        assert_eq!(outputs as usize, forwarded, "{}", path.display());
    }
    let kinds: Vec<&str> = ends.keys().map(String::as_str).collect();
    assert_eq!(kinds, ["cancelled", "failure", "open", "refused", "result", "retired", "timer"]);

    let dir = tempdir().unwrap();
    let path = dir.path().join("trace.jsonl");
    let open = "{\"ev\":\"open\",\"at\":18446744073709551615,\"t\":1}\n";
    fs::write(&path, format!("{{\"fuseline\":1,\"window\":1,\"clouds\":[]}}\n{open}")).unwrap();
    let text = String::from_utf8(export("--perfetto", &path)).unwrap();
    assert!(text.contains("\"ts\":18446744073709551.615,"), "{text}");
}

#[test]
fn bad_input_is_one_line_and_leaves_the_output_as_it_was() {
    let dir = tempdir().unwrap();
    let output = dir.path().join("out");
    fs::write(&output, "as it was").unwrap();
    let output = output.to_str().unwrap();
    let header = "{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n";
    let cut = run(&["export", "--mcap", "-o", output], &format!("{header}{{\"ev\":"));
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
