//! Random runs, weighted towards the situations in which one rule or another decides.
//!
//! [`Generator::run`] returns the same run for the same seed and number. The reference machine
//! shows it where the edges are. It does not judge what an implementation makes of a run.

use fuseline_traces::{Cloud, Commit, Header, Input};

use crate::context::RunContext;
use crate::draw::Draw;
use crate::run::Run;

mod flood;
pub(crate) mod wide;

use flood::DepartureOrder;

/// The number of the newest timestamps or requests among which a step chooses. One kind of step
/// chooses among twice as many.
const RECENT: usize = 12;
/// One run in this many fills the greatest window.
const FLOODS: u64 = 250;
/// One run in this many is long.
const LONGS: u64 = 50;
/// The greatest window.
const GREATEST: u16 = 1024;

/// Generates runs from a seed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Generator {
    /// The seed. Another seed gives other runs.
    pub seed: u64,
    /// The commit rule, or `None` for all of them.
    pub commit: Option<Commit>,
    /// The greatest number of clouds in a run, up to 15.
    pub clouds: u8,
}

impl Generator {
    /// Returns the run with this number, which is always the same.
    #[must_use]
    pub fn run(&self, number: u64) -> Run {
        let mut draw = Draw::new(self.seed, number);
        let is_flood = number % FLOODS == FLOODS / 2;
        let steps = match number % LONGS {
            _ if is_flood => 12,
            n if n == LONGS / 2 => draw.between(200, 500),
            _ => draw.between(2, 40),
        };
        let header = self.header(&mut draw, is_flood);
        let mut writer = InputGenerator::new(&header, draw);
        writer.start();
        if is_flood {
            // The flood is larger than the greatest window.
            writer.flood(u64::from(GREATEST) + 6, &header);
        }
        for _ in 0..steps {
            writer.step(&header);
        }
        if is_flood {
            for leaving in DepartureOrder::ALL {
                writer.refill(leaving, &header);
            }
        }
        let inputs = writer.inputs;
        Run { header, inputs }
    }

    fn header(&self, draw: &mut Draw, is_flood: bool) -> Header {
        let window = match draw.weighed(&[(5, 3), (4, 16), (1, 1023)]) {
            _ if is_flood => GREATEST,
            most => u16::try_from(draw.between(1, most)).unwrap_or(GREATEST),
        };
        let commit = draw.weighed(&Commit::ALL.map(|commit| (1, commit)));
        let most = draw.weighed(&[(1, 0), (3, 2), (7, 5), (1, 15)]).min(u64::from(self.clouds));
        let count = draw.between(most.min(1), most);
        let mut clouds: Vec<Cloud> = Vec::new();
        while (clouds.len() as u64) < count {
            let p = draw.weighed(&[(16, 9), (1, u64::from(u16::MAX))]);
            let p = u16::try_from(draw.between(1, p)).unwrap_or(u16::MAX);
            let p = if draw.one_in(16) { u16::MAX } else { p };
            // Each priority occurs once. When the small ones are used up, greater ones follow.
            let p = if count > 8 { p.max(u16::try_from(clouds.len()).unwrap_or(1) + 1) } else { p };
            let is_free = clouds.iter().all(|cloud| cloud.p != p);
            let limit = match draw.weighed(&[(2, 1), (5, 5), (1, u64::MAX)]) {
                5 => draw.between(2, 5),
                limit => limit,
            };
            let resume = match draw.between(0, 2) {
                0 => limit - 1,
                1 => 0,
                _ => draw.between(0, limit - 1),
            };
            if is_free {
                clouds.push(Cloud { p, name: None, limit, resume });
            }
        }
        Header { operator: None, window, commit: self.commit.unwrap_or(commit), clouds }
    }
}

/// The kind of a step.
#[derive(Clone, Copy)]
enum StepKind {
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
    /// Many messages at once.
    Flood,
}

/// Generates inputs. It follows the reference machine to know where the edges are.
struct InputGenerator {
    context: RunContext,
    draw: Draw,
    inputs: Vec<Input>,
    /// The timestamps for which an open was tried.
    tried: Vec<u64>,
    next_t: u64,
    /// `true` if the clock and the counter stay away from their ends, where nothing more happens.
    is_long: bool,
}

impl InputGenerator {
    fn new(header: &Header, draw: Draw) -> Self {
        Self {
            context: RunContext::new(header),
            draw,
            inputs: vec![],
            tried: vec![],
            next_t: 0,
            is_long: false,
        }
    }

