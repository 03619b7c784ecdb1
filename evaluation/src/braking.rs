//! Stops a vehicle before an obstacle at rest: constant speed, then a delay, then constant
//! deceleration.

/// Brakes, in metres and seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Brakes {
    /// The deceleration of full braking.
    pub(crate) deceleration: f64,
    /// The time from the decision until the brakes bite.
    pub(crate) delay: f64,
}

/// States how a drive towards an obstacle at rest ends.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum DriveOutcome {
    /// The vehicle stands, with this many metres left.
    Stops {
        /// In metres, above 0.
        gap: f64,
    },
    /// It reaches the obstacle.
    Hits {
        /// At this speed, in m/s.
        impact: f64,
    },
}

impl Brakes {
    /// Returns how the drive ends if the vehicle decides to brake `decided` after the gap was
    /// `start`, or if it never decides. A vehicle that reaches a gap of 0 hits the obstacle.
    pub(crate) fn end(&self, speed: f64, start: f64, decided: Option<f64>) -> DriveOutcome {
        let gap = decided.map_or(0.0, |decided| start - speed * (decided + self.delay));
        if gap <= 0.0 {
            return DriveOutcome::Hits { impact: speed };
        }
        let remaining = gap - speed * speed / (2.0 * self.deceleration);
        if remaining > 0.0 {
            return DriveOutcome::Stops { gap: remaining };
        }
        DriveOutcome::Hits { impact: (-2.0 * self.deceleration * remaining).max(0.0).sqrt() }
    }
}

impl DriveOutcome {
    pub(crate) const fn hits(self) -> bool {
        matches!(self, Self::Hits { .. })
    }

    /// Returns the square of the speed at impact, in m²/s².
    pub(crate) fn energy(self) -> f64 {
        match self {
            Self::Stops { .. } => 0.0,
            Self::Hits { impact } => impact * impact,
        }
    }
}
