//! The name of an open message.

use fuseline_core::Timestamp;

/// Names one open message for the machine that opened it. Using it with another machine is not detected.
// The C interface has it as three integers in this order.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct MessageId {
    pub(crate) timestamp: Timestamp,
    pub(crate) generation: u64,
    pub(crate) index: usize,
}

impl MessageId {
    /// The message's timestamp.
    #[must_use]
    pub const fn timestamp(self) -> Timestamp {
        self.timestamp
    }

    /// The message's index, less than the window; no other open message has it.
    #[must_use]
    pub const fn place(self) -> usize {
        self.index
    }
}
