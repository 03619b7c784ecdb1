#![doc = include_str!("../README.md")]
#![no_std]
#![warn(
    clippy::arithmetic_side_effects,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::integer_division,
    clippy::panic,
    clippy::unwrap_used,
    clippy::wildcard_enum_match_arm
)]

#[cfg(test)]
extern crate std;

mod expected;
mod figure;
mod guard;
mod invalid;
mod link;
mod loss;
mod observations;
mod parameters;
mod policy;
mod send_budget;
mod span;
mod streaming;
mod survival;
mod units;

pub use expected::{Choice, Expected, least_loss, mean_loss};
pub use figure::Figure;
pub use guard::{Assessment, Guard};
pub use invalid::Invalid;
pub use link::{LinkDirection, LinkQueue, LinkRate};
pub use loss::{Accuracy, Impact, Loss, Source};
pub use observations::Observations;
pub use parameters::{Classes, Hazard, Parameters};
pub use policy::{Capped, Case, Chosen, Constant, End, Policy, Reason, Situation};
pub use send_budget::SendBudget;
pub use span::Span;
pub use streaming::{BoxDetector, StreamLoss, Streaming};
pub use survival::{Observation, Step, Survival};
pub use units::{Metres, MetresPerSecond, MetresPerSecondSquared};
