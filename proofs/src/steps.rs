//! The machine's steps that harnesses take.
//!
//! A replay of a counterexample also records each step as lines of a trace.

use crate::fusion::{At, Fusion, Ready};
use crate::priority::Priority;
use crate::slot::{Cause, Commit, Decision, Slot};
use crate::source::Source;
use crate::time::{Deadline, Instant, Timestamp};
use crate::{Admission, OfferRefusal, Opening, Outcome};

#[cfg(not(any(kani, target_arch = "wasm32")))]
mod recording;
#[cfg(not(any(kani, target_arch = "wasm32")))]
pub use recording::take;

/// Runs only in a replay.
macro_rules! record {
    ($recorded:expr) => {
        #[cfg(not(any(kani, target_arch = "wasm32")))]
        if kani::native::is_replay() {
            $recorded
        }
    };
}

pub(crate) fn step(slot: Slot, commit: Commit, cause: Cause) -> (Slot, Decision) {
    record!(recording::slot(slot, commit, recording::of_cause(cause)));
    let (after, decision) = slot.step(commit, cause);
    record!(recording::stepped(slot, cause, decision));
    (after, decision)
}

pub(crate) fn offer_to(slot: Slot, commit: Commit, source: Source) -> (Slot, Option<OfferRefusal>) {
    record!(recording::slot(slot, commit, recording::of_offer(source)));
    let (after, refusal) = slot.offer(source);
    record!(recording::offered(source, refusal));
    let _ = commit;
    (after, refusal)
}

pub(crate) fn at<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    now: Instant,
) -> At<'_, CLOUDS, WINDOW> {
    record!(recording::tick(fusion, now));
    let at = fusion.at(now);
    record!(recording::came_to(&at));
    at
}

/// Gives an input when nothing is due, as [`with_nothing_due`](crate::arbitrary::with_nothing_due) makes the
/// machine.
pub(crate) fn open<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    deadline: Option<Deadline>,
) -> Opening {
    record!(recording::open(fusion, timestamp, deadline));
    let opening = Ready { fusion }.open(timestamp, deadline);
    record!(recording::opened(timestamp, opening));
    opening
}

pub(crate) fn offer<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    cloud: Priority,
    deadline: Deadline,
    backlog: u64,
) -> Admission {
    record!(recording::offer(fusion, (timestamp, cloud), deadline, backlog));
    let admission = Ready { fusion }.offer(timestamp, cloud, deadline, backlog);
    record!(recording::admitted((timestamp, cloud), admission));
    admission
}

pub(crate) fn result<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    priority: Priority,
) -> Outcome<CLOUDS> {
    record!(recording::result(fusion, (timestamp, priority)));
    let outcome = Ready { fusion }.result(timestamp, priority);
    record!(recording::arrived((timestamp, priority), outcome));
    outcome
}

pub(crate) fn fail<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    priority: Priority,
) -> Outcome<CLOUDS> {
    record!(recording::fail(fusion, (timestamp, priority)));
    let outcome = Ready { fusion }.fail(timestamp, priority);
    record!(recording::arrived((timestamp, priority), outcome));
    outcome
}
