//! [`ValueOwner`]: an [`Owner`] that also stores the results' values, for the thread that forwards one.

use std::fmt;
use std::sync::Arc;
use std::vec::Vec;

use fuseline_core::{
    Admission, Deadline, Firing, Instant, OfferRefusal, OpenRefusal, Priority, Source, Timestamp,
};

use crate::call::{Call, Message};
use crate::cells::SourceCells;
use crate::handle::SharedHandle;
use crate::owner::Owner;
use crate::shared::Shared;

/// Opens messages and offers requests like [`Owner`], and stores the results' values of type `T`.
///
/// Threads that outlive the function that made the machine need a `'static` machine, as from
/// `Box::leak`.
pub struct ValueOwner<'a, T, const CLOUDS: usize, const WINDOW: usize> {
    owner: Owner<'a, CLOUDS, WINDOW>,
    handle: &'a SharedHandle<CLOUDS, WINDOW>,
    /// The cells of each slot's last message.
    cells: Vec<Arc<SourceCells<T, CLOUDS>>>,
}

impl<'a, T, const CLOUDS: usize, const WINDOW: usize> ValueOwner<'a, T, CLOUDS, WINDOW> {
    /// Creates the owner of this machine, with no value stored.
    pub fn new(shared: &'a mut Shared<CLOUDS, WINDOW>) -> Self {
        let (owner, handle) = shared.split();
        let cells = std::iter::repeat_with(|| Arc::new(SourceCells::new())).take(WINDOW).collect();
        Self { owner, handle, cells }
    }

    /// Opens a message with this timestamp (F1). Returns the message and the call for local.
    ///
    /// `deadline` is how long local may take, or `None` for no bound.
    ///
    /// # Errors
    /// Returns the first [`OpenRefusal`] that holds.
    pub fn open(
        &mut self,
        now: Instant,
        timestamp: Timestamp,
        deadline: Option<Deadline>,
    ) -> Result<(Message<'a, T, CLOUDS, WINDOW>, Call<'a, T, CLOUDS, WINDOW>), OpenRefusal> {
        let message_id = self.owner.open(now, timestamp, deadline)?;
        let cells = &mut self.cells[message_id.place()];
        match Arc::get_mut(cells) {
            Some(cells) => cells.clear(),
            // A call of the slot's last message is still under way and may still fill its cell.
            None => *cells = Arc::new(SourceCells::new()),
        }
        let message = Message { handle: self.handle, id: message_id, cells: Arc::clone(cells) };
        let call = Call { message: message.clone(), source: Source::LOCAL };
        Ok((message, call))
    }

    /// Asks whether the message may be sent to this cloud (F2). Returns the timers that fired
    /// first, as [`Message::expire`] does, then the call and its due instant.
    ///
    /// `deadline` is how long the cloud may take. `backlog` is the length of the cloud's outgoing
    /// queue without this message.
    ///
    /// # Errors
    /// The inner result has the first [`OfferRefusal`] that holds.
    #[expect(clippy::type_complexity, reason = "each part is another type's answer")]
    pub fn offer(
        &mut self,
        now: Instant,
        message: &Message<'a, T, CLOUDS, WINDOW>,
        cloud: Priority,
        deadline: Deadline,
        backlog: u64,
    ) -> (
        Option<(Firing<CLOUDS>, Option<T>)>,
        Result<(Call<'a, T, CLOUDS, WINDOW>, Instant), OfferRefusal>,
    ) {
        let (fired, admission) = self.owner.offer(now, message.id, cloud, deadline, backlog);
        let fired = fired.map(|firing| (firing, message.forwarded(&firing.outcome)));
        let call = match admission {
            Admission::Admitted { due } => match self.handle.source(cloud) {
                Some(source) => Ok((Call { message: message.clone(), source }, due)),
                None => Err(OfferRefusal::Unknown),
            },
            Admission::Refused(why) => Err(why),
        };
        (fired, call)
    }
}

impl<T, const CLOUDS: usize, const WINDOW: usize> fmt::Debug for ValueOwner<'_, T, CLOUDS, WINDOW> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ValueOwner").field(&self.owner).finish()
    }
}
