//! What is known of a run while it happens: which reasons hold for an input, and what is due.
//!
//! It follows the reference machine's decisions and makes none of its own.

use std::collections::{BTreeMap, BTreeSet};

use fuseline_traces::{
    Cloud, Decision, Demands, DropReason, Header, Input, OfferRefusal, OpenRefusal, Reference,
};

/// How far back an open timestamp is looked for.
const RECENT: usize = 16;

/// The reference machine with all that it was told and decided.
pub(super) struct Scene {
    reference: Reference,
    pub(super) window: usize,
    gates: BTreeMap<u64, Gate>,
    /// The greatest timestamp ever opened.
    newest: Option<u64>,
    /// Every timestamp ever opened.
    tales: BTreeMap<u64, Tale>,
    open: BTreeSet<u64>,
    /// Requests that are pending, the latest last.
    pub(super) asked: Vec<(u64, u64)>,
}

/// One timestamp, as it is or was when it was retired.
#[derive(Default)]
pub(super) struct Tale {
    /// Each source asked, local too, and its due instant if it had one.
    pub(super) asked: BTreeMap<u64, Option<u64>>,
    pending: BTreeSet<u64>,
    /// Those whose result came in time.
    in_hand: BTreeSet<u64>,
}

/// One cloud's gate.
pub(super) struct Gate {
    pub(super) limit: u64,
    pub(super) resume: u64,
    pub(super) is_shut: bool,
}

/// What the rules decide about an input.
pub(super) struct Step {
    /// What was due first.
    pub(super) fired: Demands,
    /// About the input itself.
    pub(super) own: Demands,
    /// The reasons that hold for it, in the order in which they are asked for.
    pub(super) reasons: Reasons,
}

/// Which reasons hold for an input, whether or not an earlier one decides.
pub(super) enum Reasons {
    None,
    Open(Vec<OpenRefusal>),
    Offer(Vec<OfferRefusal>),
    Result(Vec<DropReason>),
    Fail(Vec<DropReason>),
}

impl Scene {
    pub(super) fn new(header: &Header) -> Self {
        let gate = |cloud: &Cloud| {
            let Cloud { limit, resume, .. } = *cloud;
            (u64::from(cloud.p), Gate { limit, resume, is_shut: false })
        };
        Self {
            reference: Reference::new(header),
            window: header.window.into(),
            gates: header.clouds.iter().map(gate).collect(),
            newest: None,
            tales: BTreeMap::new(),
            open: BTreeSet::new(),
            asked: Vec::new(),
        }
    }

    /// Lets an input happen.
    pub(super) fn apply(&mut self, input: &Input) -> Step {
        let (mut fired, mut own) = (Demands::new(), Demands::new());
        // P10: a tick just before changes nothing, and tells the timers' decisions from the input's.
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
        if !matches!(input, Input::Open { .. } | Input::Offer { .. }) || !fired.is_empty() {
            let (open, tales) = (&self.open, &self.tales);
            self.asked.retain(|(t, p)| {
                open.contains(t) && tales.get(t).is_some_and(|tale| tale.pending.contains(p))
            });
        }
        Step { fired, own, reasons }
    }

    pub(super) const fn now(&self) -> u64 {
        self.reference.now()
    }

    pub(super) fn next_due(&self) -> Option<u64> {
        self.reference.next_due()
    }

    /// The timestamps that are open, ascending.
    pub(super) const fn open(&self) -> &BTreeSet<u64> {
        &self.open
    }

    /// A request that is outranked by what is in hand, and was not made before.
    pub(super) fn outranked(&self) -> Option<(u64, u64)> {
        self.open.iter().rev().take(RECENT).find_map(|t| {
            let tale = self.tales.get(t)?;
            let best = tale.in_hand.last()?;
            let below = self.gates.range(..best).map(|(p, _)| *p);
            Some((*t, below.rev().find(|p| !tale.asked.contains_key(p))?))
        })
    }

    /// A timestamp that was opened.
    pub(super) fn tale(&self, t: u64) -> Option<&Tale> {
        self.tales.get(&t)
    }

    /// The gate of a registered cloud.
    pub(super) fn gate(&self, p: u64) -> Option<&Gate> {
        self.gates.get(&p)
    }

