//! The files that results depend on. A name after a `!` is left out, with all that begins as it does.

pub(crate) const CORE: &str = "core/src";
/// It lists the modules and has no logic.
pub(crate) const NO_LIST: &str = "!core/src/lib.rs";
/// The machine for many threads, which the other one does not know.
pub(crate) const NO_SHARED: &str = "!core/src/shared";
/// What turns a trace's inputs into the machine's and its answers into decisions.
pub(crate) const ARBITER: &str = "adapters/operator/src/arbiter.rs";
/// The format, the reference machine, the judge.
pub(crate) const TRACES: &str = "traces/src";
pub(crate) const CORPUS: &str = "traces/corpus";
/// The strategies, the driver and the ledger.
pub(crate) const TESTS: &str = "tests/src";
