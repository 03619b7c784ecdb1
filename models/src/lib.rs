#![doc = include_str!("../README.md")]

mod check;
mod claim;
mod counterexample;
mod explore;
mod machine;
mod operator;
mod property;
mod shown;
mod sighting;
mod state;
mod world;

pub use check::{CheckError, CheckOptions, Exploration, check};
pub use claim::{Claim, Claims};
pub use counterexample::Counterexample;
pub use explore::explore;
pub use machine::{FiredTimers, InputResponse, WholeAnswer, silence_panic_output};
pub use operator::Operator;
pub use sighting::{Sighting, Sightings};
pub use state::State;
pub use world::{Readings, Size, WORLDS, World};
