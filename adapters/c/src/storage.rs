//! A machine for one thread in its caller's storage. This module makes it, calls it and ends it.
//!
//! [`IdleStorage`] is the only access to the machine.

use core::cell::UnsafeCell;
use core::ffi::c_void;

use fuseline_core::{
    Admission, At, Cloud, DropReason, Fusion, Instant, OfferRefusal, Outcome, Ready, Timestamp,
};

use crate::header::{NO_CLOUDS, StorageHeader, StorageKind, rule, status_of, validated_config};
use crate::inputs::{
    AnswerPointer, answer_list, looked, looked_at, priority, write_admission, write_answer,
    write_firing, write_opening,
};
use crate::plain::{
    CAnswer, CConfig, CMessage, CState, CStatus, FUSELINE_BYTES, FUSELINE_BYTES_A_CLOUD,
    FUSELINE_BYTES_A_TIMER, FUSELINE_BYTES_A_TIMESTAMP, capacity_of,
};

/// The beginning of a machine's storage. Opaque to the caller.
#[repr(C, align(8))]
#[derive(Debug)]
pub struct CMachine {
    header: StorageHeader,
}

impl StorageKind for CMachine {
    const SEAL: u64 = 0x4675_7365_6c69_6e65; // "Fuseline"
}

/// The whole storage.
#[repr(C)]
pub(crate) struct Storage<const CLOUDS: usize, const WINDOW: usize> {
    header: CMachine,
    fusion: UnsafeCell<Fusion<CLOUDS, WINDOW>>,
}

/// The capacity that the library was built for.
#[cfg(feature = "capacity-own")]
pub(crate) const OWN_CLOUDS: usize = number(option_env!("FUSELINE_OWN_CLOUDS"), 1);
#[cfg(feature = "capacity-own")]
pub(crate) const OWN_WINDOW: usize = number(option_env!("FUSELINE_OWN_WINDOW"), 1);

#[cfg(feature = "capacity-own")]
pub(crate) const OWN_CAPACITY: u32 = crate::plain::capacity_of(OWN_CLOUDS, OWN_WINDOW);
/// A number that is not a capacity, because the library was built without its own capacity.
#[cfg(not(feature = "capacity-own"))]
pub(crate) const OWN_CAPACITY: u32 = 0;

/// Returns the bytes that the header reserves for a capacity. These are more than needed, so that
/// the machine may change.
const fn reserved(clouds: usize, window: usize) -> usize {
    let a_timestamp =
        FUSELINE_BYTES_A_TIMER.wrapping_mul(clouds).wrapping_add(FUSELINE_BYTES_A_TIMESTAMP);
    FUSELINE_BYTES
        .wrapping_add(FUSELINE_BYTES_A_CLOUD.wrapping_mul(clouds))
        .wrapping_add(window.wrapping_mul(a_timestamp))
}

/// Runs `$do` with `$Storage`, the `$Of` of the capacity `$number`. Returns `$otherwise` if the
/// library was not built for that capacity.
macro_rules! with_room {
    ($number:expr, $Storage:ident = $Of:ident => $do:expr, else $otherwise:expr) => {
        match $number {
            #[cfg(feature = "capacity-1-4")]
            n if n == $crate::plain::CCapacity::C1W4 as u32 => {
                type $Storage = $Of<1, 4>;
                $do
            }
            #[cfg(feature = "capacity-3-16")]
            n if n == $crate::plain::CCapacity::C3W16 as u32 => {
                type $Storage = $Of<3, 16>;
                $do
            }
            #[cfg(feature = "capacity-7-64")]
            n if n == $crate::plain::CCapacity::C7W64 as u32 => {
                type $Storage = $Of<7, 64>;
                $do
            }
            #[cfg(feature = "capacity-15-1024")]
            n if n == $crate::plain::CCapacity::C15W1024 as u32 => {
                type $Storage = $Of<15, 1024>;
                $do
            }
            #[cfg(feature = "capacity-own")]
            n if n == $crate::storage::OWN_CAPACITY => {
                type $Storage =
                    $Of<{ $crate::storage::OWN_CLOUDS }, { $crate::storage::OWN_WINDOW }>;
                $do
            }
            _ => $otherwise,
        }
    };
}
pub(crate) use with_room;

impl<const CLOUDS: usize, const WINDOW: usize> Storage<CLOUDS, WINDOW> {
    const FITS: () = {
        assert!(size_of::<Self>() <= reserved(CLOUDS, WINDOW), "the header reserves too little");
        assert!(align_of::<Self>() == align_of::<CMachine>(), "the header aligns as uint64_t");
    };

