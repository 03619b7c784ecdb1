#![doc = include_str!("../README.md")]

mod side;
mod shared;
pub mod drive;
#[cfg(feature = "grpc")]
pub mod grpc;
mod local;
mod operator;
mod panics;
#[cfg(feature = "prometheus")]
mod prometheus;
#[cfg(target_os = "linux")]
pub mod realtime;
mod run;
mod setup;
mod stream;
mod error_chain;

pub use side::{SideRequest, SideTally};
pub use shared::SharedState;
pub use drive::Timers;
pub use fuseline_deadline as deadline;
pub use fuseline_engine::{
    Commit, ConfigError, DropReason, Ending, Failure, Forwarded, Hint, CurrentDeadline, Item, OfferRefusal,
    OpenRefusal, Reasons, Recording, CapacityError, CapacityErrors, Source, SourceTally, Tally, Trigger,
};
pub use local::Local;
pub use operator::{Config, Items, JoinError, Operator, Running, SpawnError, Trace, spawn};
#[cfg(feature = "prometheus")]
pub use prometheus::prometheus;
pub use setup::{Call, Cloud, Setup};
pub use stream::{Reader, WriteError, Writer, stream};

#[cfg(feature = "prometheus")]
pub use metrics_exporter_prometheus::BuildError;

/// Why a call, a handler or a computation has no result; any error converts by `?` or `into`.
pub type Error = Box<dyn std::error::Error + Send + Sync>;
