//! Tests of the shipped system. Each part is behind a feature of its name:
//!
//! - [`parsers`]: every parser of outside input, over any bytes.
//! - [`simulate`]: the shipped operator and the ROS 2 node in virtual time, among hostile sources,
//!   readers, topics and disks. [`judge`] judges their runs.
//! - `chaos`, a binary: shipped operators with real clouds while the network and the clouds break.
#![cfg_attr(
    feature = "parsers",
    expect(dead_code, reason = "what the command does with what it has read is not here")
)]

#[cfg(feature = "simulate")]
pub mod judge;
#[cfg(feature = "parsers")]
pub mod parsers;
#[cfg(feature = "simulate")]
pub mod simulate;

// The command's sources, under the names that they use for each other.
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/deadline.rs"]
mod deadline;
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/diagnostics.rs"]
mod diagnostics;
#[cfg(feature = "parsers")]
#[path = "../../../evaluation/src/duration.rs"]
pub mod duration;
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/exit.rs"]
mod exit;
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/fault.rs"]
mod fault;
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/input.rs"]
mod input;
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/sink.rs"]
mod sink;
#[cfg(feature = "parsers")]
#[path = "../../../cli/src/table.rs"]
mod table;
