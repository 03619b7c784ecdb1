//! What keeps a node from running.

use std::path::PathBuf;

use fuseline_deadline::Invalid;
use fuseline_engine::EngineConfigError;
use fuseline_tokio::grpc::{InvalidToken, RemoteError};
use rustdds::dds::CreateError;
use thiserror::Error;

/// Why a cloud's server cannot be called.
#[derive(Debug, Error)]
pub enum GrpcError {
    /// A file that a parameter names cannot be read.
    #[error("{path} cannot be read: {error}")]
    File {
        /// The file.
        path: String,
        /// Why not.
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
        /// Why not.
        error: InvalidToken,
    },
    /// The server's address, certificates or key are not valid.
    #[error(transparent)]
    Remote(#[from] RemoteError),
}

/// Why a node does not run, or did not end well.
#[derive(Debug, Error)]
pub enum NodeError {
    /// There is no machine with these parameters.
    #[error("the parameters are refused: {0}")]
    Config(#[from] EngineConfigError),
    /// Figures that make no policy.
    #[error("the policy's parameters are refused: {0}")]
    Policy(#[from] Invalid),
    /// A recording's file cannot be created.
    #[error("{path} cannot be written: {error}", path = path.display())]
    Recording {
        /// The file.
        path: PathBuf,
        /// Why not.
        error: std::io::Error,
    },
    /// A cloud's server cannot be called.
    #[error("the cloud {cloud}: {error}")]
    Grpc {
        /// The cloud's name.
        cloud: String,
        /// Why not.
        error: GrpcError,
    },
    /// There is no timer of the kind that was set.
    #[error("no timer to wake the node: {0}; timers:=tokio needs nothing of the system")]
    Timers(std::io::Error),
    /// Real-time scheduling or locked memory is not granted.
    #[error("realtime: {0}; realtime:=0 does without")]
    Realtime(String),
    /// DDS refuses an end of a topic, or the domain.
    #[error("DDS: {0}")]
    Dds(#[from] CreateError),
    /// A topic is on Zenoh, which is not built in.
    #[error("Zenoh: this build has none; build with --features zenoh")]
    NoZenoh,
    /// A topic is on a middleware that was not joined.
    #[error("{0} is not joined")]
    NotJoined(&'static str),
    /// Zenoh's configuration cannot be read.
    #[error("Zenoh: {0}")]
    ZenohConfig(String),
    /// Zenoh refuses the session, or an end of a topic.
    #[error("Zenoh: {0}")]
    Zenoh(String),
    /// ROS refuses the node or an end of a topic.
    #[error("ROS: {0}")]
    Ros(String),
    /// The system refuses something basic, such as a thread.
    #[error("the operating system: {0}")]
    System(std::io::Error),
    /// The run was not recorded whole.
    #[error("the trace is incomplete, because writing it failed: {0}")]
    Trace(std::io::Error),
}

#[cfg(feature = "zenoh")]
impl From<zenoh::Error> for NodeError {
    fn from(error: zenoh::Error) -> Self {
        Self::Zenoh(error.to_string())
    }
}
