//! Collects the tests that need no process of their own into one program. The package `tests`
//! builds it, unoptimized.

mod aligner;
mod bookkeeping;
mod budget;
mod engine;
mod lineage;
mod naive;
mod probes;
mod random_inputs;
mod recording;
mod recovery;
mod reorderer;
mod tested;
mod workload;
