//! What is known of the vehicle, its sources and the hazards.

use crate::invalid::{Figure, Invalid};
use crate::span::Span;

/// The vehicle, its sources and the hazards, in metres and seconds.
///
/// A figure that is not known exactly is a [`Span`], of which the end that keeps the guarantee counts. The default is the
/// vehicle of the traffic jam; each field names its figure.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Parameters {
    /// Full braking, in m/s²; 7.5.
    pub deceleration: Span,
    /// From the decision to brake until the brakes act, in seconds; 0.1.
    pub brake_delay: Span,
    /// How many frames in a row must report an obstacle before the vehicle brakes; 3.
    pub frames: u32,
    /// Seconds between two frames that local takes: the camera's if calls overlap; else local's response, rounded up
    /// to frames. 1/30.
    pub period_local: Span,
    /// Seconds between two frames that the cloud takes; 1/30.
    pub period_cloud: Span,
    /// From a frame's capture until local's result, in seconds; 0.3017.
    pub local_response: Span,
    /// How much later than capture + deadline an output may leave, in seconds: late timers, and the time from capture
    /// until the request is made if the deadline counts from there. 0.005.
    pub lateness: f64,
    /// The distance to keep from an obstacle where local alone stops anyway, in metres; 2.
    pub margin: f64,
    /// What may be on the road; one class, which local sees from 39 m on and the cloud from 57 m on.
    pub classes: Classes,
}

/// A class of hazards, such as standing motorcycles.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hazard {
    /// How much it counts among the classes, above 0; only for losses, since a guarantee counts all classes alike.
    pub weight: f64,
    /// How far away local begins to report it, in metres.
    pub range_local: Span,
    /// How far away the cloud begins to report it, in metres; no less far than local.
    pub range_cloud: Span,
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
        above_0(Figure::Deceleration, self.deceleration)?;
        not_below_0(Figure::BrakeDelay, self.brake_delay)?;
        if self.frames == 0 {
            return Err(Invalid::NoFrames);
        }
        above_0(Figure::PeriodLocal, self.period_local)?;
        above_0(Figure::PeriodCloud, self.period_cloud)?;
        above_0(Figure::LocalResponse, self.local_response)?;
        not_below_0(Figure::Lateness, self.lateness.into())?;
        not_below_0(Figure::Margin, self.margin.into())?;
        self.classes.as_slice().iter().try_for_each(Hazard::check)
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            deceleration: 7.5.into(),
            brake_delay: 0.1.into(),
            frames: 3,
            period_local: (1.0 / 30.0).into(),
            period_cloud: (1.0 / 30.0).into(),
            local_response: 0.3017.into(),
            lateness: 0.005,
            margin: 2.0,
            classes: Hazard::default().into(),
        }
    }
}

impl Hazard {
    fn check(&self) -> Result<(), Invalid> {
        let Self { weight, range_local, range_cloud } = *self;
        above_0(Figure::Weight, weight.into())?;
        above_0(Figure::RangeLocal, range_local)?;
        above_0(Figure::RangeCloud, range_cloud)?;
        if range_cloud.least < range_local.least || range_cloud.greatest < range_local.greatest {
            return Err(Invalid::CloudSeesLess);
        }
        Ok(())
    }
}

impl Default for Hazard {
    fn default() -> Self {
        Self { weight: 1.0, range_local: 39.0.into(), range_cloud: 57.0.into() }
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

pub(crate) fn above_0(figure: Figure, span: Span) -> Result<(), Invalid> {
    not_below_0(figure, span)?;
    if span.least > 0.0 { Ok(()) } else { Err(Invalid::NotAbove0(figure)) }
}

fn not_below_0(figure: Figure, span: Span) -> Result<(), Invalid> {
    if !span.is_sound() {
        return Err(Invalid::Span(figure));
    }
    if span.least >= 0.0 { Ok(()) } else { Err(Invalid::Below0(figure)) }
}
