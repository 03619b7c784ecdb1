//! Tests that hard-coded results would not pass, and a second simulation that shares no code with
//! the first.

mod checks;
mod crossing;
mod emitted;
mod second;

use std::time::Duration;

use fuseline_testkit::Rng;

use crate::approach::{Approach, ApproachRun, Vehicle, nanos};
use crate::braking::DriveOutcome;
use crate::operator::ScenarioOperator;

/// The vehicle of the specification.
pub(crate) const REFERENCE: Vehicle = Vehicle {
    deceleration: 7.5,
    brake_delay: 0.1,
    rate: 30.0,
    frames: 3,
    range_local: 39.0,
    range_cloud: 57.0,
    local_response: 0.3017,
    local_serial: false,
    reveal: None,
};

/// Returns a random vehicle and a random speed.
fn any_vehicle(random: &mut Rng) -> (Vehicle, f64) {
    let vehicle = Vehicle {
        deceleration: random.f64_between(4.0, 10.0),
        brake_delay: random.f64_between(0.0, 0.3),
        rate: random.one_of(&[10.0, 20.0, 30.0]),
        frames: random.one_of(&[1, 2, 3, 4]),
        range_local: random.f64_between(15.0, 70.0),
        range_cloud: random.f64_between(30.0, 90.0),
        local_response: random.f64_between(0.05, 0.5),
        local_serial: false,
        reveal: None,
    };
    (vehicle, random.f64_between(8.0, 32.0))
}

/// Returns how a drive ends, with these responses of the cloud by the instant of capture.
fn end(drive: &ApproachRun<'_>, response: impl Fn(u64) -> Option<u64>) -> DriveOutcome {
    let mut operator = ScenarioOperator::new("", drive.frames(), false);
    let (end, _) = drive.run(&mut operator, response);
    assert!(!operator.is_full());
    end
}

/// Returns how a drive ends with one response for all frames, in s.
fn end_at(drive: &ApproachRun<'_>, response: f64) -> DriveOutcome {
    let takes = nanos(response);
    end(drive, |_| Some(takes))
}

/// Returns one drive of a vehicle.
fn drive(vehicle: &Vehicle, speed: f64, phase: f64, approach: Approach) -> ApproachRun<'_> {
    ApproachRun { vehicle, speed, phase, approach, deadline: Duration::ZERO }
}
