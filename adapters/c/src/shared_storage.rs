//! A machine for many threads in its caller's storage. This module makes it, and passes calls to
//! its two halves.
//!
//! The owner's half refuses a second call at the same time; the shared handle takes any number. A
//! message id that crosses the interface is tied to its machine, so that another machine refuses
//! it.
#![expect(unsafe_code, reason = "reads and writes its caller's storage")]

use core::ffi::c_void;
use core::mem::transmute;
use core::ptr::addr_of_mut;

use fuseline_core::{Deadline, DropReason, Firing, Instant, Outcome, Priority, Timestamp};
use fuseline_threads::{MessageId, Owner, Shared, SharedHandle};

use crate::header::{
    AnswerTarget, NO_CLOUDS, StorageHeader, StorageKind, apart, rule, status_of, validated_config,
    wrong,
};
use crate::inputs::{open_refusal, priority, write_admission, write_answer, write_firing};
use crate::plain::{
    CAnswer, CConfig, CMessageId, CReason, CStatus, FUSELINE_SHARED_BYTES,
    FUSELINE_SHARED_BYTES_A_CLOUD,
};
use crate::storage::with_room;

/// A machine for many threads, in its caller's storage. Opaque.
#[repr(C, align(64))]
#[derive(Debug)]
pub struct CShared {
    header: StorageHeader,
}

impl StorageKind for CShared {
    const SEAL: u64 = 0x5468_7265_6164_7321; // "Threads!"
}

/// The whole storage. `owner` and `handle` refer to `shared`, which is not used in any other way.
#[repr(C)]
struct SharedStorage<const CLOUDS: usize, const WINDOW: usize> {
    header: CShared,
    owner: Owner<'static, CLOUDS, WINDOW>,
    handle: &'static SharedHandle<CLOUDS, WINDOW>,
    shared: Shared<CLOUDS, WINDOW>,
}

/// The owner's half, of any capacity.
pub(crate) trait OwnerCalls {
    fn open(&mut self, now: u64, t: u64, deadline: Option<Deadline>) -> Result<MessageId, CReason>;
    fn offer(&mut self, now: u64, message_id: MessageId, offer: (u64, Deadline, u64))
    -> AnswerList;
}

/// The half for all threads, of any capacity.
pub(crate) trait SharedCalls {
    fn bring(&self, now: u64, message_id: MessageId, input_kind: InputKind) -> AnswerList;
    fn next_due(&self, message_id: MessageId) -> Option<u64>;
}

/// An event that any thread may report for one message.
#[derive(Clone, Copy)]
pub(crate) enum InputKind {
    /// A result of this source (F3).
    Result(u64),
    /// A failure of this source (F4).
    Failure(u64),
    /// Time (F5).
    Time,
}

/// The answers of one call: first the answer of the due timers, and then the input's own.
pub(crate) struct AnswerList {
    pub(crate) fired: CAnswer,
    pub(crate) answer: CAnswer,
}

