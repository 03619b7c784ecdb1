//! What every adapter shares: the core, the queues to the sources, the values of held results, recording
//! and counting. An adapter adds its clock, its threads and its network.

mod counts;
mod effect;
mod engine;
mod hands;
mod item;
mod lane;
#[cfg(feature = "mcap")]
mod mcap;
mod meter;
mod pace;
mod reasons;
mod story;
mod tally;
mod tape;

pub use counts::Counting;
pub use effect::{Effect, Hint, Local, Offer};
pub use engine::Engine;
pub use fuseline_core::{ConfigError, Gate};
pub use fuseline_deadline::{Policy, Situation};
pub use fuseline_traces::{
    Cloud, Commit, DropReason, Header, OfferRefusal, OpenRefusal, Recorder, Recording,
};
pub use item::{Ending, Failure, Forwarded, Item, Source, Trigger};
#[cfg(feature = "mcap")]
pub use mcap::{Mcap, McapError};
pub use pace::{Pace, Shortfall, Shortfalls};
pub use reasons::Reasons;
pub use tally::{InForce, SourceTally, Tally};
pub use tape::Sink;
