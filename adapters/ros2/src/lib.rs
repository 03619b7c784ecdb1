#![doc = include_str!("../README.md")]

pub mod arguments;
mod clock;
mod error;
mod fusion;
// Hidden: the simulator in tests/system uses it, and it may change in any version.
#[doc(hidden)]
pub mod in_process;
pub mod key;
mod lifecycle;
mod managed;
mod middleware;
pub mod names;
mod node;
pub mod parameters;
mod raw;
mod realtime;
mod recordings;
mod report;
mod rosout;
mod run;
mod service;
pub mod settings;
mod silence_detector;
mod source;
mod speed;
mod stamps;
mod status_publisher;
mod stop;

pub use arguments::Arguments;
pub use error::{GrpcError, NodeError};
pub use fuseline_engine::{Commit, Tally};
pub use node::check;
pub use raw::Payload;
pub use rosout::{PendingLogs, Rosout};
pub use run::run;
pub use settings::Settings;
pub use stop::Stop;
