#![doc = include_str!("../README.md")]

#[cfg(feature = "operator")]
mod aligner;
pub mod arbiter;
#[cfg(feature = "operator")]
mod budget;
#[cfg(feature = "operator")]
mod config;
#[cfg(feature = "operator")]
mod counts;
#[cfg(feature = "operator")]
mod eager_notice;
#[cfg(feature = "operator")]
mod effect;
#[cfg(feature = "operator")]
mod effect_queue;
#[cfg(feature = "operator")]
mod engine;
#[cfg(feature = "operator")]
mod event;
#[cfg(feature = "operator")]
mod greatest_deadline;
#[cfg(feature = "operator")]
mod item;
#[cfg(feature = "operator")]
mod lag;
#[cfg(feature = "operator")]
mod latency;
#[cfg(feature = "operator")]
mod lineage;
#[cfg(feature = "operator")]
mod lock;
#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "operator")]
mod meter;
#[cfg(feature = "operator")]
mod open_message;
#[cfg(feature = "operator")]
mod outage;
#[cfg(feature = "operator")]
mod policies;
#[cfg(feature = "operator")]
mod queue;
#[cfg(feature = "operator")]
mod reasons;
#[cfg(feature = "operator")]
mod recordings;
#[cfg(feature = "operator")]
mod reorderer;
#[cfg(feature = "operator")]
mod sized_arbiter;
#[cfg(feature = "operator")]
mod sources;
#[cfg(feature = "operator")]
mod tally;
#[cfg(feature = "operator")]
mod workload;
#[cfg(feature = "operator")]
mod writer;

#[cfg(feature = "operator")]
pub use aligner::{Aligner, JoinArrival, JoinBounds, JoinCause, JoinDropReason, Joined};
#[cfg(feature = "operator")]
pub use budget::Budget;
#[cfg(feature = "operator")]
pub use config::{CloudConfig, EngineConfig, EngineConfigError};
#[cfg(feature = "operator")]
pub use counts::Counting;
#[cfg(feature = "operator")]
pub use effect::{Effect, Hint, Local, Offer, Overflow};
#[cfg(feature = "operator")]
pub use engine::Engine;
pub use fuseline_core::{ConfigError, Gate};
#[cfg(feature = "operator")]
pub use fuseline_deadline::{Policy, Situation};
pub use fuseline_traces::{
    Cloud, Commit, DropReason, Header, HeaderAnnotations, OfferRefusal, OpenRefusal, Origin,
    Recorder, Recording, nanos,
};
#[cfg(feature = "operator")]
pub use item::{CarriedMessage, Ending, Failure, Forwarded, Item, Source, Trigger};
#[cfg(feature = "operator")]
pub use latency::{Latency, Reserve};
#[cfg(feature = "operator")]
pub use lineage::{Lineage, StampedValue};
#[cfg(feature = "operator")]
pub use lock::lock;
#[cfg(feature = "mcap")]
pub use mcap::{Mcap, McapError};
#[cfg(feature = "operator")]
pub use reasons::Reasons;
#[cfg(feature = "operator")]
pub use reorderer::{Ordered, Reorderer};
#[cfg(feature = "operator")]
pub use tally::{CurrentDeadline, SourceTally, Tally};
#[cfg(feature = "operator")]
pub use workload::{CapacityError, CapacityErrors, Workload};
#[cfg(feature = "operator")]
pub use writer::Sink;
