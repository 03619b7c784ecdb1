//! The built command, run as a user runs it.

pub(crate) mod certificates;
pub(crate) mod drawn;
pub(crate) mod recount;
pub(crate) mod running;
pub(crate) mod sample;
pub(crate) mod signal;

use std::io::Write;
use std::process::{Command, Output, Stdio};

/// Judges a trace as observed, and accepts what a short trace leaves in doubt.
pub(crate) const OBSERVED: [&str; 8] = [
    "check",
    "--observed",
    "--tolerance",
    "1ms",
    "--lateness",
    "5ms",
    "--accept",
    "silent,blurred,endless",
];

/// The command with these arguments.
pub(crate) fn fuseline(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fuseline"));
    command.args(args).env_remove("RUST_LOG").env_remove("FUSELINE_TOKEN");
    command
}

/// Runs it to its end with this standard input.
pub(crate) fn run(args: &[&str], input: &str) -> Output {
    let mut command = fuseline(args);
    let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = piped.spawn().unwrap();
    // It may end without reading everything.
    drop(child.stdin.take().unwrap().write_all(input.as_bytes()));
    child.wait_with_output().unwrap()
}

/// Returns an instant as Perfetto's file has it.
pub(crate) fn micros(nanos: u64) -> String {
    format!("{}.{:03}", nanos / 1000, nanos % 1000)
}

/// Returns the text on standard output.
pub(crate) fn out(output: &Output) -> &str {
    str::from_utf8(&output.stdout).unwrap()
}

/// Returns the text on standard error.
pub(crate) fn err(output: &Output) -> &str {
    str::from_utf8(&output.stderr).unwrap()
}
