//! Random runs that favour the edges: due instants, full windows, moving gates, the ends of every range.

use std::fmt;

use fuseline_traces::{Cloud, Commit, Decision, Header, Input, Reference};
use proptest::collection::vec;
use proptest::prelude::*;

/// The most steps that a run is written from; a flood makes many inputs of one.
const STEPS: usize = 300;
/// How far back a step reaches for a timestamp or a request.
const RECENT: usize = 24;

/// A configuration and what happens to its operator.
///
/// It is shown as the conforming trace, so that a failure can go into the corpus as it is printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Run {
    /// The configuration.
    pub header: Header,
    /// The inputs, in order.
    pub inputs: Vec<Input>,
}

/// Runs of hundreds of inputs, over all configurations.
pub fn runs() -> impl Strategy<Value = Run> {
    (headers(), starts(), vec(step(), 0..STEPS)).prop_map(|(header, start, steps)| {
        let mut writer = Writer::new(header, start);
        for step in steps {
            writer.step(step);
        }
        Run { header: writer.header, inputs: writer.inputs }
    })
}

impl fmt::Debug for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines = Vec::new();
        self.header.write(&mut lines);
        let mut reference = Reference::new(&self.header);
        let mut demands = Vec::new();
        for input in &self.inputs {
            lines.push(b'\n');
            input.write(&mut lines);
            demands.clear();
            reference.apply(input, &mut demands);
            for (decision, _) in &demands {
                lines.push(b'\n');
                decision.write(&mut lines);
            }
        }
        writeln!(f, "\n{}", String::from_utf8_lossy(&lines))
    }
}

/// Where a run's clock and counter begin.
type Start = (u64, u64);

/// When a step happens.
#[derive(Clone, Copy, Debug)]
enum Time {
    Stay,
    Forward(u64),
    Back(u64),
    /// Around the next due instant.
    Due(Edge),
    /// Around the due instant of a recent request.
    DueOf(usize, Edge),
    At(u64),
}

/// One less, exactly, one more.
#[derive(Clone, Copy, Debug)]
enum Edge {
    Before,
    On,
    After,
}

#[derive(Clone, Copy, Debug)]
enum Moment {
    /// So many after the greatest one tried.
    Next(u64),
    /// So many before it, among those tried.
    Recent(usize),
    /// So many before the last one that is open.
    Open(usize),
    Any(u64),
}

#[derive(Clone, Copy, Debug)]
enum Whose {
    Local,
    Cloud(usize),
    /// A cloud's priority and 65536: what a careless conversion takes for the cloud.
    Wrapped(usize),
    Any(u64),
}

/// Whose result or failure.
#[derive(Clone, Copy, Debug)]
enum Call {
    /// Of a recent request whose timestamp is open.
    Asked(usize),
    Of(Moment, Whose),
}

#[derive(Clone, Copy, Debug)]
enum Span {
    Of(u64),
    /// Until the next due instant, so that timers tie.
    Tie,
}

#[derive(Clone, Copy, Debug)]
enum Backlog {
    Limit(Edge),
    Resume(Edge),
    Of(u64),
}

#[derive(Clone, Copy, Debug)]
enum Act {
    Open(Moment, Option<Span>),
    Offer(Moment, Whose, Span, Backlog),
    Result(Call),
    Fail(Call),
    Tick,
    /// What a message brings: an open, and an offer for each cloud in the mask, with these deadlines in turn.
    Message(Option<Span>, [Span; 3], u16),
    /// Opens and offers at one instant, as many as fill the greatest window.
    Flood(u16, u64, Option<Span>),
}

type Step = (Time, Act);

/// Makes inputs of steps, with the reference machine to know where the edges are.
struct Writer {
    header: Header,
    reference: Reference,
    inputs: Vec<Input>,
    /// Timestamps that an open was tried for.
    tried: Vec<u64>,
    /// Those of them that are open.
    open: Vec<u64>,
    /// Admitted requests of open timestamps.
    asked: Vec<(u64, u64)>,
    dues: Vec<u64>,
    next_t: u64,
}

