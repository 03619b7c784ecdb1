//! One call, as the handle that makes it sees it.
//!
//! Calls to clouds and side requests differ only in where the bytes that they send are counted.

use std::sync::Arc;
use std::time::Duration;

use fuseline_engine::{Counting, Lineage};

use crate::side_counts::SideCounts;

/// One call to a cloud, as its handle sees it.
#[derive(Clone)]
pub struct Call {
    /// The message's timestamp.
    pub timestamp: u64,
    /// The time left: without what was spent in the queue, with the time to linger.
    pub deadline: Duration,
    /// What the message comes from, if it was written with that.
    pub lineage: Option<Arc<Lineage>>,
    pub(crate) byte_counter: ByteCounter,
}

/// Where the bytes that a call sends are counted.
#[derive(Clone)]
pub(crate) enum ByteCounter {
    Cloud(u16, Counting),
    SideRequest(Arc<SideCounts>),
}

impl Call {
    /// A call for a handle that you drive yourself; what it sends is counted for cloud `priority`.
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

    /// The same about a message with this lineage.
    #[must_use]
    pub fn with_lineage(mut self, lineage: Option<Arc<Lineage>>) -> Self {
        self.lineage = lineage;
        self
    }

    /// Counts bytes sent, the price of speculation.
    pub fn sent(&self, bytes: usize) {
        match &self.byte_counter {
            ByteCounter::Cloud(priority, counting) => counting.sent(*priority, bytes as u64),
            ByteCounter::SideRequest(counts) => counts.sent(bytes as u64),
        }
    }
}
