//! The machine for many threads under test: the callers' inputs, their answers, and a check that
//! some order of the pure step explains the answers.

mod history;
mod input;
mod sequential;
#[cfg(loom)]
mod turn;

#[cfg(not(loom))]
pub(crate) use history::TimedCall;
pub(crate) use history::{CallHistory, ThreadHandle};
pub(crate) use input::{CallAnswer, CallInput, Timed, open, result, tick};
pub(crate) use sequential::Sequential;
#[cfg(loom)]
pub(crate) use turn::CallOrder;