    /// Starts at the beginning of clock and counter, or near the end of one of them.
    fn start(&mut self) {
        let near = |draw: &mut Draw, back| u64::MAX - draw.between(0, back);
        if self.draw.one_in(16) {
            let at = near(&mut self.draw, 300);
            self.push(Input::Tick { at });
        }
        if self.draw.one_in(16) {
            self.next_t = near(&mut self.draw, 8);
        }
    }

    fn step(&mut self, header: &Header) {
        const ACTS: [(u64, StepKind); 10] = [
            (20, StepKind::Message),
            (10, StepKind::Open),
            (22, StepKind::Offer),
            (10, StepKind::Clash),
            (24, StepKind::Result),
            (12, StepKind::Hold),
            (14, StepKind::Fail),
            (16, StepKind::Arrival),
            (26, StepKind::Tick),
            (1, StepKind::Flood),
        ];
        let at = self.instant();
        match self.draw.weighed(&ACTS) {
            StepKind::Message => self.message(at, header),
            StepKind::Open => {
                let (t, deadline) = (self.fresh(), self.deadline_of_local());
                self.open(at, t, deadline);
            }
            StepKind::Offer => {
                let (t, p) = (self.timestamp(), self.priority(header));
                let (deadline, backlog) = (self.span(), self.backlog(p));
                self.push(Input::Offer { at, t, p, deadline, backlog });
            }
            StepKind::Clash => self.clash(at, header),
            StepKind::Result => {
                let (t, p) = self.call(header);
                self.push(Input::Result { at, t, p });
            }
            StepKind::Hold => self.hold(),
            StepKind::Fail => {
                let (t, p) = self.call(header);
                self.push(Input::Fail { at, t, p });
            }
            StepKind::Arrival => self.arrival(),
            StepKind::Tick => self.push(Input::Tick { at }),
            StepKind::Flood => {
                let count = self.draw.between(2, 40);
                self.flood(count, header);
            }
        }
    }

    fn message(&mut self, at: u64, header: &Header) {
        let (t, deadline) = (self.next_t, self.deadline_of_local());
        self.open(at, t, deadline);
        let lowest = header.clouds.iter().map(|cloud| cloud.p).min();
        let spared = lowest.filter(|_| self.draw.one_in(3));
        for cloud in &header.clouds {
            if Some(cloud.p) != spared && !self.draw.one_in(4) {
                let p = cloud.p.into();
                let deadline = self.span();
                let backlog = if self.draw.one_in(6) { self.backlog(p) } else { 0 };
                self.push(Input::Offer { at, t, p, deadline, backlog });
            }
        }
    }

    fn hold(&mut self) {
        let requested = self.context.requested();
        let waits = |(t, p): &&(u64, u64)| *p > 0 && requested.iter().any(|(u, q)| u == t && q > p);
        let Some((t, p)) = requested.iter().rev().take(2 * RECENT).find(waits).copied() else {
            return;
        };
        let at = self.context.now();
        self.push(Input::Result { at, t, p });
        match self.draw.between(0, 9) {
            0 => self.push(Input::Result { at, t, p }),
            1 => self.push(Input::Fail { at, t, p }),
            // The result is then forwarded, although lower ones are pending.
            2 => self.fail_above(t, p),
            _ => {}
        }
    }

    /// Fails all sources that outrank a request.
    fn fail_above(&mut self, t: u64, p: u64) {
        let at = self.context.now();
        let requested = self.context.requested().iter().copied();
        let above: Vec<_> = requested.filter(|(u, q)| *u == t && *q > p).collect();
        for (t, p) in above {
            self.push(Input::Fail { at, t, p });
        }
    }

    fn clash(&mut self, at: u64, header: &Header) {
        let any = (self.timestamp(), self.priority(header));
        let (t, p) = self.context.outranked().filter(|_| !self.draw.one_in(4)).unwrap_or(any);
        let deadline = if self.draw.one_in(2) { 0 } else { self.span() };
        let limit = self.context.gate(p).map_or(u64::MAX, |gate| gate.limit);
        let backlog = if self.draw.one_in(2) { limit } else { self.backlog(p) };
        self.push(Input::Offer { at, t, p, deadline, backlog });
    }

    fn arrival(&mut self) {
        let index = self.recent(self.context.requested().len());
        let Some((t, p)) = self.context.requested().get(index).copied() else { return };
        let due = self.context.due(t, p);
        let at = self.edge(due.unwrap_or(self.context.now()));
        let is_failure = self.draw.one_in(3);
        self.push(if is_failure { Input::Fail { at, t, p } } else { Input::Result { at, t, p } });
    }

    fn open(&mut self, at: u64, t: u64, deadline: Option<u64>) {
        self.tried.push(t);
        self.next_t = self.next_t.max(t.saturating_add(1));
        self.push(Input::Open { at, t, deadline });
    }

