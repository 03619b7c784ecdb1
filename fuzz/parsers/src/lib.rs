//! What the fuzz targets of the parsers share: one check, again and again, in bounded memory, until
//! it finds something.

use std::alloc::System;
use std::sync::{LazyLock, Mutex, PoisonError};

use cap::Cap;
use fuseline_system_tests::parsers::{Ends, MEMORY, Parser};

/// Printed once reading ended in every way in which it can.
const REACHED: &str = "fuseline-fuzz: everything was reached";

/// An execution that allocates more than this ends the program.
#[global_allocator]
static MEMORY_IN_USE: Cap<System> = Cap::new(System, MEMORY);

/// How reading ended so far; nothing once it ended in every way.
static ENDS: LazyLock<Mutex<(Ends, bool)>> = LazyLock::new(Mutex::default);

/// Checks bytes, and says so when reading ended in every way for the first time.
///
/// The parser is given and not looked up, so that nothing of the others is in the program: libFuzzer goes through the
/// counters of all the code there is after each execution.
///
/// # Panics
/// If the check finds something, with what is wrong.
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
