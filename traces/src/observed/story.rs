//! The observations of one timestamp, and a decision whether the rules can explain them.

use super::explain::{
    InstantRange, LAST, NEVER, ObservedFacts, ObservedSource, RetirementOutput, SourceTimer,
    WideInstant,
};
use super::progressive::{OutputTime, ProgressiveFacts};
use super::slack::SourceSlack;
use crate::event::Commit;

/// The observations of one timestamp. Instants are in ns.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct MessageHistory {
    /// The instant of its open, and local's deadline.
    pub open: Option<(u64, Option<u64>)>,
    /// The requests: the cloud's priority, the instant, and the due instant.
    pub requests: Vec<(u64, u64, u64)>,
    /// The results: the source's priority and the instant.
    pub results: Vec<(u64, u64)>,
    /// The failures: the source's priority and the instant.
    pub failures: Vec<(u64, u64)>,
    /// The outputs: the priority of the result's source, or `None` for a miss, and the instant.
    pub outputs: Vec<(Option<u64>, u64)>,
    /// The outputs that were said to be the last: the source's priority and the instant (F9).
    pub finals: Vec<(u64, u64)>,
    /// `true` if the operator has no local computation. Local then fails, at the latest when
    /// everything is requested.
    pub without_local: bool,
}

/// An output that the rules allow, and the instants at which it may be recorded.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AllowedOutput {
    /// The source whose result is sent, or `None` for a miss.
    pub p: Option<u64>,
    /// The first instant, in ns, at which it may be recorded.
    pub from: u64,
    /// The last instant, in ns, at which it may be recorded.
    pub to: u64,
}

impl MessageHistory {
    /// Returns `true` if some explanation fits, in a trace whose greatest instant is `end`.
    ///
    /// The answer is exact: `explain` describes the method, and the tests compare it with a search
    /// through all orders.
    #[must_use]
    pub fn is_explained(&self, commit: Commit, slack: impl Into<SourceSlack>, end: u64) -> bool {
        self.is_explained_within(commit, &slack.into(), end)
    }

    /// Returns the same, with tolerances by source.
    pub(super) fn is_explained_within(
        &self,
        commit: Commit,
        slack: &SourceSlack,
        end: u64,
    ) -> bool {
        if commit == Commit::Progressive {
            return self.is_explained_progressively(slack, end);
        }
        let Some((facts, priorities)) = self.facts(commit, slack, end) else { return false };
        match (&*self.outputs, &*self.finals) {
            ([], []) => {
                let after = InstantRange { from: unseen(slack, end), to: LAST };
                let emits = (0..priorities.len()).map(RetirementOutput::Emit);
                facts.stays_open()
                    || emits
                        .chain([RetirementOutput::Miss])
                        .any(|output| facts.yields(output, after))
            }
            ([(p, at)], []) => {
                let output = match p {
                    None => Some(RetirementOutput::Miss),
                    Some(p) => priorities.iter().position(|q| q == p).map(RetirementOutput::Emit),
                };
                output.is_some_and(|output| facts.yields(output, produced(*at, slack)))
            }
            _ => false,
        }
    }

    /// Returns the same under progressive, where each output is produced and the last one ends the
    /// timestamp.
    fn is_explained_progressively(&self, slack: &SourceSlack, end: u64) -> bool {
        let Some((facts, priorities)) = self.progressive(slack, end) else { return false };
        if !self.rises(slack) {
            return false;
        }
        match (&*self.outputs, &*self.finals) {
            ([(None, at)], []) => facts.facts.yields(RetirementOutput::Miss, produced(*at, slack)),
            ([], []) => {
                let after = InstantRange { from: unseen(slack, end), to: LAST };
                facts.is_explained() || facts.facts.yields(RetirementOutput::Miss, after)
            }
            (_, []) => facts.is_explained(),
            (_, [(p, at), ..]) => {
                let last = priorities.iter().position(|q| q == p);
                last.is_some_and(|last| facts.ends(last, produced(*at, slack)))
            }
        }
    }

    /// Returns `true` if the outputs rise in priority, as far as their stamps tell, and at most one
    /// final or miss ends them (P1, A54).
    pub(super) fn rises(&self, slack: &SourceSlack) -> bool {
        let twice = slack.tolerance().saturating_mul(2);
        let emits: Vec<_> = self.outputs.iter().filter_map(|(p, at)| Some(((*p)?, *at))).collect();
        let misses = self.outputs.len() - emits.len();
        let follows = |(p, at): (u64, u64), (before, then): (u64, u64)| {
            p > before && then <= at.saturating_add(twice)
        };
        let rises = |(i, emit): (usize, &(u64, u64))| {
            emits[..i].iter().all(|before| follows(*emit, *before) || follows(*before, *emit))
        };
        emits.iter().enumerate().all(rises)
            && misses + self.finals.len() < 2
            && (misses == 0 || emits.is_empty())
            && self.finals.iter().all(|(last, _)| emits.iter().all(|(p, _)| p <= last))
    }

