//! What concurrent implementations record: each timestamp by itself, within a tolerance (SPEC.md, *Observed*).
//!
//! [`Judge`] goes through a trace line by line and keeps what it needs of the timestamps that may still get a line; each is
//! then one [`Story`], of which it is decided, exactly, whether the rules can explain it within the [`Slack`].

mod blame;
mod explain;
mod judge;
mod story;
mod verdict;
mod watch;

pub use judge::{Disorder, Judge, JudgeError, judge};
pub use story::{Allowed, Slack, Story};
pub use verdict::{Broken, Verdict, Violation};
