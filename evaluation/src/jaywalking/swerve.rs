//! The path of a car that steers at constant speed. The model is `CommonRoad`'s single track: its
//! tyres slip, and its wheels turn at a limited rate.
//!
//! Both axles have the same cornering stiffness, so the equations of the single track decouple. The
//! yaw rate follows the steering angle with one lag, and the slip angle follows both with another.
//! Both have closed forms while the wheels turn at a constant rate. Only the position is integrated
//! in steps.

use crate::shape::Point;

// Vehicle 2, a BMW 320i (`parameters_vehicle2` of commonroad-vehicle-models 3.0.2).
/// The distance from the centre of mass to the rear axle, in m.
const REAR: f64 = 1.422_717_093_6;
/// The distance from the front axle to the centre of mass, in m.
const BEFORE: f64 = 1.156_195_706_4;
const WHEELBASE: f64 = REAR + BEFORE;
/// The moment of inertia divided by the mass and both distances. It is the ratio of the yaw rate's
/// lag to the slip's.
const INERTIA: f64 = 1_791.599_530_012_285_6 / (1_093.295_233_467_404_6 * REAR * BEFORE);
/// The tyres' lateral acceleration for each radian of slip, in m/s²: 21.92 g.
const STIFFNESS: f64 = 21.92 * 9.81;
/// The greatest angle of the wheels, in rad.
const MOST: f64 = 1.066;

/// The distance from the centre of mass to the car's corners, in m, or a little more. The centre of
/// mass is the middle of the car's rectangle.
const REACH: f64 = 2.54;
/// The longest step of the integration of the position, in s.
const STEP: f64 = 0.05;

/// A swerve to the left at constant speed. The steering angle grows at a constant rate until it
/// gives the wanted lateral acceleration, and then stays.
#[derive(Clone, Debug)]
pub(crate) struct Swerve {
    speed: f64,
    /// The rate of the steering angle, in rad/s.
    rate: f64,
    /// The time for which the wheels turn.
    turning: f64,
    /// The final speed at which the heading turns, in rad/s.
    turn: f64,
    /// The duration of a step of `places`.
    step: f64,
    /// The centre of mass after each step, until the car drives on a circle.
    places: Vec<Point>,
}

impl Swerve {
    /// Creates a swerve at this speed, with at most this lateral acceleration and this steering
    /// rate.
    pub(crate) fn new(speed: f64, lateral: f64, rate: f64) -> Self {
        let angle = (lateral * WHEELBASE / (speed * speed)).atan().min(MOST);
        let turning = angle / rate;
        let turn = speed * angle / WHEELBASE;
        // No step spans the instant at which the wheels stop turning.
        let step = if turning < STEP / 4.0 { STEP } else { turning / (turning / STEP).ceil() };
        let mut swerve = Self { speed, rate, turning, turn, step, places: vec![[0.0; 2]] };
        let settled = turning + 30.0 * swerve.lags().1;
        while swerve.integrated() < settled {
            let next = swerve.pose(swerve.integrated() + step).0;
            swerve.places.push(next);
        }
        swerve
    }

    pub(crate) const fn speed(&self) -> f64 {
        self.speed
    }

    /// Returns a speed that no part of the car exceeds.
    pub(crate) fn fastest(&self) -> f64 {
        self.speed + self.turn * REACH
    }

    /// Returns the position of the centre of mass after this time, relative to where the swerve
    /// began, and the heading in rad.
    pub(crate) fn pose(&self, after: f64) -> (Point, f64) {
        let heading = self.heading(after);
        let number = self.index(after);
        let ([x, y], from) = (self.places[number], self.step_start(number));
        let [along, across] = if after <= from + 1.001 * self.step {
            self.driven(from, after)
        } else {
            // By now the car drives on a circle.
            let radius = self.speed / self.turn;
            let [from, to] = [from, after].map(|at| self.heading(at) + self.slip(at));
            [radius * (to.sin() - from.sin()), radius * (from.cos() - to.cos())]
        };
        ([x + along, y + across], heading)
    }

    /// Returns the last step that begins by this time.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundreds")]
    fn index(&self, after: f64) -> usize {
        ((after / self.step) as usize).min(self.places.len() - 1)
    }

