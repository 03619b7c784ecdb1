//! Shared by tests of several crates: a driver with a manual clock, and the checks of the fuzz
//! targets.

mod driver;
pub mod fuzz;

pub use driver::{CoreDriver, Fired};
