//! Stores what was recorded so far of a timestamp that may still get a line.
//!
//! Facts that no longer decide anything are removed, so that memory is bounded.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use super::attempts::{AttemptFailure, RequestAttempt, folded_failures, folded_requests};
use super::gap::Opened;
use super::slack::SourceSlack;
use super::story::MessageHistory;
use super::window::WaitingChange;
use crate::annotations::{Annotations, ValueKeys};
use crate::event::{Commit, Decision, Event, Input};
use crate::reason::DropReason;

/// The number of facts that are stored before those that decide nothing are removed.
const MANY: usize = 64;
/// Stands for all sources that are neither local nor registered; only the instants of their inputs
/// matter.
const STRANGER: u64 = u64::MAX;

/// The observations of a timestamp so far.
#[derive(Clone, Debug, Default)]
pub(super) struct OpenMessageHistory {
    opens: Vec<OpenTimestamp>,
    /// The instants of refusals of its opens.
    refusals: Vec<u64>,
    requests: Vec<RequestAttempt>,
    came: BTreeSet<RequestClosing>,
    /// The drop lines. The results and failures that they name do not count.
    dropped: BTreeSet<Dropped>,
    outputs: Vec<ObservedOutput>,
    /// The outputs that were said to be the last (F9).
    finals: Vec<ObservedOutput>,
    /// The line of a request to a cloud that is not registered, and its priority.
    stranger: Option<(u64, u64)>,
    /// The least and the greatest instant of its lines, as far as they matter.
    instants: Option<(u64, u64)>,
    /// Its last line.
    pub(super) line: u64,
    /// `true` if it waits until it can be judged, whatever else comes.
    pub(super) is_queued: bool,
    /// `true` if it is known to break the rules and waits for an output that may come too late.
    pub(super) is_overdue: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct OpenTimestamp {
    at: u64,
    deadline: Option<u64>,
    /// The instant by which its own deadline demands an output (J2).
    due: Option<u64>,
    line: u64,
}

/// An output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ObservedOutput {
    /// The source whose result was sent, or `None` for a miss.
    pub(super) p: Option<u64>,
    pub(super) at: u64,
    /// The keys that concern its value.
    pub(super) value: ValueKeys,
    pub(super) line: u64,
}

/// A result or a failure.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct RequestClosing {
    p: u64,
    at: u64,
    is_result: bool,
    is_superseded: bool,
    attempt: Option<u8>,
    /// The timestamp whose message a result's value was computed from.
    of: Option<u64>,
    /// `true` if a result's value is meant for this timestamp, or `None` if it does not say.
    is_meant: Option<bool>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct Dropped {
    p: u64,
    at: u64,
    is_unknown: bool,
}

/// The value keys of a result.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ResultValue {
    pub(super) p: u64,
    pub(super) at: u64,
    /// The timestamp whose message the value was computed from.
    pub(super) of: Option<u64>,
    /// `true` if the value is meant for this timestamp.
    pub(super) is_meant: Option<bool>,
}

/// All observations of a timestamp, put together.
#[derive(Debug)]
pub(super) struct WholeMessageHistory<'a> {
    pub(super) story: MessageHistory,
    /// The outputs, with their lines.
    pub(super) outputs: &'a [ObservedOutput],
    /// The outputs that were said to be the last, with their lines (F9).
    pub(super) finals: &'a [ObservedOutput],
    /// The value keys of results, if any result has them.
    pub(super) values: Vec<ResultValue>,
    /// The instant by which the message's own deadline demands an output (J2).
    pub(super) due: Option<u64>,
    /// `true` if any of its sources or attempts failed.
    pub(super) has_failed: bool,
    /// The line of a second open, and `true` if that is a copy of the first.
    pub(super) second_open: Option<(u64, bool)>,
    /// The line of the first open.
    pub(super) first_open: Option<u64>,
    /// The line of a request to a cloud that is not registered, and its priority.
    pub(super) stranger: Option<(u64, u64)>,
    pub(super) was_refused: bool,
}

