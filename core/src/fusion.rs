//! The machine: keeps the window, the due instants and the gates, and steps one timestamp at a
//! time.

use crate::answer::{Admission, DropReason, Firing, OfferRefusal, OpenRefusal, Opening, Outcome};
use crate::clouds::{Cloud, Clouds, ConfigError};
use crate::entry::Entry;
use crate::gate::Gate;
use crate::priority::Priority;
use crate::slot::{Cause, Commit, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::window::{OpenIndex, Window};

/// Decides for one operator, with up to `CLOUDS` (0 to 15) clouds and `WINDOW` (1 to 1024) open
/// timestamps. Two machines are equal if they give the same answers to all further inputs.
///
/// - constructor: [`new`](Self::new)
/// - inputs: [`ready`](Self::ready) or [`at`](Self::at), then one method of [`Ready`]
/// - queries: [`next_due`](Self::next_due), [`now`](Self::now), [`newest`](Self::newest),
///   [`open`](Self::open), [`slot`](Self::slot), [`due`](Self::due),
///   [`offer_refusal`](Self::offer_refusal), [`gate`](Self::gate)
#[derive(Clone)]
pub struct Fusion<const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) commit: Commit,
    pub(crate) window: usize,
    pub(crate) clouds: Clouds<CLOUDS>,
    pub(crate) now: Instant,
    pub(crate) newest: Option<Timestamp>,
    pub(crate) open: Window<CLOUDS, WINDOW>,
}

/// The machine at an instant: either timers fire first, or it accepts inputs (F0).
#[derive(Debug)]
#[must_use = "a firing may forward a result; without `Ready` there is no input"]
pub enum At<'a, const CLOUDS: usize, const WINDOW: usize> {
    /// These timers fired (F5). Act on the firing and call [`Fusion::at`] again.
    Fired(Firing<CLOUDS>),
    /// Nothing is due, so the machine accepts inputs.
    Ready(Ready<'a, CLOUDS, WINDOW>),
}

/// Accepts inputs at an instant when nothing is due. The machine takes inputs in no other way.
///
/// It accepts any number of inputs at this instant, because whatever they arm is due later.
pub struct Ready<'a, const CLOUDS: usize, const WINDOW: usize> {
    pub(crate) fusion: &'a mut Fusion<CLOUDS, WINDOW>,
}

impl<const CLOUDS: usize, const WINDOW: usize> Fusion<CLOUDS, WINDOW> {
    /// Creates a machine without open timestamps. Its clock is at [`Instant::START`], and its gates
    /// are open.
    ///
    /// `window`, from 1 to `WINDOW`, is the greatest number of timestamps that may be open at once.
    /// The order of `clouds` does not matter (P10). Capacities beyond 15 clouds or 1024 timestamps
    /// do not compile. A machine takes about 100 bytes or more for each timestamp of its capacity.
    /// If the stack is small, put a large machine in a `Box`.
    ///
    /// # Errors
    /// Returns the first [`ConfigError`] that holds.
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

