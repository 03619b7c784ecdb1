//! Checks that wrong use is reported by a status and changes nothing.
#![expect(unsafe_code, reason = "calls a C interface")]
#![expect(clippy::multiple_unsafe_ops_per_block, reason = "a row of calls with one reason")]
#![expect(clippy::cast_possible_truncation, reason = "sizes and counts of a few hundred")]

mod common;

use core::ffi::{CStr, c_void};
use core::mem::MaybeUninit;
use core::ptr::null_mut;

use common::{CLOUDS, LAYOUT, config};
use fuseline_c::calls::*;
use fuseline_c::*;

/// The header's `FUSELINE_STORAGE` for 3 clouds and 16 timestamps.
#[repr(C, align(8))]
struct Storage(
    [u8; FUSELINE_BYTES
        + 3 * FUSELINE_BYTES_A_CLOUD
        + 16 * (FUSELINE_BYTES_A_TIMESTAMP + 3 * FUSELINE_BYTES_A_TIMER)],
);

fn init(storage: &mut Storage, config: &CConfig) -> (CStatus, *mut CMachine) {
    let mut machine = null_mut();
    let bytes = size_of::<Storage>();
    let address = (&raw mut *storage).cast::<c_void>();
    // SAFETY: the storage and the configuration are this test's own.
    let status = unsafe { fuseline_init(address, bytes, config, &raw mut machine) };
    (status, machine)
}

fn storage() -> Box<Storage> {
    Box::new(Storage([0xa5; _]))
}

/// Opens timestamp `t` and returns the status and the answer.
fn open(machine: *mut CMachine, t: u64) -> (CStatus, CAnswer) {
    let mut answer = MaybeUninit::<CAnswer>::zeroed();
    // SAFETY: `machine` may be read as one; the answer is this function's own.
    let status = unsafe { fuseline_open(machine, 0, t, answer.as_mut_ptr()) };
    // SAFETY: written, or zero, which is an answer too.
    (status, unsafe { answer.assume_init() })
}

#[test]
fn a_machine_answers_and_ends() {
    let mut storage = storage();
    let (status, machine) = init(&mut storage, &config());
    assert_eq!(status, CStatus::Done);
    let (status, answer) = open(machine, 7);
    assert_eq!((status, answer.outcome, answer.t), (CStatus::Done, COutcome::Accepted, 7));
    let (_, answer) = open(machine, 7);
    assert_eq!((answer.outcome, answer.why), (COutcome::Refused, CReason::Order));
    // SAFETY: a machine.
    assert_eq!(unsafe { fuseline_end(machine) }, CStatus::Done);
    assert_eq!(open(machine, 8).0, CStatus::Foreign);
}

