//! Identifies an open message.

use fuseline_core::Timestamp;

/// Identifies one open message of the machine that opened it. Using it with another machine is not
/// detected.
// The C interface has it as three integers in this order.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct MessageId {
    pub(crate) timestamp: Timestamp,
    pub(crate) generation: u64,
    pub(crate) index: usize,
}

impl MessageId {
    /// Returns the message's timestamp.
    #[must_use]
    pub const fn timestamp(self) -> Timestamp {
        self.timestamp
    }

    /// Returns the message's index, which is less than the window. No other open message has the
    /// same index.
    #[must_use]
    pub const fn place(self) -> usize {
        self.index
    }
}
