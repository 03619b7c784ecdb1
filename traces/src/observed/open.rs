//! What was recorded so far of a timestamp that may still get a line.
//!
//! Facts that no longer decide anything are left out, so that memory is bounded.

use std::collections::BTreeSet;

use super::gap::Opened;
use super::story::{MessageHistory, Slack};
use crate::event::{Decision, Event, Input};
use crate::reason::DropReason;

/// How many facts are kept before those that decide nothing are left out.
const MANY: usize = 64;
/// All sources that are neither local nor registered: when something came of them is all that counts.
const STRANGER: u64 = u64::MAX;

/// What was observed of a timestamp so far.
#[derive(Debug, Default)]
pub(super) struct OpenMessageHistory {
    opens: Vec<OpenTimestamp>,
    /// When an open was refused.
    refusals: Vec<u64>,
    /// The clouds requested, when, and with which due instant.
    requests: Vec<(u64, u64, u64)>,
    came: BTreeSet<RequestClosing>,
    /// The drop lines: their results and failures count for nothing.
    dropped: BTreeSet<Dropped>,
    /// What came out and when, with the line.
    outputs: Vec<(Option<u64>, u64, u64)>,
    /// The line of a request to a cloud that is not registered, with its priority.
    stranger: Option<(u64, u64)>,
    /// The last line of it.
    pub(super) line: u64,
    /// When it can be judged, whatever else comes.
    pub(super) ripe: u64,
    pub(super) is_queued: bool,
    /// Whether it is known to break the rules, and waits for what may come out too late.
    pub(super) is_overdue: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct OpenTimestamp {
    at: u64,
    deadline: Option<u64>,
    line: u64,
}

/// A result or a failure.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct RequestClosing {
    p: u64,
    at: u64,
    is_result: bool,
    is_superseded: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct Dropped {
    p: u64,
    at: u64,
    is_unknown: bool,
}

/// All that was observed of a timestamp, put together.
#[derive(Debug)]
pub(super) struct WholeMessageHistory {
    pub(super) story: MessageHistory,
    /// The lines of what came out.
    pub(super) lines: Vec<u64>,
    /// The line of an open beside the first.
    pub(super) second_open: Option<u64>,
    /// The line of a request to a cloud that is not registered, with its priority.
    pub(super) stranger: Option<(u64, u64)>,
    pub(super) was_refused: bool,
}

impl OpenMessageHistory {
    /// Takes a line of the timestamp; `records_opens` says whether an open stands before it in the trace.
    pub(super) fn take(
        &mut self,
        line: u64,
        event: &Event,
        is_cloud: impl Fn(u64) -> bool,
        records_opens: bool,
    ) {
        self.line = line;
        let known = |p| if p == 0 || is_cloud(p) { p } else { STRANGER };
        match *event {
            Event::Input(Input::Open { at, deadline, .. }) => {
                self.opens.push(OpenTimestamp { at, deadline, line });
            }
            Event::Input(Input::Result { at, p, .. }) => self.comes(known(p), at, true),
            Event::Input(Input::Fail { at, p, .. }) => self.comes(known(p), at, false),
            Event::Decision(Decision::Request { at, p, due, .. }) if is_cloud(p) => {
                // One more than there may be shows that one is requested twice.
                if self.requests.len() <= MANY {
                    self.requests.push((p, at, due));
                }
            }
            Event::Decision(Decision::Request { p, .. }) => {
                self.stranger.get_or_insert((line, p));
            }
            Event::Decision(Decision::RefuseOpen { at, .. }) => self.refusals.push(at),
            Event::Decision(Decision::Drop { at, p, why, .. }) => match why {
                DropReason::Unknown => self.drops(known(p), at, true),
                DropReason::Superseded if records_opens => self.drops(known(p), at, false),
                DropReason::Superseded
                | DropReason::Unsolicited
                | DropReason::Duplicate
                | DropReason::Late => {}
            },
            Event::Decision(Decision::Emit { at, p, .. }) => self.comes_out(Some(p), at, line),
            Event::Decision(Decision::Miss { at, .. }) => self.comes_out(None, at, line),
            Event::Input(Input::Offer { .. } | Input::Tick { .. })
            | Event::Decision(
                Decision::Timer { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Hold { .. }
                | Decision::Cancel { .. },
            ) => {}
        }
    }

    /// Leaves out what came before `until` and decides nothing beside what came earlier of its kind, if there is much.
    ///
    /// Looks at each a few times in all, since it does so each time that their number has doubled.
    pub(super) fn compact(&mut self, until: u64) {
        let is_due = |len: usize| len >= MANY && len.is_power_of_two();
        if is_due(self.came.len()) {
            let mut seen = BTreeSet::new();
            self.came.retain(|came| {
                seen.insert((came.p, came.is_result, came.is_superseded)) || came.at >= until
            });
        }
        if is_due(self.dropped.len()) {
            self.dropped.retain(|dropped| dropped.at >= until);
        }
    }

    /// How many facts are held that may be left out.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.came.len() + self.dropped.len()
    }

