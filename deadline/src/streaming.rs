//! [`Streaming`], the deadline of least loss where outputs form a stream, of which the newest is in force.

use core::time::Duration;

use crate::expected::Expected;
use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::loss::{Loss, Source};
use crate::policy::Situation;
use crate::span::Span;

/// The deadline of least [`StreamLoss`], by the last `WINDOW` calls and the last `WINDOW` speeds.
pub type Streaming<const WINDOW: usize = 64> = Expected<StreamLoss<WINDOW>, WINDOW>;

/// How well a detector of boxes does on single frames.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct BoxDetector {
    /// Its accuracy where a box counts that overlaps by half, such as its AP50.
    pub accuracy: f64,
    /// By how much its boxes that count overlap in the mean (`IoU`), 0.5 to 1.
    pub overlap: f64,
}

/// What an output costs in a stream of outputs, of which the newest is in force: accuracy, and what the world moves meanwhile.
///
/// While no speed is known, nothing moves.
///
/// # Derivation
///
/// Streaming accuracy (Li, Wang and Ramanan, *Towards Streaming Perception*) compares the world at each instant with the newest
/// output that was sent by then. Let frames be captured every `P`, and each output be sent at the age `r`. Then an output is in
/// force from the age `r` until the next one is sent, at the age `r + P`. So waiting costs twice: the output is older when it is
/// sent, and the one before it stays for longer.
///
/// Boxes that move by the share `q` of their size overlap what they were by `(1 − q) / (1 + q)` (`IoU`), as far as they move along
/// one side; along both, `q` is the sum of the shares and the overlap no less than that. A box counts while it overlaps by half,
/// so while `q ≤ 1/3`. A detector whose right boxes overlap by `o` has used `(1 − o) / (1 + o)` of that, if its error lies along
/// the movement; the rest, its *slack*, is `s = 1/3 − (1 − o) / (1 + o)`. So what moves at `v` sizes a second counts until the
/// age `s / v`, and of the time in force the share
///
/// ```text
/// clamp((s / v − r) / P, 0, 1)
/// ```
///
/// The loss is the better source's accuracy less the own one's times the mean of that share over the speeds that were observed.
/// [`Expected`] finds the deadline of least mean loss (T3).
///
/// That the next output is sent at the same age is an assumption: with mixed sources some are sent earlier, some later, and the
/// loss is right in the mean. If the consumer moves boxes on, only what that misses counts as speed. Under the commit rule
/// *progressive* local's output is sent at once, whatever the deadline: waiting costs nothing, so give no speeds.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct StreamLoss<const WINDOW: usize = 64> {
    local: BoxDetector,
    cloud: BoxDetector,
    period: Duration,
    /// In sizes of the box a second; entries from `len` on mean nothing.
    speeds: [f64; WINDOW],
    len: usize,
    next: usize,
}

impl<const WINDOW: usize> StreamLoss<WINDOW> {
    /// Of frames that are captured every `period`. No speed is known yet.
    #[must_use]
    pub const fn new(local: BoxDetector, cloud: BoxDetector, period: Duration) -> Self {
        const { assert!(WINDOW > 0, "a window of no speeds remembers nothing") };
        Self { local, cloud, period, speeds: [0.0; WINDOW], len: 0, next: 0 }
    }

    /// Remembers how fast a box moved, in sizes of the box a second, and forgets the speed `WINDOW` ago.
    ///
    /// The speed is `|vx| / width + |vy| / height`; of a consumer that moves boxes on, that of its error. What is no speed is
    /// ignored.
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

    /// The share of boxes that count, over the time in which an output of this age is in force.
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
    /// By which share of its size a right box may move until it no longer counts.
    fn slack(self) -> f64 {
        1.0 / 3.0 - (1.0 - self.overlap) / (1.0 + self.overlap)
    }
}
