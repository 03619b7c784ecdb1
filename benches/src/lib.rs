//! What the benches share: the machines compared and the arrivals they are given.

pub mod adapter;
pub mod arrivals;
pub mod baseline;
pub mod beside;
pub mod machine;
pub mod trace;
pub mod window;
