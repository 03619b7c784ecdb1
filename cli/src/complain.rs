//! Standard error, which may be closed.

use std::fmt;
use std::io::{self, Write};

/// Prints a line on standard error. If it is closed, the command goes on.
pub(crate) fn complain(line: impl fmt::Display) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}
