//! Parameter files of ROS, up to the node's settings.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz_parsers::run("yaml", bytes));
