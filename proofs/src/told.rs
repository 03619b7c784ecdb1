//! The steps that harnesses take. Where a counterexample is run again, each is told in the words of the trace.

use crate::fusion::{At, Fusion, Ready};
use crate::priority::Priority;
use crate::slot::{Cause, Commit, Decision, Slot};
use crate::source::Source;
use crate::time::{Deadline, Instant, Timestamp};
use crate::{Admission, OfferRefusal, Opening, Outcome};

#[cfg(not(any(kani, target_arch = "wasm32")))]
mod words;
#[cfg(not(any(kani, target_arch = "wasm32")))]
pub use words::take;

/// Only where someone reads it.
macro_rules! tell {
    ($telling:expr) => {
        #[cfg(not(any(kani, target_arch = "wasm32")))]
        if kani::native::is_replay() {
            $telling
        }
    };
}

pub(crate) fn step(slot: Slot, commit: Commit, cause: Cause) -> (Slot, Decision) {
    tell!(words::slot(slot, commit, words::of_cause(cause)));
    let (after, decision) = slot.step(commit, cause);
    tell!(words::stepped(slot, cause, decision));
    (after, decision)
}

pub(crate) fn offer_to(slot: Slot, commit: Commit, source: Source) -> (Slot, Option<OfferRefusal>) {
    tell!(words::slot(slot, commit, words::of_offer(source)));
    let (after, refusal) = slot.offer(source);
    tell!(words::offered(source, refusal));
    let _ = commit;
    (after, refusal)
}

pub(crate) fn at<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    now: Instant,
) -> At<'_, CLOUDS, WINDOW> {
    tell!(words::tick(fusion, now));
    let at = fusion.at(now);
    tell!(words::came_to(&at));
    at
}

/// The input is given where nothing is due, as [`at_rest`](crate::any::at_rest) is made.
pub(crate) fn open<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    deadline: Option<Deadline>,
) -> Opening {
    tell!(words::open(fusion, timestamp, deadline));
    let opening = Ready { fusion }.open(timestamp, deadline);
    tell!(words::opened(timestamp, opening));
    opening
}

pub(crate) fn offer<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    cloud: Priority,
    deadline: Deadline,
    backlog: u64,
) -> Admission {
    tell!(words::offer(fusion, (timestamp, cloud), deadline, backlog));
    let admission = Ready { fusion }.offer(timestamp, cloud, deadline, backlog);
    tell!(words::admitted((timestamp, cloud), admission));
    admission
}

pub(crate) fn result<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    priority: Priority,
) -> Outcome<CLOUDS> {
    tell!(words::result(fusion, (timestamp, priority)));
    let outcome = Ready { fusion }.result(timestamp, priority);
    tell!(words::arrived((timestamp, priority), outcome));
    outcome
}

pub(crate) fn fail<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    priority: Priority,
) -> Outcome<CLOUDS> {
    tell!(words::fail(fusion, (timestamp, priority)));
    let outcome = Ready { fusion }.fail(timestamp, priority);
    tell!(words::arrived((timestamp, priority), outcome));
    outcome
}
