//! The counts of an operator. The engine writes them, anyone may read them, and each goes to a
//! meter of the `metrics` facade too (D11).

use std::array;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};
use metrics::{Counter, Gauge, Histogram, counter, gauge, histogram};
use tracing::error;

use crate::item::{Source, Trigger};
use crate::lag::Lag;
use crate::lock::lock;
use crate::reasons::Reasons;
use crate::tally::{CurrentDeadline, SourceTally, Tally};

/// The counts and meters of one operator.
///
/// Each count is a word of its own. So a tally that is read while an input is applied may have only
/// some of that input's counts. Data that seldom changes and is not a number is behind a lock.
// The fields that most messages count come first.
#[repr(C)]
pub(crate) struct Counts {
    sources: Vec<SourceCounts>,
    pub(crate) lag: Lag,
    messages: Count,
    /// The number of open messages.
    pub(crate) open: Gauge,
    refused: [Count; OpenRefusal::ALL.len()],
    missed: Count,
    handler_failures: Count,
    /// The delays of timers.
    timer_lag: Histogram,
    recording_error: Mutex<Option<Arc<str>>>,
}

/// The counts and meters of one source. Those that most messages count come first, in few cache
/// lines: with thousands of operators, none of them is in the cache.
#[repr(C, align(64))]
pub(crate) struct SourceCounts {
    /// Indexed by [`CountedEvent::index`].
    events: [Count; CountedEvent::LEN],
    /// The time from the request's admission to its result.
    pub(crate) response: Histogram,
    pub(crate) calls: Gauge,
    pub(crate) backlog: Gauge,
    /// The time from accepting the message to the output; under progressive, to each output.
    pub(crate) output: Histogram,
    deadlines: [Counter; CurrentDeadline::WHYS.len()],
    /// The deadline of the latest offer.
    deadline: Gauge,
    source: Source,
    reasons: Mutex<Reasons>,
    in_force: Mutex<Option<CurrentDeadline>>,
}

/// One count: the tally's cell, and the meter.
struct Count(AtomicU64, Counter);

/// An event that is counted for one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum CountedEvent {
    Admitted,
    Held,
    Output(Trigger),
    /// A result was forwarded when it came; `Output` counts its message.
    Forwarded,
    /// A result was forwarded when it came, and better ones may follow.
    Preliminary,
    Cancelled,
    Sent {
        bytes: u64,
    },
    Timer,
    /// A message ended without a better result than the one sent before.
    Final,
    Failed,
    Lost,
    /// A message handler failed.
    HandlerFailed,
    PolicyFailed,
    /// A handler blocked the thread that it ran on.
    HeldUp,
    Refused(OfferRefusal),
    Dropped(DropReason),
    FailureDropped(DropReason),
}

/// The counts of a running operator, which may be read from anywhere.
#[derive(Clone)]
pub struct Counting(Arc<Counts>);

impl Counts {
    /// Registers with the recorder that is installed now. Without one, metering costs next to
    /// nothing.
    pub(crate) fn new(operator: &str, sources: &[Source], lag_warning: Duration) -> Self {
        let name = || operator.to_owned();
        let refused = |why: OpenRefusal| counter!("fuseline_refused_messages_total", "operator" => name(), "why" => why.as_str());
        let handler_failures = counter!("fuseline_handler_failures_total",
            "operator" => name(), "source" => "operator", "handler" => "message");
        Self {
            messages: Count::new(counter!("fuseline_messages_total", "operator" => name())),
            refused: OpenRefusal::ALL.map(|why| Count::new(refused(why))),
            missed: Count::new(counter!("fuseline_missed_messages_total", "operator" => name())),
            handler_failures: Count::new(handler_failures),
            timer_lag: histogram!("fuseline_timer_lag_seconds", "operator" => name()),
            open: gauge!("fuseline_open_messages", "operator" => name()),
            lag: Lag::new(operator, lag_warning),
            sources: sources.iter().map(|source| SourceCounts::new(operator, source)).collect(),
            recording_error: Mutex::new(None),
        }
    }

