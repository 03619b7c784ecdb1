//! Locations that vehicles share: a service with state, and what ego makes of its answers.

use std::collections::BTreeMap;

use crate::approach::seconds;
use crate::red_light::geometry::{CrossingGeometry, MEETING};
use crate::shape::Point;

/// The time between two reports of a vehicle, in ns.
pub(crate) const EVERY: u64 = 100_000_000;
/// The instant at which the runner begins.
const RUNNER_FROM: u64 = 50_000_000;
/// A car that would need more than this to stop at its line will not stop, in m/s².
const HARD: f64 = 4.0;
/// Cars that arrive within this many seconds of each other may meet.
const TOGETHER: f64 = 1.0;
/// Ego brakes only if it reaches its reference within this time, in s.
const AHEAD: f64 = 4.0;

/// The car that reports.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum ReportingVehicle {
    Ego,
    Runner,
}

/// The position and the movement of a vehicle's front.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct VehicleState {
    /// In the vehicles' common time, ns.
    pub(crate) at: u64,
    pub(crate) front: Point,
    pub(crate) velocity: Point,
}

/// The service: it keeps each vehicle's last report, and answers with the others'.
#[derive(Default)]
pub(crate) struct ReportedLocations {
    last: BTreeMap<ReportingVehicle, VehicleState>,
}

impl ReportedLocations {
    /// Takes a report, and answers it.
    pub(crate) fn report(
        &mut self,
        who: ReportingVehicle,
        position: VehicleState,
    ) -> Vec<VehicleState> {
        self.last.insert(who, position);
        let others = self.last.iter().filter(|(other, _)| **other != who);
        others.map(|(_, position)| *position).collect()
    }
}

/// Both vehicles' reports to the service, in the order in which they are sent.
pub(crate) struct Exchange<'a> {
    geometry: &'a CrossingGeometry,
    service: ReportedLocations,
    runner_next: u64,
}

impl<'a> Exchange<'a> {
    pub(crate) fn new(geometry: &'a CrossingGeometry) -> Self {
        Self { geometry, service: ReportedLocations::default(), runner_next: RUNNER_FROM }
    }

    /// Returns the service's answer to ego's report at this instant. The reports that the runner
    /// sent by then have reached the service.
    pub(crate) fn ego(&mut self, at: u64) -> Vec<VehicleState> {
        while self.runner_next <= at {
            self.service.report(
                ReportingVehicle::Runner,
                self.position(ReportingVehicle::Runner, self.runner_next),
            );
            self.runner_next += EVERY;
        }
        self.service.report(ReportingVehicle::Ego, self.position(ReportingVehicle::Ego, at))
    }

    fn position(&self, who: ReportingVehicle, at: u64) -> VehicleState {
        let (car, speed) = match who {
            ReportingVehicle::Ego => (self.geometry.ego(seconds(at)), self.geometry.ego_speed),
            ReportingVehicle::Runner => {
                (self.geometry.runner(seconds(at)), self.geometry.runner_speed)
            }
        };
        VehicleState { at, front: car.front, velocity: car.heading.map(|part| part * speed) }
    }
}

/// Returns `true` if ego brakes for a neighbour at this instant. It assumes that the neighbour went
/// on as it reported.
pub(crate) fn must_brake(geometry: &CrossingGeometry, neighbour: &VehicleState, now: u64) -> bool {
    let heading = geometry.intersection.heading();
    let along = |point: Point| point[0] * heading[0] + point[1] * heading[1];
    let speed = along(neighbour.velocity);
    let age = seconds(now.saturating_sub(neighbour.at));
    let distance = along(geometry.intersection.runner_at) - along(neighbour.front) - speed * age;
    let to_line = distance - geometry.intersection.line;
    let will_not_stop = to_line <= 0.0 || speed * speed / (2.0 * to_line) > HARD;
    let ego = MEETING - seconds(now);
    will_not_stop && (distance / speed - ego).abs() < TOGETHER && ego < AHEAD
}
