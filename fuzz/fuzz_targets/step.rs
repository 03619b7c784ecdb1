//! The machine that ships against the reference machine, decision for decision.
#![no_main]

use fuseline_tests::fuzz::{Mark, step};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz::run(step, Mark::of_step, bytes));
