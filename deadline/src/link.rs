//! [`LinkQueue`]: what a vehicle's uplink or downlink does to messages, as arithmetic without a clock.
//!
//! Times are nanoseconds of the caller's clock. The queue is first in, first out, and empties at the rate that the caller
//! gives for each instant; what it has taken is sent, also when nobody waits for it any more.

/// Which way a message is sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum LinkDirection {
    /// From the vehicle: requests.
    Uplink,
    /// To it: replies.
    Downlink,
}

/// What a link carries from an instant on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LinkRate {
    /// Bits in a second; 0 carries nothing.
    pub bits_per_second: u64,
    /// Until when that holds, in ns; later than the instant it was given for. `u64::MAX` is for ever.
    pub until: u64,
}

/// A bounded queue before a link of finite rate.
///
/// A message that does not fit behind those that wait is not taken. An empty queue takes any message, or none longer than
/// the queue would ever be sent.
///
/// ```
/// use fuseline_deadline::{LinkQueue, LinkRate};
///
/// let ten = |_| LinkRate { bits_per_second: 10_000_000, until: u64::MAX };
/// let mut uplink = LinkQueue::new(100_000);
/// // 33.3 KB take 26.64 ms, and what is sent meanwhile waits.
/// assert_eq!(uplink.send(0, 33_300, ten), Some(26_640_000));
/// assert_eq!(uplink.send(0, 33_300, ten), Some(53_280_000));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LinkQueue {
    /// As `waiting`.
    limit: u128,
    /// Billionths of bits that are not sent yet, so that a nanosecond's share of any rate is a whole number.
    waiting: u128,
    now: u64,
}

/// Billionths of bits in a byte.
const BYTE: u128 = 8_000_000_000;

impl LinkRate {
    /// This rate for ever.
    #[must_use]
    pub const fn constant(bits_per_second: u64) -> Self {
        Self { bits_per_second, until: u64::MAX }
    }

    /// What is carried in so many nanoseconds.
    const fn carried(self, nanos: u64) -> u128 {
        (self.bits_per_second as u128).saturating_mul(nanos as u128)
    }
}

impl LinkQueue {
    /// An empty queue for so many bytes.
    #[must_use]
    pub const fn new(queue_bytes: u64) -> Self {
        Self { limit: (queue_bytes as u128).saturating_mul(BYTE), waiting: 0, now: 0 }
    }

    /// Takes a message of so many bytes at `now`; returns when its last bit is sent, rounded up, `u64::MAX` if the rate
    /// stays 0. None: it does not fit.
    ///
    /// An instant before the last one counts as the last one.
    pub fn send(&mut self, now: u64, bytes: u64, rate: impl Fn(u64) -> LinkRate) -> Option<u64> {
        self.pass(now, &rate);
        let waiting = self.waiting.saturating_add(u128::from(bytes).saturating_mul(BYTE));
        if self.waiting > 0 && waiting > self.limit {
            return None;
        }
        self.waiting = waiting;
        Some(self.emptied(rate))
    }

    /// The bytes that are not sent at `now`, begun ones counted whole.
    pub fn waiting(&mut self, now: u64, rate: impl Fn(u64) -> LinkRate) -> u64 {
        self.pass(now, &rate);
        u64::try_from(self.waiting.div_ceil(BYTE)).unwrap_or(u64::MAX)
    }

    fn pass(&mut self, to: u64, rate: &impl Fn(u64) -> LinkRate) {
        while self.now < to && self.waiting > 0 {
            let current = rate(self.now);
            let until = current.until.max(self.now.saturating_add(1)).min(to);
            let carried = current.carried(until.saturating_sub(self.now));
            self.waiting = self.waiting.saturating_sub(carried);
            self.now = until;
        }
        self.now = self.now.max(to);
    }

    /// When nothing waits any more.
    fn emptied(&self, rate: impl Fn(u64) -> LinkRate) -> u64 {
        let (mut at, mut waiting) = (self.now, self.waiting);
        while waiting > 0 && at < u64::MAX {
            let current = rate(at);
            let until = current.until.max(at.saturating_add(1));
            let carried = current.carried(until.saturating_sub(at));
            if carried >= waiting {
                let bits = u128::from(current.bits_per_second).max(1);
                let takes = u64::try_from(waiting.div_ceil(bits)).unwrap_or(u64::MAX);
                return at.saturating_add(takes);
            }
            waiting = waiting.saturating_sub(carried);
            at = until;
        }
        at
    }
}
