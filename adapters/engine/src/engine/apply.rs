//! Carries out the machine's answers: items, calls to start and to abort, counts and logs (D3).
//!
//! This is the private half of [`Engine`], in the order in which an input uses it: the preparation,
//! the firings, the outcomes of results and failures, and the requests that start afterwards.

use std::mem;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_core as core;
use fuseline_core::{Outcome, Priorities};
use fuseline_deadline::End;
use fuseline_traces::{Annotations, DropReason, Input, nanos};
use tracing::{debug, error, info, warn};

use crate::arbiter::{Answer, CLOUDS, drop_reason, offer_refusal, open_refusal};
use crate::counts::CountedEvent;
use crate::effect::{Effect, Hint};
use crate::engine::Engine;
use crate::item::{Ending, Failure, Forwarded, Item, Trigger};
use crate::lineage::{Lineage, StampedValue};
use crate::outage::OutageLine;
use crate::policies::PolicyPanic;
use crate::queue::{AbandonedRequest, Waiting};
use crate::sources::LOCAL;

impl<V, R> Engine<V, R> {
    /// Prepares an input at `at`. Meters the lag of the timer that is due first, and ends the calls
    /// that have lingered long enough.
    pub(super) fn begin(&mut self, at: u64) {
        if let Some(due) = self.arbiter.next_due().filter(|due| *due <= at) {
            self.counts.timer_lag(Duration::from_nanos(at - due));
        }
        while let Some((index, abandoned)) = self.sources.end_lingering(at) {
            self.abandon(at, index, &abandoned);
        }
    }

    /// Returns the deadline of an offer, at most `cap`, or `None` if the policy panics.
    pub(super) fn deadline(
        &mut self,
        at: u64,
        (t, p): (u64, u16),
        cap: Duration,
        backlog: u64,
    ) -> Option<Duration> {
        let budget = self.open_messages.budget(t);
        let cap = budget.map_or(cap, |budget| cap.min(budget.for_cloud(at)));
        let Some(index) = self.sources.cloud(p).filter(|_| !cap.is_zero()) else {
            return Some(cap);
        };
        // A policy is asked only about requests that will be admitted; otherwise it would count
        // probes that were never sent (T6).
        if self.policies.has_policy(index)
            && self.arbiter.offer_refusal((t, p.into()), nanos(cap), backlog).is_some()
        {
            return Some(cap);
        }
        let queue = &self.sources[index];
        let spent = Duration::from_nanos(budget.map_or(0, |budget| budget.spent()));
        let chosen = self.policies.choose(index, (cap, spent), |ages| queue.ages(at, ages));
        let Ok(chosen) = chosen else {
            let (operator, source) = (&*self.operator, self.sources.name(index));
            error!(operator, timestamp = t, source, "the policy panicked, so no request is sent");
            self.counts.source(index, CountedEvent::PolicyFailed);
            return None;
        };
        if let Some(meter) = self.counts.meters(index) {
            meter.chosen(&chosen);
        }
        if self.policies.put_in_force(index, chosen) {
            self.counts.in_force(index, chosen);
        }
        Some(chosen.deadline)
    }

    /// Applies an input, carries out the firings before it (F0), and records everything. Returns
    /// the answer and its instant.
    pub(super) fn decide(&mut self, input: &Input) -> (Answer<CLOUDS>, u64) {
        self.decide_annotated(input, || Annotations::NONE)
    }

    /// Does the same as [`decide`](Self::decide), with further keys of the input. `annotations` is
    /// called only if something is recorded.
    pub(super) fn decide_annotated(
        &mut self,
        input: &Input,
        annotations: impl FnOnce() -> Annotations,
    ) -> (Answer<CLOUDS>, u64) {
        let mut firings = mem::take(&mut self.firings);
        let answer = self.arbiter.apply(input, &mut firings);
        for (at, firing) in firings.drain(..) {
            self.fired(at, &firing);
        }
        self.firings = firings;
        let now = self.arbiter.now();
        if self.recordings.is_any() {
            let commit = self.arbiter.commit();
            self.recordings.record((input, &annotations()), (commit, now), &answer);
        }
        (answer, now)
    }

    /// Returns the instant at which the clock reads `at`, if that is known.
    pub(super) fn instant(&self, at: u64) -> Option<Instant> {
        self.start?.checked_add(Duration::from_nanos(at))
    }

    /// Carries out a firing (F5).
    fn fired(&mut self, at: u64, firing: &core::Firing<CLOUDS>) {
        self.recordings.fired(at, firing);
        let t = firing.timestamp.as_u64();
        for p in firing.timers.iter() {
            let Some(index) = self.sources.index(p.as_u16()) else { continue };
            let (operator, source) = (&*self.operator, self.sources.name(index));
            debug!(operator, timestamp = t, source, "timer fired");
            self.counts.source(index, CountedEvent::Timer);
            self.log_timer(at, index);
            self.close(at, t, index);
        }
        self.settle(at, t, Trigger::Timer, &firing.outcome);
    }

