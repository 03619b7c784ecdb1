//! Shared by the parsers' fuzz targets: runs one check repeatedly, in bounded memory, until it
//! finds something.

use std::alloc::System;
use std::sync::{LazyLock, Mutex, PoisonError};

use cap::Cap;
use fuseline_system_tests::parsers::{Ends, MEMORY, Parser};

/// Printed once reading has ended in every possible way.
const REACHED: &str = "fuseline-fuzz: everything was reached";

/// Ends the program in an execution that allocates more than this.
#[global_allocator]
static MEMORY_IN_USE: Cap<System> = Cap::new(System, MEMORY);

/// The ways in which reading has ended so far, and `true` once these are all of them.
static ENDS: LazyLock<Mutex<(Ends, bool)>> = LazyLock::new(Mutex::default);

/// Checks bytes, and prints a line when reading has ended in every way for the first time.
///
/// The parser is an argument and is not looked up, so that the program contains no other parser:
/// libFuzzer goes through the counters of all its code after each execution.
///
/// # Panics
/// Panics with the fault if the check finds something.
pub fn run(parser: &Parser, bytes: &[u8]) {
    let mut shared = ENDS.lock().unwrap_or_else(PoisonError::into_inner);
    let (ends, complete) = &mut *shared;
    if let Err(fault) = (parser.check)(bytes, ends) {
        panic!("{fault}");
    }
    if !*complete && parser.ends.iter().all(|end| ends.contains(end)) {
        *complete = true;
        eprintln!("{REACHED}");
    }
}
