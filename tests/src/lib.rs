//! What crosses crates: a driver with a manual clock, and what the fuzz targets check.

mod driver;
pub mod fuzz;

pub use driver::{CoreDriver, Fired};
