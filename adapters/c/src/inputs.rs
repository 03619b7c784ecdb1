//! A machine of whatever capacity, in the plain data of the border.

use fuseline_core::{
    Admission, At, Deadline, DropReason, Firing, Fusion, Instant, OfferRefusal, OpenRefusal,
    Opening, Outcome, Priorities, Priority, Ready, Source, Timestamp,
};

use crate::plain::{CAnswer, CMessage, COutcome, CReason, CState, CStatus, FUSELINE_SOURCES};

/// An input of SPEC.md, without its instant.
#[derive(Clone, Copy)]
pub(crate) enum Asked {
    /// F1: a message came; with a deadline for local or none.
    Open(u64, Option<u64>),
    /// F2: the timestamp, the cloud, its deadline and the length of its queue.
    Offer(u64, u64, u64, u64),
    /// F3: the timestamp and the source.
    Result(u64, u64),
    /// F4: the timestamp and the source.
    Fail(u64, u64),
    /// F0.
    Tick,
}

/// What all capacities have in common.
pub(crate) trait Inputs {
    /// One firing (F5), or the input's own answer. `answer` is empty before.
    fn ask(&mut self, now: u64, asked: Asked, answer: &mut CAnswer) -> CStatus;
    /// The next due instant.
    fn next_due(&self) -> Option<u64>;
    /// What the machine knows of itself.
    fn state(&self) -> CState;
    /// What it knows of an open timestamp.
    fn message(&self, t: u64) -> Option<CMessage>;
    /// Whether a cloud's gate was left shut.
    fn is_shut(&self, cloud: u64) -> Option<bool>;
}

impl<const CLOUDS: usize, const WINDOW: usize> Inputs for Fusion<CLOUDS, WINDOW> {
    fn ask(&mut self, now: u64, asked: Asked, answer: &mut CAnswer) -> CStatus {
        answer.at = self.now().as_nanos().max(now);
        match self.at(Instant::from_nanos(now)) {
            At::Fired(firing) => {
                tell_firing(answer, &firing);
                CStatus::Again
            }
            At::Ready(ready) => {
                apply(ready, asked, answer);
                CStatus::Done
            }
        }
    }

    fn next_due(&self) -> Option<u64> {
        self.next_due().map(Instant::as_nanos)
    }

    fn state(&self) -> CState {
        let due = self.next_due();
        CState {
            now: self.now().as_nanos(),
            newest: self.newest().map_or(0, Timestamp::as_u64),
            due: due.map_or(0, Instant::as_nanos),
            has_newest: self.newest().is_some().into(),
            has_due: due.is_some().into(),
            open_len: small(self.len()),
            window: small(self.window()),
        }
    }

    fn message(&self, t: u64) -> Option<CMessage> {
        let slot = self.slot(Timestamp::new(t))?;
        let mut message = CMessage {
            dues: [0; FUSELINE_SOURCES],
            priorities: [0; FUSELINE_SOURCES],
            sources_len: 0,
            requested: slot.requested().bits().into(),
            pending: slot.pending().bits().into(),
            armed: slot.armed().bits().into(),
            cached: slot.cached().bits().into(),
            reserved: 0,
        };
        let sources = core::iter::once(Source::LOCAL).chain(self.clouds().iter());
        let places = message.dues.iter_mut().zip(&mut message.priorities);
        for ((due, priority), source) in places.zip(sources) {
            let named = self.priority(source);
            *due = self.due(Timestamp::new(t), named).map_or(0, Instant::as_nanos);
            *priority = named.as_u16();
            message.sources_len = message.sources_len.saturating_add(1);
        }
        Some(message)
    }

    fn is_shut(&self, cloud: u64) -> Option<bool> {
        Some(self.gate(priority(cloud)?)?.is_shut())
    }
}

