//! One operator without its clock, its threads and its network. Inputs are methods, and tasks for
//! the adapter come out as effects.
//!
//! Each input is one call of the [`SizedArbiter`], which decides. [`apply`] carries out the
//! answers. Neither module decides anything about time or rank.

mod apply;

use std::fmt;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_core::{Admission, Opening};
use fuseline_deadline::{End, Situation};
use fuseline_traces::{Annotations, Input, ValueKeys, nanos};

use crate::arbiter::Answer;
use crate::budget::Budget;
use crate::config::{EngineConfig, EngineConfigError};
use crate::counts::{CountedEvent, Counting, Counts};
use crate::eager_notice::EagerNotice;
use crate::effect::{Effect, Local, Offer, Overflow};
use crate::effect_queue::EffectQueue;
use crate::greatest_deadline::GreatestDeadline;
use crate::item::Source;
use crate::latency::{Latency, Reserve};
use crate::lineage::{Lineage, StampedValue};
use crate::open_message::OpenMessages;
use crate::policies::Policies;
use crate::queue::Waiting;
use crate::reasons::to_text;
use crate::recordings::Recordings;
use crate::sized_arbiter::{ServedFirings, SizedArbiter};
use crate::sources::{LOCAL, SourceQueues};
use crate::writer::{Sink, TraceWriter};

/// One operator: the core, the values that it holds, the queues to its sources, its counts and its
/// recordings.
///
/// `V` is what sources compute, and `R` is what is sent to them; the engine looks into neither.
/// Instants are nanoseconds of the adapter's monotonic clock. Timestamps, priorities and instants
/// are plain numbers, not the core's types, because any number is a legal input (A18). After each
/// input, call [`next_effect`](Self::next_effect) until it returns `None`.
///
/// - constructor: [`new`](Self::new), with an [`EngineConfig`]
/// - before the first input: [`set_start`](Self::set_start), [`record`](Self::record)
/// - inputs: [`open`](Self::open), [`open_with`](Self::open_with), [`offer`](Self::offer),
///   [`result`](Self::result), [`fail`](Self::fail), [`tick`](Self::tick)
/// - facts about the vehicle and the operators downstream: [`set_situation`](Self::set_situation),
///   [`set_reserve`](Self::set_reserve)
/// - effects: [`next_effect`](Self::next_effect)
/// - queries: [`next_due`](Self::next_due), [`is_idle`](Self::is_idle), [`counts`](Self::counts)
// The fields that every result needs come first: with thousands of operators nothing is in the
// cache.
#[repr(C)]
pub struct Engine<V, R> {
    arbiter: SizedArbiter,
    counts: Arc<Counts>,
    sources: SourceQueues<R>,
    open_messages: OpenMessages<V>,
    effects: EffectQueue<V, R>,
    firings: ServedFirings,
    /// The number of open messages that the gauge shows.
    shown_open: usize,
    recordings: Recordings,
    policies: Policies,
    eager_notice: EagerNotice,
    operator: Arc<str>,
    local: Local,
    /// The number of computations that may wait for local.
    waiting: usize,
    /// The part of an end-to-end deadline that is kept for the operators downstream.
    reserve: Reserve,
    /// Records how long messages and local's computations take, if the operators upstream want to
    /// know.
    latency: Option<Latency>,
    has_substitutes: bool,
    greatest_deadline: GreatestDeadline,
    /// `true` if messages' ages come from a clock that may step (D13).
    has_doubtful_ages: bool,
    /// The instant when the engine's clock read 0.
    start: Option<Instant>,
}

