//! [`Streaming`], the deadline of least loss if outputs form a stream in which the newest output is
//! in force.

use core::time::Duration;

use crate::expected::Expected;
use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::loss::{Loss, Source};
use crate::policy::Situation;
use crate::span::Span;

/// Chooses the deadline of least [`StreamLoss`], from the last `WINDOW` calls and the last `WINDOW`
/// speeds.
///
/// ```
/// use core::time::Duration;
/// use fuseline_deadline::{BoxDetector, Invalid, Policy, Situation, StreamLoss, Streaming};
///
/// let (period, local_response) = (Duration::from_millis(33), Duration::from_millis(15));
/// let local = BoxDetector { accuracy: 42.0, overlap: 0.8 };
/// let cloud = BoxDetector { accuracy: 52.0, overlap: 0.9 };
/// let mut policy: Streaming =
///     Streaming::new(StreamLoss::new(local, cloud, period), local_response, Some(16))?;
/// policy.moved(0.5); // a box moved by half its size in a second
/// let deadline = policy.decide(&Situation::UNKNOWN, Duration::from_millis(200)).deadline;
/// assert_eq!(deadline, Duration::from_millis(200)); // the first message is a probe
/// # Ok::<(), Invalid>(())
/// ```
pub type Streaming<const WINDOW: usize = 64> = Expected<StreamLoss<WINDOW>, WINDOW>;

/// The quality of a detector of boxes on single frames.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct BoxDetector {
    /// The detector's accuracy if a box must overlap by half, such as its AP50.
    pub accuracy: f64,
    /// The mean overlap of its right boxes (`IoU`), from 0.5 to 1.
    pub overlap: f64,
}

/// The loss of an output in a stream in which the newest output is in force: accuracy, reduced by
/// how far boxes move meanwhile.
///
/// While no speed is known, nothing moves.
///
/// # Derivation
///
/// Streaming accuracy (Li, Wang and Ramanan, *Towards Streaming Perception*) compares the world at
/// each instant with the newest output that was sent by then. Let frames be captured every `P`, and
/// let each output be sent at the age `r`. Then an output is in force from the age `r` until the
/// next one is sent, at the age `r + P`. So waiting costs twice: the output is older when it is
/// sent, and the previous output stays in force for longer.
///
/// A box that has moved by the share `q` of its size along one side overlaps its former place by
/// `(1 − q) / (1 + q)` (`IoU`). If it moves along both sides, `q` is the sum of the shares, and the
/// overlap is at least that. A box counts while it overlaps by half, so while `q ≤ 1/3`. A detector
/// whose right boxes overlap by `o` has already used `(1 − o) / (1 + o)` of that third, if its
/// error lies along the movement. The rest is its *slack*, `s = 1/3 − (1 − o) / (1 + o)`. So a box
/// that moves at `v` sizes per second counts until the age `s / v`. It counts for this share of the
/// time in force:
///
/// ```text
/// clamp((s / v − r) / P, 0, 1)
/// ```
///
/// The loss is the better source's accuracy minus the source's own accuracy times the mean of that
/// share over the observed speeds. [`Expected`] finds the deadline of least mean loss (T3).
///
/// The derivation assumes that the next output is sent at the same age. With mixed sources some
/// outputs are earlier and some are later, and the loss is right on average. If the consumer
/// extrapolates boxes, only the error of its extrapolation counts as speed. Under the *progressive*
/// commit rule local's output is sent at once whatever the deadline, so waiting costs nothing; then
/// give no speeds.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct StreamLoss<const WINDOW: usize = 64> {
    local: BoxDetector,
    cloud: BoxDetector,
    period: Duration,
    /// The speeds, in sizes of the box per second. Entries from `len` on are unused.
    speeds: [f64; WINDOW],
    len: usize,
    next: usize,
}

impl<const WINDOW: usize> StreamLoss<WINDOW> {
    /// Creates a loss for frames that are captured every `period`, with no speed known yet.
    #[must_use]
    pub const fn new(local: BoxDetector, cloud: BoxDetector, period: Duration) -> Self {
        const { assert!(WINDOW > 0, "a window of no speeds remembers nothing") };
        Self { local, cloud, period, speeds: [0.0; WINDOW], len: 0, next: 0 }
    }

    /// Remembers how fast a box moved, in sizes of the box per second, and forgets the speed
    /// `WINDOW` calls ago.
    ///
    /// The speed is `|vx| / width + |vy| / height`. If the consumer extrapolates boxes, it is the
    /// speed of the extrapolation's error. A number that is not a speed is ignored.
    pub fn moved(&mut self, speed: f64) {
        if !(0.0..f64::INFINITY).contains(&speed) {
            return;
        }
        if let Some(entry) = self.speeds.get_mut(self.next) {
            *entry = speed;
        }
        let next = self.next.saturating_add(1);
        self.len = self.len.max(next);
        self.next = if next < WINDOW { next } else { 0 };
    }

    /// Returns the share of boxes that count, over the time in which an output of this age is in
    /// force.
    fn share(&self, detector: BoxDetector, response: Duration) -> f64 {
        let speeds = self.speeds.get(..self.len).unwrap_or_default();
        let (slack, response) = (detector.slack(), response.as_secs_f64());
        let (mut shares, mut count) = (0.0, 0.0);
        for speed in speeds {
            let counts_until = if *speed > 0.0 { slack / speed } else { f64::INFINITY };
            shares += ((counts_until - response) / self.period.as_secs_f64()).clamp(0.0, 1.0);
            count += 1.0;
        }
        if count > 0.0 { shares / count } else { 1.0 }
    }
}

impl<const WINDOW: usize> Loss for StreamLoss<WINDOW> {
    fn loss(&self, _: &Situation<'_>, source: Source, response: Duration) -> f64 {
        let detector = match source {
            Source::Local => self.local,
            Source::Cloud => self.cloud,
        };
        let best = self.local.accuracy.max(self.cloud.accuracy);
        best - detector.accuracy * self.share(detector, response)
    }

    fn check(&self) -> Result<(), Invalid> {
        for (detector, figure) in
            [(self.local, Figure::AccuracyLocal), (self.cloud, Figure::AccuracyCloud)]
        {
            figure.check(Span::exactly(detector.accuracy))?;
            Figure::Overlap.check(Span::exactly(detector.overlap))?;
        }
        Figure::PeriodLocal.check(Span::exactly(self.period))
    }
}

impl<const WINDOW: usize> Streaming<WINDOW> {
    /// Learns how fast a box moved; see [`StreamLoss::moved`].
    pub fn moved(&mut self, speed: f64) {
        self.loss_mut().moved(speed);
    }
}

impl BoxDetector {
    /// Returns the share of its size that a right box may move until it no longer counts.
    fn slack(self) -> f64 {
        1.0 / 3.0 - (1.0 - self.overlap) / (1.0 + self.overlap)
    }
}
