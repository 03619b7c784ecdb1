//! The exported functions for the machine that many threads call without a lock (SPEC.md, section
//! 8).
//!
//! As in `calls`, a wrong call is answered with a status and changes nothing.
#![expect(unsafe_code, reason = "a C interface reads and writes through its caller's pointers")]
#![expect(clippy::doc_markdown, reason = "these texts are the header's, which has no markdown")]
#![expect(clippy::missing_safety_doc, reason = "the header's preamble says it once for all calls")]

use core::ffi::c_void;

use crate::header::{StorageHeader, answer_target};
use crate::plain::{CAnswer, CConfig, CMessageId, COutcome, CStatus};
use crate::shared_storage::{self, AnswerList, CShared, InputKind};

/// Returns the number of bytes of storage that a machine for many threads takes, or 0 if the
/// library was not built for the capacity. The storage must be aligned to 64 bytes.
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_shared_bytes(capacity: u32) -> usize {
    shared_storage::bytes(capacity)
}

/// Makes a machine for many threads (SPEC.md, section 8) in `storage`, which is aligned to 64
/// bytes. Otherwise it works as fuseline_init.
///
/// One thread at a time, the owner, opens and offers. Any thread reports results, failures and the
/// passing of time, each for one message id. Call no function of the machine before this one has
/// returned, and none while or after it is ended.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_init(
    storage: *mut c_void,
    bytes: usize,
    config: *const CConfig,
    machine: *mut *mut CShared,
) -> CStatus {
    // SAFETY: as the header requires.
    match unsafe { shared_storage::make(storage, bytes, config, machine) } {
        Ok(()) => CStatus::Done,
        Err(status) => status,
    }
}

/// Ends a machine when no thread calls it any more. Its storage is the caller's again.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_end(machine: *mut CShared) -> CStatus {
    // SAFETY: as the header requires.
    if let Err(status) = unsafe { StorageHeader::of(machine, &[]) } {
        return status;
    }
    // SAFETY: it is one, and no other call uses it, as the header requires.
    unsafe { StorageHeader::end(machine) };
    CStatus::Done
}

/// Opens timestamp `t`, because its message arrived (F1). Only the owner may call this. If the
/// message is accepted, `*message_id` identifies it. Otherwise `*message_id` identifies nothing.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_open(
    machine: *mut CShared,
    now: u64,
    t: u64,
    message_id: *mut CMessageId,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    unsafe { open(machine, (now, t, None), message_id, answer) }
}

/// Opens timestamp `t`, for which local may take `deadline` nanoseconds (F1). Only the owner may
/// call this.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_open_within(
    machine: *mut CShared,
    now: u64,
    t: u64,
    deadline: u64,
    message_id: *mut CMessageId,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    unsafe { open(machine, (now, t, Some(deadline)), message_id, answer) }
}

/// Asks whether the message may be sent to cloud `p`, which may take `deadline` nanoseconds (F2).
/// `backlog` is the number of other requests in the cloud's outgoing queue. Only the owner may call
/// this. `fired` receives the message's timers that were due by `now`. A function with two answers
/// needs two objects for them; otherwise it returns FUSELINE_STATUS_OVERLAP.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_offer(
    machine: *mut CShared,
    now: u64,
    message_id: CMessageId,
    p: u64,
    deadline: u64,
    backlog: u64,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    let answer_list = unsafe {
        shared_storage::owner(
            machine,
            &[answer_target(fired), answer_target(answer)],
            |owner, header| {
                shared_storage::named(machine, message_id).map(|message_id| {
                    owner.offer(now, message_id, (p, header.deadline(deadline), backlog))
                })
            },
        )
    };
    let answer_list = answer_list.and_then(|answer_list| answer_list);
    // SAFETY: as the header requires.
    answer_list
        .map_or_else(|status| status, |answer_list| unsafe { write(&answer_list, fired, answer) })
}

