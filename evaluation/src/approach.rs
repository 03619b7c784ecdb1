//! A vehicle that approaches an obstacle at rest: its figures, what it computes where, and how one
//! drive ends.
//!
//! `traffic_jam` and `networks` run such drives over speeds, responses and policies.

use std::time::Duration;

use fuseline_deadline::{
    Guard, Hazard, Invalid, Metres, MetresPerSecond, MetresPerSecondSquared, Parameters, Situation,
    Span,
};
pub(crate) use fuseline_traces::nanos as whole;
use serde::Serialize;

use crate::braking::{Brakes, DriveOutcome};
use crate::operator::{CLOUD, CloudRequest, ScenarioMessage, ScenarioOperator, UNLIMITED};
use crate::planner::{FrameStatus, Planner};

/// The vehicle, its camera and what it computes with, in metres and seconds.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub(crate) struct Vehicle {
    pub(crate) deceleration: f64,
    pub(crate) brake_delay: f64,
    /// Frames in a second.
    pub(crate) rate: f64,
    /// Frames that must report before it brakes.
    pub(crate) frames: u32,
    pub(crate) range_local: f64,
    pub(crate) range_cloud: f64,
    pub(crate) local_response: f64,
    /// `true` if local computes one frame at a time.
    pub(crate) local_serial: bool,
    /// The obstacle is hidden while it is further away.
    pub(crate) reveal: Option<f64>,
}

/// The answering source.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Approach {
    /// Local alone.
    Local,
    /// The cloud alone, however long it takes.
    Cloud,
    /// Whichever is first.
    First,
    /// Both: the cloud by a deadline, else local.
    Ours,
}

/// One drive towards the obstacle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ApproachRun<'a> {
    pub(crate) vehicle: &'a Vehicle,
    pub(crate) speed: f64,
    /// The instant when the obstacle comes into the greater range, in frames after a capture.
    pub(crate) phase: f64,
    pub(crate) approach: Approach,
    /// The deadline of each request of *ours*.
    pub(crate) deadline: Duration,
}

/// Returns a frame's number as a floating-point number. It is exact, because no drive has 2^32
/// frames.
pub(crate) fn figure(number: u64) -> f64 {
    u32::try_from(number).map_or(f64::INFINITY, f64::from)
}

/// Converts seconds to the nearest number of nanoseconds. Negative seconds give 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded, saturating")]
pub(crate) fn nanos(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

#[expect(clippy::cast_precision_loss, reason = "a drive lasts minutes, and 2^53 ns are 104 days")]
pub(crate) fn seconds(nanos: u64) -> f64 {
    nanos as f64 / 1e9
}

fn time(seconds: f64) -> Duration {
    Duration::from_nanos(nanos(seconds))
}

impl Vehicle {
    pub(crate) fn period(&self) -> f64 {
        self.rate.recip()
    }

    /// Returns the seconds between two frames that local computes.
    pub(crate) fn period_local(&self) -> f64 {
        self.period() * self.frames_of_local()
    }

    /// Returns the number of frame periods for which local is busy with one frame, or 1 if it
    /// computes several frames at once.
    pub(crate) fn frames_of_local(&self) -> f64 {
        if self.local_serial { (self.local_response * self.rate).ceil().max(1.0) } else { 1.0 }
    }

    pub(crate) const fn brakes(&self) -> Brakes {
        Brakes { deceleration: self.deceleration, delay: self.brake_delay }
    }

    /// Returns the shipped guard with this vehicle's figures.
    ///
    /// # Errors
    /// Returns the first figure that makes no sense.
    pub(crate) fn guard(&self) -> Result<Guard, Invalid> {
        let hazard = Hazard {
            weight: 1.0,
            range_local: Metres(self.range_local).into(),
            range_cloud: Metres(self.range_cloud).into(),
        };
        Guard::new(Parameters {
            deceleration: MetresPerSecondSquared(self.deceleration).into(),
            brake_delay: time(self.brake_delay).into(),
            frames: self.frames,
            period_local: Span::of_rate(self.rate / self.frames_of_local()),
            period_cloud: Span::of_rate(self.rate),
            local_response: time(self.local_response).into(),
            classes: hazard.into(),
            ..Parameters::default()
        })
    }

    /// Returns the situation for policies at this speed.
    pub(crate) fn situation(&self, speed: f64) -> Situation<'static> {
        let reveal = self.reveal.map(Metres);
        Situation { reveal, ..Situation::at(MetresPerSecond(speed)) }
    }

    /// Returns the vehicle with the cloud's model in place of its own.
    pub(crate) const fn with_model_on_board(self, response: f64) -> Self {
        Self { range_local: self.range_cloud, local_response: response, ..self }
    }

    /// Returns `true` if a source of this range reports an obstacle at this distance.
    fn reports(&self, range: f64, gap: f64) -> bool {
        gap > 0.0 && gap <= range.min(self.reveal.unwrap_or(f64::INFINITY))
    }
}

