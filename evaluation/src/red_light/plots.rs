//! Draws the intersections from above.

use plotters::prelude::*;

use crate::plot::{Canvas, DRAWN, Plot, TextLine, Theme, canvas, inside, keys_of_shapes};
use crate::red_light::crossing::WarningSource;
use crate::red_light::geometry::{CrossingGeometry, MEETING};
use crate::red_light::{Args, RedLightResult, RedLightRun};
use crate::shape::{Point, Rectangle as Car};

/// The number of units in a metre.
const METRE: f64 = 11.0;
/// The visible area in m, horizontally and vertically.
const SHOWN: [[f64; 2]; 2] = [[-34.0, 22.0], [-24.0, 20.0]];
/// The top of the picture, below the text.
const TOP: f64 = 104.0;

/// Returns a picture of each variant, at the delta nearest to 0.
pub(crate) fn plots(args: &Args, result: &RedLightResult) -> Vec<Plot> {
    let nearest = args.delta.iter().copied().min_by(|one, other| one.abs().total_cmp(&other.abs()));
    let delta = nearest.unwrap_or_default();
    let names = ["corner-building", "queue-in-turning-lane", "skewed"];
    let mut plots = Vec::new();
    for variant in &args.variant {
        let geometry = args.geometry(*variant, delta, !args.no_occluder);
        let of = |approach: WarningSource| {
            let is = |run: &&RedLightRun| {
                (run.variant, run.delta, run.approach) == (*variant, delta, approach)
            };
            result.runs.iter().find(is).cloned()
        };
        let (local, sharing) = (of(WarningSource::Local), of(WarningSource::Sharing));
        let deceleration = args.deceleration;
        let caption = format!(
            "{} from above, at δ = {delta} s. Ego comes from the left. Filled: where the cars are at 6 s if ego brakes by \
             shared locations. Red outline: where ego is then with the detector on board. Thin outlines: each half second \
             before.",
            capital(geometry.intersection.name)
        );
        let name = names[*variant as usize];
        plots.push(Plot::new(name, caption, move |theme| {
            let title = format!("Running a red light: {}", geometry.intersection.name);
            let below = below(local.as_ref(), sharing.as_ref());
            let [[left, right], [low, high]] = SHOWN;
            let size = (unit((right - left) * METRE), unit((high - low) * METRE + TOP));
            canvas(theme, size, (&title, &below), |canvas| {
                let keys = [
                    ("ego by shared locations", theme.series[1].filled()),
                    ("ego by the detector on board", theme.bad.stroke_width(2)),
                    ("car that runs the light", theme.series[2].filled()),
                ];
                keys_of_shapes(theme, canvas, &keys);
                let area = canvas.margin(i32::try_from(unit(TOP)).unwrap_or(0), 0, 0, 0);
                let ego = |run: &RedLightRun, now: f64| {
                    let bite = run.brakes_before.map(|before| MEETING - before);
                    geometry.ego_braking(now, bite, deceleration)
                };
                roads(theme, &area, &geometry);
                ruler(theme, &area);
                let reported = |now: f64| sharing.as_ref().map(|run| ego(run, now));
                paths(theme, &area, &geometry, reported);
                let car =
                    |car: &Car, colour: RGBColor| shape(&area, &car.corners(), colour.filled());
                car(&geometry.runner(MEETING), theme.series[2]);
                if let Some(ego) = reported(MEETING) {
                    car(&ego, theme.series[1]);
                }
                if let Some(run) = &local {
                    let corners = ego(run, MEETING).corners();
                    outline(&area, &corners, theme.bad.stroke_width(3));
                }
            })
        }));
    }
    plots
}

pub(crate) fn capital(name: &str) -> String {
    let (first, rest) = name.split_at(1);
    first.to_uppercase() + rest
}

