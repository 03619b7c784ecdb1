//! The core's own sources about the balanced tree that was its window before, so that the two are measured in one binary.
#![no_std]

#[rustfmt::skip]
#[path = "../../../core/src/answer.rs"]
mod answer;
#[rustfmt::skip]
#[path = "../../../core/src/clouds.rs"]
mod clouds;
#[rustfmt::skip]
#[path = "../../../core/src/entry.rs"]
mod entry;
#[rustfmt::skip]
#[path = "../../../core/src/fusion.rs"]
mod fusion;
#[rustfmt::skip]
#[path = "../../../core/src/gate.rs"]
mod gate;
#[rustfmt::skip]
#[path = "../../../core/src/priority.rs"]
mod priority;
#[rustfmt::skip]
#[path = "../../../core/src/slot.rs"]
mod slot;
#[rustfmt::skip]
#[path = "../../../core/src/source.rs"]
mod source;
#[rustfmt::skip]
#[path = "../../../core/src/time.rs"]
mod time;
mod window;

pub use answer::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};
pub use clouds::{Cloud, Clouds, ConfigError};
pub use entry::Entry;
pub use fusion::{At, Fusion, Ready};
pub use gate::Gate;
pub use priority::{Priorities, Priority};
pub use slot::{Cause, Commit, Decision, InvalidSlot, Slot};
pub use source::{Source, Sources};
pub use time::{Deadline, Instant, Timestamp};
