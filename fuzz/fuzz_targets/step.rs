//! Compares the machine that ships with the reference machine, decision by decision.
#![no_main]

use fuseline_testkit::Mark;
use fuseline_tests::fuzz::step;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz::run(step, Mark::of_runs, bytes));
