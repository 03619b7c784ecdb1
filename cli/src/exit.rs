//! The exit codes of commands.

use std::process::ExitCode;

/// The exit code of a command that Ctrl-C ended.
pub(crate) const INTERRUPTED: i32 = 130;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Exit {
    /// All is well.
    Conforms = 0,
    /// A trace does not conform.
    Differs = 1,
    /// Something could not be read or made.
    BadInput = 2,
    /// No violation was found, and something is in doubt.
    Doubt = 3,
}

impl Exit {
    /// Returns the worse of two codes: 2 over 1 over 3 over 0.
    #[must_use]
    pub(crate) const fn or_worse(self, other: Self) -> Self {
        if self.rank() < other.rank() { other } else { self }
    }

    const fn rank(self) -> u8 {
        match self {
            Self::Conforms => 0,
            Self::Doubt => 1,
            Self::Differs => 2,
            Self::BadInput => 3,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