    pub(crate) fn tally(&self) -> Tally {
        Tally {
            messages: self.messages.read(),
            refused: by_reason(OpenRefusal::ALL, |why| self.refused[why.index()].read()),
            missed: self.missed.read(),
            handler_failures: self.handler_failures.read(),
            late_timers: self.lag.late_timers(),
            greatest_lag: self.lag.greatest(),
            sources: self.sources.iter().map(SourceCounts::tally).collect(),
            recording_error: lock(&self.recording_error).clone(),
        }
    }

    pub(crate) fn message(&self) {
        self.messages.add(1);
    }

    pub(crate) fn refused(&self, why: OpenRefusal) {
        self.refused[why.index()].add(1);
    }

    pub(crate) fn missed(&self) {
        self.missed.add(1);
    }

    /// Notes the delay of a timer.
    pub(crate) fn timer_lag(&self, lag: Duration) {
        self.timer_lag.record(lag);
        self.lag.timer(lag);
    }

    fn index(&self, p: u16) -> Option<usize> {
        self.sources.iter().position(|counts| counts.source.priority == p)
    }

    /// Counts the reason why the source at `index` sent no result.
    pub(crate) fn reason(&self, index: usize, why: &str) -> Arc<str> {
        match self.sources.get(index) {
            Some(counts) => lock(&counts.reasons).count(why),
            None => why.into(),
        }
    }

    /// Stores the deadline of the source's latest offer. Call this when it has changed.
    pub(crate) fn in_force(&self, index: usize, in_force: CurrentDeadline) {
        if let Some(counts) = self.sources.get(index) {
            *lock(&counts.in_force) = Some(in_force);
            counts.deadline.set(in_force.deadline.as_secs_f64());
        }
    }

    /// Notes that a recording ends here.
    pub(crate) fn recording_error(&self, why: &str) {
        error!(why, "the trace ends here, because it cannot be written; the operator continues");
        lock(&self.recording_error).get_or_insert_with(|| why.into());
    }

    /// Counts an event of the source at `index`; local's index is 0.
    pub(crate) fn source(&self, index: usize, event: CountedEvent) {
        if let Some(counts) = self.sources.get(index) {
            counts.count(event);
        }
    }

    /// Returns the meters of the source at `index`.
    pub(crate) fn meters(&self, index: usize) -> Option<&SourceCounts> {
        self.sources.get(index)
    }
}

impl fmt::Debug for Counting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.tally().fmt(f)
    }
}

impl Counting {
    pub(crate) fn new(counts: &Arc<Counts>) -> Self {
        Self(Arc::clone(counts))
    }

    /// Returns the counts so far.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.0.tally()
    }

    /// Counts a failure of a message handler of cloud `p`, or of one of the operator's own handlers
    /// if `p` is `None`.
    pub fn handler_failed(&self, p: Option<u16>) {
        match p.and_then(|p| self.0.index(p)) {
            Some(index) => self.0.source(index, CountedEvent::HandlerFailed),
            None => self.0.handler_failures.add_shared(1),
        }
    }

    /// Counts a handler that ran longer than the [lag warning](crate::EngineConfig::lag_warning)
    /// allows, and logs it now and then. `p` is the source that the handler belongs to, or `None`
    /// for a handler of the operator.
    pub fn check_handler_time(&self, p: Option<u16>, lasted: Duration) {
        if !self.0.lag.is_too_long(lasted) {
            return;
        }
        let source = p.and_then(|p| self.0.index(p));
        if let Some(index) = source {
            self.0.source(index, CountedEvent::HeldUp);
        }
        let counts = source.and_then(|index| self.0.sources.get(index));
        let held_up =
            counts.map(|counts| (&*counts.source.name, counts.read(CountedEvent::HeldUp)));
        self.0.lag.held_up(lasted, held_up);
    }

    /// Returns how long a handler may run without a pause before it is counted and logged.
    #[must_use]
    pub fn lag_warning(&self) -> Duration {
        self.0.lag.warning()
    }

    /// Counts bytes that a call to cloud `p` sends. Does nothing if there is no such cloud.
    pub fn sent(&self, p: u16, bytes: u64) {
        if let Some(index) = self.0.index(p) {
            self.0.source(index, CountedEvent::Sent { bytes });
        }
    }
}

