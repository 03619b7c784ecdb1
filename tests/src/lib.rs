//! What crosses crates: a driver with a manual clock, random runs, and a ledger that checks the promises.

mod driver;
pub mod fuzz;
mod ledger;
mod run;

pub use driver::{Driver, Fired};
pub use ledger::Ledger;
pub use run::{Run, runs};

/// The README's example is run as a test.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
