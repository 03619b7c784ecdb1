//! The shipped machine, with the types of a trace.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};

use fuseline_engine::arbiter::{Arbiter, decisions_of};
use fuseline_traces::{Decision, Header, Input};

/// The greatest number of clouds in a model.
pub(crate) const CLOUDS: usize = 3;
/// The greatest number of open timestamps in a model.
pub(crate) const WINDOW: usize = 3;

/// The shipped machine. A configuration may use less than its capacity.
pub(crate) type ModelMachine = Arbiter<CLOUDS, WINDOW>;

/// The machine's response to one input.
#[derive(Clone, Debug, Default)]
pub struct InputResponse {
    /// The firings that were due (F5).
    pub fired: Vec<FiredTimers>,
    /// The input's own decisions.
    pub own: Vec<Decision>,
    /// States whether the response is whole.
    pub end: WholeAnswer,
}

/// The consequences of the timers of one timestamp at one due instant.
#[derive(Clone, Debug)]
pub struct FiredTimers {
    /// The timestamp.
    pub t: u64,
    /// The due instant.
    pub due: u64,
    /// The decisions.
    pub decisions: Vec<Decision>,
}

/// States whether an input got its whole answer (F8).
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum WholeAnswer {
    /// The answer is whole.
    #[default]
    Whole,
    /// More timers fired than were live, and the machine continued.
    Endless,
    /// The machine panicked.
    Panicked,
}

impl InputResponse {
    /// Returns all decisions in the order of the trace.
    pub fn decisions(&self) -> impl Iterator<Item = &Decision> {
        self.fired.iter().flat_map(|fired| &fired.decisions).chain(&self.own)
    }
}

/// Creates a machine with this configuration, or returns `None` if it refuses the configuration.
pub(crate) fn machine(header: &Header) -> Option<ModelMachine> {
    ModelMachine::new(header).ok()
}

/// Gives the machine one input, and stops after `most` firings. Unless the answer is whole, the
/// machine must not be used again.
pub(crate) fn answer(machine: &mut ModelMachine, input: &Input, most: usize) -> InputResponse {
    // This is the answer if the machine panics.
    let mut answer = InputResponse { end: WholeAnswer::Panicked, ..InputResponse::default() };
    IN_MACHINE.set(true);
    let _ = panic::catch_unwind(AssertUnwindSafe(|| apply(machine, input, most, &mut answer)));
    IN_MACHINE.set(false);
    answer
}

/// Stops printing the machine's panics, which are in the answer.
pub fn silence_panic_output() {
    let print = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if !IN_MACHINE.get() {
            print(info);
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
            // Only a panic can leave a machine that never ends.
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
