//! All of an operator but its machine: carries out what the machine decides (D3).

use std::collections::VecDeque;
use std::mem;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use fuseline_core as core;
use fuseline_core::Outcome;
use fuseline_deadline::{End, Situation};
use fuseline_traces::{Decision, DropReason, Input};
use tracing::{debug, error, warn};

use crate::arbiter::{Answer, decisions_of, drop_reason, offer_refusal, open_refusal};
use crate::counts::Counts;
use crate::effect::{Effect, Hint, Local};
use crate::event::Event;
use crate::item::{Ending, Failure, Forwarded, Item, Source, Trigger};
use crate::open_message::OpenMessages;
use crate::queue::{AbandonedRequest, SourceQueue, Waiting};
use crate::tally::CurrentDeadline;
use crate::writer::TraceWriter;

/// The place of local's lane.
pub(crate) const LOCAL: usize = 0;

/// The values it holds, the queues to its sources, its counts and its recordings.
pub(crate) struct OperatorState<V, R> {
    pub(crate) operator: Arc<str>,
    /// Local's, then the clouds' in the header's order.
    pub(crate) queues: Vec<SourceQueue<R>>,
    pub(crate) local: Local,
    pub(crate) open_messages: OpenMessages<V>,
    pub(crate) counts: Arc<Counts>,
    pub(crate) effects: VecDeque<Effect<V, R>>,
    pub(crate) writers: Vec<TraceWriter>,
    /// The decisions of the input at hand, for the tapes.
    decisions: Vec<Decision>,
    /// Ages of requests, for policies.
    ages: Vec<Duration>,
    open_shown: usize,
}

impl<V, R> OperatorState<V, R> {
    pub(crate) fn new(operator: Arc<str>, queues: Vec<SourceQueue<R>>, local: Local) -> Self {
        let sources: Vec<Source> = queues.iter().map(|queue| queue.source.clone()).collect();
        let counts = Arc::new(Counts::new(&operator, &sources));
        Self {
            operator,
            queues,
            local,
            open_messages: OpenMessages::new(),
            counts,
            effects: VecDeque::new(),
            writers: Vec::new(),
            decisions: Vec::new(),
            ages: Vec::new(),
            open_shown: 0,
        }
    }

    /// The index of the lane of priority `p`.
    pub(crate) fn place(&self, p: u16) -> Option<usize> {
        self.queues.iter().position(|queue| queue.source.priority == p)
    }

    /// Records an input, what fired before it, and its answer.
    pub(crate) fn record<const CLOUDS: usize>(
        &mut self,
        input: &Input,
        now: u64,
        answer: &Answer<CLOUDS>,
    ) {
        if self.writers.is_empty() {
            return;
        }
        answer.decisions(now, |decision| self.decisions.push(decision));
        for writer in &mut self.writers {
            writer.record(input, &self.decisions);
        }
        self.decisions.clear();
    }

    /// F5: timers fired.
    pub(crate) fn fired<const CLOUDS: usize>(&mut self, at: u64, firing: &core::Firing<CLOUDS>) {
        if !self.writers.is_empty() {
            decisions_of(at, firing, |decision| self.decisions.push(decision));
        }
        let t = firing.timestamp.as_u64();
        for p in firing.timers.iter() {
            let Some(place) = self.place(p.as_u16()) else { continue };
            debug!(
                operator = &*self.operator,
                timestamp = t,
                source = self.name(place),
                "timer fired"
            );
            self.counts.source(place, Event::Timer);
            self.close(at, t, place);
        }
        self.settle(at, t, Trigger::Timer, &firing.outcome);
    }

    /// F1: the message was not taken on.
    pub(crate) fn refuse(&mut self, at: u64, t: u64, why: core::OpenRefusal) {
        let why = open_refusal(why);
        warn!(operator = &*self.operator, timestamp = t, %why, "message refused");
        self.counts.refused(why);
        self.output(t, at, at, Ending::Refused(why), Vec::new());
    }

    /// F2: the request was refused.
    pub(crate) fn refuse_offer(&self, t: u64, place: Option<usize>, why: core::OfferRefusal) {
        let why = offer_refusal(why);
        let source = place.map(|place| self.name(place));
        debug!(operator = &*self.operator, timestamp = t, source, %why, "request refused");
        if let Some(place) = place {
            self.counts.source(place, Event::Refused(why));
        }
    }

