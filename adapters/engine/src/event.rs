//! The events of one source's requests and results, as they are counted.

use fuseline_traces::{DropReason, OfferRefusal};

use crate::item::Trigger;

/// An event that is counted for one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum CountedEvent {
    Admitted,
    Refused(OfferRefusal),
    Output(Trigger),
    /// A message ended without a better result than the one sent before.
    Final,
    /// A result was forwarded when it came; `Output` counts its message.
    Forwarded,
    /// A result was forwarded when it came, and better ones may follow.
    Preliminary,
    Held,
    Dropped(DropReason),
    Failed,
    Lost,
    /// A message handler failed.
    HandlerFailed,
    PolicyFailed,
    /// A handler blocked the thread that it ran on.
    HeldUp,
    FailureDropped(DropReason),
    Timer,
    Cancelled,
    Sent {
        bytes: u64,
    },
}
