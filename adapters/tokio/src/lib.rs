#![doc = include_str!("../README.md")]

mod call;
mod carried_state;
pub mod drive;
mod encoding;
mod error_chain;
#[cfg(feature = "grpc")]
pub mod grpc;
pub mod handlers;
mod in_order;
mod items;
mod join;
mod local;
mod operator;
mod outbox;
mod panics;
mod pending_call;
#[cfg(feature = "prometheus")]
mod prometheus;
mod run;
mod setup;
mod shared;
mod side;
mod side_counts;
mod stream;
#[cfg(feature = "tower")]
pub mod tower;
mod workers;

pub use call::Call;
pub use carried_state::CarriedState;
pub use drive::Timers;
pub use encoding::{EncodeOnce, EncodedRequest};
pub use fuseline_deadline as deadline;
pub use fuseline_engine::{
    CapacityError, CapacityErrors, CarriedMessage, CloudConfig as Cloud, Commit, ConfigError,
    CurrentDeadline, DropReason, Ending, EngineConfigError, Failure, Forwarded, Hint, Item,
    JoinCause, JoinDropReason, Joined, Latency, Lineage, OfferRefusal, OpenRefusal, Origin,
    Overflow, Reasons, Recording, Reserve, Source, SourceTally, StampedValue, Tally, Trigger,
};
pub use in_order::OutOfOrder;
pub use items::Items;
pub use join::{Join, JoinConfig, JoinDrop, JoinTally, RunningJoin};
pub use local::Local;
pub use operator::{Config, JoinError, Operator, Running, SpawnError, Trace, spawn};
#[cfg(feature = "prometheus")]
pub use prometheus::prometheus;
pub use setup::Setup;
pub use shared::SharedState;
pub use side::SideRequest;
pub use side_counts::SideTally;
pub use stream::{Reader, WriteError, Writer, stream};

#[cfg(feature = "prometheus")]
pub use metrics_exporter_prometheus::BuildError;

/// The reason why a call, a handler or a computation has no result; any error converts by `?` or
/// `into`.
pub type Error = Box<dyn std::error::Error + Send + Sync>;
