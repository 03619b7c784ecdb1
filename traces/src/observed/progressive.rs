//! Decides whether the rules can explain what was observed of one timestamp under the progressive
//! rule (F9).
//!
//! An explanation is one under patient in which each accepted result that outranks all before it is
//! sent when it comes (P13). So what `explain` says of patient holds here too. Requests come as
//! early as they can, and each source is pending as long as it can be. A source whose output was
//! observed sends it at an instant that fits. Any other source must not send so early that the
//! trace would show it:
//!
//! - **Pending until it is outranked or closed** is best. Nothing else ends earlier because of it,
//!   and while a source that outranks it is pending, nothing is retired.
//! - **Sent unseen**, as late as it can, is the second choice: whatever it outranks ends then.
//! - **Otherwise it must be outranked in time.** The next observed source above it must then send
//!   no later.
//!
//! So the latest course of each source, from the highest down, is best for all sources below it. If
//! a `final` was observed, the last output is tried as the retirement at each instant at which
//! something becomes possible. For `n` clouds these are at most `3n + 4` instants, each in O(`n`³)
//! steps. If none was observed, one try suffices, or one for each source if there is no output.

use super::explain::{InstantRange, LAST, NEVER, ObservedFacts, WideInstant, reach};

/// An instant after all instants of a trace, and before [`NEVER`].
const FOREVER: WideInstant = NEVER - 1;

/// All instants.
pub(super) const ALWAYS: InstantRange = InstantRange { from: 0, to: LAST };

/// The instants at which the output of a source is produced.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum OutputTime {
    /// The output was observed, so it is produced within this range.
    Within(InstantRange),
    /// The output is produced at this instant or later, or not at all.
    NotBefore(WideInstant),
}

/// Everything that was observed of one timestamp, with its outputs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct ProgressiveFacts {
    pub(super) facts: ObservedFacts,
    /// The outputs of its sources, in the order of the sources.
    pub(super) outputs: Vec<OutputTime>,
}

impl ProgressiveFacts {
    /// Returns facts whose outputs may be produced at any time.
    pub(super) fn free(facts: &ObservedFacts) -> Self {
        let outputs = vec![OutputTime::NotBefore(0); facts.sources.len()];
        Self { facts: facts.clone(), outputs }
    }

    /// Returns `true` if some explanation has these outputs, whenever it retires the timestamp.
    /// An explanation without outputs does not retire the timestamp.
    pub(super) fn is_explained(&self) -> bool {
        let ready = self.facts.ready();
        if self.outputs.iter().any(|output| output.is_observed()) {
            return self.is_timeline(None, FOREVER, ready);
        }
        let mut unseen = self.outputs.iter().enumerate().map(|(q, _)| self.with(q, ALWAYS));
        self.is_timeline(None, FOREVER, FOREVER)
            || unseen.any(|with| with.is_timeline(None, FOREVER, ready))
    }

    /// Returns `true` if some explanation has these outputs, sends the output of source `last`
    /// last, and retires the timestamp at an instant of `when`.
    pub(super) fn ends(&self, last: usize, when: InstantRange) -> bool {
        let from = when.from.max(self.facts.ready());
        let mut above = self.outputs.iter().skip(last + 1);
        let mut instants = self.instants(InstantRange { from, to: when.to });
        above.all(|output| !output.is_observed())
            && instants.any(|at| self.is_timeline(Some(last), at, at))
    }

    /// Returns the same facts with an output of source `q`, produced within `when` as far as that
    /// is possible.
    pub(super) fn with(&self, q: usize, when: InstantRange) -> Self {
        let mut with = self.clone();
        if let Some(output) = with.outputs.get_mut(q) {
            let InstantRange { from, to } = when;
            *output = OutputTime::Within(match *output {
                OutputTime::Within(when) => {
                    InstantRange { from: from.max(when.from), to: to.min(when.to) }
                }
                OutputTime::NotBefore(first) => InstantRange { from: from.max(first), to },
            });
        }
        with
    }

    /// Returns the first and the last instant at which the output of source `q` may be produced,
    /// given the others.
    pub(super) fn span(&self, q: usize) -> Option<InstantRange> {
        span(|when| self.with(q, when).is_explained())
    }

    /// Returns the instants in `when` to try as the retirement: its beginning, and each instant at
    /// which something becomes possible.
    fn instants(&self, when: InstantRange) -> impl Iterator<Item = WideInstant> {
        let begins =
            self.facts.sources.iter().enumerate().flat_map(|(q, source)| {
                [self.sends(q).from, source.fails().from, source.fires().from]
            });
        let later = begins.filter(move |begin| when.from < *begin && *begin <= when.to);
        Some(when.from).filter(|from| *from <= when.to).into_iter().chain(later)
    }

