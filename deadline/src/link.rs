//! [`LinkQueue`]: computes when messages pass a vehicle's uplink or downlink, without a clock.
//!
//! Times are nanoseconds of the caller's clock. The queue is first in, first out, and empties at
//! the rate that the caller gives for each instant. A message in the queue is sent even if nobody
//! waits for it any more.

/// The direction of a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum LinkDirection {
    /// From the vehicle; carries requests.
    Uplink,
    /// To the vehicle; carries results.
    Downlink,
}

/// The rate of a link from an instant on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LinkRate {
    /// Bits per second; 0 carries nothing.
    pub bits_per_second: u64,
    /// The instant, in ns, until which the rate holds. It is later than the instant that was asked
    /// about; `u64::MAX` means without end.
    pub until: u64,
}

/// A bounded queue in front of a link of finite rate.
///
/// A message that does not fit behind the waiting ones is not taken. An empty queue takes any
/// message; otherwise a message longer than the queue could never be sent.
///
/// ```
/// use fuseline_deadline::{LinkQueue, LinkRate};
///
/// let ten = |_| LinkRate { bits_per_second: 10_000_000, until: u64::MAX };
/// let mut uplink = LinkQueue::new(100_000);
/// // 33.3 KB take 26.64 ms, and a message that comes meanwhile waits.
/// assert_eq!(uplink.send(0, 33_300, ten), Some(26_640_000));
/// assert_eq!(uplink.send(0, 33_300, ten), Some(53_280_000));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LinkQueue {
    /// The queue's capacity, in the unit of `waiting`.
    limit: u128,
    /// The unsent bits, in billionths of a bit, so that a nanosecond's share of any rate is a whole
    /// number.
    waiting: u128,
    now: u64,
}

/// The number of billionths of a bit in a byte.
const BYTE: u128 = 8_000_000_000;

impl LinkRate {
    /// Returns a rate that never changes.
    #[must_use]
    pub const fn constant(bits_per_second: u64) -> Self {
        Self { bits_per_second, until: u64::MAX }
    }

    /// Returns the amount that is carried in `nanos` nanoseconds.
    const fn carried(self, nanos: u64) -> u128 {
        (self.bits_per_second as u128).saturating_mul(nanos as u128)
    }
}

impl LinkQueue {
    /// Creates an empty queue with room for `queue_bytes` bytes.
    #[must_use]
    pub const fn new(queue_bytes: u64) -> Self {
        Self { limit: (queue_bytes as u128).saturating_mul(BYTE), waiting: 0, now: 0 }
    }

    /// Puts a message of `bytes` bytes into the queue at `now`, in ns. Returns the instant when its
    /// last bit is sent, or `None` if it does not fit.
    ///
    /// The instant is rounded up, and it is `u64::MAX` if the rate stays 0. A `now` before the last
    /// one counts as the last one.
    pub fn send(&mut self, now: u64, bytes: u64, rate: impl Fn(u64) -> LinkRate) -> Option<u64> {
        self.pass(now, &rate);
        let waiting = self.waiting.saturating_add(u128::from(bytes).saturating_mul(BYTE));
        if self.waiting > 0 && waiting > self.limit {
            return None;
        }
        self.waiting = waiting;
        Some(self.emptied(rate))
    }

    /// Returns the number of bytes that are not sent at `now`, in ns. Bytes that are partly sent
    /// count whole.
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

    /// Returns the instant when the queue is empty.
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
