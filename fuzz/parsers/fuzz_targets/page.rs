//! The page of a report, whose data come from a trace and must stay data.
#![no_main]

use fuseline_fuzz_parsers::run;
use fuseline_system_tests::parsers::PAGE;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| run(&PAGE, bytes));
