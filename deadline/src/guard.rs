//! [`Guard`], the longest deadline that is safe (T1, T2). The book's chapter *Deadlines that are
//! safe* has the proofs.

use core::time::Duration;

use crate::invalid::Invalid;
use crate::parameters::{Hazard, Parameters};
use crate::policy::{Case, Chosen, End, Policy, Reason, Situation, rounded_down};
use crate::span::Span;
use crate::units::Metres;

/// Chooses the longest deadline with which fusion never hits what local alone would not have hit
/// (T2).
///
/// Section 9 of `SPEC.md` lists the conditions of this guarantee, and what is not guaranteed (T4).
/// Two conditions concern the planner. It counts timestamps, not arrivals. And an output without a
/// report breaks a row of reports only if local has a result for its timestamp.
///
/// Any shorter deadline keeps the guarantee. So it also holds for every policy that the guard
/// [`cap`](Policy::cap).
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Guard {
    parameters: Parameters,
}

/// The guard's assessment of a situation.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Assessment {
    /// The time after capture, in seconds, until which local's results surely suffice to stop, for
    /// the class that decides. NaN if nothing is known.
    pub budget_local: f64,
    /// The time after capture, in seconds, until which the cloud's results may suffice to stop, for
    /// the class with the longest time. NaN if nothing is known.
    pub budget_cloud: f64,
    /// The case that holds.
    pub case: Case,
    /// The longest deadline that is safe.
    pub deadline: Duration,
}

/// The times of one class of hazards in a situation, in seconds after capture. They are NaN if the
/// situation makes no sense.
struct HazardTimes {
    /// The time until which local's results surely suffice to stop.
    local: f64,
    /// The time from which on local's results surely do not suffice.
    lost: f64,
    /// The time until which the cloud's results may suffice.
    cloud: f64,
}

impl Guard {
    /// Creates a guard for this vehicle.
    ///
    /// # Errors
    /// Returns an [`Invalid`] for the first figure that is not plausible.
    pub fn new(parameters: Parameters) -> Result<Self, Invalid> {
        // Only plausible figures make a guard (T7).
        parameters.check()?;
        Ok(Self { parameters })
    }

    /// Returns the longest deadline that is safe now, and why. Looks at each class once.
    #[must_use]
    pub fn judge(&self, situation: &Situation<'_>) -> Assessment {
        let Parameters { local_response, margin: Metres(margin), .. } = self.parameters;
        let Span { least: shortest, greatest: longest } = local_response;
        let (local_response, lateness) = (local_response.numbers(), self.parameters.lateness);
        let lateness = lateness.as_secs_f64();
        let (mut stops, mut least, mut cloud) = (None, f64::NAN, f64::NAN);
        let mut is_unsure = false;
        for hazard in self.parameters.classes.as_slice() {
            let sight = self.sight(hazard, situation);
            least = sight.local.min(least);
            cloud = sight.cloud.max(cloud);
            if sight.local - lateness >= local_response.greatest {
                stops = Some(sight.local.min(stops.unwrap_or(f64::INFINITY)));
            } else if sight.lost < local_response.least {
                // Local alone collides with this class, whatever fusion does.
            } else {
                is_unsure = true;
            }
        }
        let (case, deadline) = match stops {
            _ if is_unsure => (Case::Unsure, shortest),
            Some(stops) => {
                // At rest the time is unbounded, and no margin is needed.
                let speed = situation.speed.numbers().greatest;
                let spared = if stops.is_finite() { margin / speed } else { 0.0 };
                (Case::LocalStops, longest.max(rounded_down(stops - lateness - spared)))
            }
            // A held result is sent no later than its due instant plus the lateness.
            None if cloud - lateness > local_response.least => {
                (Case::CloudAlone, rounded_down(cloud - lateness))
            }
            // With local's least response no output is later than local's own (T1).
            None => (Case::Unsure, shortest),
        };
        let budget_local = stops.filter(|_| !is_unsure).unwrap_or(least);
        Assessment { budget_local, budget_cloud: cloud, case, deadline }
    }

    /// Returns local's least and greatest response.
    #[must_use]
    pub const fn local_response(&self) -> (Duration, Duration) {
        let Span { least, greatest } = self.parameters.local_response;
        (least, greatest)
    }

    /// Returns the parameters from which the guard was made.
    #[must_use]
    pub const fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    fn sight(&self, hazard: &Hazard, situation: &Situation<'_>) -> HazardTimes {
        let Parameters { deceleration, brake_delay, frames, .. } = self.parameters;
        let Parameters { period_local, period_cloud, .. } = self.parameters;
        let (deceleration, brake_delay) = (deceleration.numbers(), brake_delay.numbers());
        let (period_local, period_cloud) = (period_local.numbers(), period_cloud.numbers());
        let (range_local, range_cloud) =
            (hazard.range_local.numbers(), hazard.range_cloud.numbers());
        let Some((speed, reveal)) = known(situation) else {
            return HazardTimes { local: f64::NAN, lost: f64::NAN, cloud: f64::NAN };
        };
        let frames = f64::from(frames);
        // B = R/v − v/(2a) − τ − n·P: the lemma *The budget* of the book's chapter.
        let time = |range: f64, speed: f64, deceleration: f64, brake_delay: f64, frames: f64| {
            range / speed - speed / (2.0 * deceleration) - brake_delay - frames
        };
        // The obstacle may come into range just after a frame, so one more frame may be needed.
        let local = time(
            range_local.least.min(reveal),
            speed.greatest,
            deceleration.least,
            brake_delay.greatest,
            frames * period_local.greatest,
        );
        let at_best = |range: f64, frames: f64| {
            time(range, speed.least, deceleration.greatest, brake_delay.least, frames)
        };
        // `reveal` does not cap this range. An obstacle that came into sight a frame ago was
        // further away, and local may be about to stop for it. Local may be unable to stop for an
        // obstacle that comes into sight from now on.
        let lost = at_best(range_local.greatest, (frames - 1.0) * period_local.least);
        let cloud = at_best(range_cloud.greatest.min(reveal), frames * period_cloud.least);
        HazardTimes { local, lost, cloud }
    }
}

impl Policy for Guard {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        let Assessment { case, deadline, .. } = self.judge(situation);
        Chosen::within(cap, deadline, Reason::Guard(case))
    }

    fn ended(&mut self, _: End) {}

    fn assumes_one_output(&self) -> bool {
        true
    }
}

/// Returns the speed, and the distance to the nearest place that may hide something, or `None` if
/// either makes no sense.
pub(crate) fn known(situation: &Situation<'_>) -> Option<(Span<f64>, f64)> {
    // In a situation that makes no sense, nothing is known (T7).
    situation.check().ok()?;
    let reveal = situation.reveal.map_or(f64::INFINITY, |Metres(reveal)| reveal);
    // At −0 the vehicle is also at rest, but a division by −0 gives the other sign.
    Some((situation.speed.numbers().map(f64::abs), reveal))
}
