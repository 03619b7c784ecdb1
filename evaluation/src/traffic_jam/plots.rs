//! Draws the table, and the deadlines that give it.

use std::time::Duration;

use plotters::prelude::*;
use rayon::prelude::*;

use crate::approach::{Approach, Vehicle};
use crate::paper::PAPER;
use crate::plot::{Axes, ChartLine, DRAWN, Plot, TextLine, Theme, canvas};
use crate::reaction;
use crate::traffic_jam::TrafficJamResult;
use crate::traffic_jam::cells::{Cell, CellParameters, Colour, DeadlineChoice, Jam};
use crate::traffic_jam::text::word;

/// Deadlines up to here are shown, in s.
const LONGEST: f64 = 3.5;
/// The step between the deadlines that are tried, in s.
const STEP: f64 = 0.02;
/// The number of steps to the longest one.
const STEPS: u32 = 175;

pub(crate) fn plots(result: &TrafficJamResult, jam: &Jam) -> Vec<Plot> {
    let mut plots = vec![table(result)];
    plots.extend(deadlines(jam));
    plots
}

fn table(result: &TrafficJamResult) -> Plot {
    let (responses, cells) = (result.parameters.response.clone(), result.cells.clone());
    let marked: Vec<bool> = cells.iter().map(|cell| result.is_harder(cell)).collect();
    let caption = "Where the vehicle stops, a cell has the least gap that is left, in metres; where it does not, the \
                   greatest speed at impact. A cross in a corner marks a cell that differs from the paper's; a star one in which ours hits harder \
                   than local alone, since it waited for a cloud that came too late.";
    Plot::new("table", caption, move |theme| {
        let rows: Vec<&[Cell]> = cells
            .chunk_by(|one, next| (one.speed, one.approach) == (next.speed, next.approach))
            .collect();
        let (wide, high) = (92, 34);
        let height = u32::try_from(rows.len()).unwrap_or(u32::MAX) * 36 + 150;
        let width = u32::try_from(responses.len()).unwrap_or(u32::MAX) * 92 + 210;
        let below = "Green: the least gap that is left. Red: the greatest speed at impact.";
        let words = ("Traffic jam", below);
        canvas(theme, (width.max(520), height), words, |canvas| {
            let soft = TextLine::new(13.0, theme.soft);
            soft.centred().put(
                canvas,
                "response of the cloud, s",
                (160 + wide * i32::try_from(responses.len()).unwrap_or(0) / 2, 84),
            );
            for (column, response) in (0..).zip(&responses) {
                soft.centred().put(
                    canvas,
                    &response.to_string(),
                    (160 + wide * column + wide / 2, 106),
                );
            }
            let (mut y, mut before, mut marks) = (124, None, marked.iter());
            for row in &rows {
                let [first, ..] = row else { continue };
                if before != Some(first.speed) {
                    y += if before.is_some() { 8 } else { 0 };
                    let speed = format!("{} m/s", first.speed);
                    TextLine::new(14.0, theme.ink).bold().put(
                        canvas,
                        &speed,
                        (24, y + high / 2 - 1),
                    );
                    before = Some(first.speed);
                }
                TextLine::new(14.0, theme.ink).put(
                    canvas,
                    word(first.approach),
                    (102, y + high / 2 - 1),
                );
                for (column, cell) in (0..).zip(*row) {
                    let x = 160 + wide * column;
                    let place = [(x, y), (x + wide - 3, y + high - 3)];
                    draw(theme, canvas, (cell, marks.next() == Some(&true)), place);
                }
                y += high;
            }
        })
    })
}

/// Draws a cell, with a star if it is harder than local's.
fn draw(
    theme: &Theme,
    canvas: &crate::plot::Canvas<'_>,
    (cell, is_harder): (&Cell, bool),
    place: [(i32, i32); 2],
) {
    let [(left, top), (right, bottom)] = place;
    let (colour, mut text) = match (cell.outcome, cell.gap, cell.impact) {
        (Colour::Avoids, Some([gap, _]), _) => (theme.good, format!("{gap:.1} m")),
        (Colour::Mixed, _, Some([_, impact])) => (theme.series[2], format!("~ {impact:.1} m/s")),
        (_, _, Some([_, impact])) => (theme.bad, format!("{impact:.1} m/s")),
        (_, _, None) => (theme.soft, String::new()),
    };
    if is_harder {
        text.push_str(" *");
    }
    canvas.draw(&Rectangle::new(place, colour.filled())).expect(DRAWN);
    let middle = (i32::midpoint(left, right), i32::midpoint(top, bottom));
    TextLine::new(13.0, theme.on_colour).centred().put(canvas, &text, middle);
    if !cell.is_as_in_paper() {
        let cross = TextLine::new(13.0, theme.on_colour).bold().centred();
        cross.put(canvas, "×", (right - 8, top + 8));
    }
}

/// Draws the deadlines, or returns `None` if the guard's figures make no sense.
fn deadlines(jam: &Jam) -> Option<Plot> {
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
