//! [`SharedHandle`]: takes results, failures and ticks from any thread, without a lock.
//!
//! Each call changes the state of one message, which is packed into one word, by compare-and-swap.
//! Only the [`Owner`](crate::Owner) opens messages and makes requests.

use core::sync::atomic::Ordering;

#[cfg(not(loom))]
use core::sync::atomic::AtomicU64;
#[cfg(loom)]
use loom::sync::atomic::AtomicU64;

use fuseline_core::{
    Cause, Clouds, Commit, DropReason, Entry, Firing, Instant, Outcome, Priority, Slot, Source,
    Sources,
};

use crate::message_id::MessageId;
use crate::packed::PackedSlot;

/// Takes results, failures and ticks from any thread.
///
/// Each call names its message and an instant of the caller's own clock. It first fires the
/// message's timers that are due by then, and returns them as one firing. If timers were due at
/// several instants, the firing has all of them, with the last due instant and its outcome. The
/// caller that gets `Forwarded`, in a firing or an outcome, sends the output; exactly one caller
/// does.
///
/// - inputs: [`result`](Self::result), [`fail`](Self::fail), [`expire`](Self::expire)
/// - queries: [`next_due`](Self::next_due), [`source`](Self::source), [`priority`](Self::priority)
pub struct SharedHandle<const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) window: usize,
    pub(crate) commit: Commit,
    pub(crate) clouds: Clouds<CLOUDS>,
    pub(crate) slots: [WindowSlot<CLOUDS>; WINDOW],
}

/// One slot of the window. Slots share no cache line because different threads use their messages.
#[repr(align(64))]
pub(crate) struct WindowSlot<const CLOUDS: usize> {
    pub(crate) packed: AtomicU64,
    local_due: AtomicU64,
    dues: [AtomicU64; CLOUDS],
}

impl<const CLOUDS: usize, const WINDOW: usize> SharedHandle<CLOUDS, WINDOW> {
    /// The greatest number of changes to an open timestamp. Each cloud is requested once, each
    /// source stops being pending once, and the last of these changes retires the timestamp. An
    /// exchange fails only after a change.
    const CHANGES: usize = CLOUDS.wrapping_mul(2).wrapping_add(1);

    pub(crate) fn new(window: usize, commit: Commit, clouds: Clouds<CLOUDS>) -> Self {
        Self { window, commit, clouds, slots: core::array::from_fn(|_| WindowSlot::new()) }
    }

    /// Reports the result of a source (F3). Returns the timers that fired first, and the outcome.
    pub fn result(
        &self,
        now: Instant,
        message_id: MessageId,
        source: Priority,
    ) -> (Option<Firing<CLOUDS>>, Outcome<CLOUDS>) {
        self.close(now, message_id, source, Cause::Result)
    }

    /// Reports that no result will come from a source (F4). Returns the timers that fired first,
    /// and the outcome.
    pub fn fail(
        &self,
        now: Instant,
        message_id: MessageId,
        source: Priority,
    ) -> (Option<Firing<CLOUDS>>, Outcome<CLOUDS>) {
        self.close(now, message_id, source, Cause::Failure)
    }

    /// Fires the message's timers that are due by `now` (F5). Returns `None` if none is due or the
    /// message is no longer open.
    #[must_use = "a firing may forward a result"]
    pub fn expire(&self, now: Instant, message_id: MessageId) -> Option<Firing<CLOUDS>> {
        let fired = self.exchange(message_id, |_, mut entry| {
            let fired = self.fire(now, message_id, &mut entry);
            (entry.slot(), fired)
        });
        fired.flatten()
    }

    /// Returns the earliest due instant of the message's timers, or `None` if none is armed. A call
    /// of another thread may change it at any time.
    #[must_use]
    pub fn next_due(&self, message_id: MessageId) -> Option<Instant> {
        self.exchange(message_id, |_, entry| (entry.slot(), entry.next_due())).flatten()
    }

    /// Returns the source with this priority, or `None` if no cloud is registered with it. Priority
    /// 0 is local.
    #[must_use]
    pub fn source(&self, priority: Priority) -> Option<Source> {
        self.clouds.source(priority)
    }

    /// Returns the priority of `source`, or 0 if the source is not registered.
    #[must_use]
    pub fn priority(&self, source: Source) -> Priority {
        self.clouds.priority(source)
    }

