//! What an output costs, by its source and when it comes.
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

/// What an output of a source costs at a time after capture. In any unit; less is better.
///
/// A function of the same form is a loss too. Where it is not a number, no deadline is chosen for its sake.
pub trait Loss {
    /// The loss of one message.
    fn loss(&self, situation: &Situation<'_>, source: Source, response: Duration) -> f64;

    /// Refuses figures that are not plausible, when a policy is made of it.
    ///
    /// # Errors
    /// The first figure that makes no sense.
    fn check(&self) -> Result<(), Invalid> {
        Ok(())
    }
}

/// Whose result an output is.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Source {
    /// The computation on board.
    Local,
    /// The cloud whose deadline is chosen.
    Cloud,
}

/// Square of the speed at impact, in m²/s², with an obstacle at rest that comes into range just after a frame: the mean
/// over the classes, by weight.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Impact {
    parameters: Parameters,
}

/// Accuracy lost against the better source, and a price for each millisecond of waiting.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Accuracy {
    /// Local's accuracy, such as its AP.
    pub local: f64,
    /// The cloud's accuracy.
    pub cloud: f64,
    /// What a millisecond costs, in the unit of accuracy.
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
