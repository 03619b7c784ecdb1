//! The functions of the header for the machine that many threads call without a lock (SPEC.md, section 8).
#![expect(unsafe_code, reason = "a C interface reads and writes through its caller's pointers")]
#![expect(clippy::doc_markdown, reason = "these texts are the header's, which has no markdown")]
#![expect(clippy::missing_safety_doc, reason = "the header's preamble says it once for all calls")]

use core::ffi::c_void;
use core::mem::{size_of, transmute};
use core::ptr::addr_of_mut;
use core::sync::atomic::{AtomicU32, Ordering};

use fuseline_core::{
    Admission, Deadline, DropReason, Firing, Instant, OfferRefusal, Outcome, Timestamp,
};
use fuseline_threads::{Desk, Owner, Shared, Ticket};

use crate::inputs::{open_refusal, priority, tell, tell_admission, tell_firing};
use crate::plain::{CAnswer, CConfig, COutcome, CReason, CStatus, CTicket};
use crate::storage::{NO_CLOUDS, check, configured, rule, status_of, with_room};

/// A machine for many threads, in its caller's storage. Opaque.
#[repr(C, align(64))]
#[derive(Debug)]
pub struct CShared {
    /// The seal of the address at which it was initialised.
    seal: u64,
    bytes: usize,
    capacity: u32,
    /// 1 while a call of the owner's is under way.
    busy: AtomicU32,
}

/// The whole storage. `owner` and `desk` refer to `shared`, which is not touched otherwise.
#[repr(C)]
struct Hall<const CLOUDS: usize, const WINDOW: usize> {
    head: CShared,
    owner: Owner<'static, CLOUDS, WINDOW>,
    desk: &'static Desk<CLOUDS, WINDOW>,
    shared: Shared<CLOUDS, WINDOW>,
}

const SEAL: u64 = 0x5468_7265_6164_7321; // "Threads!"

/// What is asked of any thread about one message.
#[derive(Clone, Copy)]
enum Brought {
    Result(u64),
    Failure(u64),
    Time,
}

/// What all capacities have in common.
trait Halves {
    fn open(&mut self, now: u64, t: u64, deadline: Option<u64>) -> Result<Ticket, CReason>;
    fn offer(&mut self, now: u64, ticket: Ticket, offer: (u64, u64, u64), told: &mut Told);
}

/// The answers of one call: first of the timers that were due, then the input's own.
struct Told {
    fired: CAnswer,
    answer: CAnswer,
}

