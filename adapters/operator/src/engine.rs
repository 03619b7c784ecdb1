//! One operator without its clock, its threads and its network: what happened goes in, what to do
//! comes out.

use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use fuseline_arbiter::{Arbiter, decisions_of};
use fuseline_core::ConfigError;
use fuseline_traces::{Decision, Header, Input};
use tracing::{debug, warn};

use crate::effect::{Effect, Local, Offer};
use crate::item::{Ending, Failure, Forwarded, Item, Source, Trigger};
use crate::lane::{Lane, Waiting};
use crate::reasons::words;
use crate::tally::{Counting, Counts, Event};
use crate::tape::{Sink, Tape};

/// Local's priority and the place of its lane.
const LOCAL: usize = 0;

/// One operator: the core, the values it holds, the queues to its sources, its counts and its
/// recording.
///
/// `V` is what sources compute, `R` what is sent to them; neither is looked at. Instants are
/// nanoseconds of the adapter's monotonic clock. After each input, take the effects by
/// [`next_effect`](Self::next_effect) until there are none.
///
/// - inputs: [`open`](Self::open), [`offer`](Self::offer), [`result`](Self::result),
///   [`fail`](Self::fail), [`tick`](Self::tick)
/// - effects: [`next_effect`](Self::next_effect)
/// - questions: [`next_due`](Self::next_due), [`is_idle`](Self::is_idle), [`counts`](Self::counts)
pub struct Engine<V, R> {
    operator: Arc<str>,
    arbiter: Arbiter,
    /// Local's, then the clouds' in the header's order.
    lanes: Vec<Lane<R>>,
    local: Local,
    open: HashMap<u64, Story<V>>,
    counts: Arc<Counts>,
    effects: VecDeque<Effect<V, R>>,
    decisions: Vec<Decision>,
    tapes: Vec<Tape>,
}

/// What an open message has.
struct Story<V> {
    opened: u64,
    held: Vec<Held<V>>,
    failures: Vec<Failure>,
}

struct Held<V> {
    p: u64,
    arrived: u64,
    value: V,
}

/// What came along with an input.
enum Cargo<'a, V, R> {
    Nothing,
    Value(V),
    Request(R),
    /// Why there is no result.
    Reason(&'a str),
}

impl<V, R> Engine<V, R> {
    /// An operator so configured; `at_once[i]` bounds the calls under way to the header's cloud
    /// `i`, and is 1 where there is none.
    ///
    /// # Errors
    /// Why the configuration is refused.
    pub fn new(header: &Header, at_once: &[usize], local: Local) -> Result<Self, ConfigError> {
        let arbiter = Arbiter::new(header)?;
        let operator: Arc<str> = header.operator.as_deref().unwrap_or("operator").into();
        let mut lanes =
            vec![Lane::new(Source { priority: 0, name: "local".into() }, local.at_once)];
        for (i, cloud) in header.clouds.iter().enumerate() {
            let name = match &cloud.name {
                Some(name) => name.as_str().into(),
                None => format!("cloud-{}", cloud.p).into(),
            };
            let at_once = at_once.get(i).copied().unwrap_or(1);
            lanes.push(Lane::new(Source { priority: cloud.p, name }, at_once));
        }
        let sources: Vec<Source> = lanes.iter().map(|lane| lane.source.clone()).collect();
        let counts = Arc::new(Counts::new(&operator, &sources));
        let (open, effects, decisions) = (HashMap::new(), VecDeque::new(), Vec::new());
        Ok(Self {
            operator,
            arbiter,
            lanes,
            local,
            open,
            counts,
            effects,
            decisions,
            tapes: Vec::new(),
        })
    }

    /// Records everything from here on; to be called before the first input, once for each file.
    ///
    /// A file is written by a thread of its own: twice a second, and at once when a message is
    /// missed or refused, or more often as [`Recording`](fuseline_traces::Recording) says. If the
    /// disk falls far behind or refuses what is written, the recording ends early, whole:
    /// [`Tally::unrecorded`](crate::Tally::unrecorded) and the log say so at once, and
    /// [`finish`](Self::finish) at the end. The operator goes on.
    ///
    /// # Errors
    /// If the system has no thread left.
    pub fn record(&mut self, sink: impl Into<Sink>) -> io::Result<()> {
        self.tapes.push(Tape::new(sink.into(), Arc::clone(&self.counts))?);
        Ok(())
    }

