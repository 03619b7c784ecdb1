//! The machine for many threads under test: what its callers do, what they were answered, and whether some order of
//! the pure step explains it.

mod history;
mod input;
mod sequential;
#[cfg(loom)]
mod turn;

pub use history::{CallHistory, ThreadHandle, TimedCall};
pub use input::{
    CallAnswer, CallFirings, CallInput, Timed, fail, limited, next_due, offer, open, queued,
    result, tick,
};
pub use sequential::Sequential;
#[cfg(loom)]
pub use turn::CallOrder;
