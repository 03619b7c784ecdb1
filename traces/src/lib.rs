//! The trace of a fusion operator: its format, the reference machine and the judge.

mod event;

pub use event::{Cloud, Commit, Decision, DropReason, Header, Input, Refusal};
