//! One operator without its clock, its threads and its network: what happened goes in, what is to be
//! done comes out.

mod outcomes;

use std::fmt;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use fuseline_core::{Admission, ConfigError, Opening, Priority, Timestamp};
use fuseline_deadline::{End, Policy, Situation};
use fuseline_traces::{Header, Input};
use tracing::warn;

use crate::arbiter::{Answer, Arbiter};
use crate::counts::Counting;
use crate::effect::{Effect, Local, Offer};
use crate::engine::outcomes::{LOCAL, OperatorState};
use crate::event::Event;
use crate::item::Source;
use crate::queue::{SourceQueue, Waiting};
use crate::reasons::words;
use crate::writer::{Sink, TraceWriter};

/// The most clouds that a header may have.
const CLOUDS: usize = 15;

/// One operator: the core, the values it holds, the queues to its sources, its counts and its
/// recording.
///
/// `V` is what sources compute, `R` what is sent to them; the engine looks into neither. Instants are
/// nanoseconds of the adapter's monotonic clock. After each input, call
/// [`next_effect`](Self::next_effect) until it returns none.
///
/// - before the first input: [`set_policy`](Self::set_policy), [`set_linger`](Self::set_linger),
///   [`take_hints`](Self::take_hints), [`record`](Self::record)
/// - inputs: [`open`](Self::open), [`offer`](Self::offer), [`result`](Self::result),
///   [`fail`](Self::fail), [`tick`](Self::tick)
/// - what policies know: [`set_situation`](Self::set_situation)
/// - effects: [`next_effect`](Self::next_effect)
/// - questions: [`next_due`](Self::next_due), [`is_idle`](Self::is_idle), [`counts`](Self::counts)
pub struct Engine<V, R> {
    arbiter: Arbiter,
    state: OperatorState<V, R>,
    situation: Situation<'static>,
}

impl<V, R> Engine<V, R> {
    /// An operator with this configuration; `at_once[i]` bounds the calls under way to the header's
    /// cloud `i`, which is 1 if it is not given.
    ///
    /// # Errors
    /// The first [`ConfigError`] that holds.
    pub fn new(header: &Header, at_once: &[usize], local: Local) -> Result<Self, ConfigError> {
        let arbiter = Arbiter::new(header)?;
        let operator: Arc<str> = header.operator.as_deref().unwrap_or("operator").into();
        let mut queues =
            vec![SourceQueue::new(Source { priority: 0, name: "local".into() }, local.at_once)];
        for (i, cloud) in header.clouds.iter().enumerate() {
            let name = match &cloud.name {
                Some(name) => name.as_str().into(),
                None => format!("cloud-{}", cloud.p).into(),
            };
            let at_once = at_once.get(i).copied().unwrap_or(1);
            queues.push(SourceQueue::new(Source { priority: cloud.p, name }, at_once));
        }
        let state = OperatorState::new(operator, queues, local);
        // Unknown until it is set: policies risk nothing.
        Ok(Self { arbiter, state, situation: Situation::UNKNOWN })
    }

    /// Lets `policy` choose the deadlines of cloud `p`, each at most the one offered, and reports to it
    /// how each request ended. Does nothing if there is no such cloud.
    ///
    /// A request that was given up is censored, even if it never left the queue. Ages count from when
    /// the message was taken in. If the policy panics, the cloud is not asked.
    pub fn set_policy(&mut self, p: u16, policy: Box<dyn Policy + Send>) {
        if let Some(place) = self.cloud(p) {
            self.state.queues[place].policy = Some(policy);
        }
    }

    /// Lets calls to cloud `p` run on for up to `linger` after they were due, to see how long they really
    /// take. Does nothing if there is no such cloud.
    ///
    /// They take no place from calls still waited for. At most as many linger as calls may be under way;
    /// one more ends the oldest.
    pub fn set_linger(&mut self, p: u16, linger: Duration) {
        if let Some(place) = self.cloud(p) {
            self.state.queues[place].linger = nanos(linger);
        }
    }

    /// Gives back results that came too late as [hints](Effect::Hint), if their message is one of the
    /// last 1024.
    pub fn take_hints(&mut self) {
        self.state.open_messages.remember();
    }

    /// Sets what policies know of the vehicle, for messages from now on; at first nothing.
    pub const fn set_situation(&mut self, situation: Situation<'static>) {
        self.situation = situation;
    }

