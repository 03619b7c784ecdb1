//! The page of a report: its data are whatever a trace says, and stay data.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz_parsers::run("page", bytes));