#[test]
fn wrong_configuration_has_its_status() {
    let twice = [CLOUDS[0], CLOUDS[0]];
    let gate = [CCloud { priority: 1, limit: 5, resume: 5 }];
    let local = [CCloud { priority: 0, limit: 5, resume: 4 }];
    let beyond = [CCloud { priority: 65_536, limit: 5, resume: 4 }];
    let four = [CLOUDS[0], CLOUDS[1], CLOUDS[2], CCloud { priority: 4, limit: 31, resume: 30 }];
    let with = |clouds: &[CCloud]| CConfig {
        clouds: clouds.as_ptr(),
        clouds_len: clouds.len() as u32,
        ..config()
    };
    let cases = [
        (CConfig { abi: FUSELINE_ABI + 1, ..config() }, CStatus::Abi),
        (CConfig { layout: LAYOUT ^ 1, ..config() }, CStatus::Abi),
        (CConfig { capacity: 0, ..config() }, CStatus::Capacity),
        // A shape near one that the library holds is not held.
        (CConfig { capacity: 3 << 16 | 15, ..config() }, CStatus::Capacity),
        (CConfig { capacity: 2 << 16 | 16, ..config() }, CStatus::Capacity),
        (CConfig { greatest_deadline: 0, ..config() }, CStatus::Deadline),
        (CConfig { capacity: CCapacity::C15W1024 as u32, ..config() }, CStatus::Size),
        (CConfig { commit: 3, ..config() }, CStatus::Commit),
        (CConfig { window: 0, ..config() }, CStatus::Window),
        (CConfig { window: 17, ..config() }, CStatus::Window),
        (CConfig { clouds_len: 16, ..config() }, CStatus::Clouds),
        (CConfig { clouds_len: u32::MAX, ..config() }, CStatus::Clouds),
        (CConfig { clouds: core::ptr::null(), ..config() }, CStatus::Null),
        (CConfig { clouds: core::ptr::without_provenance(9), ..config() }, CStatus::Alignment),
        (with(&four), CStatus::Clouds),
        (with(&twice), CStatus::Twice),
        (with(&gate), CStatus::Gate),
        (with(&local), CStatus::Priority),
        (with(&beyond), CStatus::Priority),
    ];
    for (config, expected) in cases {
        let mut storage = storage();
        let (status, machine) = init(&mut storage, &config);
        assert_eq!(status, expected, "{config:?}");
        assert!(machine.is_null(), "{config:?}");
        assert!(storage.0.iter().all(|byte| *byte == 0xa5), "{config:?}");
    }
}

#[test]
fn wrong_pointers_are_reported() {
    let mut storage = storage();
    let mut machine = null_mut();
    let address = (&raw mut *storage).cast::<c_void>();
    let (bytes, config) = (size_of::<Storage>(), config());
    let inside = address.cast::<*mut CMachine>();
    // SAFETY: whatever is not wrong on purpose is this test's own; a wrong pointer is not followed.
    unsafe {
        assert_eq!(
            fuseline_init(null_mut(), bytes, &raw const config, &raw mut machine),
            CStatus::Null
        );
        assert_eq!(
            fuseline_init(address, bytes, core::ptr::null(), &raw mut machine),
            CStatus::Null
        );
        assert_eq!(fuseline_init(address, bytes, &raw const config, null_mut()), CStatus::Null);
        assert_eq!(fuseline_init(address, bytes, &raw const config, inside), CStatus::Overlap);
        let odd = address.byte_add(4);
        assert_eq!(
            fuseline_init(odd, bytes - 4, &raw const config, &raw mut machine),
            CStatus::Alignment
        );
        let too_small = fuseline_bytes(CCapacity::C3W16 as u32) - 1;
        assert_eq!(
            fuseline_init(address, too_small, &raw const config, &raw mut machine),
            CStatus::Size
        );
    }
    let (_, machine) = init(&mut storage, &config);
    let mut due = 0;
    // SAFETY: as above.
    unsafe {
        assert_eq!(fuseline_tick(machine, 0, null_mut()), CStatus::Null);
        assert_eq!(fuseline_tick(machine, 0, machine.cast()), CStatus::Overlap);
        let last = machine.byte_add(fuseline_bytes(CCapacity::C3W16 as u32) - 8).cast();
        assert_eq!(fuseline_tick(machine, 0, last), CStatus::Overlap);
        let before = machine.wrapping_byte_sub(8).cast();
        assert_eq!(fuseline_tick(machine, 0, before), CStatus::Overlap);
        assert_eq!(fuseline_next_due(null_mut(), &raw mut due), CStatus::Null);
        assert_eq!(fuseline_next_due(machine.byte_add(1), &raw mut due), CStatus::Alignment);
        assert_eq!(fuseline_next_due(machine.byte_add(8), &raw mut due), CStatus::Foreign);
        assert_eq!(fuseline_next_due(machine, &raw mut due), CStatus::None);
    }
}

