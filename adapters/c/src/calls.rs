//! The exported functions for the machine of one thread.
//!
//! Each one answers a wrong pointer, a wrong machine and a call from within another call with a
//! status, and then changes nothing. `include/fuseline.h` is generated from these functions and
//! their documentation.
#![expect(unsafe_code, reason = "a C interface reads and writes through its caller's pointers")]
#![expect(clippy::doc_markdown, reason = "these texts are the header's, which has no markdown")]
#![expect(clippy::missing_safety_doc, reason = "the header's preamble says it once for all calls")]

use core::ffi::{c_char, c_void};

use crate::header::{StorageHeader, answer_target};
use crate::names;
use crate::plain::{CAnswer, CConfig, CMessage, CState, CStatus, FUSELINE_ABI};
use crate::storage::{self, CMachine, IdleStorage, Storage, with_room};

/// Makes a call of an idle machine if there is one and the answer can be written; otherwise returns
/// from the function. There is one call for each capacity, so that the compiler joins it with the
/// machine's code.
macro_rules! call {
    ($machine:ident, $answer:ident, $method:ident($($argument:expr),*)) => {{
        // SAFETY: as the header requires.
        let header = match unsafe { StorageHeader::of($machine, &[answer_target($answer)]) } {
            Ok(header) => header,
            Err(status) => return status,
        };
        with_room!(header.idle_capacity(), R = Storage => {
            // SAFETY: the seal says that a storage of this capacity was written here, and it is
            // idle.
            let storage = unsafe { IdleStorage::new($machine.cast::<R>()) };
            // SAFETY: not null, aligned, outside the machine, and the header requires that it may
            // be written.
            storage.$method($($argument,)* unsafe { &mut *$answer.cast() })
        }, else header.refusal())
    }};
}

/// Returns the version of the library's interface. It is FUSELINE_ABI if the header fits.
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_abi() -> u32 {
    FUSELINE_ABI
}

/// Returns the version of the library, such as "0.1.0". FUSELINE_VERSION is the header's.
#[must_use]
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_version() -> *const c_char {
    names::VERSION.as_ptr()
}

/// Returns the capacity that the library was built for in addition to the named ones, or 0 if there
/// is none.
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_own_capacity() -> u32 {
    storage::OWN_CAPACITY
}

/// Returns a deadline of `count` units of `unit` nanoseconds each, as in
/// fuseline_deadline(budget_ms - age_ms, FUSELINE_MILLISECOND). Returns 0, which every machine
/// refuses, if `count` is negative. Returns UINT64_MAX if the product does not fit. A machine
/// refuses that too, unless its greatest deadline is UINT64_MAX.
#[must_use]
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_deadline(count: i64, unit: u64) -> u64 {
    u64::try_from(count).unwrap_or(0).saturating_mul(unit)
}

/// Returns an instant from a reading of CLOCK_MONOTONIC or a similar clock: a struct timespec's
/// seconds and nanoseconds. Returns 0 if the reading is negative, and UINT64_MAX if it does not
/// fit.
#[must_use]
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_instant(seconds: i64, nanoseconds: i64) -> u64 {
    u64::try_from(seconds).map_or(0, |seconds| {
        seconds.saturating_mul(1_000_000_000).saturating_add_signed(nanoseconds)
    })
}

/// Returns the number of bytes of storage that a machine of this capacity takes, or 0 if the
/// library was not built for the capacity.
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_bytes(capacity: u32) -> usize {
    storage::bytes(capacity)
}

/// Makes a machine in `storage`. The storage has `bytes` bytes, is aligned as a uint64_t, and
/// belongs to the machine until fuseline_end.
///
/// The storage is not read, so a machine that is already there is lost. Nothing is written unless
/// the call succeeds; then `*machine` is the argument of the other functions. The machine must stay
/// where it is.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_init(
    storage: *mut c_void,
    bytes: usize,
    config: *const CConfig,
    machine: *mut *mut CMachine,
) -> CStatus {
    // SAFETY: as the header requires.
    match unsafe { storage::make(storage, bytes, config, machine) } {
        Ok(()) => CStatus::Done,
        Err(status) => status,
    }
}

