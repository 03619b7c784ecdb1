//! The errors of a planned run.

use std::io;

use fuseline_tokio::SpawnError;
use fuseline_tokio::grpc::RemoteError;
use thiserror::Error;

use crate::fault::{Fault, chain, plain};
use crate::files::FileError;
use crate::run::plan::at;

/// The reason why a run cannot begin, or has no whole trace.
#[derive(Debug, Error)]
pub(super) enum RunError {
    #[error("{}cloud {cloud:?}: {}", at(.place.as_deref()), chain(.source))]
    Remote { place: Option<String>, cloud: String, source: RemoteError },
    #[error("{}{source}", at(.place.as_deref()))]
    File { place: Option<String>, source: FileError },
    #[error("{0}; choose other options for the clouds or the window")]
    Spawn(#[from] SpawnError),
    #[error("no port on 127.0.0.1 is free: {}; end programs that hold ports", plain(.0))]
    Loopback(io::Error),
    #[error("{trace}: {why}; the tables show what was written: make room, or name another --trace")]
    Unrecorded { trace: String, why: String },
}

impl From<RunError> for Fault {
    fn from(error: RunError) -> Self {
        Self::own(error)
    }
}
