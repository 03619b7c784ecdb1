//! [`SendBudget`]: which requests are worth their bytes, where a link cannot carry all of them.

use core::time::Duration;

/// Spreads a link's bytes over streams of requests; a stream is one operator's requests to one cloud.
///
/// The bytes that the link carries fill the stream of the greatest expected gain a byte until it can send two messages,
/// then the second stream, and so on; what no stream needs is lost. So no more is ever sent than the rate times the time since
/// the first offer. What a stream gains is the caller's estimate, such as
/// [`Expected::gain`](crate::Expected::gain); a stream without a gain gets nothing.
///
/// A message that takes the link longer than `longest` is never sent: it would be late, and hold up all others.
///
/// An estimate is of calls that were made. So with `probe_every` a stream comes first once if it was passed over so many times
/// in a row, or was never sent.
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
    /// The last offer's instant.
    now: Option<u64>,
}

/// What holds for all streams.
#[derive(Clone, Copy, PartialEq, Debug)]
struct SendTerms {
    bytes_per_second: u64,
    longest: Duration,
    probe_every: Option<u32>,
}

/// A stream, as its last offer was.
#[derive(Clone, Copy, PartialEq, Debug)]
struct SendStream {
    bytes: u64,
    gain: f64,
    /// Billionths of bytes that it may send.
    saved: u128,
    /// Offers since it was sent last; the greatest number if it never was.
    passed_over: u32,
}

/// Billionths of a byte in a byte.
const WHOLE: u128 = 1_000_000_000;

/// How many messages a stream may save for: with one only, what it has beyond that would be lost until it is sent.
const MESSAGES: u128 = 2;

impl<const STREAMS: usize> SendBudget<STREAMS> {
    /// A budget of so many bytes a second.
    #[must_use]
    pub const fn new(bytes_per_second: u64, longest: Duration, probe_every: Option<u32>) -> Self {
        let stream = SendStream { bytes: 0, gain: 0.0, saved: 0, passed_over: u32::MAX };
        let terms = SendTerms { bytes_per_second, longest, probe_every };
        Self { terms, streams: [stream; STREAMS], now: None }
    }

    /// The link's rate is another from now on.
    pub const fn set_rate(&mut self, bytes_per_second: u64) {
        self.terms.bytes_per_second = bytes_per_second;
    }

    /// Whether this stream's next message of so many bytes is worth them at `now`, in ns; then they are spent.
    ///
    /// `gain` is what its answer is expected to gain over no request, in one unit for all streams. A stream that was not
    /// counted in `STREAMS` is never sent. An instant before the last one counts as the last one.
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

    /// Gives what the link carried since the last offer to the streams, the worthiest first.
    fn save(&mut self, now: u64) {
        let since = self.now.map_or(0, |before| now.saturating_sub(before));
        self.now = Some(self.now.map_or(now, |before| before.max(now)));
        let mut left = u128::from(self.terms.bytes_per_second).saturating_mul(u128::from(since));
        let mut below = f64::INFINITY;
        let terms = self.terms;
        // Streams of one worth share a turn, in their order.
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

    /// Its gain a byte; the greatest number if it is due for a probe, and 0 if the link takes too long.
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
        // What is not a number is no gain.
        if self.gain > 0.0 { (self.gain / bytes).min(f64::MAX / 2.0) } else { 0.0 }
    }
}
