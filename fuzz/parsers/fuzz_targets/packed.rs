//! Traces however they are packed: gzip, zstd, MCAP, plain.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz_parsers::run("packed", bytes));
