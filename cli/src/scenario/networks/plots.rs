//! Collisions and impact over the speed.

use crate::plot::{Axes, Line, Plot, Theme, sheet};
use crate::scenario::networks::policy::Manner;
use crate::scenario::networks::told::{mean, percent};
use crate::scenario::networks::{Found, Row};

/// Both plots.
pub(crate) fn plots(found: &Found) -> Vec<Plot> {
    let collisions = Sight {
        name: "collisions",
        words: (
            "Recorded networks: who collides",
            "Starts that end in a collision, mean over the drives",
        ),
        y_name: "collisions, %",
        of: percent,
    };
    let impact = Sight {
        name: "impact",
        words: (
            "Recorded networks: how hard",
            "Square of the speed at impact, mean over all starts and drives",
        ),
        y_name: "impact energy, m²/s²",
        of: |row| row.energy,
    };
    let clipped =
        "Local alone leaves the picture at the top, so that the others can be told apart.";
    vec![
        collisions.plot(
            found,
            format!("Collisions in % over the speed, policies side by side. {clipped}"),
        ),
        impact.plot(
            found,
            format!("Mean square of the speed at impact, 0 where there is none. {clipped}"),
        ),
    ]
}

struct Sight {
    name: &'static str,
    words: (&'static str, &'static str),
    y_name: &'static str,
    of: fn(&Row) -> f64,
}

impl Sight {
    fn plot(self, found: &Found, caption: String) -> Plot {
        let mut speeds = found.speeds.clone();
        speeds.sort_by(f64::total_cmp);
        let rows = found.rows.clone();
        let of = self.of;
        let curve = move |policy: Manner| -> Vec<(f64, f64)> {
            speeds.iter().map(|speed| (*speed, mean(&rows, Some(*speed), policy, of))).collect()
        };
        let curves: Vec<(Manner, Vec<(f64, f64)>)> =
            found.policies.iter().map(|policy| (*policy, curve(*policy))).collect();
        let x = span(&found.speeds);
        let highest = |is_meant: fn(Manner) -> bool| {
            let meant = curves.iter().filter(|(policy, _)| is_meant(*policy));
            meant.flat_map(|(_, points)| points).map(|(_, y)| *y).fold(0.0, f64::max)
        };
        // Local's are far above the others'.
        let others = highest(|policy| policy != Manner::Local);
        let top = if others > 0.0 { others * 1.08 } else { highest(|_| true).max(1.0) * 1.08 };
        Plot::new(self.name, caption, move |theme| {
            sheet(theme, (860, 500), self.words, |sheet| {
                let lines: Vec<Line> = curves
                    .iter()
                    .enumerate()
                    .map(|(place, curve)| line(theme, place, curve))
                    .collect();
                Line::keys(&lines, theme, sheet, (82, 84));
                let area = sheet.margin(104, 12, 20, 24);
                let axes =
                    Axes { x: x.clone(), y: 0.0..top, x_name: "speed, m/s", y_name: self.y_name };
                let mut chart = axes.chart(theme, &area);
                for line in &lines {
                    line.draw(&mut chart);
                }
            })
        })
    }
}

fn line(theme: &Theme, place: usize, (policy, points): &(Manner, Vec<(f64, f64)>)) -> Line {
    let is_constant = matches!(policy, Manner::Constant(_));
    Line {
        name: if is_constant { format!("{policy} s") } else { policy.to_string() },
        colour: theme.series[place % theme.series.len()],
        width: if *policy == Manner::Guard { 4 } else { 2 },
        is_dashed: is_constant,
        points: points.clone(),
    }
}

fn span(figures: &[f64]) -> std::ops::Range<f64> {
    let least = figures.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = figures.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if greatest > least { least..greatest } else { least - 1.0..greatest + 1.0 }
}