    /// F3: what became of a result.
    pub(crate) fn result<const CLOUDS: usize>(
        &mut self,
        at: u64,
        (t, p): (u64, u16),
        outcome: &Outcome<CLOUDS>,
        value: V,
    ) {
        let Some(place) = self.place(p) else { return };
        let (operator, source) = (&*self.operator, self.name(place));
        match outcome {
            Outcome::Dropped(why) => {
                let why = drop_reason(*why);
                debug!(operator, timestamp = t, source, %why, "result dropped");
                self.counts.source(place, Event::Dropped(why));
                self.hint(at, t, place, value, why);
            }
            Outcome::Held => {
                debug!(operator, timestamp = t, source, "result held");
                self.counts.source(place, Event::Held);
                self.open_messages.hold(t, p, at, value);
            }
            Outcome::Forwarded { .. } => {
                self.counts.source(place, Event::Forwarded);
                // It is the best available now, which is what is sent.
                self.open_messages.hold(t, p, at, value);
                self.settle(at, t, Trigger::Arrival, outcome);
            }
            Outcome::Waiting | Outcome::Missed => self.settle(at, t, Trigger::Arrival, outcome),
        }
    }

    /// F4: what became of a failure; `why` in words.
    pub(crate) fn failed<const CLOUDS: usize>(
        &mut self,
        at: u64,
        (t, p): (u64, u16),
        outcome: &Outcome<CLOUDS>,
        why: &str,
    ) {
        let Some(place) = self.place(p) else { return };
        if let Outcome::Dropped(why) = outcome {
            let (operator, source, why) = (&*self.operator, self.name(place), drop_reason(*why));
            debug!(operator, timestamp = t, source, %why, "failure dropped");
            self.counts.source(place, Event::FailureDropped(why));
            return;
        }
        self.counts.source(place, Event::Failed);
        let why = self.counts.reason(place, why);
        if let Some(open_message) = self.open_messages.find(t) {
            open_message.failures.push(Failure { source: self.queues[place].source.clone(), why });
        }
        self.settle(at, t, Trigger::Failure, outcome);
    }

    /// F6, F7: the message is answered, missed, or waits.
    fn settle<const CLOUDS: usize>(
        &mut self,
        at: u64,
        t: u64,
        trigger: Trigger,
        outcome: &Outcome<CLOUDS>,
    ) {
        match outcome {
            Outcome::Dropped(_) | Outcome::Held | Outcome::Waiting => {}
            Outcome::Missed => self.retire(at, t, trigger),
            Outcome::Forwarded { cancelled, .. } => {
                self.retire(at, t, trigger);
                for p in cancelled.iter() {
                    let Some(place) = self.place(p.as_u16()) else { continue };
                    self.counts.source(place, Event::Cancelled);
                    self.close(at, t, place);
                }
            }
        }
    }

    /// The message is no longer open: the best available result is sent, if there is any.
    fn retire(&mut self, at: u64, t: u64, trigger: Trigger) {
        if self.local.skip_answered {
            self.queues[LOCAL].withdraw(t);
        }
        let Some(open_message) = self.open_messages.close(t) else { return };
        let Some(held) = open_message.held else {
            let why = trigger.as_str();
            warn!(operator = &*self.operator, timestamp = t, why, "message missed");
            self.counts.missed();
            self.output(t, open_message.opened, at, Ending::Missed, open_message.failures);
            return;
        };
        let Some(place) = self.place(held.p) else { return };
        self.counts.source(place, Event::Output(trigger));
        if let Some(meter) = self.counts.meters.sources.get(place) {
            meter.output.record(Duration::from_nanos(at.saturating_sub(open_message.opened)));
        }
        let source = self.queues[place].source.clone();
        let arrived = Duration::from_nanos(held.arrived);
        let forwarded = Forwarded { value: held.value, source, arrived, trigger };
        self.output(
            t,
            open_message.opened,
            at,
            Ending::Forwarded(forwarded),
            open_message.failures,
        );
    }

    /// D1 one item: the only way out for a message that was taken in.
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

    /// A result that came too late may still be of use.
    fn hint(&mut self, at: u64, timestamp: u64, place: usize, value: V, why: DropReason) {
        if !matches!(why, DropReason::Late | DropReason::Superseded) {
            return;
        }
        if let Some(opened) = self.open_messages.opened(timestamp) {
            let (source, age) = (self.queues[place].source.clone(), since(opened, at));
            self.effects.push_back(Effect::Hint(Hint { timestamp, source, value, age, why }));
        }
    }

