//! The errors that prevent a verdict.

use std::path::{Path, PathBuf};

/// The reason there is no ledger.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    /// A file or folder cannot be read, written or run.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The path.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The contents of a file are wrong.
    #[error("{path}: {why}", path = path.display())]
    Content {
        /// The path.
        path: PathBuf,
        /// The fault.
        why: String,
    },
    /// A tool that must succeed has failed.
    #[error("{tool} failed for {what}:\n{message}")]
    Tool {
        /// The tool.
        tool: &'static str,
        /// Its input.
        what: String,
        /// Its output.
        message: String,
    },
    /// The seeded faults cannot be read, or one cannot be seeded.
    #[error(transparent)]
    Faults(#[from] fuseline_faults::FaultsError),
    /// Nothing has this name.
    #[error("there is no {kind} {name}")]
    Name {
        /// A harness or a fault.
        kind: &'static str,
        /// The name that was given.
        name: String,
    },
    /// Ctrl-C was pressed.
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
