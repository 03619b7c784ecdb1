//! Tests the machine for many threads from C's side.
#![cfg(feature = "threads")]
#![expect(unsafe_code, reason = "calls a C interface")]
#![expect(clippy::multiple_unsafe_ops_per_block, reason = "a row of calls with one reason")]
#![expect(clippy::cast_possible_truncation, reason = "sizes of a few hundred")]

mod common;

use core::mem::MaybeUninit;
use core::ptr::null_mut;
use std::sync::atomic::{AtomicU32, Ordering};

use common::config;
use fuseline_c::shared::*;
use fuseline_c::*;

#[repr(C, align(64))]
struct Storage([u8; 4096]);

/// A machine that threads may share.
#[derive(Clone, Copy)]
struct Machine(*mut CShared);
// SAFETY: the machine takes calls of any threads.
unsafe impl Send for Machine {}
// SAFETY: as above.
unsafe impl Sync for Machine {}

fn make(storage: &mut Storage) -> (CStatus, Machine) {
    under(CCommit::Eager, storage)
}

fn under(commit: CCommit, storage: &mut Storage) -> (CStatus, Machine) {
    let config = CConfig { commit: commit as u32, ..config() };
    let mut machine = null_mut();
    let (address, bytes) = ((&raw mut *storage).cast(), size_of::<Storage>());
    // SAFETY: this test's own.
    let status =
        unsafe { fuseline_shared_init(address, bytes, &raw const config, &raw mut machine) };
    (status, Machine(machine))
}

impl Machine {
    fn call(call: impl FnOnce(*mut CAnswer, *mut CAnswer) -> CStatus) -> (CStatus, [CAnswer; 2]) {
        let mut answers = [MaybeUninit::<CAnswer>::zeroed(); 2];
        let [fired, answer] = &mut answers;
        let status = call(fired.as_mut_ptr(), answer.as_mut_ptr());
        // SAFETY: written, or zero, which is an answer too.
        (status, answers.map(|answer| unsafe { answer.assume_init() }))
    }

    fn open(self, now: u64, t: u64) -> (CStatus, CAnswer, CMessageId) {
        let mut message_id = CMessageId { opaque: [0; 3] };
        let (status, [answer, _]) =
            // SAFETY: a machine, and places of this test's own.
            Machine::call(|answer, _| unsafe { fuseline_shared_open(self.0, now, t, &raw mut message_id, answer) });
        (status, answer, message_id)
    }

    fn offer(self, now: u64, message_id: CMessageId, p: u64) -> (CStatus, [CAnswer; 2]) {
        // SAFETY: as above.
        Machine::call(|fired, answer| unsafe {
            fuseline_shared_offer(self.0, now, message_id, p, 100, 0, fired, answer)
        })
    }

    fn result(self, now: u64, message_id: CMessageId, p: u64) -> (CStatus, [CAnswer; 2]) {
        // SAFETY: as above.
        Machine::call(|fired, answer| unsafe {
            fuseline_shared_result(self.0, now, message_id, p, fired, answer)
        })
    }
}

#[test]
fn a_held_result_goes_when_the_timer_fires() {
    let mut storage = Box::new(Storage([0xa5; _]));
    let (status, machine) = make(&mut storage);
    assert_eq!(status, CStatus::Done);
    let (_, answer, message_id) = machine.open(0, 7);
    assert_eq!((answer.outcome, answer.t), (COutcome::Accepted, 7));
    let (_, [_, answer]) = machine.offer(0, message_id, 2);
    assert_eq!((answer.outcome, answer.due), (COutcome::Admitted, 100));
    let (_, [fired, answer]) = machine.result(5, message_id, 0);
    assert_eq!((fired.fired, answer.outcome), (0, COutcome::Held));
    let (_, [_, answer]) = machine.result(5, message_id, 1 << 20);
    assert_eq!((answer.outcome, answer.why), (COutcome::Dropped, CReason::Unknown));
    let mut due = 0;
    // SAFETY: a machine, and places of this test's own.
    unsafe {
        assert_eq!(fuseline_shared_next_due(machine.0, message_id, &raw mut due), CStatus::Done);
        assert_eq!(due, 100);
        let (status, [fired, _]) = Machine::call(|fired, answer| {
            fuseline_shared_expire(machine.0, 100, message_id, fired, answer)
        });
        assert_eq!((status, fired.fired, fired.outcome), (CStatus::Done, 1, COutcome::Forwarded));
        assert_eq!((fired.by, fired.timers_len, fired.timers[0]), (0, 1, 2));
        assert_eq!(fuseline_shared_next_due(machine.0, message_id, &raw mut due), CStatus::None);
        assert_eq!(fuseline_shared_end(machine.0), CStatus::Done);
    }
    assert_eq!(machine.open(1, 8).0, CStatus::Foreign);
}

/// Under progressive each output goes to one caller, and so does the end (F9).
#[test]
fn progressive_outputs_and_end_go_to_one_caller_each() {
    let mut storage = Box::new(Storage([0xa5; _]));
    let (status, machine) = under(CCommit::Progressive, &mut storage);
    assert_eq!(status, CStatus::Done);
    let (_, _, message_id) = machine.open(0, 7);
    for p in [1, 2] {
        assert_eq!(machine.offer(0, message_id, p).1[1].outcome, COutcome::Admitted);
    }
    for p in [0, 1] {
        let (_, [_, answer]) = machine.result(5, message_id, p);
        assert_eq!((answer.outcome, u64::from(answer.by)), (COutcome::Preliminary, p));
    }
    let (_, [_, again]) = machine.result(5, message_id, 0);
    assert_eq!((again.outcome, again.why), (COutcome::Dropped, CReason::Superseded));
    let (_, [fired, late]) = machine.result(100, message_id, 2);
    assert_eq!((fired.outcome, fired.by, fired.timers[0]), (COutcome::Final, 1, 2));
    assert_eq!((late.outcome, late.why), (COutcome::Dropped, CReason::Superseded));
}

