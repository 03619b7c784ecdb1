//! Proofs about the shipped machine: its own sources, and harnesses that look at them from inside.
// Built for its own tests there would be nothing here: the core's files would look for their test modules in vain.
#![cfg(not(test))]
#![no_std]

#[cfg(not(target_arch = "wasm32"))]
extern crate std;

// The core's modules, as its `lib.rs` lists them.
#[rustfmt::skip]
#[path = "../../core/src/answer.rs"]
mod answer;
#[rustfmt::skip]
#[path = "../../core/src/clouds.rs"]
mod clouds;
#[rustfmt::skip]
#[path = "../../core/src/entry.rs"]
mod entry;
#[rustfmt::skip]
#[path = "../../core/src/fusion.rs"]
mod fusion;
#[rustfmt::skip]
#[path = "../../core/src/gate.rs"]
mod gate;
#[rustfmt::skip]
#[path = "../../core/src/priority.rs"]
mod priority;
#[rustfmt::skip]
#[path = "../../core/src/slot.rs"]
mod slot;
#[rustfmt::skip]
#[path = "../../core/src/source.rs"]
mod source;
#[rustfmt::skip]
#[path = "../../core/src/time.rs"]
mod time;
// The façade's harnesses have a window of their own; the shipped one is looked at by itself.
mod window;
#[path = "../../core/src"]
mod shipped {
    #[rustfmt::skip]
    #[expect(dead_code, reason = "only the façade asks for all that are open, to compare and to print")]
    pub(crate) mod window;
}

pub use answer::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};
pub use clouds::{Cloud, Clouds, ConfigError};
pub use entry::Entry;
pub use fusion::{At, Fusion, Ready};
pub use gate::Gate;
pub use priority::{Priorities, Priority};
pub use slot::{Cause, Commit, Decision, InvalidSlot, Slot};
pub use source::{Source, Sources};
pub use time::{Deadline, Instant, Timestamp};

mod any;
pub mod harness;
mod told;
mod valid;
#[cfg(not(any(kani, target_arch = "wasm32")))]
pub use told::take as take_told;
