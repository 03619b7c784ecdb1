//! The statistics: the outcome of each message and of each request, read from a trace.
//!
//! The tables of `fuseline run` and the page of `fuseline report` show these statistics and no
//! others, under the names in [`COLUMNS`].

mod history;
mod sums;
#[cfg(test)]
mod tests;

use std::time::Duration;

use fuseline_traces::{Commit, Decision, DropReason, Event, Input};

use crate::quantile::{ArrivalTime, Quantile};
use crate::statistics::history::{
    CallEnd, OutcomeColumn, RequestEnd, RequestHistory, TimestampHistory,
};
use crate::statistics::sums::MessageSums;
use crate::timestamp_map::TimestampMap;

/// The counts of a source's requests, each with its meaning. Local has a request for each accepted
/// message. The first count is the sum of the next six.
pub const COLUMNS: [(&str, &str); 8] = [
    ("requests", "offers admitted (F2); local's are the messages taken on (F1)"),
    ("forwarded", "its result went downstream (F7)"),
    ("discarded", "its result came in time and was held; another source's was forwarded (F7)"),
    ("late", "its timer fired before a result came (F5)"),
    ("failed", "its failure was accepted (F4)"),
    (
        "superseded",
        "it was pending when another source's result was forwarded: a cloud's call is cancelled \
         then, local's goes on (F7)",
    ),
    ("open", "pending, or its result held, as the trace ends"),
    ("refused", "offers refused; they are no requests (F2)"),
];

/// Collects the statistics of a trace, line by line.
///
/// Each request has exactly one fate, so a row adds up whatever the trace contains. If an observed
/// trace lacks the line of a decision, the request's own lines decide: a result was in time if it
/// came before its due instant and before its message's end.
pub struct TraceStatistics {
    /// The priorities of local, of the clouds, and of unknown sources that a trace requests or
    /// forwards against the rules, in this order.
    priorities: Vec<u64>,
    /// The number of these sources that are local or a registered cloud.
    known: usize,
    /// `true` if lines of decisions may be missing.
    is_observed: bool,
    /// `true` if a `final` ends a timestamp that had an output (F9).
    has_finals: bool,
    /// The refused offers, by source.
    refused: Vec<u64>,
    /// The number of refused opens.
    turned_away: u64,
    stories: TimestampMap<TimestampHistory>,
    timer_lag: Option<Duration>,
}

/// The totals of a trace.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Totals {
    /// The messages that came: forwarded, missed, refused or open.
    pub messages: u64,
    /// The messages with a result that went downstream (F7).
    pub forwarded: u64,
    /// The messages that were retired without a result, because nothing came in time (F6).
    pub missed: u64,
    /// The refused opens (F1).
    pub refused: u64,
    /// The messages that are open when the trace ends.
    pub open: u64,
    /// The response times that 50, 90 and 99 % of all messages that ended do not exceed.
    pub response: [Option<Quantile>; 3],
    /// The rows of local and then of the clouds, in the order given.
    pub rows: Vec<RequestRow>,
}

/// The counts of one source's requests.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RequestRow {
    /// Its priority; local's is 0.
    pub p: u64,
    /// The counts, in the order of [`COLUMNS`].
    pub counts: [u64; 8],
    /// The response times of the messages that its results answered.
    pub response: [Option<Quantile>; 3],
}

/// One message: when each source's result came, and which one was forwarded.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MessageRecord {
    /// The arrivals by source. Local is source 0.
    pub arrivals: Vec<ArrivalTime>,
    /// `None` if the message was missed, or refused for a full window.
    pub forwarded: Option<ForwardedOutput>,
}

/// The output for a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ForwardedOutput {
    /// The source of the result, by its index in [`MessageRecord::arrivals`].
    pub source: usize,
    /// The time from the message to its output.
    pub response: Duration,
}

/// The outcome of a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum TimestampOutcome {
    /// A result went downstream.
    Forwarded {
        /// The priority of the source.
        p: u64,
    },
    /// It was retired without a result.
    Missed,
    /// It is open when the trace ends.
    Open,
    /// Its open was refused, or it has none.
    Unopened,
}

impl MessageRecord {
    /// Returns `true` if some cloud that got a request sent neither a result nor a failure before
    /// the deadline, or `None` if that is not known.
    #[must_use]
    pub fn is_in_outage(&self, deadline: Duration) -> Option<bool> {
        let clouds = || self.arrivals.iter().skip(1);
        let is_lost = clouds().any(|arrival| match *arrival {
            ArrivalTime::At(at) | ArrivalTime::After(at) | ArrivalTime::Failed(at) => {
                at >= deadline
            }
            ArrivalTime::Never => true,
        });
        let is_known = is_lost || !clouds().any(|arrival| matches!(arrival, ArrivalTime::After(_)));
        is_known.then_some(is_lost)
    }
}

