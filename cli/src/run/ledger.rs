//! The ledger: what became of each message and of each request, read from the trace.

use std::collections::BTreeMap;
use std::time::Duration;

use fuseline_traces::{Decision, Input};
use serde::Serialize;

use crate::policies::{Arrival, Forwarded, Message};

/// What a trace tells about its messages, taken line by line.
pub(crate) struct Ledger {
    /// The clouds' priorities; cloud `i` is source `i + 1`.
    clouds: Vec<u16>,
    messages: BTreeMap<u64, Story>,
    /// The failure that is the current input: an accepted one may cause no decision.
    failing: Option<(u64, u64, u64)>,
    timer_lag: Option<Duration>,
}

/// How the messages ended.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(crate) struct Ends {
    /// Forwarded, by source.
    pub(crate) forwarded: Vec<u64>,
    /// Nothing came.
    pub(crate) missed: u64,
    /// The window was full.
    pub(crate) refused: u64,
    /// Still open when the run ended.
    pub(crate) open: u64,
}

/// How the offers to one cloud ended, each message's first one; they add up.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize)]
pub(crate) struct Fates {
    /// The result was held or forwarded.
    pub(crate) on_time: u64,
    /// The timer came first.
    pub(crate) late: u64,
    /// The message left with a better result first.
    pub(crate) superseded: u64,
    /// Never sent (F2).
    pub(crate) refused: u64,
    /// The call failed.
    pub(crate) failed: u64,
    /// Still under way when the run ended.
    pub(crate) open: u64,
}

struct Story {
    opened: u64,
    end: End,
    /// By source.
    sources: Box<[Source]>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum End {
    Open,
    Forwarded(Forwarded),
    Missed,
    Refused,
}

#[derive(Clone, Copy, Default)]
struct Source {
    fate: Fate,
    /// When its first result came, whatever became of it.
    arrived: Option<Duration>,
    /// When its fate was sealed.
    sealed: Duration,
    /// When its timer is due, by the operator's clock.
    due: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
enum Fate {
    #[default]
    Unasked,
    Pending,
    OnTime,
    Late,
    Superseded,
    Refused,
    Failed,
}

impl Ledger {
    /// Nothing yet, for clouds of these priorities.
    pub(crate) fn new(clouds: &[u16]) -> Self {
        Self { clouds: clouds.to_vec(), messages: BTreeMap::new(), failing: None, timer_lag: None }
    }

    /// Takes the next input of the trace.
    pub(crate) fn input(&mut self, input: &Input) {
        self.settle();
        match *input {
            Input::Open { at, t, deadline } => {
                let mut sources: Box<[Source]> =
                    vec![Source::default(); self.clouds.len() + 1].into();
                sources[0].due = at.saturating_add(deadline.unwrap_or(u64::MAX));
                self.messages.insert(t, Story { opened: at, end: End::Open, sources });
            }
            Input::Offer { .. } | Input::Tick { .. } => {}
            Input::Result { at, t, p } => self.with(t, p, |opened, source| {
                source.arrived.get_or_insert(since(opened, at));
            }),
            Input::Fail { at, t, p } => self.failing = Some((at, t, p)),
        }
    }

    /// Takes the next decision of the trace.
    pub(crate) fn decision(&mut self, decision: &Decision) {
        match *decision {
            Decision::Timer { at, t, p } => {
                let mut lag = None;
                self.with(t, p, |_, source| lag = Some(since(source.due, at)));
                self.timer_lag = self.timer_lag.max(lag);
                self.seal(at, t, p, Fate::Late);
            }
            Decision::RefuseOpen { t, .. } => self.end(t, End::Refused),
            Decision::RefuseOffer { at, t, p, .. } => self.seal(at, t, p, Fate::Refused),
            Decision::Request { at, t, p, due } => {
                self.with(t, p, |_, source| source.due = due);
                self.seal(at, t, p, Fate::Pending);
            }
            Decision::Hold { at, t, p } => self.seal(at, t, p, Fate::OnTime),
            Decision::Drop { t, p, .. } => {
                self.failing = self.failing.filter(|failing| (failing.1, failing.2) != (t, p));
            }
            Decision::Emit { at, t, p } => {
                self.seal(at, t, p, Fate::OnTime);
                let opened = self.messages.get(&t).map(|story| story.opened);
                if let (Some(source), Some(opened)) = (self.source(p), opened) {
                    let response = since(opened, at);
                    self.end(t, End::Forwarded(Forwarded { source, response }));
                }
            }
            Decision::Miss { t, .. } => self.end(t, End::Missed),
            Decision::Cancel { at, t, p } => self.seal(at, t, p, Fate::Superseded),
        }
    }

    /// Ends the trace.
    pub(crate) fn finish(&mut self) {
        self.settle();
    }

    /// How long after its due instant a timer was served at most; none if none fired.
    pub(crate) const fn timer_lag(&self) -> Option<Duration> {
        self.timer_lag
    }

