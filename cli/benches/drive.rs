//! Measures how fast implementations are driven: the core behind the protocol, and the example in
//! Python if Python is installed. Each input is answered before the next is sent.

use std::process::Command;

use serde_json::Value;

/// Odd, so that there is a median.
const TURNS: usize = 3;

fn main() {
    let fuseline = env!("CARGO_BIN_EXE_fuseline");
    let python = concat!(env!("CARGO_MANIFEST_DIR"), "/../traces/examples/arbiter.py");
    println!(
        "the corpus and the generated runs of a drive without options, the median of {TURNS} turns"
    );
    drive(fuseline, "fuseline impl", &[fuseline, "impl"]);
    if Command::new("python3").arg("--version").output().is_ok() {
        drive(fuseline, "arbiter.py", &["python3", python]);
    } else {
        println!("arbiter.py: skipped, python3 is not installed");
    }
}

fn drive(fuseline: &str, name: &str, command: &[&str]) {
    let mut turns: Vec<(f64, u64)> = (0..TURNS).map(|_| turn(fuseline, command)).collect();
    turns.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((seconds, inputs)) = turns.get(TURNS / 2) {
        println!("{name}: {inputs} inputs in {seconds:.1} s");
    }
}

/// The seconds that one suite took, and its inputs.
fn turn(fuseline: &str, command: &[&str]) -> (f64, u64) {
    let mut drive = Command::new(fuseline);
    let driven = drive.args(["drive", "--json", "--"]).args(command).output();
    let driven = driven.expect("it can be started");
    assert!(driven.status.success(), "it does not conform");
    let report: Value = serde_json::from_slice(&driven.stdout).expect("a report");
    let number = |key: &str| report.get(key).cloned().unwrap_or_default();
    (number("seconds").as_f64().unwrap_or(f64::NAN), number("inputs").as_u64().unwrap_or(0))
}
