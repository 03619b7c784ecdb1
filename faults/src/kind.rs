//! The kinds of witness: how each is built and run, which faults it could see, and what its
//! witnesses cite.

mod all;
mod suites;

use std::collections::BTreeSet;

pub use all::KINDS;

use crate::error::FaultsError;
use crate::fault::SeededFault;
use crate::printed::Outcomes;
use crate::tree::Tree;

/// One kind of witness.
pub struct WitnessKind {
    /// Its name.
    pub name: &'static str,
    /// A description of its witnesses, for readers.
    pub title: &'static str,
    /// Selects the faults that its witnesses could see.
    pub(crate) concerns: fn(&SeededFault) -> bool,
    pub(crate) suite: &'static BuildSuite,
    pub(crate) programs: &'static [Program],
    /// The number of a program's tests that run at once. It is more than one if the tests mostly
    /// wait.
    pub(crate) threads: &'static str,
    /// `true` if a run ends at the first test that fails, because the tests take long.
    pub(crate) stops: bool,
    /// Reads what a program printed.
    pub(crate) read: fn(&str, &str) -> Outcomes,
    /// The identifiers that a witness cites.
    pub(crate) cites: fn(&Tree, &str) -> Result<BTreeSet<String>, FaultsError>,
}

/// The programs that are built together, with the same features and flags.
#[derive(PartialEq, Eq, Debug)]
pub(crate) struct BuildSuite {
    pub(crate) name: &'static str,
    /// The packages, which are empty for Python.
    pub(crate) packages: &'static [&'static str],
    /// The arguments that select its tests.
    pub(crate) tests: &'static [&'static str],
    /// The programs that are built together with a test, so that all have the same features.
    pub(crate) programs: &'static [&'static str],
    pub(crate) variables: &'static [(&'static str, &'static str)],
}

/// A program of a suite, by its package and target, and the arguments with which it runs.
pub(crate) struct Program {
    pub(crate) package: &'static str,
    pub(crate) target: &'static str,
    pub(crate) arguments: &'static [&'static str],
}

impl WitnessKind {
    /// Returns the interface whose cases of misuse it runs, if it does.
    pub(crate) fn interface(&self) -> Option<&'static str> {
        self.name.strip_suffix("-misuse")
    }

    /// Returns `true` if its cases run the node with real peers.
    pub(crate) fn is_among_peers(&self) -> bool {
        self.interface() == Some("ros2-run")
    }

    /// Returns `true` if a case is selected by a part of its name, so that others may run with it.
    /// The output names each case when it begins or ends.
    pub(crate) fn takes_parts_of_names(&self) -> bool {
        self.is_among_peers() || self.suite.packages.is_empty()
    }

    /// Returns `true` if its witnesses could see a fault. The cases of an interface see only the
    /// faults that remove their guards.
    pub(crate) fn sees(&self, fault: &SeededFault) -> bool {
        match (&fault.case, self.interface()) {
            (Some(case), Some(interface)) => case.interface == interface,
            (None, None) => (self.concerns)(fault),
            _ => false,
        }
    }

    /// Finds the kind with this name.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        KINDS.iter().find(|kind| kind.name == name)
    }
}

/// The part of a campaign that runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub enum Tier {
    /// The faults of core, judges and threads.
    Landing,
    /// All.
    Full,
}

impl Tier {
    /// Returns `true` if a kind of witness runs in it.
    #[must_use]
    pub fn runs(self, kind: &WitnessKind) -> bool {
        self == Self::Full || all::builds_at_landing(kind)
    }

    /// Returns `true` if a fault runs in it.
    #[must_use]
    pub fn has(self, fault: &SeededFault) -> bool {
        self == Self::Full || all::runs_at_landing(fault)
    }
}