impl RequestRow {
    /// Returns the number of admitted offers. For local it is the number of accepted messages.
    #[must_use]
    pub const fn requests(&self) -> u64 {
        self.counts[0]
    }

    /// Returns the number of refused offers.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.counts[7]
    }

    /// Returns the number of requests whose results came in time.
    #[must_use]
    pub const fn answered(&self) -> u64 {
        self.forwarded() + self.counts[OutcomeColumn::Discarded as usize]
    }

    /// Returns the number of requests that ran to their deadlines or failed.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.counts[OutcomeColumn::Late as usize] + self.counts[OutcomeColumn::Failed as usize]
    }

    /// Returns the number of results that went downstream.
    #[must_use]
    pub const fn forwarded(&self) -> u64 {
        self.counts[OutcomeColumn::Forwarded as usize]
    }
}

impl TraceStatistics {
    /// Creates empty statistics for clouds of these priorities.
    pub fn new(clouds: impl IntoIterator<Item = u16>, commit: Commit, is_observed: bool) -> Self {
        let priorities: Vec<u64> =
            [0].into_iter().chain(clouds.into_iter().map(u64::from)).collect();
        let known = priorities.len();
        Self {
            refused: vec![0; known],
            priorities,
            known,
            is_observed,
            // In an observed trace, a `final` may be missing.
            has_finals: commit == Commit::Progressive && !is_observed,
            turned_away: 0,
            stories: TimestampMap::default(),
            timer_lag: None,
        }
    }

    /// Takes the next line of the trace.
    pub fn event(&mut self, event: &Event) {
        match event {
            Event::Input(input) => self.input(input),
            Event::Decision(decision) => self.decision(decision),
        }
    }

    fn input(&mut self, input: &Input) {
        match *input {
            Input::Open { at, t, deadline } => {
                let story = self.story(t);
                // No refusal came in between.
                story.accept();
                story.offered = Some(at);
                if story.opened.is_none() {
                    story.call(0).due = deadline.map(|deadline| at.saturating_add(deadline));
                }
            }
            Input::Offer { .. } | Input::Tick { .. } => {}
            Input::Result { at, t, p } => self.with(t, p, |call| {
                call.settle();
                call.arrived.get_or_insert(at);
                call.answered.get_or_insert(at);
            }),
            Input::Fail { at, t, p } => self.with(t, p, |call| {
                call.settle();
                call.failing = Some(at);
            }),
        }
    }

    fn decision(&mut self, decision: &Decision) {
        match *decision {
            Decision::Timer { at, t, p } => {
                let mut due = None;
                self.with(t, p, |call| {
                    due = call.due;
                    call.end_with(RequestEnd::Late, at);
                });
                let lag = due.map(|due| Duration::from_nanos(at.saturating_sub(due)));
                self.timer_lag = self.timer_lag.max(lag);
            }
            Decision::RefuseOpen { t, .. } => {
                self.turned_away += 1;
                if let Some(story) = self.stories.get_mut(t) {
                    story.offered = None;
                }
            }
            Decision::RefuseOffer { p, .. } => {
                if let Some(source) = self.source(p) {
                    self.refused[source] += 1;
                }
            }
            Decision::Request { t, p, due, .. } => self.with_any(t, p, |call| {
                call.is_requested = true;
                call.due = Some(due);
            }),
            Decision::Hold { at, t, p } => {
                self.with(t, p, |call| call.end_with(RequestEnd::InTime, at));
            }
            Decision::Drop { at, t, p, why } => self.with(t, p, |call| {
                let was_result = call.failing.take().is_none();
                call.answered = None;
                if was_result && why == DropReason::Late {
                    call.end_with(RequestEnd::Late, at);
                }
            }),
            Decision::Emit { at, t, p } => {
                self.with_any(t, p, |call| {
                    call.is_requested = true;
                    call.end_with(RequestEnd::InTime, at);
                });
                let (source, has_finals) = (self.source(p), self.has_finals);
                let Self { stories, priorities, .. } = self;
                let story = stories.or_insert_with(t, TimestampHistory::default);
                let last = if has_finals { &mut story.output } else { &mut story.end };
                let last_p = last.and_then(|last| priorities.get(last.source?));
                // Under progressive, a better output takes its place.
                if last.is_none() || last_p.is_some_and(|last_p| *last_p < p) {
                    *last = Some(CallEnd { at, source });
                }
            }
            Decision::Final { t, .. } => {
                let story = self.story(t);
                story.end = story.end.or(story.output);
            }
            Decision::Miss { at, t } => {
                let story = self.story(t);
                story.end.get_or_insert(CallEnd { at, source: None });
            }
            Decision::Cancel { at, t, p } => {
                self.with(t, p, |call| call.end_with(RequestEnd::Superseded, at));
            }
        }
    }

