//! What the fuzz targets share: one check, again and again, until it finds something.

use std::sync::{LazyLock, Mutex, PoisonError};

use fuseline_testkit::{Coverage, Mark};

/// Printed once everything that a target can come to was reached.
const REACHED: &str = "fuseline-fuzz: everything was reached";

/// What a target checks of bytes.
pub type TargetCheck = fn(&[u8], &mut Coverage) -> Result<(), String>;

/// What this program came to so far; nothing once all was reached.
static REACH: LazyLock<Mutex<(Coverage, bool)>> = LazyLock::new(Mutex::default);

/// Checks bytes, and says so when everything in `marks` was reached for the first time.
///
/// # Panics
/// If the check finds something, with the trace that shows it.
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