    /// F1: a message came. If it is taken on, `job` goes to local, whose deadline is `deadline`, and it is
    /// offered to clouds (F2); `offers` is looked at only then. Says whether it was.
    ///
    /// If too many computations wait for local already, local fails (F4) after the offers, so that
    /// the clouds alone can answer it.
    pub fn open(
        &mut self,
        at: u64,
        t: u64,
        deadline: Option<Duration>,
        job: R,
        offers: impl IntoIterator<Item = Offer<R>>,
    ) -> bool {
        let deadline = deadline.map(nanos);
        self.apply(Input::Open { at, t, deadline }, Cargo::Nothing);
        if self.decisions.iter().any(|decision| matches!(decision, Decision::RefuseOpen { .. })) {
            self.send(at);
            return false;
        }
        self.counts.message();
        self.counts.source(LOCAL, Event::Admitted);
        self.open.insert(t, Story { opened: at, held: Vec::new(), failures: Vec::new() });
        let lost_after = deadline.filter(|_| self.local.lossy);
        let lane = &mut self.lanes[LOCAL];
        lane.push(Waiting { t, asked: at, due: None, lost_after, request: job });
        self.send(at);
        for Offer { priority, deadline, request } in offers {
            self.offer(at, t, priority, deadline, request);
        }
        if self.lanes[LOCAL].backlog() > self.local.waiting {
            self.fail(at, t, 0, &"too many computations wait");
        }
        true
    }

    /// F2: a message handler wants `request` sent to cloud `p`.
    pub fn offer(&mut self, at: u64, t: u64, p: u16, deadline: Duration, request: R) {
        let backlog = self.lane(p.into()).map_or(0, |lane| self.lanes[lane].backlog() as u64);
        let input = Input::Offer { at, t, p: p.into(), deadline: nanos(deadline), backlog };
        self.apply(input, Cargo::Request(request));
        self.send(at);
    }

    /// F3: a source's result came.
    pub fn result(&mut self, at: u64, t: u64, p: u16, value: V) {
        self.end(at, t, p);
        self.apply(Input::Result { at, t, p: p.into() }, Cargo::Value(value));
        self.send(at);
    }

    /// F4: a source will send no result; `why` is logged, counted, and told with the message's item.
    pub fn fail(&mut self, at: u64, t: u64, p: u16, why: &dyn fmt::Display) {
        let source = self.lane(p.into()).map(|lane| &*self.lanes[lane].source.name);
        let why = words(why);
        warn!(operator = %self.operator, timestamp = t, source, %why, "no result will come");
        self.end(at, t, p);
        self.apply(Input::Fail { at, t, p: p.into() }, Cargo::Reason(&why));
        self.send(at);
    }

    /// F5: time went by.
    pub fn tick(&mut self, at: u64) {
        self.apply(Input::Tick { at }, Cargo::Nothing);
        self.send(at);
    }

    /// Ends the recordings, if there are any, and waits until they are written. Dropping the engine
    /// does the same.
    ///
    /// # Errors
    /// The first error met while recording; the trace is whole up to there.
    pub fn finish(&mut self) -> io::Result<()> {
        // All are ended, whatever became of the first.
        let written: Vec<_> = self.tapes.drain(..).map(|mut tape| tape.finish()).collect();
        written.into_iter().collect()
    }

    /// The next thing to be done, in the order of the decisions.
    pub fn next_effect(&mut self) -> Option<Effect<V, R>> {
        self.effects.pop_front()
    }