    /// The deadline of an offer, at most `cap`; none if the policy panics.
    pub(crate) fn deadline(
        &mut self,
        at: u64,
        t: u64,
        place: usize,
        situation: Situation<'static>,
        cap: Duration,
    ) -> Option<Duration> {
        let queue = &mut self.queues[place];
        let mut ages = mem::take(&mut self.ages);
        queue.ages(at, &mut ages);
        let chosen = match &mut queue.policy {
            None => Some(CurrentDeadline { deadline: cap, reason: None }),
            Some(policy) => {
                let situation = Situation { under_way: &ages, ..situation };
                catch_unwind(AssertUnwindSafe(|| policy.decide(&situation, cap).into())).ok()
            }
        };
        self.ages = ages;
        let Some(chosen) = chosen else {
            let source = self.name(place);
            error!(
                operator = &*self.operator,
                timestamp = t,
                source,
                "the policy panicked: nothing is asked"
            );
            return None;
        };
        // The cap holds for a policy too: what is shown is what the request gets.
        let chosen = CurrentDeadline { deadline: chosen.deadline.min(cap), ..chosen };
        if let Some(meter) = self.counts.meters.sources.get(place) {
            meter.chosen(&chosen);
        }
        let queue = &mut self.queues[place];
        if queue.in_force != Some(chosen) {
            queue.in_force = Some(chosen);
            self.counts.in_force(place, chosen);
        }
        Some(chosen.deadline)
    }

    /// A request has ended by itself, perhaps before it was sent.
    pub(crate) fn ended(&mut self, at: u64, t: u64, place: usize, end: fn(Duration) -> End) {
        let Some(requested_at) = self.queues[place].end(t) else { return };
        if let Some(meter) = self.counts.meters.sources.get(place) {
            meter.response.record(since(requested_at, at));
        }
        self.tell(place, end(since(requested_at, at)));
    }

    /// The request's result is no longer wanted. F7: local is never aborted.
    fn close(&mut self, at: u64, t: u64, place: usize) {
        if place != LOCAL
            && let Some(given_up) = self.queues[place].close(t)
        {
            self.give_up(at, place, &given_up);
        }
    }

    /// Ends the calls that have lingered long enough by `at`.
    pub(crate) fn lapse(&mut self, at: u64) {
        for place in 0..self.queues.len() {
            while let Some(given_up) = self.queues[place].lapse(at) {
                self.give_up(at, place, &given_up);
            }
        }
    }

    fn give_up(&mut self, at: u64, place: usize, given_up: &AbandonedRequest) {
        let AbandonedRequest { t: timestamp, requested_at, was_sent } = *given_up;
        if was_sent {
            let priority = self.queues[place].source.priority;
            self.effects.push_back(Effect::Abort { priority, timestamp });
        }
        self.tell(place, End::Censored(since(requested_at, at)));
    }

    /// Reports to the policy how a call ended.
    fn tell(&mut self, place: usize, end: End) {
        let Some(policy) = &mut self.queues[place].policy else { return };
        if catch_unwind(AssertUnwindSafe(|| policy.ended(end))).is_err() {
            error!(
                operator = &*self.operator,
                source = self.name(place),
                ?end,
                "the policy panicked"
            );
        }
    }

    /// Starts what waits while there is room, and updates the gauges.
    pub(crate) fn send(&mut self, now: u64) {
        if self.local.lossy {
            while let Some(t) = self.queues[LOCAL].give_up(now) {
                warn!(operator = %self.operator, timestamp = t, "no word of the local computation came");
                self.counts.source(LOCAL, Event::Lost);
            }
        }
        for (place, queue) in self.queues.iter_mut().enumerate() {
            while let Some(Waiting { t, due, request, .. }) = queue.next(now) {
                let until = due.map(|due| due.saturating_add(queue.linger));
                let priority = queue.source.priority;
                self.effects.push_back(Effect::Start { priority, timestamp: t, until, request });
            }
            let shown = (queue.backlog(), queue.in_flight());
            if shown != queue.shown {
                queue.shown = shown;
                if let Some(meter) = self.counts.meters.sources.get(place) {
                    meter.backlog.set(count(shown.0));
                    meter.calls.set(count(shown.1));
                }
            }
        }
        if self.open_messages.len() != self.open_shown {
            self.open_shown = self.open_messages.len();
            self.counts.meters.open.set(count(self.open_shown));
        }
    }

    pub(crate) fn name(&self, place: usize) -> &str {
        &self.queues[place].source.name
    }
}

fn since(then: u64, at: u64) -> Duration {
    Duration::from_nanos(at.saturating_sub(then))
}

/// For gauges; queues hold far fewer than 2³².
fn count(len: usize) -> f64 {
    u32::try_from(len).unwrap_or(u32::MAX).into()
}
