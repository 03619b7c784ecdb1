//! The state of one open timestamp: its sets and the due instants of its timers.

use crate::answer::OpenRefusal;
use crate::slot::Slot;
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant};

/// Stores the [`Slot`] of an open timestamp and the due instants of its timers, for up to `CLOUDS`
/// clouds.
///
/// [`Fusion`](crate::Fusion) keeps one for each open timestamp. Use it directly only to build a
/// machine that stores open timestamps in another way.
#[derive(Clone, Copy)]
pub struct Entry<const CLOUDS: usize> {
    pub(crate) slot: Slot,
    pub(crate) local_due: Instant,
    pub(crate) dues: [Instant; CLOUDS],
}

impl<const CLOUDS: usize> Entry<CLOUDS> {
    pub(crate) const EMPTY: Self = Self::new(Slot::RETIRED);

    /// Creates an entry with these sets. Every due instant is [`Instant::START`], so call
    /// [`set_due`](Self::set_due) for each armed timer.
    #[must_use]
    pub const fn new(slot: Slot) -> Self {
        Self { slot, local_due: Instant::START, dues: [Instant::START; CLOUDS] }
    }

    /// Creates the entry of a timestamp that is opened at `now`, with local's `deadline` if it has
    /// one (F1).
    ///
    /// # Errors
    /// Returns [`OpenRefusal::Deadline`] if local's due instant is not later than `now`.
    pub fn open(now: Instant, deadline: Option<Deadline>) -> Result<Self, OpenRefusal> {
        let mut entry = Self::EMPTY;
        entry.slot = Slot::open(deadline.is_some());
        if let Some(deadline) = deadline {
            entry.local_due = now.due(deadline).ok_or(OpenRefusal::Deadline)?;
        }
        Ok(entry)
    }

    /// Returns the timestamp's sets.
    #[must_use]
    pub const fn slot(&self) -> Slot {
        self.slot
    }

    /// Replaces the sets and keeps the due instants.
    pub const fn set_slot(&mut self, slot: Slot) {
        self.slot = slot;
    }

    /// Returns the due instant of this source's timer. The value is meaningful only while the timer
    /// is armed.
    #[must_use]
    pub fn due(&self, source: Source) -> Instant {
        match usize::from(source.index()).checked_sub(1) {
            None => self.local_due,
            Some(cloud) => self.dues.get(cloud).copied().unwrap_or(Instant::END),
        }
    }

    /// Sets the due instant of this source's timer. Does nothing for a source beyond `CLOUDS`.
    pub fn set_due(&mut self, source: Source, due: Instant) {
        match usize::from(source.index()).checked_sub(1) {
            None => self.local_due = due,
            Some(cloud) => {
                if let Some(own) = self.dues.get_mut(cloud) {
                    *own = due;
                }
            }
        }
    }

    // The next two methods look at every timer, armed or not: without branches that is faster than
    // finding the armed ones.

    /// Returns the armed timers whose due instant is exactly `due`. They fire together (F5).
    #[must_use]
    pub fn armed_at(&self, due: Instant) -> Sources {
        let mut due_then = u16::from(self.local_due == due);
        for (own, number) in self.dues.iter().zip(1..) {
            due_then |= u16::from(*own == due).wrapping_shl(number);
        }
        self.slot.armed().intersection(Sources::from_bits(due_then))
    }

    /// Returns the earliest due instant of the armed timers, or `None` if none is armed.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        let armed = self.slot.armed();
        // A timer that is not armed counts as due at the end of time.
        let if_armed = |number, due| match armed.bits().wrapping_shr(number) & 1 {
            0 => Instant::END,
            _ => due,
        };
        let mut first = if_armed(0, self.local_due);
        for (due, number) in self.dues.iter().zip(1..) {
            first = first.min(if_armed(number, *due));
        }
        (!armed.is_empty()).then_some(first)
    }
}

impl<const CLOUDS: usize> core::fmt::Debug for Entry<CLOUDS> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Entry").field("slot", &self.slot).finish_non_exhaustive()
    }
}
