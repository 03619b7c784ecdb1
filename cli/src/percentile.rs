//! Percentiles: in bounded memory however many times there are, and how they are shown.

use std::time::Duration;

use fuseline_report::Quantile;
use hdrhistogram::Histogram;
use serde::{Serialize, Serializer};

/// The longest time that is distinguished, in microseconds: an hour.
const LONGEST_US: u64 = 3_600_000_000;
/// Times are kept to this many digits.
const DIGITS: u8 = 4;

/// Times of which some never ended.
#[derive(Clone)]
pub(crate) struct Spread {
    times: Histogram<u32>,
    never: u64,
}

/// The percentiles of times, as tables and JSON have them.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Percentiles {
    pub(crate) p50: Option<Quantile>,
    pub(crate) p90: Option<Quantile>,
    pub(crate) p99: Option<Quantile>,
    pub(crate) max: Option<Quantile>,
}

/// Shows a percentile; `time` shows one that is known.
pub(crate) fn shown(quantile: Option<Quantile>, time: impl Fn(Duration) -> String) -> String {
    match quantile {
        Some(Quantile::Exactly(at)) => time(at),
        Some(Quantile::AtLeast(at)) => format!("≥ {} ms", at.as_millis()),
        Some(Quantile::Never) => "never".to_owned(),
        None => "–".to_owned(),
    }
}

/// Writes the percentiles p50, p90 and p99 as one object.
///
/// # Errors
/// Returns an error of the serializer.
pub(crate) fn as_object<S: Serializer>(
    [p50, p90, p99]: &[Option<Quantile>; 3],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Object {
        p50: Option<Quantile>,
        p90: Option<Quantile>,
        p99: Option<Quantile>,
    }
    Object { p50: *p50, p90: *p90, p99: *p99 }.serialize(serializer)
}

impl Spread {
    pub(crate) fn new() -> Self {
        let times = Histogram::new_with_max(LONGEST_US, DIGITS).expect("the bounds are in order");
        Self { times, never: 0 }
    }

    /// Adds a time; more than an hour counts as one.
    pub(crate) fn add(&mut self, time: Duration) {
        self.times.saturating_record(u64::try_from(time.as_micros()).unwrap_or(u64::MAX));
    }

    /// Adds one that never ended.
    pub(crate) const fn add_never(&mut self) {
        self.never += 1;
    }

    /// Returns a quantile by nearest rank, or `None` if nothing was added.
    pub(crate) fn quantile(&self, percent: u64) -> Option<Quantile> {
        let rank = ((self.times.len() + self.never) * percent).div_ceil(100);
        if rank == 0 {
            return None;
        }
        if rank > self.times.len() {
            return Some(Quantile::Never);
        }
        // Half a rank less, so that rounding does not lead to the next.
        #[expect(clippy::cast_precision_loss, reason = "a day at 1000 Hz has 2^27 slots")]
        let share = (rank as f64 - 0.5) / self.times.len() as f64;
        Some(Quantile::Exactly(Duration::from_micros(self.times.value_at_quantile(share))))
    }

    /// Times in milliseconds and how many percent took no longer, in that many steps.
    #[expect(clippy::cast_precision_loss, reason = "microseconds of an hour; some hundreds")]
    pub(crate) fn curve(&self, steps: u64) -> Vec<(f64, f64)> {
        let steps = if self.times.is_empty() { 0..0 } else { 0..steps + 1 };
        let last = steps.end as f64 - 1.0;
        let point = |step| {
            let share = step as f64 / last;
            (self.times.value_at_quantile(share) as f64 / 1000.0, share * 100.0)
        };
        steps.map(point).collect()
    }

    pub(crate) fn reported(&self) -> Percentiles {
        let [p50, p90, p99, max] = [50, 90, 99, 100].map(|percent| self.quantile(percent));
        Percentiles { p50, p90, p99, max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_ranks_to_a_ten_thousandth() {
        let mut spread = Spread::new();
        assert_eq!(spread.quantile(50), None);
        (1..=200).for_each(|ms| spread.add(Duration::from_millis(ms)));
        for (percent, expected) in [(50, 100.0), (90, 180.0), (99, 198.0), (100, 200.0)] {
            let Some(Quantile::Exactly(found)) = spread.quantile(percent) else { panic!() };
            assert!((found.as_secs_f64() * 1e3 / expected - 1.0).abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn what_never_ended_comes_last() {
        let mut spread = Spread::new();
        spread.add(Duration::from_millis(1));
        spread.add_never();
        let found = [50, 51].map(|percent| spread.quantile(percent));
        assert_eq!(
            found,
            [Some(Quantile::Exactly(Duration::from_millis(1))), Some(Quantile::Never)]
        );
    }

    #[test]
    fn curve_leads_from_least_to_greatest() {
        let mut spread = Spread::new();
        assert!(spread.curve(4).is_empty());
        (1..=100).for_each(|ms| spread.add(Duration::from_millis(ms)));
        // More than an hour counts as one.
        spread.add(Duration::from_secs(86_400));
        let expected = [(1.0, 0.0), (26.0, 25.0), (51.0, 50.0), (76.0, 75.0), (3_600_000.0, 100.0)];
        let curve = spread.curve(4);
        assert_eq!(curve.len(), expected.len());
        for ((time, share), (expected_time, expected_share)) in curve.into_iter().zip(expected) {
            assert!((time / expected_time - 1.0).abs() < 1e-3, "{time} for {expected_time}");
            assert!((share - expected_share).abs() < 1e-9, "{share} for {expected_share}");
        }
    }
}
