//! What can go wrong.

use std::io;
use std::path::{Path, PathBuf};

/// Why there is no evidence.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvidenceError {
    /// A file or folder cannot be used.
    #[error("{}: {source}", path.display())]
    File {
        /// Which one.
        path: PathBuf,
        /// What went wrong.
        source: io::Error,
    },
    /// A file does not say what it should.
    #[error("{}: {why}", path.display())]
    Content {
        /// Which one.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// A fault cannot be seeded.
    #[error("fault {name}: {why}")]
    Seed {
        /// Its name.
        name: String,
        /// What is wrong with it.
        why: String,
    },
    /// A run of witnesses says nothing.
    #[error("{kind}, {run}: {why}; see {}", log.display())]
    Run {
        /// The kind of witness.
        kind: &'static str,
        /// The fault's name, or that there was none.
        run: String,
        /// What is wrong.
        why: String,
        /// What it printed.
        log: PathBuf,
    },
    /// A tool is not there.
    #[error("{tool}: there is no such tool here; {remedy}")]
    Tool {
        /// How it was called.
        tool: String,
        /// How it comes here.
        remedy: String,
    },
    /// The user wants it to end.
    #[error("interrupted; what is done so far is kept")]
    Interrupted,
}

impl EvidenceError {
    /// About this file.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::File { path: path.to_owned(), source }
    }

    /// About what this file says.
    pub(crate) fn content(path: &Path, why: impl Into<String>) -> Self {
        Self::Content { path: path.to_owned(), why: why.into() }
    }
}