    /// Records everything from here on; call it before the first input, once for each file.
    ///
    /// Each file has a thread of its own that writes it: twice a second, and at once when a message is
    /// missed or refused, or more often as [`Recording`](fuseline_traces::Recording) says. If the
    /// disk fails or falls far behind, the recording ends early, with a whole input:
    /// [`Tally::unrecorded`](crate::Tally::unrecorded) and the log say so at once, and
    /// [`finish`](Self::finish) at the end. The operator goes on.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn record(&mut self, sink: impl Into<Sink>) -> io::Result<()> {
        let counts = Arc::clone(&self.state.counts);
        self.state.writers.push(TraceWriter::new(sink.into(), counts)?);
        Ok(())
    }

    /// F1: a message came; true if it is taken on. Then `job` goes to local, whose deadline is `deadline`,
    /// and clouds are offered `offers` (F2), which is not looked at otherwise.
    ///
    /// If too many computations already wait for local, local fails (F4) after the offers, and only
    /// clouds can answer the message.
    pub fn open(
        &mut self,
        at: u64,
        t: u64,
        deadline: Option<Duration>,
        job: R,
        offers: impl IntoIterator<Item = Offer<R>>,
    ) -> bool {
        self.begin(at);
        let deadline = deadline.map(nanos);
        let Self { arbiter, state, .. } = self;
        let opening = arbiter.open(at, t, deadline, |at, firing| state.fired(at, firing));
        let now = arbiter.now();
        state.record::<CLOUDS>(&Input::Open { at, t, deadline }, now, &Answer::Open { t, opening });
        if let Opening::Refused(why) = opening {
            state.refuse(now, t, why);
            state.send(now);
            return false;
        }
        state.counts.message();
        state.counts.source(LOCAL, Event::Admitted);
        state.open_messages.open(t, now);
        let lost_after = deadline.filter(|_| state.local.lossy);
        state.queues[LOCAL].push(Waiting {
            t,
            requested_at: now,
            due: None,
            lost_after,
            request: job,
        });
        state.send(now);
        for Offer { priority, deadline, request } in offers {
            self.offer(at, t, priority, deadline, request);
        }
        if self.state.queues[LOCAL].backlog() > self.state.local.waiting {
            self.fail(at, t, 0, &"too many computations wait");
        }
        true
    }

    /// F2: a message handler wants `request` sent to cloud `p`.
    ///
    /// If the cloud has a policy, the policy chooses the deadline, at most `deadline`. It is asked only
    /// if the request will be admitted.
    pub fn offer(&mut self, at: u64, t: u64, p: u16, deadline: Duration, request: R) {
        // F0: what is due comes first; it may close the message that the policy would be asked about.
        if self.arbiter.next_due().is_some_and(|due| due <= at) {
            self.tick(at);
        }
        self.begin(at);
        let place = self.state.place(p);
        let backlog = place.map_or(0, |place| self.state.queues[place].backlog() as u64);
        let is_cloud = |place: &usize| *place != LOCAL && !deadline.is_zero();
        let requested_at =
            place.filter(is_cloud).filter(|place| self.is_policy_asked(t, *place, backlog));
        let deadline = match requested_at {
            None => Some(deadline),
            Some(place) => self.state.deadline(at, t, place, self.situation, deadline),
        };
        let Some(deadline) = deadline else { return };
        let deadline = nanos(deadline);
        let Self { arbiter, state, .. } = self;
        let p = p.into();
        let admission =
            arbiter.offer(at, (t, p), deadline, backlog, |at, firing| state.fired(at, firing));
        let now = arbiter.now();
        let input = Input::Offer { at, t, p, deadline, backlog };
        state.record::<CLOUDS>(&input, now, &Answer::Offer { t, p, admission });
        match (admission, place) {
            (Admission::Refused(why), _) => state.refuse_offer(t, place, why),
            // The core admits only requests to registered clouds.
            (Admission::Admitted { .. }, None) => {}
            (Admission::Admitted { due }, Some(place)) => {
                state.counts.source(place, Event::Admitted);
                let due = Some(due.as_nanos());
                let waiting = Waiting { t, requested_at: now, due, lost_after: None, request };
                state.queues[place].push(waiting);
            }
        }
        state.send(now);
    }

    /// F3: a source's result came.
    pub fn result(&mut self, at: u64, t: u64, p: u16, value: V) {
        self.begin(at);
        let Self { arbiter, state, .. } = self;
        if let Some(place) = state.place(p) {
            state.ended(at, t, place, End::Answered);
        }
        let outcome = arbiter.result(at, (t, p.into()), |at, firing| state.fired(at, firing));
        let now = arbiter.now();
        let input = Input::Result { at, t, p: p.into() };
        state.record(&input, now, &Answer::Result { t, p: p.into(), outcome });
        state.result(now, (t, p), &outcome, value);
        state.send(now);
    }

    /// F4: a source will send no result; `why` is logged, counted, and given with the message's item.
    pub fn fail(&mut self, at: u64, t: u64, p: u16, why: &dyn fmt::Display) {
        self.begin(at);
        let Self { arbiter, state, .. } = self;
        let place = state.place(p);
        let why = words(why);
        let source = place.map(|place| state.name(place));
        warn!(operator = %state.operator, timestamp = t, source, %why, "no result will come");
        if let Some(place) = place {
            state.ended(at, t, place, End::Failed);
        }
        let outcome = arbiter.fail(at, (t, p.into()), |at, firing| state.fired(at, firing));
        let now = arbiter.now();
        let input = Input::Fail { at, t, p: p.into() };
        state.record(&input, now, &Answer::Fail { t, p: p.into(), outcome });
        state.failed(now, (t, p), &outcome, &why);
        state.send(now);
    }

    /// F5: time went by.
    pub fn tick(&mut self, at: u64) {
        self.begin(at);
        let Self { arbiter, state, .. } = self;
        arbiter.tick(at, |at, firing| state.fired(at, firing));
        state.record::<CLOUDS>(&Input::Tick { at }, arbiter.now(), &Answer::Tick);
        state.send(arbiter.now());
    }

    /// Ends the recordings, if there are any, and waits until they are written. Dropping the engine
    /// does the same.
    ///
    /// # Errors
    /// The first error while recording; the trace is whole up to there.
    pub fn finish(&mut self) -> io::Result<()> {
        // All of them, even if the first fails.
        let written: Vec<_> =
            self.state.writers.drain(..).map(|mut writer| writer.finish()).collect();
        written.into_iter().collect()
    }

    /// The next thing to do, in the order of the decisions.
    pub fn next_effect(&mut self) -> Option<Effect<V, R>> {
        self.state.effects.pop_front()
    }

    /// The earliest instant, in ns, at which a timer is due, a call has lingered long enough, or a lost
    /// computation frees its place for one that waits; none if there is none. Tick then.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        let queues = &self.state.queues;
        let lapses = queues.iter().filter_map(SourceQueue::next_lapse);
        self.arbiter.next_due().into_iter().chain(queues[LOCAL].next_lost()).chain(lapses).min()
    }

    /// Whether no message is open.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.arbiter.fusion().is_empty()
    }

    /// The counts, which go on counting.
    #[must_use]
    pub fn counts(&self) -> Counting {
        Counting::new(&self.state.counts)
    }

    /// Time comes before the input that carries it.
    fn begin(&mut self, at: u64) {
        if let Some(due) = self.arbiter.next_due().filter(|due| *due <= at) {
            let lag = &self.state.counts.meters.timer_lag;
            lag.record(Duration::from_nanos(at - due));
        }
        self.state.lapse(at);
    }

    /// T6: a policy is asked about what is admitted alone, or it would count probes that never were sent.
    fn is_policy_asked(&self, t: u64, place: usize, backlog: u64) -> bool {
        let queue = &self.state.queues[place];
        if queue.policy.is_none() {
            return true;
        }
        let (fusion, p) = (self.arbiter.fusion(), Priority::new(queue.source.priority));
        let (Some(slot), Some(cloud), Some(mut gate)) =
            (fusion.slot(Timestamp::new(t)), fusion.source(p), fusion.gate(p))
        else {
            return false;
        };
        // F2: the gate of the machine itself moves when it is offered.
        slot.offer(cloud).1.is_none() && gate.admits(backlog)
    }

    /// The place of cloud `p`.
    fn cloud(&self, p: u16) -> Option<usize> {
        self.state.place(p).filter(|place| *place != LOCAL)
    }
}

/// Saturates at 2⁶⁴ − 1 ns, as due instants do (A14).
fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