impl Writer {
    fn new(header: Header, (at, t): Start) -> Self {
        let reference = Reference::new(&header);
        let mut writer = Self {
            header,
            reference,
            inputs: Vec::new(),
            tried: Vec::new(),
            open: Vec::new(),
            asked: Vec::new(),
            dues: Vec::new(),
            next_t: t,
        };
        if at > 0 {
            writer.push(Input::Tick { at });
        }
        writer
    }

    fn step(&mut self, (time, act): Step) {
        let at = self.time(time);
        match act {
            Act::Open(moment, deadline) => {
                let (t, deadline) = (self.moment(moment), deadline.map(|span| self.span(span)));
                self.open(at, t, deadline);
            }
            Act::Offer(moment, whose, span, backlog) => {
                let (t, p, deadline) = (self.moment(moment), self.whose(whose), self.span(span));
                let backlog = self.backlog(p, backlog);
                self.push(Input::Offer { at, t, p, deadline, backlog });
            }
            Act::Result(call) => {
                let (t, p) = self.call(call);
                self.push(Input::Result { at, t, p });
            }
            Act::Fail(call) => {
                let (t, p) = self.call(call);
                self.push(Input::Fail { at, t, p });
            }
            Act::Tick => self.push(Input::Tick { at }),
            Act::Message(deadline, spans, mask) => {
                let (t, deadline) = (self.next_t, deadline.map(|span| self.span(span)));
                self.open(at, t, deadline);
                let clouds = (0..self.header.clouds.len()).filter(|i| mask >> i & 1 == 1);
                for (i, span) in clouds.zip(spans.iter().cycle()) {
                    let (p, deadline) = (self.whose(Whose::Cloud(i)), self.span(*span));
                    self.push(Input::Offer { at, t, p, deadline, backlog: 0 });
                }
            }
            Act::Flood(count, stride, deadline) => {
                for i in 0..count {
                    let (t, deadline) = (self.next_t, deadline.map(|span| self.span(span)));
                    self.open(at, t, deadline);
                    self.next_t = self.next_t.saturating_add(stride);
                    let (p, deadline) = (self.whose(Whose::Cloud(i.into())), u64::from(i % 7) * 20);
                    self.push(Input::Offer { at, t, p, deadline, backlog: 0 });
                }
            }
        }
    }

    fn open(&mut self, at: u64, t: u64, deadline: Option<u64>) {
        self.tried.push(t);
        self.next_t = self.next_t.max(t.saturating_add(1));
        self.push(Input::Open { at, t, deadline });
    }

    fn push(&mut self, input: Input) {
        self.inputs.push(input);
        let mut demands = Vec::new();
        self.reference.apply(&input, &mut demands);
        for (decision, _) in demands {
            if let Decision::Request { t, p, due, .. } = decision {
                self.asked.push((t, p));
                self.dues.push(due);
            }
        }
        if let Some(t) = input.t().filter(|t| !self.open.contains(t) && self.reference.is_open(*t))
        {
            self.open.push(t);
        }
        self.open.retain(|t| self.reference.is_open(*t));
        self.asked.retain(|(t, _)| self.reference.is_open(*t));
    }

    fn time(&self, time: Time) -> u64 {
        let now = self.reference.now();
        match time {
            Time::Stay => now,
            Time::Forward(by) => now.saturating_add(by),
            Time::Back(by) => now.saturating_sub(by),
            Time::Due(edge) => edge.of(self.reference.next_due().unwrap_or(now)),
            Time::DueOf(back, edge) => edge.of(recent(&self.dues, back).unwrap_or(now)),
            Time::At(at) => at,
        }
    }

    fn moment(&self, moment: Moment) -> u64 {
        match moment {
            Moment::Next(skip) => self.next_t.saturating_add(skip),
            Moment::Recent(back) => recent(&self.tried, back).unwrap_or(self.next_t),
            Moment::Open(back) => {
                recent(&self.open, back).unwrap_or_else(|| self.moment(Moment::Recent(back)))
            }
            Moment::Any(t) => t,
        }
    }

