//! Draws the intersections from above.

use crate::plot::{Axes, ChartLine, Plot, canvas};
use crate::red_light::crossing::WarningSource;
use crate::red_light::geometry::MEETING;
use crate::red_light::{Args, RedLightResult, RedLightRun, Variant};
use crate::shape::Point;

/// Returns a map of each variant, at the delta nearest to 0.
pub(crate) fn plots(args: &Args, result: &RedLightResult) -> Vec<Plot> {
    let nearest = args.delta.iter().copied().min_by(|one, other| one.abs().total_cmp(&other.abs()));
    let delta = nearest.unwrap_or_default();
    let names = ["corner-building", "queue-in-turning-lane", "skewed"];
    let plot = |variant: &Variant| {
        let geometry = args.geometry(*variant, delta, !args.no_occluder);
        let of = |approach: WarningSource| {
            let is = |run: &&RedLightRun| {
                (run.variant, run.delta, run.approach) == (*variant, delta, approach)
            };
            result.runs.iter().find(is)
        };
        let (local, sharing) = (of(WarningSource::Local), of(WarningSource::Sharing));
        let ego = |run: &RedLightRun, now: f64| {
            let bite = run.brakes_before.map(|before| MEETING - before);
            closed(&geometry.ego_braking(now, bite, args.deceleration).corners())
        };
        let runner = |now: f64| closed(&geometry.runner(now).corners());
        // Each line has the word of its key, the index of its colour, its width, and its points.
        let mut lines = Vec::new();
        lines.extend(sharing.map(|run| ("ego, shared locations", 1, 4, ego(run, MEETING))));
        lines.extend(local.map(|run| ("ego, detector on board", 5, 4, ego(run, MEETING))));
        lines.push(("runner", 2, 4, runner(MEETING)));
        if geometry.has_occluder {
            lines.push(("what hides it", 0, 4, closed(geometry.intersection.occluder)));
        }
        let keys = lines.len();
        for step in 1..=12 {
            let now = MEETING - f64::from(step) / 2.0;
            lines.extend(sharing.map(|run| ("", 1, 1, ego(run, now))));
            lines.push(("", 2, 1, runner(now)));
        }
        for [along, across] in [[1.0, 0.0], geometry.intersection.heading()] {
            lines.extend([-3.5, 0.0, 3.5].map(|left| {
                let at =
                    |ahead: f64| (ahead * along - left * across, ahead * across + left * along);
                ("", 0, 1, vec![at(-80.0), at(80.0)])
            }));
        }
        let title = format!("Running a red light: {}", geometry.intersection.name);
        let below = below(local, sharing);
        let caption = format!(
            "The intersection from above, at δ = {delta} s. Ego comes from the left. Thick: where \
            the cars are at 6 s. Thin: where they are each half second before, if ego brakes by \
            shared locations."
        );
        Plot::new(names[*variant as usize], caption, move |theme| {
            let line = |(name, series, width, points): &(&str, usize, u32, Vec<(f64, f64)>)| {
                let (name, colour) = ((*name).to_owned(), theme.series[*series]);
                ChartLine { name, colour, width: *width, is_dashed: false, points: points.clone() }
            };
            let lines: Vec<ChartLine> = lines.iter().map(line).collect();
            // A metre has 11 units in both directions.
            canvas(theme, (718, 646), (&title, &below), |canvas| {
                ChartLine::keys(&lines[..keys], theme, canvas, (82, 84));
                let area = canvas.margin(104, 12, 20, 24);
                let axes = Axes { x: -34.0..22.0, y: -24.0..20.0, x_name: "x, m", y_name: "y, m" };
                let mut chart = axes.chart(theme, &area);
                for line in &lines {
                    line.draw(&mut chart, &axes);
                }
            })
        })
    };
    args.variant.iter().map(plot).collect()
}

fn below(local: Option<&RedLightRun>, sharing: Option<&RedLightRun>) -> String {
    let word = |run: &RedLightRun| match (run.collides, run.brakes_before) {
        (true, _) => "collides".to_owned(),
        (false, Some(before)) => format!("brakes {before:.2} s before 6 s and avoids"),
        (false, None) => "avoids".to_owned(),
    };
    let local = local.map(|run| format!("Detector on board: {}.", word(run)));
    let sharing = sharing.map(|run| {
        let trip = run.round_trip.unwrap_or_default();
        format!("Shared locations, round trip {trip} s: {}.", word(run))
    });
    [local, sharing].into_iter().flatten().collect::<Vec<_>>().join(" ")
}

/// Returns the outline of a shape.
fn closed(corners: &[Point]) -> Vec<(f64, f64)> {
    corners.iter().chain(corners.first()).map(|[x, y]| (*x, *y)).collect()
}
