//! Traces in every packing: gzip, zstd, MCAP and plain.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::PACKED;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&PACKED, bytes));
