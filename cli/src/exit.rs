//! How a command ends.

use std::process::ExitCode;

/// The exit code of a command that Ctrl-C ended.
pub(crate) const INTERRUPTED: i32 = 130;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Exit {
    /// All is well.
    Conforms = 0,
    /// A trace does not conform.
    Differs = 1,
    /// Something could not be read or made.
    BadInput = 2,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
