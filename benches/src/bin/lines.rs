//! A trace read and judged, each by a function of its own, for a tool that counts instructions from outside.
//!
//! `benches/worst-case` runs it. Prints how many lines the trace has.

use std::hint::black_box;

use fuseline_benches::trace::trace;
use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{Events, judge};

/// How many lines it has at least: enough that the judges' sets have their usual size.
const LINES: usize = 50_000;
const SLACK: Slack = Slack { tolerance: 2_000_000, lateness: 5_000_000 };

#[inline(never)]
fn lines_read(trace: &[u8]) {
    let mut reader = Events::new("trace", black_box(trace)).expect("a header");
    while let Some(event) = reader.next_event().expect("it can be read") {
        black_box(event);
    }
}

#[inline(never)]
fn lines_strict(trace: &[u8]) {
    let verdict = judge("trace", black_box(trace)).expect("it can be read");
    assert!(verdict.conforms);
}

#[inline(never)]
fn lines_observed(trace: &[u8]) {
    let verdict = observed::judge("trace", SLACK, black_box(trace)).expect("in order");
    assert!(verdict.conforms);
}

/// Marks the end of each for a tool that dumps its counters at the start of functions.
#[inline(never)]
fn lines_done() {
    black_box(());
}

fn main() {
    let (trace, lines) = trace(LINES);
    println!("{lines}");
    lines_read(&trace);
    lines_done();
    lines_strict(&trace);
    lines_done();
    lines_observed(&trace);
    lines_done();
}
