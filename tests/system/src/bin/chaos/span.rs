//! The work of operators in a stretch of time.

use std::collections::BTreeMap;
use std::time::Duration;

use fuseline_tokio::Tally;

use crate::vehicle::name;

/// The counts of all operators so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct ChaosTotals {
    outputs: BTreeMap<String, u64>,
    failed: u64,
    timed_out: u64,
}

/// The counts of one or several stretches of time.
#[derive(Clone, Debug, Default)]
pub(crate) struct TimeSpan {
    pub(crate) times: u64,
    pub(crate) ms: u64,
    pub(crate) outputs: u64,
    /// The outputs of the disrupted cloud, or of all clouds if all were disrupted.
    pub(crate) of_disrupted: u64,
    pub(crate) of_local: u64,
    /// The calls that failed, and the calls that the deadline ended.
    pub(crate) failed: u64,
    pub(crate) timed_out: u64,
}

impl ChaosTotals {
    pub(crate) fn of(tallies: &[Tally]) -> Self {
        let mut done = Self::default();
        for source in tallies.iter().flat_map(|tally| &tally.sources) {
            *done.outputs.entry(source.source.name.to_string()).or_default() += source.forwarded();
            done.failed += source.failed;
            done.timed_out += source.timers;
        }
        done
    }

    /// Returns the counts since `before`. `cloud` is the disrupted cloud, or `None` if all were
    /// disrupted.
    pub(crate) fn since(&self, before: &Self, cloud: Option<usize>, took: Duration) -> TimeSpan {
        let by = |name: &str| {
            let of = |done: &Self| done.outputs.get(name).copied().unwrap_or(0);
            of(self) - of(before)
        };
        let outputs = self.outputs.keys().map(|name| by(name)).sum();
        let of_local = by(&name(None));
        TimeSpan {
            times: 1,
            ms: u64::try_from(took.as_millis()).unwrap_or(u64::MAX),
            outputs,
            of_disrupted: cloud.map_or(outputs - of_local, |cloud| by(&name(Some(cloud)))),
            of_local,
            failed: self.failed - before.failed,
            timed_out: self.timed_out - before.timed_out,
        }
    }
}

impl TimeSpan {
    pub(crate) fn add(&mut self, other: &Self) {
        self.times += other.times;
        self.ms += other.ms;
        self.outputs += other.outputs;
        self.of_disrupted += other.of_disrupted;
        self.of_local += other.of_local;
        self.failed += other.failed;
        self.timed_out += other.timed_out;
    }
}
