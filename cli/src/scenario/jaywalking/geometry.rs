//! A car and a person who steps onto the road, in m and s.

use serde::Serialize;

use crate::scenario::shape::{Rectangle, first_contact};

/// The car's length and width.
pub(crate) const CAR: (f64, f64) = (4.7, 1.9);
/// The person is a disc.
pub(crate) const RADIUS: f64 = 0.3;
/// How far to the right of the middle of the car's lane the person begins.
pub(crate) const ASIDE: f64 = 1.75;
/// Whoever does not cross within so long never does.
const END: f64 = 60.0;

/// What the car does about the person.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Manoeuvre {
    /// To the left, with speed and heading kept.
    Swerve,
    Brake,
}

/// Where the person is, and what the car can do.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Geometry {
    /// From the car's front to the person's line at 0 s.
    pub(crate) distance: f64,
    pub(crate) person_speed: f64,
    /// To the left.
    pub(crate) lateral: f64,
    pub(crate) deceleration: f64,
}

impl Geometry {
    /// The car, if it does so from `from` on.
    pub(crate) fn car(&self, now: f64, speed: f64, manoeuvre: Manoeuvre, from: f64) -> Rectangle {
        let acting = (now - from).max(0.0);
        let front = match manoeuvre {
            Manoeuvre::Swerve => [speed * now, self.lateral * acting * acting / 2.0],
            Manoeuvre::Brake => {
                let braking = acting.min(speed / self.deceleration);
                let lost = speed * (acting - braking) + self.deceleration * braking * braking / 2.0;
                [speed * now - lost, 0.0]
            }
        };
        let (length, width) = CAR;
        Rectangle { front, heading: [1.0, 0.0], length, width }
    }

    /// The person.
    pub(crate) fn person(&self, now: f64) -> [f64; 2] {
        [self.distance, self.person_speed * now - ASIDE]
    }

    /// When the person has crossed the car's way.
    fn crossed(&self) -> f64 {
        ((ASIDE + CAR.1 / 2.0 + RADIUS) / self.person_speed).min(END)
    }

    /// When the car touches the person, if it responds after so long.
    pub(crate) fn contact(&self, speed: f64, manoeuvre: Manoeuvre, response: f64) -> Option<f64> {
        // Until the car is past, or stands and the person has crossed: then nothing more can happen.
        let past = (self.distance + CAR.0 + RADIUS) / speed;
        let end = match manoeuvre {
            Manoeuvre::Swerve => past,
            Manoeuvre::Brake => (response + speed / self.deceleration).max(self.crossed()),
        };
        let contingency = match manoeuvre {
            Manoeuvre::Swerve => self.lateral * (end - response).max(0.0),
            Manoeuvre::Brake => 0.0,
        };
        let fastest = speed.hypot(self.person_speed + contingency);
        first_contact((0.0, end), fastest, |now| {
            let car = self.car(now, speed, manoeuvre, response);
            (car.distance_to(self.person(now)) - RADIUS).max(0.0)
        })
    }

    /// The greatest speed up to which it touches nobody, in m/s; none if it always might.
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
