//! The steps of a run; each is one input or a few.

use fuseline_traces::Input;

use super::RunWriter;

/// The kind of a step.
#[derive(Clone, Copy)]
enum VariedStep {
    /// A message arrives: an open, and offers to some of the clouds.
    Message,
    Open,
    Offer,
    /// An offer that is likely to be refused, for several reasons at once.
    Clash,
    Result,
    /// A cloud's result that is held because a better one is pending.
    Hold,
    Fail,
    /// A result or a failure around its own due instant.
    Arrival,
    Tick,
    /// A tick after several due instants.
    LateTick,
    /// Inputs that can only be dropped or refused in the state of a timestamp.
    Ineffective,
    /// All clouds return results for one message, one after the other.
    Chain,
    /// Offers that change one cloud's gate.
    Gate,
    /// Many messages at once.
    Flood,
    /// Some open timestamps are ended.
    Drain,
}

impl RunWriter<'_> {
    pub(super) fn step(&mut self) {
        const ACTS: [(u64, VariedStep); 15] = [
            (18, VariedStep::Message),
            (9, VariedStep::Open),
            (18, VariedStep::Offer),
            (11, VariedStep::Clash),
            (22, VariedStep::Result),
            (10, VariedStep::Hold),
            (12, VariedStep::Fail),
            (14, VariedStep::Arrival),
            (18, VariedStep::Tick),
            (6, VariedStep::LateTick),
            (7, VariedStep::Ineffective),
            (8, VariedStep::Chain),
            (7, VariedStep::Gate),
            (2, VariedStep::Flood),
            (4, VariedStep::Drain),
        ];
        let at = self.instant();
        match self.draw.weighed(&ACTS) {
            VariedStep::Message => self.message(at),
            VariedStep::Open => {
                let (t, deadline) = (self.fresh(), self.deadline_of_local());
                self.open(at, t, deadline);
            }
            VariedStep::Offer => {
                let (t, p) = (self.timestamp(), self.priority());
                let (deadline, backlog) = (self.span(), self.backlog(p));
                self.push(Input::Offer { at, t, p, deadline, backlog });
            }
            VariedStep::Clash => self.clash(at),
            VariedStep::Result => {
                let (t, p) = self.call();
                self.push(Input::Result { at, t, p });
            }
            VariedStep::Hold => self.hold(),
            VariedStep::Fail => {
                let (t, p) = self.call();
                self.push(Input::Fail { at, t, p });
            }
            VariedStep::Arrival => self.arrival(),
            VariedStep::Tick => self.push(Input::Tick { at }),
            VariedStep::LateTick => self.late_tick(),
            VariedStep::Ineffective => self.push_ineffective(),
            VariedStep::Chain => self.chain(),
            VariedStep::Gate => self.move_gate(),
            VariedStep::Flood => {
                let most = u64::from(self.header.window.min(38)) + 2;
                let count = self.draw.between(2, most);
                self.flood(count);
            }
            VariedStep::Drain => self.drain(),
        }
    }

    fn message(&mut self, at: u64) {
        let (t, deadline) = (self.fresh(), self.deadline_of_local());
        self.open(at, t, deadline);
        let mut clouds: Vec<u64> = self.header.clouds.iter().map(|cloud| cloud.p.into()).collect();
        self.draw.shuffle(&mut clouds);
        for p in clouds {
            if self.draw.one_in(4) {
                continue;
            }
            let deadline = self.span();
            let backlog = if self.draw.one_in(6) { self.backlog(p) } else { 0 };
            self.push(Input::Offer { at, t, p, deadline, backlog });
        }
    }

    fn hold(&mut self) {
        let requested = self.context.requested();
        let waits = |(t, p): &&(u64, u64)| *p > 0 && requested.iter().any(|(u, q)| u == t && q > p);
        let Some((t, p)) = requested.iter().rev().take(32).find(waits).copied() else {
            return;
        };
        let at = self.now();
        self.push(Input::Result { at, t, p });
        match self.draw.between(0, 9) {
            0 => self.give(at, t, p),
            // The result is then forwarded, although lower ones are pending.
            1 => self.fail_above(t, p),
            _ => {}
        }
    }

    /// Fails all sources that outrank a request, in random order.
    pub(super) fn fail_above(&mut self, t: u64, p: u64) {
        let at = self.now();
        let requested = self.context.requested().iter().copied();
        let mut above: Vec<_> = requested.filter(|(u, q)| *u == t && *q > p).collect();
        self.draw.shuffle(&mut above);
        for (t, p) in above {
            self.push(Input::Fail { at, t, p });
        }
    }

    fn arrival(&mut self) {
        let len = self.context.requested().len();
        let index = if self.draw.one_in(3) { self.draw.index(len) } else { self.recent(len) };
        let Some((t, p)) = self.context.requested().get(index).copied() else { return };
        let due = self.context.due(t, p);
        let at = self.edge(due.unwrap_or(self.now()));
        let is_failure = self.draw.one_in(3);
        self.push(if is_failure { Input::Fail { at, t, p } } else { Input::Result { at, t, p } });
    }

    /// Advances the clock past some of the current due instants, or past all of them.
    fn late_tick(&mut self) {
        let requested = self.context.requested().iter().copied();
        let mut dues: Vec<u64> = requested.filter_map(|(t, p)| self.context.due(t, p)).collect();
        let now = self.now();
        // A timer that is due at the end of time would end the run.
        let end = if self.is_long || !self.draw.one_in(20) { u64::MAX - 1 } else { u64::MAX };
        dues.retain(|due| *due <= end && due.saturating_sub(now) < 1 << 62);
        dues.sort_unstable();
        let index = if self.draw.one_in(3) {
            dues.len().saturating_sub(1)
        } else {
            self.draw.index(dues.len())
        };
        let at = dues.get(index).copied().unwrap_or(self.now());
        let at = self.edge(at);
        self.push(Input::Tick { at });
    }

    /// Ends some open timestamps, the oldest or the newest first. Their clouds fail, and local
    /// returns or fails too.
    fn drain(&mut self) {
        let mut open: Vec<u64> = self.context.open().iter().copied().collect();
        if self.draw.one_in(2) {
            open.reverse();
        }
        open.truncate(usize::try_from(self.draw.between(1, 24)).unwrap_or(1));
        for t in open {
            self.end(t);
        }
    }

    /// Ends one open timestamp.
    pub(super) fn end(&mut self, t: u64) {
        self.fail_above(t, 0);
        if self.context.open().contains(&t) {
            let at = self.now();
            let is_failure = self.draw.one_in(3);
            self.push(if is_failure {
                Input::Fail { at, t, p: 0 }
            } else {
                Input::Result { at, t, p: 0 }
            });
        }
    }
}
