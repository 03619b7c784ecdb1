//! A car and a person who steps onto the road, in m and s.

use serde::Serialize;

use crate::jaywalking::swerve::Swerve;
use crate::shape::{Rectangle, first_contact};

/// The car's length and width.
pub(crate) const CAR: (f64, f64) = (4.7, 1.9);
/// The person is a disc.
pub(crate) const RADIUS: f64 = 0.3;
/// The distance of the person's start to the right of the middle of the car's lane.
pub(crate) const ASIDE: f64 = 1.75;
/// A person who does not cross within this time never does.
const END: f64 = 60.0;

/// The car's manoeuvre.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Manoeuvre {
    /// To the left, with the speed kept.
    Swerve,
    Brake,
}

/// The person's place, and the car's abilities.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct SwerveGeometry {
    /// The distance from the car's front to the person's line at 0 s.
    pub(crate) distance: f64,
    pub(crate) person_speed: f64,
    /// The greatest acceleration to the left.
    pub(crate) lateral: f64,
    /// The speed at which the wheels turn, in rad/s.
    pub(crate) steering_rate: f64,
    pub(crate) deceleration: f64,
}

impl SwerveGeometry {
    fn swerve(&self, speed: f64) -> Swerve {
        Swerve::new(speed, self.lateral, self.steering_rate)
    }

    /// Returns the car, if it brakes from `from` on.
    fn braking(&self, now: f64, speed: f64, from: f64) -> Rectangle {
        let acting = (now - from).max(0.0);
        let braking = acting.min(speed / self.deceleration);
        let lost = speed * (acting - braking) + self.deceleration * braking * braking / 2.0;
        let (length, width) = CAR;
        Rectangle { front: [speed * now - lost, 0.0], heading: [1.0, 0.0], length, width }
    }

    pub(crate) fn person(&self, now: f64) -> [f64; 2] {
        [self.distance, self.person_speed * now - ASIDE]
    }

    /// Returns when the person has crossed the car's path.
    fn crossed(&self) -> f64 {
        ((ASIDE + CAR.1 / 2.0 + RADIUS) / self.person_speed).min(END)
    }

    /// Returns when the car touches the person if it responds after `response`, or `None` if it
    /// does not.
    pub(crate) fn contact(&self, speed: f64, manoeuvre: Manoeuvre, response: f64) -> Option<f64> {
        let gap = |car: Rectangle, now: f64| (car.distance_to(self.person(now)) - RADIUS).max(0.0);
        match manoeuvre {
            Manoeuvre::Swerve => {
                let swerve = self.swerve(speed);
                let end = self.past(&swerve, response);
                first_contact((0.0, end), swerve.fastest() + self.person_speed, |now| {
                    gap(swerving(&swerve, now, response), now)
                })
            }
            Manoeuvre::Brake => {
                // Nothing more can happen after the car has stopped and the person has crossed.
                let end = (response + speed / self.deceleration).max(self.crossed());
                first_contact((0.0, end), speed.hypot(self.person_speed), |now| {
                    gap(self.braking(now, speed, response), now)
                })
            }
        }
    }

    /// Returns when a swerving car is past the person's line with its whole length, or drives
    /// across the road. Then the car is ahead of the person, or has not come that far.
    fn past(&self, swerve: &Swerve, response: f64) -> f64 {
        const STEP: f64 = 0.01;
        let mut now = 0.0;
        while now < END {
            let car = swerving(swerve, now, response);
            let rearmost =
                car.corners().into_iter().fold(f64::INFINITY, |x, corner| x.min(corner[0]));
            if rearmost > self.distance + RADIUS || car.heading[0] <= 0.0 {
                break;
            }
            now += STEP;
        }
        now
    }

    /// Returns the greatest speed up to which the car touches nobody, in m/s, or `None` if it
    /// touches nobody at 150 m/s either.
    pub(crate) fn greatest(&self, manoeuvre: Manoeuvre, response: f64) -> Option<f64> {
        const STEPS: u32 = 1500;
        const STEP: f64 = 0.1;
        let touches = |speed: f64| self.contact(speed, manoeuvre, response).is_some();
        let first = (1..=STEPS).map(|step| f64::from(step) * STEP).find(|speed| touches(*speed))?;
        let (mut low, mut high) = (first - STEP, first);
        while high - low > 1e-5 {
            let middle = f64::midpoint(low, high);
            if touches(middle) { high = middle } else { low = middle }
        }
        Some(low)
    }
}

/// Returns a car that begins to swerve at `from`.
fn swerving(swerve: &Swerve, now: f64, from: f64) -> Rectangle {
    let (length, width) = CAR;
    let ([x, y], angle) = swerve.pose((now - from).max(0.0));
    let (across, along) = angle.sin_cos();
    // At 0 s the car's front is at 0. Its centre of mass is in its middle.
    let half = length / 2.0;
    let front = [swerve.speed() * now.min(from) + x + half * (along - 1.0), y + half * across];
    Rectangle { front, heading: [along, across], length, width }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `greatest.json` names its source, and `test_worlds.py` compares it with that source.
    #[test]
    fn swerve_is_no_better_than_commonroads() {
        let stored = include_str!("../../python/worlds/greatest.json");
        let stored: serde_json::Value = serde_json::from_str(stored).unwrap();
        let rows: Vec<[f64; 3]> = serde_json::from_value(stored["rows"].clone()).unwrap();
        assert_eq!(rows.len(), 8 * 4);
        for [steering_rate, response, theirs] in rows {
            let geometry = SwerveGeometry {
                distance: 10.0,
                person_speed: 1.5,
                lateral: 7.0,
                steering_rate,
                deceleration: 7.5,
            };
            let ours = geometry.greatest(Manoeuvre::Swerve, response).unwrap();
            // Their figure is rounded to 0.01 and integrated in steps of a millisecond.
            let off = (ours - theirs) / theirs;
            assert!(off.abs() < 0.005, "{steering_rate} rad/s, {response} s: {ours} and {theirs}");
        }
    }
}