impl<const CLOUDS: usize, const WINDOW: usize> Halves for Owner<'static, CLOUDS, WINDOW> {
    fn open(&mut self, now: u64, t: u64, deadline: Option<u64>) -> Result<Ticket, CReason> {
        let deadline = deadline.map(Deadline::from_nanos);
        self.open(Instant::from_nanos(now), Timestamp::new(t), deadline).map_err(open_refusal)
    }

    fn offer(&mut self, now: u64, ticket: Ticket, offer: (u64, u64, u64), told: &mut Told) {
        let (p, deadline, backlog) = offer;
        // F2 unknown: what does not fit 16 bits cannot be registered (A18). No other call is asked then.
        let Some(p) = priority(p) else {
            return tell_admission(&mut told.answer, Admission::Refused(OfferRefusal::Unknown));
        };
        let deadline = Deadline::from_nanos(deadline);
        let (fired, admission) = self.offer(Instant::from_nanos(now), ticket, p, deadline, backlog);
        tell_fired(&mut told.fired, fired.as_ref());
        tell_admission(&mut told.answer, admission);
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> Hall<CLOUDS, WINDOW> {
    /// Writes a machine into the storage.
    ///
    /// # Safety
    /// `storage` is aligned, and `size_of::<Self>()` bytes from it may be written and belong to nobody else until the
    /// machine is ended.
    unsafe fn fill(storage: *mut Self, made: Shared<CLOUDS, WINDOW>, capacity: u32) {
        // SAFETY: within the storage, by the caller's promise.
        let shared = unsafe { addr_of_mut!((*storage).shared) };
        // SAFETY: as above.
        unsafe { shared.write(made) };
        // SAFETY: written just now; from here on it is used through its two halves alone, while the storage is there.
        let (owner, desk) = unsafe { &mut *shared }.split();
        // SAFETY: within the storage.
        let place = unsafe { addr_of_mut!((*storage).owner) };
        // SAFETY: as above.
        unsafe { place.write(owner) };
        // SAFETY: within the storage.
        let place = unsafe { addr_of_mut!((*storage).desk) };
        // SAFETY: as above.
        unsafe { place.write(desk) };
        let head = CShared {
            seal: seal(storage.cast()),
            bytes: size_of::<Self>(),
            capacity,
            busy: AtomicU32::new(0),
        };
        // SAFETY: within the storage.
        let place = unsafe { addr_of_mut!((*storage).head) };
        // SAFETY: as above. Last, so that a machine is one only when it is whole.
        unsafe { place.write(head) };
    }
}

/// How many bytes of storage a machine for many threads takes in this library; 0 if it does not hold the capacity.
/// Align it to 64 bytes.
#[unsafe(no_mangle)]
pub extern "C" fn fuseline_shared_bytes(capacity: u32) -> usize {
    with_room!(capacity, R = Hall => size_of::<R>(), else 0)
}

/// Makes a machine for many threads (SPEC.md, section 8) in `storage`, aligned to 64 bytes. As fuseline_init otherwise.
///
/// One thread at a time opens and offers; any thread gives results, failures and time, each for one ticket. Call no
/// function of it before this one returned, and none while or after it is ended.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_init(
    storage: *mut c_void,
    bytes: usize,
    config: *const CConfig,
    machine: *mut *mut CShared,
) -> CStatus {
    if let Err(status) = check(machine).and_then(|()| check(storage.cast::<CShared>())) {
        return status;
    }
    let distance = machine.addr().wrapping_sub(storage.addr());
    if distance < bytes || distance.wrapping_neg() < size_of::<*mut CShared>() {
        return CStatus::Overlap;
    }
    let mut clouds = NO_CLOUDS;
    // SAFETY: the header asks for a readable configuration.
    let (config, clouds) = match unsafe { configured(config, &mut clouds) } {
        Ok(configured) => configured,
        Err(status) => return status,
    };
    let needed = fuseline_shared_bytes(config.capacity);
    if bytes < needed {
        return CStatus::Size;
    }
    let (window, commit) = rule(&config);
    with_room!(config.capacity, R = Hall => match Shared::new(window, commit, clouds) {
        // SAFETY: aligned and large enough as checked, and the caller's to give.
        Ok(made) => unsafe { R::fill(storage.cast(), made, config.capacity) },
        Err(error) => return status_of(&error),
    }, else return CStatus::Capacity);
    // SAFETY: not null, aligned, and the header asks that it may be written.
    unsafe { machine.write(storage.cast()) };
    CStatus::Done
}

/// Ends a machine, when no thread calls it any more: its storage is the caller's again.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_end(machine: *mut CShared) -> CStatus {
    // SAFETY: as the header asks.
    if let Err(status) = unsafe { head(machine, &[]) } {
        return status;
    }
    // SAFETY: a machine, as was just found.
    let seal = unsafe { addr_of_mut!((*machine).seal) };
    // SAFETY: no other thread uses it, as the header asks.
    unsafe { seal.write(0) };
    CStatus::Done
}

/// F1, the owner's: a message came. `*ticket` names it if it is accepted.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_open(
    machine: *mut CShared,
    now: u64,
    t: u64,
    ticket: *mut CTicket,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header asks.
    unsafe { open(machine, (now, t, None), ticket, answer) }
}

/// F1, the owner's: a message came, and local may take `deadline` nanoseconds for it.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_open_within(
    machine: *mut CShared,
    now: u64,
    t: u64,
    deadline: u64,
    ticket: *mut CTicket,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header asks.
    unsafe { open(machine, (now, t, Some(deadline)), ticket, answer) }
}

/// F2, the owner's: may the message be sent to cloud `p`? `fired` says first which of its timers were due.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_offer(
    machine: *mut CShared,
    now: u64,
    ticket: CTicket,
    p: u64,
    deadline: u64,
    backlog: u64,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    let mut told = told(now, ticket);
    // SAFETY: as the header asks.
    let asked = unsafe {
        owner(machine, &[place(fired), place(answer)], |owner| {
            owner.offer(now, named(ticket), (p, deadline, backlog), &mut told);
        })
    };
    // SAFETY: as the header asks.
    asked.map_or_else(|status| status, |()| unsafe { write(&told, fired, answer) })
}