impl SourceCounts {
    fn new(operator: &str, source: &Source) -> Self {
        let name = source.name.as_ref().to_owned();
        let labels = [("operator", operator.to_owned()), ("source", name)];
        let [of_operator, of_source] = &labels;
        let labelled = |name: &'static str, (key, value): (&'static str, &'static str)| {
            counter!(name, &[of_operator.clone(), of_source.clone(), (key, value.to_owned())])
        };
        let mut events = CountedEvent::all().map(|event| match event.meter() {
            (name, Some(label)) => Count::new(labelled(name, label)),
            (name, None) => Count::new(counter!(name, &labels)),
        });
        Self {
            events: array::from_fn(|_| events.next().expect("as many as there are")),
            response: histogram!("fuseline_response_seconds", &labels),
            output: histogram!("fuseline_output_seconds", &labels),
            backlog: gauge!("fuseline_backlog", &labels),
            calls: gauge!("fuseline_calls", &labels),
            deadline: gauge!("fuseline_deadline_seconds", &labels),
            deadlines: CurrentDeadline::WHYS
                .map(|why| labelled("fuseline_deadlines_total", ("why", why))),
            source: source.clone(),
            reasons: Mutex::default(),
            in_force: Mutex::new(None),
        }
    }

    /// Counts a deadline that was chosen.
    pub(crate) fn chosen(&self, chosen: &CurrentDeadline) {
        self.deadlines[chosen.index()].increment(1);
    }

    fn count(&self, event: CountedEvent) {
        let count = &self.events[event.index()];
        match event {
            CountedEvent::Sent { bytes } => count.add_shared(bytes),
            CountedEvent::HandlerFailed | CountedEvent::HeldUp => count.add_shared(1),
            _ => count.add(1),
        }
    }

    fn read(&self, event: CountedEvent) -> u64 {
        self.events[event.index()].read()
    }

    fn tally(&self) -> SourceTally {
        use CountedEvent as Event;
        SourceTally {
            source: self.source.clone(),
            admitted: self.read(Event::Admitted),
            refused: by_reason(OfferRefusal::ALL, |why| self.read(Event::Refused(why))),
            outputs: by_reason(Trigger::ALL, |trigger| self.read(Event::Output(trigger))),
            finals: self.read(Event::Final),
            preliminary: self.read(Event::Preliminary),
            held: self.read(Event::Held),
            dropped: by_reason(DropReason::ALL, |why| self.read(Event::Dropped(why))),
            failed: self.read(Event::Failed),
            reasons: lock(&self.reasons).clone(),
            lost: self.read(Event::Lost),
            handler_failures: self.read(Event::HandlerFailed),
            policy_failures: self.read(Event::PolicyFailed),
            held_up: self.read(Event::HeldUp),
            failures_dropped: by_reason(DropReason::ALL, |why| {
                self.read(Event::FailureDropped(why))
            }),
            timers: self.read(Event::Timer),
            cancelled: self.read(Event::Cancelled),
            sent_bytes: self.read(Event::Sent { bytes: 0 }),
            in_force: *lock(&self.in_force),
        }
    }
}

impl CountedEvent {
    const REFUSED: usize = 13 + Trigger::ALL.len();
    const DROPPED: usize = Self::REFUSED + OfferRefusal::ALL.len();
    const FAILURE_DROPPED: usize = Self::DROPPED + DropReason::ALL.len();
    const LEN: usize = Self::FAILURE_DROPPED + DropReason::ALL.len();

