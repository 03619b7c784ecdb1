//! The head of every storage. Before a call reads anything else, it checks here that the pointer is
//! to a live machine of the right kind.
//!
//! This module also checks configurations, which both kinds of machine share.

use core::ffi::c_void;
use core::ptr::addr_of_mut;
use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};

use fuseline_core::{Cloud, Commit, ConfigError, Deadline, Gate, Priority};

use crate::plain::{CCloud, CCommit, CConfig, CStatus, FUSELINE_ABI, LAYOUT};

/// The greatest number of clouds of any capacity.
pub(crate) const MOST_CLOUDS: usize = 15;
/// The buffer into which the clouds of a configuration are read.
pub(crate) const NO_CLOUDS: [Cloud; MOST_CLOUDS] = [Cloud::new(Priority::LOCAL, 1); MOST_CLOUDS];

/// A bit that no capacity has.
const BUSY: u32 = 1 << 31;

/// The first bytes of a storage.
#[repr(C)]
#[derive(Debug)]
pub(crate) struct StorageHeader {
    /// The seal of the address at which the machine was made, so a copy of the bytes elsewhere is
    /// not a machine.
    close: u64,
    /// The number of bytes of the storage.
    bytes: usize,
    /// The capacity, with [`BUSY`] while a call is under way. One comparison checks both facts.
    state: AtomicU32,
    /// The greatest deadline in nanoseconds. A greater one is refused.
    greatest_deadline: u64,
}

/// A kind of machine that a caller has a pointer to: a [`StorageHeader`] and its alignment.
pub(crate) trait StorageKind {
    /// A number that differs between the kinds.
    const SEAL: u64;
}

/// The place for an answer, and the result of checking its pointer.
#[derive(Clone, Copy)]
pub(crate) struct AnswerTarget {
    at: usize,
    len: usize,
    is: Result<(), CStatus>,
}

impl StorageHeader {
    /// Returns the head of a whole storage of type `T`.
    pub(crate) fn new<K: StorageKind, T>(storage: *const T, config: &CConfig) -> Self {
        Self {
            close: close::<K>(storage.addr()),
            bytes: size_of::<T>(),
            state: AtomicU32::new(config.capacity),
            greatest_deadline: config.greatest_deadline,
        }
    }

    /// Converts a caller's deadline. A deadline above the greatest becomes 0, which the machine
    /// refuses as `deadline` unless another reason comes first (F1, F2, A11).
    pub(crate) const fn deadline(&self, nanos: u64) -> Deadline {
        Deadline::from_nanos(if nanos > self.greatest_deadline { 0 } else { nanos })
    }

    /// Returns the head of a machine, if it is one and the answers are outside of it.
    ///
    /// # Safety
    /// `machine` came from the kind's init, or may at least be read as a `K`, which begins with a
    /// head.
    #[expect(unsafe_code, reason = "reads the caller's storage")]
    pub(crate) unsafe fn of<'a, K: StorageKind>(
        machine: *mut K,
        answers: &[AnswerTarget],
    ) -> Result<&'a Self, CStatus> {
        for answer in answers {
            answer.is?;
        }
        check(machine)?;
        // SAFETY: not null, aligned, and may be read by the caller's promise. The machine lies
        // beside it, not in it.
        let header = unsafe { &*machine.cast::<Self>() };
        if header.close != close::<K>(machine.addr()) {
            return Err(wrong(CStatus::Foreign));
        }
        for answer in answers {
            if overlaps(answer.at, answer.len, machine.addr(), header.bytes) {
                return Err(wrong(CStatus::Overlap));
            }
        }
        Ok(header)
    }

    /// Returns the capacity.
    #[cfg(feature = "threads")]
    pub(crate) fn capacity(&self) -> u32 {
        self.state.load(Ordering::Relaxed) & !BUSY
    }

    /// Returns the capacity if no call is under way, and otherwise a number that is not a capacity.
    pub(crate) fn idle_capacity(&self) -> u32 {
        // Acquire pairs with Release at the end of a call, so that the caller sees everything that
        // the last call wrote, even in another thread.
        self.state.load(Ordering::Acquire)
    }

    /// Returns the status for a machine whose [`idle_capacity`](Self::idle_capacity) is not a
    /// capacity of the library.
    #[cold]
    pub(crate) fn refusal(&self) -> CStatus {
        if self.idle_capacity() & BUSY == 0 { CStatus::Foreign } else { CStatus::Busy }
    }

    /// Begins a call of an idle machine. A load and a store suffice against interruptions, because
    /// the whole call of an interruption fits between the two.
    pub(crate) fn begin(&self, capacity: u32) {
        self.state.store(capacity | BUSY, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }

    /// Begins a call if none is under way. Two threads may come at once.
    #[cfg(feature = "threads")]
    pub(crate) fn begin_alone(&self) -> Result<(), CStatus> {
        match self.state.fetch_or(BUSY, Ordering::Acquire) & BUSY {
            0 => Ok(()),
            _ => Err(CStatus::Busy),
        }
    }

    /// Ends the call.
    pub(crate) fn done(&self, capacity: u32) {
        self.state.store(capacity, Ordering::Release);
    }

    /// Ends a machine, so that its storage is not a machine any more.
    ///
    /// # Safety
    /// `machine` is one, and no other call uses it.
    #[expect(unsafe_code, reason = "writes to the caller's storage")]
    pub(crate) unsafe fn end<K: StorageKind>(machine: *mut K) {
        // SAFETY: a machine begins with its head, and is the caller's to end.
        let close = unsafe { addr_of_mut!((*machine.cast::<Self>()).close) };
        // SAFETY: as above.
        unsafe { close.write(0) };
    }
}

