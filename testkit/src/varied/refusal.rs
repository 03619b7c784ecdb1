//! Inputs that are refused or dropped: for several reasons at once, in each state of a timestamp,
//! and around a gate.

use fuseline_traces::Input;

use super::RunWriter;

impl RunWriter<'_> {
    /// Makes an offer for which several reasons to refuse may hold (F2).
    pub(super) fn clash(&mut self, at: u64) {
        let any = (self.timestamp(), self.priority());
        let (t, p) = match self.draw.between(0, 7) {
            0..3 => self.context.outranked().unwrap_or(any),
            3 => {
                let index = self.recent(self.context.requested().len());
                self.context.requested().get(index).copied().unwrap_or(any)
            }
            4 => (self.tried_before(), self.cloud()),
            _ => any,
        };
        let deadline = if self.draw.one_in(2) { 0 } else { self.span() };
        let limit = self.context.gate(p).map_or(u64::MAX, |gate| gate.limit);
        let backlog = if self.draw.one_in(2) { limit } else { self.backlog(p) };
        self.push(Input::Offer { at, t, p, deadline, backlog });
    }

    /// Gives inputs that a timestamp does not wait for, so they can only be dropped or refused.
    pub(super) fn push_ineffective(&mut self) {
        let t = self.timestamp();
        let count = self.draw.weighed(&[(3, 4), (1, 16)]);
        self.poke_at(t, count);
    }

    /// Gives results, failures and offers that change nothing, of at most `count` sources.
    pub(super) fn poke_at(&mut self, t: u64, count: usize) {
        let mut sources: Vec<u64> = self.header.clouds.iter().map(|cloud| cloud.p.into()).collect();
        sources.push(0);
        let p = self.cloud();
        sources.push(self.alias(p));
        self.draw.shuffle(&mut sources);
        sources.truncate(count);
        for p in sources {
            let at = self.now();
            let is_pending = self.context.requested().contains(&(t, p));
            let was_offered = self.context.due(t, p).is_some();
            if is_pending || was_offered && self.draw.one_in(4) {
                let (deadline, backlog) = (self.span(), self.backlog(p));
                self.push(Input::Offer { at, t, p, deadline, backlog });
            } else {
                self.give(at, t, p);
            }
        }
    }

    /// Gives results and failures for timestamps that were tried at any time before.
    pub(super) fn look_back(&mut self) {
        for _ in 0..8 {
            let index = self.draw.index(self.tried.len());
            let Some(t) = self.tried.get(index).copied() else { return };
            self.poke_at(t, 1);
        }
    }

    /// Makes offers that change one cloud's gate, or are refused for another reason and so must not
    /// change it (F2g).
    pub(super) fn move_gate(&mut self) {
        let index = self.draw.index(self.header.clouds.len());
        let Some(cloud) = self.header.clouds.get(index) else { return };
        let outranked = self.context.outranked().filter(|_| self.draw.one_in(2));
        let p = outranked.map_or(u64::from(cloud.p), |(_, p)| p);
        let mut t = self.open_for_offer();
        for _ in 0..self.draw.between(2, 7) {
            let at = self.now();
            if self.context.requested().contains(&(t, p)) {
                t = self.open_for_offer();
            }
            let (deadline, mut backlog) = (self.tenths(20, 60).max(1), self.backlog(p));
            if self.draw.one_in(2) {
                self.refuse_beside_gate(t, p, outranked.map(|(t, _)| t));
                backlog = self.between_resume_and_limit(p).unwrap_or(backlog);
            }
            self.push(Input::Offer { at, t, p, deadline, backlog });
        }
    }

    /// Returns a backlog that shows whether a gate is open or shut without changing it, if there is
    /// one.
    fn between_resume_and_limit(&mut self, p: u64) -> Option<u64> {
        let (limit, resume) = self.context.gate(p).map(|gate| (gate.limit, gate.resume))?;
        (limit - resume > 1).then(|| self.draw.between(resume + 1, limit - 1))
    }

    /// Makes an offer that is refused for each reason before the gate's, or else for its deadline.
    fn refuse_beside_gate(&mut self, t: u64, p: u64, outranked: Option<u64>) {
        let at = self.now();
        let requested = self.context.requested().iter().rev().find(|(_, q)| *q == p);
        let requested = requested.map(|(t, _)| *t);
        let (other, deadline) = match self.draw.between(0, 5) {
            0 => (self.next_t.saturating_add(5), 50),
            1 => (self.tried_before(), 0),
            2 => (requested.unwrap_or(t), 0),
            3 | 4 => (outranked.unwrap_or(t), 0),
            _ => (t, 0),
        };
        let backlog = self.backlog(p);
        self.push(Input::Offer { at, t: other, p, deadline, backlog });
    }

    /// Gives thousands of inputs while a gate is shut, and then opens it.
    pub(super) fn stay_shut(&mut self, inputs: u64) {
        self.steps(4);
        let index = self.draw.index(self.header.clouds.len());
        let Some(cloud) = self.header.clouds.get(index) else {
            self.steps(inputs / 4);
            return;
        };
        let (p, limit, resume) = (u64::from(cloud.p), cloud.limit, cloud.resume);
        let mut t = self.open_for_offer();
        let until = self.inputs.len() + usize::try_from(inputs).unwrap_or(0);
        let mut backlog = limit;
        while self.inputs.len() < until {
            let at = self.now();
            let is_open = self.context.open().contains(&t);
            if !is_open || self.draw.one_in(40) {
                t = self.open_for_offer();
            }
            if self.draw.one_in(60) {
                let at = at.saturating_add(self.tenths(0, 10));
                self.push(Input::Tick { at });
            }
            let deadline = self.tenths(20, 60).max(1);
            self.push(Input::Offer { at, t, p, deadline, backlog });
            backlog = self.draw.weighed(&[(4, resume + 1), (1, limit), (1, u64::MAX)]);
        }
        let at = self.now();
        t = self.open_for_offer();
        let deadline = self.tenths(20, 60).max(1);
        for backlog in [resume.saturating_add(1), resume, limit] {
            self.push(Input::Offer { at, t, p, deadline, backlog });
        }
        self.steps(8);
    }

    /// Makes room and opens a timestamp.
    fn open_for_offer(&mut self) -> u64 {
        self.make_room();
        let (at, t) = (self.now(), self.next_t);
        self.open(at, t, None);
        t
    }
}
