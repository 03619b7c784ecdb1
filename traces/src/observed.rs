//! The observed judge, for traces of concurrent implementations: judges each timestamp by itself,
//! within a tolerance (SPEC.md, *Observed*).
//!
//! [`Judge`] reads a trace line by line and keeps what it needs of the timestamps that may still
//! get a line. Each timestamp then becomes one [`MessageHistory`], and the judge decides exactly
//! whether the rules can explain it within the [`Slack`].

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
mod violation;
mod window;

use crate::event::Line;
use crate::parse::{Form, LineAnnotations, ParseError, parse_as};

pub use judge::{Judge, JudgeError, TimeOrderError, judge};
pub use slack::{Slack, SourceSlack};
pub use story::{AllowedOutput, MessageHistory};

/// Reads one line of an observed trace, given without its `\n`.
///
/// It differs from [`parse`](crate::parse) in two ways. A request may have its `deadline` instead
/// of `due`; the event then has the due instant. An attempt may have its number, which this
/// function leaves out.
///
/// # Errors
/// Returns a [`ParseError`] with its column for whatever the format does not allow.
pub fn parse(line: &[u8]) -> Result<Line, ParseError> {
    parse_as(line, Form::Observed, &mut LineAnnotations::default())
}
