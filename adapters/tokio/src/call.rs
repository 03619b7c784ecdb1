//! One call to a cloud or one side request, as the handle that makes it sees it.
//!
//! The two kinds of call differ only in where the bytes that they send are counted.

use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Counting, Lineage};

use crate::side_counts::SideCounts;

/// Describes one call to a cloud to the handle that makes it.
#[derive(Clone)]
pub struct Call {
    /// The message's timestamp.
    pub timestamp: u64,
    /// The time left for the call: the request's deadline, less the time in the queue, plus the
    /// time to [linger](crate::Cloud::linger).
    pub deadline: Duration,
    /// The lineage of the message, if the message was written with one.
    pub lineage: Option<Arc<Lineage>>,
    pub(crate) byte_counter: ByteCounter,
}

/// Counts the bytes that a call sends.
#[derive(Clone)]
pub(crate) enum ByteCounter {
    Cloud(u16, Counting),
    SideRequest(Arc<SideCounts>),
}

impl Call {
    /// Returns a call for a handle that you drive yourself. The bytes that it sends are counted for
    /// cloud `priority`.
    #[must_use]
    pub const fn new(
        timestamp: u64,
        deadline: Duration,
        priority: u16,
        counting: Counting,
    ) -> Self {
        let byte_counter = ByteCounter::Cloud(priority, counting);
        Self { timestamp, deadline, lineage: None, byte_counter }
    }

    /// Returns this call with the lineage of its message.
    #[must_use]
    pub fn with_lineage(mut self, lineage: Option<Arc<Lineage>>) -> Self {
        self.lineage = lineage;
        self
    }

    /// Counts bytes that the call sends. They appear in the tally of its cloud or side request.
    pub fn sent(&self, bytes: usize) {
        match &self.byte_counter {
            ByteCounter::Cloud(priority, counting) => counting.sent(*priority, bytes as u64),
            ByteCounter::SideRequest(counts) => counts.sent(bytes as u64),
        }
    }
}