    fn push(&mut self, input: Input) {
        self.inputs.push(input);
        let step = self.context.apply(&input);
        // A wrong machine might answer a second time, so this repeats the last decision's input.
        if let Some((t, p)) = step.sent().filter(|_| self.draw.one_in(8)) {
            let at = self.context.now();
            self.inputs.push(Input::Result { at, t, p });
            self.context.apply(&Input::Result { at, t, p });
        }
    }

    fn instant(&mut self) -> u64 {
        let now = self.context.now();
        match self.draw.between(0, 99) {
            0..50 => now,
            50..68 => now.saturating_add(self.draw.between(0, 9)),
            68..90 => {
                let due = self.context.next_due().unwrap_or(now);
                self.edge(due)
            }
            90..96 => now.saturating_sub(self.draw.between(1, 50)),
            96..99 => now.saturating_add(self.draw.between(30, 500)),
            _ if self.draw.one_in(8) && !self.is_long => u64::MAX,
            _ => now,
        }
    }

    /// Returns the value, one less, or one more.
    fn edge(&mut self, value: u64) -> u64 {
        match self.draw.between(0, 2) {
            0 => value.saturating_sub(1),
            1 => value,
            _ => value.saturating_add(1),
        }
    }

    /// Returns a timestamp to open.
    fn fresh(&mut self) -> u64 {
        match self.draw.between(0, 29) {
            0..20 => self.next_t,
            20..24 => self.next_t.saturating_add(self.draw.between(1, 9)),
            24..29 => self.tried_before(),
            _ if self.is_long => self.next_t.saturating_add(1 << 33),
            _ => self.draw.weighed(&[(1, u64::MAX), (3, self.next_t.saturating_add(1 << 33))]),
        }
    }

    /// Returns a timestamp for an offer, a result or a failure.
    fn timestamp(&mut self) -> u64 {
        match self.draw.between(0, 39) {
            0..28 => {
                let back = self.draw.weighed(&[(6, 2), (1, RECENT)]);
                let back = self.draw.index(back.min(self.context.open().len()));
                let open = self.context.open().iter().rev().nth(back).copied();
                open.unwrap_or(self.next_t)
            }
            28..36 => self.tried_before(),
            36..39 => self.next_t.saturating_add(self.draw.between(0, 2)),
            _ => self.draw.next(),
        }
    }

    fn tried_before(&mut self) -> u64 {
        let index = self.recent(self.tried.len());
        self.tried.get(index).copied().unwrap_or(self.next_t)
    }

    fn priority(&mut self, header: &Header) -> u64 {
        match self.draw.between(0, 33) {
            0..30 => self.cloud(header),
            30 => 0,
            // A priority that a careless conversion takes for the cloud's.
            31 => self.cloud(header) + 65_536,
            32 => self.draw.between(1, 10),
            _ => self.draw.next(),
        }
    }

    fn cloud(&mut self, header: &Header) -> u64 {
        let index = self.draw.index(header.clouds.len());
        header.clouds.get(index).map_or(1, |cloud| u64::from(cloud.p))
    }

    /// Returns the timestamp and the source of a result or a failure.
    fn call(&mut self, header: &Header) -> (u64, u64) {
        match self.draw.between(0, 10) {
            0..5 if !self.context.requested().is_empty() => {
                let index = self.recent(self.context.requested().len());
                self.context.requested()[index]
            }
            5..8 => (self.timestamp(), 0),
            _ => (self.timestamp(), self.priority(header)),
        }
    }

    fn deadline_of_local(&mut self) -> Option<u64> {
        (!self.draw.one_in(3)).then(|| self.span())
    }

    fn span(&mut self) -> u64 {
        match self.draw.between(0, 39) {
            0..2 => 0,
            2..5 => 1,
            5..26 => self.draw.between(2, 90),
            // Until the next due instant, so that timers coincide.
            26..37 => {
                let due = self.context.next_due();
                due.map_or(10, |due| due.saturating_sub(self.context.now()))
            }
            // The clock soon passes what is due.
            _ if self.is_long => 500,
            37..39 => u64::MAX,
            _ => self.draw.next(),
        }
    }

    fn backlog(&mut self, p: u64) -> u64 {
        let (limit, resume) = self.context.gate(p).map_or((1, 0), |gate| (gate.limit, gate.resume));
        match self.draw.between(0, 19) {
            0..9 => 0,
            9..13 => self.edge(limit),
            13..17 => self.edge(resume),
            17..19 => limit,
            _ => u64::MAX,
        }
    }

    /// Returns one of the last few of `len` indices.
    fn recent(&mut self, len: usize) -> usize {
        let back = self.draw.index(len.min(RECENT));
        len.saturating_sub(1).saturating_sub(back)
    }
}