    /// Advances the clock to `now` and fires the earliest timers that are due by then, if any (F0).
    ///
    /// An earlier `now` does not move the clock back. Call this method until it returns
    /// [`At::Ready`]: at most once for each armed timer, and once more. A call without an input
    /// after it is a tick.
    #[inline]
    pub fn at(&mut self, now: Instant) -> At<'_, CLOUDS, WINDOW> {
        match self.first_due(now) {
            Some((index, due)) => At::Fired(self.fire(index, due)),
            None => At::Ready(Ready { fusion: self }),
        }
    }

    /// Advances the clock to `now`, passes each firing that is due by then to `fired`, and accepts
    /// inputs (F0).
    ///
    /// An earlier `now` does not move the clock back. The firings come in order, at most one for
    /// each armed timer. The effect is the same as calling [`at`](Self::at) until it returns
    /// [`At::Ready`].
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

    /// Returns the earliest instant at which a timer is due, or `None` if no timer is armed. Call
    /// [`ready`](Self::ready) or [`at`](Self::at) at that instant.
    #[must_use]
    pub fn next_due(&self) -> Option<Instant> {
        self.open.next_due()
    }

    /// Returns the machine's clock: the greatest instant given so far.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Returns the greatest timestamp that was ever opened, or `None` before the first.
    #[must_use]
    pub const fn newest(&self) -> Option<Timestamp> {
        self.newest
    }

    /// Returns the number of open timestamps, at most [`Self::window`].
    #[must_use]
    pub const fn len(&self) -> usize {
        self.open.len()
    }

    /// Returns `true` if no timestamp is open.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.open.len() == 0
    }

    /// Returns the sets of an open timestamp, or `None` if it is not open.
    #[must_use]
    pub fn slot(&self, timestamp: Timestamp) -> Option<Slot> {
        Some(self.open.entry(self.open.find(timestamp)?).slot)
    }

    /// Returns the due instant of the timer of `(timestamp, priority)`, or `None` if the timer is
    /// not armed.
    #[must_use]
    pub fn due(&self, timestamp: Timestamp, priority: Priority) -> Option<Instant> {
        let source = self.clouds.source(priority)?;
        let entry = self.open.entry(self.open.find(timestamp)?);
        entry.slot.armed().contains(source).then(|| entry.due(source))
    }

    /// Returns the reason why an offer would be refused now, or `None` if it would be admitted
    /// (F2).
    ///
    /// Nothing changes, not even the gate or the clock. Ask first if preparing a request is costly,
    /// or has an effect of its own as a policy's decision has (T6).
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

    /// Returns the open timestamps and their sets, in ascending order of timestamp.
    pub fn open(&self) -> impl Iterator<Item = (Timestamp, Slot)> {
        self.open.iter().map(|(timestamp, entry)| (timestamp, entry.slot))
    }

    /// Returns a cloud's gate, or `None` if the cloud is not registered.
    #[must_use]
    pub fn gate(&self, cloud: Priority) -> Option<Gate> {
        self.clouds.gate(self.clouds.source(cloud)?).copied()
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

    /// Returns the sources of all registered clouds.
    #[must_use]
    pub fn clouds(&self) -> Sources {
        self.clouds.all()
    }

    /// Returns the greatest number of timestamps that may be open at once.
    #[must_use]
    pub const fn window(&self) -> usize {
        self.window
    }

    /// Returns the commit rule.
    #[must_use]
    pub const fn commit(&self) -> Commit {
        self.commit
    }

    /// Advances the clock (F0) and returns the first timestamp with a timer that is due by then,
    /// and that due instant.
    #[inline]
    fn first_due(&mut self, now: Instant) -> Option<(OpenIndex, Instant)> {
        self.now = self.now.max(now);
        // A timer fires at its due instant, not after it (F5, A1).
        let due = self.open.next_due().filter(|due| *due <= self.now)?;
        Some((self.open.first_due()?, due))
    }

    /// Fires one timestamp's timers of one due instant (F5).
    pub(crate) fn fire(&mut self, index: OpenIndex, due: Instant) -> Firing<CLOUDS> {
        let timestamp = self.open.timestamp(index);
        let timers = self.open.entry(index).armed_at(due);
        // If no timer were due, this timestamp would fire again and again (F5).
        debug_assert!(!timers.is_empty(), "what fires is armed");
        let outcome = self.close(index, Cause::Timers(timers));
        Firing { timestamp, due, timers: self.clouds.priorities(timers), outcome }
    }

    /// Steps an open timestamp, and removes it if the step retires it.
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

    /// Returns `true` if this timestamp or a later one was ever opened.
    fn was_reached(&self, timestamp: Timestamp) -> bool {
        self.newest.is_some_and(|newest| timestamp <= newest)
    }
}

impl<const CLOUDS: usize, const WINDOW: usize> Ready<'_, CLOUDS, WINDOW> {
    /// Opens `timestamp`, because its message arrived (F1).
    ///
    /// `deadline` is how long local may take, or `None` for no bound. A refused open changes
    /// nothing.
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

    /// Asks whether the message may be sent to this cloud (F2).
    ///
    /// `deadline` is how long the cloud may take. `backlog` is the length of the cloud's outgoing
    /// queue without this message. Send the request only if it is admitted.
    pub fn offer(
        &mut self,
        timestamp: Timestamp,
        cloud: Priority,
        deadline: Deadline,
        backlog: u64,
    ) -> Admission {
        let fusion = &mut *self.fusion;
        let source = fusion.clouds.source(cloud).filter(|_| fusion.was_reached(timestamp));
        // Local has no gate, so an offer to it is unknown (F2, A19).
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

    /// Reports the result of a source. The machine forwards, holds or drops it (F3).
    pub fn result(&mut self, timestamp: Timestamp, source: Priority) -> Outcome<CLOUDS> {
        self.close(timestamp, source, Cause::Result)
    }

    /// Reports that no result will come from a source: its call failed, or local produced nothing
    /// (F4).
    pub fn fail(&mut self, timestamp: Timestamp, source: Priority) -> Outcome<CLOUDS> {
        self.close(timestamp, source, Cause::Failure)
    }

    /// Returns the machine's clock: the instant at which these inputs are decided.
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
            // A result for a retired or skipped timestamp is superseded, even if it is late as well
            // (F3, A16).
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

/// Returns an entry without the due instants of disarmed timers.
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