impl ApproachRun<'_> {
    /// Returns the gap at the first frame's capture, in metres.
    pub(crate) fn start(&self) -> f64 {
        let Vehicle { range_local, range_cloud, .. } = *self.vehicle;
        range_local.max(range_cloud) + self.phase * self.speed * self.vehicle.period()
    }

    /// Returns about how many frames are captured until the obstacle is reached.
    pub(crate) fn frames(&self) -> f64 {
        self.start() / self.speed * self.vehicle.rate
    }

    /// Drives towards the obstacle. Returns how the drive ends, and when the planner decided to
    /// brake, in nanoseconds.
    ///
    /// `response` returns how long the cloud takes for a frame captured at an instant, in
    /// nanoseconds, or `None` for forever. `operator` must be unused.
    pub(crate) fn run(
        &self,
        operator: &mut ScenarioOperator,
        response: impl Fn(u64) -> Option<u64>,
    ) -> (DriveOutcome, Option<u64>) {
        let (start, period) = (self.start(), self.vehicle.period());
        let mut planner = Planner::new(self.vehicle.frames as usize);
        let mut local = LocalComputation { vehicle: self.vehicle, frees: 0 };
        let reached = start / self.speed;
        let mut decided = None;
        for frame in 0_u64.. {
            let captured = figure(frame) * period;
            if captured >= reached {
                break;
            }
            let at = nanos(captured);
            operator.message(&self.message(at, &mut local, &response));
            decided = self.plan(operator, &mut planner, start);
            if decided.is_some() {
                break;
            }
        }
        // No more frames come, but results that are under way may still decide.
        while decided.is_none() {
            let Some(next) = operator.next().filter(|next| seconds(*next) < reached) else { break };
            operator.pass(next);
            decided = self.plan(operator, &mut planner, start);
        }
        let end = self.vehicle.brakes().end(self.speed, start, decided.map(seconds));
        (end, decided)
    }

    /// Returns the message of the frame captured at this instant.
    fn message(
        &self,
        at: u64,
        local: &mut LocalComputation<'_>,
        response: impl Fn(u64) -> Option<u64>,
    ) -> ScenarioMessage {
        let cloud = |deadline| Some(CloudRequest { deadline, response: response(at) });
        let requested = |local: Option<u64>, request| ScenarioMessage { at, local, request };
        match self.approach {
            Approach::Local => requested(local.take(at), None),
            Approach::Cloud => requested(None, cloud(UNLIMITED)),
            Approach::First => {
                let local = local.take(at);
                requested(local, cloud(local.unwrap_or(UNLIMITED)))
            }
            Approach::Ours => requested(local.take(at), cloud(whole(self.deadline))),
        }
    }

    /// Gives the planner the operator's outputs. Returns when it decided to brake, if it did.
    fn plan(
        &self,
        operator: &mut ScenarioOperator,
        planner: &mut Planner,
        start: f64,
    ) -> Option<u64> {
        let Vehicle { range_local, range_cloud, .. } = *self.vehicle;
        let period = self.vehicle.period();
        operator.take_outputs().into_iter().find_map(|output| {
            let gap = start - self.speed * figure(output.t) * period;
            let sight = match output.source {
                None => FrameStatus::Missed,
                Some(source) => {
                    let range = if source == CLOUD { range_cloud } else { range_local };
                    if self.vehicle.reports(range, gap) {
                        FrameStatus::Obstacle
                    } else {
                        FrameStatus::Clear
                    }
                }
            };
            let frame = usize::try_from(output.t).unwrap_or(usize::MAX);
            planner.take(frame, sight).then_some(output.at)
        })
    }
}

/// Computes on board, frame by frame.
struct LocalComputation<'a> {
    vehicle: &'a Vehicle,
    /// The instant at which it is free again, if it computes one frame at a time.
    frees: u64,
}

impl LocalComputation<'_> {
    /// Starts on a frame captured now and returns how long that takes, or `None` if local is busy.
    fn take(&mut self, at: u64) -> Option<u64> {
        let response = nanos(self.vehicle.local_response);
        if self.vehicle.local_serial && at < self.frees {
            return None;
        }
        self.frees = at.saturating_add(response);
        Some(response)
    }
}
