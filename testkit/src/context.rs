//! Follows a run while it happens: which reasons hold for an input, and what is due.
//!
//! It follows the decisions of the reference machine and makes none of its own. Generators use it
//! to find edges, and `coverage` uses it to count them.

use std::collections::{BTreeMap, BTreeSet};

use fuseline_traces::{
    Cloud, Commit, Decision, DropReason, ExpectedDecisions, Header, Input, OfferRefusal,
    OpenRefusal, Reference,
};

use crate::history::History;

/// The number of open timestamps, from the newest back, that are searched.
const RECENT: usize = 16;

/// The reference machine with its inputs and decisions so far.
#[derive(Clone, Debug)]
pub struct RunContext {
    reference: Reference,
    commit: Commit,
    window: usize,
    gates: BTreeMap<u64, Gate>,
    /// The greatest timestamp ever opened.
    newest: Option<u64>,
    /// Every timestamp ever opened. A retired one stays as it was at its end.
    histories: BTreeMap<u64, History>,
    open: BTreeSet<u64>,
    requested: Vec<(u64, u64)>,
}

/// One cloud's gate.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Gate {
    /// The backlog that shuts the gate.
    pub limit: u64,
    /// The backlog at or below which it opens again.
    pub resume: u64,
    /// `true` if the gate is shut.
    pub is_shut: bool,
}

/// The decisions that the rules demand for an input.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RuleDecision {
    /// The decisions of the timers that fired first.
    pub fired: ExpectedDecisions,
    /// The decisions about the input itself.
    pub own: ExpectedDecisions,
    /// The reasons that hold for the input, in the order in which they are checked.
    pub reasons: HoldingReasons,
}

/// All reasons that hold for an input. The first of them decides.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum HoldingReasons {
    /// A tick has no reasons.
    None,
    /// Reasons to refuse an open.
    Open(Vec<OpenRefusal>),
    /// Reasons to refuse an offer.
    Offer(Vec<OfferRefusal>),
    /// Reasons to drop a result.
    Result(Vec<DropReason>),
    /// Reasons to drop a failure.
    Fail(Vec<DropReason>),
}

impl RuleDecision {
    /// Returns all decisions in the order of the trace.
    pub fn decisions(&self) -> impl Iterator<Item = &Decision> {
        self.fired.iter().chain(&self.own).map(|(decision, _)| decision)
    }

    /// Returns the timestamp and the source of a result that is sent, by the input itself rather
    /// than by a timer.
    pub(crate) fn sent(&self) -> Option<(u64, u64)> {
        self.own.iter().chain(&self.fired).find_map(|(decision, _)| match decision {
            Decision::Emit { t, p, .. } => Some((*t, *p)),
            _ => None,
        })
    }
}

