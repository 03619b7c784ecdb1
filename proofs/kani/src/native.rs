//! Runs harnesses as plain functions, on random values or on the values of a counterexample.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::panic::{self, AssertUnwindSafe, Location};

use crate::Arbitrary;

/// The number of draws by [`any_where`] after which a run is rejected.
const DRAWS: u32 = 2_000;

/// Reports the runs of a harness.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Report {
    /// The number of runs that came to their end.
    pub accepted: u64,
    /// The number of runs that an assumption excluded.
    pub rejected: u64,
    /// The number of times that each assertion was reached, by its message.
    pub assertions: BTreeMap<&'static str, u64>,
    /// The number of times that each cover was reached, by its line and message; 0 if its condition never
    /// held.
    pub covers: BTreeMap<(u32, &'static str), u64>,
}

/// An assertion that failed.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Failure {
    /// Its message.
    pub message: String,
    /// Its file and line, unless it is a panic of the code that is proved.
    pub location: Option<String>,
    /// The values drawn until then.
    pub values: Vec<u64>,
}

/// The reason a run was not accepted.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum RunError {
    /// An assumption excluded it.
    Rejected,
    /// An assertion failed, or something panicked.
    Failed(Failure),
}

enum Values {
    Random(Random),
    Recorded(VecDeque<u64>),
}

struct Run {
    values: Values,
    drawn: Vec<u64>,
    report: Report,
    failed: Option<(&'static str, String)>,
}

thread_local! {
    static RUN: RefCell<Option<Run>> = const { RefCell::new(None) };
}

/// The payload with which an excluded run ends.
struct Rejected;
/// The payload with which a run ends after an assertion failed.
struct Refuted;

/// Runs a harness on random values until `accepted` runs came to their end.
///
/// # Errors
/// Returns the first failure.
pub fn random(harness: fn(), seed: u64, accepted: u64) -> Result<Report, Failure> {
    let values = Values::Random(Random::new(seed));
    start(values);
    loop {
        let ended = once(harness);
        let stop = RUN.with_borrow_mut(|run| {
            let run = run.as_mut().expect("a run was started");
            match &ended {
                Ok(()) => run.report.accepted += 1,
                Err(RunError::Rejected) => run.report.rejected += 1,
                Err(RunError::Failed(_)) => return true,
            }
            run.drawn.clear();
            let hopeless = run.report.rejected > 10 * accepted;
            run.report.accepted == accepted || hopeless
        });
        if let Err(RunError::Failed(failure)) = ended {
            return Err(failure);
        }
        if stop {
            return Ok(RUN.take().expect("a run was started").report);
        }
    }
}

/// Runs a harness once on these values. Missing values are 0.
///
/// # Errors
/// Returns the reason if the run was not accepted.
pub fn replay(harness: fn(), values: &[u64]) -> Result<Report, RunError> {
    start(Values::Recorded(values.iter().copied().collect()));
    once(harness).map(|()| RUN.take().expect("a run was started").report)
}

/// Returns `true` if steps are to be recorded, which is so only in a replay.
#[must_use]
pub fn is_replay() -> bool {
    RUN.with_borrow(|run| run.as_ref().is_some_and(|run| matches!(run.values, Values::Recorded(_))))
}

fn start(values: Values) {
    let run = Run { values, drawn: Vec::new(), report: Report::default(), failed: None };
    RUN.set(Some(run));
}

fn once(harness: fn()) -> Result<(), RunError> {
    let Err(payload) = panic::catch_unwind(AssertUnwindSafe(harness)) else { return Ok(()) };
    if payload.is::<Rejected>() {
        return Err(RunError::Rejected);
    }
    let message = payload
        .downcast_ref::<&str>()
        .map(|message| (*message).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned());
    Err(RunError::Failed(with(|run| {
        let values = run.drawn.clone();
        match run.failed.take() {
            Some((message, location)) if payload.is::<Refuted>() => {
                Failure { message: message.to_owned(), location: Some(location), values }
            }
            _ => Failure { message: message.unwrap_or_default(), location: None, values },
        }
    })))
}

fn with<T>(act: impl FnOnce(&mut Run) -> T) -> T {
    RUN.with_borrow_mut(|run| {
        act(run.as_mut().expect("a harness runs through `random` or `replay`"))
    })
}

pub(crate) fn any(bits: u32) -> u64 {
    with(|run| {
        let mask = u64::MAX >> (64 - bits);
        let value = match &mut run.values {
            Values::Random(random) => random.any(mask),
            Values::Recorded(values) => values.pop_front().unwrap_or(0) & mask,
        };
        run.drawn.push(value);
        value
    })
}

pub(crate) fn any_where<T: Arbitrary, F: Fn(&T) -> bool>(wanted: F) -> T {
    let (before, draws) = with(|run| match run.values {
        Values::Random(_) => (run.drawn.len(), DRAWS),
        Values::Recorded(_) => (run.drawn.len(), 1),
    });
    for _ in 0..draws {
        let value = T::any();
        if wanted(&value) {
            return value;
        }
        if draws > 1 {
            with(|run| run.drawn.truncate(before));
        }
    }
    panic::resume_unwind(Box::new(Rejected))
}

pub(crate) fn assume(condition: bool) {
    if !condition {
        panic::resume_unwind(Box::new(Rejected));
    }
}

pub(crate) fn check(condition: bool, message: &'static str, at: &'static Location<'static>) {
    with(|run| {
        *run.report.assertions.entry(message).or_default() += 1;
        if !condition {
            run.failed = Some((message, format!("{}:{}", at.file(), at.line())));
        }
    });
    if !condition {
        panic::resume_unwind(Box::new(Refuted));
    }
}

pub(crate) fn cover(condition: bool, line: u32, message: &'static str) {
    with(|run| *run.report.covers.entry((line, message)).or_default() += u64::from(condition));
}

/// `SplitMix64` by Steele and Vigna, biased towards decisive values: the ends of the range, and
/// values that were drawn shortly before.
struct Random {
    state: u64,
    recent: [u64; 8],
    next: usize,
}

impl Random {
    fn new(seed: u64) -> Self {
        Self { state: seed, recent: [0; 8], next: 0 }
    }

    fn word(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn any(&mut self, mask: u64) -> u64 {
        let choice = self.word();
        let near = self.recent[usize::from(choice.to_be_bytes()[0] % 8)];
        let value = match choice % 16 {
            0 => 0,
            1 => mask,
            2 => mask - 1,
            3..=5 => self.word() % 8,
            6 | 7 => near,
            8 => near.wrapping_add(1),
            9 => near.wrapping_sub(1),
            _ => self.word(),
        } & mask;
        if mask > 1 {
            self.recent[self.next] = value;
            self.next = (self.next + 1) % 8;
        }
        value
    }
}
