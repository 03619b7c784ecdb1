//! The checks of every parser of outside input, as functions over any bytes. The fuzz targets of
//! `fuzz/parsers` are loops around them, and plain tests replay the seeds.
//!
//! A library's parser is called in its library. The command is not a library, so this crate
//! compiles its sources by path. Nothing in them is public only for these checks.

mod csv;
mod frames;
mod held;
mod keys;
mod packed;
mod page;
mod yaml;

use std::collections::BTreeSet;

/// The greatest memory at one time, in bytes, for any input of a few kilobytes. It is twice the
/// longest gRPC message, which is allocated when its length is read, with some room for the caller.
pub const MEMORY: usize = 128 << 20;

/// A description of what is wrong.
type ParserResult = Result<(), String>;

/// One kind of outside input.
#[derive(Clone, Copy, Debug)]
pub struct Parser {
    /// The name of its fuzz target, and of the folder of its seeds.
    pub name: &'static str,
    /// Reads bytes, records how the reading ended, and returns what is wrong.
    pub check: fn(&[u8], &mut Ends) -> Result<(), String>,
    /// Every way in which reading can end. The seeds reach each of them.
    pub ends: &'static [&'static str],
}

/// The ways in which reading has ended so far.
pub type Ends = BTreeSet<&'static str>;

/// Rows of CSV: recorded drives, probes and observed calls.
pub const CSV: Parser = Parser { name: "csv", check: csv::check, ends: csv::ENDS };
/// Packed files: gzip, zstd, MCAP.
pub const PACKED: Parser = Parser { name: "packed", check: packed::check, ends: packed::ENDS };
/// ROS parameter files.
pub const YAML: Parser = Parser { name: "yaml", check: yaml::check, ends: yaml::ENDS };
/// Keys in serialized messages.
pub const KEYS: Parser = Parser { name: "keys", check: keys::check, ends: keys::ENDS };
/// Frames of gRPC.
pub const FRAMES: Parser = Parser { name: "frames", check: frames::check, ends: frames::ENDS };
/// The data of a report's page.
pub const PAGE: Parser = Parser { name: "page", check: page::check, ends: page::ENDS };

/// All parsers, except the trace's own reader, which `fuseline-tests` checks.
pub const ALL: [Parser; 6] = [CSV, PACKED, YAML, KEYS, FRAMES, PAGE];

/// Checks that a message about a file is one line without control characters.
fn fit(message: &str) -> ParserResult {
    if message.contains(char::is_control) {
        return Err(format!("not fit for a terminal: {message:?}"));
    }
    Ok(())
}
