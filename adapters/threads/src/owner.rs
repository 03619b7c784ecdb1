//! [`Owner`]: opens messages and offers requests, from one thread at a time. Only the owner has the gates.

use core::sync::atomic::Ordering;

use fuseline_core::{
    Admission, Clouds, Deadline, Entry, Firing, Instant, OfferRefusal, OpenRefusal, Priority,
    Source, Timestamp,
};

use crate::handle::{SharedHandle, WindowSlot};
use crate::message_id::MessageId;
use crate::packed::PackedSlot;

/// Opens timestamps and offers requests, while other threads use the [`SharedHandle`].
///
/// There is one owner at a time, and it cannot be cloned: two owners might write the same request's
/// due instant.
#[derive(Debug)]
pub struct Owner<'a, const CLOUDS: usize, const WINDOW: usize> {
    handle: &'a SharedHandle<CLOUDS, WINDOW>,
    state: &'a mut OwnerState<CLOUDS>,
}

/// The state that only the owner needs.
#[derive(Debug)]
pub(crate) struct OwnerState<const CLOUDS: usize> {
    /// The owner uses the gates of this copy. The handle's copy has gates too, but they are unused.
    clouds: Clouds<CLOUDS>,
    newest: Option<Timestamp>,
    /// The index of the slot that was opened last.
    last: usize,
}

impl<const CLOUDS: usize> OwnerState<CLOUDS> {
    pub(crate) const fn new(clouds: Clouds<CLOUDS>) -> Self {
        Self { clouds, newest: None, last: 0 }
    }
}

impl<'a, const CLOUDS: usize, const WINDOW: usize> Owner<'a, CLOUDS, WINDOW> {
    pub(crate) const fn new(
        handle: &'a SharedHandle<CLOUDS, WINDOW>,
        state: &'a mut OwnerState<CLOUDS>,
    ) -> Self {
        Self { handle, state }
    }

    /// Opens a message with this timestamp (F1).
    ///
    /// `deadline` is how long local may take, or `None` for no bound. The call looks at each slot
    /// at most once. It looks at only one slot if there is room, and messages are retired in the
    /// order in which they were opened.
    ///
    /// # Errors
    /// Returns the first [`OpenRefusal`] that holds. Another thread may retire a message meanwhile,
    /// so `Full` may no longer hold when the call returns.
    pub fn open(
        &mut self,
        now: Instant,
        timestamp: Timestamp,
        deadline: Option<Deadline>,
    ) -> Result<MessageId, OpenRefusal> {
        if self.state.newest.is_some_and(|newest| timestamp <= newest) {
            return Err(OpenRefusal::Order);
        }
        let Some((index, window_slot, packed)) = self.free_slot() else {
            return Err(OpenRefusal::Full);
        };
        let entry = Entry::<CLOUDS>::open(now, deadline)?;
        if deadline.is_some() {
            window_slot.set_due(Source::LOCAL, entry.due(Source::LOCAL));
        }
        let packed = packed.opened(entry.slot());
        // Nobody else writes a free slot, so a store suffices. It is relaxed because other threads
        // get the message id only after it.
        window_slot.packed.store(packed.bits(), Ordering::Relaxed);
        self.state.newest = Some(timestamp);
        self.state.last = index;
        Ok(MessageId { timestamp, generation: packed.generation(), index })
    }

    /// Asks whether the message may be sent to this cloud (F2). Returns the timers that fired
    /// first, as [`SharedHandle::expire`] does, and the admission.
    ///
    /// `deadline` is how long the cloud may take. `backlog` is the length of the cloud's outgoing
    /// queue without this message.
    pub fn offer(
        &mut self,
        now: Instant,
        message_id: MessageId,
        cloud: Priority,
        deadline: Deadline,
        backlog: u64,
    ) -> (Option<Firing<CLOUDS>>, Admission) {
        let handle = self.handle;
        let source = handle.clouds.source(cloud);
        // Local has no gate, so an offer to it is unknown (F2, A19).
        let gated = source.and_then(|source| Some((source, self.state.clouds.gate_mut(source)?)));
        let Some((source, gate)) = gated else {
            return (handle.expire(now, message_id), Admission::Refused(OfferRefusal::Unknown));
        };
        let answer = handle.exchange(message_id, |window_slot, mut entry| {
            let fired = handle.fire(now, message_id, &mut entry);
            // Each attempt starts from the unchanged gate, so an offer moves the gate at most once
            // (F2g).
            let mut after = *gate;
            let (slot, admission) = entry.slot().admit(source, &mut after, now, deadline, backlog);
            if let Admission::Admitted { due } = admission {
                // The exchange publishes the due instant, which only the owner writes.
                window_slot.set_due(source, due);
            }
            (slot, (fired, admission, after))
        });
        let Some((fired, admission, after)) = answer else {
            return (None, Admission::Refused(OfferRefusal::Closed));
        };
        *gate = after;
        (fired, admission)
    }

    /// Returns the first free slot after the slot that was opened last, with its index and word.
    fn free_slot(&self) -> Option<(usize, &'a WindowSlot<CLOUDS>, PackedSlot<CLOUDS>)> {
        let slots = self.handle.slots.iter().take(self.handle.window).enumerate();
        let from = self.state.last.wrapping_add(1);
        let free = |(index, window_slot): (usize, &'a WindowSlot<CLOUDS>)| {
            // A plain load might miss an old retirement, so this is an exchange that changes
            // nothing. Acquire orders it after everything that was done before the retirement,
            // including reads of the due instants that are overwritten next.
            let packed = PackedSlot::from_bits(window_slot.packed.fetch_or(0, Ordering::Acquire));
            (!packed.is_open()).then_some((index, window_slot, packed))
        };
        slots.clone().skip(from).chain(slots.take(from)).find_map(free)
    }
}
