//! The machine: bookkeeping of window, due instants and gates around the step of one timestamp.

use crate::answer::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};
use crate::clouds::{Cloud, Clouds, ConfigError};
use crate::entry::Entry;
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::{Cause, Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::window::{OpenIndex, Window};

/// One operator's machine, for up to `CLOUDS` (0 to 15) clouds and `WINDOW` (1 to 1024) open timestamps.
///
/// Two machines are equal if they answer all inputs alike.
///
/// - constructor: [`new`](Self::new)
/// - inputs: [`ready`](Self::ready) or [`at`](Self::at), then one method of [`Ready`]
/// - questions: [`next_due`](Self::next_due), [`now`](Self::now), [`newest`](Self::newest),
///   [`len`](Self::len), [`slot`](Self::slot), [`due`](Self::due), [`offer_refusal`](Self::offer_refusal),
///   [`open`](Self::open), [`gate`](Self::gate), [`source`](Self::source), [`priority`](Self::priority), [`clouds`](Self::clouds),
///   [`window`](Self::window), [`commit`](Self::commit)
#[derive(Clone)]
pub struct Fusion<const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) commit: Commit,
    pub(crate) window: usize,
    pub(crate) clouds: Clouds<CLOUDS>,
    pub(crate) now: Instant,
    pub(crate) newest: Option<Timestamp>,
    pub(crate) open: Window<CLOUDS, WINDOW>,
}

/// The machine at an instant (F0): either a firing comes first, or it takes inputs.
#[derive(Debug)]
#[must_use = "a firing may forward a result; without `Ready` there is no input"]
pub enum At<'a, const CLOUDS: usize, const WINDOW: usize> {
    /// These timers fired (F5). Act on it and call [`Fusion::at`] again.
    Fired(Firing<CLOUDS>),
    /// Nothing is due.
    Ready(Ready<'a, CLOUDS, WINDOW>),
}

/// The machine at an instant when nothing is due: the only way to give it an input.
///
/// It takes any number of inputs of this instant: whatever they arm is due later.
pub struct Ready<'a, const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) fusion: &'a mut Fusion<CLOUDS, WINDOW>,
}

impl<const CLOUDS: usize, const WINDOW: usize> Fusion<CLOUDS, WINDOW> {
    /// A machine with nothing open, its clock at [`Instant::START`] and its gates open.
    ///
    /// `window`, 1 to `WINDOW`, bounds how many timestamps are open at once. The order of `clouds` does not matter
    /// (P10). Capacities beyond 15 clouds or 1024 timestamps do not compile. The machine's size follows from its
    /// capacities, from about 100 bytes a timestamp: box large ones where stacks are small.
    ///
    /// # Errors
    /// The first [`ConfigError`] that holds.
    pub fn new(window: usize, commit: Commit, clouds: &[Cloud]) -> Result<Self, ConfigError> {
        Ok(Self {
            commit,
            window: ConfigError::check_window::<WINDOW>(window)?,
            clouds: Clouds::new(clouds)?,
            now: Instant::START,
            newest: None,
            open: Window::new(),
        })
    }

