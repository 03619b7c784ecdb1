//! What is known of the vehicle, its sources and the hazards.

use core::time::Duration;

use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::span::Span;
use crate::units::{Metres, MetresPerSecondSquared};

/// The vehicle, its sources and the hazards.
///
/// A figure that is not known exactly is a [`Span`], of which the end that keeps the guarantee counts. The default is the
/// vehicle of the traffic jam; each field names its figure. Of these the paper states local's response, the frames and
/// their rate; the others are chosen so that the paper's table comes out, as the book's chapter *The paper's scenarios*
/// says.
///
/// A number without a unit is no figure:
///
/// ```compile_fail
/// # use fuseline_deadline::{Guard, Parameters};
/// Guard::new(Parameters { local_response: 301.7.into(), ..Parameters::default() });
/// ```
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Parameters {
    /// Full braking; 7.5 m/s².
    pub deceleration: Span<MetresPerSecondSquared>,
    /// From the decision to brake until the brakes act; 0.1 s.
    pub brake_delay: Span<Duration>,
    /// How many frames in a row must report an obstacle before the vehicle brakes; 3.
    pub frames: u32,
    /// The time between two frames that local takes: the camera's if calls overlap; else local's response, rounded up
    /// to frames. 1/30 s.
    pub period_local: Span<Duration>,
    /// The time between two frames that the cloud takes; 1/30 s.
    pub period_cloud: Span<Duration>,
    /// From a frame's capture until local's result; 0.3017 s.
    pub local_response: Span<Duration>,
    /// How much later than capture + deadline an output may leave: late timers, and the time from capture until the
    /// request is made if the deadline counts from there. 5 ms.
    pub lateness: Duration,
    /// The distance to keep from an obstacle where local alone stops anyway; 2 m.
    pub margin: Metres,
    /// What may be on the road; one class, which local sees from 39 m on and the cloud from 57 m on.
    pub classes: Classes,
}

/// A class of hazards, such as standing motorcycles.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hazard {
    /// How much it counts among the classes, above 0; only for losses, since a guarantee counts all classes alike.
    pub weight: f64,
    /// How far away local begins to report it.
    pub range_local: Span<Metres>,
    /// How far away the cloud begins to report it; no less far than local.
    pub range_cloud: Span<Metres>,
}

/// One to [`Classes::MOST`] classes of hazards.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Classes {
    hazards: [Hazard; Self::MOST],
    len: usize,
}

impl Parameters {
    /// Checks every figure.
    pub(crate) fn check(&self) -> Result<(), Invalid> {
        Figure::Deceleration.check(self.deceleration)?;
        Figure::BrakeDelay.check(self.brake_delay)?;
        if self.frames == 0 {
            return Err(Invalid::NoFrames);
        }
        Figure::PeriodLocal.check(self.period_local)?;
        Figure::PeriodCloud.check(self.period_cloud)?;
        Figure::LocalResponse.check(self.local_response)?;
        Figure::Lateness.check(Span::exactly(self.lateness))?;
        Figure::Margin.check(Span::exactly(self.margin))?;
        self.classes.as_slice().iter().try_for_each(Hazard::check)
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            deceleration: MetresPerSecondSquared(7.5).into(),
            brake_delay: Duration::from_millis(100).into(),
            frames: 3,
            period_local: Span::of_rate(30.0),
            period_cloud: Span::of_rate(30.0),
            local_response: Duration::from_micros(301_700).into(),
            lateness: Duration::from_millis(5),
            margin: Metres(2.0),
            classes: Hazard::default().into(),
        }
    }
}

impl Hazard {
    fn check(&self) -> Result<(), Invalid> {
        let Self { weight, range_local, range_cloud } = *self;
        Figure::Weight.check(Span::exactly(weight))?;
        Figure::RangeLocal.check(range_local)?;
        Figure::RangeCloud.check(range_cloud)?;
        if range_cloud.least < range_local.least || range_cloud.greatest < range_local.greatest {
            return Err(Invalid::CloudSeesLess);
        }
        Ok(())
    }
}

impl Default for Hazard {
    fn default() -> Self {
        Self { weight: 1.0, range_local: Metres(39.0).into(), range_cloud: Metres(57.0).into() }
    }
}

impl Classes {
    /// How many classes there may be.
    pub const MOST: usize = 8;

    /// These classes, in any order.
    ///
    /// # Errors
    /// [`Invalid::Classes`] if there are none or too many.
    pub fn new(hazards: &[Hazard]) -> Result<Self, Invalid> {
        let mut all = [Hazard::default(); Self::MOST];
        match all.get_mut(..hazards.len()) {
            Some(some) if !hazards.is_empty() => some.copy_from_slice(hazards),
            _ => return Err(Invalid::Classes(hazards.len())),
        }
        Ok(Self { hazards: all, len: hazards.len() })
    }

    /// The classes as they were given.
    #[must_use]
    pub fn as_slice(&self) -> &[Hazard] {
        self.hazards.get(..self.len).unwrap_or_default()
    }
}

impl From<Hazard> for Classes {
    fn from(hazard: Hazard) -> Self {
        Self { hazards: [hazard; Self::MOST], len: 1 }
    }
}
