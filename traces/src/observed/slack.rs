//! The error of recorded instants, source by source, and the time by which an implementation may
//! act late.

use std::collections::BTreeMap;

/// The greatest error of a recorded instant, and the time by which an implementation may act late,
/// in nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Slack {
    /// The error of every recorded instant, in either direction.
    pub tolerance: u64,
    /// The greatest delay between a due instant and the serving of its timer, and between a
    /// decision and the sending of its output.
    pub lateness: u64,
}

/// A [`Slack`] with separate tolerances for sources whose stamps have another error.
///
/// The lines of source `p` are its `request`, `result` and `fail`; all others are the operator's
/// own. Between lines of two sources the errors of both add up.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SourceSlack {
    slack: Slack,
    tolerances: BTreeMap<u64, u64>,
    /// The greatest error of any stamp.
    greatest: u64,
}

impl SourceSlack {
    /// Sets the tolerance of source `p`'s stamps, in ns; 0 is local.
    #[must_use]
    pub fn with_tolerance_of(mut self, p: u64, tolerance: u64) -> Self {
        self.tolerances.insert(p, tolerance);
        self.greatest = self.tolerances.values().copied().fold(self.slack.tolerance, u64::max);
        self
    }

    /// Returns the error of the operator's stamps, in ns, which also holds for sources without a
    /// tolerance of their own.
    #[must_use]
    pub const fn tolerance(&self) -> u64 {
        self.slack.tolerance
    }

    /// Returns the error of source `p`'s stamps, in ns.
    #[must_use]
    pub fn tolerance_of(&self, p: u64) -> u64 {
        self.tolerances.get(&p).copied().unwrap_or(self.slack.tolerance)
    }

    /// Returns how late an implementation may act, in ns.
    #[must_use]
    pub const fn lateness(&self) -> u64 {
        self.slack.lateness
    }

    /// Returns the delay by which a result of source `p` may be late and still pass as in time.
    pub(super) fn unnoticed(&self, p: u64) -> u64 {
        self.tolerance_of(p).saturating_mul(2).saturating_add(self.lateness())
    }

    /// Returns the slack of the operator's own lines.
    pub(super) const fn own(&self) -> Slack {
        self.slack
    }

    /// Returns the greatest error of any stamp.
    pub(super) const fn greatest(&self) -> u64 {
        self.greatest
    }

    /// Returns the greatest distance between two recorded lines of the operator that are one step.
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
