//! A second simulation of both other scenes, in small steps of time and with shapes cut into
//! points.

use fuseline_testkit::Rng;

use crate::braking::Brakes;
use crate::jaywalking::{Manoeuvre, SwerveGeometry as Street};
use crate::red_light::{CrossingGeometry, Variant};

const STEP: f64 = 1e-3;

/// Returns points all along a car's outline, a hand's breadth apart. Its front is at `front`, and
/// its heading is in degrees.
fn outline(front: [f64; 2], degrees: f64) -> Vec<[f64; 2]> {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let at = |back: f64, contingency: f64| {
        [front[0] - back * cos - contingency * sin, front[1] - back * sin + contingency * cos]
    };
    let along = (0..=47).map(|step| f64::from(step) * 0.1);
    let across = (0..=38).map(|step| f64::from(step) * 0.05 - 0.95);
    let sides = along.flat_map(|back| [at(back, 0.95), at(back, -0.95)]);
    let ends = across.flat_map(|contingency| [at(0.0, contingency), at(4.7, contingency)]);
    sides.chain(ends).collect()
}

/// Returns `true` if a point lies in a car that drives along +x. The car counts as larger by
/// `spare` metres on each side.
fn is_in(front: [f64; 2], point: [f64; 2], spare: f64) -> bool {
    let (x, y) = (front[0] - point[0], (point[1] - front[1]).abs());
    -spare <= x && x <= 4.7 + spare && y <= 0.95 + spare
}

#[test]
fn cars_touch_where_points_of_one_come_into_the_other() {
    let headings = [90.0_f64, -90.0, 120.0];
    let (mut touch, mut compared) = (0, 0);
    for seed in 0..60_u64 {
        let random = &mut Rng::with_seed(seed);
        let variants = [Variant::CornerBuilding, Variant::QueueInTurningLane, Variant::Skewed];
        let which = random.one_of(&[0, 1, 2_usize]);
        let intersection = variants[which].intersection();
        let geometry = CrossingGeometry {
            intersection,
            ego_speed: random.f64_between(9.0, 16.0),
            runner_speed: random.f64_between(9.0, 16.0),
            delta: random.f64_between(-0.6, 0.6),
            has_occluder: true,
        };
        let decided = random.f64_between(4.0, 6.5);
        let brakes = Brakes { deceleration: 7.5, delay: 0.1 };
        let first = geometry.contact(Some(decided), &brakes).is_some();
        let (mut front, mut speed) =
            (intersection.ego_at - 6.0 * geometry.ego_speed, geometry.ego_speed);
        let (sin, cos) = headings[which].to_radians().sin_cos();
        let (mut surely, mut nearly) = (false, false);
        for step in 0..9000 {
            let now = f64::from(step) * STEP;
            let ahead = geometry.runner_speed * (now - 6.0 - geometry.delta);
            let runner =
                [intersection.runner_at[0] + ahead * cos, intersection.runner_at[1] + ahead * sin];
            if now > 4.0 {
                for point in outline(runner, headings[which]) {
                    surely |= is_in([front, -1.75], point, -0.02);
                    nearly |= is_in([front, -1.75], point, 0.02);
                }
            }
            let slower = if now >= decided + 0.1 { 7.5 * STEP } else { 0.0 };
            front += (speed - slower / 2.0).max(0.0) * STEP;
            speed = (speed - slower).max(0.0);
        }
        // A corner of one car may pass between the points of the other, so only clear cases are
        // compared.
        if surely == nearly {
            compared += 1;
            assert_eq!(first, surely, "{seed}");
        }
        touch += usize::from(first);
    }
    assert!(compared > 45 && (10..50).contains(&touch), "{compared}, {touch}");
}

#[test]
fn a_car_touches_a_person_where_small_steps_of_time_say_so() {
    let (mut touch, mut compared) = (0, 0);
    for seed in 0..250_u64 {
        let random = &mut Rng::with_seed(seed);
        let street = Street {
            distance: random.f64_between(5.0, 20.0),
            person_speed: random.f64_between(0.5, 3.0),
            lateral: random.f64_between(3.0, 9.0),
            deceleration: random.f64_between(4.0, 9.0),
            steering_rate: random.f64_between(0.2, 2.0),
        };
        let manoeuvre = random.one_of(&[Manoeuvre::Swerve, Manoeuvre::Brake]);
        let (speed, response) = (random.f64_between(4.0, 16.0), random.f64_between(0.2, 0.8));
        let first = street.contact(speed, manoeuvre, response).is_some();
        // The centre of mass, 2.35 m behind the front, and the angles of car, wheels and slip.
        let (mut middle, mut now_speed) = ([-2.35, 0.0], speed);
        let (mut heading, mut steering) = (0.0_f64, 0.0_f64);
        let (mut yaw, mut slip) = (0.0_f64, 0.0_f64);
        let mut nearest = f64::INFINITY;
        for step in 0..20_000 {
            let now = f64::from(step) * STEP;
            let person = [street.distance, street.person_speed * now - 1.75];
            let (sin, cos) = heading.sin_cos();
            let apart = [person[0] - middle[0], person[1] - middle[1]];
            let (ahead, left) = (apart[0] * cos + apart[1] * sin, apart[1] * cos - apart[0] * sin);
            let x = (ahead.abs() - 2.35).max(0.0);
            let y = (left.abs() - 0.95).max(0.0);
            if heading < std::f64::consts::FRAC_PI_2 {
                nearest = f64::min(nearest, x.hypot(y) - 0.3);
            }
            let is_acting = now >= response;
            match manoeuvre {
                Manoeuvre::Swerve if is_acting => {
                    let is_hard = speed * speed * steering.tan() / 2.58 >= street.lateral;
                    let more = if is_hard { 0.0 } else { street.steering_rate * STEP };
                    steering = (steering + more).min(1.066);
                }
                Manoeuvre::Brake if is_acting => {
                    now_speed = (now_speed - street.deceleration * STEP).max(0.0);
                }
                Manoeuvre::Swerve | Manoeuvre::Brake => {}
            }
            let (sin, cos) = (heading + slip).sin_cos();
            middle = [middle[0] + now_speed * STEP * cos, middle[1] + now_speed * STEP * sin];
            heading += yaw * STEP;
            // CommonRoad's single track: its mass, inertia and tyres as quotients.
            let quick = 215.04 / speed;
            let slips = quick * (0.5517 * steering - slip) - yaw;
            yaw += quick / 0.9962 * (speed / 2.5789 * steering - yaw) * STEP;
            slip += slips * STEP;
        }
        if nearest.abs() > 0.03 {
            compared += 1;
            assert_eq!(first, nearest < 0.0, "{seed}: {nearest}");
        }
        touch += usize::from(first);
    }
    assert!(compared > 230 && (50..200).contains(&touch), "{compared}, {touch}");
}
