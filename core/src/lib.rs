#![doc = include_str!("../README.md")]
#![no_std]

#[cfg(test)]
extern crate std;

mod answer;
mod clouds;
mod entry;
mod fusion;
mod gate;
mod held;
mod priority;
mod slot;
mod source;
mod time;
mod window;

pub use answer::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};
pub use clouds::{Cloud, Clouds, ConfigError};
pub use entry::Entry;
pub use fusion::{At, Fusion, Ready};
pub use gate::Gate;
pub use held::Held;
pub use priority::{Priorities, Priority};
pub use slot::{Cause, Commit, Decision, InvalidSlot, Slot};
pub use source::{Source, Sources};
pub use time::{Deadline, Instant, Timestamp};
