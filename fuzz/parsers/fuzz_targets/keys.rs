//! CDR: the key of a serialized message.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::KEYS;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&KEYS, bytes));
