//! More checks that hard-coded results would not pass.

use std::time::Duration;

use fuseline_testkit::Rng;

use crate::approach::{Approach, ApproachRun, Vehicle, nanos};
use crate::tests::{REFERENCE, any_vehicle, drive, end, end_at};
use crate::traffic_jam::tests_of_cells::guard;

/// Phases that are spread evenly over a frame.
const PHASES: [f64; 8] = [0.0625, 0.1875, 0.3125, 0.4375, 0.5625, 0.6875, 0.8125, 0.9375];

/// Returns the number of phases in which the vehicle collides.
fn hits(vehicle: &Vehicle, speed: f64, approach: Approach, response: f64) -> usize {
    let ends = PHASES.map(|phase| end_at(&drive(vehicle, speed, phase, approach), response));
    ends.iter().filter(|end| end.hits()).count()
}

/// Returns how late the results of a source of this range may come, in s after capture.
fn budget(vehicle: &Vehicle, speed: f64, range: f64) -> f64 {
    let braking = speed / (2.0 * vehicle.deceleration) + vehicle.brake_delay;
    range / speed - braking - f64::from(vehicle.frames) / vehicle.rate
}

#[test]
fn local_and_cloud_agree_with_the_budgets_on_1000_random_vehicles() {
    let (mut in_time, mut late) = (0, 0);
    for seed in 0..1000 {
        let random = &mut Rng::with_seed(seed);
        let (vehicle, speed) = any_vehicle(random);
        let response = random.f64_between(0.05, 2.5);
        for (approach, range, response) in [
            (Approach::Local, vehicle.range_local, vehicle.local_response),
            (Approach::Cloud, vehicle.range_cloud, response),
        ] {
            let budget = budget(&vehicle, speed, range);
            let hits = hits(&vehicle, speed, approach, response);
            if response < budget {
                in_time += 1;
                assert_eq!(hits, 0, "{seed}: {approach:?} at {response} within {budget}");
            } else if response > budget + vehicle.rate.recip() {
                late += 1;
                assert_eq!(hits, 8, "{seed}: {approach:?} at {response} after {budget}");
            }
        }
    }
    assert!(in_time > 300 && late > 300, "{in_time}, {late}");
}

#[test]
fn scaled_in_distance_speed_and_time_everything_ends_the_same() {
    let mut collide = 0;
    for seed in 0..150 {
        let random = &mut Rng::with_seed(seed);
        let (vehicle, speed) = any_vehicle(random);
        let factor = random.f64_between(0.5, 2.0);
        let scaled = Vehicle {
            brake_delay: vehicle.brake_delay * factor,
            rate: vehicle.rate / factor,
            range_local: vehicle.range_local * factor * factor,
            range_cloud: vehicle.range_cloud * factor * factor,
            local_response: vehicle.local_response * factor,
            ..vehicle
        };
        // Here the phases end differently, so a small difference shows.
        let near = budget(&vehicle, speed, vehicle.range_cloud) + random.f64() / vehicle.rate;
        let response = near.clamp(0.05, 2.0);
        let deadline = random.f64_between(0.05, 1.5);
        for approach in [Approach::Local, Approach::Cloud, Approach::First, Approach::Ours] {
            for phase in PHASES {
                let of = |vehicle, speed, factor: f64| {
                    let deadline = Duration::from_secs_f64(deadline * factor);
                    let drive = ApproachRun { deadline, ..drive(vehicle, speed, phase, approach) };
                    end_at(&drive, response * factor).hits()
                };
                let plain = of(&vehicle, speed, 1.0);
                assert_eq!(plain, of(&scaled, speed * factor, factor), "{seed}, {approach:?}");
                collide += usize::from(plain);
            }
        }
    }
    assert!((500..4300).contains(&collide), "{collide}");
}

#[test]
fn a_slower_cloud_makes_nothing_green_and_a_longer_range_nothing_red() {
    let mut changed = 0;
    for seed in 0..200 {
        let random = &mut Rng::with_seed(seed);
        let (mut vehicle, speed) = any_vehicle(random);
        (vehicle.range_local, vehicle.range_cloud) = (5.0, vehicle.range_cloud);
        let response = random.f64_between(0.05, 2.0);
        let cloud = |vehicle: &Vehicle, response| hits(vehicle, speed, Approach::Cloud, response);
        let before = cloud(&vehicle, response);
        let slower = cloud(&vehicle, response + random.f64_between(0.01, 0.5));
        assert!(slower >= before, "{seed}: {slower} after {before}");
        let more = random.f64_between(0.5, 15.0);
        let longer = Vehicle { range_cloud: vehicle.range_cloud + more, ..vehicle };
        let further = cloud(&longer, response);
        assert!(further <= before, "{seed}: {further} after {before}");
        let local = |range: f64| {
            let vehicle = Vehicle { range_local: range, range_cloud: 5.0, ..vehicle };
            hits(&vehicle, speed, Approach::Local, 0.0)
        };
        let (near, far) = (local(vehicle.range_cloud), local(vehicle.range_cloud + more));
        assert!(far <= near, "{seed}: {far} after {near}");
        changed += usize::from(slower > before) + usize::from(further < before);
        changed += usize::from(far < near);
    }
    assert!(changed > 25, "{changed}");
}

#[test]
fn a_response_equal_to_the_deadline_is_late() {
    let deadline = Duration::from_millis(750);
    let drive = ApproachRun { deadline, ..drive(&REFERENCE, 22.0, 0.5, Approach::Ours) };
    let takes = |nanos: u64| end(&drive, |_| Some(nanos)).hits();
    assert_eq!([749_999_999, 750_000_000, 750_000_001].map(takes), [false, true, true]);
}

#[test]
fn a_blind_cloud_in_time_collides_where_local_alone_does_not() {
    let blind = Vehicle { range_cloud: 0.0, ..REFERENCE };
    let deadline = guard(&REFERENCE, 11.0);
    for phase in PHASES {
        let ours = ApproachRun { deadline, ..drive(&blind, 11.0, phase, Approach::Ours) };
        assert!(end_at(&ours, 0.5).hits());
        assert!(!end_at(&drive(&blind, 11.0, phase, Approach::Local), 0.5).hits());
    }
}

#[test]
fn the_guard_never_collides_where_local_alone_does_not_and_half_a_second_does() {
    let (mut saved, mut lost) = (0, 0);
    for seed in 0..600 {
        let random = &mut Rng::with_seed(seed);
        let speed = if seed % 3 == 0 { 20.0 } else { random.f64_between(9.0, 28.0) };
        let phase = random.f64();
        let drop_rate = random.f64();
        // The instant of a frame determines its response.
        let response = |at: u64| {
            let random = &mut Rng::with_seed(seed ^ at.rotate_left(20));
            let response = random.one_of(&[0.1, 0.3, 0.6, 1.2]) * random.f64_between(0.5, 1.5);
            (random.f64() > drop_rate).then(|| nanos(response))
        };
        let local = end(&drive(&REFERENCE, speed, phase, Approach::Local), response).hits();
        let ours = |deadline| {
            let drive = ApproachRun { deadline, ..drive(&REFERENCE, speed, phase, Approach::Ours) };
            end(&drive, response).hits()
        };
        let guarded = ours(guard(&REFERENCE, speed));
        assert!(local || !guarded, "{seed}: the guard collides at {speed}, local alone does not");
        saved += usize::from(local && !guarded);
        lost += usize::from(!local && seed % 3 == 0 && ours(Duration::from_millis(500)));
    }
    assert!(saved > 20 && lost > 20, "{saved}, {lost}");
}
