//! The second generator: runs at many scales of time, with long chains, full windows and numbers
//! that alias.
//!
//! [`Generator`](crate::Generator) is the first; its seeds keep their runs. This one adds what
//! implementations in other languages get wrong: clocks of 32 bits, rounded milliseconds, numbers
//! in a double, sets of a fixed size, and state that outlives its run.

use fuseline_traces::{Commit, Header, Input};

use crate::context::RunContext;
use crate::draw::Draw;
use crate::run::Run;

mod bulk;
mod chain;
mod header;
mod number;
mod refusal;
mod step;
mod time;

use time::TimeScale;

/// This many runs in a row have headers that are equal or differ in one thing.
const FAMILY: u64 = 4;
/// One family in this many begins with a run that fills a window, and another one with a long run.
const HEAVY: u64 = 12;
/// One family in this many begins with a run of more than 65,536 inputs.
const GIANT: u64 = 1_024;
/// Separates the streams from those of the first generator.
const SALT: u64 = 0x7661_7269_6564_0002;

/// Generates varied runs from a seed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct VariedGenerator {
    /// The seed. Another seed gives other runs.
    pub seed: u64,
    /// The commit rule, or `None` for all of them.
    pub commit: Option<Commit>,
    /// The greatest number of clouds in a run, up to 15.
    pub clouds: u8,
}

/// The main content of a run.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RunKind {
    /// Every kind of step.
    Mixed,
    /// Fills its window, empties it in part and fills it again.
    Fill,
    /// Every kind of step, a thousand times.
    Long,
    /// Thousands of inputs while a gate is shut.
    Shut,
    /// More inputs than 16 bits can count.
    Giant,
}

impl RunKind {
    /// Returns the kind of a family's first run. The other runs are mixed.
    const fn of_family(family: u64) -> Self {
        if family % GIANT == GIANT - 1 {
            return Self::Giant;
        }
        match (family % HEAVY, (family / HEAVY) % 2) {
            (5, _) => Self::Fill,
            (11, 0) => Self::Shut,
            (11, _) => Self::Long,
            _ => Self::Mixed,
        }
    }
}

impl VariedGenerator {
    /// Returns the run with this number, which is always the same.
    #[must_use]
    pub fn run(&self, number: u64) -> Run {
        let is_first = number.is_multiple_of(FAMILY);
        let kind = if is_first { RunKind::of_family(number / FAMILY) } else { RunKind::Mixed };
        let header = self.header(number);
        let mut writer = RunWriter::new(&header, Draw::new(self.seed ^ SALT, number));
        if kind != RunKind::Mixed {
            writer.keep_away_from_ends();
        }
        match kind {
            RunKind::Mixed => {
                let steps = writer.draw.between(4, 48);
                writer.steps(steps);
            }
            RunKind::Fill => writer.fill_and_refill(),
            RunKind::Long => {
                let steps = writer.draw.between(500, 1_000);
                writer.steps(steps);
                writer.look_back();
            }
            RunKind::Shut => {
                let inputs = writer.draw.between(1_000, 5_000);
                writer.stay_shut(inputs);
            }
            RunKind::Giant => writer.pass_many(66_000),
        }
        let inputs = writer.inputs;
        Run { header, inputs }
    }
}

/// Generates inputs. It follows the reference machine to know where the edges are.
struct RunWriter<'a> {
    header: &'a Header,
    context: RunContext,
    draw: Draw,
    time: TimeScale,
    inputs: Vec<Input>,
    /// The timestamps for which an open was tried.
    tried: Vec<u64>,
    next_t: u64,
    /// `true` if the clock and the counter stay away from their ends, where nothing more happens.
    is_long: bool,
}

impl<'a> RunWriter<'a> {
    fn new(header: &'a Header, mut draw: Draw) -> Self {
        let time = TimeScale::draw(&mut draw);
        let next_t = number::first_timestamp(&mut draw);
        let context = RunContext::new(header);
        let (inputs, tried, is_long) = (Vec::new(), Vec::new(), false);
        Self { header, context, draw, time, inputs, tried, next_t, is_long }
    }

    /// Keeps the clock and the counter of a long run away from their ends, where nothing more
    /// happens.
    fn keep_away_from_ends(&mut self) {
        self.is_long = true;
        self.next_t = self.next_t.min((1 << 63) - 8);
        self.time.start = self.time.start.min((1 << 63) - 8);
    }

    fn steps(&mut self, count: u64) {
        for _ in 0..count {
            self.step();
        }
    }

    /// Returns the clock's reading, or the instant at which the run begins if there was no input
    /// yet.
    fn now(&self) -> u64 {
        self.context.now().max(self.time.start)
    }

    fn push(&mut self, input: Input) {
        self.inputs.push(input);
        let step = self.context.apply(&input);
        // A wrong machine might answer a second time, so this repeats the last decision's input.
        if let Some((t, p)) = step.sent().filter(|_| self.draw.one_in(10)) {
            self.give(self.now(), t, p);
        }
    }

    /// Gives a result or a failure, and nothing else.
    fn give(&mut self, at: u64, t: u64, p: u64) {
        let is_failure = self.draw.one_in(3);
        let input = if is_failure { Input::Fail { at, t, p } } else { Input::Result { at, t, p } };
        self.inputs.push(input);
        self.context.apply(&input);
    }

    fn open(&mut self, at: u64, t: u64, deadline: Option<u64>) {
        self.tried.push(t);
        self.next_t = self.next_t.max(t.saturating_add(1));
        self.push(Input::Open { at, t, deadline });
    }
}
