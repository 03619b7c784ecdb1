//! The bridge from the machine to the trace: it applies one input, answers in the core's own types, and
//! makes the trace's lines from them for those who record.
//!
//! It decides nothing itself and keeps nothing but the machine. The operator around it is
//! `Engine`.

mod answer;
mod reason;

use fuseline_core::{
    Admission, Cloud, Commit, ConfigError, Deadline, DropReason, Firing, Fusion, Instant,
    OfferRefusal, Opening, Outcome, Priority, Ready, Timestamp,
};
use fuseline_traces as trace;
use fuseline_traces::{Decision, Header, Input};

pub use answer::{Answer, decisions_of};
pub use reason::{drop_reason, offer_refusal, open_refusal};

/// The most clouds that a header may have.
#[cfg(feature = "operator")]
pub(crate) const CLOUDS: usize = 15;

/// One operator's machine: takes the numbers of a trace, answers in the core's types.
///
/// Instants and durations are nanoseconds. Each input first gives every firing (F5) to `fired`, with
/// the instant at which it is served. The default capacities suffice for any [`Header`]. Two arbiters
/// are equal if their machines are.
///
/// - constructor: [`new`](Self::new)
/// - inputs: [`open`](Self::open), [`offer`](Self::offer), [`result`](Self::result),
///   [`fail`](Self::fail), [`tick`](Self::tick); any of them: [`apply`](Self::apply),
///   [`decide`](Self::decide)
/// - questions: [`next_due`](Self::next_due), [`now`](Self::now),
///   [`offer_refusal`](Self::offer_refusal), [`fusion`](Self::fusion)
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Arbiter<const CLOUDS: usize = { self::CLOUDS }, const WINDOW: usize = 1024> {
    /// Boxed: the largest takes 178 KiB.
    fusion: Box<Fusion<CLOUDS, WINDOW>>,
}

impl<const CLOUDS: usize, const WINDOW: usize> Arbiter<CLOUDS, WINDOW> {
    /// A machine with this configuration and nothing open.
    ///
    /// # Errors
    /// The first [`ConfigError`] that holds.
    pub fn new(header: &Header) -> Result<Self, ConfigError> {
        let cloud = |cloud: &trace::Cloud| Cloud {
            priority: Priority::new(cloud.p),
            limit: cloud.limit,
            resume: cloud.resume,
        };
        let clouds: Vec<Cloud> = header.clouds.iter().map(cloud).collect();
        let commit = match header.commit {
            trace::Commit::Eager => Commit::Eager,
            trace::Commit::Patient => Commit::Patient,
            trace::Commit::Progressive => Commit::Progressive,
        };
        Ok(Self { fusion: Box::new(Fusion::new(usize::from(header.window), commit, &clouds)?) })
    }

    /// F1: a message came.
    pub fn open(
        &mut self,
        at: u64,
        t: u64,
        deadline: Option<u64>,
        fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Opening {
        self.ready(at, fired).open(Timestamp::new(t), deadline.map(Deadline::from_nanos))
    }

    /// F2: a message handler wants a request sent to cloud `p`.
    pub fn offer(
        &mut self,
        at: u64,
        (t, p): (u64, u64),
        deadline: u64,
        backlog: u64,
        fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Admission {
        let mut ready = self.ready(at, fired);
        match priority(p) {
            Some(p) => ready.offer(Timestamp::new(t), p, Deadline::from_nanos(deadline), backlog),
            // F2 unknown: a priority beyond 16 bits cannot be registered.
            None => Admission::Refused(OfferRefusal::Unknown),
        }
    }

    /// F3: the result of source `p` came.
    pub fn result(
        &mut self,
        at: u64,
        (t, p): (u64, u64),
        fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Outcome<CLOUDS> {
        let mut ready = self.ready(at, fired);
        match priority(p) {
            Some(p) => ready.result(Timestamp::new(t), p),
            // F3 unknown: as for an offer.
            None => Outcome::Dropped(DropReason::Unknown),
        }
    }

    /// F4: source `p` will send no result.
    pub fn fail(
        &mut self,
        at: u64,
        (t, p): (u64, u64),
        fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Outcome<CLOUDS> {
        let mut ready = self.ready(at, fired);
        match priority(p) {
            Some(p) => ready.fail(Timestamp::new(t), p),
            // F4 unknown: as for a result.
            None => Outcome::Dropped(DropReason::Unknown),
        }
    }

    /// F0: time went by.
    pub fn tick(&mut self, at: u64, fired: impl FnMut(u64, &Firing<CLOUDS>)) {
        let _: Ready<'_, CLOUDS, WINDOW> = self.ready(at, fired);
    }

    /// Applies whichever input it is.
    pub fn apply(
        &mut self,
        input: &Input,
        fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Answer<CLOUDS> {
        match *input {
            Input::Open { at, t, deadline } => {
                Answer::Open { t, opening: self.open(at, t, deadline, fired) }
            }
            Input::Offer { at, t, p, deadline, backlog } => {
                let admission = self.offer(at, (t, p), deadline, backlog, fired);
                Answer::Offer { t, p, admission }
            }
            Input::Result { at, t, p } => {
                Answer::Result { t, p, outcome: self.result(at, (t, p), fired) }
            }
            Input::Fail { at, t, p } => {
                Answer::Fail { t, p, outcome: self.fail(at, (t, p), fired) }
            }
            Input::Tick { at } => {
                self.tick(at, fired);
                Answer::Tick
            }
        }
    }

    /// Applies an input and gives its decisions to `decide`, in the order of the trace.
    pub fn decide(&mut self, input: &Input, mut decide: impl FnMut(Decision)) {
        let answer = self.apply(input, |at, firing| decisions_of(at, firing, &mut decide));
        answer.decisions(self.fusion.commit(), self.now(), decide);
    }

    /// The earliest instant, in ns, at which a timer is due; none if no timer is armed. Tick then.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.fusion.next_due().map(Instant::as_nanos)
    }

    /// The machine's clock, in ns.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.fusion.now().as_nanos()
    }

    /// F2: why an offer would be refused as things stand, or none if it would be admitted; changes
    /// nothing.
    ///
    /// What is due after [`now`](Self::now) has not fired yet: [`tick`](Self::tick) first.
    #[must_use]
    pub fn offer_refusal(
        &self,
        (t, p): (u64, u64),
        deadline: u64,
        backlog: u64,
    ) -> Option<OfferRefusal> {
        // F2 unknown: as for an offer.
        let Some(p) = priority(p) else { return Some(OfferRefusal::Unknown) };
        let deadline = Deadline::from_nanos(deadline);
        self.fusion.offer_refusal(Timestamp::new(t), p, deadline, backlog)
    }

    /// The machine, for further questions.
    #[must_use]
    pub fn fusion(&self) -> &Fusion<CLOUDS, WINDOW> {
        &self.fusion
    }

    /// The machine, with everything due by `at` fired.
    fn ready(
        &mut self,
        at: u64,
        mut fired: impl FnMut(u64, &Firing<CLOUDS>),
    ) -> Ready<'_, CLOUDS, WINDOW> {
        // F0: timers are served at the clock's instant, which never goes back.
        let served = self.now().max(at);
        self.fusion.ready(Instant::from_nanos(at), |firing| fired(served, &firing))
    }
}

fn priority(p: u64) -> Option<Priority> {
    u16::try_from(p).ok().map(Priority::new)
}