    /// How the messages ended.
    pub(crate) fn ends(&self) -> Ends {
        let forwarded = vec![0; self.clouds.len() + 1];
        let mut ends = Ends { forwarded, ..Ends::default() };
        for story in self.messages.values() {
            match story.end {
                End::Forwarded(Forwarded { source, .. }) => ends.forwarded[source] += 1,
                End::Missed => ends.missed += 1,
                End::Refused => ends.refused += 1,
                End::Open => ends.open += 1,
            }
        }
        ends
    }

    /// How the offers to each cloud ended, in the order of the clouds given.
    pub(crate) fn fates(&self) -> Vec<Fates> {
        let mut fates = vec![Fates::default(); self.clouds.len()];
        for story in self.messages.values() {
            for (source, fates) in story.sources.iter().skip(1).zip(&mut fates) {
                match source.fate {
                    Fate::Unasked => {}
                    Fate::Pending => fates.open += 1,
                    Fate::OnTime => fates.on_time += 1,
                    Fate::Late => fates.late += 1,
                    Fate::Superseded => fates.superseded += 1,
                    Fate::Refused => fates.refused += 1,
                    Fate::Failed => fates.failed += 1,
                }
            }
        }
        fates
    }

    /// The messages that ended, for the policies.
    ///
    /// Where a call was ended or never made, `planned(source, opened, t)` tells when its result
    /// would have come since the message's instant, if it can.
    pub(crate) fn messages(
        &self,
        planned: impl Fn(usize, Duration, u64) -> Option<Arrival>,
    ) -> Vec<Message> {
        let ended = self.messages.iter().filter(|(_, story)| story.end != End::Open);
        let message = |(t, story): (&u64, &Story)| {
            let opened = Duration::from_nanos(story.opened);
            let arrival = |(i, source): (usize, &Source)| match (source.arrived, source.fate) {
                (Some(arrived), _) => Arrival::At(arrived),
                (None, Fate::Failed) => Arrival::Never,
                (None, _) => planned(i, opened, *t).unwrap_or(Arrival::After(source.sealed)),
            };
            let forwarded = match story.end {
                End::Forwarded(forwarded) => Some(forwarded),
                End::Open | End::Missed | End::Refused => None,
            };
            Message { arrivals: story.sources.iter().enumerate().map(arrival).collect(), forwarded }
        };
        ended.map(message).collect()
    }

    /// A failure that was not dropped was accepted (F4).
    fn settle(&mut self) {
        if let Some((at, t, p)) = self.failing.take() {
            self.seal(at, t, p, Fate::Failed);
        }
    }

    /// What is sealed stays so: a held result's timer changes nothing, nor does a second offer.
    fn seal(&mut self, at: u64, t: u64, p: u64, fate: Fate) {
        self.with(t, p, |opened, source| {
            let is_next = match source.fate {
                Fate::Unasked => true,
                Fate::Pending => fate != Fate::Refused,
                Fate::OnTime | Fate::Late | Fate::Superseded | Fate::Refused | Fate::Failed => {
                    false
                }
            };
            if is_next {
                (source.fate, source.sealed) = (fate, since(opened, at));
            }
        });
    }

    fn end(&mut self, t: u64, end: End) {
        if let Some(story) = self.messages.get_mut(&t) {
            story.end = end;
        }
    }

    fn with(&mut self, t: u64, p: u64, act: impl FnOnce(u64, &mut Source)) {
        if let (Some(i), Some(story)) = (self.source(p), self.messages.get_mut(&t))
            && let Some(source) = story.sources.get_mut(i)
        {
            act(story.opened, source);
        }
    }

    fn source(&self, p: u64) -> Option<usize> {
        if p == 0 {
            return Some(0);
        }
        self.clouds.iter().position(|cloud| u64::from(*cloud) == p).map(|i| i + 1)
    }
}

fn since(opened: u64, at: u64) -> Duration {
    Duration::from_nanos(at.saturating_sub(opened))
}

#[cfg(test)]
mod tests {
    use fuseline_arbiter::Arbiter;
    use fuseline_traces::{Cloud, Commit, Header};

    use super::*;

    const MS: u64 = 1_000_000;

    /// Applies inputs to the core and enters its decisions.
    fn ledger(inputs: &[Input]) -> Ledger {
        let cloud = |p| Cloud { p, name: None, limit: 2, resume: 1 };
        let clouds = vec![cloud(7), cloud(3), cloud(5)];
        let header = Header { operator: None, window: 2, commit: Commit::Eager, clouds };
        let mut arbiter: Arbiter = Arbiter::new(&header).unwrap();
        let mut ledger = Ledger::new(&[7, 3, 5]);
        for input in inputs {
            ledger.input(input);
            arbiter.decide(input, |decision| ledger.decision(&decision));
        }
        ledger.finish();
        ledger
    }

    fn open(at: u64, t: u64) -> Input {
        Input::Open { at: at * MS, t, deadline: None }
    }

    fn offer(at: u64, t: u64, p: u64) -> Input {
        Input::Offer { at: at * MS, t, p, deadline: 500 * MS, backlog: 0 }
    }

    fn result(at: u64, t: u64, p: u64) -> Input {
        Input::Result { at: at * MS, t, p }
    }

