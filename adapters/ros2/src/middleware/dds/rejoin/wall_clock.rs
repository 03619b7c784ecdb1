//! Finds out whether the wall clock stepped back.
//!
//! Deadlines do not depend on it, but `rustdds` does. The clock is passed in: this only compares.

use std::time::{Duration, SystemTime};

/// A shorter step back is over before another participant has met anybody.
const SHORTEST_STEP: Duration = Duration::from_millis(100);

/// The latest time that the wall clock has shown.
#[derive(Debug)]
pub(super) struct WallClock {
    latest: SystemTime,
}

impl WallClock {
    pub(super) fn new(now: SystemTime) -> Self {
        Self { latest: now }
    }

    /// Returns `true` if it stepped back since it was last looked at. Shorter steps add up until it
    /// has caught up.
    pub(super) fn stepped_back(&mut self, now: SystemTime) -> bool {
        let behind = self.latest.duration_since(now).unwrap_or_default();
        let stepped_back = behind > SHORTEST_STEP;
        self.latest = if stepped_back { now } else { self.latest.max(now) };
        stepped_back
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(shown_ms: &[u64]) -> Vec<bool> {
        let at = |ms: &u64| SystemTime::UNIX_EPOCH + Duration::from_millis(*ms);
        let (first, later) = shown_ms.split_first().expect("a first time");
        let mut clock = WallClock::new(at(first));
        later.iter().map(|ms| clock.stepped_back(at(ms))).collect()
    }

    /// D13.
    #[test]
    fn a_clock_stepped_back_if_it_is_more_than_a_tenth_of_a_second_behind_the_latest_time() {
        assert_eq!(steps(&[1000, 1100, 1000, 999]), [false, false, true]);
        assert_eq!(steps(&[1000, 940, 880]), [false, true], "short steps add up");
        assert_eq!(steps(&[1000, 940, 1000, 1040, 980]), [false; 4], "it has caught up");
    }

    /// D13.
    #[test]
    fn each_step_back_counts_once_and_a_step_ahead_does_not() {
        assert_eq!(steps(&[1000, 5000, 1000, 1020, 1040]), [false, true, false, false]);
        assert_eq!(steps(&[5000, 3000, 1000, 1020]), [true, true, false]);
    }
}