/// F3, any thread's: the result of source `p` came. `fired` says first which of the message's timers were due by `now`,
/// several due instants as one firing. Of all callers exactly one is told to forward.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_result(
    machine: *mut CShared,
    now: u64,
    ticket: CTicket,
    p: u64,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header asks.
    unsafe { bring(machine, now, ticket, Brought::Result(p), fired, answer) }
}

/// F4, any thread's: no result will come from source `p`.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_fail(
    machine: *mut CShared,
    now: u64,
    ticket: CTicket,
    p: u64,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header asks.
    unsafe { bring(machine, now, ticket, Brought::Failure(p), fired, answer) }
}

/// F5, any thread's: time went by for this message.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_expire(
    machine: *mut CShared,
    now: u64,
    ticket: CTicket,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header asks.
    unsafe { bring(machine, now, ticket, Brought::Time, fired, answer) }
}

/// Question, any thread's: when a timer of this message is due next, or FUSELINE_STATUS_NONE.
#[must_use]
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fuseline_shared_next_due(
    machine: *mut CShared,
    ticket: CTicket,
    due: *mut u64,
) -> CStatus {
    // SAFETY: as the header asks.
    let capacity = match unsafe { head(machine, &[place(due)]) } {
        Ok(capacity) => capacity,
        Err(status) => return status,
    };
    let found = with_room!(capacity, R = Hall => {
        // SAFETY: the seal says that a hall of this capacity was written here.
        let desk = unsafe { (*machine.cast::<R>()).desk };
        desk.next_due(named(ticket))
    }, else None);
    let Some(found) = found else { return CStatus::None };
    // SAFETY: not null, aligned, outside the machine, and the header asks that it may be written.
    unsafe { due.write(found.as_nanos()) };
    CStatus::Done
}

/// # Safety
/// As the header asks.
unsafe fn open(
    machine: *mut CShared,
    (now, t, deadline): (u64, u64, Option<u64>),
    ticket: *mut CTicket,
    answer: *mut CAnswer,
) -> CStatus {
    let mut opened = Err(CReason::None);
    // SAFETY: as the header asks.
    let asked = unsafe {
        owner(machine, &[place(ticket), place(answer)], |owner| {
            opened = owner.open(now, t, deadline);
        })
    };
    if let Err(status) = asked {
        return status;
    }
    let mut told = CAnswer { at: now, t, outcome: COutcome::Accepted, ..CAnswer::EMPTY };
    match opened {
        // SAFETY: not null, aligned, outside the machine, and the header asks that it may be written.
        Ok(made) => unsafe { ticket.write(plain(made)) },
        Err(why) => (told.outcome, told.why) = (COutcome::Refused, why),
    }
    // SAFETY: as above.
    unsafe { answer.write(told) };
    CStatus::Done
}

/// # Safety
/// As the header asks.
unsafe fn bring(
    machine: *mut CShared,
    now: u64,
    ticket: CTicket,
    brought: Brought,
    fired: *mut CAnswer,
    answer: *mut CAnswer,
) -> CStatus {
    // SAFETY: as the header asks.
    let capacity = match unsafe { head(machine, &[place(fired), place(answer)]) } {
        Ok(capacity) => capacity,
        Err(status) => return status,
    };
    let mut told = told(now, ticket);
    with_room!(capacity, R = Hall => {
        // SAFETY: the seal says that a hall of this capacity was written here. The desk takes calls of any threads.
        let desk = unsafe { (*machine.cast::<R>()).desk };
        ask_desk(desk, Instant::from_nanos(now), named(ticket), brought, &mut told);
    }, else return CStatus::Foreign);
    // SAFETY: as the header asks.
    unsafe { write(&told, fired, answer) }
}

