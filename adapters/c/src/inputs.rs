//! Writes the answers of a machine of any capacity into the plain data of the interface.

use core::mem::MaybeUninit;

use fuseline_core::{
    Admission, DropReason, Firing, Fusion, Instant, OfferRefusal, OpenRefusal, Opening, Outcome,
    Priorities, Priority, Source, Timestamp,
};

use crate::plain::{CAnswer, CMessage, COutcome, CReason, CState, CStatus, FUSELINE_SOURCES};

/// The place for an answer.
pub(crate) type AnswerPointer<'a, T> = &'a mut MaybeUninit<T>;

/// Writes the value, or returns [`CStatus::None`] and writes nothing if there is none.
pub(crate) fn answer_list<T>(value: Option<T>, target: AnswerPointer<T>) -> CStatus {
    match value {
        Some(value) => {
            target.write(value);
            CStatus::Done
        }
        None => CStatus::None,
    }
}

pub(crate) fn looked<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
) -> CState {
    let due = fusion.next_due();
    CState {
        now: fusion.now().as_nanos(),
        newest: fusion.newest().map_or(0, Timestamp::as_u64),
        due: due.map_or(0, Instant::as_nanos),
        has_newest: fusion.newest().is_some().into(),
        has_due: due.is_some().into(),
        open_len: small(fusion.len()),
        window: small(fusion.window()),
    }
}

pub(crate) fn looked_at<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    t: Timestamp,
) -> Option<CMessage> {
    let slot = fusion.slot(t)?;
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
    let sources = core::iter::once(Source::LOCAL).chain(fusion.clouds().iter());
    let places = message.dues.iter_mut().zip(&mut message.priorities);
    for ((due, priority), source) in places.zip(sources) {
        let named = fusion.priority(source);
        *due = fusion.due(t, named).map_or(0, Instant::as_nanos);
        *priority = named.as_u16();
        message.sources_len = message.sources_len.saturating_add(1);
    }
    Some(message)
}

pub(crate) fn write_opening(answer: &mut CAnswer, opening: Opening) {
    (answer.outcome, answer.why) = match opening {
        Opening::Accepted => (COutcome::Accepted, CReason::None),
        Opening::Refused(why) => (COutcome::Refused, open_refusal(why)),
    };
}

pub(crate) fn write_admission(answer: &mut CAnswer, admission: Admission) {
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

// Inlined, so that the firing goes from registers into the answer.
#[inline]
pub(crate) fn write_firing<const CLOUDS: usize>(answer: &mut CAnswer, firing: &Firing<CLOUDS>) {
    answer.fired = 1;
    answer.t = firing.timestamp.as_u64();
    answer.due = firing.due.as_nanos();
    answer.timers_len = list(&mut answer.timers, &firing.timers);
    write_answer(answer, &firing.outcome);
}

pub(crate) fn write_answer<const CLOUDS: usize>(answer: &mut CAnswer, outcome: &Outcome<CLOUDS>) {
    match outcome {
        Outcome::Dropped(why) => {
            answer.outcome = COutcome::Dropped;
            answer.why = drop_reason(*why);
        }
        Outcome::Held => answer.outcome = COutcome::Held,
        Outcome::Waiting => answer.outcome = COutcome::Waiting,
        Outcome::Missed => answer.outcome = COutcome::Missed,
        Outcome::Final { by } => {
            answer.outcome = COutcome::Final;
            answer.by = by.as_u16().into();
        }
        Outcome::Preliminary { by, cancelled } => {
            write_output(answer, COutcome::Preliminary, *by, cancelled);
        }
        Outcome::Forwarded { by, cancelled } => {
            write_output(answer, COutcome::Forwarded, *by, cancelled);
        }
    }
}

/// Writes an output, and the pending clouds that it cancels (F7, F9).
fn write_output<const CLOUDS: usize>(
    answer: &mut CAnswer,
    outcome: COutcome,
    by: Priority,
    cancelled: &Priorities<CLOUDS>,
) {
    answer.outcome = outcome;
    answer.by = by.as_u16().into();
    answer.cancelled_len = list(&mut answer.cancelled, cancelled);
}

/// Writes the members in ascending order and returns their number.
fn list<const CLOUDS: usize>(
    places: &mut [u16; FUSELINE_SOURCES],
    members: &Priorities<CLOUDS>,
) -> u32 {
    let mut len = 0;
    for ((target, member), counted) in places.iter_mut().zip(members.iter()).zip(1..) {
        *target = member.as_u16();
        len = counted;
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
