//! What crosses crates: a driver with a manual clock, and what the fuzz targets check.

mod driver;
pub mod fuzz;

pub use driver::{CoreDriver, Fired};

/// The README's example is run as a test.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
