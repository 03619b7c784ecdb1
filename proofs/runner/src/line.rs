//! The output of a run: one line for each harness, and one for each fault.

use std::fmt;

use serde::Serialize;

/// One harness, or one harness under a fault.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct LedgerLine {
    pub(crate) harness: String,
    /// The fault that was seeded, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) fault: Option<String>,
    pub(crate) engine: String,
    pub(crate) bounds: String,
    pub(crate) solver: String,
    pub(crate) verdict: String,
    /// `true` if the verdict is the required one.
    pub(crate) good: bool,
    pub(crate) seconds: f64,
    pub(crate) memory_mib: u64,
    /// The values that refute it, for `--replay`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) values: Vec<u64>,
}

impl LedgerLine {
    /// Returns the name of the harness, with the fault if there is one.
    pub(crate) fn name(&self) -> String {
        match &self.fault {
            Some(fault) => under(fault, &self.harness),
            None => self.harness.clone(),
        }
    }
}

/// Returns the name of a harness under a fault.
pub(crate) fn under(fault: &str, harness: &str) -> String {
    format!("{fault} / {harness}")
}

impl fmt::Display for LedgerLine {
    /// Writes one row. A `!` marks a verdict that is not the required one.
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