/// A stray write or a call under way leaves this capacity in the head.
#[test]
fn overwritten_capacity_is_foreign_or_busy() {
    let mut storage = storage();
    let (_, machine) = init(&mut storage, &config());
    for (word, status) in
        [(0, CStatus::Foreign), (CCapacity::C3W16 as u32 | 1 << 31, CStatus::Busy)]
    {
        // SAFETY: within the storage; the capacity lies behind the seal and the length.
        unsafe { machine.cast::<u32>().add(4).write(word) };
        assert_eq!(open(machine, 1).0, status);
        // SAFETY: a machine.
        assert_eq!(unsafe { fuseline_end(machine) }, status);
    }
}

#[test]
fn patient_without_clouds_forwards_local() {
    let patient = CConfig {
        commit: CCommit::Patient as u32,
        clouds_len: 0,
        clouds: core::ptr::null(),
        ..config()
    };
    let mut storage = storage();
    let (status, machine) = init(&mut storage, &patient);
    assert_eq!((status, open(machine, 1).1.outcome), (CStatus::Done, COutcome::Accepted));
    let mut answer = MaybeUninit::<CAnswer>::zeroed();
    // SAFETY: a machine, and a place of this test's own.
    assert_eq!(unsafe { fuseline_result(machine, 0, 1, 0, answer.as_mut_ptr()) }, CStatus::Done);
    // SAFETY: written, or zero, which is an answer too.
    assert_eq!(unsafe { answer.assume_init() }.outcome, COutcome::Forwarded);
}

#[test]
fn deadline_above_the_greatest_is_refused_in_order() {
    let mut storage = storage();
    let (_, machine) = init(&mut storage, &config());
    let mut answer = MaybeUninit::<CAnswer>::zeroed();
    let mut opened = |t, deadline| {
        // SAFETY: a machine, and an answer of this test's own.
        let status = unsafe { fuseline_open_within(machine, 5, t, deadline, answer.as_mut_ptr()) };
        assert_eq!(status, CStatus::Done);
        // SAFETY: written.
        unsafe { ((*answer.as_ptr()).outcome, (*answer.as_ptr()).why) }
    };
    let negative = 0_u64.wrapping_sub(20);
    for deadline in [0, 1_001, negative, u64::MAX] {
        assert_eq!(opened(7, deadline), (COutcome::Refused, CReason::Deadline), "{deadline}");
    }
    assert_eq!(opened(7, 1_000), (COutcome::Accepted, CReason::None));
    assert_eq!(opened(7, 1_001), (COutcome::Refused, CReason::Order));
    let mut offered = |p, deadline| {
        // SAFETY: as above.
        let status = unsafe { fuseline_offer(machine, 5, 7, p, deadline, 0, answer.as_mut_ptr()) };
        assert_eq!(status, CStatus::Done);
        // SAFETY: written.
        unsafe { ((*answer.as_ptr()).outcome, (*answer.as_ptr()).why) }
    };
    for deadline in [0, 1_001, negative, u64::MAX] {
        assert_eq!(offered(1, deadline), (COutcome::Refused, CReason::Deadline), "{deadline}");
    }
    assert_eq!(offered(1, 1_000), (COutcome::Admitted, CReason::None));
    assert_eq!(offered(1, negative), (COutcome::Refused, CReason::Duplicate));
    assert_eq!(offered(9, negative), (COutcome::Refused, CReason::Unknown));
}

#[test]
fn a_signed_time_is_0_below_0_and_saturates() {
    assert_eq!(fuseline_deadline(-20, 1_000_000), 0);
    assert_eq!(fuseline_deadline(0, 1_000_000), 0);
    assert_eq!(fuseline_deadline(20, 1_000_000), 20_000_000);
    assert_eq!(fuseline_deadline(18_446_744_074, 1_000_000_000), u64::MAX);
    assert_eq!(fuseline_deadline(i64::MIN, 1), 0);
    assert_eq!(fuseline_instant(2, 3), 2_000_000_003);
    assert_eq!(fuseline_instant(2, -1), 1_999_999_999);
    assert_eq!(fuseline_instant(0, -1), 0);
    assert_eq!(fuseline_instant(-1, 999_999_999), 0);
    assert_eq!(fuseline_instant(i64::MAX, i64::MAX), u64::MAX);
    assert_eq!(fuseline_instant(i64::MIN, i64::MIN), 0);
}