fn below(local: Option<&RedLightRun>, sharing: Option<&RedLightRun>) -> String {
    let word = |run: &RedLightRun| match (run.collides, run.brakes_before) {
        (true, _) => "collides".to_owned(),
        (false, Some(before)) => format!("brakes {before:.2} s before 6 s and avoids"),
        (false, None) => "avoids".to_owned(),
    };
    let local = local.map(|run| format!("Detector on board: {}.", word(run)));
    let sharing = sharing.map(|run| {
        format!(
            "Shared locations, round trip {} s: {}.",
            run.round_trip.unwrap_or_default(),
            word(run)
        )
    });
    [local, sharing].into_iter().flatten().collect::<Vec<_>>().join(" ")
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundreds")]
fn unit(length: f64) -> u32 {
    length.round() as u32
}

#[expect(clippy::cast_possible_truncation, reason = "some hundreds")]
fn pixel([x, y]: Point) -> (i32, i32) {
    let [[left, _], [_, high]] = SHOWN;
    (((x - left) * METRE).round() as i32, ((high - y) * METRE).round() as i32)
}

fn shape(canvas: &Canvas<'_>, corners: &[Point], style: impl Into<ShapeStyle>) {
    let corners: Vec<(i32, i32)> = inside(corners, SHOWN).into_iter().map(pixel).collect();
    if !corners.is_empty() {
        canvas.draw(&Polygon::new(corners, style)).expect(DRAWN);
    }
}

/// Draws an outline if all of it is shown.
fn outline(canvas: &Canvas<'_>, corners: &[Point], style: impl Into<ShapeStyle>) {
    if inside(corners, SHOWN) != corners {
        return;
    }
    let closed = corners.iter().chain(corners.first()).map(|corner| pixel(*corner));
    canvas.draw(&PathElement::new(closed.collect::<Vec<_>>(), style)).expect(DRAWN);
}

/// Draws both roads, 7 m wide, and what hides the other car.
fn roads(theme: &Theme, canvas: &Canvas<'_>, geometry: &CrossingGeometry) {
    let road = theme.line.filled();
    shape(canvas, &[[-80.0, -3.5], [80.0, -3.5], [80.0, 3.5], [-80.0, 3.5]], road);
    let [along, across] = geometry.intersection.heading();
    let left = [-across, along];
    let corner = |ahead: f64, contingency: f64| {
        [ahead * along + contingency * left[0], ahead * across + contingency * left[1]]
    };
    let corners = [corner(-80.0, -3.5), corner(80.0, -3.5), corner(80.0, 3.5), corner(-80.0, 3.5)];
    shape(canvas, &corners, road);
    let dash = theme.ground.stroke_width(2);
    for step in 0..20 {
        let from = -80.0 + 8.0 * f64::from(step);
        for (one, other) in
            [([from, 0.0], [from + 3.0, 0.0]), (corner(from, 0.0), corner(from + 3.0, 0.0))]
        {
            let is_apart = |point: Point| point[0].hypot(point[1]) > 8.0;
            if is_apart(one) && is_apart(other) {
                canvas.draw(&PathElement::new(vec![pixel(one), pixel(other)], dash)).expect(DRAWN);
            }
        }
    }
    if geometry.has_occluder {
        shape(canvas, geometry.intersection.occluder, theme.wall.filled());
    }
}

/// Draws both cars each half second, ego with shared locations.
fn paths(
    theme: &Theme,
    canvas: &Canvas<'_>,
    geometry: &CrossingGeometry,
    ego: impl Fn(f64) -> Option<Car>,
) {
    for step in 1..=12_i32 {
        let now = MEETING - f64::from(step) / 2.0;
        let faint = 0.6 - f64::from(step) * 0.04;
        if let Some(ego) = ego(now) {
            outline(canvas, &ego.corners(), theme.series[1].mix(faint));
        }
        outline(canvas, &geometry.runner(now).corners(), theme.series[2].mix(faint));
    }
}

/// Draws a ruler of ten metres.
fn ruler(theme: &Theme, canvas: &Canvas<'_>) {
    let [from, to] = [pixel([10.0, 17.5]), pixel([20.0, 17.5])];
    canvas.draw(&PathElement::new(vec![from, to], theme.soft.stroke_width(2))).expect(DRAWN);
    for (x, y) in [from, to] {
        let end = PathElement::new(vec![(x, y - 4), (x, y + 4)], theme.soft.stroke_width(2));
        canvas.draw(&end).expect(DRAWN);
    }
    let middle = (i32::midpoint(from.0, to.0), from.1 - 13);
    TextLine::new(13.0, theme.soft).centred().put(canvas, "10 m", middle);
}
