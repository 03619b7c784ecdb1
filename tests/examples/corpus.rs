//! Replays each conforming trace of the corpus through the core, and prints the outcome of each in
//! the form of a test.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::corpus::{CASES, Example};
use fuseline_traces::{Decision, Event, Events};

fn main() -> ExitCode {
    let mut all = true;
    for case in CASES {
        // The name is on a line of its own before the replay, so that a replay that never ends has
        // been named.
        println!("test {} ...", case.name);
        let alike = catch_unwind(AssertUnwindSafe(|| replays(case))).unwrap_or(false);
        println!("test {} ... {}", case.name, if alike { "ok" } else { "FAILED" });
        all &= alike;
    }
    if all { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Returns `true` if the core answers the inputs with the decisions that follow them.
fn replays(case: &Example) -> bool {
    let mut reader = Events::new(case.name, case.trace.as_bytes()).expect("it has a header");
    let mut arbiter: Arbiter = Arbiter::new(reader.header()).expect("a sound configuration");
    let mut expected: Vec<Decision> = Vec::new();
    let mut found: Vec<Decision> = Vec::new();
    while let Some(event) = reader.next_event().expect("it is well formed") {
        match event {
            Event::Input(input) => arbiter.decide(&input, |decision| found.push(decision)),
            Event::Decision(decision) => expected.push(decision),
        }
    }
    found == expected
}
