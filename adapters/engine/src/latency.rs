//! The time that operators take, for the reserve of the operators upstream (E3).

use std::collections::VecDeque;
use std::iter::Sum;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::lock::lock;

/// The time that an operator takes for a message, on board alone and with its clouds. It is stated,
/// or measured while the operator runs.
///
/// The operator records its messages in it, and the operators upstream keep that much of an
/// end-to-end deadline in [reserve](Reserve). Clones share the measurements.
///
/// ```
/// use fuseline_engine::{Latency, Reserve};
/// use std::time::Duration;
///
/// let planner = Latency::stated(Duration::from_millis(30));
/// let control = Latency::stated_with_clouds(Duration::from_millis(5), Duration::from_millis(20));
/// let reserve: Reserve = [&planner, &control].into_iter().sum();
/// assert_eq!(reserve.on_board(), Duration::from_millis(35));
/// assert_eq!(reserve.with_clouds(), Duration::from_millis(50));
/// ```
#[derive(Clone, Debug)]
pub struct Latency(LatencyKind);

#[derive(Clone, Debug)]
enum LatencyKind {
    Stated(Reserve),
    Measured { percent: u8, at_first: Duration, last: Arc<Mutex<Measurements>> },
}

/// The part of an end-to-end deadline that is kept for the operators downstream. It is the sum of
/// their latencies.
///
/// Local's time ends before what the others need [on board](Self::on_board). Requests end before
/// what the others take [with their clouds](Self::with_clouds). So a cloud downstream never takes
/// time from local upstream (E11).
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Reserve {
    on_board: Duration,
    with_clouds: Duration,
}

#[derive(Debug, Default)]
struct Measurements {
    local: LastLatencies,
    messages: LastLatencies,
}

/// The last [`REMEMBERED`] times, in order and sorted.
#[derive(Debug, Default)]
struct LastLatencies {
    in_order: VecDeque<Duration>,
    sorted: Vec<Duration>,
}

/// The number of times that are remembered.
const REMEMBERED: usize = 256;
/// The number of times that must be recorded before they are used.
const ENOUGH: usize = 16;

impl Reserve {
    /// Returns a reserve of `on_board` for local computations, and of the greater of `on_board` and
    /// `with_clouds` for requests.
    #[must_use]
    pub const fn new(on_board: Duration, with_clouds: Duration) -> Self {
        let is_less = with_clouds.as_nanos() < on_board.as_nanos();
        Self { on_board, with_clouds: if is_less { on_board } else { with_clouds } }
    }

    /// Returns how long the operators downstream need to compute on board.
    #[must_use]
    pub const fn on_board(&self) -> Duration {
        self.on_board
    }

    /// Returns how long the operators downstream take if they wait for their clouds; at least
    /// [`on_board`](Self::on_board).
    #[must_use]
    pub const fn with_clouds(&self) -> Duration {
        self.with_clouds
    }
}

/// Adds up the latencies, saturating.
impl<'a> Sum<&'a Latency> for Reserve {
    fn sum<I: Iterator<Item = &'a Latency>>(latencies: I) -> Self {
        latencies.map(Latency::estimate).fold(Self::default(), |sum, one| {
            let on_board = sum.on_board.saturating_add(one.on_board);
            Self::new(on_board, sum.with_clouds.saturating_add(one.with_clouds))
        })
    }
}

impl Latency {
    /// States one time that the operator takes, on board and with its clouds.
    #[must_use]
    pub const fn stated(latency: Duration) -> Self {
        Self::stated_with_clouds(latency, latency)
    }

    /// States how long the operator takes on board, and how long if it waits for its clouds.
    #[must_use]
    pub const fn stated_with_clouds(on_board: Duration, with_clouds: Duration) -> Self {
        Self(LatencyKind::Stated(Reserve::new(on_board, with_clouds)))
    }

    /// Measures the given percentile, 1 to 100, of local's last 256 computations and of the last
    /// 256 messages. Each of the two is `at_first` until 16 times were recorded for it.
    #[must_use]
    pub fn measured(percent: u8, at_first: Duration) -> Self {
        Self(LatencyKind::Measured { percent, at_first, last: Arc::default() })
    }

    /// Records how long a message took until its last output. Does nothing if the latency is
    /// stated.
    pub fn record(&self, took: Duration) {
        self.push(|last| &mut last.messages, took);
    }