    /// Returns the facts as intervals under progressive, with the production of each output, and
    /// the sources' priorities. Returns `None` if an output has no source or requests contradict
    /// each other.
    pub(super) fn progressive(
        &self,
        slack: &SourceSlack,
        end: u64,
    ) -> Option<(ProgressiveFacts, Vec<u64>)> {
        let (facts, priorities) = self.facts(Commit::Progressive, slack, end)?;
        let outputs = vec![OutputTime::NotBefore(unseen(slack, end)); priorities.len()];
        let mut facts = ProgressiveFacts { facts, outputs };
        for (p, at) in &self.outputs {
            let Some(p) = p else { continue };
            let q = priorities.iter().position(|q| q == p)?;
            *facts.outputs.get_mut(q)? = OutputTime::Within(produced(*at, slack));
        }
        Some((facts, priorities))
    }

    /// Returns the outputs that the rules allow for the other observations, and the instants at
    /// which each may be recorded. Returns none if those observations contradict each other.
    #[must_use]
    pub fn allowed(
        &self,
        commit: Commit,
        slack: impl Into<SourceSlack>,
        end: u64,
    ) -> Vec<AllowedOutput> {
        self.allowed_within(commit, &slack.into(), end)
    }

    /// Returns the same, with tolerances by source.
    pub(super) fn allowed_within(
        &self,
        commit: Commit,
        slack: &SourceSlack,
        end: u64,
    ) -> Vec<AllowedOutput> {
        let Some((facts, priorities)) = self.facts(commit, slack, end) else { return Vec::new() };
        // Other outputs may be sent too (F9).
        let progressive = (commit == Commit::Progressive).then(|| ProgressiveFacts::free(&facts));
        let emits = (0..priorities.len()).rev().map(RetirementOutput::Emit);
        let outputs = emits.chain([RetirementOutput::Miss]).filter_map(|output| {
            let (p, when) = match (output, &progressive) {
                (RetirementOutput::Emit(q), Some(facts)) => {
                    (priorities.get(q).copied(), facts.span(q)?)
                }
                (RetirementOutput::Emit(q), None) => {
                    (priorities.get(q).copied(), facts.span(output)?)
                }
                (RetirementOutput::Miss, _) => (None, facts.span(output)?),
            };
            Some(AllowedOutput::produced(p, when, slack))
        });
        outputs.collect()
    }

    /// Returns the facts as intervals, with the sources' priorities, or `None` if two requests or
    /// an order contradict each other.
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
        // The sources in ascending priority, each with its own facts.
        let most = self.requests.len() + 1;
        let (mut priorities, mut sources) = (Vec::with_capacity(most), Vec::with_capacity(most));
        priorities.push(0);
        sources.push(local);
        for (p, at, due) in &self.requests {
            let tolerance = slack.tolerance_of(*p);
            let requested = span(*at, tolerance);
            if requested.to < open {
                return None;
            }
            let timer = Some(timer(WideInstant::from(*due), tolerance));
            let source = ObservedSource { requested: requested.from.max(open), timer, ..local };
            let place = priorities.binary_search(p).err()?;
            priorities.insert(place, *p);
            sources.insert(place, source);
        }
        let events = self.results.iter().map(|event| (event, true));
        for ((p, at), is_result) in events.chain(self.failures.iter().map(|event| (event, false))) {
            let came = span(*at, slack.tolerance_of(*p));
            let known = priorities.binary_search(p).ok();
            let mut source = known.and_then(|place| sources.get_mut(place));
            if came.to < source.as_ref().map_or(open, |source| source.requested) {
                return None;
            }
            // A result of a cloud without a request, or of an absent local, is a drop.
            let is_source = *p > 0 || !self.without_local;
            let Some(source) = source.as_mut().filter(|_| is_source) else { continue };
            source.last = source.last.min(came.to);
            let kind = if is_result { &mut source.result } else { &mut source.failure };
            *kind = Some(kind.map_or(came.from, |from| from.min(came.from)));
        }
        if self.without_local {
            let all_requested = sources.iter().skip(1).map(|source| source.requested).max();
            let last = all_requested.unwrap_or(NEVER);
            sources[0] = ObservedSource { timer: None, failure: Some(open), last, ..local };
        }
        let is_eager = commit == Commit::Eager;
        Some((ObservedFacts { is_eager, open, sources }, priorities))
    }
}

impl AllowedOutput {
    /// Returns the allowed output that is produced at these instants.
    pub(super) fn produced(p: Option<u64>, when: InstantRange, slack: &SourceSlack) -> Self {
        let [tolerance, lateness] = [slack.tolerance(), slack.lateness()].map(WideInstant::from);
        let within = |at: WideInstant| u64::try_from(at).unwrap_or(u64::MAX);
        let from = within(when.from.saturating_sub(tolerance));
        Self { p, from, to: within(when.to + lateness + tolerance) }
    }
}

/// Returns the instants at which an output that was recorded at `at` was produced.
pub(super) fn produced(at: u64, slack: &SourceSlack) -> InstantRange {
    let [at, tolerance, lateness] =
        [at, slack.tolerance(), slack.lateness()].map(WideInstant::from);
    InstantRange { from: at.saturating_sub(tolerance + lateness), to: at + tolerance }
}

/// Returns the instant from which on an output may be missing in a trace that ends at `end`.
fn unseen(slack: &SourceSlack, end: u64) -> WideInstant {
    let [tolerance, lateness, end] =
        [slack.tolerance(), slack.lateness(), end].map(WideInstant::from);
    (end + 1).saturating_sub(tolerance + lateness)
}

#[cfg(test)]
mod tests;