fn apply<const CLOUDS: usize, const WINDOW: usize>(
    mut ready: Ready<'_, CLOUDS, WINDOW>,
    asked: Asked,
    answer: &mut CAnswer,
) {
    // F3 unknown, F4 unknown: what does not fit 16 bits cannot be registered (A18).
    let unknown = Outcome::Dropped(DropReason::Unknown);
    match asked {
        Asked::Open(t, deadline) => {
            answer.t = t;
            let opening = ready.open(Timestamp::new(t), deadline.map(Deadline::from_nanos));
            tell_opening(answer, opening);
        }
        Asked::Offer(t, p, deadline, backlog) => {
            answer.t = t;
            // F2 unknown: as for a result.
            let admission = priority(p).map_or(Admission::Refused(OfferRefusal::Unknown), |p| {
                ready.offer(Timestamp::new(t), p, Deadline::from_nanos(deadline), backlog)
            });
            tell_admission(answer, admission);
        }
        Asked::Result(t, p) => {
            answer.t = t;
            let outcome = priority(p).map_or(unknown, |p| ready.result(Timestamp::new(t), p));
            tell(answer, &outcome);
        }
        Asked::Fail(t, p) => {
            answer.t = t;
            let outcome = priority(p).map_or(unknown, |p| ready.fail(Timestamp::new(t), p));
            tell(answer, &outcome);
        }
        Asked::Tick => {}
    }
}

pub(crate) fn tell_opening(answer: &mut CAnswer, opening: Opening) {
    (answer.outcome, answer.why) = match opening {
        Opening::Accepted => (COutcome::Accepted, CReason::None),
        Opening::Refused(why) => (COutcome::Refused, open_refusal(why)),
    };
}

pub(crate) fn tell_admission(answer: &mut CAnswer, admission: Admission) {
    match admission {
        Admission::Admitted { due } => {
            answer.outcome = COutcome::Admitted;
            answer.due = due.as_nanos();
        }
        Admission::Refused(why) => {
            answer.outcome = COutcome::Refused;
            answer.why = offer_refusal(why);
        }
    }
}

pub(crate) fn tell_firing<const CLOUDS: usize>(answer: &mut CAnswer, firing: &Firing<CLOUDS>) {
    answer.fired = 1;
    answer.t = firing.timestamp.as_u64();
    answer.due = firing.due.as_nanos();
    answer.timers_len = list(&mut answer.timers, &firing.timers);
    tell(answer, &firing.outcome);
}

pub(crate) fn tell<const CLOUDS: usize>(answer: &mut CAnswer, outcome: &Outcome<CLOUDS>) {
    match outcome {
        Outcome::Dropped(why) => {
            answer.outcome = COutcome::Dropped;
            answer.why = drop_reason(*why);
        }
        Outcome::Held => answer.outcome = COutcome::Held,
        Outcome::Waiting => answer.outcome = COutcome::Waiting,
        Outcome::Missed => answer.outcome = COutcome::Missed,
        Outcome::Forwarded { by, cancelled } => {
            answer.outcome = COutcome::Forwarded;
            answer.by = by.as_u16().into();
            answer.cancelled_len = list(&mut answer.cancelled, cancelled);
        }
    }
}

/// Writes the members in ascending order and counts them.
fn list<const CLOUDS: usize>(
    places: &mut [u16; FUSELINE_SOURCES],
    members: &Priorities<CLOUDS>,
) -> u32 {
    let mut len = 0_u32;
    for (place, member) in places.iter_mut().zip(members.iter()) {
        *place = member.as_u16();
        len = len.saturating_add(1);
    }
    len
}

pub(crate) const fn open_refusal(why: OpenRefusal) -> CReason {
    match why {
        OpenRefusal::Order => CReason::Order,
        OpenRefusal::Full => CReason::Full,
        OpenRefusal::Deadline => CReason::Deadline,
    }
}

const fn offer_refusal(why: OfferRefusal) -> CReason {
    match why {
        OfferRefusal::Unknown => CReason::Unknown,
        OfferRefusal::Closed => CReason::Closed,
        OfferRefusal::Duplicate => CReason::Duplicate,
        OfferRefusal::Outranked => CReason::Outranked,
        OfferRefusal::Deadline => CReason::Deadline,
        OfferRefusal::Queue => CReason::Queue,
    }
}

const fn drop_reason(why: DropReason) -> CReason {
    match why {
        DropReason::Unknown => CReason::Unknown,
        DropReason::Superseded => CReason::Superseded,
        DropReason::Unsolicited => CReason::Unsolicited,
        DropReason::Duplicate => CReason::Duplicate,
        DropReason::Late => CReason::Late,
    }
}

pub(crate) fn priority(p: u64) -> Option<Priority> {
    u16::try_from(p).ok().map(Priority::new)
}

fn small(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}
