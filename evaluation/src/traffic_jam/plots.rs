//! Draws the deadlines that give the table.

use std::time::Duration;

use plotters::prelude::*;
use rayon::prelude::*;

use crate::approach::{Approach, Vehicle};
use crate::paper::PAPER;
use crate::plot::{Axes, ChartLine, DRAWN, Plot, TextLine, canvas};
use crate::reaction;
use crate::traffic_jam::cells::{CellParameters, DeadlineChoice, Jam};

/// Deadlines up to here are shown, in s.
const LONGEST: f64 = 3.5;
/// The step between the deadlines that are tried, in s.
const STEP: f64 = 0.02;
/// The number of steps to the longest one.
const STEPS: u32 = 175;

/// Draws the deadlines, or returns `None` if the guard's figures make no sense.
pub(crate) fn deadlines(jam: &Jam) -> Option<Plot> {
    let vehicle = jam.vehicle;
    let guard = Jam::new(vehicle, DeadlineChoice::Guard).ok()?;
    let speeds: Vec<f64> = (0..=400).map(|step| 10.0 + f64::from(step) * 0.04).collect();
    let budget = |range: f64, period: f64, speed: f64| {
        let delays = vehicle.brake_delay + f64::from(vehicle.frames) * period;
        let range = range.min(vehicle.reveal.unwrap_or(f64::INFINITY));
        range / speed - speed / (2.0 * vehicle.deceleration) - delays
    };
    let line = |of: &dyn Fn(f64) -> f64| -> Vec<(f64, f64)> {
        smooth(&speeds.iter().map(|speed| (*speed, of(*speed))).collect::<Vec<_>>())
    };
    let local = line(&|speed| budget(vehicle.range_local, vehicle.period_local(), speed));
    let cloud = line(&|speed| budget(vehicle.range_cloud, vehicle.period(), speed));
    let chosen = line(&|speed| guard.deadline(speed, 0.0).as_secs_f64());
    let bars: Vec<(f64, Vec<[f64; 2]>)> = PAPER
        .traffic_jam
        .speeds()
        .into_iter()
        .map(|speed| (speed, allowed(vehicle, speed)))
        .collect();
    let caption = "Dashed: until when a result is early enough to stop. The guard waits as long as local alone would still \
                   stop; where local would not, as long as the cloud might. Green: the constant deadlines that give the \
                   paper's row of ours at that speed. No single deadline is green at all five.";
    Some(Plot::new("deadlines", caption, move |theme| {
        let words =
            ("Which deadline gives the table", "Seconds after a frame's capture, over the speed");
        canvas(theme, (860, 520), words, |canvas| {
            let of =
                |name: &str, series: usize, width, is_dashed, points: &Vec<(f64, f64)>| ChartLine {
                    name: name.to_owned(),
                    colour: theme.series[series],
                    width,
                    is_dashed,
                    points: points.clone(),
                };
            let lines = [
                of("local is early enough until", 0, 2, true, &local),
                of("the cloud, until", 1, 2, true, &cloud),
                of("deadline of the guard", 2, 3, false, &chosen),
            ];
            ChartLine::keys(&lines, theme, canvas, (82, 84));
            let area = canvas.margin(104, 12, 20, 24);
            let axes = Axes {
                x: 10.0..26.0,
                y: 0.0..LONGEST,
                x_name: "speed, m/s",
                y_name: "deadline, s",
            };
            let mut chart = axes.chart(theme, &area);
            for (speed, bars) in &bars {
                let bar = |[from, to]: &[f64; 2]| {
                    let corners = [(speed - 0.17, *from), (speed + 0.17, *to)];
                    Rectangle::new(corners, theme.good.mix(0.5).filled())
                };
                chart.draw_series(bars.iter().map(bar)).expect(DRAWN);
            }
            let reactions = reaction::lines(theme, false, &axes.x);
            for line in lines.iter().chain(&reactions) {
                line.draw(&mut chart, &axes);
            }
            let word = TextLine::new(12.0, theme.soft).style();
            let words = reactions.iter().map(|line| {
                let at = line.points.first().copied().unwrap_or_default();
                EmptyElement::at(at) + Text::new(line.name.clone(), (6, -14), word.clone())
            });
            chart.draw_series(words).expect(DRAWN);
            let key = Rectangle::new([(636, 78), (648, 90)], theme.good.mix(0.5).filled());
            canvas.draw(&key).expect(DRAWN);
            TextLine::new(13.0, theme.ink).put(canvas, "gives the paper's row", (655, 84));
        })
    }))
}

/// Keeps every eighth point and both sides of each jump. The drawing rounds points to whole units,
/// which shows in short lines.
fn smooth(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let is_jump = |one: usize, other: usize| {
        let [one, other] = [one, other].map(|place| points.get(place));
        one.zip(other).is_some_and(|(one, other)| (one.1 - other.1).abs() > 0.1)
    };
    let is_kept = |place: usize| {
        place.is_multiple_of(8)
            || is_jump(place, place + 1)
            || is_jump(place, place.wrapping_sub(1))
    };
    (0..points.len()).filter(|place| is_kept(*place)).map(|place| points[place]).collect()
}

/// Returns the constant deadlines with which the drives at a speed end as in the paper's row of
/// *ours*.
fn allowed(vehicle: Vehicle, speed: f64) -> Vec<[f64; 2]> {
    let paper = &PAPER.traffic_jam;
    let gives = |deadline: f64| {
        let deadline = DeadlineChoice::Constant(Duration::from_secs_f64(deadline));
        let Ok(jam) = Jam::new(vehicle, deadline) else { return false };
        paper.cloud_response_s.iter().all(|response| {
            let question = CellParameters { speed, approach: Approach::Ours, response: *response };
            let collides = paper.collides(speed, Approach::Ours, *response);
            collides.is_none_or(|collides| jam.is(&question, collides).unwrap_or(false))
        })
    };
    let steps: Vec<f64> = (1..=STEPS).map(|step| f64::from(step) * STEP).collect();
    let marks: Vec<bool> = steps.par_iter().map(|deadline| gives(*deadline)).collect();
    let mut bars: Vec<[f64; 2]> = Vec::new();
    for (deadline, _) in steps.iter().zip(marks).filter(|(_, is_given)| *is_given) {
        match bars.last_mut() {
            Some([_, to]) if deadline - *to < STEP * 1.5 => *to = *deadline,
            _ => bars.push([(deadline - STEP).max(0.0), *deadline]),
        }
    }
    bars
}
