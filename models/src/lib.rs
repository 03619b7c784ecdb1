#![doc = include_str!("../README.md")]

mod check;
mod claim;
mod config;
mod counterexample;
mod explore;
mod machine;
mod mark;
mod operator;
mod property;
mod state;

pub use check::{CheckError, Effort, Verdict, check};
pub use claim::{Claim, Claims};
pub use config::{CONFIGS, Config, Reach, Size};
pub use counterexample::Counterexample;
pub use explore::explore;
pub use machine::{Answer, End, Fired, hush};
pub use mark::{Mark, Marks};
pub use operator::Operator;
pub use state::State;
