//! Detects when messages stop coming on a topic.

use std::time::Duration;

use tokio::time::Instant;

/// The number of usual gaps without a message that count as silence.
const GAPS: u32 = 10;
/// The shortest silence: what comes often or in bursts may pause this long.
const LEAST: Duration = Duration::from_secs(2);
/// The time for the first message, if none is set.
const FIRST: Duration = Duration::from_secs(10);
/// The newest gap counts for one part in this many of the usual gap.
const WEIGHT: u32 = 8;

/// Records when messages came, and how far apart they usually are.
#[derive(Debug, Default)]
pub(crate) struct SilenceDetector {
    /// The time that counts as silence; `None` for ten usual gaps.
    patience: Option<Duration>,
    /// Since when the first message is waited for; none waits for none.
    since: Option<Instant>,
    /// The instant at which the last message came, or a publisher after it.
    last: Option<Instant>,
    /// The mean gap, in which recent gaps count most.
    usual: Option<Duration>,
}

impl SilenceDetector {
    /// Makes the detector of a topic on which nothing has come yet.
    pub(crate) fn new(patience: Option<Duration>) -> Self {
        Self { patience, ..Self::default() }
    }

    /// Makes the detector of a topic on which messages are expected from now on.
    pub(crate) fn expecting(patience: Option<Duration>, now: Instant) -> Self {
        Self { patience, since: Some(now), ..Self::default() }
    }

    /// Returns the time since the wait for the first message began, if that is too long.
    pub(crate) fn absence(&self, now: Instant) -> Option<Duration> {
        let since = self.since.filter(|_| self.last.is_none())?;
        Some(now.duration_since(since)).filter(|it| *it > self.patience.unwrap_or(FIRST))
    }

    /// Notes that a message came.
    pub(crate) fn beat(&mut self, now: Instant) {
        // A silence is not a gap, or the next silence would be reported too late.
        if let Some(last) = self.last
            && self.silence(now).is_none()
        {
            let gap = now.duration_since(last);
            self.usual = Some(
                self.usual.map_or(gap, |usual| (usual * (WEIGHT - 1)).saturating_add(gap) / WEIGHT),
            );
        }
        self.last = Some(now);
    }

    /// Notes that a publisher came, which needs time to begin.
    pub(crate) fn rest(&mut self, now: Instant) {
        if let Some(last) = &mut self.last {
            *last = now;
        }
    }

    /// Returns the time since the last message, if that is too long. A topic with fewer than two
    /// messages has no usual gap.
    pub(crate) fn silence(&self, now: Instant) -> Option<Duration> {
        let patience = self.patience.or_else(|| Some((self.usual? * GAPS).max(LEAST)))?;
        let silence = now.duration_since(self.last?);
        (silence > patience).then_some(silence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// Returns the detector of a topic with a message at each of these instants.
    fn received(patience: Option<Duration>, start: Instant, at_ms: &[u64]) -> SilenceDetector {
        let mut silence_detector = SilenceDetector::new(patience);
        for at in at_ms {
            silence_detector.beat(start + ms(*at));
        }
        silence_detector
    }

    #[test]
    fn what_never_came_or_came_once_is_not_silent() {
        let start = Instant::now();
        for at_ms in [&[][..], &[0]] {
            assert_eq!(received(None, start, at_ms).silence(start + ms(1_000_000)), None);
        }
    }

    /// D15.
    #[test]
    fn first_message_is_waited_for_ten_seconds() {
        let start = Instant::now();
        let absence = |patience, after| {
            SilenceDetector::expecting(patience, start).absence(start + ms(after))
        };
        assert_eq!((absence(None, 10_000), absence(None, 10_001)), (None, Some(ms(10_001))));
        assert_eq!(absence(Some(ms(500)), 501), Some(ms(501)));
        let mut detector = SilenceDetector::expecting(None, start);
        detector.beat(start);
        assert_eq!(detector.absence(start + ms(60_000)), None);
        assert_eq!(SilenceDetector::new(None).absence(start + ms(60_000)), None);
    }

    #[test]
    fn ten_usual_gaps_without_a_message_are_silence_but_never_less_than_two_seconds() {
        let start = Instant::now();
        for (gap, patience) in [(33, 2_000), (200, 2_000), (1_000, 10_000), (60_000, 600_000)] {
            let silence_detector = received(None, start, &[0, gap, 2 * gap, 3 * gap]);
            let at = |after| silence_detector.silence(start + ms(3 * gap + after));
            assert_eq!(at(patience), None, "a gap of {gap} ms");
            assert_eq!(at(patience + 1), Some(ms(patience + 1)), "a gap of {gap} ms");
        }
    }

    /// D15.
    #[test]
    fn a_silence_does_not_put_off_the_next() {
        let start = Instant::now();
        let silence_detector = received(None, start, &[0, 1_000, 3_600_000, 3_601_000]);
        assert_eq!(silence_detector.silence(start + ms(3_612_000)), Some(ms(11_000)));
    }

    #[test]
    fn what_slows_down_by_and_by_is_not_silent() {
        let start = Instant::now();
        let (mut silence_detector, mut at, mut gap) =
            (SilenceDetector::new(None), start, ms(1_000));
        for _ in 0..100 {
            silence_detector.beat(at);
            assert_eq!(silence_detector.silence(at + gap), None);
            at += gap;
            gap = gap * 11 / 10;
        }
    }

    #[test]
    fn patience_that_was_set_holds_whatever_the_gaps() {
        let start = Instant::now();
        let silence_detector = received(Some(ms(500)), start, &[0]);
        assert_eq!(silence_detector.silence(start + ms(500)), None);
        assert_eq!(silence_detector.silence(start + ms(501)), Some(ms(501)));
    }

    /// D15.
    #[test]
    fn a_publisher_that_comes_has_as_long_to_begin() {
        let start = Instant::now();
        let mut silence_detector = received(None, start, &[0, 1_000]);
        silence_detector.rest(start + ms(60_000));
        assert_eq!(silence_detector.silence(start + ms(70_000)), None);
        assert_eq!(silence_detector.silence(start + ms(70_001)), Some(ms(10_001)));
        let mut never = SilenceDetector::new(None);
        never.rest(start);
        assert_eq!(never.silence(start + ms(70_000)), None);
    }
}