    fn call(&self, call: Call) -> (u64, u64) {
        match call {
            Call::Asked(back) => {
                recent(&self.asked, back).unwrap_or_else(|| (self.moment(Moment::Open(back)), 0))
            }
            Call::Of(moment, whose) => (self.moment(moment), self.whose(whose)),
        }
    }

    fn whose(&self, whose: Whose) -> u64 {
        let cloud = |i: usize| {
            let count = self.header.clouds.len().max(1);
            self.header.clouds.get(i % count).map_or(1, |cloud| u64::from(cloud.p))
        };
        match whose {
            Whose::Local => 0,
            Whose::Cloud(i) => cloud(i),
            Whose::Wrapped(i) => cloud(i) + 65_536,
            Whose::Any(p) => p,
        }
    }

    fn span(&self, span: Span) -> u64 {
        match span {
            Span::Of(nanos) => nanos,
            Span::Tie => {
                self.reference.next_due().map_or(10, |due| due.saturating_sub(self.reference.now()))
            }
        }
    }

    fn backlog(&self, p: u64, backlog: Backlog) -> u64 {
        let cloud = self.header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
        match backlog {
            Backlog::Limit(edge) => edge.of(cloud.map_or(1, |cloud| cloud.limit)),
            Backlog::Resume(edge) => edge.of(cloud.map_or(0, |cloud| cloud.resume)),
            Backlog::Of(len) => len,
        }
    }
}

impl Edge {
    fn of(self, value: u64) -> u64 {
        match self {
            Self::Before => value.saturating_sub(1),
            Self::On => value,
            Self::After => value.saturating_add(1),
        }
    }
}

/// The value so many before the last, among the recent ones.
fn recent<T: Copy>(values: &[T], back: usize) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    values.get(last.saturating_sub(back % RECENT)).copied()
}

fn headers() -> impl Strategy<Value = Header> {
    let window = prop_oneof![
        4 => 1_u16..=3,
        4 => 4_u16..=16,
        1 => 17_u16..=1023,
        1 => Just(1024_u16),
    ];
    let commit = prop_oneof![Just(Commit::Eager), Just(Commit::Patient)];
    let count = prop_oneof![1 => Just(0_usize), 3 => 1_usize..=2, 7 => 3_usize..=5, 1 => 6_usize..=14, 1 => Just(15)];
    let clouds = count.prop_flat_map(|count| vec(clouds(), count));
    (window, commit, clouds).prop_map(|(window, commit, mut clouds)| {
        let mut taken = std::collections::BTreeSet::new();
        for cloud in &mut clouds {
            // A10: the next free priority; a second one would be refused.
            while !taken.insert(cloud.p) {
                cloud.p = cloud.p.checked_add(1).unwrap_or(1);
            }
        }
        Header { operator: None, window, commit, clouds }
    })
}

fn clouds() -> impl Strategy<Value = Cloud> {
    let p = prop_oneof![3 => 1_u16..=9, 1 => Just(1_u16), 1 => Just(u16::MAX), 2 => 1..=u16::MAX];
    let limit =
        prop_oneof![2 => Just(1_u64), 4 => 2_u64..=5, 1 => Just(u64::MAX), 1 => 1..=u64::MAX];
    (p, limit, any::<prop::sample::Index>(), 0_u8..3).prop_map(|(p, limit, index, choice)| {
        let resume = match choice {
            0 => limit - 1,
            1 => 0,
            _ => index.index(usize::try_from(limit).unwrap_or(usize::MAX)) as u64,
        };
        Cloud { p, name: None, limit, resume }
    })
}

fn starts() -> impl Strategy<Value = Start> {
    let at = prop_oneof![14 => Just(0_u64), 1 => any::<u64>(), 1 => u64::MAX - 4000..=u64::MAX];
    let t = prop_oneof![14 => Just(0_u64), 1 => any::<u64>(), 1 => u64::MAX - 40..=u64::MAX];
    (at, t)
}

fn step() -> impl Strategy<Value = Step> {
    (time(), act())
}

