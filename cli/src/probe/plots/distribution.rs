//! Draws how many answers took how long.

use std::time::Duration;

use plotters::element::Circle;
use plotters::style::{Color, RGBColor};

use crate::duration::{ms, short};
use crate::probe::plots::extent::Extent;
use fuseline_evaluation::plot::{
    Axes, ChartLine, DRAWN, Plot, TextLine, Theme, canvas, logarithmic,
};
use fuseline_evaluation::{TripQuantiles, paper_round_trips};
use fuseline_report::Quantile;

/// The resolution, as a share of all answers.
const STEPS: u64 = 500;

pub(crate) fn plot(extent: &Extent, about: String) -> Plot {
    let curve = extent.round_trips.curve(STEPS);
    let marks: Vec<(f64, f64)> = [50_u8, 90, 99]
        .into_iter()
        .filter_map(|percent| match extent.round_trips.quantile(percent.into())? {
            Quantile::Exactly(at) => Some((ms(at), f64::from(percent))),
            Quantile::AtLeast(_) | Quantile::Never => None,
        })
        .collect();
    let TripQuantiles { p50, p90, p99 } = paper_round_trips();
    let paper = vec![(p50, 50.0), (p90, 90.0), (p99, 99.0)];
    let x = extent.milliseconds();
    let caption = "How many of the answers took no longer, with the quantiles p50, p90 and p99, beside those of \
        the paper's 5G drive, which are joined by straight lines.";
    Plot::new("distribution", caption, move |theme| {
        canvas(
            theme,
            (860, 500),
            ("Network probe: distribution of round trips", &about),
            |canvas| {
                let lines = [
                    line("this network", theme.series[1], false, &curve),
                    line("the paper's 5G drive", theme.series[2], true, &paper),
                ];
                ChartLine::keys(&lines, theme, canvas, (82, 84));
                let area = canvas.margin(104, 12, 20, 24);
                let axes = Axes {
                    x: x.clone(),
                    y: 0.0..100.0,
                    x_name: "round trip, ms",
                    y_name: "answers, %",
                };
                let mut chart = axes.scaled(theme, &area, (logarithmic(&x), axes.y.clone()));
                for line in &lines {
                    line.draw(&mut chart, &axes);
                }
                for (points, others, colour) in
                    [(&marks, &paper, theme.series[1]), (&paper, &marks, theme.series[2])]
                {
                    let dots = points.iter().map(|at| Circle::new(*at, 5, colour.filled()));
                    chart.draw_series(dots).expect(DRAWN);
                    for (index, at) in points.iter().enumerate() {
                        let is_left = others.get(index).is_none_or(|other| *at < *other);
                        let (x, y) = chart.backend_coord(at);
                        let x = if is_left { x - 10 } else { x + 10 };
                        let name = ["p50", "p90", "p99"][index];
                        write(theme, canvas, (name, at.0, is_left), (x, y));
                    }
                }
            },
        )
    })
}

fn write(
    theme: &Theme,
    canvas: &fuseline_evaluation::plot::Canvas<'_>,
    (name, ms, is_left): (&str, f64, bool),
    at: (i32, i32),
) {
    let label = TextLine::new(13.0, theme.ink).bold();
    let label = if is_left { label.right() } else { label };
    label.put(canvas, &format!("{name} {}", short(Duration::from_secs_f64(ms / 1e3))), at);
}

fn line(name: &str, colour: RGBColor, is_dashed: bool, points: &[(f64, f64)]) -> ChartLine {
    ChartLine { name: name.to_owned(), colour, width: 2, is_dashed, points: points.to_vec() }
}