    /// Warns of a failure, unless a failure of this source was logged shortly before (F4).
    pub(super) fn log_failure(&mut self, at: u64, t: u64, index: Option<usize>, why: &str) {
        let line = index.map(|index| self.sources[index].outage.failed(at));
        let (operator, source) = (&*self.operator, index.map(|index| self.sources.name(index)));
        match line {
            Some(None) => debug!(operator, timestamp = t, source, %why, "no result will come"),
            Some(Some(OutageLine { count: 1, .. })) | None => {
                warn!(operator, timestamp = t, source, %why, "no result will come");
            }
            Some(Some(OutageLine { count: requests, lasts })) => {
                let seconds = lasts / 1_000_000_000;
                warn!(operator, source, %why, requests, seconds, "requests still fail");
            }
        }
    }

    /// Warns of a source if many of its timers fired in a row (F5).
    fn log_timer(&mut self, at: u64, index: usize) {
        if let Some(OutageLine { count, lasts }) = self.sources[index].outage.timed_out(at) {
            let (operator, source) = (&*self.operator, self.sources.name(index));
            let seconds = lasts / 1_000_000_000;
            warn!(
                operator,
                source,
                requests = count,
                seconds,
                "no request got its result before it was due"
            );
        }
    }

    /// Logs that a source has a result again after a warning (F3).
    pub(super) fn log_recovery(&mut self, at: u64, index: usize) {
        if let Some(OutageLine { count, lasts }) = self.sources[index].outage.answered(at) {
            let (operator, source) = (&*self.operator, self.sources.name(index));
            let seconds = lasts / 1_000_000_000;
            info!(operator, source, requests = count, seconds, "results arrive again");
        }
    }

    /// Refuses a message (F1).
    pub(super) fn refuse(
        &mut self,
        at: u64,
        t: u64,
        why: core::OpenRefusal,
        lineage: Option<Arc<Lineage>>,
    ) {
        let why = open_refusal(why);
        warn!(operator = &*self.operator, timestamp = t, %why, "message refused");
        self.counts.refused(why);
        let (opened, ending) = (Duration::from_nanos(at), Ending::Refused(why));
        let (decided, failures) = (opened, Vec::new());
        let age = lineage.as_ref().and_then(|lineage| lineage.age(self.instant(at)?));
        let item = Item {
            timestamp: t,
            opened,
            decided,
            revision: 0,
            ending,
            failures,
            lineage,
            age,
            substitute: None,
            carried: None,
        };
        self.effects.push(Effect::Output(item));
    }

    /// Warns once if the timer of one cloud will end the wait for a better one (A4).
    pub(super) fn notice_eager(&mut self, t: u64, index: usize, due: u64) {
        let p = self.sources[index].source.priority;
        let Some((earlier, better)) = self.eager_notice.admitted(t, p, due) else { return };
        let name = |p| self.sources.index(p).map(|index| self.sources.name(index));
        let (operator, earlier, better) = (&*self.operator, name(earlier), name(better));
        warn!(
            operator,
            earlier,
            better,
            "under eager, the earlier deadline of a lower cloud ends the wait for a better one \
             (A4): give the lower cloud the same or a later deadline, or commit patient"
        );
    }

    /// Notes that a request was refused (F2).
    pub(super) fn refuse_offer(&self, t: u64, index: Option<usize>, why: core::OfferRefusal) {
        let why = offer_refusal(why);
        let source = index.map(|index| self.sources.name(index));
        debug!(operator = &*self.operator, timestamp = t, source, %why, "request refused");
        if let Some(index) = index {
            self.counts.source(index, CountedEvent::Refused(why));
        }
    }

    /// Carries out the outcome of a result (F3).
    pub(super) fn settle_result(
        &mut self,
        at: u64,
        (t, p): (u64, u16),
        outcome: &Outcome<CLOUDS>,
        value: StampedValue<V>,
    ) {
        let Some(index) = self.sources.index(p) else { return };
        let (operator, source) = (&*self.operator, self.sources.name(index));
        match outcome {
            Outcome::Dropped(why) => {
                let why = drop_reason(*why);
                debug!(operator, timestamp = t, source, %why, "result dropped");
                self.counts.source(index, CountedEvent::Dropped(why));
                self.hint(at, t, index, value.value, why);
            }
            Outcome::Held => {
                debug!(operator, timestamp = t, source, "result held");
                self.counts.source(index, CountedEvent::Held);
                self.open_messages.hold(t, p, at, value);
            }
            Outcome::Preliminary { .. } => {
                self.counts.source(index, CountedEvent::Preliminary);
                self.open_messages.hold(t, p, at, value);
                self.settle(at, t, Trigger::Arrival, outcome);
            }
            Outcome::Forwarded { .. } => {
                self.counts.source(index, CountedEvent::Forwarded);
                // The result is now the best available one, which is what `settle` sends.
                self.open_messages.hold(t, p, at, value);
                self.settle(at, t, Trigger::Arrival, outcome);
            }
            Outcome::Waiting | Outcome::Final { .. } | Outcome::Missed => {
                self.settle(at, t, Trigger::Arrival, outcome);
            }
        }
    }