impl<V, R> Engine<V, R> {
    /// Creates an operator with no open message.
    ///
    /// # Errors
    /// Returns the error of [`EngineConfig::check`].
    pub fn new(config: EngineConfig) -> Result<Self, EngineConfigError> {
        let arbiter = config.machine()?;
        let operator: Arc<str> = config.operator.into();
        let has_max_ages = config.clouds.iter().any(|cloud| cloud.max_age > 0);
        let sources = SourceQueues::new(&config.clouds, config.local);
        let named: Vec<Source> = sources.iter().map(|queue| queue.source.clone()).collect();
        Ok(Self {
            arbiter,
            firings: Vec::new(),
            counts: Arc::new(Counts::new(&operator, &named, config.lag_warning)),
            operator,
            policies: Policies::new(config.clouds.into_iter().map(|cloud| cloud.policy)),
            sources,
            local: config.local,
            waiting: config.local.waiting.unwrap_or(config.window.into()),
            reserve: Reserve::default(),
            latency: config.latency,
            has_substitutes: config.has_substitutes,
            greatest_deadline: GreatestDeadline::new(config.greatest_deadline),
            has_doubtful_ages: config.has_doubtful_ages,
            open_messages: OpenMessages::new(config.takes_hints, has_max_ages),
            start: None,
            eager_notice: EagerNotice::new(config.commit),
            shown_open: 0,
            recordings: Recordings::default(),
            effects: EffectQueue::new(),
        })
    }

    /// Sets the instant at which this engine's clock reads 0. If it is not set, the ages of
    /// messages are unknown. Call this before the first input.
    pub const fn set_start(&mut self, start: Instant) {
        self.start = Some(start);
    }

    /// Sets the part of an end-to-end deadline that is kept for the operators downstream (E3). It
    /// applies to messages from now on, and is 0 at first.
    pub const fn set_reserve(&mut self, reserve: Reserve) {
        self.reserve = reserve;
    }

    /// Sets the vehicle's situation, which policies use for messages from now on. At first it is
    /// unknown.
    pub const fn set_situation(&mut self, situation: Situation<'static>) {
        self.policies.set_situation(situation);
    }

    /// Records everything from here on. Call this before the first input, once for each file.
    ///
    /// Each file has its own thread. It writes twice a second, and at once when a message is missed
    /// or refused. [`Recording::every_input`](fuseline_traces::Recording::every_input) makes it
    /// write each input at once. If the disk fails or falls far behind, the recording ends early,
    /// with a whole input. [`Tally::recording_error`](crate::Tally::recording_error) and the log
    /// report this at once, and [`finish`](Self::finish) at the end. The operator continues.
    ///
    /// # Errors
    /// Returns an error if the thread cannot be started.
    pub fn record(&mut self, sink: impl Into<Sink>) -> io::Result<()> {
        let counts = Arc::clone(&self.counts);
        self.recordings.add(TraceWriter::new(sink.into(), counts)?);
        Ok(())
    }

    /// Takes a message (F1). Returns `true` if it is accepted.
    ///
    /// The `job` of an accepted message goes to local, which may take `deadline`, and the clouds
    /// are offered `offers` (F2). If the message is refused, `offers` is not read. If too many
    /// computations then wait for local, one of them is [discarded](Overflow) after the offers.
    /// Local fails for that message (F4), and only clouds can return a result for it.
    pub fn open(
        &mut self,
        at: u64,
        t: u64,
        deadline: Option<Duration>,
        job: R,
        offers: impl IntoIterator<Item = Offer<R>>,
    ) -> bool {
        self.open_with(at, t, deadline, None, job, offers)
    }

    /// Takes a message with a lineage, which its items have too. Otherwise it does what
    /// [`open`](Self::open) does.
    pub fn open_with(
        &mut self,
        at: u64,
        t: u64,
        deadline: Option<Duration>,
        lineage: Option<Arc<Lineage>>,
        job: R,
        offers: impl IntoIterator<Item = Offer<R>>,
    ) -> bool {
        self.begin(at);
        let budget = lineage.as_ref().and_then(|lineage| self.budget(at, lineage));
        // Local also ends with the budget (E3).
        let left = budget.map(|budget| budget.for_local(at, self.has_substitutes));
        let deadline = deadline.into_iter().chain(left).min().map(nanos);
        let instant = if lineage.is_some() { self.instant(at) } else { None };
        let counts_from_now = self.has_doubtful_ages;
        let annotations = || match &lineage {
            Some(lineage) => lineage.annotations(instant, counts_from_now),
            None => Annotations::NONE,
        };
        let (answer, now) = self.decide_annotated(&Input::Open { at, t, deadline }, annotations);
        if let Answer::Open { opening: Opening::Refused(why), .. } = answer {
            self.refuse(now, t, why, lineage);
            self.start_waiting(now);
            return false;
        }
        self.counts.message();
        self.counts.source(LOCAL, CountedEvent::Admitted);
        self.open_messages.open(t, now, lineage, budget);
        let (due, lost_after, spent, request) = (None, deadline, 0, job);
        let waiting = Waiting { t, requested_at: now, due, lost_after, spent, request };
        self.admit(now, LOCAL, waiting);
        self.start_waiting(now);
        for Offer { priority, deadline, request } in offers {
            self.offer(at, t, priority, deadline, request);
        }
        if self.sources[LOCAL].backlog() > self.waiting {
            // By default the oldest is discarded, because a fresh message is worth more (D17).
            let thrown_out = match self.local.overflow {
                Overflow::DropOldest => self.sources[LOCAL].oldest_waiting().unwrap_or(t),
                Overflow::DropNewest => t,
            };
            self.fail(at, thrown_out, 0, &"too many computations wait");
        }
        true
    }