    /// Records how long local computed a result, whatever was sent for its message. Does nothing if
    /// the latency is stated.
    ///
    /// The wait for a free worker does not count: clouds upstream may cause it, and it would take
    /// local's time there.
    pub fn record_local(&self, took: Duration) {
        self.push(|last| &mut last.local, took);
    }

    /// Returns the current latency.
    #[must_use]
    pub fn estimate(&self) -> Reserve {
        match &self.0 {
            LatencyKind::Stated(reserve) => *reserve,
            LatencyKind::Measured { percent, at_first, last } => {
                let last = lock(last);
                let of =
                    |last: &LastLatencies| last.percentile((*percent).into()).unwrap_or(*at_first);
                Reserve::new(of(&last.local), of(&last.messages))
            }
        }
    }

    fn push(&self, of: fn(&mut Measurements) -> &mut LastLatencies, took: Duration) {
        if let LatencyKind::Measured { last, .. } = &self.0 {
            of(&mut lock(last)).push(took);
        }
    }
}

/// Two measured latencies are equal if they share their measurements.
impl PartialEq for Latency {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (LatencyKind::Stated(one), LatencyKind::Stated(other)) => one == other,
            (
                LatencyKind::Measured { last: one, .. },
                LatencyKind::Measured { last: other, .. },
            ) => Arc::ptr_eq(one, other),
            (LatencyKind::Stated(_), LatencyKind::Measured { .. })
            | (LatencyKind::Measured { .. }, LatencyKind::Stated(_)) => false,
        }
    }
}

impl LastLatencies {
    fn push(&mut self, took: Duration) {
        if self.in_order.len() == REMEMBERED
            && let Some(oldest) = self.in_order.pop_front()
            && let Ok(index) = self.sorted.binary_search(&oldest)
        {
            self.sorted.remove(index);
        }
        self.in_order.push_back(took);
        let index = self.sorted.partition_point(|other| *other < took);
        self.sorted.insert(index, took);
    }

    fn percentile(&self, percent: usize) -> Option<Duration> {
        if self.sorted.len() < ENOUGH {
            return None;
        }
        let count = (self.sorted.len() * percent).div_ceil(100);
        self.sorted.get(count.clamp(1, self.sorted.len()) - 1).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn with_clouds(latency: &Latency) -> Duration {
        latency.estimate().with_clouds()
    }

    #[test]
    fn uses_a_percentile_once_enough_are_measured() {
        let latency = Latency::measured(90, 70 * MS);
        let operator = latency.clone();
        (1..16).for_each(|ms| operator.record(ms * MS));
        assert_eq!(with_clouds(&latency), 70 * MS);
        (1..=16).for_each(|_| operator.record_local(2 * MS));
        (16..=20).for_each(|ms| operator.record(ms * MS));
        assert_eq!(latency.estimate(), Reserve::new(2 * MS, 18 * MS));
        // Older times are forgotten (E8).
        (0..256).for_each(|_| operator.record(5 * MS));
        assert_eq!(with_clouds(&latency), 5 * MS);
    }

    #[test]
    fn clouds_downstream_are_kept_from_requests_only() {
        let latency = Latency::measured(100, MS);
        (0..16).for_each(|_| latency.record_local(3 * MS));
        (0..16).for_each(|_| latency.record(40 * MS));
        let reserve: Reserve = [latency, Latency::stated(5 * MS)].iter().sum();
        assert_eq!((reserve.on_board(), reserve.with_clouds()), (8 * MS, 45 * MS));
    }

    #[test]
    fn with_clouds_is_at_least_on_board() {
        let latency = Latency::stated_with_clouds(9 * MS, 2 * MS);
        assert_eq!(with_clouds(&latency), 9 * MS);
    }

    #[test]
    fn any_number_is_a_percentile() {
        for percent in [0, 100, 255] {
            let latency = Latency::measured(percent, MS);
            (0..16).for_each(|_| latency.record(3 * MS));
            assert_eq!(with_clouds(&latency), 3 * MS);
        }
    }

    #[test]
    fn a_stated_latency_stays_as_it_is() {
        let latency = Latency::stated(MS);
        latency.record(9 * MS);
        latency.record_local(9 * MS);
        assert_eq!(latency.estimate(), Reserve::new(MS, MS));
    }
}