    fn close(
        &self,
        now: Instant,
        message_id: MessageId,
        source: Priority,
        cause: impl Fn(Source) -> Cause,
    ) -> (Option<Firing<CLOUDS>>, Outcome<CLOUDS>) {
        let source = self.clouds.source(source);
        let answer = self.exchange(message_id, |_, mut entry| {
            let fired = self.fire(now, message_id, &mut entry);
            let Some(source) = source else {
                return (entry.slot(), (fired, Outcome::Dropped(DropReason::Unknown)));
            };
            let (slot, decision) = entry.slot().step(self.commit, cause(source));
            (slot, (fired, self.clouds.outcome(decision)))
        });
        answer.unwrap_or_else(|| {
            let reason = source.map_or(DropReason::Unknown, |_| DropReason::Superseded);
            (None, Outcome::Dropped(reason))
        })
    }

    /// Fires the timers of one message that are due by `now`, one due instant after the other (F5).
    pub(crate) fn fire(
        &self,
        now: Instant,
        message_id: MessageId,
        entry: &mut Entry<CLOUDS>,
    ) -> Option<Firing<CLOUDS>> {
        let mut timers = Sources::EMPTY;
        let mut last = None;
        for _ in 0..Source::COUNT {
            // A timer fires at its due instant, not after it (F5, A1).
            let Some(due) = entry.next_due().filter(|due| *due <= now) else { break };
            let firing = entry.armed_at(due);
            let (slot, decision) = entry.slot().step(self.commit, Cause::Timers(firing));
            entry.set_slot(slot);
            timers = timers.union(firing);
            last = Some((due, decision));
        }
        let (due, decision) = last?;
        Some(Firing {
            timestamp: message_id.timestamp,
            due,
            timers: self.clouds.priorities(timers),
            outcome: self.clouds.outcome(decision),
        })
    }

    /// Atomically replaces the message's state with the state that `decide` returns, and returns
    /// the answer of `decide`. Returns `None` if the message is no longer open.
    ///
    /// No state recurs within a generation, and the due instant of a requested source does not
    /// change. So if the word is unchanged, everything that `decide` saw is unchanged too.
    pub(crate) fn exchange<A>(
        &self,
        message_id: MessageId,
        mut decide: impl FnMut(&WindowSlot<CLOUDS>, Entry<CLOUDS>) -> (Slot, A),
    ) -> Option<A> {
        let window_slot = self.slots.get(message_id.place())?;
        for _ in 0..Self::CHANGES {
            // Acquire makes visible the due instants of the requested sources, and everything that
            // was done before their results were held.
            let packed =
                PackedSlot::<CLOUDS>::from_bits(window_slot.packed.load(Ordering::Acquire));
            if packed.generation() != message_id.generation {
                return None;
            }
            let (slot, answer) = decide(window_slot, window_slot.entry(packed.slot(self.commit)));
            let next = packed.stepped(slot);
            // The exchange runs even if nothing changes, because another message with other due
            // instants may use the slot by now.
            // Release makes what this caller did before visible to the thread that forwards or
            // opens next. The word of a failed exchange is unused, so its load may be relaxed; the
            // next load sees no older word.
            let exchanged = window_slot.packed.compare_exchange(
                packed.bits(),
                next.bits(),
                Ordering::Release,
                Ordering::Relaxed,
            );
            if exchanged.is_ok() {
                return Some(answer);
            }
        }
        // No change can follow the last one, so the loop is bounded (F8).
        None
    }
}

impl<const CLOUDS: usize> WindowSlot<CLOUDS> {
    fn new() -> Self {
        Self {
            packed: AtomicU64::new(0),
            local_due: AtomicU64::new(0),
            dues: core::array::from_fn(|_| AtomicU64::new(0)),
        }
    }

    /// Sets the due instant of a source that is not yet requested. The store is relaxed because the
    /// word that requests the source publishes it.
    pub(crate) fn set_due(&self, source: Source, due: Instant) {
        if let Some(cell) = self.due(source) {
            cell.store(due.as_nanos(), Ordering::Relaxed);
        }
    }

    /// Returns the state with the due instants of its armed timers. The loads are relaxed because
    /// the due instants were published together with the word.
    fn entry(&self, slot: Slot) -> Entry<CLOUDS> {
        let mut entry = Entry::new(slot);
        for source in slot.armed().iter() {
            if let Some(cell) = self.due(source) {
                entry.set_due(source, Instant::from_nanos(cell.load(Ordering::Relaxed)));
            }
        }
        entry
    }

    fn due(&self, source: Source) -> Option<&AtomicU64> {
        match usize::from(source.index()).checked_sub(1) {
            None => Some(&self.local_due),
            Some(cloud) => self.dues.get(cloud),
        }
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> core::fmt::Debug for SharedHandle<CLOUDS, WINDOW> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("SharedHandle")
            .field("commit", &self.commit)
            .field("window", &self.window)
            .finish_non_exhaustive()
    }
}