    /// F0: moves the clock to `now`, never back, and fires the earliest timers due by then, if any.
    ///
    /// Call it until it is [`At::Ready`], at most once for each armed timer and once more.
    /// A tick is such a call with no input after it.
    #[inline]
    pub fn at(&mut self, now: Instant) -> At<'_, CLOUDS, WINDOW> {
        match self.first_due(now) {
            Some((index, due)) => At::Fired(self.fire(index, due)),
            None => At::Ready(Ready { fusion: self }),
        }
    }

    /// F0: moves the clock to `now`, never back, gives each firing due by then to `fired`, in order, and is then ready
    /// for inputs.
    ///
    /// The same as calling [`at`](Self::at) until it is [`At::Ready`]. There are at most as many firings as armed timers.
    pub fn ready(
        &mut self,
        now: Instant,
        mut fired: impl FnMut(Firing<CLOUDS>),
    ) -> Ready<'_, CLOUDS, WINDOW> {
        while let Some((index, due)) = self.first_due(now) {
            fired(self.fire(index, due));
        }
        Ready { fusion: self }
    }

    /// The earliest instant at which a timer is due; none if no timer is armed. Tick then. Constant time.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.open.next_due()
    }

    /// The machine's clock: the greatest instant given so far.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// The greatest timestamp ever opened.
    #[must_use]
    pub const fn newest(&self) -> Option<Timestamp> {
        self.newest
    }

    /// How many timestamps are open; at most [`Self::window`].
    #[must_use]
    pub const fn len(&self) -> usize {
        self.open.len()
    }

    /// Whether no timestamp is open.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.open.len() == 0
    }

    /// The sets of an open timestamp; none if it is not open.
    #[must_use]
    pub fn slot(&self, timestamp: Timestamp) -> Option<Slot> {
        Some(self.open.entry(self.open.find(timestamp)?).slot)
    }

    /// When the timer of `(timestamp, priority)` is due, if it is armed.
    #[must_use]
    pub fn due(&self, timestamp: Timestamp, priority: Priority) -> Option<Instant> {
        let source = self.clouds.source(priority)?;
        let entry = self.open.entry(self.open.find(timestamp)?);
        entry.slot.armed().contains(source).then(|| entry.due(source))
    }

    /// F2: why an offer would be refused as things stand, or none if it would be admitted. Nothing changes, also not
    /// the gate.
    ///
    /// Timers that are due by an instant later than [`now`](Self::now) have not fired yet. For callers whose preparation
    /// of a request is costly, or counts: a policy decides about what will be admitted alone (T6).
    #[must_use]
    pub fn offer_refusal(
        &self,
        timestamp: Timestamp,
        cloud: Priority,
        deadline: Deadline,
        backlog: u64,
    ) -> Option<OfferRefusal> {
        let source = self.clouds.source(cloud).filter(|_| self.was_reached(timestamp));
        let gated = source.and_then(|source| Some((source, *self.clouds.gate(source)?)));
        let Some((source, mut gate)) = gated else {
            return Some(OfferRefusal::Unknown);
        };
        let Some(index) = self.open.find(timestamp) else {
            return Some(OfferRefusal::Closed);
        };
        let slot = self.open.entry(index).slot;
        match slot.admit(source, &mut gate, self.now, deadline, backlog).1 {
            Admission::Refused(why) => Some(why),
            Admission::Admitted { .. } => None,
        }
    }

    /// The open timestamps and their sets, in ascending order.
    pub fn open(&self) -> impl Iterator<Item = (Timestamp, Slot)> {
        self.open.iter().map(|(timestamp, entry)| (timestamp, entry.slot))
    }

    /// A cloud's gate; none if the cloud is not registered.
    #[must_use]
    pub fn gate(&self, cloud: Priority) -> Option<Gate> {
        self.clouds.gate(self.clouds.source(cloud)?).copied()
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

    /// The sources of all registered clouds.
    #[must_use]
    pub fn clouds(&self) -> Sources {
        self.clouds.all()
    }

    /// How many timestamps may be open at once.
    #[must_use]
    pub const fn window(&self) -> usize {
        self.window
    }

    /// The commit rule.
    #[must_use]
    pub const fn commit(&self) -> Commit {
        self.commit
    }

    /// F0: moves the clock. The first timestamp with a timer that is due by then, and when it is.
    #[inline]
    fn first_due(&mut self, now: Instant) -> Option<(OpenIndex, Instant)> {
        self.now = self.now.max(now);
        // F5 due: the due instant itself is past (A1).
        let due = self.open.next_due().filter(|due| *due <= self.now)?;
        Some((self.open.first_due()?, due))
    }

    /// F5 for one timestamp at one due instant.
    pub(crate) fn fire(&mut self, index: OpenIndex, due: Instant) -> Firing<CLOUDS> {
        let timestamp = self.open.timestamp(index);
        let timers = self.open.entry(index).armed_at(due);
        // F5: else it would fire for ever.
        debug_assert!(!timers.is_empty(), "what fires is armed");
        let outcome = self.close(index, Cause::Timers(timers));
        Firing { timestamp, due, timers: self.clouds.priorities(timers), outcome }
    }

    /// Steps an open timestamp, and retires it if the step does.
    pub(crate) fn close(&mut self, index: OpenIndex, cause: Cause) -> Outcome<CLOUDS> {
        let (slot, decision) = self.open.entry(index).slot.step(self.commit, cause);
        let outcome = self.clouds.outcome(decision);
        if slot.is_open() {
            self.open.set(index, slot);
        } else {
            self.open.remove(index);
        }
        outcome
    }

    /// Whether this timestamp or a later one was ever opened.
    fn was_reached(&self, timestamp: Timestamp) -> bool {
        self.newest.is_some_and(|newest| timestamp <= newest)
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> Ready<'_, CLOUDS, WINDOW> {
    /// F1: a message with this timestamp came. `deadline`, if any, is how long the local computation may take.
    pub fn open(&mut self, timestamp: Timestamp, deadline: Option<Deadline>) -> Opening {
        let fusion = &mut *self.fusion;
        if fusion.was_reached(timestamp) {
            return Opening::Refused(OpenRefusal::Order);
        }
        if fusion.open.len() >= fusion.window {
            return Opening::Refused(OpenRefusal::Full);
        }
        let entry = match Entry::open(fusion.now, deadline) {
            Ok(entry) => entry,
            Err(why) => return Opening::Refused(why),
        };
        let had_room = fusion.open.push(timestamp, entry);
        debug_assert!(had_room, "the window is no greater than its capacity");
        fusion.newest = Some(timestamp);
        Opening::Accepted
    }

    /// F2: may the message be sent to this cloud? `deadline` is how long the cloud may take, `backlog` the length of
    /// the cloud's outgoing queue without this message.
    pub fn offer(
        &mut self,
        timestamp: Timestamp,
        cloud: Priority,
        deadline: Deadline,
        backlog: u64,
    ) -> Admission {
        let fusion = &mut *self.fusion;
        let source = fusion.clouds.source(cloud).filter(|_| fusion.was_reached(timestamp));
        // F2 unknown: local has no gate (A19).
        let gated = source.and_then(|source| Some((source, fusion.clouds.gate_mut(source)?)));
        let Some((source, gate)) = gated else {
            return Admission::Refused(OfferRefusal::Unknown);
        };
        let Some(index) = fusion.open.find(timestamp) else {
            return Admission::Refused(OfferRefusal::Closed);
        };
        let slot = fusion.open.entry(index).slot;
        let (slot, admission) = slot.admit(source, gate, fusion.now, deadline, backlog);
        if let Admission::Admitted { due } = admission {
            fusion.open.arm(index, slot, source, due);
        }
        admission
    }

    /// F3: this source's result came. It is forwarded, held or dropped, never anything else.
    pub fn result(&mut self, timestamp: Timestamp, source: Priority) -> Outcome<CLOUDS> {
        self.close(timestamp, source, Cause::Result)
    }

    /// F4: no result will come from this source: the call failed, or the local computation produced nothing.
    pub fn fail(&mut self, timestamp: Timestamp, source: Priority) -> Outcome<CLOUDS> {
        self.close(timestamp, source, Cause::Failure)
    }

    /// The machine's clock: the instant of the decisions made here.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.fusion.now
    }

    fn close(
        &mut self,
        timestamp: Timestamp,
        priority: Priority,
        cause: impl FnOnce(Source) -> Cause,
    ) -> Outcome<CLOUDS> {
        let source = self.fusion.clouds.source(priority);
        let Some(source) = source.filter(|_| self.fusion.was_reached(timestamp)) else {
            return Outcome::Dropped(DropReason::Unknown);
        };
        match self.fusion.open.find(timestamp) {
            Some(index) => self.fusion.close(index, cause(source)),
            // F3 superseded: retired or skipped, also when it is late as well (A16).
            None => Outcome::Dropped(DropReason::Superseded),
        }
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> PartialEq for Fusion<CLOUDS, WINDOW> {
    fn eq(&self, other: &Self) -> bool {
        self.commit == other.commit
            && self.window == other.window
            && self.clouds == other.clouds
            && self.now == other.now
            && self.newest == other.newest
            && self.open.iter().map(canonical).eq(other.open.iter().map(canonical))
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> Eq for Fusion<CLOUDS, WINDOW> {}

impl<const CLOUDS: usize, const WINDOW: usize> core::hash::Hash for Fusion<CLOUDS, WINDOW> {
    fn hash<H: core::hash::Hasher>(&self, state: &mut H) {
        (self.commit, self.window, &self.clouds, self.now, self.newest).hash(state);
        self.len().hash(state);
        for entry in self.open.iter() {
            canonical(entry).hash(state);
        }
    }
}

/// An entry without the due instants of timers that are not armed.
fn canonical<const CLOUDS: usize>(
    (timestamp, entry): (Timestamp, &Entry<CLOUDS>),
) -> (Timestamp, Slot, [Option<Instant>; Source::COUNT as usize]) {
    let mut dues = [None; Source::COUNT as usize];
    for source in entry.slot.armed().iter() {
        if let Some(due) = dues.get_mut(usize::from(source.index())) {
            *due = Some(entry.due(source));
        }
    }
    (timestamp, entry.slot, dues)
}

impl<const CLOUDS: usize, const WINDOW: usize> core::fmt::Debug for Fusion<CLOUDS, WINDOW> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Fusion")
            .field("commit", &self.commit)
            .field("window", &self.window)
            .field("now", &self.now)
            .field("newest", &self.newest)
            .field("next_due", &self.next_due())
            .field("open", &OpenTimestamps(self))
            .finish_non_exhaustive()
    }
}

struct OpenTimestamps<'a, const CLOUDS: usize, const WINDOW: usize>(&'a Fusion<CLOUDS, WINDOW>);

impl<const CLOUDS: usize, const WINDOW: usize> core::fmt::Debug
    for OpenTimestamps<'_, CLOUDS, WINDOW>
{
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_map().entries(self.0.open()).finish()
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> core::fmt::Debug for Ready<'_, CLOUDS, WINDOW> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Ready").field(self.fusion).finish()
    }
}

#[cfg(test)]
mod tests;