    /// Returns the longest time after its due instant at which a timer was served, or `None` if no
    /// timer fired.
    #[must_use]
    pub const fn timer_lag(&self) -> Option<Duration> {
        self.timer_lag
    }

    /// Returns the outcome of a timestamp.
    #[must_use]
    pub fn outcome(&self, t: u64) -> TimestampOutcome {
        let story = self.stories.get(t);
        story.map_or(TimestampOutcome::Unopened, |story| outcome(story, &self.priorities))
    }

    /// Returns the outcome of a request as its index in [`COLUMNS`], or `None` if there was no
    /// request.
    #[must_use]
    pub fn request_outcome(&self, t: u64, p: u64) -> Option<usize> {
        let story = self.stories.get(t).filter(|story| story.is_message())?;
        Some(story.request_outcome(self.source(p)?, self.is_observed)? as usize)
    }

    /// Returns the totals of the trace.
    #[must_use]
    pub fn totals(&self) -> Totals {
        let sums = self.sums();
        let row = |(source, p): (usize, &u64)| {
            let mut counts = sums.rows.get(source).copied().unwrap_or_default();
            counts[7] = self.refused.get(source).copied().unwrap_or_default();
            RequestRow { p: *p, counts, response: sums.response_of(source) }
        };
        let rows = self.priorities.iter().enumerate().map(row).collect();
        let MessageSums { forwarded, missed, open, .. } = sums;
        Totals {
            messages: forwarded + missed + open + self.turned_away,
            forwarded,
            missed,
            refused: self.turned_away,
            open,
            response: sums.response_of_all(missed + self.turned_away),
            rows,
        }
    }

    fn sums(&self) -> MessageSums {
        let mut sums = MessageSums::default();
        for (_, story) in self.stories.iter() {
            sums.add(story, &story.fates(self.priorities.len(), self.is_observed));
        }
        sums
    }

    /// Returns the messages that ended, each with the arrivals from the known sources, for the
    /// policies.
    ///
    /// A refused message went to no source. If a call was ended before its result,
    /// `planned(source, opened, t)` returns when the result would have come, counted from the
    /// message's instant, if it can.
    pub fn messages(
        &self,
        planned: impl Fn(usize, u64, u64) -> Option<ArrivalTime>,
    ) -> Vec<MessageRecord> {
        let ended = |(t, story): (u64, &TimestampHistory)| {
            if story.begin().is_some() && story.end.is_none() {
                return None;
            }
            let arrivals = (0..self.known).map(|source| {
                let opened = story.begin().filter(|_| story.is_requested(source));
                // Nobody waits for a request that was refused, so it counts as failed at once.
                let Some(opened) = opened else { return ArrivalTime::Failed(Duration::ZERO) };
                let call = story.calls.get(source).copied().unwrap_or_default();
                let bound = call.ended.map(|(_, at)| at).or(story.end.map(|end| end.at));
                let since = |at: u64| Duration::from_nanos(at.saturating_sub(opened));
                match (call.arrived, story.request_outcome(source, self.is_observed)) {
                    (Some(arrived), _) => ArrivalTime::At(since(arrived)),
                    (None, Some(OutcomeColumn::Failed)) => {
                        ArrivalTime::Failed(since(call.failing.or(bound).unwrap_or(opened)))
                    }
                    (None, _) => planned(source, opened, t)
                        .unwrap_or(ArrivalTime::After(since(bound.unwrap_or(opened)))),
                }
            });
            let forwarded = story.end.and_then(|end| {
                Some(ForwardedOutput { source: end.source?, response: story.response(end)? })
            });
            Some(MessageRecord { arrivals: arrivals.collect(), forwarded })
        };
        self.stories.iter().filter_map(ended).collect()
    }

    fn story(&mut self, t: u64) -> &mut TimestampHistory {
        self.stories.or_insert_with(t, TimestampHistory::default)
    }

    /// Changes the source's call for a timestamp, if the source is known.
    fn with(&mut self, t: u64, p: u64, act: impl FnOnce(&mut RequestHistory)) {
        if let Some(source) = self.source(p) {
            act(self.story(t).call(source));
        }
    }

    /// Changes the source's call for a timestamp, even if the source is unknown.
    fn with_any(&mut self, t: u64, p: u64, act: impl FnOnce(&mut RequestHistory)) {
        if self.source(p).is_none() {
            self.priorities.push(p);
        }
        self.with(t, p, act);
    }

    fn source(&self, p: u64) -> Option<usize> {
        self.priorities.iter().position(|known| *known == p)
    }
}

fn outcome(story: &TimestampHistory, priorities: &[u64]) -> TimestampOutcome {
    match story.end {
        Some(CallEnd { source: Some(source), .. }) => {
            TimestampOutcome::Forwarded { p: priorities[source] }
        }
        Some(_) => TimestampOutcome::Missed,
        None if story.is_message() => TimestampOutcome::Open,
        None => TimestampOutcome::Unopened,
    }
}
