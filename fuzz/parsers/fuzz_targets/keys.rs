//! CDR: the key of a serialized message.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuseline_fuzz_parsers::run("keys", bytes));