    /// Whether anything came out.
    pub(super) const fn has_come_out(&self) -> bool {
        !self.outputs.is_empty()
    }

    /// From when on no line can change what is decided about it, unless it is a fact of its own.
    ///
    /// A line may come `2T` after its instant's turn, and its true instant is `T` off. Where something came out, what is observed
    /// after that comes after the retirement. Where nothing did, it is ripe when every timer must have been served
    /// and every output must have come, so that it stays open for good or has no explanation.
    pub(super) fn ripens(&self, slack: Slack) -> u64 {
        let Slack { tolerance, lateness } = slack;
        let opens = self.opens.iter().map(|open| open.at);
        let dropped = self.dropped.iter().map(|dropped| dropped.at);
        let settled = opens.chain(self.refusals.iter().copied()).chain(dropped);
        let (last, ends) = if self.has_come_out() {
            (settled.chain(self.outputs.iter().map(|(_, at, _)| *at)).max(), 1)
        } else {
            let dues = self.requests.iter().map(|(_, _, due)| *due);
            let limits =
                self.opens.iter().map(|open| open.at.saturating_add(open.deadline.unwrap_or(0)));
            let came = self.came.iter().map(|came| came.at);
            (settled.chain(dues).chain(limits).chain(came).max(), 2)
        };
        let margin = tolerance.saturating_mul(7).saturating_add(lateness.saturating_mul(ends));
        last.unwrap_or(0).saturating_add(margin).saturating_add(2)
    }

    /// Puts together what was observed, without what was refused and what came of that; `was_refused` says whether an open of it was
    /// refused long ago.
    pub(super) fn whole(&self, slack: Slack, was_refused: bool) -> WholeMessageHistory {
        let reach = slack.tolerance.saturating_mul(2).saturating_add(slack.lateness);
        let opens = self.accepted(reach);
        let outputs: Vec<(Option<u64>, u64)> =
            self.outputs.iter().map(|(p, at, _)| (*p, *at)).collect();
        let requested = self.requests.iter().map(|(_, at, _)| *at);
        let known = opens.iter().map(|open| open.at).chain(requested);
        let known = known.chain(outputs.iter().map(|(_, at)| *at)).min();
        // A43: what came before the timestamp was open, after it was skipped or beside its being refused.
        let before = |at: u64| known.is_none_or(|known| at.saturating_add(reach) < known);
        let is_refused = was_refused || self.refusals.iter().any(|refused| before(*refused));
        let is_none = |came: &RequestClosing| (came.is_superseded || is_refused) && before(came.at);
        let (mut results, mut failures) = (Vec::new(), Vec::new());
        for came in self.came.iter().filter(|came| !is_none(came)) {
            (if came.is_result { &mut results } else { &mut failures }).push((came.p, came.at));
        }
        let open = opens.first().map(|open| (open.at, open.deadline));
        WholeMessageHistory {
            story: MessageHistory {
                open,
                requests: self.requests.clone(),
                results,
                failures,
                outputs,
            },
            lines: self.outputs.iter().map(|(.., line)| *line).collect(),
            second_open: opens.get(1).map(|open| open.line),
            stranger: self.stranger,
            // Something of it that certainly came before shows that it was open then.
            was_refused: was_refused
                || self.refusals.iter().any(|refused| {
                    known.is_none_or(|known| known.saturating_add(reach) >= *refused)
                }),
        }
    }

