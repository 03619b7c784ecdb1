//! The detector on board beside shared locations, at each intersection.

use crate::plot::{AnimatedBody, AnimatedRun, Animation, outputs};
use crate::scenario::red_light::Args;
use crate::scenario::red_light::crossing::{Crossing, WarningSource};
use crate::scenario::red_light::geometry::{CAR, CrossingGeometry, MEETING};
use crate::scenario::red_light::plots::capital;

/// What is shown, in m.
const SHOWN: [[f64; 2]; 2] = [[-34.0, 14.0], [-24.0, 16.0]];
/// From when on, in s, and how long after the meeting.
const BEGIN: f64 = 2.5;
const AFTER: f64 = 2.0;

/// An animation of each variant, at the delta nearest to 0 and the first round trip.
pub(crate) fn animations(args: &Args) -> Vec<Animation> {
    let nearest = args.delta.iter().copied().min_by(|one, other| one.abs().total_cmp(&other.abs()));
    let (delta, trip) = (nearest.unwrap_or_default(), args.round_trip.first().copied());
    let of = |variant| {
        let geometry = args.geometry(variant, delta, !args.no_occluder);
        let run = |approach, round_trip: f64| {
            let ego = args.ego();
            run_of(&Crossing { geometry, ego: &ego, approach, round_trip })
        };
        let mut runs = vec![run(WarningSource::Local, 0.0)];
        runs.extend(trip.map(|trip| run(WarningSource::Sharing, trip)));
        let name = capital(geometry.intersection.name);
        let caption = format!(
            "{name}, at δ = {delta} s, from {BEGIN} s on. Marks: outputs of the detections and, where locations are \
             shared, of the neighbours, as their traces have them."
        );
        Animation { caption, shown: SHOWN, still: still(&geometry), runs }
    };
    args.variant.iter().copied().map(of).collect()
}

fn run_of(crossing: &Crossing<'_>) -> AnimatedRun {
    let (crossed, traces) = crossing.traced("animation", true);
    let geometry = crossing.geometry;
    let brakes = crossing.ego.brakes();
    let bite = crossed.decided.map(|decided| decided + brakes.delay);
    let end = MEETING + AFTER - BEGIN;
    let contact = crossed.contact.map(|at| at - BEGIN);
    let ego = |now: f64| {
        let car = geometry.ego_braking(now + BEGIN, bite, brakes.deceleration);
        (car.front, car.heading)
    };
    let runner = |now: f64| {
        let car = geometry.runner(now + BEGIN);
        (car.front, car.heading)
    };
    let size = [CAR.0, CAR.1];
    let mut emitted: Vec<(f64, u64)> =
        traces.iter().flat_map(|(_, trace)| outputs(trace, BEGIN)).collect();
    emitted.retain(|(at, _)| (0.0..=end).contains(at));
    let name = match crossing.approach {
        WarningSource::Local => "Detector on board".to_owned(),
        WarningSource::Cloud => "Detector in the cloud".to_owned(),
        WarningSource::Sharing => format!("Shared locations, {} s", crossing.round_trip),
    };
    AnimatedRun {
        name,
        outcome: if contact.is_some() { "collides" } else { "avoids" }.to_owned(),
        collides: contact.is_some(),
        decided: crossed.decided.map(|at| at - BEGIN),
        bodies: vec![
            AnimatedBody::new("ego", size, (end, contact), ego),
            AnimatedBody::new("other", size, (end, contact), runner),
        ],
        outputs: emitted,
    }
}

/// Both roads, 7 m wide, and what hides the runner.
fn still(geometry: &CrossingGeometry) -> Vec<(&'static str, Vec<[f64; 2]>)> {
    let [along, across] = geometry.intersection.heading();
    let corner =
        |ahead: f64, aside: f64| [ahead * along - aside * across, ahead * across + aside * along];
    let road = |corner: &dyn Fn(f64, f64) -> [f64; 2]| {
        vec![corner(-80.0, -3.5), corner(80.0, -3.5), corner(80.0, 3.5), corner(-80.0, 3.5)]
    };
    let mut still = vec![("road", road(&|x, y| [x, y])), ("road", road(&corner))];
    if geometry.has_occluder {
        still.push(("wall", geometry.intersection.occluder.to_vec()));
    }
    still
}
