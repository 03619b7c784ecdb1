//! The machine for many threads under test: the callers' inputs, their answers, and a check that some order
//! of the pure step explains the answers.

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
