//! What the machine would have put out, had every request had the same deadline.

use std::time::Duration;

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Cloud, Commit, Decision, Header, Input};

use fuseline_report::{Arrival, Forwarded};

/// The one timestamp of each run.
const T: u64 = 0;

/// Fusion with one deadline for all requests.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Constant {
    pub(crate) deadline: Duration,
    /// The clouds' priorities, in the order of the sources; no two are the same.
    pub(crate) priorities: Vec<u16>,
}

impl Constant {
    /// What becomes of a message by the machine itself; none if it is missed.
    ///
    /// Each source's result arrives as given. An arrival that is unknown does not happen.
    pub(super) fn forwarded(&self, arrivals: &[Arrival]) -> Option<Forwarded> {
        let mut machine = Machine::new(self)?;
        machine.input(Input::Open { at: 0, t: T, deadline: None });
        let places = || [0].into_iter().chain(self.priorities.iter().copied().map(u64::from));
        for p in places().skip(1) {
            let deadline = nanos(self.deadline);
            machine.input(Input::Offer { at: 0, t: T, p, deadline, backlog: 0 });
        }
        let mut ends: Vec<(u64, Input)> =
            arrivals.iter().zip(places()).filter_map(|(arrival, p)| end(*arrival, p)).collect();
        ends.sort_by_key(|(at, _)| *at);
        for (at, end) in ends {
            machine.until(at);
            machine.input(end);
        }
        machine.until(u64::MAX);
        let (p, at) = machine.emitted?;
        let source = places().position(|place| place == p)?;
        Some(Forwarded { source, response: Duration::from_nanos(at) })
    }
}

/// When and how a source's part ends, if it is known to.
fn end(arrival: Arrival, p: u64) -> Option<(u64, Input)> {
    match arrival {
        Arrival::At(at) => Some((nanos(at), Input::Result { at: nanos(at), t: T, p })),
        Arrival::Failed(at) => Some((nanos(at), Input::Fail { at: nanos(at), t: T, p })),
        Arrival::After(_) | Arrival::Never => None,
    }
}

/// The machine with one timestamp.
struct Machine {
    arbiter: Arbiter<15, 1>,
    /// Whose result went, and when.
    emitted: Option<(u64, u64)>,
}

impl Machine {
    fn new(constant: &Constant) -> Option<Self> {
        let cloud = |p: &u16| Cloud { p: *p, name: None, limit: 1, resume: 0 };
        let clouds = constant.priorities.iter().map(cloud).collect();
        // All timers fire at once, so either rule decides the same.
        let header = Header { operator: None, window: 1, commit: Commit::Eager, clouds };
        Some(Self { arbiter: Arbiter::new(&header).ok()?, emitted: None })
    }

    /// Lets each timer fire that is due by then.
    fn until(&mut self, at: u64) {
        while let Some(due) = self.arbiter.next_due().filter(|due| *due <= at) {
            self.input(Input::Tick { at: due });
        }
    }

    fn input(&mut self, input: Input) {
        let emitted = &mut self.emitted;
        self.arbiter.decide(&input, |decision| {
            if let Decision::Emit { at, p, .. } = decision {
                *emitted = Some((p, at));
            }
        });
    }
}

fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn at(millis: u64) -> Arrival {
        Arrival::At(ms(millis))
    }

    /// The first cloud outranks the second.
    fn forwarded(arrivals: [Arrival; 3]) -> Option<(usize, u128)> {
        let constant = Constant { deadline: ms(500), priorities: vec![9, 4] };
        let forwarded = constant.forwarded(&arrivals)?;
        Some((forwarded.source, forwarded.response.as_millis()))
    }

    #[test]
    fn a_message_ends_as_the_machine_ends_it() {
        let (failed, never) = (|millis| Arrival::Failed(ms(millis)), Arrival::Never);
        for (arrivals, expected) in [
            ([at(300), at(150), at(100)], Some((1, 150))),
            // What is there waits for what is better, until the due instant, which is late itself.
            ([at(300), at(500), at(100)], Some((2, 500))),
            ([at(300), at(499), at(100)], Some((1, 499))),
            ([at(300), at(600), at(100)], Some((2, 500))),
            ([at(300), never, never], Some((0, 500))),
            ([at(700), never, at(600)], Some((0, 700))),
            // What failed, or was not asked for, is not waited for.
            ([at(300), failed(40), at(100)], Some((2, 100))),
            ([at(300), failed(0), failed(0)], Some((0, 300))),
            ([at(300), failed(350), failed(320)], Some((0, 350))),
            ([failed(0), never, failed(0)], None),
            ([at(300), Arrival::After(ms(200)), at(100)], Some((2, 500))),
        ] {
            assert_eq!(forwarded(arrivals), expected, "{arrivals:?}");
        }
    }
}
