//! What keeps a run from its verdict.

use std::path::{Path, PathBuf};

/// Why there is no ledger.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    /// A file or folder cannot be read, written or run.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What went wrong.
        source: std::io::Error,
    },
    /// A file does not say what it should.
    #[error("{path}: {why}", path = path.display())]
    Content {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A tool failed where it must not.
    #[error("{tool} failed for {what}:\n{message}")]
    Tool {
        /// Which.
        tool: &'static str,
        /// On what.
        what: String,
        /// What it printed.
        message: String,
    },
    /// The seeded faults cannot be read, or one cannot be seeded.
    #[error(transparent)]
    Faults(#[from] fuseline_faults::FaultsError),
    /// There is nothing of this name.
    #[error("there is no {kind} {name}")]
    Name {
        /// A harness or a fault.
        kind: &'static str,
        /// The name that was given.
        name: String,
    },
    /// Ctrl-C.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    pub(crate) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::File { path, source }
    }

    pub(crate) fn content(path: &Path, why: &dyn std::fmt::Display) -> Self {
        Self::Content { path: path.to_owned(), why: format!("{why}") }
    }
}