    /// Which reasons hold for an input now that all that is due has fired.
    fn reasons(&self, input: &Input) -> Reasons {
        match *input {
            Input::Open { t, deadline, .. } => Reasons::Open(self.open_reasons(t, deadline)),
            Input::Offer { t, p, deadline, backlog, .. } => {
                Reasons::Offer(self.offer_reasons(t, p, deadline, backlog))
            }
            Input::Result { t, p, .. } => Reasons::Result(self.drop_reasons(t, p)),
            Input::Fail { t, p, .. } => Reasons::Fail(self.drop_reasons(t, p)),
            Input::Tick { .. } => Reasons::None,
        }
    }

    /// F1.
    fn open_reasons(&self, t: u64, deadline: Option<u64>) -> Vec<OpenRefusal> {
        holding([
            (OpenRefusal::Order, self.was_reached(t)),
            (OpenRefusal::Full, self.open.len() >= self.window),
            (OpenRefusal::Deadline, deadline.is_some_and(|deadline| self.is_past(deadline))),
        ])
    }

    /// F2. Of a retired timestamp the sets count as they last were: a machine that forgot that it
    /// is closed would look there.
    fn offer_reasons(&self, t: u64, p: u64, deadline: u64, backlog: u64) -> Vec<OfferRefusal> {
        let (gate, tale) = (self.gates.get(&p), self.tales.get(&t));
        let shut = |gate: &Gate| {
            if gate.is_shut { backlog > gate.resume } else { backlog >= gate.limit }
        };
        holding([
            (OfferRefusal::Unknown, gate.is_none() || !self.was_reached(t)),
            (OfferRefusal::Closed, !self.open.contains(&t)),
            (OfferRefusal::Duplicate, tale.is_some_and(|tale| tale.asked.contains_key(&p))),
            (OfferRefusal::Outranked, tale.is_some_and(|tale| tale.in_hand.iter().any(|q| *q > p))),
            (OfferRefusal::Deadline, self.is_past(deadline)),
            (OfferRefusal::Queue, gate.is_some_and(shut)),
        ])
    }

    /// F3, F4; of a retired timestamp as for F2 (A16).
    fn drop_reasons(&self, t: u64, p: u64) -> Vec<DropReason> {
        let known = (p == 0 || self.gates.contains_key(&p)) && self.was_reached(t);
        let mut reasons = holding([
            (DropReason::Unknown, !known),
            (DropReason::Superseded, !self.open.contains(&t)),
        ]);
        if let Some(tale) = self.tales.get(&t) {
            let due = tale.asked.get(&p).copied().flatten();
            let is_over = due.is_some_and(|due| due <= self.now());
            reasons.extend(holding([
                (DropReason::Unsolicited, !tale.asked.contains_key(&p)),
                (DropReason::Duplicate, tale.in_hand.contains(&p)),
                (DropReason::Late, !tale.pending.contains(&p) || is_over),
            ]));
        }
        reasons
    }

    /// Notes what was accepted, of which no decision speaks.
    fn accept(&mut self, input: &Input, own: &Demands) {
        match *input {
            Input::Open { t, deadline, .. } if own.is_empty() => {
                let due = deadline.map(|deadline| self.now().saturating_add(deadline));
                let mut tale = Tale::default();
                tale.asked.insert(0, due);
                tale.pending.insert(0);
                self.tales.insert(t, tale);
                self.open.insert(t);
                self.asked.push((t, 0));
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
                if let Some(tale) = self.tales.get_mut(&t) {
                    tale.asked.insert(p, Some(due));
                    tale.pending.insert(p);
                }
                self.asked.push((t, p));
                self.turn_gate(p, false);
            }
            Decision::RefuseOffer { p, why: OfferRefusal::Queue, .. } => self.turn_gate(p, true),
            Decision::Hold { t, p, .. } => self.take(t, p),
            Decision::Emit { t, p, .. } => {
                self.take(t, p);
                self.open.remove(&t);
            }
            Decision::Miss { t, .. } => {
                self.open.remove(&t);
            }
            Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Drop { .. }
            | Decision::Cancel { .. } => {}
        }
    }

    fn close(&mut self, t: u64, p: u64) {
        if let Some(tale) = self.tales.get_mut(&t) {
            tale.pending.remove(&p);
        }
    }

    fn take(&mut self, t: u64, p: u64) {
        self.close(t, p);
        if let Some(tale) = self.tales.get_mut(&t) {
            tale.in_hand.insert(p);
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

/// Those that hold.
fn holding<T: Copy, const N: usize>(reasons: [(T, bool); N]) -> Vec<T> {
    reasons.iter().filter(|(_, holds)| *holds).map(|(reason, _)| *reason).collect()
}
