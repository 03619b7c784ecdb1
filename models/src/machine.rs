//! The shipped machine behind the words of the trace.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};

use fuseline_arbiter::{Arbiter, decisions_of};
use fuseline_traces::{Decision, Header, Input};

/// The most clouds that a model has.
pub(crate) const CLOUDS: usize = 3;
/// The most timestamps that a model has open.
pub(crate) const WINDOW: usize = 3;

/// The shipped machine; a configuration may use less than it holds.
pub(crate) type ModelMachine = Arbiter<CLOUDS, WINDOW>;

/// What the machine said to one input.
#[derive(Clone, Debug, Default)]
pub struct InputResponse {
    /// What was due (F5), firing by firing.
    pub fired: Vec<FiredTimers>,
    /// The input's own decisions.
    pub own: Vec<Decision>,
    /// How it came to an end.
    pub end: WholeAnswer,
}

/// What followed from the timers of one timestamp at one due instant.
#[derive(Clone, Debug)]
pub struct FiredTimers {
    /// The timestamp.
    pub t: u64,
    /// The due instant.
    pub due: u64,
    /// The decisions.
    pub decisions: Vec<Decision>,
}

/// Whether an input got its whole answer (F8).
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum WholeAnswer {
    /// Yes.
    #[default]
    Whole,
    /// More timers fired than were live, and it went on.
    Endless,
    /// The machine panicked.
    Panicked,
}

impl InputResponse {
    /// All decisions in the order of the trace.
    pub fn decisions(&self) -> impl Iterator<Item = &Decision> {
        self.fired.iter().flat_map(|fired| &fired.decisions).chain(&self.own)
    }
}

/// A machine so configured, or none if it refuses the configuration.
pub(crate) fn machine(header: &Header) -> Option<ModelMachine> {
    ModelMachine::new(header).ok()
}

/// Gives the machine one input, after at most `most` firings; it is no good any more unless the
/// answer is whole.
pub(crate) fn answer(machine: &mut ModelMachine, input: &Input, most: usize) -> InputResponse {
    // Until the machine says otherwise.
    let mut answer = InputResponse { end: WholeAnswer::Panicked, ..InputResponse::default() };
    IN_MACHINE.set(true);
    let _ = panic::catch_unwind(AssertUnwindSafe(|| apply(machine, input, most, &mut answer)));
    IN_MACHINE.set(false);
    answer
}

/// Prints no panic of the machine; it is in the answer.
pub fn hush() {
    let tell = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if !IN_MACHINE.get() {
            tell(info);
        }
    }));
}

thread_local! {
    static IN_MACHINE: Cell<bool> = const { Cell::new(false) };
}

fn apply(machine: &mut ModelMachine, input: &Input, most: usize, answer: &mut InputResponse) {
    let own = machine.apply(input, |at, firing| {
        if answer.fired.len() >= most {
            answer.end = WholeAnswer::Endless;
            // No other way leads out of a machine that never ends.
            panic!("more timers fired than were live");
        }
        let mut decisions = Vec::new();
        decisions_of(at, firing, |decision| decisions.push(decision));
        let (t, due) = (firing.timestamp.as_u64(), firing.due.as_nanos());
        answer.fired.push(FiredTimers { t, due, decisions });
    });
    own.decisions(machine.fusion().commit(), machine.now(), |decision| answer.own.push(decision));
    answer.end = WholeAnswer::Whole;
}