#[test]
fn library_reports_version_and_capacity() {
    // SAFETY: a text of the library's, which ends.
    let version = unsafe { CStr::from_ptr(fuseline_version()) };
    assert_eq!(version.to_str(), Ok(env!("CARGO_PKG_VERSION")));
    assert_eq!(fuseline_own_capacity(), 0);
    assert_eq!(fuseline_bytes(fuseline_own_capacity()), 0);
}

#[test]
fn a_copy_is_no_machine() {
    let (mut first, mut second) = (storage(), storage());
    let (_, machine) = init(&mut first, &config());
    second.0.copy_from_slice(&first.0);
    assert_eq!(open((&raw mut *second).cast(), 1).0, CStatus::Foreign);
    assert_eq!(open(machine, 1).0, CStatus::Done);
}

#[test]
fn every_enumerator_has_its_word() {
    let word = |word: *const core::ffi::c_char| {
        // SAFETY: a text of the library's, which ends.
        unsafe { CStr::from_ptr(word) }.to_str().expect("ASCII")
    };
    let header = include_str!("../include/fuseline.h");
    let mut checked = 0;
    for line in header.lines() {
        let Some((name, number)) = line.trim().trim_end_matches(',').split_once(" = ") else {
            continue;
        };
        let Ok(number) = number.parse() else { continue };
        let (rest, answer_list) = if let Some(rest) = name.strip_prefix("FUSELINE_STATUS_") {
            (rest, word(fuseline_status_name(number)))
        } else if let Some(rest) = name.strip_prefix("FUSELINE_OUTCOME_") {
            (rest, word(fuseline_outcome_name(number)))
        } else if let Some(rest) = name.strip_prefix("FUSELINE_REASON_") {
            (rest, word(fuseline_reason_name(number)))
        } else {
            continue;
        };
        assert_eq!(rest.to_lowercase(), answer_list);
        checked += 1;
    }
    assert_eq!(checked, 19 + 11 + 12);
    assert_eq!(word(fuseline_reason_name(99)), "?");
}

#[test]
fn what_a_machine_knows_is_reported() {
    let mut storage = storage();
    let (_, machine) = init(&mut storage, &config());
    let mut answer = MaybeUninit::<CAnswer>::zeroed();
    let mut message = MaybeUninit::<CMessage>::zeroed();
    let (mut due, mut is_shut) = (0, 9);
    // SAFETY: a machine, and places of this test's own.
    unsafe {
        assert_eq!(fuseline_open_within(machine, 5, 1, 50, answer.as_mut_ptr()), CStatus::Done);
        assert_eq!(fuseline_offer(machine, 5, 1, 2, 20, 0, answer.as_mut_ptr()), CStatus::Done);
        assert_eq!(fuseline_result(machine, 6, 1, 0, answer.as_mut_ptr()), CStatus::Done);
        assert_eq!((*answer.as_ptr()).outcome, COutcome::Held);
        assert_eq!(fuseline_next_due(machine, &raw mut due), CStatus::Done);
        assert_eq!(due, 25);
        assert_eq!(fuseline_look_at(machine, 2, message.as_mut_ptr()), CStatus::None);
        assert_eq!(fuseline_look_at(machine, 1, message.as_mut_ptr()), CStatus::Done);
        let known = &*message.as_ptr();
        assert_eq!((known.sources_len, &known.priorities[..4]), (4, &[0, 1, 2, 3][..]));
        let sets = (known.requested, known.pending, known.armed, known.cached);
        assert_eq!(sets, (0b101, 0b100, 0b100, 0b001));
        assert_eq!(known.dues[2], 25);
        assert_eq!(fuseline_gate_is_shut(machine, 2, &raw mut is_shut), CStatus::Done);
        assert_eq!(is_shut, 0);
        assert_eq!(fuseline_gate_is_shut(machine, 9, &raw mut is_shut), CStatus::None);
        // A number beyond 65535 is a source that is not registered (A18).
        assert_eq!(fuseline_fail(machine, 7, 1, 65_536, answer.as_mut_ptr()), CStatus::Done);
        assert_eq!((*answer.as_ptr()).why, CReason::Unknown);
        assert_eq!(fuseline_tick(machine, 25, answer.as_mut_ptr()), CStatus::Again);
        let fired = &*answer.as_ptr();
        assert_eq!((fired.outcome, fired.by, fired.fired), (COutcome::Forwarded, 0, 1));
        assert_eq!((fired.timers_len, fired.timers[0], fired.due), (1, 2, 25));
        assert_eq!(fuseline_tick(machine, 25, answer.as_mut_ptr()), CStatus::Done);
    }
}

