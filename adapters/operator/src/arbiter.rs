//! The core behind the words of the trace.

use fuseline_core::{
    Admission, At, Cloud, Commit, ConfigError, Deadline, DropReason, Firing, Fusion, Instant,
    OfferRefusal, OpenRefusal, Opening, Outcome, Priority, Timestamp,
};
use fuseline_traces as trace;
use fuseline_traces::{Decision, Header, Input, Refusal};

/// The most clouds that a machine can have.
const CLOUDS: usize = 15;
/// The greatest window that a machine can have.
const WINDOW: usize = 1024;

/// One operator's machine for whatever configuration a [`Header`] may hold.
///
/// It answers each input with its decisions, in the order of the trace; adapters act on them and
/// record them.
pub struct Arbiter {
    fusion: Box<Fusion<CLOUDS, WINDOW>>,
}

impl Arbiter {
    /// A machine so configured, with nothing open.
    ///
    /// # Errors
    /// Why the configuration is refused.
    pub fn new(header: &Header) -> Result<Self, ConfigError> {
        let clouds: Vec<Cloud> = header
            .clouds
            .iter()
            .map(|cloud| Cloud {
                priority: Priority::new(cloud.p),
                limit: cloud.limit,
                resume: cloud.resume,
            })
            .collect();
        let commit = match header.commit {
            trace::Commit::Eager => Commit::Eager,
            trace::Commit::Patient => Commit::Patient,
        };
        Ok(Self { fusion: Box::new(Fusion::new(usize::from(header.window), commit, &clouds)?) })
    }

    /// Applies one input and gives its decisions to `decide`, in their order.
    pub fn apply(&mut self, input: &Input, mut decide: impl FnMut(Decision)) {
        let now = Instant::from_nanos(input.at());
        let mut ready = loop {
            match self.fusion.at(now) {
                At::Fired(firing) => fired(self.fusion.now(), &firing, &mut decide),
                At::Ready(ready) => break ready,
            }
        };
        let at = ready.now().as_nanos();
        match *input {
            Input::Open { t, limit, .. } => {
                match ready.open(Timestamp::new(t), limit.map(Deadline::from_nanos)) {
                    Opening::Accepted => {}
                    Opening::Refused(why) => {
                        decide(Decision::Refuse { at, t, p: None, why: open_refusal(why) });
                    }
                }
            }
            Input::Offer { t, p, deadline, backlog, .. } => {
                // F2 unknown: what does not fit 16 bits cannot be registered.
                let answer = match u16::try_from(p) {
                    Ok(number) => ready.offer(
                        Timestamp::new(t),
                        Priority::new(number),
                        Deadline::from_nanos(deadline),
                        backlog,
                    ),
                    Err(_) => Admission::Refused(OfferRefusal::Unknown),
                };
                decide(match answer {
                    Admission::Admitted { due } => {
                        Decision::Request { at, t, p, due: due.as_nanos() }
                    }
                    Admission::Refused(why) => {
                        Decision::Refuse { at, t, p: Some(p), why: offer_refusal(why) }
                    }
                });
            }
            Input::Result { t, p, .. } => {
                let outcome = match u16::try_from(p) {
                    Ok(number) => ready.result(Timestamp::new(t), Priority::new(number)),
                    Err(_) => Outcome::Dropped(DropReason::Unknown),
                };
                conclude(at, t, Some(p), &outcome, &mut decide);
            }
            Input::Fail { t, p, .. } => {
                let outcome = match u16::try_from(p) {
                    Ok(number) => ready.fail(Timestamp::new(t), Priority::new(number)),
                    Err(_) => Outcome::Dropped(DropReason::Unknown),
                };
                conclude(at, t, Some(p), &outcome, &mut decide);
            }
            Input::Tick { .. } => {}
        }
    }

    /// Lets time go by up to `at`, nanoseconds, and gives what F5 decides to `decide`.
    ///
    /// [`apply`](Self::apply) begins with it; doing it before tells the timers' decisions from the
    /// input's own.
    pub fn expire(&mut self, at: u64, mut decide: impl FnMut(Decision)) {
        while let At::Fired(firing) = self.fusion.at(Instant::from_nanos(at)) {
            fired(self.fusion.now(), &firing, &mut decide);
        }
    }

    /// The earliest instant at which a timer is due, in nanoseconds.
    #[must_use]
    pub fn next_due(&self) -> Option<u64> {
        self.fusion.next_due().map(Instant::as_nanos)
    }

    /// How many timestamps are open.
    #[must_use]
    pub fn open_len(&self) -> usize {
        self.fusion.len()
    }
}

/// Writes what timers decided (F5).
fn fired(now: Instant, firing: &Firing<CLOUDS>, decide: &mut impl FnMut(Decision)) {
    let (at, t) = (now.as_nanos(), firing.timestamp.as_u64());
    for p in firing.timers.iter() {
        decide(Decision::Timer { at, t, p: p.as_u16().into() });
    }
    conclude(at, t, None, &firing.outcome, decide);
}

/// Writes an outcome; `source` is whose result or failure it answers, if it is not timers'.
fn conclude(
    at: u64,
    t: u64,
    source: Option<u64>,
    outcome: &Outcome<CLOUDS>,
    decide: &mut impl FnMut(Decision),
) {
    let p = source.unwrap_or_default();
    match outcome {
        Outcome::Dropped(why) => decide(Decision::Drop { at, t, p, why: drop_reason(*why) }),
        Outcome::Held => decide(Decision::Hold { at, t, p }),
        Outcome::Waiting => {}
        Outcome::Missed => decide(Decision::Miss { at, t }),
        Outcome::Forwarded { by, cancelled } => {
            decide(Decision::Emit { at, t, p: by.as_u16().into() });
            for p in cancelled.iter() {
                decide(Decision::Cancel { at, t, p: p.as_u16().into() });
            }
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

fn drop_reason(why: DropReason) -> trace::DropReason {
    match why {
        DropReason::Unknown => trace::DropReason::Unknown,
        DropReason::Superseded => trace::DropReason::Superseded,
        DropReason::Unsolicited => trace::DropReason::Unsolicited,
        DropReason::Duplicate => trace::DropReason::Duplicate,
        DropReason::Late => trace::DropReason::Late,
    }
}
