//! Figures with their units.

use core::time::Duration;

/// A distance in metres.
#[derive(Clone, Copy, PartialEq, PartialOrd, Default, Debug)]
pub struct Metres(pub f64);

/// A speed in m/s. 50 km/h is `MetresPerSecond(50.0 / 3.6)`.
#[derive(Clone, Copy, PartialEq, PartialOrd, Default, Debug)]
pub struct MetresPerSecond(pub f64);

/// An acceleration or a deceleration in m/s².
#[derive(Clone, Copy, PartialEq, PartialOrd, Default, Debug)]
pub struct MetresPerSecondSquared(pub f64);

/// A figure that has a number in the unit of its kind: metres, seconds, or a unit made of them.
pub(crate) trait Quantity: Copy {
    /// Returns the number.
    fn number(self) -> f64;
}

impl Quantity for Metres {
    fn number(self) -> f64 {
        self.0
    }
}

impl Quantity for MetresPerSecond {
    fn number(self) -> f64 {
        self.0
    }
}

impl Quantity for MetresPerSecondSquared {
    fn number(self) -> f64 {
        self.0
    }
}

impl Quantity for Duration {
    fn number(self) -> f64 {
        self.as_secs_f64()
    }
}

impl Quantity for f64 {
    fn number(self) -> f64 {
        self
    }
}
