//! Finds how much a recording holds, and within which bounds.

use std::ops::Range;
use std::time::Duration;

use fuseline_evaluation::paper_round_trips;
use fuseline_testkit::networks::DriveRow;

use crate::duration::{ms, short};
use crate::percentile::{Spread, shown};
use crate::probe::pace::QUEUED;
use crate::table::counted;

/// The extent of a recording, from a first pass.
pub(crate) struct Extent {
    answered: u64,
    lost: u64,
    pauses: u64,
    /// The instants at which the first and the last request were sent, in seconds.
    pub(crate) sent: Option<(f64, f64)>,
    pub(crate) round_trips: Spread,
    /// The least and the greatest round trip.
    ends: Option<(Duration, Duration)>,
}

impl Default for Extent {
    fn default() -> Self {
        let round_trips = Spread::new();
        let (answered, lost, pauses) = (0, 0, 0);
        Self { answered, lost, pauses, sent: None, round_trips, ends: None }
    }
}

impl Extent {
    pub(crate) fn add(&mut self, row: &DriveRow) {
        self.sent = Some((self.sent.map_or(row.sent, |(first, _)| first), row.sent));
        match row.round_trip {
            Some(round_trip) => {
                self.answered += 1;
                self.round_trips.add(round_trip);
                let (least, greatest) = self.ends.unwrap_or((round_trip, round_trip));
                self.ends = Some((least.min(round_trip), greatest.max(round_trip)));
            }
            None if is_pause(row) => self.pauses += 1,
            None => self.lost += 1,
        }
    }

    /// Powers of ten around all round trips and the paper's, in milliseconds, with room for words.
    pub(crate) fn milliseconds(&self) -> Range<f64> {
        let paper = paper_round_trips();
        let (least, greatest) =
            self.ends.map_or((paper.p50, paper.p99), |(least, greatest)| (ms(least), ms(greatest)));
        // Nothing is distinguished below 0.01 ms.
        let least = (least.min(paper.p50) / 3.0).max(0.01);
        let greatest = greatest.max(paper.p99) * 3.0;
        10_f64.powf(least.log10().floor())..10_f64.powf(greatest.log10().ceil())
    }

    pub(crate) fn reported(&self) -> String {
        let [p50, p90, p99] =
            [50, 90, 99].map(|percent| shown(self.round_trips.quantile(percent), short));
        format!(
            "{}, {} failed or unanswered, {}; p50 {p50}, p90 {p90}, p99 {p99}",
            counted(self.answered, "answer"),
            self.lost,
            counted(self.pauses, "pause"),
        )
    }
}

/// Returns `true` if nothing was sent because a pause began. A request is sent only if no more than
/// [`QUEUED`] are unanswered.
pub(crate) fn is_pause(row: &DriveRow) -> bool {
    row.round_trip.is_none() && row.queued.is_some_and(|queued| queued > QUEUED as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// D11: with 30 unanswered a request was sent, and is lost; with 31 a pause began.
    #[test]
    fn lost_request_is_no_pause() {
        let mut extent = Extent::default();
        for queued in [30, 31] {
            let (at, rates) = (Duration::ZERO, [0; 2]);
            extent.add(&DriveRow { sent: 0.0, at, round_trip: None, rates, queued: Some(queued) });
        }
        assert_eq!((extent.lost, extent.pauses, extent.answered), (1, 1, 0));
    }
}