/// Reports the result of source `p` (F3). Any thread may call this. `fired` receives the message's
/// timers that were due by `now`, as one firing even if they had several due instants. If a message
/// is forwarded, exactly one caller gets FUSELINE_OUTCOME_FORWARDED. Under progressive exactly one
/// caller gets each output, and exactly one gets the end.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_result(
    machine: *mut CShared,
    now: u64,
    message_id: CMessageId,
    p: u64,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    unsafe { bring(machine, now, message_id, InputKind::Result(p), fired, answer) }
}

/// Reports that no result will come from source `p` (F4). Any thread may call this.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_fail(
    machine: *mut CShared,
    now: u64,
    message_id: CMessageId,
    p: u64,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    unsafe { bring(machine, now, message_id, InputKind::Failure(p), fired, answer) }
}

/// Lets time pass for this message (F5). Any thread may call this.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_expire(
    machine: *mut CShared,
    now: u64,
    message_id: CMessageId,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    unsafe { bring(machine, now, message_id, InputKind::Time, fired, answer) }
}

/// Writes the next due instant of this message's timers. Returns FUSELINE_STATUS_NONE if none is
/// armed. Any thread may call this.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_next_due(
    machine: *mut CShared,
    message_id: CMessageId,
    due: *mut u64,
) -> CStatus {
    // SAFETY: as the header requires.
    let due_instant = unsafe {
        shared_storage::handle(machine, &[answer_target(due)], |handle| {
            shared_storage::named(machine, message_id).map(|message_id| handle.next_due(message_id))
        })
    };
    match due_instant.and_then(|due_instant| due_instant) {
        Ok(Some(due_instant)) => {
            // SAFETY: not null, aligned, outside the machine, and the header requires that it may
            // be written.
            unsafe { due.write(due_instant) };
            CStatus::Done
        }
        Ok(None) => CStatus::None,
        Err(status) => status,
    }
}

/// # Safety
/// As the header requires.
unsafe fn open(
    machine: *mut CShared,
    (now, t, deadline): (u64, u64, Option<u64>),
    message_id: *mut CMessageId,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header requires.
    let opened = unsafe {
        shared_storage::owner(
            machine,
            &[answer_target(message_id), answer_target(answer)],
            |owner, header| owner.open(now, t, deadline.map(|deadline| header.deadline(deadline))),
        )
    };
    let mut answer_list = CAnswer { at: now, t, outcome: COutcome::Accepted, ..CAnswer::EMPTY };
    let id = match opened {
        Ok(Ok(id)) => shared_storage::plain(machine, id),
        Ok(Err(why)) => {
            (answer_list.outcome, answer_list.why) = (COutcome::Refused, why);
            shared_storage::NO_TICKET
        }
        Err(status) => return status,
    };
    // SAFETY: not null, aligned, outside the machine, and the header requires that it may be
    // written.
    unsafe { message_id.write(id) };
    // SAFETY: as above.
    unsafe { answer.write(answer_list) };
    CStatus::Done
}

/// # Safety
/// As the header requires.
unsafe fn bring(
    machine: *mut CShared,
    now: u64,
    message_id: CMessageId,
    input_kind: InputKind,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    let answers = [answer_target(fired), answer_target(answer)];
    // SAFETY: as the header requires.
    let answer_list = unsafe {
        shared_storage::handle(machine, &answers, |handle| {
            shared_storage::named(machine, message_id)
                .map(|message_id| handle.bring(now, message_id, input_kind))
        })
    };
    let answer_list = answer_list.and_then(|answer_list| answer_list);
    // SAFETY: as the header requires.
    answer_list
        .map_or_else(|status| status, |answer_list| unsafe { write(&answer_list, fired, answer) })
}

/// # Safety
/// Both may be written.
unsafe fn write(answer_list: &AnswerList, fired: *mut CAnswer, answer: *mut CAnswer) -> CStatus {
    // SAFETY: by the caller's promise.
    unsafe { fired.write(answer_list.fired) };
    // SAFETY: as above.
    unsafe { answer.write(answer_list.answer) };
    CStatus::Done
}
