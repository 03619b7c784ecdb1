//! [`Owner`]: opens messages and offers requests, from one thread at a time. It alone has the gates.

use core::sync::atomic::Ordering;

use fuseline_core::{
    Admission, Clouds, Deadline, Entry, Firing, Instant, OfferRefusal, OpenRefusal, Priority,
    Source, Timestamp,
};

use crate::handle::{SharedHandle, WindowSlot};
use crate::message_id::MessageId;
use crate::packed::PackedSlot;

/// Where the one owner opens timestamps and offers requests, while other threads use the [`SharedHandle`].
///
/// There is one at a time and it cannot be cloned: two might both write one request's due instant.
#[derive(Debug)]
pub struct Owner<'a, const CLOUDS: usize, const WINDOW: usize> {
    handle: &'a SharedHandle<CLOUDS, WINDOW>,
    state: &'a mut OwnerState<CLOUDS>,
}

/// What only the owner needs.
#[derive(Debug)]
pub(crate) struct OwnerState<const CLOUDS: usize> {
    /// For their gates; the gates of the handle's copy are not used.
    clouds: Clouds<CLOUDS>,
    newest: Option<Timestamp>,
    /// The slot that was opened last.
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

    /// F1: a message with this timestamp came. `deadline`, if any, is how long the local computation may take.
    ///
    /// Looks at each slot at most once; at a single one where messages are retired in the order in which they came.
    ///
    /// # Errors
    /// The first [`OpenRefusal`] that holds. `Full` may no longer hold at the return.
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
        // No exchange: nobody else writes a free slot. Relaxed: others get the message id after this.
        window_slot.packed.store(packed.bits(), Ordering::Relaxed);
        self.state.newest = Some(timestamp);
        self.state.last = index;
        Ok(MessageId { timestamp, generation: packed.generation(), index })
    }

    /// F2: may the message be sent to this cloud? `deadline` is how long the cloud may take, `backlog` the length of
    /// the cloud's outgoing queue without this message. Returns first which timers were due, as the handle does.
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
        // F2 unknown: local has no gate (A19).
        let gated = source.and_then(|source| Some((source, self.state.clouds.gate_mut(source)?)));
        let Some((source, gate)) = gated else {
            return (handle.expire(now, message_id), Admission::Refused(OfferRefusal::Unknown));
        };
        let answer = handle.exchange(message_id, |window_slot, mut entry| {
            let fired = handle.fire(now, message_id, &mut entry);
            // F2g: each attempt starts from the gate as it was, so that an offer moves it at most once.
            let mut after = *gate;
            let (slot, admission) = entry.slot().admit(source, &mut after, now, deadline, backlog);
            if let Admission::Admitted { due } = admission {
                // Before the exchange that makes it count. Nobody reads it yet, and only the owner makes requests.
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

    /// The first free slot after the one opened last, with its word.
    fn free_slot(&self) -> Option<(usize, &'a WindowSlot<CLOUDS>, PackedSlot<CLOUDS>)> {
        let slots = self.handle.slots.iter().take(self.handle.window).enumerate();
        let from = self.state.last.wrapping_add(1);
        let free = |(index, window_slot): (usize, &'a WindowSlot<CLOUDS>)| {
            // An exchange that changes nothing: a load might not see a retirement that is long past.
            // Acquire: what was done before it, including reads of the due instants that are now overwritten.
            let packed = PackedSlot::from_bits(window_slot.packed.fetch_or(0, Ordering::Acquire));
            (!packed.is_open()).then_some((index, window_slot, packed))
        };
        slots.clone().skip(from).chain(slots.take(from)).find_map(free)
    }
}
