//! [`SharedHandle`]: results, failures and ticks from any thread, without a lock.
//!
//! Each call changes the state of one message, packed into one word, by compare-and-swap. It opens no message and makes no
//! request: those are the [`Owner`](crate::Owner)'s alone.

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

/// Where any thread gives results, failures and ticks.
///
/// Each call names its message and bears an instant of the caller's own clock. It first returns which timers of that
/// message were due by then and what they decided; several due instants are one firing, with the last of them.
/// The caller that gets `Forwarded`, in a firing or an outcome, forwards; exactly one does.
///
/// - inputs: [`result`](Self::result), [`fail`](Self::fail), [`expire`](Self::expire)
/// - questions: [`next_due`](Self::next_due), [`source`](Self::source), [`priority`](Self::priority)
pub struct SharedHandle<const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) window: usize,
    pub(crate) commit: Commit,
    pub(crate) clouds: Clouds<CLOUDS>,
    pub(crate) slots: [WindowSlot<CLOUDS>; WINDOW],
}

/// One slot of the window. Slots share no cache lines: their messages have different callers.
#[repr(align(64))]
pub(crate) struct WindowSlot<const CLOUDS: usize> {
    pub(crate) packed: AtomicU64,
    local_due: AtomicU64,
    dues: [AtomicU64; CLOUDS],
}

impl<const CLOUDS: usize, const WINDOW: usize> SharedHandle<CLOUDS, WINDOW> {
    /// The most changes that an open timestamp can see: each cloud is requested once, each source stops being pending once,
    /// and the last of these changes retires it. An exchange fails only after a change.
    const CHANGES: usize = CLOUDS.wrapping_mul(2).wrapping_add(1);

    pub(crate) fn new(window: usize, commit: Commit, clouds: Clouds<CLOUDS>) -> Self {
        Self { window, commit, clouds, slots: core::array::from_fn(|_| WindowSlot::new()) }
    }

    /// F3: this source's result came.
    pub fn result(
        &self,
        now: Instant,
        message_id: MessageId,
        source: Priority,
    ) -> (Option<Firing<CLOUDS>>, Outcome<CLOUDS>) {
        self.close(now, message_id, source, Cause::Result)
    }

    /// F4: no result will come from this source.
    pub fn fail(
        &self,
        now: Instant,
        message_id: MessageId,
        source: Priority,
    ) -> (Option<Firing<CLOUDS>>, Outcome<CLOUDS>) {
        self.close(now, message_id, source, Cause::Failure)
    }

    /// F5: time went by. None if no timer of this message was due, as when it is no longer open.
    #[must_use = "a firing may forward a result"]
    pub fn expire(&self, now: Instant, message_id: MessageId) -> Option<Firing<CLOUDS>> {
        let fired = self.exchange(message_id, |_, mut entry| {
            let fired = self.fire(now, message_id, &mut entry);
            (entry.slot(), fired)
        });
        fired.flatten()
    }

    /// The earliest due instant of this message's timers, if one is armed; another thread's call may change it at any time.
    #[must_use]
    pub fn next_due(&self, message_id: MessageId) -> Option<Instant> {
        self.exchange(message_id, |_, entry| (entry.slot(), entry.next_due())).flatten()
    }

    /// The source with this priority; 0 is local. None if no cloud is registered with it.
    #[must_use]
    pub fn source(&self, priority: Priority) -> Option<Source> {
        self.clouds.source(priority)
    }

    /// The priority of a source; 0 for one that is not registered.
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

    /// F5 for one timestamp: fires what is due by `now`, one due instant after the other.
    pub(crate) fn fire(
        &self,
        now: Instant,
        message_id: MessageId,
        entry: &mut Entry<CLOUDS>,
    ) -> Option<Firing<CLOUDS>> {
        let mut timers = Sources::EMPTY;
        let mut last = None;
        for _ in 0..Source::COUNT {
            // F5 due: the due instant itself is past (A1).
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

    /// Lets `decide` turn the message's entry into its next state and an answer, as one atomic step; none if the
    /// message is no longer open.
    ///
    /// Within a generation no state comes back, and the due instant of a requested source stays. So if the word is
    /// unchanged, so is all that `decide` saw.
    pub(crate) fn exchange<A>(
        &self,
        message_id: MessageId,
        mut decide: impl FnMut(&WindowSlot<CLOUDS>, Entry<CLOUDS>) -> (Slot, A),
    ) -> Option<A> {
        let window_slot = self.slots.get(message_id.place())?;
        for _ in 0..Self::CHANGES {
            // Acquire: the due instants of the sources requested in it, and what was done before results were held.
            let packed =
                PackedSlot::<CLOUDS>::from_bits(window_slot.packed.load(Ordering::Acquire));
            if packed.generation() != message_id.generation {
                return None;
            }
            let (slot, answer) = decide(window_slot, window_slot.entry(packed.slot(self.commit)));
            let next = packed.stepped(slot);
            // Even if nothing changes: the slot may be in use again, with the due instants of another message.
            // Release: what the caller did before, to whoever forwards or opens next. The word of a failed exchange is
            // not used, so its load may be relaxed; the next load sees no older one.
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
        // F8 bounded: that was the last change.
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

    /// For a source that is not yet requested: the word that requests it publishes this, hence relaxed.
    pub(crate) fn set_due(&self, source: Source, due: Instant) {
        if let Some(cell) = self.due(source) {
            cell.store(due.as_nanos(), Ordering::Relaxed);
        }
    }

    /// The state with the due instants of its armed timers. They were published along with it, hence relaxed.
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
