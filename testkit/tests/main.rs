//! One program of the tests, which need no process of their own. The package of `tests` builds it: it is not optimized.

mod coverage;
mod generate;
mod networks;
mod promises;
mod rng;
mod shrink;
mod varied;
mod wide;
