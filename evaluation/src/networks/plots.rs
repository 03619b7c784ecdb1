//! Collisions and impact over the speed.

use crate::networks::policy::ResponsePolicy;
use crate::networks::reports::{mean, name, percent};
use crate::networks::{DriveRow, NetworksResult};
use crate::plot::{Axes, ChartLine, Plot, Theme, canvas};

pub(crate) fn plots(result: &NetworksResult) -> Vec<Plot> {
    let collisions = PlotView {
        name: "collisions",
        words: (
            "Recorded networks: who collides",
            "Starts that end in a collision, mean over the drives",
        ),
        y_name: "collisions, %",
        of: percent,
    };
    let impact = PlotView {
        name: "impact",
        words: (
            "Recorded networks: how hard",
            "Square of the speed at impact, mean over all starts and drives",
        ),
        y_name: "impact energy, m²/s²",
        of: |row| row.energy,
    };
    let cut = "Lines leave the chart at the top where the policies no longer differ. Local leaves \
               it where it is far above the others.";
    vec![
        collisions
            .plot(result, format!("Collisions in % over the speed, policies side by side. {cut}")),
        impact.plot(
            result,
            format!("Mean square of the speed at impact, 0 where there is none. {cut}"),
        ),
    ]
}

struct PlotView {
    name: &'static str,
    words: (&'static str, &'static str),
    y_name: &'static str,
    of: fn(&DriveRow) -> f64,
}

impl PlotView {
    fn plot(self, result: &NetworksResult, caption: String) -> Plot {
        let mut speeds = result.parameters.speed.clone();
        speeds.sort_by(f64::total_cmp);
        let rows = result.rows.clone();
        let of = self.of;
        let curve = move |policy: ResponsePolicy| -> Vec<(f64, f64)> {
            speeds.iter().map(|speed| (*speed, mean(&rows, Some(*speed), policy, of))).collect()
        };
        let curves: Vec<(ResponsePolicy, Vec<(f64, f64)>)> =
            result.parameters.policy.iter().map(|policy| (*policy, curve(*policy))).collect();
        let x = span(&result.parameters.speed);
        let top = top(&curves);
        Plot::new(self.name, caption, move |theme| {
            canvas(theme, (860, 500), self.words, |canvas| {
                let lines: Vec<ChartLine> = curves
                    .iter()
                    .enumerate()
                    .map(|(index, curve)| line(theme, index, curve))
                    .collect();
                ChartLine::keys(&lines, theme, canvas, (82, 84));
                let area = canvas.margin(104, 12, 20, 24);
                let axes =
                    Axes { x: x.clone(), y: 0.0..top, x_name: "speed, m/s", y_name: self.y_name };
                let mut chart = axes.chart(theme, &area);
                for line in &lines {
                    line.draw(&mut chart, &axes);
                }
            })
        })
    }
}

/// Returns the height of the picture. It shows all places at which the policies other than local
/// alone differ from each other.
fn top(curves: &[(ResponsePolicy, Vec<(f64, f64)>)]) -> f64 {
    let others = || curves.iter().filter(|(policy, _)| *policy != ResponsePolicy::Local);
    let at =
        |index: usize| others().filter_map(move |(_, points)| points.get(index)).map(|(_, y)| *y);
    let places = others().map(|(_, points)| points.len()).max().unwrap_or(0);
    let [mut differ, mut highest] = [0.0_f64; 2];
    for index in 0..places {
        let greatest = at(index).fold(0.0, f64::max);
        let least = at(index).fold(f64::INFINITY, f64::min);
        highest = highest.max(greatest);
        // Figures that differ by less than a twentieth count as equal.
        if least < greatest * 0.95 {
            differ = differ.max(greatest);
        }
    }
    let all = curves.iter().flat_map(|(_, points)| points).map(|(_, y)| *y).fold(1.0, f64::max);
    let shown = [differ, highest, all].into_iter().find(|top| *top > 0.0);
    shown.unwrap_or(1.0) * 1.15
}

fn line(
    theme: &Theme,
    index: usize,
    (policy, points): &(ResponsePolicy, Vec<(f64, f64)>),
) -> ChartLine {
    ChartLine {
        name: name(*policy),
        colour: theme.series[index % theme.series.len()],
        width: if *policy == ResponsePolicy::Guard { 4 } else { 2 },
        is_dashed: matches!(policy, ResponsePolicy::Constant(_)),
        points: points.clone(),
    }
}

fn span(figures: &[f64]) -> std::ops::Range<f64> {
    let least = figures.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = figures.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if greatest > least { least..greatest } else { least - 1.0..greatest + 1.0 }
}