    fn fail(at: u64, t: u64, p: u64) -> Input {
        Input::Fail { at: at * MS, t, p }
    }

    fn at(ms: u64) -> Arrival {
        Arrival::At(Duration::from_millis(ms))
    }

    fn after(ms: u64) -> Arrival {
        Arrival::After(Duration::from_millis(ms))
    }

    #[test]
    fn the_best_clouds_result_supersedes_the_other_request() {
        let ledger = ledger(&[open(10, 0), offer(10, 0, 7), offer(10, 0, 3), result(180, 0, 7)]);
        assert_eq!(ledger.ends(), Ends { forwarded: vec![0, 1, 0, 0], ..Ends::default() });
        let [seven, three, _] = ledger.fates()[..] else { unreachable!() };
        assert_eq!(seven, Fates { on_time: 1, ..Fates::default() });
        assert_eq!(three, Fates { superseded: 1, ..Fates::default() });
        let messages = ledger.messages(|_, _, _| None);
        assert_eq!(messages[0].arrivals, [after(0), at(170), after(170), after(0)]);
        assert_eq!(messages[0].forwarded.unwrap().response, Duration::from_millis(170));
    }

    #[test]
    fn a_held_result_is_on_time_and_the_one_timed_out_late() {
        let ledger = ledger(&[
            open(0, 0),
            offer(0, 0, 7),
            offer(0, 0, 3),
            result(100, 0, 3),
            result(300, 0, 0),
            Input::Tick { at: 500 * MS },
            result(900, 0, 7),
        ]);
        let [seven, three, _] = ledger.fates()[..] else { unreachable!() };
        assert_eq!(seven, Fates { late: 1, ..Fates::default() });
        assert_eq!(three, Fates { on_time: 1, ..Fates::default() });
        assert_eq!(ledger.ends().forwarded, [0, 0, 1, 0]);
        // What came after the end was seen all the same.
        assert_eq!(
            ledger.messages(|_, _, _| None)[0].arrivals,
            [at(300), at(900), at(100), after(0)]
        );
    }

    #[test]
    fn an_accepted_failure_counts_and_a_dropped_one_does_not() {
        let failed = ledger(&[open(0, 0), offer(0, 0, 7), fail(20, 0, 7), result(30, 0, 0)]);
        assert_eq!(failed.fates()[0], Fates { failed: 1, ..Fates::default() });
        assert_eq!(failed.messages(|_, _, _| None)[0].arrivals[1], Arrival::Never);
        let late = ledger(&[open(0, 0), offer(0, 0, 7), fail(500, 0, 7)]);
        assert_eq!(late.fates()[0], Fates { late: 1, ..Fates::default() });
        assert_eq!(late.ends().open, 1);
    }

    #[test]
    fn a_refused_offer_and_a_refused_message_count_apart() {
        let full = [open(0, 0), open(1, 1), open(2, 2), offer(2, 2, 7), offer(3, 1, 7)];
        let ledger = ledger(&full);
        assert_eq!(ledger.ends().refused, 1);
        assert_eq!(ledger.fates()[0], Fates { refused: 1, open: 1, ..Fates::default() });
        // Only what ended is weighed.
        assert_eq!(ledger.messages(|_, _, _| None).len(), 1);
    }

    #[test]
    fn a_held_result_stays_on_time_when_its_timer_commits_a_better_one() {
        let ledger = ledger(&[
            open(0, 0),
            offer(0, 0, 3),
            offer(5, 0, 5),
            offer(9, 0, 7),
            result(100, 0, 3),
            result(200, 0, 5),
            Input::Tick { at: 500 * MS },
        ]);
        assert_eq!(ledger.ends().forwarded, [0, 0, 0, 1]);
        let [seven, three, five] = ledger.fates()[..] else { unreachable!() };
        assert_eq!(seven, Fates { superseded: 1, ..Fates::default() });
        assert_eq!((three, five), (Fates { on_time: 1, ..Fates::default() }, three));
    }

    #[test]
    fn a_second_offer_does_not_count() {
        let ledger = ledger(&[open(0, 0), offer(0, 0, 7), offer(1, 0, 7), result(2, 0, 7)]);
        assert_eq!(ledger.fates()[0], Fates { on_time: 1, ..Fates::default() });
    }

    #[test]
    fn a_message_nobody_answers_is_missed() {
        let ledger = ledger(&[open(0, 0), fail(5, 0, 0)]);
        assert_eq!(ledger.ends().missed, 1);
        assert_eq!(ledger.messages(|_, _, _| None)[0].forwarded, None);
    }

    #[test]
    fn a_plan_stands_in_for_a_call_that_was_ended() {
        let ledger = ledger(&[open(10, 0), offer(10, 0, 3), offer(10, 0, 7), result(180, 0, 7)]);
        let planned = |source, opened, t| {
            assert_eq!((opened, t), (Duration::from_millis(10), 0));
            (source == 2).then(|| at(220))
        };
        assert_eq!(ledger.messages(planned)[0].arrivals, [after(0), at(170), at(220), after(0)]);
    }
}