impl<const CLOUDS: usize, const WINDOW: usize> OwnerCalls for Owner<'static, CLOUDS, WINDOW> {
    fn open(&mut self, now: u64, t: u64, deadline: Option<Deadline>) -> Result<MessageId, CReason> {
        let opened = self.open(Instant::from_nanos(now), Timestamp::new(t), deadline);
        opened.map_err(open_refusal)
    }

    fn offer(
        &mut self,
        now: u64,
        message_id: MessageId,
        offer: (u64, Deadline, u64),
    ) -> AnswerList {
        let (p, deadline, backlog) = offer;
        // Local is not a cloud (A19), and a number beyond 16 bits is unknown (F2, A18).
        let cloud = priority(p).unwrap_or(Priority::LOCAL);
        let (fired, admission) =
            self.offer(Instant::from_nanos(now), message_id, cloud, deadline, backlog);
        let mut answer_list = AnswerList::new(now, message_id, fired.as_ref());
        write_admission(&mut answer_list.answer, admission);
        answer_list
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> SharedCalls for SharedHandle<CLOUDS, WINDOW> {
    fn bring(&self, now: u64, message_id: MessageId, input_kind: InputKind) -> AnswerList {
        let at = Instant::from_nanos(now);
        // A number beyond 16 bits cannot be registered, so it is unknown (F3, F4, A18).
        let unknown = || (self.expire(at, message_id), Outcome::Dropped(DropReason::Unknown));
        let (fired, outcome) = match input_kind {
            InputKind::Result(p) => {
                priority(p).map_or_else(unknown, |p| self.result(at, message_id, p))
            }
            InputKind::Failure(p) => {
                priority(p).map_or_else(unknown, |p| self.fail(at, message_id, p))
            }
            InputKind::Time => {
                return AnswerList::new(now, message_id, self.expire(at, message_id).as_ref());
            }
        };
        let mut answer_list = AnswerList::new(now, message_id, fired.as_ref());
        write_answer(&mut answer_list.answer, &outcome);
        answer_list
    }

    fn next_due(&self, message_id: MessageId) -> Option<u64> {
        self.next_due(message_id).map(Instant::as_nanos)
    }
}

impl AnswerList {
    /// Returns the answers with the firing, and with the input's own answer still empty.
    fn new<const CLOUDS: usize>(
        now: u64,
        message_id: MessageId,
        fired: Option<&Firing<CLOUDS>>,
    ) -> Self {
        let empty = CAnswer { at: now, t: message_id.timestamp().as_u64(), ..CAnswer::EMPTY };
        let mut answer_list = Self { fired: empty, answer: empty };
        if let Some(firing) = fired {
            write_firing(&mut answer_list.fired, firing);
        }
        answer_list
    }
}

/// Returns the bytes that the header reserves for a capacity. These are more than needed, so that
/// the machine may change.
const fn reserved(clouds: usize, window: usize) -> usize {
    // Timestamps share no cache lines.
    let a_timestamp = clouds.wrapping_mul(8).wrapping_add(24).next_multiple_of(64);
    FUSELINE_SHARED_BYTES
        .wrapping_add(FUSELINE_SHARED_BYTES_A_CLOUD.wrapping_mul(clouds))
        .wrapping_add(window.wrapping_mul(a_timestamp))
}

impl<const CLOUDS: usize, const WINDOW: usize> SharedStorage<CLOUDS, WINDOW> {
    const FITS: () = {
        assert!(size_of::<Self>() <= reserved(CLOUDS, WINDOW), "the header reserves too little");
        assert!(align_of::<Self>() == align_of::<CShared>(), "the header aligns to 64 bytes");
    };

    /// Writes a machine into the storage.
    ///
    /// # Safety
    /// `storage` is aligned, and `size_of::<Self>()` bytes from it may be written and belong to
    /// nobody else until the machine is ended.
    unsafe fn fill(storage: *mut Self, created: Shared<CLOUDS, WINDOW>, config: &CConfig) {
        const { Self::FITS };
        // SAFETY: within the storage, by the caller's promise.
        let shared = unsafe { addr_of_mut!((*storage).shared) };
        // SAFETY: as above.
        unsafe { shared.write(created) };
        // SAFETY: written just now; from here on it is used through its two halves alone, while the
        // storage is there.
        let (owner, handle) = unsafe { &mut *shared }.split();
        // SAFETY: within the storage.
        let target = unsafe { addr_of_mut!((*storage).owner) };
        // SAFETY: as above.
        unsafe { target.write(owner) };
        // SAFETY: within the storage.
        let target = unsafe { addr_of_mut!((*storage).handle) };
        // SAFETY: as above.
        unsafe { target.write(handle) };
        let header = CShared { header: StorageHeader::new::<CShared, Self>(storage, config) };
        // SAFETY: within the storage.
        let target = unsafe { addr_of_mut!((*storage).header) };
        // SAFETY: as above. Last, so that a machine is one only when it is whole.
        unsafe { target.write(header) };
    }
}

/// Returns the number of bytes that a machine of this capacity takes, or 0 if the library was not
/// built for it.
pub(crate) const fn bytes(capacity: u32) -> usize {
    with_room!(capacity, R = SharedStorage => size_of::<R>(), else 0)
}

/// Makes a machine and writes its address.
///
/// # Safety
/// The caller meets the requirements of the header.
pub(crate) unsafe fn make(
    storage: *mut c_void,
    bytes: usize,
    config: *const CConfig,
    machine: *mut *mut CShared,
) -> Result<(), CStatus> {
    let mut clouds = NO_CLOUDS;
    // SAFETY: as the header requires.
    let (config, clouds) =
        unsafe { validated_config((storage, bytes), config, machine, &mut clouds, self::bytes) }?;
    let (window, commit) = rule(&config);
    with_room!(config.capacity, R = SharedStorage => {
        let created = Shared::new(window, commit, clouds).map_err(|error| status_of(&error))?;
        // SAFETY: aligned and large enough, as was checked, and the caller's to give.
        unsafe { R::fill(storage.cast(), created, &config) };
    }, else return Err(CStatus::Capacity));
    // SAFETY: not null, aligned, and the header requires that it may be written.
    unsafe { machine.write(storage.cast()) };
    Ok(())
}

/// Runs `call` with the shared handle, if there is a machine and the answers are outside of it and
/// apart.
///
/// # Safety
/// As for [`StorageHeader::of`].
pub(crate) unsafe fn handle<A>(
    machine: *mut CShared,
    answers: &[AnswerTarget],
    call: impl FnOnce(&dyn SharedCalls) -> A,
) -> Result<A, CStatus> {
    // SAFETY: by the caller's promise.
    let header = unsafe { StorageHeader::of(machine, answers) }?;
    apart(answers)?;
    with_room!(header.capacity(), R = SharedStorage => {
        // SAFETY: the seal says that a storage of this capacity was written here. The shared handle
        // takes calls of any threads.
        Ok(call(unsafe { (*machine.cast::<R>()).handle }))
    }, else Err(CStatus::Foreign))
}

/// Runs `call` with the owner's half, unless another call of it is under way or two answers share
/// bytes.
///
/// # Safety
/// As for [`StorageHeader::of`].
pub(crate) unsafe fn owner<A>(
    machine: *mut CShared,
    answers: &[AnswerTarget],
    call: impl FnOnce(&mut dyn OwnerCalls, &StorageHeader) -> A,
) -> Result<A, CStatus> {
    // SAFETY: by the caller's promise.
    let header = unsafe { StorageHeader::of(machine, answers) }?;
    apart(answers)?;
    header.begin_alone()?;
    let answer_list = with_room!(header.capacity(), R = SharedStorage => {
        // SAFETY: the seal says that a storage of this capacity was written here.
        let owner = unsafe { addr_of_mut!((*machine.cast::<R>()).owner) };
        // SAFETY: as above, and `busy` says that no other call uses the owner's half.
        Ok(call(unsafe { &mut *owner }, header))
    }, else Err(CStatus::Foreign));
    header.done(header.capacity());
    answer_list
}

// A message id crosses the interface as three integers, the last of which is its index. It has no
// padding where addresses have 64 bits.
const _: () = assert!(size_of::<usize>() == 8, "the machine for many threads is for 64 bits");

/// The message id that is written if no message was opened.
pub(crate) const NO_TICKET: CMessageId = CMessageId { opaque: [0; 3] };

/// Returns the caller's form of a message id, in which the index is combined with the address of
/// its machine and counts from 1.
pub(crate) fn plain(machine: *mut CShared, message_id: MessageId) -> CMessageId {
    // SAFETY: as for `named`; no byte of it is padding.
    let [timestamp, generation, index] = unsafe { transmute::<MessageId, [u64; 3]>(message_id) };
    CMessageId { opaque: [timestamp, generation, index.wrapping_add(first_index(machine))] }
}

/// Returns the message id of a message of this machine.
pub(crate) fn named(machine: *mut CShared, message_id: CMessageId) -> Result<MessageId, CStatus> {
    let [timestamp, generation, index] = message_id.opaque;
    let index = index.wrapping_sub(first_index(machine));
    if index >= PLACES.wrapping_sub(1) {
        return Err(wrong(CStatus::MessageId));
    }
    // SAFETY: a message id is three integers of 64 bits, any of which are a message id. The sizes
    // are compared when compiled.
    Ok(unsafe { transmute::<[u64; 3], MessageId>([timestamp, generation, index]) })
}

/// A number greater than the slots of any machine.
const PLACES: u64 = 2048;

/// Returns the number that stands for a machine's first index. It is not 0. It is far from any
/// other machine's number, because machines are aligned to 64 bytes and no address uses its upper 5
/// bits.
fn first_index(machine: *mut CShared) -> u64 {
    (machine.addr() as u64 / 64).wrapping_mul(PLACES).wrapping_add(1)
}
