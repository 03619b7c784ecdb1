//! Draws human reaction times as lines across charts.

use std::ops::Range;

use crate::paper::PAPER;
use crate::plot::{ChartLine, Theme};

/// Returns lines at the least and the greatest reaction time that the paper cites: upright at an x,
/// or level at a y, between two ends.
pub(crate) fn lines(theme: &Theme, is_upright: bool, ends: &Range<f64>) -> [ChartLine; 2] {
    PAPER.human_reaction_s.map(|at| {
        let point = |other: f64| if is_upright { (at, other) } else { (other, at) };
        ChartLine {
            name: format!("human reaction, {at} s"),
            colour: theme.soft,
            width: 1,
            is_dashed: true,
            points: vec![point(ends.start), point(ends.end)],
        }
    })
}