fn ask_desk<const CLOUDS: usize, const WINDOW: usize>(
    desk: &Desk<CLOUDS, WINDOW>,
    now: Instant,
    ticket: Ticket,
    brought: Brought,
    told: &mut Told,
) {
    let unknown = || (desk.expire(now, ticket), Outcome::Dropped(DropReason::Unknown));
    let (fired, outcome) = match brought {
        Brought::Result(p) => priority(p).map_or_else(unknown, |p| desk.result(now, ticket, p)),
        Brought::Failure(p) => priority(p).map_or_else(unknown, |p| desk.fail(now, ticket, p)),
        Brought::Time => return tell_fired(&mut told.fired, desk.expire(now, ticket).as_ref()),
    };
    tell_fired(&mut told.fired, fired.as_ref());
    tell(&mut told.answer, &outcome);
}

fn tell_fired<const CLOUDS: usize>(answer: &mut CAnswer, fired: Option<&Firing<CLOUDS>>) {
    if let Some(firing) = fired {
        tell_firing(answer, firing);
    }
}

/// Where an answer will be written.
struct Written {
    at: usize,
    len: usize,
    is: Result<(), CStatus>,
}

fn place<T>(answer: *mut T) -> Written {
    Written { at: answer.addr(), len: size_of::<T>(), is: check(answer) }
}

/// The capacity of a machine that is one, if the answers lie outside of it.
///
/// # Safety
/// `machine` came from [`fuseline_shared_init`] or may be read as a [`CShared`] at least.
unsafe fn head(machine: *mut CShared, answers: &[Written]) -> Result<u32, CStatus> {
    for answer in answers {
        answer.is?;
    }
    check(machine)?;
    // SAFETY: not null, aligned, and may be read by the caller's promise; nobody writes it while calls are made.
    let head = unsafe { &*machine };
    if head.seal != seal(machine) {
        return Err(CStatus::Foreign);
    }
    for answer in answers {
        let distance = answer.at.wrapping_sub(machine.addr());
        if distance < head.bytes || distance.wrapping_neg() < answer.len {
            return Err(CStatus::Overlap);
        }
    }
    Ok(head.capacity)
}

/// Runs `call` with the owner's half, unless another call of it is under way.
///
/// # Safety
/// As for [`head`].
unsafe fn owner(
    machine: *mut CShared,
    answers: &[Written],
    call: impl FnOnce(&mut dyn Halves),
) -> Result<(), CStatus> {
    // SAFETY: by the caller's promise.
    let capacity = unsafe { head(machine, answers) }?;
    // SAFETY: a machine, as was just found.
    let busy = unsafe { &(*machine).busy };
    // An exchange: here two threads may well come at once.
    if busy.swap(1, Ordering::Acquire) != 0 {
        return Err(CStatus::Busy);
    }
    with_room!(capacity, R = Hall => {
        // SAFETY: the seal says that a hall of this capacity was written here.
        let owner = unsafe { addr_of_mut!((*machine.cast::<R>()).owner) };
        // SAFETY: as above, and `busy` says that no other call uses the owner's half.
        call(unsafe { &mut *owner });
    }, else return Err(CStatus::Foreign));
    busy.store(0, Ordering::Release);
    Ok(())
}

/// # Safety
/// Both may be written.
unsafe fn write(told: &Told, fired: *mut CAnswer, answer: *mut CAnswer) -> CStatus {
    // SAFETY: by the caller's promise.
    unsafe { fired.write(told.fired) };
    // SAFETY: as above.
    unsafe { answer.write(told.answer) };
    CStatus::Done
}

fn told(now: u64, ticket: CTicket) -> Told {
    let t = named(ticket).timestamp().as_u64();
    let empty = CAnswer { at: now, t, ..CAnswer::EMPTY };
    Told { fired: empty, answer: empty }
}

fn named(ticket: CTicket) -> Ticket {
    // SAFETY: a ticket is three integers of 64 bits, any of which are a ticket. The sizes are compared when compiled.
    unsafe { transmute::<[u64; 3], Ticket>(ticket.opaque) }
}

fn plain(ticket: Ticket) -> CTicket {
    // SAFETY: as for `named`; no byte of it is padding.
    CTicket { opaque: unsafe { transmute::<Ticket, [u64; 3]>(ticket) } }
}

fn seal(machine: *const CShared) -> u64 {
    // An address has at most 64 bits.
    SEAL ^ machine.addr() as u64
}
