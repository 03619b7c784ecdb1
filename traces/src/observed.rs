//! What concurrent implementations record: each timestamp by itself, within a tolerance (SPEC.md, *Observed*).
//!
//! [`Judge`] goes through a trace line by line and keeps what it needs of the timestamps that may still get a line; each is
//! then one [`MessageHistory`], of which it is decided, exactly, whether the rules can explain it within the [`Slack`].

mod attempts;
mod causes;
mod doubts;
mod explain;
mod gap;
mod judge;
mod open;
mod progressive;
mod slack;
mod story;
mod verdict;
mod violation;
mod window;

use crate::event::Line;
use crate::parse::{Form, LineAnnotations, ParseError, parse_as};

pub use judge::{Judge, JudgeError, TimeOrderError, judge};
pub use slack::{Slack, SourceSlack};
pub use story::{AllowedOutput, MessageHistory};
pub use verdict::{BrokenRule, Verdict, Violation};

/// Reads one line of an observed trace, given without its `\n`: as [`parse`](crate::parse) does, but a request may have its
/// `deadline` instead of `due`, and comes as one with `due`; an attempt may have its number, which is left out here.
///
/// # Errors
/// Whatever the format does not allow, with its column.
pub fn parse(line: &[u8]) -> Result<Line, ParseError> {
    parse_as(line, Form::Observed, &mut LineAnnotations::default())
}