    /// Returns `true` if all sources can have a course that gives these outputs and leaves the
    /// timestamp open at least until `by`. If the last output is known, the timestamp is retired at
    /// `at`.
    fn is_timeline(&self, last: Option<usize>, at: WideInstant, by: WideInstant) -> bool {
        let mut outranked = at;
        let mut pending: Vec<InstantRange> = Vec::with_capacity(self.facts.sources.len());
        for (q, source) in self.facts.sources.iter().enumerate().rev() {
            let is_sent = self.outputs[q].is_observed() || last == Some(q);
            let may_be_sent = last.is_none_or(|last| q <= last);
            // A source that outranks the last output is closed at the retirement.
            let may_stay = last.is_none_or(|last| q < last);
            let unsent = self.unsent(q, outranked, may_stay).filter(|_| !is_sent);
            // A source that outranks it is pending from then on (P4, P7).
            let sent = self.sent(q, outranked).filter(|sent| reach(&pending, *sent) >= by);
            let sent = sent.filter(|_| may_be_sent);
            let Some(until) = sent.max(unsent) else { return false };
            outranked = sent.filter(|sent| *sent == until).unwrap_or(outranked);
            pending.push(InstantRange { from: source.requested, to: until });
        }
        reach(&pending, self.facts.open) >= by
    }

    /// Returns the latest instant at which the output of a source can be produced, if the next
    /// source above it sends at `outranked`.
    fn sent(&self, q: usize, outranked: WideInstant) -> Option<WideInstant> {
        let InstantRange { from, to } = self.sends(q);
        let below = &self.outputs[..q];
        let observed = |r: &usize| below[*r].is_observed();
        // The observed outputs of lower sources come earlier (P1).
        let from = (0..q).filter(observed).map(|r| self.sends(r).from).fold(from, WideInstant::max);
        let at = to.min(outranked).min(self.limit(q));
        (from <= at).then_some(at)
    }

    /// Returns the instant until which a source that does not send can be pending. It is pending
    /// until it is outranked, if it may stay that long, or until it is closed.
    fn unsent(&self, q: usize, outranked: WideInstant, may_stay: bool) -> Option<WideInstant> {
        let source = &self.facts.sources[q];
        if may_stay && outranked.max(source.requested) <= source.lasts() {
            return Some(outranked);
        }
        let closes = [source.fails(), source.fires()];
        let possible = closes.into_iter().filter(|span| span.from <= span.to.min(outranked));
        possible.map(|span| span.to.min(outranked)).max()
    }

    /// Returns the instant by which an observed output must be produced because of the sources that
    /// it outranks.
    fn limit(&self, q: usize) -> WideInstant {
        if !self.outputs[q].is_observed() {
            return NEVER;
        }
        let below = (0..q).rev().take_while(|r| !self.outputs[*r].is_observed());
        let waits = below.filter(|r| {
            let source = &self.facts.sources[*r];
            [self.sends(*r), source.fails(), source.fires()].iter().all(|span| span.from > span.to)
        });
        waits.map(|r| self.facts.sources[r].lasts()).min().unwrap_or(NEVER)
    }

    /// Returns the instants at which the output of a source can be produced, considering only that
    /// source.
    fn sends(&self, q: usize) -> InstantRange {
        let InstantRange { from, to } = self.facts.sources[q].returns();
        match self.outputs[q] {
            OutputTime::Within(when) => {
                InstantRange { from: from.max(when.from), to: to.min(when.to) }
            }
            OutputTime::NotBefore(first) => InstantRange { from: from.max(first), to },
        }
    }
}

impl OutputTime {
    pub(super) const fn is_observed(self) -> bool {
        match self {
            Self::Within(_) => true,
            Self::NotBefore(_) => false,
        }
    }
}

/// Returns the first and the last instant of an event, given a function that says whether the event
/// may be within a range.
pub(super) fn span(may_be_within: impl Fn(InstantRange) -> bool) -> Option<InstantRange> {
    if !may_be_within(ALWAYS) {
        return None;
    }
    let (mut from, mut before) = (LAST, 0);
    while before < from {
        let middle = before + (from - before) / 2;
        let is_by = may_be_within(InstantRange { from: 0, to: middle });
        (from, before) = if is_by { (middle, before) } else { (from, middle + 1) };
    }
    let (mut to, mut beyond) = (from, LAST + 1);
    while to + 1 < beyond {
        let middle = to + (beyond - to) / 2;
        let is_later = may_be_within(InstantRange { from: middle, to: LAST });
        (to, beyond) = if is_later { (middle, beyond) } else { (to, middle) };
    }
    Some(InstantRange { from, to })
}
