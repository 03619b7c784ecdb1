//! What stands in gRPC frames: requests, replies, locations.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz_parsers::run("frames", bytes));
