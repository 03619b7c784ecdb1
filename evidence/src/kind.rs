//! The kinds of witness.

mod all;
mod pipelines;
mod python;
mod servers;

use std::collections::BTreeSet;

pub use all::KINDS;

use crate::error::EvidenceError;
use crate::fault::SeededFault;
use crate::printed::Outcomes;
use crate::tree::Tree;

/// For large crates with short tests, most of whose run is the build.
const QUICK: &[(&str, &str)] = &[("CARGO_PROFILE_DEV_OPT_LEVEL", "0"), ("CARGO_INCREMENTAL", "1")];

/// One kind of witness: how it is run, what it printed means, and what each witness cites.
pub struct EvidenceKind {
    /// Its name, which is that of its record too.
    pub name: &'static str,
    /// What its witnesses are, for readers.
    pub title: &'static str,
    /// Which identifiers must have a witness of this kind.
    pub(crate) applies: fn(&str) -> bool,
    /// Which faults its witnesses could see.
    pub(crate) concerns: fn(&SeededFault) -> bool,
    pub(crate) run: RunMethod,
    /// The files that the results depend on.
    pub(crate) sources: &'static [&'static str],
    /// Reads what cargo printed.
    pub(crate) read: fn(&str) -> Outcomes,
    /// The identifiers that a witness cites.
    pub(crate) cites: fn(&Tree, &str) -> Result<BTreeSet<String>, EvidenceError>,
}

/// How the witnesses of a kind run.
pub(crate) enum RunMethod {
    /// cargo with these arguments and variables, under every fault.
    Cargo { arguments: &'static [&'static str], variables: &'static [(&'static str, &'static str)] },
    /// pytest with these arguments in `adapters/python`, by the interpreter that `.ci/python` installed the wheel for.
    Pytest { arguments: &'static [&'static str] },
    /// As `Cargo`, but what cargo would run is run by the project's own command, as it is without the fault.
    DrivePrinted { arguments: &'static [&'static str], by: &'static [&'static str] },
    /// A command of its own, which keeps its own record and holds it against the sources in each run of it. The kind has
    /// the harnesses of these files of `proofs/src/harness`, one of which catches each fault seeded in the code they are of.
    Prove { files: &'static [&'static str], of: &'static [&'static str] },
}

impl EvidenceKind {
    /// A digest of what its results depend on.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn digest(&self, tree: &Tree) -> Result<String, EvidenceError> {
        tree.digest(self.sources)
    }

    /// Whether its witnesses run under every fault by a campaign.
    #[must_use]
    pub fn is_run_here(&self) -> bool {
        match self.run {
            RunMethod::Cargo { .. } | RunMethod::Pytest { .. } | RunMethod::DrivePrinted { .. } => {
                true
            }
            RunMethod::Prove { .. } => false,
        }
    }

    /// Whether one of its witnesses must catch this fault.
    pub(crate) fn must_catch(&self, fault: &SeededFault) -> bool {
        matches!(self.run, RunMethod::Prove { of, .. } if of.contains(&&*fault.file))
    }

    /// The one of this name.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        KINDS.iter().find(|kind| kind.name == name)
    }
}
