//! The parts that the benches share: the machines, and their inputs.

pub mod adapter;
pub mod arrivals;
pub mod baseline;
pub mod beside;
pub mod machine;
pub mod trace;
pub mod window;
