//! What a run prints: one line a harness, one a fault.

use std::fmt;

use serde::Serialize;

/// One harness, or one harness under a fault.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct LedgerLine {
    pub(crate) harness: String,
    /// The fault that was seeded, if one was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) fault: Option<String>,
    pub(crate) engine: String,
    pub(crate) bounds: String,
    pub(crate) solver: String,
    pub(crate) verdict: String,
    /// Whether that is what must be.
    pub(crate) good: bool,
    pub(crate) seconds: f64,
    pub(crate) memory_mib: u64,
    /// What refutes it, to be given to `--replay`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) values: Vec<u64>,
}

impl LedgerLine {
    /// The harness, and the fault if there is one.
    pub(crate) fn name(&self) -> String {
        match &self.fault {
            Some(fault) => under(fault, &self.harness),
            None => self.harness.clone(),
        }
    }
}

/// How a harness under a fault is called.
pub(crate) fn under(fault: &str, harness: &str) -> String {
    format!("{fault} / {harness}")
}

impl fmt::Display for LedgerLine {
    /// One row; a `!` stands before what is not as it must be.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mark = if self.good { ' ' } else { '!' };
        write!(
            f,
            "{mark} {:58} {} {:7} {:6.1} s {:5} MiB  {:38} {}",
            self.name(),
            self.engine,
            self.solver,
            self.seconds,
            self.memory_mib,
            self.bounds,
            self.verdict,
        )
    }
}
