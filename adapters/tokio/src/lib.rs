#![doc = include_str!("../README.md")]

mod call;
pub mod drive;
mod encoding;
mod error_chain;
#[cfg(feature = "grpc")]
pub mod grpc;
mod items;
mod local;
mod operator;
mod panics;
#[cfg(feature = "prometheus")]
mod prometheus;
#[cfg(target_os = "linux")]
pub mod realtime;
mod run;
mod setup;
mod shared;
mod side;
mod side_counts;
mod stream;
mod workers;

pub use call::Call;
pub use drive::Timers;
pub use encoding::encoding;
pub use fuseline_deadline as deadline;
pub use fuseline_engine::{
    CapacityError, CapacityErrors, Commit, ConfigError, CurrentDeadline, DropReason, Ending,
    Failure, Forwarded, Hint, Item, Lineage, OfferRefusal, OpenRefusal, Origin, Reasons, Recording,
    Source, SourceTally, StampedValue, Tally, Trigger,
};
pub use items::Items;
pub use local::Local;
pub use operator::{Config, JoinError, Operator, Running, SpawnError, Trace, spawn};
#[cfg(feature = "prometheus")]
pub use prometheus::prometheus;
pub use setup::{Cloud, Setup};
pub use shared::SharedState;
pub use side::SideRequest;
pub use side_counts::SideTally;
pub use stream::{Reader, WriteError, Writer, stream};

#[cfg(feature = "prometheus")]
pub use metrics_exporter_prometheus::BuildError;

/// Why a call, a handler or a computation has no result; any error converts by `?` or `into`.
pub type Error = Box<dyn std::error::Error + Send + Sync>;
