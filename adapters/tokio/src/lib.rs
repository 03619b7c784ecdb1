//! Operators, streams and clouds on tokio around the Fuseline core.

#[cfg(feature = "grpc")]
pub mod grpc;
mod local;
mod operator;
mod panics;
mod run;
mod setup;
mod stream;

pub use fuseline_operator::{
    Commit, ConfigError, DropReason, Forwarded, Item, Outcome, Recording, Refusal, Rule, Source,
    SourceTally, Tally,
};
pub use local::Local;
pub use operator::{Config, Items, Operator, Running, SpawnError, Trace, spawn};
pub use setup::{Call, Cloud, Setup};
pub use stream::{Reader, WriteError, Writer, stream};

/// Why a call, a handler or a computation has no result; any error fits by `?` or `into`.
pub type Error = Box<dyn std::error::Error + Send + Sync>;
