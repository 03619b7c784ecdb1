//! One program of the tests: it is built once.

mod paper_vehicle;
mod scenario;
