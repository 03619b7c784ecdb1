#![doc = include_str!("../README.md")]

mod annotations;
mod canonical;
pub mod corpus;
mod doubt;
mod duration;
mod event;
mod judge;
pub mod observed;
pub mod packed;
mod parse;
mod read;
mod reason;
mod recent;
mod record;
mod reference;
#[cfg(feature = "csv")]
pub mod rows;
mod rule;
mod scan;
mod values;
mod verdict;
mod word;
mod write;

pub use annotations::{Annotations, HeaderAnnotations, Origin, ValueKeys};
pub use doubt::{Doubt, DoubtKind};
pub use duration::nanos;
pub use event::{Cloud, Commit, Decision, Event, Header, Input, Line, VERSION};
pub use judge::{Judge, judge};
pub use parse::{ParseError, observed_line, parse, parse_annotated};
pub use read::{Defect, Events, LINE, ReadError, unpack};
pub use reason::{DropReason, OfferRefusal, OpenRefusal};
pub use record::{Recorder, Recording};
pub use reference::{ExpectedDecisions, Reference};
pub use rule::Rule;
pub use values::HeldValues;
pub use verdict::{Verdict, Violation, ViolationPlace};