#[test]
fn wrong_use_of_it_is_reported() {
    let mut storage = Box::new(Storage([0xa5; _]));
    let (_, machine) = make(&mut storage);
    let (_, _, message_id) = machine.open(0, 1);
    let odd = Machine(machine.0.wrapping_byte_add(8));
    assert_eq!(odd.result(0, message_id, 0).0, CStatus::Alignment);
    assert_eq!(
        Machine(machine.0.wrapping_byte_add(64)).result(0, message_id, 0).0,
        CStatus::Foreign
    );
    assert_eq!(Machine(null_mut()).result(0, message_id, 0).0, CStatus::Null);
    let inside = machine.0.cast::<CAnswer>();
    let (status, _) = Machine::call(|fired, _| {
        // SAFETY: an answer in the machine is not written.
        unsafe { fuseline_shared_result(machine.0, 0, message_id, 0, fired, inside) }
    });
    assert_eq!(status, CStatus::Overlap);
    let (status, _) = Machine::call(|fired, _| {
        // SAFETY: one place for two answers is not written.
        unsafe { fuseline_shared_result(machine.0, 0, message_id, 0, fired, fired) }
    });
    assert_eq!(status, CStatus::Overlap);
    // No open returned these message ids, or another machine did.
    let mut other_storage = Box::new(Storage([0xa5; _]));
    let (_, other) = make(&mut other_storage);
    let (_, _, others) = other.open(0, 1);
    for wild in [CMessageId { opaque: [u64::MAX; 3] }, CMessageId { opaque: [0; 3] }, others] {
        assert_eq!(machine.result(0, wild, 0).0, CStatus::MessageId);
        assert_eq!(machine.offer(0, wild, 1).0, CStatus::MessageId);
    }
    // A refused open leaves no message id of an earlier message.
    assert_eq!(machine.open(0, 1).2, CMessageId { opaque: [0; 3] });
    assert_eq!(machine.result(0, message_id, 0).1[1].outcome, COutcome::Forwarded);
    let mut copy = Box::new(Storage([0; _]));
    copy.0.copy_from_slice(&storage.0);
    assert_eq!(Machine((&raw mut *copy).cast()).result(0, message_id, 0).0, CStatus::Foreign);
}

#[test]
fn a_deadline_above_the_greatest_is_refused() {
    let mut storage = Box::new(Storage([0xa5; _]));
    let (_, machine) = make(&mut storage);
    let negative = 0_u64.wrapping_sub(20);
    let mut message_id = CMessageId { opaque: [0; 3] };
    let mut open = |deadline| {
        // SAFETY: a machine, and places of this test's own.
        let (_, [answer, _]) = Machine::call(|answer, _| unsafe {
            fuseline_shared_open_within(machine.0, 0, 7, deadline, &raw mut message_id, answer)
        });
        (answer.outcome, answer.why)
    };
    for deadline in [0, 1_001, negative] {
        assert_eq!(open(deadline), (COutcome::Refused, CReason::Deadline), "{deadline}");
    }
    assert_eq!(open(1_000).0, COutcome::Accepted);
    for deadline in [0, 1_001, negative] {
        // SAFETY: as above.
        let (_, [_, answer]) = Machine::call(|fired, answer| unsafe {
            fuseline_shared_offer(machine.0, 0, message_id, 1, deadline, 0, fired, answer)
        });
        let answer_list = (answer.outcome, answer.why);
        assert_eq!(answer_list, (COutcome::Refused, CReason::Deadline), "{deadline}");
    }
}

#[test]
fn of_threads_that_race_exactly_one_is_to_forward() {
    let mut storage = Box::new(Storage([0; _]));
    let (_, machine) = make(&mut storage);
    let mut fired_too = 0;
    for t in 0..2_000 {
        let (_, answer, message_id) = machine.open(t, t);
        assert_eq!(answer.outcome, COutcome::Accepted);
        for p in [1, 2] {
            assert_eq!(machine.offer(t, message_id, p).1[1].outcome, COutcome::Admitted);
        }
        let forwarded = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for p in [0, 1, 2] {
                let forwarded = &forwarded;
                scope.spawn(move || {
                    // One result comes at the due instant. It is late, and the timers fire before
                    // it.
                    let now = if p == t % 3 { t + 100 } else { t };
                    let (status, answers) = machine.result(now, message_id, p);
                    assert_eq!(status, CStatus::Done);
                    let answer_list = answers
                        .iter()
                        .filter(|answer_list| answer_list.outcome == COutcome::Forwarded);
                    forwarded.fetch_add(answer_list.count() as u32, Ordering::Relaxed);
                });
            }
        });
        let (_, [fired, _]) = Machine::call(|fired, answer| {
            // SAFETY: a machine, and places of this test's own.
            unsafe { fuseline_shared_expire(machine.0, t + 100, message_id, fired, answer) }
        });
        fired_too += u32::from(fired.outcome == COutcome::Forwarded);
        let missed = fired.outcome == COutcome::Missed;
        let forwarded = forwarded.into_inner() + u32::from(fired.outcome == COutcome::Forwarded);
        assert!(forwarded == 1 && !missed, "message {t}: {forwarded} forwarded");
    }
    assert!(fired_too < 2_000, "the threads forward, not the last tick alone");
}
