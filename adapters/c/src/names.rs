//! The names of statuses, outcomes and reasons, as in SPEC.md.

use core::ffi::{CStr, c_char};

use crate::plain::{COutcome, CReason, CStatus};

/// The package's version.
pub(crate) const VERSION: &CStr =
    match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => NO_WORD,
    };

/// The name for a number that has no name of its own.
const NO_WORD: &CStr = c"?";

const STATUSES: [(CStatus, &CStr); 19] = [
    (CStatus::Done, c"done"),
    (CStatus::Again, c"again"),
    (CStatus::None, c"none"),
    (CStatus::Null, c"null"),
    (CStatus::Alignment, c"alignment"),
    (CStatus::Size, c"size"),
    (CStatus::Overlap, c"overlap"),
    (CStatus::Foreign, c"foreign"),
    (CStatus::Busy, c"busy"),
    (CStatus::Abi, c"abi"),
    (CStatus::Capacity, c"capacity"),
    (CStatus::Commit, c"commit"),
    (CStatus::Window, c"window"),
    (CStatus::Clouds, c"clouds"),
    (CStatus::Priority, c"priority"),
    (CStatus::Twice, c"twice"),
    (CStatus::Gate, c"gate"),
    (CStatus::Deadline, c"deadline"),
    (CStatus::MessageId, c"message_id"),
];

const OUTCOMES: [(COutcome, &CStr); 11] = [
    (COutcome::Nothing, c"nothing"),
    (COutcome::Accepted, c"accepted"),
    (COutcome::Refused, c"refused"),
    (COutcome::Admitted, c"admitted"),
    (COutcome::Held, c"held"),
    (COutcome::Forwarded, c"forwarded"),
    (COutcome::Dropped, c"dropped"),
    (COutcome::Missed, c"missed"),
    (COutcome::Waiting, c"waiting"),
    (COutcome::Preliminary, c"preliminary"),
    (COutcome::Final, c"final"),
];

const REASONS: [(CReason, &CStr); 12] = [
    (CReason::None, c"none"),
    (CReason::Order, c"order"),
    (CReason::Full, c"full"),
    (CReason::Deadline, c"deadline"),
    (CReason::Unknown, c"unknown"),
    (CReason::Closed, c"closed"),
    (CReason::Duplicate, c"duplicate"),
    (CReason::Outranked, c"outranked"),
    (CReason::Queue, c"queue"),
    (CReason::Superseded, c"superseded"),
    (CReason::Unsolicited, c"unsolicited"),
    (CReason::Late, c"late"),
];

pub(crate) fn status(number: u32) -> *const c_char {
    word(STATUSES.iter().find(|(status, _)| *status as u32 == number).map(|(_, word)| *word))
}

pub(crate) fn outcome(number: u32) -> *const c_char {
    word(OUTCOMES.iter().find(|(outcome, _)| *outcome as u32 == number).map(|(_, word)| *word))
}

pub(crate) fn reason(number: u32) -> *const c_char {
    word(REASONS.iter().find(|(reason, _)| *reason as u32 == number).map(|(_, word)| *word))
}

fn word(word: Option<&'static CStr>) -> *const c_char {
    word.unwrap_or(NO_WORD).as_ptr()
}
