//! The reasons of refusals and drops, each with its word and its sentence, as the page shows them.

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};
use serde::Serialize;

/// One reason. The columns refer to it by its index.
#[derive(Serialize)]
pub(crate) struct ReasonColumn {
    word: &'static str,
    sentence: &'static str,
}

/// Returns the reasons of refusals: first the reasons for opens, then those for offers.
pub(crate) fn refusals() -> Vec<ReasonColumn> {
    let opens =
        OpenRefusal::ALL.map(|why| ReasonColumn { word: why.as_str(), sentence: why.sentence() });
    let offers =
        OfferRefusal::ALL.map(|why| ReasonColumn { word: why.as_str(), sentence: why.sentence() });
    opens.into_iter().chain(offers).collect()
}

/// Returns the reasons of drops, each at its index.
pub(crate) fn drops() -> [ReasonColumn; DropReason::ALL.len()] {
    DropReason::ALL.map(|why| ReasonColumn { word: why.as_str(), sentence: why.sentence() })
}

/// Returns the index of an open's refusal among [`refusals`].
pub(crate) const fn index_of_open(why: OpenRefusal) -> usize {
    why.index()
}

/// Returns the index of an offer's refusal among [`refusals`].
pub(crate) const fn index_of_offer(why: OfferRefusal) -> usize {
    OpenRefusal::ALL.len() + why.index()
}