/// Under progressive an output is preliminary until one is forwarded or the last is final (F9).
#[test]
fn progressive_output_is_preliminary_until_the_last() {
    let mut storage = storage();
    let progressive = CConfig { commit: CCommit::Progressive as u32, ..config() };
    let (status, machine) = init(&mut storage, &progressive);
    assert_eq!(status, CStatus::Done);
    let mut answer = MaybeUninit::<CAnswer>::zeroed();
    let mut message = MaybeUninit::<CMessage>::zeroed();
    // SAFETY: a machine, and places of this test's own.
    unsafe {
        for t in [1, 2] {
            assert_eq!(fuseline_open(machine, 5, t, answer.as_mut_ptr()), CStatus::Done);
            for p in [1, 2, 3] {
                assert_eq!(
                    fuseline_offer(machine, 5, t, p, 20, 0, answer.as_mut_ptr()),
                    CStatus::Done
                );
            }
        }
        assert_eq!(fuseline_result(machine, 6, 1, 2, answer.as_mut_ptr()), CStatus::Done);
        let sent = &*answer.as_ptr();
        assert_eq!((sent.outcome, sent.why), (COutcome::Preliminary, CReason::None));
        assert_eq!((sent.by, sent.cancelled_len, sent.cancelled[0]), (2, 1, 1));
        assert_eq!(fuseline_look_at(machine, 1, message.as_mut_ptr()), CStatus::Done);
        let known = &*message.as_ptr();
        let sets = (known.requested, known.pending, known.armed, known.cached);
        assert_eq!(sets, (0b1111, 0b1000, 0b1000, 0b0100));
        for (p, why) in [(0, CReason::Superseded), (2, CReason::Duplicate)] {
            assert_eq!(fuseline_result(machine, 6, 1, p, answer.as_mut_ptr()), CStatus::Done);
            let dropped = &*answer.as_ptr();
            assert_eq!((dropped.outcome, dropped.why, dropped.by), (COutcome::Dropped, why, 0));
        }
        assert_eq!(fuseline_result(machine, 6, 2, 0, answer.as_mut_ptr()), CStatus::Done);
        assert_eq!((*answer.as_ptr()).outcome, COutcome::Preliminary);
        assert_eq!(fuseline_result(machine, 7, 2, 3, answer.as_mut_ptr()), CStatus::Done);
        let last = &*answer.as_ptr();
        assert_eq!((last.outcome, last.by), (COutcome::Forwarded, 3));
        assert_eq!((last.cancelled_len, &last.cancelled[..2]), (2, &[1, 2][..]));
        assert_eq!(fuseline_tick(machine, 25, answer.as_mut_ptr()), CStatus::Again);
        let ended = &*answer.as_ptr();
        assert_eq!((ended.outcome, ended.t, ended.by), (COutcome::Final, 1, 2));
        assert_eq!((ended.fired, ended.timers[0], ended.cancelled_len), (1, 3, 0));
        assert_eq!(fuseline_tick(machine, 25, answer.as_mut_ptr()), CStatus::Done);
    }
}