    /// Writes a machine into the storage.
    ///
    /// # Safety
    /// `storage` is aligned, and `size_of::<Self>()` bytes from it may be written and belong to
    /// nobody else.
    #[expect(unsafe_code, reason = "writes to the caller's storage")]
    unsafe fn fill(storage: *mut Self, config: &CConfig, clouds: &[Cloud]) -> Result<(), CStatus> {
        const { Self::FITS };
        let (window, commit) = rule(config);
        let fusion = Fusion::new(window, commit, clouds).map_err(|error| status_of(&error))?;
        let header = CMachine { header: StorageHeader::new::<CMachine, Self>(storage, config) };
        // SAFETY: that many bytes may be written, by the caller's promise; nothing was there that
        // would have to be dropped.
        unsafe { storage.write(Self { header, fusion: UnsafeCell::new(fusion) }) };
        Ok(())
    }
}

/// The storage of a machine without a call under way. It accepts one call.
pub(crate) struct IdleStorage<'a, const CLOUDS: usize, const WINDOW: usize>(
    &'a Storage<CLOUDS, WINDOW>,
);

// The inputs are not inlined, so that each exists once for each capacity, with the arguments where
// the caller put them.
impl<const CLOUDS: usize, const WINDOW: usize> IdleStorage<'_, CLOUDS, WINDOW> {
    const CAPACITY: u32 = capacity_of(CLOUDS, WINDOW);
    /// A number beyond 16 bits cannot be registered, so it is unknown (F3, F4, A18).
    const UNKNOWN: Outcome<CLOUDS> = Outcome::Dropped(DropReason::Unknown);

    /// # Safety
    /// A storage of this capacity was written here, no call is under way, and no other thread calls
    /// at the same time.
    #[expect(unsafe_code, reason = "reads the caller's storage")]
    pub(crate) unsafe fn new(storage: *mut Storage<CLOUDS, WINDOW>) -> Self {
        // SAFETY: by the caller's promise.
        Self(unsafe { &*storage })
    }

    /// Writes the next due instant.
    pub(crate) fn next_due(self, due: AnswerPointer<u64>) -> CStatus {
        self.enter(|fusion, _| answer_list(fusion.next_due().map(Instant::as_nanos), due))
    }

    /// Writes the machine's state.
    pub(crate) fn look(self, state: AnswerPointer<CState>) -> CStatus {
        self.enter(|fusion, _| answer_list(Some(looked(fusion)), state))
    }

    /// Writes the state of an open timestamp.
    pub(crate) fn look_at(self, t: u64, message: AnswerPointer<CMessage>) -> CStatus {
        self.enter(|fusion, _| answer_list(looked_at(fusion, Timestamp::new(t)), message))
    }

    /// Writes 1 if a cloud's gate was left shut, and 0 otherwise.
    pub(crate) fn gate_is_shut(self, p: u64, is_shut: AnswerPointer<u32>) -> CStatus {
        self.enter(|fusion, _| {
            let gate = priority(p).and_then(|cloud| fusion.gate(cloud));
            answer_list(gate.map(|gate| gate.is_shut().into()), is_shut)
        })
    }

    /// Opens a timestamp (F1).
    #[inline(never)]
    pub(crate) fn open(self, now: u64, t: u64, answer: AnswerPointer<CAnswer>) -> CStatus {
        self.submit(now, t, answer, |mut ready, _, answer| {
            write_opening(answer, ready.open(Timestamp::new(t), None));
        })
    }

    /// Opens a timestamp with this deadline for local (F1).
    #[inline(never)]
    pub(crate) fn open_within(
        self,
        now: u64,
        t: u64,
        deadline: u64,
        answer: AnswerPointer<CAnswer>,
    ) -> CStatus {
        self.submit(now, t, answer, |mut ready, header, answer| {
            let deadline = Some(header.deadline(deadline));
            write_opening(answer, ready.open(Timestamp::new(t), deadline));
        })
    }

    /// Offers a request to the cloud with this priority (F2).
    #[inline(never)]
    pub(crate) fn offer(
        self,
        now: u64,
        t: u64,
        p: u64,
        deadline: u64,
        backlog: u64,
        answer: AnswerPointer<CAnswer>,
    ) -> CStatus {
        self.submit(now, t, answer, |mut ready, header, answer| {
            // A number beyond 16 bits cannot be registered, so it is unknown (F2, A18).
            let admission = priority(p).map_or(Admission::Refused(OfferRefusal::Unknown), |p| {
                ready.offer(Timestamp::new(t), p, header.deadline(deadline), backlog)
            });
            write_admission(answer, admission);
        })
    }

    /// Reports a result of this source (F3).
    #[inline(never)]
    pub(crate) fn result(
        self,
        now: u64,
        t: u64,
        p: u64,
        answer: AnswerPointer<CAnswer>,
    ) -> CStatus {
        self.submit(now, t, answer, |mut ready, _, answer| {
            let result = |p| ready.result(Timestamp::new(t), p);
            write_answer(answer, &priority(p).map_or(Self::UNKNOWN, result));
        })
    }

    /// Reports a failure of this source (F4).
    #[inline(never)]
    pub(crate) fn fail(self, now: u64, t: u64, p: u64, answer: AnswerPointer<CAnswer>) -> CStatus {
        self.submit(now, t, answer, |mut ready, _, answer| {
            let fail = |p| ready.fail(Timestamp::new(t), p);
            write_answer(answer, &priority(p).map_or(Self::UNKNOWN, fail));
        })
    }

    /// Lets time pass (F0).
    #[inline(never)]
    pub(crate) fn tick(self, now: u64, answer: AnswerPointer<CAnswer>) -> CStatus {
        self.submit(now, 0, answer, |_, _, _| ())
    }

    /// Writes one firing (F5), or the input's own answer.
    #[inline]
    fn submit(
        self,
        now: u64,
        t: u64,
        answer: AnswerPointer<CAnswer>,
        input: impl FnOnce(Ready<'_, CLOUDS, WINDOW>, &StorageHeader, &mut CAnswer),
    ) -> CStatus {
        self.enter(|fusion, header| {
            let now = Instant::from_nanos(now).max(fusion.now());
            let answer = answer.write(CAnswer { at: now.as_nanos(), t, ..CAnswer::EMPTY });
            if fusion.next_due().is_some_and(|due| due <= now) {
                return fire(fusion, now, answer);
            }
            fire_or(fusion, now, answer, |ready, answer| input(ready, header, answer))
        })
    }

    /// Runs `call` with the machine. A call that interrupts it finds the machine busy.
    #[expect(unsafe_code, reason = "the machine is behind a shared reference")]
    #[inline]
    fn enter(
        self,
        call: impl FnOnce(&mut Fusion<CLOUDS, WINDOW>, &StorageHeader) -> CStatus,
    ) -> CStatus {
        let header = &self.0.header.header;
        header.begin(Self::CAPACITY);
        // SAFETY: no other call uses it, by the promise of `new`, and from now on `header` says
        // that one does.
        let status = call(unsafe { &mut *self.0.fusion.get() }, header);
        header.done(Self::CAPACITY);
        status
    }
}

