//! What was observed of one timestamp, and whether the rules can explain it.

use std::collections::{BTreeMap, BTreeSet};

use super::explain::{
    InstantRange, LAST, NEVER, ObservedFacts, ObservedSource, RetirementOutput, SourceTimer,
    WideInstant,
};
use super::slack::SourceSlack;
use crate::event::Commit;

/// What was observed of one timestamp.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct MessageHistory {
    /// When it was opened, and with which deadline.
    pub open: Option<(u64, Option<u64>)>,
    /// The clouds' priorities, when each was requested, and its due instant.
    pub requests: Vec<(u64, u64, u64)>,
    /// Whose results came, and when.
    pub results: Vec<(u64, u64)>,
    /// Whose failures came, and when.
    pub failures: Vec<(u64, u64)>,
    /// Whose result was sent, or none for a miss, and when.
    pub outputs: Vec<(Option<u64>, u64)>,
    /// Whether the operator has no local computation: local fails then, at the latest when all is requested.
    pub without_local: bool,
}

/// An output that the rules allow, and between which instants.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AllowedOutput {
    /// Whose result is sent; none for a miss.
    pub p: Option<u64>,
    /// The first instant at which it may be recorded.
    pub from: u64,
    /// The last one.
    pub to: u64,
}

impl MessageHistory {
    /// Whether some explanation of it fits, in a trace whose greatest instant is `end`.
    ///
    /// Nothing is forwarded that has no explanation, and nothing that has one is refused: see `explain` for the way, and the tests
    /// for a search through all orders.
    #[must_use]
    pub fn is_explained(&self, commit: Commit, slack: impl Into<SourceSlack>, end: u64) -> bool {
        self.is_explained_within(commit, &slack.into(), end)
    }

    /// The same with tolerances by source.
    pub(super) fn is_explained_within(
        &self,
        commit: Commit,
        slack: &SourceSlack,
        end: u64,
    ) -> bool {
        let Some((facts, priorities)) = self.facts(commit, slack, end) else { return false };
        let slack = [slack.tolerance(), slack.lateness()].map(WideInstant::from);
        match *self.outputs {
            [] => {
                let from = (WideInstant::from(end) + 1).saturating_sub(slack[0] + slack[1]);
                let after = InstantRange { from, to: LAST };
                let emits = (0..priorities.len()).map(RetirementOutput::Emit);
                facts.stays_open()
                    || emits
                        .chain([RetirementOutput::Miss])
                        .any(|output| facts.yields(output, after))
            }
            [(p, at)] => {
                let at = WideInstant::from(at);
                let when = InstantRange {
                    from: at.saturating_sub(slack[0] + slack[1]),
                    to: at + slack[0],
                };
                let output = match p {
                    None => Some(RetirementOutput::Miss),
                    Some(p) => priorities.iter().position(|q| *q == p).map(RetirementOutput::Emit),
                };
                output.is_some_and(|output| facts.yields(output, when))
            }
            _ => false,
        }
    }

    /// What the rules can bring out of the rest of it, and between which instants it may be recorded; none at all if the rest
    /// contradicts itself.
    #[must_use]
    pub fn allowed(
        &self,
        commit: Commit,
        slack: impl Into<SourceSlack>,
        end: u64,
    ) -> Vec<AllowedOutput> {
        self.allowed_within(commit, &slack.into(), end)
    }

    /// The same with tolerances by source.
    pub(super) fn allowed_within(
        &self,
        commit: Commit,
        slack: &SourceSlack,
        end: u64,
    ) -> Vec<AllowedOutput> {
        let Some((facts, priorities)) = self.facts(commit, slack, end) else { return Vec::new() };
        let [tolerance, lateness] = [slack.tolerance(), slack.lateness()].map(WideInstant::from);
        let within = |at: WideInstant| u64::try_from(at).unwrap_or(u64::MAX);
        let emits = (0..priorities.len()).rev().map(RetirementOutput::Emit);
        let outputs = emits.chain([RetirementOutput::Miss]).filter_map(|output| {
            let InstantRange { from, to } = facts.span(output)?;
            let p = match output {
                RetirementOutput::Emit(q) => priorities.get(q).copied(),
                RetirementOutput::Miss => None,
            };
            let from = within(from.saturating_sub(tolerance));
            Some(AllowedOutput { p, from, to: within(to + lateness + tolerance) })
        });
        outputs.collect()
    }

    /// As intervals, with the priorities of the sources; none if two requests or an order contradict each other.
    fn facts(
        &self,
        commit: Commit,
        slack: &SourceSlack,
        end: u64,
    ) -> Option<(ObservedFacts, Vec<u64>)> {
        let (lateness, end) = (WideInstant::from(slack.lateness()), WideInstant::from(end));
        let span = |at: u64, tolerance: u64| {
            let (at, tolerance) = (WideInstant::from(at), WideInstant::from(tolerance));
            InstantRange { from: at.saturating_sub(tolerance), to: at + tolerance }
        };
        // A due instant counts from the stamp of its open or request, and has its error.
        let timer = |due: WideInstant, tolerance: u64| {
            let to = due + lateness + WideInstant::from(tolerance);
            let from = due.saturating_sub(WideInstant::from(tolerance));
            SourceTimer { served: InstantRange { from, to }, by: if to > end { NEVER } else { to } }
        };
        let own = slack.tolerance();
        let open = self.open.map_or(0, |(at, _)| span(at, own).from);
        let deadline = self
            .open
            .and_then(|(at, deadline)| Some(WideInstant::from(at) + WideInstant::from(deadline?)));
        let local = ObservedSource {
            requested: open,
            timer: deadline.map(|due| timer(due, own)),
            result: None,
            failure: None,
            last: NEVER,
        };
        let mut sources = BTreeMap::from([(0, local)]);
        for (p, at, due) in &self.requests {
            let tolerance = slack.tolerance_of(*p);
            let requested = span(*at, tolerance);
            if requested.to < open {
                return None;
            }
            let timer = Some(timer(WideInstant::from(*due), tolerance));
            let source = ObservedSource { requested: requested.from.max(open), timer, ..local };
            if sources.insert(*p, source).is_some() {
                return None;
            }
        }
        let events = self.results.iter().map(|event| (event, true));
        for ((p, at), is_result) in events.chain(self.failures.iter().map(|event| (event, false))) {
            let came = span(*at, slack.tolerance_of(*p));
            if came.to < sources.get(p).map_or(open, |source| source.requested) {
                return None;
            }
            // Of a cloud without a request, or of local where there is none: a drop.
            let is_source = *p > 0 || !self.without_local;
            let Some(source) = sources.get_mut(p).filter(|_| is_source) else { continue };
            source.last = source.last.min(came.to);
            let kind = if is_result { &mut source.result } else { &mut source.failure };
            *kind = Some(kind.map_or(came.from, |from| from.min(came.from)));
        }
        if self.without_local {
            let all_requested = sources.values().skip(1).map(|source| source.requested).max();
            let last = all_requested.unwrap_or(NEVER);
            sources.insert(0, ObservedSource { timer: None, failure: Some(open), last, ..local });
        }
        let priorities: BTreeSet<u64> = sources.keys().copied().collect();
        let is_eager = commit == Commit::Eager;
        let facts = ObservedFacts { is_eager, open, sources: sources.into_values().collect() };
        Some((facts, priorities.into_iter().collect()))
    }
}

#[cfg(test)]
mod tests;
