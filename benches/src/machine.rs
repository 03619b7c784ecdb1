//! A machine that takes a trace's inputs and counts its decisions.

use fuseline_core::{
    Admission, At, Deadline, Fusion, Instant, Opening, Outcome, Priority, Timestamp,
};
use fuseline_traces::Input;

/// Counts each kind of decision. Machines that decide the same way have equal counts.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug)]
pub struct DecisionTally {
    /// Opens accepted and offers admitted.
    pub admitted: u64,
    /// Opens and offers refused.
    pub refused: u64,
    /// Results held.
    pub held: u64,
    /// Results and failures dropped.
    pub dropped: u64,
    /// Sums of the forwarded priorities plus one.
    pub forwarded: u64,
    /// Timestamps missed.
    pub missed: u64,
    /// Timers fired.
    pub timers: u64,
}

/// A machine under measurement.
pub trait Machine {
    /// Applies one input.
    fn apply(&mut self, input: &Input, tally: &mut DecisionTally);
}

impl<const CLOUDS: usize, const WINDOW: usize> Machine for Fusion<CLOUDS, WINDOW> {
    #[inline]
    fn apply(&mut self, input: &Input, tally: &mut DecisionTally) {
        let mut ready = loop {
            match self.at(Instant::from_nanos(input.at())) {
                At::Fired(firing) => {
                    tally.timers += firing.timers.iter().count() as u64;
                    count(&firing.outcome, tally);
                }
                At::Ready(ready) => break ready,
            }
        };
        match *input {
            Input::Open { t, deadline, .. } => {
                match ready.open(Timestamp::new(t), deadline.map(Deadline::from_nanos)) {
                    Opening::Accepted => tally.admitted += 1,
                    Opening::Refused(_) => tally.refused += 1,
                }
            }
            Input::Offer { t, p, deadline, backlog, .. } => {
                let deadline = Deadline::from_nanos(deadline);
                match ready.offer(Timestamp::new(t), priority(p), deadline, backlog) {
                    Admission::Admitted { .. } => tally.admitted += 1,
                    Admission::Refused(_) => tally.refused += 1,
                }
            }
            Input::Result { t, p, .. } => {
                count(&ready.result(Timestamp::new(t), priority(p)), tally);
            }
            Input::Fail { t, p, .. } => count(&ready.fail(Timestamp::new(t), priority(p)), tally),
            Input::Tick { .. } => {}
        }
    }
}

fn priority(p: u64) -> Priority {
    Priority::new(u16::try_from(p).unwrap_or(u16::MAX))
}

fn count<const CLOUDS: usize>(outcome: &Outcome<CLOUDS>, tally: &mut DecisionTally) {
    match outcome {
        Outcome::Dropped(_) => tally.dropped += 1,
        Outcome::Held => tally.held += 1,
        Outcome::Waiting | Outcome::Final { .. } => {}
        Outcome::Forwarded { by, .. } | Outcome::Preliminary { by, .. } => {
            tally.forwarded += u64::from(by.as_u16()) + 1;
        }
        Outcome::Missed => tally.missed += 1,
    }
}
