//! The machine for many threads under test: the callers' inputs, their answers, and a check that some order
//! of the pure step explains the answers.
#![allow(dead_code, unused_imports, reason = "each program of the tests takes a part")]

mod history;
mod input;
mod sequential;
#[cfg(loom)]
mod turn;

pub(crate) use history::{CallHistory, ThreadHandle, TimedCall};
pub(crate) use input::{
    CallAnswer, CallFirings, CallInput, Timed, fail, limited, next_due, offer, open, queued,
    result, tick,
};
pub(crate) use sequential::Sequential;
#[cfg(loom)]
pub(crate) use turn::CallOrder;
