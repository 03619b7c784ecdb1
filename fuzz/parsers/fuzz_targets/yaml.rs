//! ROS parameter files, up to the node's settings.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::YAML;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&YAML, bytes));
