//! CSV: events, drives, recordings of a probe, and observed calls.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::CSV;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&CSV, bytes));