/// Ends a machine. Its storage is the caller's again, and further calls return
/// FUSELINE_STATUS_FOREIGN. Messages that are open have no output.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_end(machine: *mut CMachine) -> CStatus {
    // SAFETY: as the header requires.
    match unsafe { storage::end(machine) } {
        Ok(()) => CStatus::Done,
        Err(status) => status,
    }
}

/// Opens timestamp `t`, because its message arrived (F1). Local may take any time.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_open(
    machine: *mut CMachine,
    now: u64,
    t: u64,
    answer: *mut CAnswer,
) -> CStatus {
    call!(machine, answer, open(now, t))
}

/// Opens timestamp `t`, for which local may take `deadline` nanoseconds (F1).
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_open_within(
    machine: *mut CMachine,
    now: u64,
    t: u64,
    deadline: u64,
    answer: *mut CAnswer,
) -> CStatus {
    call!(machine, answer, open_within(now, t, deadline))
}

/// Asks whether message `t` may be sent to cloud `p`, which may take `deadline` nanoseconds (F2).
/// `backlog` is the number of other requests in the cloud's outgoing queue.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_offer(
    machine: *mut CMachine,
    now: u64,
    t: u64,
    p: u64,
    deadline: u64,
    backlog: u64,
    answer: *mut CAnswer,
) -> CStatus {
    call!(machine, answer, offer(now, t, p, deadline, backlog))
}

/// Reports the result of source `p`; 0 is local (F3).
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_result(
    machine: *mut CMachine,
    now: u64,
    t: u64,
    p: u64,
    answer: *mut CAnswer,
) -> CStatus {
    call!(machine, answer, result(now, t, p))
}

/// Reports that no result will come from source `p`; 0 is local (F4).
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_fail(
    machine: *mut CMachine,
    now: u64,
    t: u64,
    p: u64,
    answer: *mut CAnswer,
) -> CStatus {
    call!(machine, answer, fail(now, t, p))
}

/// Lets time pass (F0). Call it at the next due instant. You may also call it at any other time
/// (P10).
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_tick(
    machine: *mut CMachine,
    now: u64,
    answer: *mut CAnswer,
) -> CStatus {
    call!(machine, answer, tick(now))
}

/// Writes the earliest instant at which a timer is due. Returns FUSELINE_STATUS_NONE if no timer is
/// armed.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_next_due(machine: *mut CMachine, due: *mut u64) -> CStatus {
    call!(machine, due, next_due())
}

/// Writes the state of the machine as a whole.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_look(machine: *mut CMachine, state: *mut CState) -> CStatus {
    call!(machine, state, look())
}

/// Writes the state of timestamp `t`. Returns FUSELINE_STATUS_NONE if it is not open.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_look_at(
    machine: *mut CMachine,
    t: u64,
    message: *mut CMessage,
) -> CStatus {
    call!(machine, message, look_at(t))
}

/// Writes 1 if the last offer left the gate of cloud `p` shut, and otherwise 0. Returns
/// FUSELINE_STATUS_NONE if there is no such cloud.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_gate_is_shut(
    machine: *mut CMachine,
    p: u64,
    is_shut: *mut u32,
) -> CStatus {
    call!(machine, is_shut, gate_is_shut(p))
}

/// Returns the word for a fuseline_status, or "?" for another number.
#[must_use]
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_status_name(status: u32) -> *const c_char {
    names::status(status)
}

/// Returns the word for a fuseline_outcome, or "?" for another number.
#[must_use]
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_outcome_name(outcome: u32) -> *const c_char {
    names::outcome(outcome)
}

/// Returns the word of SPEC.md for a fuseline_reason, or "?" for another number.
#[must_use]
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_reason_name(reason: u32) -> *const c_char {
    names::reason(reason)
}
