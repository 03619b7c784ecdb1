//! Whether the rules can explain what was observed of one timestamp under progressive (F9).
//!
//! By P13 an explanation is one under patient, in which each accepted result that outranks all before it is sent when it comes.
//! So what `explain` says of patient holds: requests as early as they can, each source pending as long as it can. A source
//! that was observed to be sent is so at an instant that fits. Any other must not be sent so early that the trace would show it:
//!
//! - **Pending until it is outranked or closed** is best: nothing else ends earlier for it, and as long as what outranks it is
//!   pending, nothing is retired.
//! - **Sent unseen** is what is left, as late as it can: what it outranks ends then.
//! - **Else it must be outranked in time.** The next one above it that was observed is then sent no later.
//!
//! So from the highest source down the latest course of each is the best for all below it. What was sent last, with each
//! instant at which something becomes possible, is tried as the retirement where a `final` was observed: for `n` clouds at most
//! `3n + 4` instants, each in O(`n`³) steps. Where none was, one look is enough; one a source if nothing came out.

use super::explain::{InstantRange, LAST, NEVER, ObservedFacts, WideInstant, reach};

/// After all instants of a trace, and before none at all.
const FOREVER: WideInstant = NEVER - 1;

/// All instants.
pub(super) const ALWAYS: InstantRange = InstantRange { from: 0, to: LAST };

/// When the output of a source is produced.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum OutputTime {
    /// At one of these instants: it was observed.
    Within(InstantRange),
    /// Not at all, or from this instant on.
    NotBefore(WideInstant),
}

/// All that was observed of one timestamp, and what came out of it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct ProgressiveFacts {
    pub(super) facts: ObservedFacts,
    /// Those of its sources, in the same order.
    pub(super) outputs: Vec<OutputTime>,
}

impl ProgressiveFacts {
    /// Of which any output may be produced at any time.
    pub(super) fn free(facts: &ObservedFacts) -> Self {
        let outputs = vec![OutputTime::NotBefore(0); facts.sources.len()];
        Self { facts: facts.clone(), outputs }
    }

    /// Whether some explanation has these outputs, whenever it retires the timestamp, if it does. Without any it does not.
    pub(super) fn is_explained(&self) -> bool {
        let ready = self.facts.ready();
        if self.outputs.iter().any(|output| output.is_observed()) {
            return self.is_timeline(None, FOREVER, ready);
        }
        let mut unseen = self.outputs.iter().enumerate().map(|(q, _)| self.with(q, ALWAYS));
        self.is_timeline(None, FOREVER, FOREVER)
            || unseen.any(|with| with.is_timeline(None, FOREVER, ready))
    }

    /// Whether some explanation has these outputs, the one of this source being the last, and retires the timestamp at an instant
    /// of `when`.
    pub(super) fn ends(&self, last: usize, when: InstantRange) -> bool {
        let from = when.from.max(self.facts.ready());
        let mut above = self.outputs.iter().skip(last + 1);
        let mut instants = self.instants(InstantRange { from, to: when.to });
        above.all(|output| !output.is_observed())
            && instants.any(|at| self.is_timeline(Some(last), at, at))
    }

    /// The same with an output of this source, produced within `when`, as far as that may be.
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

    /// The first and the last instant at which the output of this source may be produced, the others being as they are.
    pub(super) fn span(&self, q: usize) -> Option<InstantRange> {
        span(|when| self.with(q, when).is_explained())
    }

    /// The instants in `when` to try as the retirement: its beginning, and wherever something becomes possible.
    fn instants(&self, when: InstantRange) -> impl Iterator<Item = WideInstant> {
        let begins =
            self.facts.sources.iter().enumerate().flat_map(|(q, source)| {
                [self.sends(q).from, source.fails().from, source.fires().from]
            });
        let later = begins.filter(move |begin| when.from < *begin && *begin <= when.to);
        Some(when.from).filter(|from| *from <= when.to).into_iter().chain(later)
    }

    /// Whether all sources can have a course that brings these outputs, and leaves the timestamp open until `by` at least. Where it
    /// is known which was the last, it is retired `at` then.
    fn is_timeline(&self, last: Option<usize>, at: WideInstant, by: WideInstant) -> bool {
        let mut outranked = at;
        let mut pending: Vec<InstantRange> = Vec::with_capacity(self.facts.sources.len());
        for (q, source) in self.facts.sources.iter().enumerate().rev() {
            let is_sent = self.outputs[q].is_observed() || last == Some(q);
            let may_be_sent = last.is_none_or(|last| q <= last);
            // What outranks the last output is closed at the retirement.
            let may_stay = last.is_none_or(|last| q < last);
            let unsent = self.unsent(q, outranked, may_stay).filter(|_| !is_sent);
            // P4, P7: what outranks it is pending from then on.
            let sent = self.sent(q, outranked).filter(|sent| reach(&pending, *sent) >= by);
            let sent = sent.filter(|_| may_be_sent);
            let Some(until) = sent.max(unsent) else { return false };
            outranked = sent.filter(|sent| *sent == until).unwrap_or(outranked);
            pending.push(InstantRange { from: source.requested, to: until });
        }
        reach(&pending, self.facts.open) >= by
    }

    /// The latest instant at which the output of a source can be produced, what is above it being sent at `outranked`.
    fn sent(&self, q: usize, outranked: WideInstant) -> Option<WideInstant> {
        let InstantRange { from, to } = self.sends(q);
        let below = &self.outputs[..q];
        let observed = |r: &usize| below[*r].is_observed();
        // P1: what was observed of those below comes before.
        let from = (0..q).filter(observed).map(|r| self.sends(r).from).fold(from, WideInstant::max);
        let at = to.min(outranked).min(self.limit(q));
        (from <= at).then_some(at)
    }

    /// Until when a source can be pending that is not sent: until it is outranked, if it may stay so long, or is closed.
    fn unsent(&self, q: usize, outranked: WideInstant, may_stay: bool) -> Option<WideInstant> {
        let source = &self.facts.sources[q];
        if may_stay && outranked.max(source.requested) <= source.lasts() {
            return Some(outranked);
        }
        let closes = [source.fails(), source.fires()];
        let possible = closes.into_iter().filter(|span| span.from <= span.to.min(outranked));
        possible.map(|span| span.to.min(outranked)).max()
    }

    /// By when the output of a source must be produced, if it was observed, for the sake of those that it outranks.
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

    /// When the output of a source can be produced, as far as it goes by the source alone.
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

/// The first and the last instant of something, of which it is known whether it may be within any range.
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
