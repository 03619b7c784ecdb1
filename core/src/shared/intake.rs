//! The owner's half: opens and offers.

use core::sync::atomic::Ordering;

use super::desk::{Desk, Place};
use super::machine::Ticket;
use super::word::Word;
use crate::answer::{Admission, Firing, OfferRefusal, OpenRefusal};
use crate::clouds::Clouds;
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::Slot;
use crate::source::Source;
use crate::time::{Deadline, Instant, Timestamp};

/// Where the one owner opens timestamps and offers requests, while other threads use the [`Desk`].
///
/// There is one at a time and it cannot be cloned: with two, both might write one request's due instant.
#[derive(Debug)]
pub struct Intake<'a, const CLOUDS: usize, const WINDOW: usize> {
    desk: &'a Desk<CLOUDS, WINDOW>,
    owner: &'a mut Owner<CLOUDS>,
}

/// What nobody else needs.
#[derive(Debug)]
pub(super) struct Owner<const CLOUDS: usize> {
    gates: [Gate; CLOUDS],
    newest: Option<Timestamp>,
    /// The place that was opened last.
    last: usize,
}

impl<const CLOUDS: usize> Owner<CLOUDS> {
    pub(super) const fn new(clouds: &Clouds<CLOUDS>) -> Self {
        Self { gates: clouds.gates, newest: None, last: 0 }
    }
}

impl<'a, const CLOUDS: usize, const WINDOW: usize> Intake<'a, CLOUDS, WINDOW> {
    pub(super) const fn new(desk: &'a Desk<CLOUDS, WINDOW>, owner: &'a mut Owner<CLOUDS>) -> Self {
        Self { desk, owner }
    }

    /// F1: a message with this timestamp came. `deadline`, if any, is how long the local computation may take.
    ///
    /// Looks at no place twice, and only once where messages leave in the order in which they came.
    ///
    /// # Errors
    /// The first [`OpenRefusal`] that holds. `Full` held when the call began.
    pub fn open(
        &mut self,
        now: Instant,
        timestamp: Timestamp,
        deadline: Option<Deadline>,
    ) -> Result<Ticket, OpenRefusal> {
        if self.owner.newest.is_some_and(|newest| timestamp <= newest) {
            return Err(OpenRefusal::Order);
        }
        let Some((index, place, word)) = self.free_place() else {
            return Err(OpenRefusal::Full);
        };
        if let Some(deadline) = deadline {
            let due = now.saturating_add(deadline);
            if due <= now {
                return Err(OpenRefusal::Deadline);
            }
            place.set_due(Source::LOCAL, due);
        }
        let word = word.opened(Slot::open(deadline.is_some()));
        // No exchange: nobody else writes a free place. Relaxed: who has the ticket got it after this.
        place.word.store(word.bits(), Ordering::Relaxed);
        self.owner.newest = Some(timestamp);
        self.owner.last = index;
        Ok(Ticket { timestamp, generation: word.generation(), place: index })
    }

    /// F2: may the message be sent to this cloud? `deadline` is how long the cloud may take, `backlog` the length of
    /// the cloud's outgoing queue without this message. Answers first which timers were due, as the desk does.
    pub fn offer(
        &mut self,
        now: Instant,
        ticket: Ticket,
        cloud: Priority,
        deadline: Deadline,
        backlog: u64,
    ) -> (Option<Firing<CLOUDS>>, Admission) {
        let desk = self.desk;
        let source = desk.clouds.source(cloud);
        let Some((source, gate)) = source.and_then(|source| Some((source, self.gate(source)?)))
        else {
            return (desk.expire(now, ticket), Admission::Refused(OfferRefusal::Unknown));
        };
        let due = now.saturating_add(deadline);
        let answer = desk.exchange(ticket, |place, mut entry| {
            let fired = desk.fire(now, ticket, &mut entry);
            let (admitted, refusal) = entry.slot.offer(source);
            // F2g: each look asks the gate as it was, so that an offer moves it once at most.
            let mut asked = *gate;
            let refusal = refusal
                .or((due <= now).then_some(OfferRefusal::Deadline))
                .or_else(|| (!asked.admits(backlog)).then_some(OfferRefusal::Queue));
            if let Some(reason) = refusal {
                return (entry.slot, (fired, Admission::Refused(reason), asked));
            }
            // Before the exchange that makes it count. Nobody reads it yet, and only the owner makes requests.
            place.set_due(source, due);
            (admitted, (fired, Admission::Admitted { due }, asked))
        });
        let Some((fired, admission, asked)) = answer else {
            return (None, Admission::Refused(OfferRefusal::Closed));
        };
        *gate = asked;
        (fired, admission)
    }

    /// A place where nothing is open, from the one after the last that was opened, with its word.
    fn free_place(&self) -> Option<(usize, &'a Place<CLOUDS>, Word<CLOUDS>)> {
        let places = self.desk.places.iter().take(self.desk.window).enumerate();
        let from = self.owner.last.wrapping_add(1);
        let free = |(index, place): (usize, &'a Place<CLOUDS>)| {
            // An exchange that changes nothing: a load might not hear of a retirement that is long past.
            // Acquire: what was done before it, the reads of the due instants that are now written anew among it.
            let word = Word::from_bits(place.word.fetch_or(0, Ordering::Acquire));
            (!word.is_open()).then_some((index, place, word))
        };
        places.clone().skip(from).chain(places.take(from)).find_map(free)
    }

    /// The gate of a cloud; none for local.
    fn gate(&mut self, source: Source) -> Option<&mut Gate> {
        self.owner.gates.get_mut(usize::from(source.index()).checked_sub(1)?)
    }
}
