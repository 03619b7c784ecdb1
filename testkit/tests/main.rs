//! Collects the tests, which need no process of their own, into one program. The package `tests`
//! builds it, unoptimized.

mod coverage;
mod generate;
mod networks;
mod promises;
mod rng;
mod shrink;
mod varied;
mod wide;
