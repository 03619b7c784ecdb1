//! Proofs about the shipped machine: its own sources, with harnesses that look at them from inside.
// A build for the crate's own tests would fail, because the core's files would look for their test modules
// here.
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
// The harnesses of `fusion.rs` have a window of their own. The shipped window is proved by itself, over cells
// in place of its arrays. Natively the original is included too, for comparison.
mod cells;
mod levels;
mod window;
#[rustfmt::skip]
mod cell_window {
    use crate::cells::{CellsOf as Cells, CopyWithin, Get, GetMut};
    fuseline_proof_macros::over_cells!("core/src/window.rs" without "fn new()" "fn iter(");
}
#[cfg(not(any(kani, target_arch = "wasm32")))]
#[path = "../../core/src"]
mod shipped {
    #[rustfmt::skip]
    #[expect(dead_code, reason = "it is compared call by call")]
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

mod arbitrary;
#[cfg(not(any(kani, target_arch = "wasm32")))]
pub mod comparison;
pub mod harness;
mod rules;
mod steps;
mod valid;
#[cfg(not(any(kani, target_arch = "wasm32")))]
pub use steps::take as take_recording;
