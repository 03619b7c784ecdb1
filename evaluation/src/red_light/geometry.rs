//! The intersections: where the cars are when, and what the camera sees.

use serde::Serialize;

use crate::braking::Brakes;
use crate::shape::{Point, Rectangle, first_contact, is_hidden};

/// A car's length and width, in m.
pub(crate) const CAR: (f64, f64) = (4.7, 1.9);
/// The middle of ego's lane.
pub(crate) const LANE: f64 = -1.75;
/// The distance of ego's camera behind its front, in m.
const CAMERA: f64 = 1.8;
/// The angle that the camera sees to each side, in degrees.
const VIEW: f64 = 60.0;
/// The instant at which both cars would be at their references, in s.
pub(crate) const MEETING: f64 = 6.0;
/// The time after that at which everything is over, in s.
const AFTER: f64 = 10.0;

/// The layout of the intersection.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Variant {
    /// A building at the corner hides the runner, who comes from the right.
    CornerBuilding,
    /// A queue in the turning lane hides the runner, who comes from the left.
    QueueInTurningLane,
    /// A building at the corner of roads that meet at 120°.
    Skewed,
}

/// An intersection, in m, m/s and degrees.
pub(crate) struct Intersection {
    pub(crate) name: &'static str,
    pub(crate) ego_speed: f64,
    pub(crate) runner_speed: f64,
    heading: f64,
    /// The place of the runner's front at the meeting.
    pub(crate) runner_at: Point,
    /// The place of ego's front at that time.
    pub(crate) ego_at: f64,
    /// The distance before `runner_at` at which the runner would have to stop.
    pub(crate) line: f64,
    pub(crate) occluder: &'static [Point],
}

const CORNER_BUILDING: Intersection = Intersection {
    name: "corner building",
    ego_speed: 12.0,
    runner_speed: 14.0,
    heading: 90.0,
    runner_at: [1.75, -2.7],
    ego_at: 0.8,
    line: 5.0,
    occluder: &[[-60.0, -60.0], [-5.5, -60.0], [-5.5, -5.5], [-60.0, -5.5]],
};

const QUEUE_IN_TURNING_LANE: Intersection = Intersection {
    name: "queue in turning lane",
    ego_speed: 13.0,
    runner_speed: 14.0,
    heading: -90.0,
    runner_at: [-1.75, -0.8],
    ego_at: -2.7,
    line: 7.0,
    occluder: &[[-40.0, 0.5], [-4.0, 0.5], [-4.0, 3.0], [-40.0, 3.0]],
};

const SKEWED: Intersection = Intersection {
    name: "skewed",
    ego_speed: 13.0,
    runner_speed: 14.0,
    heading: 120.0,
    runner_at: [2.0, -2.7],
    ego_at: -0.2,
    line: 6.0,
    occluder: &[[-60.0, -5.5], [-3.5, -5.5], [16.5, -40.14], [-60.0, -40.14]],
};

impl Variant {
    pub(crate) const fn intersection(self) -> &'static Intersection {
        match self {
            Self::CornerBuilding => &CORNER_BUILDING,
            Self::QueueInTurningLane => &QUEUE_IN_TURNING_LANE,
            Self::Skewed => &SKEWED,
        }
    }
}

impl Intersection {
    /// Returns the runner's way, of length 1.
    pub(crate) fn heading(&self) -> Point {
        let (across, along) = self.heading.to_radians().sin_cos();
        [along, across]
    }
}

/// Two cars that approach one intersection.
#[derive(Clone, Copy)]
pub(crate) struct CrossingGeometry {
    pub(crate) intersection: &'static Intersection,
    pub(crate) ego_speed: f64,
    pub(crate) runner_speed: f64,
    /// How much later than ego the runner reaches its reference, in s.
    pub(crate) delta: f64,
    pub(crate) has_occluder: bool,
}

impl CrossingGeometry {
    /// Returns the instant after which nothing more can happen, in s.
    pub(crate) fn end(&self) -> f64 {
        MEETING + self.delta.abs() + AFTER
    }

    /// Returns ego at an instant if it does not brake.
    pub(crate) fn ego(&self, now: f64) -> Rectangle {
        ego_at(self.intersection.ego_at + self.ego_speed * (now - MEETING))
    }

    /// Returns ego at an instant if its brakes bite from `bite` on.
    pub(crate) fn ego_braking(&self, now: f64, bite: Option<f64>, deceleration: f64) -> Rectangle {
        let braked = bite.map_or(0.0, |bite| (now - bite).max(0.0));
        let braking = braked.min(self.ego_speed / deceleration);
        let lost = self.ego_speed * (braked - braking) + deceleration * braking * braking / 2.0;
        ego_at(self.intersection.ego_at + self.ego_speed * (now - MEETING) - lost)
    }

    /// Returns the runner at an instant; it never brakes.
    pub(crate) fn runner(&self, now: f64) -> Rectangle {
        let (length, width) = CAR;
        let ([x, y], heading) = (self.intersection.runner_at, self.intersection.heading());
        let ahead = self.runner_speed * (now - MEETING - self.delta);
        let front = [x + ahead * heading[0], y + ahead * heading[1]];
        Rectangle { front, heading, length, width }
    }

    /// Returns `true` if a camera of this range sees the runner: both ends of the runner's front,
    /// and the middle between them.
    pub(crate) fn sees(&self, now: f64, range: f64) -> bool {
        let [x, y] = self.ego(now).front;
        let camera = [x - CAMERA, y];
        let runner = self.runner(now);
        let [left, right, ..] = runner.corners();
        [left, right, runner.front].into_iter().all(|point| {
            let (ahead, contingency) = (point[0] - camera[0], point[1] - camera[1]);
            let is_in_view = contingency.atan2(ahead).abs() <= VIEW.to_radians();
            let is_hidden =
                self.has_occluder && is_hidden(self.intersection.occluder, camera, point);
            contingency.hypot(ahead) <= range && is_in_view && !is_hidden
        })
    }

    /// Returns when the cars touch if ego decides to brake at `decided`, or never decides.
    pub(crate) fn contact(&self, decided: Option<f64>, brakes: &Brakes) -> Option<f64> {
        let bite = decided.map(|decided| decided + brakes.delay);
        let fastest = self.ego_speed + self.runner_speed;
        first_contact((0.0, self.end()), fastest, |now| {
            self.ego_braking(now, bite, brakes.deceleration).distance(&self.runner(now))
        })
    }
}

/// Returns ego with its front at this place.
fn ego_at(front: f64) -> Rectangle {
    let (length, width) = CAR;
    Rectangle { front: [front, LANE], heading: [1.0, 0.0], length, width }
}