fn time() -> impl Strategy<Value = Time> {
    prop_oneof![
        60 => Just(Time::Stay),
        20 => (0_u64..=9).prop_map(Time::Forward),
        12 => edge().prop_map(Time::Due),
        5 => (0..RECENT, edge()).prop_map(|(back, edge)| Time::DueOf(back, edge)),
        5 => (1_u64..=50).prop_map(Time::Back),
        2 => (30_u64..=5000).prop_map(Time::Forward),
        1 => any::<u64>().prop_map(|at| Time::At(at >> 32)),
    ]
}

fn edge() -> impl Strategy<Value = Edge> {
    prop_oneof![Just(Edge::Before), Just(Edge::On), Just(Edge::After)]
}

fn act() -> impl Strategy<Value = Act> {
    let fresh = prop_oneof![
        20 => Just(Moment::Next(0)),
        4 => (1_u64..=9).prop_map(Moment::Next),
        3 => (0..4_usize).prop_map(Moment::Recent),
        1 => any::<u64>().prop_map(|t| Moment::Any(t >> 40)),
    ];
    let flood = prop_oneof![40 => 1_u16..40, 1 => 1000_u16..1100];
    prop_oneof![
        10 => (fresh, prop::option::of(span())).prop_map(|(t, deadline)| Act::Open(t, deadline)),
        20 => (prop::option::of(span()), [span(), span(), span()], mask())
            .prop_map(|(deadline, spans, mask)| Act::Message(deadline, spans, mask)),
        28 => (moment(), whose(), span(), backlog())
            .prop_map(|(t, p, span, backlog)| Act::Offer(t, p, span, backlog)),
        30 => call().prop_map(Act::Result),
        16 => call().prop_map(Act::Fail),
        36 => Just(Act::Tick),
        1 => (flood, 1_u64..=9, prop::option::of(span()))
            .prop_map(|(count, stride, deadline)| Act::Flood(count, stride, deadline)),
    ]
}

/// About half of the clouds, or most of them.
fn mask() -> impl Strategy<Value = u16> {
    prop_oneof![any::<u16>(), any::<[u16; 2]>().prop_map(|[one, two]| one | two)]
}

fn moment() -> impl Strategy<Value = Moment> {
    prop_oneof![
        30 => (0..2_usize).prop_map(Moment::Open),
        5 => (0..RECENT).prop_map(Moment::Open),
        5 => (0..RECENT).prop_map(Moment::Recent),
        2 => (0_u64..3).prop_map(Moment::Next),
        1 => any::<u64>().prop_map(Moment::Any),
    ]
}

fn call() -> impl Strategy<Value = Call> {
    prop_oneof![
        6 => (0..5_usize).prop_map(Call::Asked),
        3 => (0..4_usize).prop_map(|back| Call::Of(Moment::Open(back), Whose::Local)),
        2 => (moment(), whose()).prop_map(|(t, p)| Call::Of(t, p)),
    ]
}

fn whose() -> impl Strategy<Value = Whose> {
    prop_oneof![
        2 => Just(Whose::Local),
        30 => (0_usize..15).prop_map(Whose::Cloud),
        1 => (0_usize..15).prop_map(Whose::Wrapped),
        1 => any::<u64>().prop_map(Whose::Any),
    ]
}

fn span() -> impl Strategy<Value = Span> {
    prop_oneof![
        1 => Just(Span::Of(0)),
        3 => Just(Span::Of(1)),
        24 => (2_u64..=90).prop_map(Span::Of),
        10 => Just(Span::Tie),
        2 => Just(Span::Of(u64::MAX)),
        1 => any::<u64>().prop_map(Span::Of),
    ]
}

fn backlog() -> impl Strategy<Value = Backlog> {
    prop_oneof![
        10 => Just(Backlog::Of(0)),
        4 => edge().prop_map(Backlog::Limit),
        4 => edge().prop_map(Backlog::Resume),
        1 => Just(Backlog::Of(u64::MAX)),
        1 => any::<u64>().prop_map(Backlog::Of),
    ]
}
