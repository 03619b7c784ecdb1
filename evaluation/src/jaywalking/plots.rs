//! The greatest speed over the response.

use plotters::prelude::*;
use rayon::prelude::*;

use crate::jaywalking::geometry::{Manoeuvre, SwerveGeometry};
use crate::jaywalking::{Greatest, JaywalkingResult};
use crate::plot::{Axes, ChartLine, DRAWN, Plot, TextLine, canvas};
use crate::reaction;

/// Responses that are shown, in fiftieths of a second.
const SHOWN: std::ops::RangeInclusive<u32> = 0..=65;

pub(crate) fn plots(result: &JaywalkingResult, geometry: SwerveGeometry) -> Vec<Plot> {
    let line = |manoeuvre: Manoeuvre| -> Vec<(f64, f64)> {
        let responses = SHOWN.into_par_iter().map(|fiftieths| f64::from(fiftieths) / 50.0);
        let points = responses.map(|at| (at, geometry.greatest(manoeuvre, at)));
        points.filter_map(|(at, speed)| Some((at, speed?))).collect()
    };
    let (swerve, brake) = (line(Manoeuvre::Swerve), line(Manoeuvre::Brake));
    let marks: Vec<(f64, f64)> =
        result.greatest.iter().filter_map(|row| Some((row.response, row.swerve?))).collect();
    let lower: Vec<(f64, f64)> =
        result.greatest.iter().filter_map(|row| Some((row.response, row.brake?))).collect();
    let ends = marks.iter().chain(&lower).chain(&brake).map(|(_, speed)| *speed);
    let top = (ends.fold(1.0, f64::max) * 1.5).min(150.0);
    let caption = "The greatest speed up to which nobody is touched, by how long it takes until the car acts. Dots: the \
                   planner on board and a cached plan. A line that leaves at the top may come to an end there: the car \
                   swerves so early that it is past at any speed.";
    let of = |row: Option<&Greatest>| row.map_or(0.0, |row| row.response);
    let (first, last) = (of(result.greatest.first()), of(result.greatest.last()));
    let below = format!(
        "Greatest speed without contact. Dots: planner on board, {first} s; cached plan, {last} s"
    );
    vec![Plot::new("greatest-speed", caption, move |theme| {
        let words = ("Person jaywalking", &*below);
        canvas(theme, (760, 470), words, |canvas| {
            let of = |name: &str, series: usize, points: &Vec<(f64, f64)>| ChartLine {
                name: name.to_owned(),
                colour: theme.series[series],
                width: 3,
                is_dashed: false,
                points: points.clone(),
            };
            let lines = [of("swerve", 1, &swerve), of("brake", 2, &brake)];
            let reactions = reaction::lines(theme, true, &(0.0..top.ceil()));
            let lines: Vec<ChartLine> = lines.into_iter().chain(reactions).collect();
            ChartLine::keys(&lines, theme, canvas, (82, 84));
            let area = canvas.margin(104, 12, 20, 24);
            let axes = Axes {
                x: 0.0..1.3,
                y: 0.0..top.ceil(),
                x_name: "response, s",
                y_name: "speed, m/s",
            };
            let mut chart = axes.chart(theme, &area);
            for line in &lines {
                line.draw(&mut chart, &axes);
            }
            for (marks, others, colour) in
                [(&marks, &lower, theme.series[1]), (&lower, &marks, theme.series[2])]
            {
                let dots = marks.iter().map(|at| Circle::new(*at, 5, colour.filled()));
                chart.draw_series(dots).expect(DRAWN);
                let style = TextLine::new(12.0, theme.ink).centred().style();
                let words = marks.iter().map(|mark| {
                    let beside = if is_lower(*mark, others) { 16 } else { -14 };
                    let text = format!("{:.2}", mark.1);
                    EmptyElement::at(*mark) + Text::new(text, (0, beside), style.clone())
                });
                chart.draw_series(words).expect(DRAWN);
            }
        })
    })]
}

/// Returns `true` if another mark with the same response is above this one. The figure of the lower
/// mark stands below it.
fn is_lower((response, speed): (f64, f64), others: &[(f64, f64)]) -> bool {
    let mut same = others.iter().filter(|(other, _)| other.total_cmp(&response).is_eq());
    same.any(|(_, other)| *other > speed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_stands_on_its_marks_own_side() {
        let (swerve, brake) = ([(0.4, 9.46), (0.5, 8.11)], [(0.4, 9.43), (0.5, 8.88)]);
        assert_eq!(swerve.map(|mark| is_lower(mark, &brake)), [false, true]);
        assert_eq!(brake.map(|mark| is_lower(mark, &swerve)), [true, false]);
    }
}
