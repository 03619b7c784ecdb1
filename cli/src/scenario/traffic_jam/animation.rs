//! Local, cloud and ours before the same motorcycle.

use crate::plot::{AnimatedBody, AnimatedRun, Animation, outputs};
use crate::scenario::approach::{Approach, ApproachRun, nanos, seconds};
use crate::scenario::braking::DriveOutcome;
use crate::scenario::operator::ScenarioOperator;
use crate::scenario::traffic_jam::Args;
use crate::scenario::traffic_jam::cells::Jam;

/// A car's length and width, and a motorcycle's, in m.
const CAR: [f64; 2] = [4.7, 1.9];
const MOTORCYCLE: [f64; 2] = [2.2, 0.9];
/// Cells that are shown where the table has them: speed in m/s, response in s.
const CELLS: [(f64, f64); 2] = [(22.0, 0.5), (18.0, 3.0)];

/// An animation of each of the cells, or of the table's first one.
pub(crate) fn animations(args: &Args, jam: &Jam) -> Vec<Animation> {
    let has = |list: &[f64], wanted: f64| list.iter().any(|it| it.total_cmp(&wanted).is_eq());
    let mut cells: Vec<(f64, f64)> = CELLS
        .into_iter()
        .filter(|(speed, response)| has(&args.speed, *speed) && has(&args.response, *response))
        .collect();
    if cells.is_empty() {
        cells.extend(args.speed.first().copied().zip(args.response.first().copied()));
    }
    cells.into_iter().map(|cell| animation(args, jam, cell)).collect()
}

fn animation(args: &Args, jam: &Jam, (speed, response): (f64, f64)) -> Animation {
    let runs: Vec<AnimatedRun> =
        args.approach.iter().map(|approach| run(jam, *approach, (speed, response))).collect();
    let range = jam.vehicle.range_local.max(jam.vehicle.range_cloud);
    let shown = [[-range - 6.0, 6.0], [-3.5, 3.5]];
    let road = vec![[-200.0, -3.0], [50.0, -3.0], [50.0, 3.0], [-200.0, 3.0]];
    let caption = format!(
        "At {speed} m/s, with a cloud that takes {response} s. Marks: the operator's outputs, by source, as its trace has \
         them; it brakes once three in a row report the motorcycle."
    );
    Animation { caption, shown, still: vec![("road", road)], runs }
}

fn run(jam: &Jam, approach: Approach, (speed, response): (f64, f64)) -> AnimatedRun {
    let vehicle = jam.vehicle;
    let deadline = jam.deadline(speed, response);
    let phase = jam.phases().first().copied().unwrap_or_default();
    let drive = ApproachRun { vehicle: &vehicle, speed, phase, approach, deadline };
    let mut operator = ScenarioOperator::new("animation", drive.frames(), true);
    let (outcome, decided) = drive.run(&mut operator, |_| Some(nanos(response)));
    let brakes = vehicle.brakes();
    let (start, decided) = (drive.start(), decided.map(seconds));
    let bite = decided.map_or(f64::INFINITY, |decided| decided + brakes.delay);
    let travelled = move |now: f64| {
        let braking = (now - bite).max(0.0).min(speed / brakes.deceleration);
        speed * now.min(bite) + speed * braking - brakes.deceleration * braking * braking / 2.0
    };
    let end = start / speed + speed / brakes.deceleration / 2.0 + 0.5;
    let ego = move |now: f64| ([(travelled(now) - start).min(0.0), 0.0], [1.0, 0.0]);
    let motorcycle = |_: f64| ([MOTORCYCLE[0], 0.0], [1.0, 0.0]);
    let (word, collides) = match outcome {
        DriveOutcome::Stops { gap } => (format!("stops {gap:.1} m before it"), false),
        DriveOutcome::Hits { impact } => (format!("hits at {impact:.1} m/s"), true),
    };
    let name = match approach {
        Approach::Local => "Local",
        Approach::Cloud => "Cloud",
        Approach::First => "First response",
        Approach::Ours => "Ours",
    };
    let emitted = operator.into_trace().map(|trace| outputs(&trace, 0.0)).unwrap_or_default();
    AnimatedRun {
        name: name.to_owned(),
        outcome: word,
        collides,
        decided,
        bodies: vec![
            AnimatedBody::new("other", MOTORCYCLE, (end, None), motorcycle),
            AnimatedBody::new("ego", CAR, (end, None), ego),
        ],
        outputs: emitted.into_iter().filter(|(at, _)| *at <= end).collect(),
    }
}
