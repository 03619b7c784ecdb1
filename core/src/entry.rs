//! The state of one open timestamp: its sets and the due instants of its timers.

use crate::answer::OpenRefusal;
use crate::slot::Slot;
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant};

/// An open timestamp's [`Slot`], and when each of its armed timers is due; for up to `CLOUDS` clouds.
///
/// [`Fusion`](crate::Fusion) keeps one for each open timestamp. It is public for machines that keep theirs another way.
#[derive(Clone, Copy)]
pub struct Entry<const CLOUDS: usize> {
    pub(crate) slot: Slot,
    pub(crate) local_due: Instant,
    pub(crate) dues: [Instant; CLOUDS],
}

impl<const CLOUDS: usize> Entry<CLOUDS> {
    pub(crate) const EMPTY: Self = Self::new(Slot::RETIRED);

    /// The entry of a timestamp with these sets. Every due instant is [`Instant::START`]: set those of its armed timers.
    #[must_use]
    pub const fn new(slot: Slot) -> Self {
        Self { slot, local_due: Instant::START, dues: [Instant::START; CLOUDS] }
    }

    /// F1 for one timestamp: the entry of one that is opened at `now`. `deadline`, if any, is local's.
    ///
    /// # Errors
    /// [`OpenRefusal::Deadline`] if its due instant is not after now.
    pub fn open(now: Instant, deadline: Option<Deadline>) -> Result<Self, OpenRefusal> {
        let mut entry = Self::EMPTY;
        entry.slot = Slot::open(deadline.is_some());
        if let Some(deadline) = deadline {
            entry.local_due = now.due(deadline).ok_or(OpenRefusal::Deadline)?;
        }
        Ok(entry)
    }

    /// The timestamp's sets.
    #[must_use]
    pub const fn slot(&self) -> Slot {
        self.slot
    }

    /// Replaces the sets; the due instants stay.
    pub const fn set_slot(&mut self, slot: Slot) {
        self.slot = slot;
    }

    /// The due instant of this source's timer; meaningless unless the timer is armed.
    #[must_use]
    pub fn due(&self, source: Source) -> Instant {
        match usize::from(source.index()).checked_sub(1) {
            None => self.local_due,
            Some(cloud) => self.dues.get(cloud).copied().unwrap_or(Instant::END),
        }
    }

    /// Sets when this source's timer is due; does nothing for a source beyond `CLOUDS`.
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

    // Both below look at every timer, armed or not: without branches that is less than to look for the armed ones.

    /// The armed timers that are due exactly at `due`: they fire together (F5).
    #[must_use]
    pub fn armed_at(&self, due: Instant) -> Sources {
        let mut due_then = u16::from(self.local_due == due);
        for (own, number) in self.dues.iter().zip(1..) {
            due_then |= u16::from(*own == due).wrapping_shl(number);
        }
        self.slot.armed().intersection(Sources::from_bits(due_then))
    }

    /// The earliest due instant of the armed timers, if there is one.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        let armed = self.slot.armed();
        // What is not armed is due at the end of time.
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
