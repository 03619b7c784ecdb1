//! Finds how much a recording holds, and within which bounds.

use std::ops::Range;
use std::time::Duration;

use crate::probe::figures::Spread;
use crate::probe::recording::PlotRow;
use crate::probe::summary::quantile;
use crate::table::counted;
use fuseline_evaluation::paper_round_trips;

/// The extent of a recording, from a first pass.
pub(crate) struct Extent {
    pub(crate) rows: u64,
    pub(crate) answered: u64,
    pub(crate) lost: u64,
    pub(crate) pauses: u64,
    /// The instants at which the first and the last request were sent, in seconds.
    pub(crate) sent: Option<(f64, f64)>,
    pub(crate) round_trips: Spread,
    /// The least and the greatest round trip, in milliseconds.
    ends: Option<(f64, f64)>,
}

impl Default for Extent {
    fn default() -> Self {
        let round_trips = Spread::new();
        let (rows, answered, lost, pauses) = (0, 0, 0, 0);
        Self { rows, answered, lost, pauses, sent: None, round_trips, ends: None }
    }
}

impl Extent {
    pub(crate) fn add(&mut self, plot_row: &PlotRow) {
        self.rows += 1;
        self.sent = Some((self.sent.map_or(plot_row.sent, |(first, _)| first), plot_row.sent));
        match plot_row.round_trip {
            Some(ms) => {
                self.answered += 1;
                self.round_trips.add(Duration::from_secs_f64(ms / 1000.0));
                let (least, greatest) = self.ends.unwrap_or((ms, ms));
                self.ends = Some((least.min(ms), greatest.max(ms)));
            }
            None if plot_row.is_pause => self.pauses += 1,
            None => self.lost += 1,
        }
    }

    /// Powers of ten around all round trips and the paper's, in milliseconds, with room for words.
    pub(crate) fn milliseconds(&self) -> Range<f64> {
        let paper = paper_round_trips();
        let (least, greatest) = self.ends.unwrap_or((paper.p50, paper.p99));
        // Nothing is distinguished below 0.01 ms.
        let least = (least.min(paper.p50) / 3.0).max(0.01);
        let greatest = greatest.max(paper.p99) * 3.0;
        10_f64.powf(least.log10().floor())..10_f64.powf(greatest.log10().ceil())
    }

    pub(crate) fn reported(&self) -> String {
        let [p50, p90, p99] =
            [50, 90, 99].map(|percent| quantile(self.round_trips.quantile(percent)));
        format!(
            "{}, {} failed or unanswered, {}; p50 {p50}, p90 {p90}, p99 {p99}",
            counted(self.answered, "answer"),
            self.lost,
            counted(self.pauses, "pause"),
        )
    }
}