    /// Offers `request` to cloud `p` for a message handler (F2).
    ///
    /// If the cloud has a policy, the policy chooses the deadline, at most `deadline`. The policy
    /// is called only if a request with that greatest deadline would be admitted.
    pub fn offer(&mut self, at: u64, t: u64, p: u16, deadline: Duration, request: R) {
        // Due timers come first, since they may close the message that the policy would be asked
        // about (F0).
        if self.arbiter.next_due().is_some_and(|due| due <= at) {
            self.tick(at);
        }
        self.begin(at);
        let index = self.sources.index(p);
        let backlog = index.map_or(0, |index| self.sources[index].backlog() as u64);
        let is_cap = index.is_some_and(|index| self.policies.has_policy(index));
        let deadline = self.greatest_deadline.of_offer(deadline, (&self.operator, p), is_cap);
        let Some(deadline) = self.deadline(at, (t, p), deadline, backlog) else { return };
        let (p, deadline) = (p.into(), nanos(deadline));
        let (answer, now) = self.decide(&Input::Offer { at, t, p, deadline, backlog });
        let Answer::Offer { admission, .. } = answer else { return };
        match (admission, index) {
            (Admission::Refused(why), _) => self.refuse_offer(t, index, why),
            // The core admits only requests to registered clouds.
            (Admission::Admitted { .. }, None) => {}
            (Admission::Admitted { due }, Some(index)) => {
                self.counts.source(index, CountedEvent::Admitted);
                self.notice_eager(t, index, due.as_nanos());
                let due = Some(due.as_nanos());
                let spent = self.open_messages.budget(t).map_or(0, |budget| budget.spent());
                let (requested_at, lost_after) = (now, None);
                let waiting = Waiting { t, requested_at, due, lost_after, spent, request };
                self.admit(now, index, waiting);
            }
        }
        self.start_waiting(now);
    }

    /// Applies a source's result (F3).
    ///
    /// A value counts as a failure if it was computed from a later message, or from an older one
    /// than the source's `max_age` allows (D2, F4). So does a value that is meant for another
    /// message (D18).
    pub fn result(&mut self, at: u64, t: u64, p: u16, value: impl Into<StampedValue<V>>) {
        let value = value.into();
        let ValueKeys { of, meant_for } = value.keys();
        let index = self.sources.index(p);
        let max_age = index.map_or(0, |index| self.sources[index].max_age);
        if let Some(of) = of.filter(|of| !(t.saturating_sub(max_age)..=t).contains(of)) {
            let least = t.saturating_sub(max_age);
            let why = format_args!(
                "the value was computed from message {of}; it must be from messages {least} to {t}"
            );
            return self.fail(at, t, p, &why);
        }
        if let Some(meant_for) = meant_for.filter(|meant_for| *meant_for != t) {
            return self.fail(
                at,
                t,
                p,
                &format_args!("the value is meant for message {meant_for}"),
            );
        }
        self.begin(at);
        if let Some(index) = index {
            self.log_recovery(at, index);
            let took = self.ended(at, t, index, End::Answered);
            if let (LOCAL, Some(latency), Some(took)) = (index, &self.latency, took) {
                latency.record_local(took);
            }
        }
        let input = Input::Result { at, t, p: p.into() };
        let (answer, now) = self.decide_annotated(&input, || value.keys().into());
        let Answer::Result { outcome, .. } = answer else { return };
        self.settle_result(now, (t, p), &outcome, value);
        self.start_waiting(now);
    }

