//! Standard error, which nobody has to read.

use std::fmt;
use std::io::{self, Write};

/// Tells a line on standard error. That nobody reads it must not end what goes well.
pub(crate) fn complain(line: impl fmt::Display) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}