impl OpenMessageHistory {
    /// Notes a line of the timestamp. Returns whether the timestamp begins or ceases to wait for
    /// its output.
    ///
    /// `records_opens` is `true` if an open comes before the line in the trace. The timestamp may
    /// have `most` outputs; only one more is stored.
    pub(super) fn take(
        &mut self,
        line: u64,
        event: &Event,
        annotations: &Annotations,
        is_cloud: impl Fn(u64) -> bool,
        records_opens: bool,
        most: usize,
    ) -> WaitingChange {
        self.line = line;
        let known = |p| if p == 0 || is_cloud(p) { p } else { STRANGER };
        let &Annotations { of, attempt, .. } = annotations;
        let value = annotations.value();
        match *event {
            Event::Input(Input::Open { at, deadline, .. }) => {
                let begins = !self.is_opened() && !self.has_come_out();
                self.opens.push(OpenTimestamp { at, deadline, due: annotations.due(at), line });
                return if begins { WaitingChange::Begins } else { WaitingChange::None };
            }
            Event::Input(Input::Result { at, t, p }) => {
                let is_meant = annotations.meant_for.map(|meant| meant == t);
                let came = RequestClosing::new(known(p), at, true, attempt);
                self.comes(RequestClosing { of, is_meant, ..came });
            }
            Event::Input(Input::Fail { at, p, .. }) => {
                self.comes(RequestClosing::new(known(p), at, false, attempt));
            }
            Event::Decision(Decision::Request { at, p, due, .. }) if is_cloud(p) => {
                self.requests(RequestAttempt { p, at, due, attempt });
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
            Event::Decision(Decision::Emit { at, p, .. }) => {
                return self.puts_out(ObservedOutput { p: Some(p), at, value, line }, most);
            }
            Event::Decision(Decision::Miss { at, .. }) => {
                return self.puts_out(
                    ObservedOutput { p: None, at, value: ValueKeys::default(), line },
                    most,
                );
            }
            Event::Decision(Decision::Final { at, p, .. }) => {
                let change = self.stops_waiting();
                let value = ValueKeys::default();
                keep(&mut self.finals, 1, ObservedOutput { p: Some(p), at, value, line });
                return change;
            }
            Event::Input(Input::Offer { .. } | Input::Tick { .. })
            | Event::Decision(
                Decision::Timer { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Hold { .. }
                | Decision::Cancel { .. },
            ) => {}
        }
        WaitingChange::None
    }

    fn puts_out(&mut self, output: ObservedOutput, most: usize) -> WaitingChange {
        let change = self.stops_waiting();
        keep(&mut self.outputs, most, output);
        change
    }

    /// Returns how an output changes the waiting for it.
    pub(super) const fn stops_waiting(&self) -> WaitingChange {
        if self.is_waiting() { WaitingChange::Ends } else { WaitingChange::None }
    }

    /// Notes the instant of a line.
    pub(super) fn lasts(&mut self, at: u64) {
        self.instants =
            Some(self.instants.map_or((at, at), |(from, to)| (from.min(at), to.max(at))));
    }

    /// Returns `true` if there are so many facts that some may be removed.
    pub(super) fn is_large(&self) -> bool {
        self.came.len() >= MANY || self.dropped.len() >= MANY
    }

    /// Removes facts before `until` that decide nothing beside earlier ones of their kind, if there
    /// are many facts.
    ///
    /// Since this happens each time their number has doubled, it looks at each fact a few times in
    /// all.
    pub(super) fn compact(&mut self, until: u64) {
        let is_due = |len: usize| len >= MANY && len.is_power_of_two();
        if is_due(self.came.len()) {
            let newest = self.newest_before(until);
            let (mut seen, mut kept) = (BTreeSet::new(), BTreeSet::new());
            self.came.retain(|came| {
                let is_newest = came.is_result && newest.get(&came.p) == Some(&came.value_order());
                seen.insert((
                    came.p,
                    came.is_result,
                    came.is_superseded,
                    came.attempt,
                    came.is_meant,
                )) || came.at >= until
                    || (is_newest && kept.insert(came.p))
            });
        }
        if is_due(self.dropped.len()) {
            self.dropped.retain(|dropped| dropped.at >= until);
        }
    }

    /// Returns the results of each source before `until` whose values may be of the latest
    /// timestamps.
    fn newest_before(&self, until: u64) -> BTreeMap<u64, ValueOrder> {
        let mut newest = BTreeMap::new();
        for came in self.came.iter().filter(|came| came.is_result && came.at < until) {
            let value_order = newest.entry(came.p).or_insert(came.value_order());
            *value_order = came.value_order().max(*value_order);
        }
        newest
    }

    /// Returns the number of facts that may be removed.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.came.len() + self.dropped.len()
    }

    /// Returns the time from its first line to its last.
    pub(super) fn span(&self) -> u64 {
        self.instants.map_or(0, |(from, to)| to - from)
    }

    /// Returns `true` if it has an open, refused or not.
    pub(super) const fn is_opened(&self) -> bool {
        !self.opens.is_empty()
    }

    /// Returns `true` if it was opened and has no output yet.
    pub(super) const fn is_waiting(&self) -> bool {
        !self.opens.is_empty() && !self.has_come_out()
    }

    /// Returns `true` if it was certainly open around the instant at which another timestamp was
    /// opened (P9). Outputs until `end` would have been seen.
    pub(super) fn is_surely_open(
        &self,
        at: u64,
        slack: &SourceSlack,
        has_local: bool,
        end: u64,
    ) -> bool {
        let (twice, by) = (slack.tolerance().saturating_mul(2), at.saturating_add(slack.reach()));
        let accepted = self.accepted(slack.reach());
        if accepted.first().is_none_or(|open| open.at.saturating_add(twice) >= at) {
            return false;
        }
        if let Some(out) = self.outputs.iter().chain(&self.finals).map(|output| output.at).min() {
            return out > by;
        }
        // It waits for local, or for a deadline that is not over (P7).
        let later = at.saturating_add(slack.tolerance_of(0)).saturating_add(slack.tolerance());
        let is_local_pending = has_local
            && self.came.iter().all(|came| came.p != 0 || came.at > later)
            && accepted.iter().all(|open| open.deadline.is_none());
        let runs = |request: &RequestAttempt| {
            request.due > at.saturating_add(slack.tolerance_of(request.p)).saturating_add(twice)
        };
        end > by && (is_local_pending || self.requests.iter().any(runs))
    }

    /// Returns `true` if it has an output.
    pub(super) const fn has_come_out(&self) -> bool {
        !(self.outputs.is_empty() && self.finals.is_empty())
    }

    /// Returns `true` if it has its last output.
    pub(super) fn has_ended(&self, commit: Commit) -> bool {
        match commit {
            Commit::Eager | Commit::Patient => self.has_come_out(),
            // Others may follow an output (F9).
            Commit::Progressive => {
                !self.finals.is_empty() || self.outputs.iter().any(|output| output.p.is_none())
            }
        }
    }

    /// Returns the instant from which on no line can change the decision about it, unless the line
    /// is a fact of its own.
    ///
    /// A line may come `2T` after its turn, and its true instant may be `T` off. If the last output
    /// came, whatever is observed later comes after the retirement. Otherwise the timestamp is
    /// closed when every timer must have been served and every output must have come. From then on
    /// it either stays open or has no explanation.
    pub(super) fn closed_from(&self, commit: Commit, slack: &SourceSlack) -> u64 {
        let (tolerance, lateness) = (slack.greatest(), slack.lateness());
        let opens = self.opens.iter().map(|open| open.at);
        let dropped = self.dropped.iter().map(|dropped| dropped.at);
        let out = self.outputs.iter().chain(&self.finals).map(|output| output.at);
        let settled = opens.chain(self.refusals.iter().copied()).chain(dropped).chain(out);
        let (last, ends) = if self.has_ended(commit) {
            (settled.max(), 1)
        } else {
            let dues = self.requests.iter().map(|request| request.due);
            let limits =
                self.opens.iter().map(|open| open.at.saturating_add(open.deadline.unwrap_or(0)));
            let own = self.opens.iter().filter_map(|open| open.due);
            let came = self.came.iter().map(|came| came.at);
            (settled.chain(dues).chain(limits).chain(own).chain(came).max(), 2)
        };
        let margin = tolerance.saturating_mul(7).saturating_add(lateness.saturating_mul(ends));
        last.unwrap_or(0).saturating_add(margin).saturating_add(2)
    }

    /// Combines all observations, without refused opens and their consequences. `was_refused` is
    /// `true` if one of its opens was refused long ago.
    pub(super) fn whole(&self, slack: &SourceSlack, was_refused: bool) -> WholeMessageHistory<'_> {
        let (own, lateness) = (slack.tolerance(), slack.lateness());
        let opens = self.accepted(slack.reach());
        let requested =
            self.requests.iter().map(|request| (request.at, slack.tolerance_of(request.p)));
        let out = self.outputs.iter().chain(&self.finals).map(|output| (output.at, own));
        let known = opens.iter().map(|open| (open.at, own)).chain(requested).chain(out);
        // The earliest and the latest instant at which the first of these lines may have happened.
        let first = known.clone().map(|(at, tolerance)| at.saturating_sub(tolerance)).min();
        let first_by = known.map(|(at, tolerance)| at.saturating_add(tolerance)).min();
        // An input may have come before the timestamp was open, after it was skipped, or beside its
        // refusal (A43).
        let before = |at: u64, tolerance: u64| {
            let by = at.saturating_add(tolerance).saturating_add(lateness);
            first.is_none_or(|first| by < first)
        };
        let is_refused = was_refused || self.refusals.iter().any(|refused| before(*refused, own));
        let is_none = |came: &&RequestClosing| {
            (came.is_superseded || is_refused) && before(came.at, slack.tolerance_of(came.p))
        };
        let says = self.outputs.iter().any(|output| !output.value.is_empty())
            || self.came.iter().any(|came| came.of.is_some() || came.is_meant.is_some());
        let (mut results, mut failures, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for came in self.came.iter().filter(|came| !is_none(came)) {
            let RequestClosing { p, at, attempt, of, is_meant, .. } = *came;
            if came.is_result {
                results.push((p, at));
                // If no result has value keys, there is nothing to compare.
                if says {
                    values.push(ResultValue { p, at, of, is_meant });
                }
            } else {
                failures.push(AttemptFailure { p, at, attempt });
            }
        }
        let open = opens.first();
        WholeMessageHistory {
            story: MessageHistory {
                open: open.map(|open| (open.at, open.deadline)),
                requests: folded_requests(&self.requests),
                results,
                failures: folded_failures(&self.requests, &failures),
                outputs: self.outputs.iter().map(|output| (output.p, output.at)).collect(),
                finals: self.finals.iter().filter_map(|last| Some((last.p?, last.at))).collect(),
                without_local: false,
            },
            outputs: &self.outputs,
            finals: &self.finals,
            values,
            due: open.and_then(|open| open.due),
            has_failed: !failures.is_empty(),
            second_open: opens.get(1).map(|second| {
                (second.line, opens.first().is_some_and(|open| open.is_copied_by(second)))
            }),
            first_open: open.map(|open| open.line),
            stranger: self.stranger,
            // A line that certainly came before shows that the timestamp was open then.
            was_refused: was_refused
                || self.refusals.iter().any(|refused| {
                    let by = |by: u64| by.saturating_add(own).saturating_add(lateness);
                    first_by.is_none_or(|first| by(first) >= *refused)
                }),
        }
    }

    /// Returns `true` if this line is an open of the timestamp.
    pub(super) fn has_open(&self, line: u64) -> bool {
        self.opens.iter().any(|open| open.line == line)
    }

    /// Returns the instant until which a line may change which of its opens were refused.
    pub(super) fn opens_by(&self, slack: &SourceSlack) -> u64 {
        let opens = self.opens.iter().map(|open| open.at);
        let last = opens.chain(self.refusals.iter().copied()).max().unwrap_or(0);
        let margin = slack.greatest().saturating_mul(4).saturating_add(slack.lateness());
        last.saturating_add(margin)
    }

    /// Returns its opens that were refused; `t` is the timestamp.
    pub(super) fn refused(&self, t: u64, slack: &SourceSlack) -> Vec<Opened> {
        let accepted = self.accepted(slack.reach());
        let refused = self.opens.iter().filter(|open| !accepted.contains(open));
        refused.map(|open| Opened { at: open.at, line: open.line, t }).collect()
    }

    /// Returns the opens that were not refused. A refusal removes the nearest open within `reach`,
    /// which is two errors of the clock and the lateness (A42).
    fn accepted(&self, reach: u64) -> Cow<'_, [OpenTimestamp]> {
        if self.refusals.is_empty() {
            return Cow::Borrowed(&self.opens);
        }
        let (mut opens, mut refusals) = (self.opens.clone(), self.refusals.clone());
        refusals.sort_unstable();
        for refused in refusals {
            let distances = opens.iter().map(|open| open.at.abs_diff(refused)).enumerate();
            let nearest = distances.min_by_key(|(_, distance)| *distance);
            if let Some((place, _)) = nearest.filter(|(_, distance)| *distance <= reach) {
                opens.remove(place);
            }
        }
        Cow::Owned(opens)
    }

