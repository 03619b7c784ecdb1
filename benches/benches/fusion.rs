//! Time per input at 3 clouds and a window of 16, arrivals from recorded drives, beside a hash map and a heap.

use std::collections::hash_map::RandomState;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use fuseline_benches::arrivals::{CLOUDS, WINDOW, fusion, inputs};
use fuseline_benches::baseline::Baseline;
use fuseline_benches::machine::{Machine, Tally};
use fuseline_core::Commit;
use rustc_hash::FxBuildHasher;

/// One pass over all inputs.
fn pass(mut machine: impl Machine, inputs: &[fuseline_traces::Input]) -> Tally {
    let mut tally = Tally::default();
    for input in inputs {
        machine.apply(black_box(input), &mut tally);
    }
    tally
}

fn drives(c: &mut Criterion) {
    for (name, commit) in [("eager", Commit::Eager), ("patient", Commit::Patient)] {
        let inputs = inputs(2_000, commit);
        let core = || fusion(commit).expect("a valid configuration");
        let tally = pass(core(), &inputs);
        assert_eq!(tally, pass(Baseline::<RandomState>::new(WINDOW, commit, &CLOUDS), &inputs));
        println!("drives/{name}: {} inputs, {tally:?}", inputs.len());

        let mut group = c.benchmark_group(format!("drives_{name}"));
        group.throughput(Throughput::Elements(inputs.len() as u64));
        group.bench_function("fuseline", |b| b.iter(|| pass(core(), &inputs)));
        group.bench_function("hash_map_and_heap", |b| {
            b.iter(|| pass(Baseline::<RandomState>::new(WINDOW, commit, &CLOUDS), &inputs));
        });
        group.bench_function("fast_hash_map_and_heap", |b| {
            b.iter(|| pass(Baseline::<FxBuildHasher>::new(WINDOW, commit, &CLOUDS), &inputs));
        });
        group.finish();
    }
}

criterion_group!(benches, drives);
criterion_main!(benches);
