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

    /// The armed timers that are due exactly at `due`: they fire together (F5).
    #[must_use]
    pub fn armed_at(&self, due: Instant) -> Sources {
        self.slot.armed().iter().filter(|source| self.due(*source) == due).collect()
    }

    /// The earliest due instant of the armed timers, if there is one.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.slot.armed().iter().map(|source| self.due(source)).min()
    }
}

impl<const CLOUDS: usize> core::fmt::Debug for Entry<CLOUDS> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Entry").field("slot", &self.slot).finish_non_exhaustive()
    }
}