    fn requests(&mut self, request: RequestAttempt) {
        let is_same =
            |other: &&RequestAttempt| (other.p, other.attempt) == (request.p, request.attempt);
        // Two lines suffice to show that an attempt is requested twice.
        if self.requests.iter().filter(is_same).count() < 2 {
            self.requests.push(request);
        }
    }

    fn comes(&mut self, came: RequestClosing) {
        let RequestClosing { p, at, .. } = came;
        if self.dropped.is_empty() {
            self.came.insert(came);
            return;
        }
        let [first, last] = [false, true].map(|is_unknown| Dropped { p, at, is_unknown });
        let mut drops = self.dropped.range(first..=last).peekable();
        let is_superseded = drops.peek().is_some();
        if !drops.any(|dropped| dropped.is_unknown) {
            self.came.insert(RequestClosing { is_superseded, ..came });
        }
    }

    /// Notes a drop line. It concerns everything that came from the source at its instant, in
    /// whatever order the lines are.
    fn drops(&mut self, p: u64, at: u64, is_unknown: bool) {
        self.dropped.insert(Dropped { p, at, is_unknown });
        let first = RequestClosing::new(p, at, false, None);
        let dropped: Vec<RequestClosing> = self
            .came
            .range(first..)
            .take_while(|came| (came.p, came.at) == (p, at))
            .copied()
            .collect();
        for came in dropped {
            self.came.remove(&came);
            if !is_unknown {
                self.came.insert(RequestClosing { is_superseded: true, ..came });
            }
        }
    }
}