    #[expect(clippy::cast_precision_loss, reason = "some hundreds")]
    fn step_start(&self, number: usize) -> f64 {
        number as f64 * self.step
    }

    /// Returns the time until which the positions are known.
    fn integrated(&self) -> f64 {
        self.step_start(self.places.len() - 1)
    }

    /// Returns the lags of the slip angle and of the yaw rate, in s.
    fn lags(&self) -> (f64, f64) {
        let lag = self.speed / STIFFNESS;
        (lag, lag * INERTIA)
    }

    /// Returns the effect of a ramp of the steering angle that ends when the wheels stop. It is the
    /// ramp minus a second ramp that begins then.
    fn after_ramp(&self, after: f64, ramp: impl Fn(f64) -> f64) -> f64 {
        let beyond = if after > self.turning { ramp(after - self.turning) } else { 0.0 };
        self.rate * (ramp(after) - beyond)
    }

    /// Returns the heading. The yaw rate lags behind the steering angle.
    fn heading(&self, after: f64) -> f64 {
        let (_, lag) = self.lags();
        let ramp = |at: f64| at * at / 2.0 - lag * at - lag * lag * (-at / lag).exp_m1();
        self.speed / WHEELBASE * self.after_ramp(after, ramp)
    }

    /// Returns the angle from the heading to the direction in which the centre of mass moves.
    fn slip(&self, after: f64) -> f64 {
        let (own, yaw) = self.lags();
        let gain = self.speed / WHEELBASE;
        let slope = REAR / WHEELBASE - gain * own;
        let level = (gain * yaw - slope) * own;
        let yawing = gain * yaw / (1.0 / own - 1.0 / yaw);
        self.after_ramp(after, |at| {
            slope * at + level - yawing * (-at / yaw).exp() - (level - yawing) * (-at / own).exp()
        })
    }

    /// Returns the displacement between two instants that are less than two steps apart. It
    /// integrates the velocity by Gauss–Legendre quadrature with five points.
    fn driven(&self, from: f64, to: f64) -> Point {
        const PLACES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (-0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let half = (to - from) / 2.0;
        PLACES.iter().fold([0.0; 2], |[x, y], (node, weight)| {
            let at = from + half * (1.0 + node);
            let (sin, cos) = (self.heading(at) + self.slip(at)).sin_cos();
            let step = self.speed * half * weight;
            [x + step * cos, y + step * sin]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Solves the single track's equations by Euler's method, in small steps of time.
    fn stepped(speed: f64, lateral: f64, rate: f64, after: f64) -> (Point, f64) {
        const STEPS: u32 = 400_000;
        let step = after / f64::from(STEPS);
        let most = (lateral * WHEELBASE / (speed * speed)).atan().min(MOST);
        let (mut at, mut heading, mut yaw, mut slip) = ([0.0, 0.0], 0.0_f64, 0.0, 0.0_f64);
        let lag = STIFFNESS / speed;
        for number in 0..STEPS {
            let angle = (rate * step * (f64::from(number) + 0.5)).min(most);
            let (sin, cos) = (heading + slip).sin_cos();
            at = [at[0] + speed * step * cos, at[1] + speed * step * sin];
            heading += yaw * step;
            let slips = lag * (REAR / WHEELBASE * angle - slip) - yaw;
            yaw += lag / INERTIA * (speed / WHEELBASE * angle - yaw) * step;
            slip += slips * step;
        }
        (at, heading)
    }

    #[test]
    fn way_is_that_of_small_steps_of_time() {
        for (speed, lateral, rate) in
            [(9.0, 7.0, 0.4), (4.0, 7.0, 0.4), (2.0, 7.0, 0.4), (16.0, 3.0, 1.0), (9.0, 7.0, 1e3)]
        {
            let swerve = Swerve::new(speed, lateral, rate);
            for after in [0.1, 0.5, 1.0, 2.0, 4.0] {
                let (at, heading) = swerve.pose(after);
                let (other, turned) = stepped(speed, lateral, rate, after);
                let off = (at[0] - other[0]).hypot(at[1] - other[1]);
                assert!(off < 1e-3 && (heading - turned).abs() < 1e-4, "{speed} {after}: {off}");
            }
        }
    }
}