/// Returns the place for an answer.
pub(crate) fn answer_target<T>(answer: *mut T) -> AnswerTarget {
    AnswerTarget { at: answer.addr(), len: size_of::<T>(), is: check(answer) }
}

/// Refuses a call in which two answers share a place, because the later one would overwrite the
/// earlier.
#[cfg(feature = "threads")]
pub(crate) fn apart(mut answers: &[AnswerTarget]) -> Result<(), CStatus> {
    while let [first, others @ ..] = answers {
        if others.iter().any(|other| overlaps(first.at, first.len, other.at, other.len)) {
            return Err(wrong(CStatus::Overlap));
        }
        answers = others;
    }
    Ok(())
}

/// Returns the status of a wrong call. It is not inlined, so that a correct call does not pay for
/// it.
#[cold]
#[inline(never)]
pub(crate) fn wrong(status: CStatus) -> CStatus {
    core::hint::black_box(status)
}

/// Checks the arguments of an init of either kind, and returns its configuration and clouds.
/// `needed` returns the bytes that a capacity takes, or 0 if the library was not built for it.
///
/// # Safety
/// `config` may be read, with the clouds that it names.
#[expect(unsafe_code, reason = "reads the caller's configuration")]
pub(crate) unsafe fn validated_config<K>(
    (storage, bytes): (*mut c_void, usize),
    config: *const CConfig,
    machine: *mut *mut K,
    clouds: &mut [Cloud; MOST_CLOUDS],
    needed: impl FnOnce(u32) -> usize,
) -> Result<(CConfig, &[Cloud]), CStatus> {
    check(machine)?;
    if overlaps(machine.addr(), size_of::<*mut K>(), storage.addr(), bytes) {
        return Err(CStatus::Overlap);
    }
    check(storage.cast::<K>())?;
    check(config.cast_mut())?;
    // SAFETY: not null, aligned, and may be read by the caller's promise.
    let config = unsafe { config.read() };
    if config.abi != FUSELINE_ABI || config.layout != LAYOUT {
        return Err(CStatus::Abi);
    }
    if config.commit > CCommit::Progressive as u32 {
        return Err(CStatus::Commit);
    }
    if config.greatest_deadline == 0 {
        return Err(CStatus::Deadline);
    }
    // SAFETY: the clouds may be read, by the caller's promise.
    let clouds = unsafe { registered(&config, clouds) }?;
    match needed(config.capacity) {
        0 => Err(CStatus::Capacity),
        needed if bytes < needed => Err(CStatus::Size),
        _ => Ok((config, clouds)),
    }
}

/// Returns the window and the commit rule of a configuration.
pub(crate) fn rule(config: &CConfig) -> (usize, Commit) {
    let commit = match config.commit {
        number if number == CCommit::Progressive as u32 => Commit::Progressive,
        number if number == CCommit::Patient as u32 => Commit::Patient,
        _ => Commit::Eager,
    };
    (usize::try_from(config.window).unwrap_or(usize::MAX), commit)
}

pub(crate) const fn status_of(error: &ConfigError) -> CStatus {
    match error {
        ConfigError::Window { .. } => CStatus::Window,
        ConfigError::TooManyClouds { .. } => CStatus::Clouds,
        ConfigError::LocalPriority => CStatus::Priority,
        ConfigError::DuplicatePriority(_) => CStatus::Twice,
        ConfigError::Gate(_) => CStatus::Gate,
    }
}

/// Returns the clouds of a configuration, each within its ranges.
///
/// # Safety
/// They may be read.
#[expect(unsafe_code, reason = "reads the caller's configuration")]
unsafe fn registered<'a>(
    config: &CConfig,
    places: &'a mut [Cloud; MOST_CLOUDS],
) -> Result<&'a [Cloud], CStatus> {
    let len = usize::try_from(config.clouds_len).unwrap_or(usize::MAX);
    let places = places.get_mut(..len).ok_or(CStatus::Clouds)?;
    if !places.is_empty() {
        check(config.clouds.cast_mut())?;
    }
    for (i, target) in places.iter_mut().enumerate() {
        // SAFETY: within the clouds, by the caller's promise.
        let cloud = unsafe { config.clouds.add(i) };
        // SAFETY: not null, aligned, and may be read by the caller's promise.
        let cloud: CCloud = unsafe { cloud.read() };
        let priority = u16::try_from(cloud.priority).map_err(|_| CStatus::Priority)?;
        // The gate is checked here, because making a machine checks the capacity first.
        if Gate::new(cloud.limit, cloud.resume).is_none() {
            return Err(CStatus::Gate);
        }
        let priority = Priority::new(priority);
        *target = Cloud { priority, limit: cloud.limit, resume: cloud.resume };
    }
    Ok(places)
}

/// Checks that a pointer can point to a `T`.
fn check<T>(pointer: *mut T) -> Result<(), CStatus> {
    if pointer.is_null() {
        return Err(wrong(CStatus::Null));
    }
    if !pointer.is_aligned() {
        return Err(wrong(CStatus::Alignment));
    }
    Ok(())
}

/// Returns `true` if `len` bytes at `at` share a byte with the `bytes` bytes of a storage.
fn overlaps(at: usize, len: usize, storage: usize, bytes: usize) -> bool {
    let distance = at.wrapping_sub(storage);
    distance < bytes || distance.wrapping_neg() < len
}

fn close<K: StorageKind>(address: usize) -> u64 {
    // An address has at most 64 bits.
    K::SEAL ^ address as u64
}
