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

pub use check::{CheckError, Effort, Exploration, check};
pub use claim::{Claim, Claims};
pub use config::{CONFIGS, Config, Reach, Size};
pub use counterexample::Counterexample;
pub use explore::explore;
pub use machine::{Completion, Fired, Reaction, hush};
pub use mark::{Mark, Marks};
pub use operator::Operator;
pub use state::State;
