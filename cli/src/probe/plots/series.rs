//! Round trips over time, with the pauses.

use std::collections::BTreeSet;
use std::ops::Range;

use plotters::element::{Circle, PathElement, Rectangle};
use plotters::style::Color;

use crate::duration::ms;
use crate::probe::plots::extent::{Extent, is_pause};
use fuseline_evaluation::plot::{Axes, Canvas, DRAWN, Plot, TextLine, Theme, canvas, logarithmic};
use fuseline_testkit::networks::DriveRow;

const SIZE: (u32, u32) = (860, 500);
/// No more is distinguished: about a unit of the drawing, in parts of the chart.
const ACROSS: f64 = 760.0;
const UP: f64 = 350.0;

/// The visible part of a recording, at the resolution of the drawing.
#[derive(Clone)]
pub(crate) struct Series {
    seconds: Range<f64>,
    milliseconds: Range<f64>,
    /// Answers by place.
    dots: BTreeSet<(i32, i32)>,
    /// Requests without an answer.
    lost: BTreeSet<i32>,
    /// From when until when nothing was sent, in seconds.
    pauses: Vec<(f64, f64)>,
    is_paused: bool,
}

impl Series {
    pub(crate) fn new(extent: &Extent) -> Self {
        let (first, last) = extent.sent.unwrap_or((0.0, 1.0));
        Self {
            seconds: first..last.max(first + 0.1),
            milliseconds: extent.milliseconds(),
            dots: BTreeSet::new(),
            lost: BTreeSet::new(),
            pauses: Vec::new(),
            is_paused: false,
        }
    }

    pub(crate) fn add(&mut self, row: &DriveRow) {
        let unit = (self.seconds.end - self.seconds.start) / ACROSS;
        if self.is_paused
            && let Some(pause) = self.pauses.last_mut()
        {
            pause.1 = row.sent;
        }
        self.is_paused = is_pause(row);
        let x = cell((row.sent - self.seconds.start) / unit);
        match row.round_trip {
            Some(round_trip) => {
                let ms = ms(round_trip);
                let up = (ms.max(self.milliseconds.start) / self.milliseconds.start).log10();
                self.dots.insert((x, cell(up / self.decades() * UP)));
            }
            None if !self.is_paused => drop(self.lost.insert(x)),
            None => match self.pauses.last_mut() {
                // They are drawn as one, so that there are no more than the drawing shows.
                Some(pause) if row.sent - pause.1 < unit / 2.0 => pause.1 = row.sent,
                Some(_) | None => self.pauses.push((row.sent, row.sent)),
            },
        }
    }

    pub(crate) fn plot(self, about: String) -> Plot {
        let caption = "Round trips over the time of sending; a band is a pause, in which nothing was sent. \
            Marks at the top are requests that failed or stayed unanswered.";
        Plot::new("round-trips", caption, move |theme| {
            canvas(theme, SIZE, ("Network probe: round trips over time", &about), |canvas| {
                Self::keys(theme, canvas);
                self.draw(theme, &canvas.margin(104, 12, 20, 24));
            })
        })
    }

    fn draw(&self, theme: &Theme, area: &Canvas<'_>) {
        let (x, y) = (self.seconds.clone(), self.milliseconds.clone());
        let axes = Axes {
            x: x.clone(),
            y: y.clone(),
            x_name: "time of sending, s",
            y_name: "round trip, ms",
        };
        let mut chart = axes.scaled(theme, area, (x.clone(), logarithmic(&y)));
        let unit = (x.end - x.start) / ACROSS;
        chart
            .draw_series(self.pauses.iter().map(|(from, to)| {
                // Never too narrow to be seen.
                let to = to.max(from + 2.0 * unit).min(x.end);
                let from = from.min(x.end - 2.0 * unit);
                Rectangle::new([(from, y.start), (to, y.end)], theme.bad.mix(0.22).filled())
            }))
            .expect(DRAWN);
        let dot = theme.series[1].filled();
        chart
            .draw_series(self.dots.iter().map(|(across, up)| {
                let ms = y.start * 10_f64.powf(f64::from(*up) / UP * self.decades());
                Circle::new((x.start + f64::from(*across) * unit, ms), 2, dot)
            }))
            .expect(DRAWN);
        let low = y.end / 10_f64.powf(self.decades() * 8.0 / UP);
        chart
            .draw_series(self.lost.iter().map(|across| {
                let at = x.start + f64::from(*across) * unit;
                PathElement::new(vec![(at, low), (at, y.end)], theme.bad.stroke_width(2))
            }))
            .expect(DRAWN);
    }

    fn keys(theme: &Theme, canvas: &Canvas<'_>) {
        let label = TextLine::new(13.0, theme.ink);
        canvas.draw(&Circle::new((92, 84), 4, theme.series[1].filled())).expect(DRAWN);
        label.put(canvas, "round trip", (110, 84));
        let style = theme.bad.mix(0.22).filled();
        canvas.draw(&Rectangle::new([(204, 76), (225, 92)], style)).expect(DRAWN);
        label.put(canvas, "pause", (232, 84));
        let mark = PathElement::new(vec![(306, 79), (306, 89)], theme.bad.stroke_width(2));
        canvas.draw(&mark).expect(DRAWN);
        label.put(canvas, "failed or unanswered", (318, 84));
    }

    fn decades(&self) -> f64 {
        (self.milliseconds.end / self.milliseconds.start).log10()
    }
}

#[expect(clippy::cast_possible_truncation, reason = "some hundreds")]
fn cell(at: f64) -> i32 {
    at.round() as i32
}
