//! `fuseline frame`, run as a user runs it.

mod common;

use std::fs;

use common::{err, out, run};
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