/// Stores an output unless there are already too many. The exact number beyond that does not
/// matter.
fn keep(outputs: &mut Vec<ObservedOutput>, most: usize, output: ObservedOutput) {
    if outputs.len() <= most {
        outputs.push(output);
    }
}

/// Orders results by how late a timestamp their values may be of. A value without `of` may be of
/// the latest.
type ValueOrder = (bool, u64);

impl OpenTimestamp {
    /// Returns `true` if the other open is a copy of this one on another line.
    const fn is_copied_by(&self, other: &Self) -> bool {
        self.at == other.at && self.line != other.line
    }
}

impl RequestClosing {
    const fn new(p: u64, at: u64, is_result: bool, attempt: Option<u8>) -> Self {
        Self { p, at, is_result, is_superseded: false, attempt, of: None, is_meant: None }
    }

    const fn value_order(&self) -> ValueOrder {
        match self.of {
            Some(of) => (false, of),
            None => (true, 0),
        }
    }
}

impl WholeMessageHistory<'_> {
    /// Returns the line of the first output.
    pub(super) fn line(&self) -> Option<u64> {
        self.outputs.iter().chain(self.finals).map(|output| output.line).min()
    }

    /// Returns `true` if it has an open that was not refused.
    pub(super) const fn is_opened(&self) -> bool {
        self.story.open.is_some()
    }

    /// Returns `true` if it has a result, a failure or an output.
    pub(super) const fn is_reported_of(&self) -> bool {
        let MessageHistory { results, outputs, .. } = &self.story;
        !(results.is_empty() && !self.has_failed && outputs.is_empty())
    }

    /// Returns `true` if nothing is left of it.
    pub(super) const fn is_none(&self) -> bool {
        let is_asked = !self.story.requests.is_empty() || self.stranger.is_some();
        !(self.is_opened() || is_asked || self.is_reported_of() || !self.finals.is_empty())
    }
}
