//! The files that results depend on. A name after a `!` is left out, with all that begins as it does.

pub(crate) const CORE: &str = "core/src";
/// They list the modules and have no logic.
pub(crate) const NO_LIST: &str = "!core/src/lib.rs";
pub(crate) const NO_LIST_OF_TRACES: &str = "!traces/src/lib.rs";
/// The machine for many threads, and its values.
pub(crate) const THREADS: &str = "adapters/threads/src";
pub(crate) const NO_LIST_OF_THREADS: &str = "!adapters/threads/src/lib.rs";
/// What turns a trace's inputs into the machine's and its answers into decisions.
pub(crate) const ARBITER: &str = "adapters/engine/src/arbiter";
/// The judge of what concurrent machines record, which the strict one does not know.
pub(crate) const NO_OBSERVED: &str = "!traces/src/observed";
/// Packings and tables, of which neither the strict judge nor a recorder knows.
pub(crate) const NO_PACKED: &str = "!traces/src/packed";
pub(crate) const NO_ROWS: &str = "!traces/src/rows.rs";
/// The format, the reference machine, the judge.
pub(crate) const TRACES: &str = "traces/src";
pub(crate) const CORPUS: &str = "traces/corpus";
/// The generator, the ledger of promises and the account of what was reached.
pub(crate) const KIT: &str = "testkit/src";
pub(crate) const NO_LIST_OF_KIT: &str = "!testkit/src/lib.rs";
/// The driver, and what the fuzz targets check.
pub(crate) const TESTS: &str = "tests/src";
