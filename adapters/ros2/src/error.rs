//! The reasons why a node does not run.

use std::path::PathBuf;

use fuseline_tokio::grpc::{InvalidToken, RemoteError};
use rustdds::dds::CreateError;
use thiserror::Error;

use crate::settings::SettingsError;

/// The reason why a cloud's server cannot be called.
#[derive(Debug, Error)]
pub enum GrpcError {
    /// A file that a parameter names cannot be read.
    #[error("{path} cannot be read: {error}")]
    File {
        /// The file.
        path: String,
        /// The system's error.
        error: std::io::Error,
    },
    /// The file of the CA has no certificate.
    #[error(
        "{path} has no certificate; give one in PEM, which begins with -----BEGIN CERTIFICATE-----"
    )]
    NoCertificate {
        /// The file.
        path: String,
    },
    /// The file has no valid token.
    #[error("{path} has no token: {error}")]
    Token {
        /// The file.
        path: String,
        /// The reason.
        error: InvalidToken,
    },
    /// The server's address, certificates or key are not valid.
    #[error(transparent)]
    Remote(#[from] RemoteError),
}

/// The reason why a node does not run, or did not end well.
#[derive(Debug, Error)]
pub enum NodeError {
    /// The engine refuses a parameter.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A recording's file cannot be created.
    #[error("{path} cannot be written: {error}", path = path.display())]
    Recording {
        /// The file.
        path: PathBuf,
        /// The system's error.
        error: std::io::Error,
    },
    /// A cloud's server cannot be called.
    #[error("the cloud {cloud}: {error}")]
    Grpc {
        /// The cloud's name.
        cloud: String,
        /// The reason.
        error: GrpcError,
    },
    /// There is no timer of the kind that was set.
    #[error("there is no timer to wake the node: {0}; timers:=tokio needs none from the system")]
    Timers(std::io::Error),
    /// The system does not grant real-time scheduling or locked memory.
    #[error("realtime: {0}; realtime:=0 runs without it")]
    Realtime(String),
    /// DDS refuses a publisher, a subscriber or the domain.
    #[error("DDS: {0}")]
    Dds(#[from] CreateError),
    /// A topic is on Zenoh, which is not built in.
    #[error("this build has no Zenoh; build it with --features zenoh")]
    NoZenoh,
    /// A topic is on a middleware that was not joined.
    #[error("the node has not joined {0}")]
    NotJoined(&'static str),
    /// Zenoh's configuration cannot be read.
    #[error("Zenoh: {0}")]
    ZenohConfig(String),
    /// Zenoh refuses the session, a publisher or a subscriber.
    #[error("Zenoh: {0}")]
    Zenoh(String),
    /// ROS refuses the node, a publisher or a subscriber.
    #[error("ROS: {0}")]
    Ros(String),
    /// The system refuses something basic, such as a thread.
    #[error("the operating system: {0}")]
    System(std::io::Error),
    /// The trace of the run is not whole.
    #[error("the trace is incomplete, because writing it failed: {0}")]
    Trace(std::io::Error),
}

#[cfg(feature = "zenoh")]
impl From<zenoh::Error> for NodeError {
    fn from(error: zenoh::Error) -> Self {
        Self::Zenoh(error.to_string())
    }
}
