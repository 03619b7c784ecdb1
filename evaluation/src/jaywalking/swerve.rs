//! The way of a car that steers: a single track without slip, whose wheels turn no faster than they can.

/// From the rear axle to the front axle, in m: that of the BMW 320i among `CommonRoad`'s vehicles.
pub(crate) const WHEELBASE: f64 = 2.58;
/// From the rear axle to the car's front, in m.
pub(crate) const FRONT: f64 = WHEELBASE + 0.8;
/// From the rear axle to the corner that is furthest from it, in m, or a little more.
const REACH: f64 = 3.6;
/// The wheels turn no further, in rad: those of the same car.
const MOST: f64 = 1.066;

/// A swerve to the left at constant speed. The steering angle grows at a constant rate until the lateral acceleration that
/// is wanted is there, and stays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Swerve {
    speed: f64,
    /// Of the steering angle, in rad/s.
    rate: f64,
    /// How long the wheels turn.
    turning: f64,
    /// How fast the heading turns after that, in rad/s.
    turn: f64,
    /// The rear axle and the heading when the wheels have turned.
    turned: ([f64; 2], f64),
}

impl Swerve {
    /// At this speed, with at most this lateral acceleration and this steering rate.
    pub(crate) fn new(speed: f64, lateral: f64, rate: f64) -> Self {
        let angle = (lateral * WHEELBASE / (speed * speed)).atan().min(MOST);
        let turning = angle / rate;
        let turn = speed * angle.tan() / WHEELBASE;
        let mut swerve = Self { speed, rate, turning, turn, turned: ([0.0; 2], 0.0) };
        swerve.turned = (swerve.while_turning(turning), swerve.heading(turning));
        swerve
    }

    pub(crate) const fn speed(&self) -> f64 {
        self.speed
    }

    /// No part of the car is faster.
    pub(crate) fn fastest(&self) -> f64 {
        self.speed + self.turn * REACH
    }

    /// Where the rear axle is after so long, from where the swerve began, and the heading in rad.
    pub(crate) fn pose(&self, after: f64) -> ([f64; 2], f64) {
        if after <= self.turning {
            return (self.while_turning(after), self.heading(after));
        }
        // A circle.
        let ([x, y], from) = self.turned;
        let to = from + self.turn * (after - self.turning);
        let radius = self.speed / self.turn;
        ([x + radius * (to.sin() - from.sin()), y + radius * (from.cos() - to.cos())], to)
    }

    /// The heading while the wheels turn: the integral of v·tan(rate·t)/wheelbase.
    fn heading(&self, after: f64) -> f64 {
        -self.speed / (WHEELBASE * self.rate) * (self.rate * after).cos().ln()
    }

    /// Where the rear axle is while the wheels turn: the integral of the speed along the heading, by Gauss and Legendre's
    /// rule of five places. It is off by far less than a millimetre.
    fn while_turning(&self, after: f64) -> [f64; 2] {
        const PLACES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (-0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let half = after / 2.0;
        PLACES.iter().fold([0.0; 2], |[x, y], (node, weight)| {
            let (sin, cos) = self.heading(half * (1.0 + node)).sin_cos();
            let step = self.speed * half * weight;
            [x + step * cos, y + step * sin]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same by small steps of time.
    fn stepped(speed: f64, lateral: f64, rate: f64, after: f64) -> ([f64; 2], f64) {
        const STEPS: u32 = 200_000;
        let step = after / f64::from(STEPS);
        let most = (lateral * WHEELBASE / (speed * speed)).atan().min(MOST);
        let (mut at, mut heading) = ([0.0, 0.0], 0.0_f64);
        for number in 0..STEPS {
            let angle = (rate * step * (f64::from(number) + 0.5)).min(most);
            let turn = speed * angle.tan() / WHEELBASE * step;
            let (sin, cos) = (heading + turn / 2.0).sin_cos();
            at = [at[0] + speed * step * cos, at[1] + speed * step * sin];
            heading += turn;
        }
        (at, heading)
    }

    #[test]
    fn the_way_is_that_of_small_steps_of_time() {
        for (speed, lateral, rate) in
            [(9.0, 7.0, 0.4), (4.0, 7.0, 0.4), (2.0, 7.0, 0.4), (16.0, 3.0, 1.0), (9.0, 7.0, 1e3)]
        {
            for after in [0.1, 0.5, 1.0, 2.0] {
                let (at, heading) = Swerve::new(speed, lateral, rate).pose(after);
                let (other, turned) = stepped(speed, lateral, rate, after);
                let off = (at[0] - other[0]).hypot(at[1] - other[1]);
                assert!(off < 1e-4 && (heading - turned).abs() < 1e-4, "{speed} {after}: {off}");
            }
        }
    }
}