/// Writes one firing. It is not inlined, so that an input without a firing needs few registers.
#[inline(never)]
fn fire<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    now: Instant,
    answer: &mut CAnswer,
) -> CStatus {
    fire_or(fusion, now, answer, |_, _| ())
}

/// Writes one firing, or runs `input` if nothing is due.
#[inline]
fn fire_or<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    now: Instant,
    answer: &mut CAnswer,
    input: impl FnOnce(Ready<'_, CLOUDS, WINDOW>, &mut CAnswer),
) -> CStatus {
    match fusion.at(now) {
        At::Fired(ref firing) => {
            write_firing(answer, firing);
            CStatus::Again
        }
        At::Ready(ready) => {
            input(ready, answer);
            CStatus::Done
        }
    }
}

/// Returns the number of bytes that a machine of this capacity takes, or 0 if the library was not
/// built for it.
pub(crate) const fn bytes(capacity: u32) -> usize {
    with_room!(capacity, R = Storage => size_of::<R>(), else 0)
}

/// Makes a machine and writes its address. Nothing is written unless everything is valid.
///
/// # Safety
/// `config` may be read, with the clouds that it names; `bytes` bytes from `storage` may be written
/// and belong to nobody else; `machine` may be written.
#[expect(unsafe_code, reason = "reads the caller's configuration and writes to its storage")]
pub(crate) unsafe fn make(
    storage: *mut c_void,
    bytes: usize,
    config: *const CConfig,
    machine: *mut *mut CMachine,
) -> Result<(), CStatus> {
    let mut clouds = NO_CLOUDS;
    // SAFETY: by the caller's promise.
    let (config, clouds) =
        unsafe { validated_config((storage, bytes), config, machine, &mut clouds, self::bytes) }?;
    with_room!(config.capacity, R = Storage => {
        // SAFETY: aligned and large enough, as was checked, and the caller's to give.
        unsafe { R::fill(storage.cast(), &config, clouds) }?;
    }, else return Err(CStatus::Capacity));
    // SAFETY: not null, aligned, and may be written by the caller's promise.
    unsafe { machine.write(storage.cast()) };
    Ok(())
}

/// Ends a machine: from now on it is foreign.
///
/// # Safety
/// `machine` came from [`make`], or may at least be read as a [`CMachine`]; no other call comes at
/// the same time.
#[expect(unsafe_code, reason = "reads and writes the caller's storage")]
pub(crate) unsafe fn end(machine: *mut CMachine) -> Result<(), CStatus> {
    // SAFETY: as the caller promised.
    let header = unsafe { StorageHeader::of(machine, &[]) }?;
    if bytes(header.idle_capacity()) == 0 {
        return Err(header.refusal());
    }
    // SAFETY: it is one, and no other call uses it.
    unsafe { StorageHeader::end(machine) };
    Ok(())
}

/// Returns a number from the environment of the build.
#[cfg(feature = "capacity-own")]
const fn number(text: Option<&str>, without: usize) -> usize {
    let Some(text) = text else { return without };
    match usize::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => 0, // No window: does not compile.
    }
}