    /// Carries out the outcome of a failure, with the reason `why` (F4).
    pub(super) fn settle_failure(
        &mut self,
        at: u64,
        (t, p): (u64, u16),
        outcome: &Outcome<CLOUDS>,
        why: &str,
    ) {
        let Some(index) = self.sources.index(p) else { return };
        if let Outcome::Dropped(why) = outcome {
            let (operator, why) = (&*self.operator, drop_reason(*why));
            let source = self.sources.name(index);
            debug!(operator, timestamp = t, source, %why, "failure dropped");
            self.counts.source(index, CountedEvent::FailureDropped(why));
            return;
        }
        self.counts.source(index, CountedEvent::Failed);
        let why = self.counts.reason(index, why);
        if let Some(open_message) = self.open_messages.find(t) {
            let source = self.sources[index].source.clone();
            open_message.failures.push(Failure { source, why });
        }
        self.settle(at, t, Trigger::Failure, outcome);
    }

    /// Sends an item, reports a miss, or waits (F6, F7, F9).
    fn settle(&mut self, at: u64, t: u64, trigger: Trigger, outcome: &Outcome<CLOUDS>) {
        match outcome {
            Outcome::Dropped(_) | Outcome::Held | Outcome::Waiting => {}
            Outcome::Preliminary { cancelled, .. } => {
                if let Some((_, forwarded)) = self.take_best(at, t, trigger) {
                    self.output(at, t, Ending::Preliminary(forwarded));
                }
                self.cancel(at, t, cancelled);
            }
            Outcome::Forwarded { cancelled, .. } => {
                if let Some((index, forwarded)) = self.take_best(at, t, trigger) {
                    self.counts.source(index, CountedEvent::Output(trigger));
                    self.output(at, t, Ending::Forwarded(forwarded));
                }
                self.cancel(at, t, cancelled);
            }
            Outcome::Final { by } => {
                let Some(index) = self.sources.index(by.as_u16()) else { return };
                self.counts.source(index, CountedEvent::Final);
                self.output(at, t, Ending::Final(self.sources[index].source.clone()));
            }
            Outcome::Missed => {
                let why = trigger.as_str();
                warn!(operator = &*self.operator, timestamp = t, why, "message missed");
                self.counts.missed();
                self.output(at, t, Ending::Missed);
            }
        }
    }

    /// Removes the best available result to send it. Returns it with its source's index.
    fn take_best(&mut self, at: u64, t: u64, trigger: Trigger) -> Option<(usize, Forwarded<V>)> {
        let message = self.open_messages.find(t)?;
        let (held, opened) = (message.held.take()?, message.opened);
        let index = self.sources.index(held.p)?;
        if let Some(meter) = self.counts.meters(index) {
            meter.output.record(since(opened, at));
        }
        let source = self.sources[index].source.clone();
        let arrived = Duration::from_nanos(held.arrived);
        let StampedValue { value, of, meant_for } = held.value;
        Some((index, Forwarded { value, source, arrived, trigger, of, meant_for }))
    }

    /// Closes the requests that an output cancels (F7, F9).
    fn cancel(&mut self, at: u64, t: u64, cancelled: &Priorities<CLOUDS>) {
        for p in cancelled.iter() {
            let Some(index) = self.sources.index(p.as_u16()) else { continue };
            self.counts.source(index, CountedEvent::Cancelled);
            self.close(at, t, index);
        }
    }

    /// Outputs an item of an accepted message. After its last item the message is no longer open
    /// (D1).
    fn output(&mut self, at: u64, t: u64, ending: Ending<V>) {
        if self.local.skip_answered {
            self.sources[LOCAL].withdraw(t);
        }
        let instant = self.instant(at);
        let Some(item) = self.open_messages.item(t, (at, instant), ending) else { return };
        if let Some(latency) = self.latency.as_ref().filter(|_| item.is_last()) {
            latency.record(item.latency());
        }
        self.effects.push(Effect::Output(item));
    }

    /// Passes on a result that came too late for its message but may help with later ones.
    fn hint(&mut self, at: u64, timestamp: u64, index: usize, value: V, why: DropReason) {
        if !matches!(why, DropReason::Late | DropReason::Superseded) {
            return;
        }
        if let Some(opened) = self.open_messages.opened(timestamp) {
            let (source, age) = (self.sources[index].source.clone(), since(opened, at));
            self.effects.push(Effect::Hint(Hint { timestamp, source, value, age, why }));
        }
    }