    /// Whether this line is an open of it.
    pub(super) fn has_open(&self, line: u64) -> bool {
        self.opens.iter().any(|open| open.line == line)
    }

    /// Until when a line may come that changes which of its opens were refused.
    pub(super) fn opens_by(&self, slack: Slack) -> u64 {
        let opens = self.opens.iter().map(|open| open.at);
        let last = opens.chain(self.refusals.iter().copied()).max().unwrap_or(0);
        let margin = slack.tolerance.saturating_mul(4).saturating_add(slack.lateness);
        last.saturating_add(margin)
    }

    /// Its opens that were refused; `t` is the timestamp.
    pub(super) fn refused(&self, t: u64, slack: Slack) -> Vec<Opened> {
        let reach = slack.tolerance.saturating_mul(2).saturating_add(slack.lateness);
        let accepted = self.accepted(reach);
        let refused = self.opens.iter().filter(|open| !accepted.contains(open));
        refused.map(|open| Opened { at: open.at, line: open.line, t }).collect()
    }

    /// A42: the opens that were not refused. A refusal takes away the nearest open, if two errors of the clock and the lateness
    /// reach from the one to the other.
    fn accepted(&self, reach: u64) -> Vec<OpenTimestamp> {
        let (mut opens, mut refusals) = (self.opens.clone(), self.refusals.clone());
        refusals.sort_unstable();
        for refused in refusals {
            let distances = opens.iter().map(|open| open.at.abs_diff(refused)).enumerate();
            let nearest = distances.min_by_key(|(_, distance)| *distance);
            if let Some((place, _)) = nearest.filter(|(_, distance)| *distance <= reach) {
                opens.remove(place);
            }
        }
        opens
    }

    fn comes(&mut self, p: u64, at: u64, is_result: bool) {
        let [first, last] = [false, true].map(|is_unknown| Dropped { p, at, is_unknown });
        let mut drops = self.dropped.range(first..=last).peekable();
        let is_superseded = drops.peek().is_some();
        if !drops.any(|dropped| dropped.is_unknown) {
            self.came.insert(RequestClosing { p, at, is_result, is_superseded });
        }
    }

    /// A drop line is about all that came of the source at its instant, in whatever order the lines stand.
    fn drops(&mut self, p: u64, at: u64, is_unknown: bool) {
        self.dropped.insert(Dropped { p, at, is_unknown });
        for (is_result, is_superseded) in
            [(false, false), (false, true), (true, false), (true, true)]
        {
            if self.came.remove(&RequestClosing { p, at, is_result, is_superseded }) && !is_unknown
            {
                self.came.insert(RequestClosing { p, at, is_result, is_superseded: true });
            }
        }
    }

    fn comes_out(&mut self, p: Option<u64>, at: u64, line: u64) {
        // Two are one too many; how many more there are does not matter.
        if self.outputs.len() < 2 {
            self.outputs.push((p, at, line));
        }
    }
}

impl WholeMessageHistory {
    /// Whether an open of it was not refused.
    pub(super) const fn is_opened(&self) -> bool {
        self.story.open.is_some()
    }

    /// Whether it has a result, a failure or an output.
    pub(super) const fn is_reported_of(&self) -> bool {
        let MessageHistory { results, failures, outputs, .. } = &self.story;
        !(results.is_empty() && failures.is_empty() && outputs.is_empty())
    }

    /// Whether nothing is left of it.
    pub(super) const fn is_none(&self) -> bool {
        let is_asked = !self.story.requests.is_empty() || self.stranger.is_some();
        !(self.is_opened() || is_asked || self.is_reported_of())
    }
}
