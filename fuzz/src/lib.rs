//! Shared by the fuzz targets: runs one check repeatedly until it finds something.

use std::sync::{LazyLock, Mutex, PoisonError};

use fuseline_testkit::{Coverage, Mark};

/// Printed once everything that a target can reach was reached.
const REACHED: &str = "fuseline-fuzz: everything was reached";

/// A target's check of bytes.
pub type TargetCheck = fn(&[u8], &mut Coverage) -> Result<(), String>;

/// The coverage of this program so far, and `true` once it is complete.
static REACH: LazyLock<Mutex<(Coverage, bool)>> = LazyLock::new(Mutex::default);

/// Checks bytes, and prints a line when everything in `marks` was reached for the first time.
///
/// # Panics
/// Panics with the trace if the check finds something.
pub fn run(check: TargetCheck, marks: fn() -> Vec<Mark>, bytes: &[u8]) {
    let mut shared = REACH.lock().unwrap_or_else(PoisonError::into_inner);
    let (reach, complete) = &mut *shared;
    if let Err(fault) = check(bytes, reach) {
        panic!("{fault}");
    }
    if !*complete && reach.missing(marks()).is_empty() {
        *complete = true;
        eprintln!("{REACHED}");
    }
}
