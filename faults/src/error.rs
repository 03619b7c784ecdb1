//! The errors of a campaign.

use std::io;
use std::path::{Path, PathBuf};

/// The reason a run has no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FaultsError {
    /// A file or folder cannot be used.
    #[error("{}: {source}", path.display())]
    File {
        /// The path of the file or folder.
        path: PathBuf,
        /// The error.
        source: io::Error,
    },
    /// The content of a file is wrong.
    #[error("{}: {why}", path.display())]
    Content {
        /// The path of the file.
        path: PathBuf,
        /// The mistake.
        why: String,
    },
    /// A fault cannot be seeded.
    #[error("fault {name}: {why}")]
    Seed {
        /// Its name.
        name: String,
        /// The mistake.
        why: String,
    },
    /// The witnesses of a kind do not build or do not run.
    #[error("{what}: {why}; see {}", log.display())]
    Run {
        /// The witnesses, and the fault if there was one.
        what: String,
        /// The mistake.
        why: String,
        /// The output.
        log: PathBuf,
    },
    /// The user interrupted the run.
    #[error("interrupted")]
    Interrupted,
}

impl FaultsError {
    /// Returns an error about this file.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::File { path: path.to_owned(), source }
    }

    /// Returns an error about the content of this file.
    pub(crate) fn content(path: &Path, why: impl Into<String>) -> Self {
        Self::Content { path: path.to_owned(), why: why.into() }
    }
}
