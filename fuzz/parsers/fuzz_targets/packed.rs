//! Traces however they are packed: gzip, zstd, MCAP, plain.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::PACKED;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&PACKED, bytes));
