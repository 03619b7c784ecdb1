//! The vehicle, its sources and the hazards.

use core::time::Duration;

use crate::figure::Figure;
use crate::invalid::Invalid;
use crate::span::Span;
use crate::units::{Metres, MetresPerSecondSquared};

/// Describes the vehicle, its sources and the hazards.
///
/// A figure that is not known exactly is a [`Span`]; the guard uses the end of it that keeps the
/// guarantee. Each field states its default, which is the vehicle of the paper's traffic jam. The
/// paper gives local's response, the frames and their rate. The other defaults were chosen so that
/// they reproduce the paper's table, as the book's chapter *The paper's scenarios* explains.
///
/// A number without a unit does not compile:
///
/// ```compile_fail
/// # use fuseline_deadline::{Guard, Parameters};
/// Guard::new(Parameters { local_response: 301.7.into(), ..Parameters::default() });
/// ```
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Parameters {
    /// The deceleration of full braking; 7.5 m/s² by default.
    pub deceleration: Span<MetresPerSecondSquared>,
    /// The time from the decision to brake until the brakes act; 0.1 s by default.
    pub brake_delay: Span<Duration>,
    /// The number of frames in a row that must report an obstacle before the vehicle brakes; 3 by
    /// default.
    pub frames: u32,
    /// The time between two frames that local processes; 1/30 s by default. It is the camera's
    /// period if local's calls overlap, and otherwise local's response rounded up to whole periods.
    pub period_local: Span<Duration>,
    /// The time between two frames that the cloud processes; 1/30 s by default.
    pub period_cloud: Span<Duration>,
    /// The time from a frame's capture until local's result; 0.3017 s by default.
    pub local_response: Span<Duration>,
    /// The greatest delay of an output after capture + deadline; 5 ms by default. It covers late
    /// timers. If the deadline counts from the request, it also covers the time from capture until
    /// the request.
    pub lateness: Duration,
    /// The distance to keep from an obstacle where local alone stops anyway; 2 m by default.
    pub margin: Metres,
    /// The classes of hazards on the road. By default there is one class, which local sees from 39
    /// m on and the cloud from 57 m on.
    pub classes: Classes,
}

/// A class of hazards, such as standing motorcycles.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hazard {
    /// The weight of this class among all classes, above 0. Only losses use it; a guarantee counts
    /// all classes equally.
    pub weight: f64,
    /// The distance from which local begins to report the hazard.
    pub range_local: Span<Metres>,
    /// The distance from which the cloud begins to report the hazard; no less than local's.
    pub range_cloud: Span<Metres>,
}

/// A list of one to [`Classes::MOST`] classes of hazards.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Classes {
    hazards: [Hazard; Self::MOST],
    len: usize,
}

impl Parameters {
    /// The default of each field.
    pub const DEFAULT: Self = Self {
        deceleration: Span::exactly(MetresPerSecondSquared(7.5)),
        brake_delay: Span::exactly(Duration::from_millis(100)),
        frames: 3,
        period_local: Span::of_rate(30.0),
        period_cloud: Span::of_rate(30.0),
        local_response: Span::exactly(Duration::from_micros(301_700)),
        lateness: Duration::from_millis(5),
        margin: Metres(2.0),
        classes: Classes { hazards: [Hazard::DEFAULT; Classes::MOST], len: 1 },
    };

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
        Self::DEFAULT
    }
}

impl Hazard {
    /// The class that [`Parameters::DEFAULT`] has.
    pub const DEFAULT: Self = Self {
        weight: 1.0,
        range_local: Span::exactly(Metres(39.0)),
        range_cloud: Span::exactly(Metres(57.0)),
    };

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
        Self::DEFAULT
    }
}

impl Classes {
    /// The greatest number of classes.
    pub const MOST: usize = 8;

    /// Creates a list of these classes, in any order.
    ///
    /// # Errors
    /// Returns [`Invalid::Classes`] if there are none or too many.
    pub fn new(hazards: &[Hazard]) -> Result<Self, Invalid> {
        let mut all = [Hazard::default(); Self::MOST];
        match all.get_mut(..hazards.len()) {
            Some(some) if !hazards.is_empty() => some.copy_from_slice(hazards),
            _ => return Err(Invalid::Classes(hazards.len())),
        }
        Ok(Self { hazards: all, len: hazards.len() })
    }

    /// Returns the classes in the order in which they were given.
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
