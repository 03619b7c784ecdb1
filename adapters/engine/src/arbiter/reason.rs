//! Converts the core's reasons to the reasons of a trace. A new reason does not compile until it is
//! added here.

use fuseline_core as core;
use fuseline_traces as trace;

/// Converts the reason why an open was refused (F1).
#[must_use]
pub const fn open_refusal(why: core::OpenRefusal) -> trace::OpenRefusal {
    match why {
        core::OpenRefusal::Order => trace::OpenRefusal::Order,
        core::OpenRefusal::Full => trace::OpenRefusal::Full,
        core::OpenRefusal::Deadline => trace::OpenRefusal::Deadline,
    }
}

/// Converts the reason why an offer was refused (F2).
#[must_use]
pub const fn offer_refusal(why: core::OfferRefusal) -> trace::OfferRefusal {
    match why {
        core::OfferRefusal::Unknown => trace::OfferRefusal::Unknown,
        core::OfferRefusal::Closed => trace::OfferRefusal::Closed,
        core::OfferRefusal::Duplicate => trace::OfferRefusal::Duplicate,
        core::OfferRefusal::Outranked => trace::OfferRefusal::Outranked,
        core::OfferRefusal::Deadline => trace::OfferRefusal::Deadline,
        core::OfferRefusal::Queue => trace::OfferRefusal::Queue,
    }
}

/// Converts the reason why a result or a failure was dropped (F3, F4).
#[must_use]
pub const fn drop_reason(why: core::DropReason) -> trace::DropReason {
    match why {
        core::DropReason::Unknown => trace::DropReason::Unknown,
        core::DropReason::Superseded => trace::DropReason::Superseded,
        core::DropReason::Unsolicited => trace::DropReason::Unsolicited,
        core::DropReason::Duplicate => trace::DropReason::Duplicate,
        core::DropReason::Late => trace::DropReason::Late,
    }
}
