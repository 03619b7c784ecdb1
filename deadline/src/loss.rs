//! The loss of an output, which depends on its source and its time.
//!
//! The book's chapter *Deadlines* derives the formulas of [`Impact`] and [`Accuracy`].

use core::time::Duration;

use crate::figure::Figure;
use crate::guard::{Guard, known};
use crate::invalid::Invalid;
use crate::parameters::{Hazard, Parameters};
use crate::policy::Situation;
use crate::span::Span;
use crate::units::Metres;

/// Returns the loss of an output, by its source and its time after capture, in any unit. Less is
/// better.
///
/// A function of the same form is a loss too. A deadline whose loss is NaN is not chosen for that
/// loss.
pub trait Loss {
    /// Returns the loss of one message whose output comes from `source`, `response` after capture.
    fn loss(&self, situation: &Situation<'_>, source: Source, response: Duration) -> f64;

    /// Checks the loss's figures when a policy is made of it.
    ///
    /// # Errors
    /// Returns an [`Invalid`] for the first figure that is not plausible.
    fn check(&self) -> Result<(), Invalid> {
        Ok(())
    }
}

/// The source of an output.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Source {
    /// Local.
    Local,
    /// The cloud whose deadline is chosen.
    Cloud,
}

/// The square of the speed at impact, in m²/s², as the mean over the classes, by weight.
///
/// The obstacle is at rest and comes into range just after a frame.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Impact {
    parameters: Parameters,
}

/// The accuracy lost in comparison with the better source, and a price for each millisecond of
/// waiting.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Accuracy {
    /// Local's accuracy, such as its AP.
    pub local: f64,
    /// The cloud's accuracy, in the same unit.
    pub cloud: f64,
    /// The price of a millisecond, in the unit of accuracy.
    pub price_per_ms: f64,
}

impl From<&Guard> for Impact {
    fn from(guard: &Guard) -> Self {
        Self { parameters: *guard.parameters() }
    }
}

impl Loss for Impact {
    fn loss(&self, situation: &Situation<'_>, source: Source, response: Duration) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for hazard in self.parameters.classes.as_slice() {
            sum += hazard.weight * self.impact(hazard, situation, source, response);
            weights += hazard.weight;
        }
        sum / weights
    }
}

impl Loss for Accuracy {
    fn loss(&self, _: &Situation<'_>, source: Source, response: Duration) -> f64 {
        let accuracy = match source {
            Source::Local => self.local,
            Source::Cloud => self.cloud,
        };
        self.local.max(self.cloud) - accuracy + self.price_per_ms * response.as_secs_f64() * 1e3
    }

    fn check(&self) -> Result<(), Invalid> {
        Figure::AccuracyLocal.check(Span::exactly(self.local))?;
        Figure::AccuracyCloud.check(Span::exactly(self.cloud))?;
        Figure::Price.check(Span::exactly(self.price_per_ms))
    }
}

impl<F: Fn(&Situation<'_>, Source, Duration) -> f64> Loss for F {
    fn loss(&self, situation: &Situation<'_>, source: Source, response: Duration) -> f64 {
        self(situation, source, response)
    }
}

impl Impact {
    fn impact(
        &self,
        hazard: &Hazard,
        situation: &Situation<'_>,
        source: Source,
        response: Duration,
    ) -> f64 {
        let Parameters { deceleration, brake_delay, frames, .. } = self.parameters;
        let Some((speed, reveal)) = known(situation) else { return f64::NAN };
        let (range, period) = match source {
            Source::Local => (hazard.range_local, self.parameters.period_local),
            Source::Cloud => (hazard.range_cloud, self.parameters.period_cloud),
        };
        let speed = speed.greatest;
        let (brake_delay, period) = (brake_delay.numbers().greatest, period.numbers().greatest);
        let delay = response.as_secs_f64() + brake_delay + f64::from(frames) * period;
        let Metres(range) = range.least;
        let gap = range.min(reveal) - speed * delay;
        if gap > 0.0 {
            (speed * speed - 2.0 * deceleration.numbers().least * gap).max(0.0)
        } else {
            speed * speed
        }
    }
}
