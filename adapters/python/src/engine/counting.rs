//! The counts of an engine, in Python's form.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::time::Duration;

use fuseline_engine as engine;
use fuseline_engine::{SourceTally, Tally, Trigger};
use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal, nanos};
use pyo3::prelude::*;

/// The counts of an engine, which can be read while it decides, and after its end.
#[pyclass(name = "Counting", module = "fuseline._fuseline", frozen)]
#[derive(Clone)]
pub(crate) struct PyCounting {
    operator: String,
    counting: engine::Counting,
}

/// The operator or a source, what was counted, and its outcome.
type CountKey = (String, &'static str, String);

/// The counts about the operator or one source.
struct PyCounts<'a> {
    of: &'a str,
    counts: &'a mut Vec<(CountKey, u64)>,
}

#[pymethods]
impl PyCounting {
    /// Returns the counts so far, including zeros, except reasons that nobody gave.
    fn counts(&self) -> Vec<(CountKey, u64)> {
        let mut counts = Vec::new();
        let tally = self.counting.tally();
        PyCounts { of: &self.operator, counts: &mut counts }.operator(&tally);
        for source in &tally.sources {
            PyCounts { of: &source.source.name, counts: &mut counts }.source(source);
        }
        counts
    }

    /// Returns the deadline in force of each cloud that was offered a message.
    ///
    /// An entry is the cloud's name, the deadline in nanoseconds, and the reason.
    fn deadlines(&self) -> Vec<(String, u64, &'static str)> {
        let tally = self.counting.tally();
        let in_force = tally.sources.iter().filter_map(|source| {
            let current = source.in_force?;
            Some((source.source.name.to_string(), nanos(current.deadline), current.why()))
        });
        in_force.collect()
    }

    /// Counts a failed handler: the message handler of cloud `p`, or the one for situations if `p`
    /// is None.
    fn handler_failed(&self, p: Option<u16>) {
        self.counting.handler_failed(p);
    }

    /// Counts a handler that ran for `lasted` nanoseconds without a pause.
    ///
    /// A time that the lag warning allows is not counted. The handler belongs to source `p`, or to
    /// the operator if `p` is None.
    fn check_handler_time(&self, p: Option<u16>, lasted: u64) {
        self.counting.check_handler_time(p, Duration::from_nanos(lasted));
    }

    /// Returns the longest time that the loop was held up, in nanoseconds.
    ///
    /// Returns 0 if it was never held up for longer than the warning allows.
    #[getter]
    fn greatest_lag(&self) -> u64 {
        nanos(self.counting.tally().greatest_lag)
    }

    /// Returns the reason that the recording ended early, if it did.
    #[getter]
    fn recording_error(&self) -> Option<String> {
        self.counting.tally().recording_error.as_deref().map(str::to_owned)
    }
}

impl PyCounting {
    pub(crate) const fn new(operator: String, counting: engine::Counting) -> Self {
        Self { operator, counting }
    }

    pub(crate) const fn counting(&self) -> &engine::Counting {
        &self.counting
    }
}

impl PyCounts<'_> {
    fn operator(&mut self, tally: &Tally) {
        self.count("message", "accepted", tally.messages);
        self.by_reason("message", "refused ", OpenRefusal::ALL, &tally.refused);
        self.count("message", "missed", tally.missed);
        self.count("handler", "failed", tally.handler_failures);
        self.count("timer", "late", tally.late_timers);
    }

    fn source(&mut self, tally: &SourceTally) {
        self.count("request", "admitted", tally.admitted);
        self.by_reason("request", "refused ", OfferRefusal::ALL, &tally.refused);
        self.count("request", "cancelled", tally.cancelled);
        self.count("request", "lost", tally.lost);
        self.count("handler", "failed", tally.handler_failures);
        self.count("handler", "held up the loop", tally.held_up);
        self.count("policy", "failed", tally.policy_failures);
        self.count("result", "held", tally.held);
        // A result that is forwarded on arrival is its message's output.
        let forwarded = tally.outputs.get(&Trigger::Arrival).copied();
        self.count("result", "forwarded", forwarded.unwrap_or(0));
        self.count("result", "preliminary", tally.preliminary);
        self.by_reason("result", "dropped ", DropReason::ALL, &tally.dropped);
        self.count("failure", "accepted", tally.failed);
        self.by_reason("failure", "dropped ", DropReason::ALL, &tally.failures_dropped);
        for (why, count) in tally.reasons.iter() {
            self.count("failed because", why, count);
        }
        self.count("failed because", "other reasons", tally.reasons.others());
        self.count("timer", "fired", tally.timers);
        self.by_reason("output", "", Trigger::ALL, &tally.outputs);
        self.count("output", "final", tally.finals);
    }

    fn by_reason<K: Display + Ord, const N: usize>(
        &mut self,
        what: &'static str,
        outcome: &str,
        all: [K; N],
        counts: &BTreeMap<K, u64>,
    ) {
        for why in all {
            let count = counts.get(&why).copied().unwrap_or_default();
            self.count(what, &format!("{outcome}{why}"), count);
        }
    }

    fn count(&mut self, what: &'static str, outcome: &str, count: u64) {
        self.counts.push(((self.of.to_owned(), what, outcome.to_owned()), count));
    }
}
