//! [`SendBudget`]: chooses which requests to send when a link cannot carry all of them.

use core::time::Duration;

/// Spreads a link's bytes over streams of requests. A stream is one operator's requests to one
/// cloud.
///
/// The stream with the greatest expected gain per byte gets the bytes that the link carries, until
/// it can send two messages. Then the second stream gets them, and so on. Bytes that no stream
/// needs are lost, so the streams never send more than the rate times the time since the first
/// offer. The caller estimates the gain of each request, for example by
/// [`Expected::gain`](crate::Expected::gain). A stream without a gain gets bytes only for probes.
///
/// A message that takes the link longer than `longest` is never sent: it would be late and would
/// hold up all others.
///
/// An estimate needs calls. So with `probe_every`, a stream comes first once if it was never sent
/// or was passed over that many times in a row.
///
/// ```
/// use core::time::Duration;
/// use fuseline_deadline::SendBudget;
///
/// // 100 KB a second, which is one message of two.
/// let mut budget = SendBudget::<2>::new(100_000, Duration::from_millis(500), None);
/// let sent = (0..=20_u64).map(|tenth| {
///     let now = tenth * 100_000_000;
///     [budget.offer(0, now, 10_000, 9.3), budget.offer(1, now, 10_000, 1.5)]
/// });
/// let sent: Vec<[bool; 2]> = sent.collect();
/// assert!(sent[1..].iter().all(|sent| *sent == [true, false]));
/// ```
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct SendBudget<const STREAMS: usize> {
    terms: SendTerms,
    streams: [SendStream; STREAMS],
    /// The instant of the last offer.
    now: Option<u64>,
}

/// The settings that all streams share.
#[derive(Clone, Copy, PartialEq, Debug)]
struct SendTerms {
    bytes_per_second: u64,
    longest: Duration,
    probe_every: Option<u32>,
}

/// The state of a stream at its last offer.
#[derive(Clone, Copy, PartialEq, Debug)]
struct SendStream {
    bytes: u64,
    gain: f64,
    /// The bytes that the stream may send, in billionths of a byte.
    saved: u128,
    /// The number of offers since the stream was last sent, or the greatest number if it never was.
    passed_over: u32,
}

/// The number of billionths of a byte in a byte.
const WHOLE: u128 = 1_000_000_000;

/// The number of messages for which a stream may save. If it were one, all further bytes would be
/// lost until that message is sent.
const MESSAGES: u128 = 2;

impl<const STREAMS: usize> SendBudget<STREAMS> {
    /// Creates a budget for a link of `bytes_per_second`. A request that takes longer than
    /// `longest` is never sent, and a stream that was passed over `probe_every` times in a row
    /// comes first once.
    #[must_use]
    pub const fn new(bytes_per_second: u64, longest: Duration, probe_every: Option<u32>) -> Self {
        let stream = SendStream { bytes: 0, gain: 0.0, saved: 0, passed_over: u32::MAX };
        let terms = SendTerms { bytes_per_second, longest, probe_every };
        Self { terms, streams: [stream; STREAMS], now: None }
    }

    /// Changes the link's rate from the next offer on.
    pub const fn set_rate(&mut self, bytes_per_second: u64) {
        self.terms.bytes_per_second = bytes_per_second;
    }

    /// Returns `true` if the next message of `stream`, of `bytes` bytes, is to be sent at `now`, in
    /// ns, and spends those bytes.
    ///
    /// `gain` is the expected gain of the request over no request, in one unit for all streams. A
    /// stream whose index is not below `STREAMS` is never sent. A `now` before the last one counts
    /// as the last one.
    pub fn offer(&mut self, stream: usize, now: u64, bytes: u64, gain: f64) -> bool {
        self.save(now);
        let terms = self.terms;
        let Some(stream) = self.streams.get_mut(stream) else { return false };
        (stream.bytes, stream.gain) = (bytes, gain);
        let is_sent = stream.worth(&terms) > 0.0 && stream.saved >= stream.needs();
        if is_sent {
            stream.saved = stream.saved.saturating_sub(stream.needs());
            stream.passed_over = 0;
        } else {
            stream.passed_over = stream.passed_over.saturating_add(1);
        }
        is_sent
    }

    /// Distributes the bytes that the link carried since the last offer, first to the stream that
    /// is worth most.
    fn save(&mut self, now: u64) {
        let since = self.now.map_or(0, |before| now.saturating_sub(before));
        self.now = Some(self.now.map_or(now, |before| before.max(now)));
        let mut left = u128::from(self.terms.bytes_per_second).saturating_mul(u128::from(since));
        let mut below = f64::INFINITY;
        let terms = self.terms;
        // Streams of equal worth take turns in the order of their index.
        while left > 0 {
            let worths = self.streams.iter().map(|stream| stream.worth(&terms));
            let next = worths.filter(|worth| *worth > 0.0 && *worth < below).fold(0.0, f64::max);
            if next <= 0.0 {
                break;
            }
            for stream in &mut self.streams {
                if stream.worth(&terms) >= next && stream.worth(&terms) < below {
                    let most = stream.needs().saturating_mul(MESSAGES);
                    let share = most.saturating_sub(stream.saved).min(left);
                    stream.saved = stream.saved.saturating_add(share);
                    left = left.saturating_sub(share);
                }
            }
            below = next;
        }
    }
}

impl SendStream {
    const fn needs(&self) -> u128 {
        (self.bytes as u128).saturating_mul(WHOLE)
    }

    /// Returns the stream's gain per byte: the greatest number if it is due for a probe, and 0 if
    /// the link takes too long.
    fn worth(&self, terms: &SendTerms) -> f64 {
        let carried = u128::from(terms.bytes_per_second).saturating_mul(terms.longest.as_nanos());
        if self.needs() > carried {
            return 0.0;
        }
        if terms.probe_every.is_some_and(|every| self.passed_over >= every) {
            return f64::MAX;
        }
        #[expect(clippy::cast_precision_loss, reason = "no message has 2^53 bytes")]
        let bytes = self.bytes.max(1) as f64;
        // NaN is no gain.
        if self.gain > 0.0 { (self.gain / bytes).min(f64::MAX / 2.0) } else { 0.0 }
    }
}