impl RunContext {
    /// Creates the context of an operator with this configuration, before its first input.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        let gate = |cloud: &Cloud| {
            let Cloud { limit, resume, .. } = *cloud;
            (u64::from(cloud.p), Gate { limit, resume, is_shut: false })
        };
        Self {
            reference: Reference::new(header),
            commit: header.commit,
            window: header.window.into(),
            gates: header.clouds.iter().map(gate).collect(),
            newest: None,
            histories: BTreeMap::new(),
            open: BTreeSet::new(),
            requested: Vec::new(),
        }
    }

    /// Applies an input and returns the decisions about it.
    pub fn apply(&mut self, input: &Input) -> RuleDecision {
        let (mut fired, mut own) = (ExpectedDecisions::new(), ExpectedDecisions::new());
        // A tick just before changes nothing (P10), and separates the timers' decisions from the
        // input's.
        self.reference.apply(&Input::Tick { at: input.at() }, &mut fired);
        for (decision, _) in &fired {
            self.follow(decision);
        }
        let reasons = self.reasons(input);
        self.reference.apply(input, &mut own);
        self.accept(input, &own);
        for (decision, _) in &own {
            self.follow(decision);
        }
        let ended = match *input {
            Input::Result { t, .. } | Input::Fail { t, .. } => Some(t),
            Input::Open { .. } | Input::Offer { .. } | Input::Tick { .. } => None,
        };
        if ended.is_some() || !fired.is_empty() {
            let (open, histories) = (&self.open, &self.histories);
            self.requested.retain(|(t, p)| {
                let is_concerned = !fired.is_empty() || Some(*t) == ended;
                let is_pending = |history: &History| history.is_pending(*p);
                !is_concerned || open.contains(t) && histories.get(t).is_some_and(is_pending)
            });
        }
        RuleDecision { fired, own, reasons }
    }

    /// Returns the greatest instant seen, in ns.
    #[must_use]
    pub const fn now(&self) -> u64 {
        self.reference.now()
    }

    /// Returns the next due instant, in ns.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.reference.next_due()
    }

    /// Returns the commit rule.
    #[must_use]
    pub const fn commit(&self) -> Commit {
        self.commit
    }

    /// Returns the greatest number of timestamps that may be open.
    #[must_use]
    pub const fn window(&self) -> usize {
        self.window
    }

    /// Returns the open timestamps, ascending.
    #[must_use]
    pub const fn open(&self) -> &BTreeSet<u64> {
        &self.open
    }

    /// Returns the pending requests, with local's, as timestamps and priorities. The latest is
    /// last.
    #[must_use]
    pub fn requested(&self) -> &[(u64, u64)] {
        &self.requested
    }

    /// Returns a request that would be outranked by an available result and was not made before, if
    /// there is one.
    #[must_use]
    pub fn outranked(&self) -> Option<(u64, u64)> {
        self.open.iter().rev().take(RECENT).find_map(|t| {
            let history = self.histories.get(t)?;
            let best = history.best()?;
            let below = self.gates.range(..best).map(|(p, _)| *p);
            Some((*t, below.rev().find(|p| !history.is_requested(*p))?))
        })
    }

    /// Returns the due instant of the request `(t, p)` in ns, even if it has passed. For local it
    /// is the end of its deadline.
    #[must_use]
    pub fn due(&self, t: u64, p: u64) -> Option<u64> {
        self.histories.get(&t)?.requested_for(p)
    }

    /// Returns the gate of a registered cloud.
    #[must_use]
    pub fn gate(&self, p: u64) -> Option<&Gate> {
        self.gates.get(&p)
    }

    /// Returns the reasons that hold for an input after all due timers have fired.
    fn reasons(&self, input: &Input) -> HoldingReasons {
        match *input {
            Input::Open { t, deadline, .. } => HoldingReasons::Open(self.open_reasons(t, deadline)),
            Input::Offer { t, p, deadline, backlog, .. } => {
                HoldingReasons::Offer(self.offer_reasons(t, p, deadline, backlog))
            }
            Input::Result { t, p, .. } => HoldingReasons::Result(self.drop_reasons(t, p)),
            Input::Fail { t, p, .. } => HoldingReasons::Fail(self.drop_reasons(t, p)),
            Input::Tick { .. } => HoldingReasons::None,
        }
    }

    /// Returns the reasons to refuse an open (F1).
    fn open_reasons(&self, t: u64, deadline: Option<u64>) -> Vec<OpenRefusal> {
        holding([
            (OpenRefusal::Order, self.was_reached(t)),
            (OpenRefusal::Full, self.open.len() >= self.window),
            (OpenRefusal::Deadline, deadline.is_some_and(|deadline| self.is_past(deadline))),
        ])
    }

    /// Returns the reasons to refuse an offer (F2).
    ///
    /// The sets of a retired timestamp count as they were at its end, because a machine that forgot
    /// that it is closed would look there.
    fn offer_reasons(&self, t: u64, p: u64, deadline: u64, backlog: u64) -> Vec<OfferRefusal> {
        let (gate, history) = (self.gates.get(&p), self.histories.get(&t));
        let shut = |gate: &Gate| {
            if gate.is_shut { backlog > gate.resume } else { backlog >= gate.limit }
        };
        holding([
            (OfferRefusal::Unknown, gate.is_none() || !self.was_reached(t)),
            (OfferRefusal::Closed, !self.open.contains(&t)),
            (OfferRefusal::Duplicate, history.is_some_and(|history| history.is_requested(p))),
            (OfferRefusal::Outranked, history.and_then(History::best).is_some_and(|best| best > p)),
            (OfferRefusal::Deadline, self.is_past(deadline)),
            (OfferRefusal::Queue, gate.is_some_and(shut)),
        ])
    }

    /// Returns the reasons to drop a result or a failure (F3, F4). Retired timestamps count as for
    /// offers (A16).
    fn drop_reasons(&self, t: u64, p: u64) -> Vec<DropReason> {
        let known = (p == 0 || self.gates.contains_key(&p)) && self.was_reached(t);
        let mut reasons = holding([
            (DropReason::Unknown, !known),
            (DropReason::Superseded, !self.open.contains(&t) || self.is_outranked(t, p)),
        ]);
        if let Some(history) = self.histories.get(&t) {
            let is_over = history.requested_for(p).is_some_and(|due| due <= self.now());
            reasons.extend(holding([
                (DropReason::Unsolicited, !history.is_requested(p)),
                (DropReason::Duplicate, history.is_held(p)),
                (DropReason::Late, !history.is_pending(p) || is_over),
            ]));
        }
        reasons
    }

    /// Returns `true` if the last output of a timestamp outranks `p` (F9).
    fn is_outranked(&self, t: u64, p: u64) -> bool {
        let best = self.histories.get(&t).and_then(History::best);
        self.commit == Commit::Progressive && best.is_some_and(|best| best > p)
    }

    /// Notes an open or a failure that was accepted, which no decision states.
    fn accept(&mut self, input: &Input, own: &ExpectedDecisions) {
        match *input {
            Input::Open { t, deadline, .. } if own.is_empty() => {
                let due = deadline.map(|deadline| self.now().saturating_add(deadline));
                self.histories.insert(t, History::new(due));
                self.open.insert(t);
                self.requested.push((t, 0));
                self.newest = Some(t);
            }
            Input::Fail { t, p, .. }
                if !matches!(own.first(), Some((Decision::Drop { .. }, _))) =>
            {
                self.close(t, p);
            }
            Input::Open { .. }
            | Input::Offer { .. }
            | Input::Result { .. }
            | Input::Fail { .. }
            | Input::Tick { .. } => {}
        }
    }

    /// Notes a decision.
    fn follow(&mut self, decision: &Decision) {
        match *decision {
            Decision::Timer { t, p, .. } => self.close(t, p),
            Decision::Request { t, p, due, .. } => {
                if let Some(history) = self.histories.get_mut(&t) {
                    history.ask(p, Some(due));
                }
                self.requested.push((t, p));
                self.turn_gate(p, false);
            }
            Decision::RefuseOffer { p, why: OfferRefusal::Queue, .. } => self.turn_gate(p, true),
            Decision::Hold { t, p, .. } => self.take(t, p),
            // The timestamp stays open until it is final (F9).
            Decision::Emit { t, p, .. } if self.commit == Commit::Progressive => {
                self.take(t, p);
                if let Some(history) = self.histories.get_mut(&t) {
                    let outranked: Vec<u64> = history.pending().take_while(|q| *q < p).collect();
                    for lower in outranked {
                        history.close(lower);
                    }
                }
            }
            Decision::Emit { t, p, .. } => {
                self.take(t, p);
                self.open.remove(&t);
            }
            Decision::Final { t, .. } | Decision::Miss { t, .. } => {
                self.open.remove(&t);
            }
            Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Drop { .. }
            | Decision::Cancel { .. } => {}
        }
    }

    fn close(&mut self, t: u64, p: u64) {
        if let Some(history) = self.histories.get_mut(&t) {
            history.close(p);
        }
    }

    fn take(&mut self, t: u64, p: u64) {
        if let Some(history) = self.histories.get_mut(&t) {
            history.hold(p, false);
        }
    }

    fn turn_gate(&mut self, p: u64, is_shut: bool) {
        if let Some(gate) = self.gates.get_mut(&p) {
            gate.is_shut = is_shut;
        }
    }

    fn was_reached(&self, t: u64) -> bool {
        self.newest.is_some_and(|newest| newest >= t)
    }

    fn is_past(&self, span: u64) -> bool {
        self.now().saturating_add(span) <= self.now()
    }
}

/// Returns the reasons that hold.
fn holding<T: Copy, const N: usize>(reasons: [(T, bool); N]) -> Vec<T> {
    reasons.iter().filter(|(_, holds)| *holds).map(|(reason, _)| *reason).collect()
}
