//! Measures how many lines a second one core judges, and which part of the time reading takes.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use fuseline_benches::trace::trace;
use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{Events, judge};

/// The least number of lines in the trace.
const LINES: usize = 1_000_000;

fn check(c: &mut Criterion) {
    let (trace, lines) = trace(LINES);
    let mut group = c.benchmark_group("check");
    group.throughput(Throughput::Elements(lines)).sample_size(20);
    group.bench_function("judge", |b| {
        b.iter(|| {
            let verdict = judge("trace", black_box(&trace[..])).expect("it can be read");
            assert!(verdict.violations.is_empty() && verdict.lines == lines);
        });
    });
    group.bench_function("observed", |b| {
        let slack = Slack { tolerance: 2_000_000, lateness: 5_000_000 };
        b.iter(|| {
            let verdict = observed::judge("trace", slack, black_box(&trace[..])).expect("in order");
            assert!(verdict.violations.is_empty() && verdict.lines == lines);
        });
    });
    group.bench_function("read", |b| {
        b.iter(|| {
            let mut reader = Events::new("trace", black_box(&trace[..])).expect("a header");
            while let Some(event) = reader.next_event().expect("it can be read") {
                black_box(event);
            }
        });
    });
    group.finish();
}

criterion_group!(benches, check);
criterion_main!(benches);
