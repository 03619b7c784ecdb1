//! The reasons of refusals and drops, each with its word and its sentence, as the page tells them.

use fuseline_traces::{DropReason, Refusal};
use serde::Serialize;

/// One reason; the columns name it by its place.
#[derive(Serialize)]
pub(crate) struct Reason {
    word: &'static str,
    sentence: &'static str,
}

/// Those of refusals, in the order of `Refusal::ALL`.
pub(crate) fn refusals() -> [Reason; 8] {
    Refusal::ALL.map(|why| Reason { word: why.as_str(), sentence: refused(why) })
}

/// Those of drops, in the order of `DropReason::ALL`.
pub(crate) fn drops() -> [Reason; 5] {
    DropReason::ALL.map(|why| Reason { word: why.as_str(), sentence: dropped(why) })
}

/// The place of a refusal's reason.
pub(crate) fn place_of_refusal(why: Refusal) -> usize {
    Refusal::ALL.iter().position(|one| *one == why).unwrap_or(Refusal::ALL.len())
}

/// The place of a drop's reason.
pub(crate) fn place_of_drop(why: DropReason) -> usize {
    DropReason::ALL.iter().position(|one| *one == why).unwrap_or(DropReason::ALL.len())
}

const fn refused(why: Refusal) -> &'static str {
    match why {
        Refusal::Order => "this timestamp or a later one was opened before",
        Refusal::Full => "as many timestamps are open as the window allows",
        Refusal::Deadline => "its due instant has passed already",
        Refusal::Unknown => "no such cloud, or no timestamp as great was ever opened",
        Refusal::Closed => "the timestamp is not open",
        Refusal::Duplicate => "this cloud was asked before",
        Refusal::Outranked => "something better is in hand",
        Refusal::Queue => "the cloud's gate is shut",
    }
}

const fn dropped(why: DropReason) -> &'static str {
    match why {
        DropReason::Unknown => "no such source, or no timestamp as great was ever opened",
        DropReason::Superseded => "the timestamp is not open any more",
        DropReason::Unsolicited => "this cloud was never asked",
        DropReason::Duplicate => "its result is held already",
        DropReason::Late => "its timer fired before, or its failure was accepted",
    }
}