    /// The earliest instant at which a timer is due, or a lost computation gives its place to one
    /// that waits; tick then.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        let due = self.arbiter.next_due();
        let lost = self.lanes[LOCAL].next_lost();
        due.map_or(lost, |due| Some(lost.map_or(due, |lost| lost.min(due))))
    }

    /// Whether no message is open.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.arbiter.fusion().is_empty()
    }

    /// The counts, as they go on.
    #[must_use]
    pub fn counts(&self) -> Counting {
        Counting::new(&self.counts)
    }

    /// Lets the core decide, records it, and turns its decisions into effects.
    fn apply(&mut self, input: Input, mut cargo: Cargo<'_, V, R>) {
        let at = input.at();
        if let Some(due) = self.arbiter.next_due().filter(|due| *due <= at) {
            self.counts.meters.timer_lag.record(Duration::from_nanos(at - due));
        }
        let mut decisions = std::mem::take(&mut self.decisions);
        decisions.clear();
        let answer = self.arbiter.apply(&input, |at, firing| {
            decisions_of(at, firing, |decision| decisions.push(decision));
        });
        let fired = decisions.len();
        answer.decisions(self.arbiter.now(), |decision| decisions.push(decision));
        for tape in &mut self.tapes {
            tape.record(&input, &decisions);
        }
        let (timers, own) = decisions.split_at(fired);
        for decision in timers {
            self.act(decision, Trigger::Timer, &mut Cargo::Nothing);
        }
        if let (Input::Fail { t, p, .. }, Cargo::Reason(why)) = (input, &cargo)
            && !matches!(own.first(), Some(Decision::Drop { .. }))
        {
            self.failed(t, p, why);
        }
        for decision in own {
            match input {
                Input::Fail { .. } => self.act(decision, Trigger::Failure, &mut cargo),
                Input::Open { .. }
                | Input::Offer { .. }
                | Input::Result { .. }
                | Input::Tick { .. } => self.act(decision, Trigger::Arrival, &mut cargo),
            }
        }
        self.decisions = decisions;
    }

    /// Does what one decision says; `trigger` is what brought it about.
    fn act(&mut self, decision: &Decision, trigger: Trigger, cargo: &mut Cargo<'_, V, R>) {
        let operator = &*self.operator;
        match *decision {
            Decision::Timer { t, p, .. } => {
                debug!(operator, timestamp = t, source = self.name(p), "timer fired");
                self.count(p, Event::Timer);
                self.close(t, p);
            }
            Decision::RefuseOpen { at, t, why } => {
                warn!(operator, timestamp = t, %why, "message refused");
                self.counts.refused(why);
                self.output(t, at, at, Ending::Refused(why), Vec::new());
            }
            Decision::RefuseOffer { t, p, why, .. } => {
                debug!(operator, timestamp = t, source = self.name(p), %why, "request refused");
                self.count(p, Event::Refused(why));
            }
            Decision::Request { at, t, p, due } => {
                self.count(p, Event::Admitted);
                if let (Some(lane), Cargo::Request(request)) = (self.lane(p), cargo.take()) {
                    let waiting =
                        Waiting { t, asked: at, due: Some(due), lost_after: None, request };
                    self.lanes[lane].push(waiting);
                }
            }
            Decision::Hold { at, t, p } => {
                debug!(operator, timestamp = t, source = self.name(p), "result held");
                self.count(p, Event::Held);
                if let (Some(story), Cargo::Value(value)) = (self.open.get_mut(&t), cargo.take()) {
                    story.held.push(Held { p, arrived: at, value });
                }
            }
            Decision::Drop { t, p, why, .. } => {
                let source = self.name(p);
                if trigger == Trigger::Failure {
                    debug!(operator, timestamp = t, source, %why, "failure dropped");
                    self.count(p, Event::FailureDropped(why));
                } else {
                    debug!(operator, timestamp = t, source, %why, "result dropped");
                    self.count(p, Event::Dropped(why));
                }
            }
            Decision::Emit { at, t, p } => self.forward(at, t, p, trigger, cargo),
            Decision::Miss { at, t } => {
                warn!(operator, timestamp = t, why = trigger.as_str(), "message missed");
                self.counts.missed();
                if let Some(story) = self.retire(t) {
                    self.output(t, story.opened, at, Ending::Missed, story.failures);
                }
            }
            Decision::Cancel { t, p, .. } => {
                self.count(p, Event::Cancelled);
                self.close(t, p);
            }
        }
    }

    /// F7: what the core chose is in hand: held, or the result that just came.
    fn forward(&mut self, at: u64, t: u64, p: u64, trigger: Trigger, cargo: &mut Cargo<'_, V, R>) {
        let Some(mut story) = self.retire(t) else { return };
        let held = story.held.iter().position(|held| held.p == p);
        let (arrived, value) = match (held, cargo.take()) {
            (Some(place), _) => {
                let held = story.held.swap_remove(place);
                (held.arrived, held.value)
            }
            (None, Cargo::Value(value)) => {
                self.count(p, Event::Forwarded);
                (at, value)
            }
            (None, Cargo::Nothing | Cargo::Request(_) | Cargo::Reason(_)) => {
                debug_assert!(false, "the core forwards only what came");
                return;
            }
        };
        let Some(lane) = self.lane(p) else { return };
        self.count(p, Event::Output(trigger));
        if let Some(meter) = self.counts.meters.sources.get(lane) {
            meter.output.record(Duration::from_nanos(at.saturating_sub(story.opened)));
        }
        let source = self.lanes[lane].source.clone();
        let arrived = Duration::from_nanos(arrived);
        let forwarded = Forwarded { value, source, arrived, trigger };
        self.output(t, story.opened, at, Ending::Forwarded(forwarded), story.failures);
    }

    /// The message is open no more.
    fn retire(&mut self, t: u64) -> Option<Story<V>> {
        if self.local.skip_answered {
            self.lanes[LOCAL].withdraw(t);
        }
        self.open.remove(&t)
    }

    /// F4: the failure was accepted.
    fn failed(&mut self, t: u64, p: u64, why: &str) {
        let Some(lane) = self.lane(p) else { return };
        self.counts.source(lane, Event::Failed);
        let why = self.counts.reason(lane, why);
        if let Some(story) = self.open.get_mut(&t) {
            story.failures.push(Failure { source: self.lanes[lane].source.clone(), why });
        }
    }

    fn output(
        &mut self,
        timestamp: u64,
        opened: u64,
        decided: u64,
        ending: Ending<V>,
        failures: Vec<Failure>,
    ) {
        let (opened, decided) = (Duration::from_nanos(opened), Duration::from_nanos(decided));
        let item = Item { timestamp, opened, decided, ending, failures };
        self.effects.push_back(Effect::Output(item));
    }

    /// The request's result is no longer wanted. F7: local is never aborted.
    fn close(&mut self, t: u64, p: u64) {
        let Some(lane) = self.lane(p).filter(|lane| *lane != LOCAL) else { return };
        let lane = &mut self.lanes[lane];
        if lane.close(t) {
            let priority = lane.source.priority;
            self.effects.push_back(Effect::Abort { priority, timestamp: t });
        }
    }

    /// A request has ended by itself.
    fn end(&mut self, at: u64, t: u64, p: u16) {
        let Some(lane) = self.lane(p.into()) else { return };
        if let Some(asked) = self.lanes[lane].end(t)
            && let Some(meter) = self.counts.meters.sources.get(lane)
        {
            meter.response.record(Duration::from_nanos(at.saturating_sub(asked)));
        }
    }

    /// Starts what waits and has room.
    fn send(&mut self, now: u64) {
        while let Some(t) = self.lanes[LOCAL].give_up(now) {
            warn!(operator = %self.operator, timestamp = t, "no word of the local computation came");
            self.counts.source(LOCAL, Event::Lost);
        }
        for (i, lane) in self.lanes.iter_mut().enumerate() {
            while let Some(Waiting { t, due, request, .. }) = lane.next(now) {
                let priority = lane.source.priority;
                self.effects.push_back(Effect::Start { priority, timestamp: t, due, request });
            }
            if let Some(meter) = self.counts.meters.sources.get(i) {
                meter.backlog.set(count(lane.backlog()));
                meter.calls.set(count(lane.flying()));
            }
        }
        self.counts.meters.open.set(count(self.open.len()));
    }

    fn count(&self, p: u64, event: Event) {
        if let Some(lane) = self.lane(p) {
            self.counts.source(lane, event);
        }
    }

    fn lane(&self, p: u64) -> Option<usize> {
        self.lanes.iter().position(|lane| u64::from(lane.source.priority) == p)
    }

    fn name(&self, p: u64) -> Option<&str> {
        self.lane(p).map(|lane| &*self.lanes[lane].source.name)
    }
}

impl<V, R> Cargo<'_, V, R> {
    fn take(&mut self) -> Self {
        std::mem::replace(self, Self::Nothing)
    }
}

/// Saturates at 2⁶⁴ − 1 ns, as due instants do (A14).
fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// For gauges; what queues hold is far from 2³².
fn count(len: usize) -> f64 {
    u32::try_from(len).unwrap_or(u32::MAX).into()
}
