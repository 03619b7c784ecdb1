//! The shipped machine behind the words of the trace.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};

use fuseline_core as core;
use fuseline_core::{
    Admission, At, Deadline, Firing, Fusion, Instant, OfferRefusal, OpenRefusal, Opening, Outcome,
    Priority, Ready, Timestamp,
};
use fuseline_traces::{Commit, Decision, DropReason, Header, Input, Refusal};

/// The most clouds that a model has.
pub(crate) const CLOUDS: usize = 3;
/// The most timestamps that a model has open.
pub(crate) const WINDOW: usize = 3;

/// The shipped machine; a configuration may use less than it holds.
pub(crate) type Machine = Fusion<CLOUDS, WINDOW>;

/// What the machine said to one input.
#[derive(Clone, Debug, Default)]
pub struct Answer {
    /// What was due (F5), firing by firing.
    pub fired: Vec<Fired>,
    /// The input's own decisions.
    pub own: Vec<Decision>,
    /// How it came to an end.
    pub end: End,
}

/// What followed from the timers of one timestamp at one due instant.
#[derive(Clone, Debug)]
pub struct Fired {
    /// The timestamp.
    pub t: u64,
    /// The due instant.
    pub due: u64,
    /// The decisions.
    pub decisions: Vec<Decision>,
}

/// Whether an input got its whole answer (F8).
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum End {
    /// Yes.
    #[default]
    Whole,
    /// More timers fired than were live, and it went on.
    Endless,
    /// The machine panicked.
    Panicked,
}

impl Answer {
    /// All decisions in the order of the trace.
    pub fn decisions(&self) -> impl Iterator<Item = &Decision> {
        self.fired.iter().flat_map(|fired| &fired.decisions).chain(&self.own)
    }
}

/// A machine so configured, or none if it refuses the configuration.
pub(crate) fn machine(header: &Header) -> Option<Machine> {
    let clouds = header.clouds.iter();
    let clouds: Vec<_> = clouds
        .map(|cloud| core::Cloud {
            priority: Priority::new(cloud.p),
            limit: cloud.limit,
            resume: cloud.resume,
        })
        .collect();
    let commit = match header.commit {
        Commit::Eager => core::Commit::Eager,
        Commit::Patient => core::Commit::Patient,
    };
    Machine::new(usize::from(header.window), commit, &clouds).ok()
}

/// Gives the machine one input, after at most `most` firings; it is no good any more unless the
/// answer is whole.
pub(crate) fn answer(machine: &mut Machine, input: &Input, most: usize) -> Answer {
    let mut answer = Answer::default();
    let end = IN_MACHINE.with(|inside| {
        inside.set(true);
        let end =
            panic::catch_unwind(AssertUnwindSafe(|| apply(machine, input, most, &mut answer)));
        inside.set(false);
        end
    });
    answer.end = end.unwrap_or(End::Panicked);
    answer
}

/// Lets no panic of the machine be told; it is in the answer.
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

fn apply(machine: &mut Machine, input: &Input, most: usize, answer: &mut Answer) -> End {
    let now = Instant::from_nanos(input.at());
    for _ in 0..=most {
        match machine.at(now) {
            At::Fired(firing) => answer.fired.push(fired(machine.now().as_nanos(), &firing)),
            At::Ready(ready) => {
                own(ready, input, &mut answer.own);
                return End::Whole;
            }
        }
    }
    End::Endless
}

fn fired(at: u64, firing: &Firing<CLOUDS>) -> Fired {
    let t = firing.timestamp.as_u64();
    let timer = |p: Priority| Decision::Timer { at, t, p: p.as_u16().into() };
    let mut decisions = firing.timers.iter().map(timer).collect();
    conclude(at, t, 0, &firing.outcome, &mut decisions);
    Fired { t, due: firing.due.as_nanos(), decisions }
}

/// The input's own decisions.
fn own(mut ready: Ready<'_, CLOUDS, WINDOW>, input: &Input, out: &mut Vec<Decision>) {
    let at = ready.now().as_nanos();
    match *input {
        Input::Open { t, limit, .. } => {
            match ready.open(Timestamp::new(t), limit.map(Deadline::from_nanos)) {
                Opening::Accepted => {}
                Opening::Refused(why) => {
                    out.push(Decision::Refuse { at, t, p: None, why: open_refusal(why) });
                }
            }
        }
        Input::Offer { t, p, deadline, backlog, .. } => {
            let deadline = Deadline::from_nanos(deadline);
            // F2 unknown: what does not fit 16 bits cannot be registered.
            let admission = match u16::try_from(p) {
                Ok(p) => ready.offer(Timestamp::new(t), Priority::new(p), deadline, backlog),
                Err(_) => Admission::Refused(OfferRefusal::Unknown),
            };
            out.push(match admission {
                Admission::Admitted { due } => Decision::Request { at, t, p, due: due.as_nanos() },
                Admission::Refused(why) => {
                    Decision::Refuse { at, t, p: Some(p), why: offer_refusal(why) }
                }
            });
        }
        Input::Result { t, p, .. } => {
            let outcome = match u16::try_from(p) {
                Ok(number) => ready.result(Timestamp::new(t), Priority::new(number)),
                Err(_) => Outcome::Dropped(core::DropReason::Unknown),
            };
            conclude(at, t, p, &outcome, out);
        }
        Input::Fail { t, p, .. } => {
            let outcome = match u16::try_from(p) {
                Ok(number) => ready.fail(Timestamp::new(t), Priority::new(number)),
                Err(_) => Outcome::Dropped(core::DropReason::Unknown),
            };
            conclude(at, t, p, &outcome, out);
        }
        Input::Tick { .. } => {}
    }
}

/// Writes an outcome; `p` is whose result or failure it answers.
fn conclude(at: u64, t: u64, p: u64, outcome: &Outcome<CLOUDS>, out: &mut Vec<Decision>) {
    match outcome {
        Outcome::Dropped(why) => out.push(Decision::Drop { at, t, p, why: drop_reason(*why) }),
        Outcome::Held => out.push(Decision::Hold { at, t, p }),
        Outcome::Waiting => {}
        Outcome::Missed => out.push(Decision::Miss { at, t }),
        Outcome::Forwarded { by, cancelled } => {
            out.push(Decision::Emit { at, t, p: by.as_u16().into() });
            let cancel = |p: Priority| Decision::Cancel { at, t, p: p.as_u16().into() };
            out.extend(cancelled.iter().map(cancel));
        }
    }
}

fn open_refusal(why: OpenRefusal) -> Refusal {
    match why {
        OpenRefusal::Order => Refusal::Order,
        OpenRefusal::Full => Refusal::Full,
        OpenRefusal::Deadline => Refusal::Deadline,
    }
}

fn offer_refusal(why: OfferRefusal) -> Refusal {
    match why {
        OfferRefusal::Unknown => Refusal::Unknown,
        OfferRefusal::Closed => Refusal::Closed,
        OfferRefusal::Duplicate => Refusal::Duplicate,
        OfferRefusal::Outranked => Refusal::Outranked,
        OfferRefusal::Deadline => Refusal::Deadline,
        OfferRefusal::Queue => Refusal::Queue,
    }
}

fn drop_reason(why: core::DropReason) -> DropReason {
    match why {
        core::DropReason::Unknown => DropReason::Unknown,
        core::DropReason::Superseded => DropReason::Superseded,
        core::DropReason::Unsolicited => DropReason::Unsolicited,
        core::DropReason::Duplicate => DropReason::Duplicate,
        core::DropReason::Late => DropReason::Late,
    }
}