    /// Reports that a source will send no result (F4).
    ///
    /// `why` is counted, given with the message's item, and logged. The first failure is logged as
    /// a warning, and then one every ten seconds while no result comes. All others are logged at
    /// level debug.
    pub fn fail(&mut self, at: u64, t: u64, p: u16, why: &dyn fmt::Display) {
        self.begin(at);
        let index = self.sources.index(p);
        let why = to_text(why);
        self.log_failure(at, t, index, &why);
        if let Some(index) = index {
            self.ended(at, t, index, End::Failed);
        }
        let (answer, now) = self.decide(&Input::Fail { at, t, p: p.into() });
        let Answer::Fail { outcome, .. } = answer else { return };
        self.settle_failure(now, (t, p), &outcome, &why);
        self.start_waiting(now);
    }

    /// Advances the clock and fires the timers that are due (F5).
    pub fn tick(&mut self, at: u64) {
        self.begin(at);
        let (_, now) = self.decide(&Input::Tick { at });
        self.start_waiting(now);
    }

    /// Ends the run at `at`. If messages are open, a last `tick` in the trace shows that everything
    /// that was due by then is overdue (A44).
    ///
    /// That tick decides nothing, because it comes before the next timer is due. Call
    /// [`finish`](Self::finish) next.
    pub fn end(&mut self, at: u64) {
        if !self.is_idle() {
            self.tick(self.next_due().map_or(at, |due| at.min(due.saturating_sub(1))));
        }
    }

    /// Ends the recordings, if there are any, and waits until they are written. Dropping the engine
    /// does the same.
    ///
    /// # Errors
    /// Returns the first error while recording. The trace is whole up to there.
    pub fn finish(&mut self) -> io::Result<()> {
        self.recordings.finish()
    }

    /// Returns the next effect, in the order of the decisions, or `None`.
    pub fn next_effect(&mut self) -> Option<Effect<V, R>> {
        self.effects.pop()
    }

    /// Returns the earliest instant, in ns, at which to [`tick`](Self::tick): a timer is due, a
    /// call has lingered long enough, or a computation counts as lost. If results can be lost on
    /// the way, a lost computation counts only while another one waits.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.arbiter.next_due().into_iter().chain(self.sources.next_due()).min()
    }

    /// Returns `true` if no message is open.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.arbiter.is_idle()
    }

    /// Returns how long local may take for a message that was accepted at `at` with `deadline`. Its
    /// end-to-end deadline may shorten the time (E3).
    #[must_use]
    pub fn local_deadline(&self, at: u64, t: u64, deadline: Option<Duration>) -> Option<Duration> {
        let budget = self.open_messages.budget(t);
        let left = budget.map(|budget| budget.for_local(at, self.has_substitutes));
        deadline.into_iter().chain(left).min()
    }

    /// Returns the operator's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.operator
    }

    /// Returns how long calls to cloud `p` may run on after their due instants.
    #[must_use]
    pub fn linger(&self, p: u16) -> Duration {
        let index = self.sources.cloud(p);
        index.map_or(Duration::ZERO, |index| Duration::from_nanos(self.sources[index].linger))
    }

    /// Returns the number of open messages.
    #[must_use]
    pub fn open_len(&self) -> usize {
        self.open_messages.len()
    }

    /// Returns a handle to the counts, which stays up to date.
    #[must_use]
    pub fn counts(&self) -> Counting {
        Counting::new(&self.counts)
    }

    /// Returns the rest of a message's end-to-end deadline, if it has one.
    fn budget(&self, at: u64, lineage: &Lineage) -> Option<Budget> {
        lineage.within?;
        let instant = if self.has_doubtful_ages { None } else { self.instant(at) };
        Budget::new(lineage, (at, instant), self.reserve)
    }
}
