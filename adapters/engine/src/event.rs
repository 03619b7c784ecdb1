//! What happens to the requests and results of one source, as it is counted.

use fuseline_traces::{DropReason, OfferRefusal};

use crate::item::Trigger;

/// What is counted about one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum CountedEvent {
    Admitted,
    Refused(OfferRefusal),
    Output(Trigger),
    /// A message ended without a result better than the one that was sent before.
    Final,
    /// A result was forwarded as it came; its message is counted by `Output`.
    Forwarded,
    /// A result was forwarded as it came, and better ones may follow.
    Preliminary,
    Held,
    Dropped(DropReason),
    Failed,
    Lost,
    /// A message handler failed.
    HandlerFailed,
    PolicyFailed,
    /// A handler held up the thread that it ran on.
    HeldUp,
    FailureDropped(DropReason),
    Timer,
    Cancelled,
    Sent {
        bytes: u64,
    },
}
