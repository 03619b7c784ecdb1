//! Reads and judges a trace, each in a function of its own, under a tool that counts instructions.
//!
//! `benches/worst-case` runs it. It prints the number of lines in the trace.

use std::hint::black_box;
use std::io::{self, Cursor};

use fuseline_benches::trace::trace;
use fuseline_engine::Mcap;
use fuseline_traces::observed::{self, Slack};
use fuseline_traces::packed::unpack;
use fuseline_traces::{Events, judge};

/// The least number of lines in the trace, which is enough for the judges' sets to reach their
/// usual size.
const LINES: usize = 50_000;
const SLACK: Slack = Slack { tolerance: 2_000_000, lateness: 5_000_000 };

#[inline(never)]
fn lines_read(trace: &[u8]) {
    let mut reader = Events::new("trace", black_box(trace)).expect("a header");
    while let Some(event) = reader.next_event().expect("it can be read") {
        black_box(event);
    }
}

/// Unpacks MCAP to lines, but does not parse them.
#[inline(never)]
fn lines_unpacked(packed: &[u8]) {
    let mut lines = unpack(black_box(packed)).expect("it can be read");
    io::copy(&mut lines, &mut io::sink()).expect("it can be read");
}

#[inline(never)]
fn lines_strict(trace: &[u8]) {
    let verdict = judge("trace", black_box(trace)).expect("it can be read");
    assert!(verdict.violations.is_empty());
}

#[inline(never)]
fn lines_observed(trace: &[u8]) {
    let verdict = observed::judge("trace", SLACK, black_box(trace)).expect("in order");
    assert!(verdict.violations.is_empty());
}

/// Marks the end of each step for a tool that dumps its counters at the start of functions.
#[inline(never)]
fn lines_done() {
    black_box(());
}

/// Returns the trace as MCAP with zstd.
fn mcap(trace: &[u8]) -> Vec<u8> {
    let mut reader = Events::new("trace", trace).expect("a header");
    let mut packed = Cursor::new(Vec::new());
    let (header, annotations) = (reader.header(), reader.header_annotations());
    let mut mcap = Mcap::new(&mut packed, header, annotations, 0).expect("memory takes all");
    while let Some(event) = reader.next_event().expect("it can be read") {
        mcap.event(&event, reader.annotations()).expect("memory takes all");
    }
    mcap.finish().expect("memory takes all");
    packed.into_inner()
}

fn main() {
    let (trace, lines) = trace(LINES);
    let packed = mcap(&trace);
    println!("{lines}");
    lines_read(&trace);
    lines_done();
    lines_unpacked(&packed);
    lines_done();
    lines_strict(&trace);
    lines_done();
    lines_observed(&trace);
    lines_done();
}
