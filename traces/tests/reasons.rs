//! Checks that each list of reasons is complete. A new reason breaks a `match` here, and then the
//! comparison below it.

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};

const fn after_open(why: OpenRefusal) -> Option<OpenRefusal> {
    match why {
        OpenRefusal::Order => Some(OpenRefusal::Full),
        OpenRefusal::Full => Some(OpenRefusal::Deadline),
        OpenRefusal::Deadline => None,
    }
}

const fn after_offer(why: OfferRefusal) -> Option<OfferRefusal> {
    match why {
        OfferRefusal::Unknown => Some(OfferRefusal::Closed),
        OfferRefusal::Closed => Some(OfferRefusal::Duplicate),
        OfferRefusal::Duplicate => Some(OfferRefusal::Outranked),
        OfferRefusal::Outranked => Some(OfferRefusal::Deadline),
        OfferRefusal::Deadline => Some(OfferRefusal::Queue),
        OfferRefusal::Queue => None,
    }
}

const fn after_drop(why: DropReason) -> Option<DropReason> {
    match why {
        DropReason::Unknown => Some(DropReason::Superseded),
        DropReason::Superseded => Some(DropReason::Unsolicited),
        DropReason::Unsolicited => Some(DropReason::Duplicate),
        DropReason::Duplicate => Some(DropReason::Late),
        DropReason::Late => None,
    }
}

fn all<T: Copy>(first: T, after: fn(T) -> Option<T>) -> Vec<T> {
    std::iter::successors(Some(first), |why| after(*why)).collect()
}

#[test]
fn every_reason_is_in_its_list() {
    assert_eq!(OpenRefusal::ALL[..], all(OpenRefusal::Order, after_open));
    assert_eq!(OfferRefusal::ALL[..], all(OfferRefusal::Unknown, after_offer));
    assert_eq!(DropReason::ALL[..], all(DropReason::Unknown, after_drop));
}