    /// Notes that a request ended by itself, perhaps before it was sent. Returns the time since it
    /// was sent, if it was.
    pub(super) fn ended(
        &mut self,
        at: u64,
        t: u64,
        index: usize,
        end: fn(Duration) -> End,
    ) -> Option<Duration> {
        let request = self.sources[index].end(t)?;
        let age = since(request.requested_at, at);
        if let Some(meter) = self.counts.meters(index) {
            meter.response.record(age);
        }
        self.report_end(index, end(age.saturating_add(Duration::from_nanos(request.spent))));
        Some(since(request.begun_at?, at))
    }

    /// Closes a request whose result is no longer wanted. Local is never aborted (F7).
    fn close(&mut self, at: u64, t: u64, index: usize) {
        if index != LOCAL
            && let Some(abandoned) = self.sources[index].close(t)
        {
            self.abandon(at, index, &abandoned);
        }
    }

    /// Abandons a request that nothing waits for any more. Its call is aborted if it was sent.
    fn abandon(&mut self, at: u64, index: usize, abandoned: &AbandonedRequest) {
        let AbandonedRequest { t: timestamp, requested_at, spent, was_sent } = *abandoned;
        if was_sent {
            let priority = self.sources[index].source.priority;
            self.effects.push(Effect::Abort { priority, timestamp });
        }
        let age = since(requested_at, at).saturating_add(Duration::from_nanos(spent));
        self.report_end(index, End::Censored(age));
    }

    /// Reports to the policy how a request ended.
    fn report_end(&mut self, index: usize, end: End) {
        if let Err(PolicyPanic) = self.policies.ended(index, end) {
            let (operator, source) = (&*self.operator, self.sources.name(index));
            error!(operator, source, ?end, "the policy panicked");
            self.counts.source(index, CountedEvent::PolicyFailed);
        }
    }

    /// Counts and reports computations that have not ended in time (D13).
    fn lose(&mut self, now: u64) {
        if self.sources.next_lost().is_none_or(|lost| lost > now) {
            return;
        }
        let operator = &*self.operator;
        if self.local.may_lose_results {
            while let Some(t) = self.sources[LOCAL].remove_lost(now) {
                warn!(
                    operator,
                    timestamp = t,
                    "the local computation did not end in time and is counted as lost"
                );
                self.counts.source(LOCAL, CountedEvent::Lost);
            }
            return;
        }
        while let Some((timestamp, is_replaced)) = self.sources[LOCAL].mark_overrun(now) {
            self.counts.source(LOCAL, CountedEvent::Lost);
            if is_replaced {
                warn!(
                    operator,
                    timestamp,
                    "local exceeded its deadline and is counted as lost: another worker replaces it"
                );
                self.effects.push(Effect::Replace { timestamp });
            } else {
                warn!(
                    operator,
                    timestamp,
                    "local exceeded its deadline and is counted as lost: it occupies its worker until it ends"
                );
            }
        }
    }

    /// Starts what waits while there is room, and updates the gauges.
    pub(super) fn start_waiting(&mut self, now: u64) {
        self.lose(now);
        for index in self.sources.changed() {
            self.start(now, index);
        }
        if self.open_messages.len() != self.shown_open {
            self.shown_open = self.open_messages.len();
            self.counts.open.set(count(self.shown_open));
        }
    }

    /// Sends an admitted request now, or lets it wait.
    pub(super) fn admit(&mut self, now: u64, index: usize, request: Waiting<R>) {
        // Lost computations first give up their places. If another queue has changed, the request
        // waits, so that all requests start in the order of the sources.
        self.lose(now);
        let is_settled = self.sources.is_settled();
        let queue = &mut self.sources[index];
        if !is_settled {
            queue.push(request);
        } else if let Some(request) = queue.admit(now, request) {
            self.effects.push(queue.start(request));
        }
    }

    fn start(&mut self, now: u64, index: usize) {
        let queue = &mut self.sources[index];
        while let Some(request) = queue.next(now) {
            self.effects.push(queue.start(request));
        }
        let shown = queue.to_show();
        if shown != queue.shown {
            queue.shown = shown;
            if let Some(meter) = self.counts.meters(index) {
                meter.backlog.set(shown.0);
                meter.calls.set(shown.1);
            }
        }
        self.sources.settle(index);
    }
}

fn since(then: u64, at: u64) -> Duration {
    Duration::from_nanos(at.saturating_sub(then))
}

/// Converts a length for a gauge. Queues hold far fewer than 2³² requests.
fn count(len: usize) -> f64 {
    u32::try_from(len).unwrap_or(u32::MAX).into()
}
