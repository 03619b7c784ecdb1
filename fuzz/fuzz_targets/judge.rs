//! Checks that the judge accepts the core's decisions, and finds an edited decision at its line.
#![no_main]

use fuseline_tests::fuzz::{judge, marks_of_judge};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz::run(judge, marks_of_judge, bytes));