    /// Returns all events in the order of their indices.
    fn all() -> impl Iterator<Item = Self> {
        [Self::Admitted, Self::Held]
            .into_iter()
            .chain(Trigger::ALL.map(Self::Output))
            .chain([Self::Forwarded, Self::Preliminary, Self::Cancelled, Self::Sent { bytes: 0 }])
            .chain([Self::Timer, Self::Final, Self::Failed, Self::Lost, Self::HandlerFailed])
            .chain([Self::PolicyFailed, Self::HeldUp])
            .chain(OfferRefusal::ALL.map(Self::Refused))
            .chain(DropReason::ALL.map(Self::Dropped))
            .chain(DropReason::ALL.map(Self::FailureDropped))
    }

    const fn index(self) -> usize {
        match self {
            Self::Admitted => 0,
            Self::Held => 1,
            Self::Output(trigger) => 2 + trigger as usize,
            Self::Forwarded => 5,
            Self::Preliminary => 6,
            Self::Cancelled => 7,
            Self::Sent { .. } => 8,
            Self::Timer => 9,
            Self::Final => 10,
            Self::Failed => 11,
            Self::Lost => 12,
            Self::HandlerFailed => 13,
            Self::PolicyFailed => 14,
            Self::HeldUp => 15,
            Self::Refused(why) => Self::REFUSED + why.index(),
            Self::Dropped(why) => Self::DROPPED + why.index(),
            Self::FailureDropped(why) => Self::FAILURE_DROPPED + why.index(),
        }
    }

    /// Returns the name of the event's meter, and its label in addition to the operator's and the
    /// source's.
    const fn meter(self) -> (&'static str, Option<(&'static str, &'static str)>) {
        match self {
            Self::Admitted => ("fuseline_requests_total", Some(("outcome", "admitted"))),
            Self::Refused(why) => ("fuseline_requests_total", Some(("outcome", why.as_str()))),
            Self::Held => ("fuseline_results_total", Some(("outcome", "held"))),
            Self::Forwarded => ("fuseline_results_total", Some(("outcome", "forwarded"))),
            Self::Preliminary => ("fuseline_results_total", Some(("outcome", "preliminary"))),
            Self::Dropped(why) => ("fuseline_results_total", Some(("outcome", why.as_str()))),
            Self::Output(by) => ("fuseline_outputs_total", Some(("outcome", by.as_str()))),
            Self::Final => ("fuseline_outputs_total", Some(("outcome", "final"))),
            Self::Failed => ("fuseline_failures_total", Some(("outcome", "accepted"))),
            Self::FailureDropped(why) => {
                ("fuseline_failures_total", Some(("outcome", why.as_str())))
            }
            Self::HandlerFailed => {
                ("fuseline_handler_failures_total", Some(("handler", "message")))
            }
            Self::PolicyFailed => ("fuseline_handler_failures_total", Some(("handler", "policy"))),
            Self::Cancelled => ("fuseline_cancelled_total", None),
            Self::Sent { .. } => ("fuseline_sent_bytes_total", None),
            Self::Timer => ("fuseline_timers_total", None),
            Self::Lost => ("fuseline_lost_total", None),
            Self::HeldUp => ("fuseline_held_up_total", None),
        }
    }
}

impl Count {
    const fn new(counter: Counter) -> Self {
        Self(AtomicU64::new(0), counter)
    }

    /// Adds to a count that only the engine changes, one input after the other, so no other
    /// addition can interfere.
    fn add(&self, count: u64) {
        self.0.store(self.read().wrapping_add(count), Ordering::Relaxed);
        self.1.increment(count);
    }

    /// Adds to a count that calls and handlers change in any thread.
    fn add_shared(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
        self.1.increment(count);
    }

    fn read(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Returns the counts that are not zero.
fn by_reason<K: Ord + Copy, const N: usize>(
    all: [K; N],
    read: impl Fn(K) -> u64,
) -> BTreeMap<K, u64> {
    all.into_iter().map(|why| (why, read(why))).filter(|(_, count)| *count > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_in_the_order_of_their_indices() {
        assert!(CountedEvent::all().map(CountedEvent::index).eq(0..CountedEvent::LEN));
    }
}
