//! Measures the time per input with 3 clouds and a window of 16, with arrivals from recorded
//! drives. A machine of a hash map and a heap is measured in turns for comparison.

use std::collections::hash_map::RandomState;
use std::hint::black_box;
use std::time::{Duration, Instant};

use fuseline_benches::arrivals::{CLOUDS, WINDOW, fusion, inputs};
use fuseline_benches::baseline::Baseline;
use fuseline_benches::beside::{in_turns, passes};
use fuseline_benches::machine::{DecisionTally, Machine};
use fuseline_core::Commit;
use fuseline_traces::Input;
use rustc_hash::FxBuildHasher;

/// Applies all inputs once. Returns the decisions, and how long that took.
#[inline(never)]
fn pass(mut machine: impl Machine, inputs: &[Input]) -> (DecisionTally, Duration) {
    let mut tally = DecisionTally::default();
    let start = Instant::now();
    for input in inputs {
        machine.apply(black_box(input), &mut tally);
    }
    (black_box(tally), start.elapsed())
}

fn main() {
    println!("ns an input, median and best; how often the window's goes into it");
    for (name, commit) in [("eager", Commit::Eager), ("patient", Commit::Patient)] {
        let inputs = inputs(2_000, commit);
        let ours = || pass(fusion(commit).expect("a valid configuration"), &inputs);
        let fast = || pass(Baseline::<FxBuildHasher>::new(WINDOW, commit, &CLOUDS), &inputs);
        let std = || pass(Baseline::<RandomState>::new(WINDOW, commit, &CLOUDS), &inputs);
        let (tally, _) = ours();
        assert!([fast().0, std().0].iter().all(|of_other| *of_other == tally));
        println!("{name}: {} inputs, {tally:?}", inputs.len());
        let [ours, fast, std] =
            in_turns(passes(400), [&mut || ours().1, &mut || fast().1, &mut || std().1])
                .map(|times| times.an_input(inputs.len()));
        for (name, (median, best)) in
            [("Fuseline", ours), ("fast hash and heap", fast), ("std hash and heap", std)]
        {
            let (to_median, to_best) = (median / ours.0, best / ours.1);
            println!("  {name:24} {median:6.1} {best:6.1}   {to_median:4.2} {to_best:4.2}");
        }
    }
}
