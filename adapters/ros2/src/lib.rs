#![doc = include_str!("../README.md")]

pub mod arguments;
mod error;
mod fusion;
mod backend;
pub mod key;
mod lifecycle;
mod managed;
mod middleware;
pub mod names;
mod node;
pub mod parameters;
mod raw;
mod report;
mod silence_detector;
mod rosout;
mod service;
pub mod settings;
mod source;
mod speed;
mod stamps;
mod stop;
mod status_publisher;

pub use arguments::Arguments;
pub use error::{GrpcError, NodeError};
pub use fuseline_engine::{Commit, Tally};
pub use node::{check, run};
pub use raw::Payload;
pub use rosout::{Lines, Rosout};
pub use settings::Settings;
pub use stop::Stop;
