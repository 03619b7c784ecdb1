//! Rows of CSV, and the lines that errors name, of every command that reads them.

mod common;

use std::fs;

use common::{err, run};

/// What each command says of a file whose row at line 5 is wrong, after an empty line.
fn complaints(end: &str) -> Vec<String> {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, rows: &[&str]| {
        let path = dir.path().join(name);
        fs::write(&path, rows.join(end)).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let events = write("events.csv", &["at,ev,t", "0,open,1", "", "1,open,2", "x,open,3"]);
    let header = write("header.jsonl", &["{\"fuseline\":1,\"window\":4,\"clouds\":[]}\n"]);
    let drive = write("drive.csv", &["sent_ms,rtt_ms", "0,10", "", "100,10", "200,x"]);
    let probed = write("probed.csv", &["sent_ms,rtt_ms", "0,10", "", "100,10", "200,-7"]);
    let short = write("short.csv", &["sent_ms,rtt_ms", "0,10", "", "100,10", "200"]);
    let calls = write("calls.csv", &["response_s,answered", "0.1,1", "", "0.2,1", "0.3,2"]);
    let plots = dir.path().join("plots");
    let cloud = |drive: &str| format!("name=a,priority=1,model=DINO-SWIN-Small,drive={drive}");
    let clouds = [cloud(&drive), cloud(&short)];
    let trace = dir.path().join("trace.jsonl");
    let trace = trace.to_str().unwrap();
    let calls_of = [
        vec!["convert", "--header", &header, &events],
        vec!["run", "--seconds", "1", "--trace", trace, "--cloud", &clouds[0]],
        vec!["run", "--seconds", "1", "--trace", trace, "--cloud", &clouds[1]],
        vec!["deadline", "--speed", "10", "--observed", &calls],
        vec!["probe", "--plot", &probed, "-o", plots.to_str().unwrap()],
        vec!["probe", "--plot", &short, "-o", plots.to_str().unwrap()],
    ];
    let complain = |args: Vec<&str>| {
        let done = run(&args, "");
        assert_eq!(done.status.code(), Some(2), "{args:?}");
        err(&done).replace(dir.path().to_str().unwrap(), "")
    };
    calls_of.into_iter().map(complain).collect()
}

#[test]
fn an_error_names_the_line_of_its_row_whatever_ends_the_lines() {
    for end in ["\n", "\r\n"] {
        let complaints = complaints(end);
        let files = ["events", "drive", "short", "calls", "probed", "short"];
        for (complaint, file) in complaints.iter().zip(files) {
            assert!(complaint.contains(&format!("/{file}.csv:5: ")), "{complaint}");
            assert_eq!(complaint.lines().count(), 1, "{complaint}");
        }
    }
}
