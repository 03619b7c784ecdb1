//! What is checked of every parser of what comes from outside, as functions over any bytes: the
//! fuzz targets of `fuzz/parsers` are loops around them, and plain tests replay the seeds.
//!
//! What a library parses is asked of the library. The command is no library, so its own sources
//! stand here by path: nothing in it is public for the sake of these checks.
#![expect(dead_code, reason = "what the command does with what it has read is not here")]

mod check;

// The command's sources, by the names that they call each other.
#[path = "../../../cli/src/deadline.rs"]
mod deadline;
#[path = "../../../cli/src/drives.rs"]
mod drives;
#[path = "../../../cli/src/exit.rs"]
mod exit;
#[path = "../../../cli/src/fault.rs"]
mod fault;
#[path = "../../../cli/src/input.rs"]
mod input;
mod probe;
#[path = "../../../cli/src/remedy.rs"]
mod remedy;
mod serve;
#[path = "../../../cli/src/sink.rs"]
mod sink;

pub use check::{ALL, CSV, Ends, FRAMES, KEYS, PACKED, PAGE, Parser, YAML};

/// The most memory at once for any bytes of a few kilobytes, in bytes: twice the longest message of
/// gRPC, which is asked for when its length is read, and room for who asks.
pub const MEMORY: usize = 128 << 20;
