//! One program of the tests that need no process of their own. The package of `tests` builds it: it is not optimized.

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
