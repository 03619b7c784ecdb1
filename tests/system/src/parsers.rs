//! What is checked of every parser of what comes from outside, as functions over any bytes: the
//! fuzz targets of `fuzz/parsers` are loops around them, and plain tests replay the seeds.
//!
//! A library's parser is called in the library. The command is no library, so its own sources are
//! compiled into this crate by path: nothing in it is public for the sake of these checks.

mod csv;
mod frames;
mod held;
mod keys;
mod packed;
mod page;
mod yaml;

use std::collections::BTreeSet;

/// The most memory at once for any bytes of a few kilobytes, in bytes: twice the longest message of
/// gRPC, which is allocated when its length is read, and room for the caller.
pub const MEMORY: usize = 128 << 20;

/// What is wrong, in words.
type ParserResult = Result<(), String>;

/// One kind of bytes from outside.
#[derive(Clone, Copy, Debug)]
pub struct Parser {
    /// The name of its fuzz target, and of the folder of its seeds.
    pub name: &'static str,
    /// Reads bytes, notes how that ended, and says what is wrong.
    pub check: fn(&[u8], &mut Ends) -> Result<(), String>,
    /// Every way in which reading can end; the seeds come to each.
    pub ends: &'static [&'static str],
}

/// The ways in which reading ended so far.
pub type Ends = BTreeSet<&'static str>;

/// Rows of CSV: recorded drives, probes and observed calls.
pub const CSV: Parser = Parser { name: "csv", check: csv::check, ends: csv::ENDS };
/// Packed files: gzip, zstd, MCAP.
pub const PACKED: Parser = Parser { name: "packed", check: packed::check, ends: packed::ENDS };
/// Parameter files of ROS.
pub const YAML: Parser = Parser { name: "yaml", check: yaml::check, ends: yaml::ENDS };
/// Keys in serialized messages.
pub const KEYS: Parser = Parser { name: "keys", check: keys::check, ends: keys::ENDS };
/// Frames of gRPC.
pub const FRAMES: Parser = Parser { name: "frames", check: frames::check, ends: frames::ENDS };
/// The data of a report's page.
pub const PAGE: Parser = Parser { name: "page", check: page::check, ends: page::ENDS };

/// All of them, but for the trace's own reader, which `fuseline-tests` has.
pub const ALL: [Parser; 6] = [CSV, PACKED, YAML, KEYS, FRAMES, PAGE];

/// A message about a file is one line that no terminal takes for a command.
fn fit(message: &str) -> ParserResult {
    if message.contains(char::is_control) {
        return Err(format!("not fit for a terminal: {message:?}"));
    }
    Ok(())
}
