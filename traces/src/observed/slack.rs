//! How far recorded instants may be off, source by source, and how late an implementation may act.

use std::collections::BTreeMap;

/// How far a recorded instant may be off, and how late an implementation may act, in nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Slack {
    /// The error of every recorded instant, either way.
    pub tolerance: u64,
    /// How long after its due instant a timer is served, and after its decision an output is sent.
    pub lateness: u64,
}

/// A [`Slack`] with the tolerances of those sources whose stamps have another error.
///
/// The lines of source `p` are its `request`, `result` and `fail`; all others are the operator's own. Between a line of
/// one source and one of another the errors of both add up.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SourceSlack {
    slack: Slack,
    tolerances: BTreeMap<u64, u64>,
    /// The greatest error of any stamp.
    greatest: u64,
}

impl SourceSlack {
    /// Gives the stamps of source `p` a tolerance of their own; 0 is local.
    #[must_use]
    pub fn with_tolerance_of(mut self, p: u64, tolerance: u64) -> Self {
        self.tolerances.insert(p, tolerance);
        self.greatest = self.tolerances.values().copied().fold(self.slack.tolerance, u64::max);
        self
    }

    /// The error of the stamps of the operator, and of all sources that have no tolerance of their own.
    #[must_use]
    pub const fn tolerance(&self) -> u64 {
        self.slack.tolerance
    }

    /// The error of the stamps of source `p`.
    #[must_use]
    pub fn tolerance_of(&self, p: u64) -> u64 {
        self.tolerances.get(&p).copied().unwrap_or(self.slack.tolerance)
    }

    /// How late an implementation may act.
    #[must_use]
    pub const fn lateness(&self) -> u64 {
        self.slack.lateness
    }

    /// By how much a result of source `p` may be late and still pass as in time.
    pub(super) fn unnoticed(&self, p: u64) -> u64 {
        self.tolerance_of(p).saturating_mul(2).saturating_add(self.lateness())
    }

    /// That of the operator's own lines.
    pub(super) const fn own(&self) -> Slack {
        self.slack
    }

    /// The greatest error of any stamp.
    pub(super) const fn greatest(&self) -> u64 {
        self.greatest
    }

    /// How far apart two lines of the operator may be recorded that are one step.
    pub(super) const fn reach(&self) -> u64 {
        let Slack { tolerance, lateness } = self.slack;
        tolerance.saturating_mul(2).saturating_add(lateness)
    }
}

impl From<Slack> for SourceSlack {
    fn from(slack: Slack) -> Self {
        Self { slack, tolerances: BTreeMap::new(), greatest: slack.tolerance }
    }
}
