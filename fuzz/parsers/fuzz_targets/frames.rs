//! The contents of gRPC frames: requests, replies, locations.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::FRAMES;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&FRAMES, bytes));
