//! Gives any bytes to the reader: the outcome is an error with its place, or lines that survive
//! writing.
#![no_main]

use fuseline_testkit::Mark;
use fuseline_tests::fuzz::trace_parse;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz::run(trace_parse, Mark::of_files, bytes));
