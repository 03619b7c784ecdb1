//! A vehicle's link with constant rates, for the calls of drawn graphs and of simulated operators.

use std::future;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fuseline_engine::{lock, nanos};
use fuseline_tokio::deadline::{LinkDirection, LinkQueue, LinkRate};
use tokio::time::{Instant, sleep_until};

/// An emulated link. Clones share its queues.
#[derive(Clone, Debug)]
pub(crate) struct EmulatedLink {
    start: Instant,
    /// The rates in each direction, in bits per second.
    rates: [u64; 2],
    queues: Arc<Mutex<[LinkQueue; 2]>>,
}

impl EmulatedLink {
    /// Creates a link on which `queue_bytes` may wait in each direction.
    pub(crate) fn new(queue_bytes: u64, rates: [u64; 2]) -> Self {
        let queues = Arc::new(Mutex::new([LinkQueue::new(queue_bytes); 2]));
        Self { start: Instant::now(), rates, queues }
    }

    /// Waits until a message of this many bytes has passed. Returns `false` if the queue has no
    /// room for it.
    pub(crate) async fn pass(&self, direction: LinkDirection, bytes: usize) -> bool {
        let now = nanos(self.start.elapsed());
        let rate = |_| LinkRate::constant(self.rates[direction as usize]);
        let through = lock(&self.queues)[direction as usize].send(now, bytes as u64, rate);
        let Some(through) = through else { return false };
        let takes = Duration::from_nanos(through.saturating_sub(now));
        if !takes.is_zero() {
            match Instant::now().checked_add(takes) {
                Some(through) => sleep_until(through).await,
                None => future::pending().await,
            }
        }
        true
    }
}
