#![doc = include_str!("../README.md")]

mod aligner;
pub mod arbiter;
mod budget;
mod config;
mod counts;
mod eager_notice;
mod effect;
mod effect_queue;
mod engine;
mod greatest_deadline;
mod item;
mod lag;
mod latency;
mod lineage;
mod lock;
#[cfg(feature = "mcap")]
mod mcap;
mod open_message;
mod outage;
mod policies;
mod queue;
mod reasons;
mod recordings;
mod reorderer;
mod sized_arbiter;
mod sources;
mod tally;
mod workload;
mod writer;

pub use aligner::{
    Aligner, JoinArrival, JoinBounds, JoinCause, JoinDropReason, Joined, LatestInput,
};
pub use budget::Budget;
pub use config::{CloudConfig, EngineConfig, EngineConfigError};
pub use counts::Counting;
pub use effect::{Effect, Hint, Local, Offer, Overflow};
pub use engine::Engine;
pub use fuseline_core::{ConfigError, Gate};
pub use fuseline_deadline::{Policy, Situation};
pub use fuseline_traces::{
    Cloud, Commit, DropReason, Header, HeaderAnnotations, OfferRefusal, OpenRefusal, Origin,
    Recorder, Recording, nanos,
};
pub use item::{CarriedMessage, Ending, Failure, Forwarded, Item, Source, Trigger};
pub use latency::{Latency, Reserve};
pub use lineage::{Lineage, StampedValue};
pub use lock::lock;
#[cfg(feature = "mcap")]
pub use mcap::{Mcap, McapError};
pub use reasons::Reasons;
pub use reorderer::{Ordered, Reorderer};
pub use tally::{CurrentDeadline, SourceTally, Tally};
pub use workload::{CapacityError, CapacityErrors, Workload};
pub use writer::Sink;
