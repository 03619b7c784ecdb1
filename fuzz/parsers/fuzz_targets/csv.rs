//! CSV: events, drives, recordings of a probe, calls that were observed.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz_parsers::run("csv", bytes));
