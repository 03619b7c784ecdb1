//! Plays one run: when the runner is seen, what the planner gets, and whether the cars touch.

use serde::Serialize;

use crate::ScenarioError;
use crate::approach::{nanos, seconds};
use crate::braking::Brakes;
use crate::operator::{
    CLOUD, CloudRequest, ScenarioMessage, ScenarioOperator, ScenarioOutput, UNLIMITED,
};
use crate::planner::{FrameStatus, Planner};
use crate::plot::Folder;
use crate::red_light::geometry::{CrossingGeometry, MEETING};
use crate::red_light::sharing::{EVERY, Exchange, VehicleState, must_brake};

/// Frames of the camera in a second.
const RATE: u32 = 30;
/// Frames that must show the runner.
const FRAMES: usize = 3;
/// The deadline of the request for locations.
const DEADLINE: u64 = 500_000_000;

/// The source from which ego learns of the runner.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum WarningSource {
    /// The detector on board.
    Local,
    /// The detector in the cloud.
    Cloud,
    /// The detector on board, and locations that the cloud collects.
    Sharing,
}

/// The detectors, in m and s, and the brakes.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Ego {
    pub(crate) range_local: f64,
    pub(crate) range_cloud: f64,
    pub(crate) local_response: f64,
    pub(crate) cloud_runtime: f64,
    pub(crate) deceleration: f64,
    pub(crate) brake_delay: f64,
}

/// The settings of a run.
#[derive(Clone, Copy)]
pub(crate) struct Crossing<'a> {
    pub(crate) geometry: CrossingGeometry,
    pub(crate) ego: &'a Ego,
    pub(crate) approach: WarningSource,
    /// The round trip between ego and the cloud, in s.
    pub(crate) round_trip: f64,
}

/// States how a run ended, in s.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Crossed {
    /// The instant at which it was decided to brake.
    pub(crate) decided: Option<f64>,
    /// The instant at which the cars touched.
    pub(crate) contact: Option<f64>,
    /// The time before the meeting at which the brakes bit.
    pub(crate) brakes_before: Option<f64>,
}

impl WarningSource {
    pub(crate) const fn word(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Cloud => "cloud",
            Self::Sharing => "sharing",
        }
    }
}

impl Ego {
    pub(crate) const fn brakes(&self) -> Brakes {
        Brakes { deceleration: self.deceleration, delay: self.brake_delay }
    }
}

/// One of ego's operators in a run.
struct CrossingOperator {
    operator: ScenarioOperator,
    name: &'static str,
    /// The number of messages that came.
    messages: u32,
}

impl CrossingOperator {
    fn new(name: &'static str, run: &str, is_traced: bool) -> Self {
        let operator = ScenarioOperator::new(&format!("{name}, {run}"), f64::INFINITY, is_traced);
        Self { operator, name, messages: 0 }
    }

    fn send(&mut self, message: &ScenarioMessage) {
        self.messages += 1;
        self.operator.message(message);
    }
}

impl Crossing<'_> {
    /// Runs the crossing and writes its traces to the folder under this name.
    pub(crate) fn run(
        &self,
        name: &str,
        traces: Option<&Folder>,
    ) -> Result<Crossed, ScenarioError> {
        let (crossed, recorded) = self.traced(name, traces.is_some());
        for (operator, trace) in recorded {
            if let Some(folder) = traces {
                folder.put(&format!("{name}-{operator}.jsonl"), &trace)?;
            }
        }
        Ok(crossed)
    }

    /// Runs the crossing. If `is_traced`, also returns the traces of the operators that had
    /// messages.
    pub(crate) fn traced(
        &self,
        name: &str,
        is_traced: bool,
    ) -> (Crossed, Vec<(&'static str, Vec<u8>)>) {
        let mut detections = CrossingOperator::new("detections", name, is_traced);
        let mut neighbours = CrossingOperator::new("neighbours", name, is_traced);
        let decided = self.decide(&mut detections, &mut neighbours).map(seconds);
        let had_messages = [detections, neighbours].into_iter().filter(|it| it.messages > 0);
        let traces = had_messages.filter_map(|it| Some((it.name, it.operator.into_trace()?)));
        let traces = traces.collect();
        let brakes = self.ego.brakes();
        let contact = self.geometry.contact(decided, &brakes);
        let bite = decided.map(|decided| decided + brakes.delay);
        let in_time = bite.filter(|bite| contact.is_none_or(|contact| *bite < contact));
        (Crossed { decided, contact, brakes_before: in_time.map(before) }, traces)
    }

    /// Returns when ego decides to brake. The first of its two streams to report the runner
    /// decides.
    fn decide(
        &self,
        detections: &mut CrossingOperator,
        neighbours: &mut CrossingOperator,
    ) -> Option<u64> {
        let mut planner = Planner::new(FRAMES);
        let mut exchange = Exchange::new(&self.geometry);
        let mut answers = Vec::new();
        let end = nanos(self.geometry.end());
        while detections.operator.next().is_some() || self.coming(detections, neighbours) < end {
            let to = self.coming(detections, neighbours);
            let next = [detections.operator.next(), neighbours.operator.next()];
            let now = next.into_iter().flatten().fold(to, u64::min);
            if now >= end {
                break;
            }
            if now == to {
                self.send(now, detections, neighbours, &mut exchange, &mut answers);
            } else {
                detections.operator.pass(now);
                neighbours.operator.pass(now);
            }
            let outputs = detections.operator.take_outputs();
            let reported = neighbours.operator.take_outputs();
            let by_sight = outputs.iter().any(|output| self.sees(&mut planner, output));
            let by_word = reported.iter().any(|output| self.is_reported(&answers, output));
            if by_sight || by_word {
                return Some(now);
            }
        }
        None
    }

    /// Returns when the next message comes.
    fn coming(&self, detections: &CrossingOperator, neighbours: &CrossingOperator) -> u64 {
        let frame = captured(detections.messages);
        match self.approach {
            WarningSource::Local | WarningSource::Cloud => frame,
            WarningSource::Sharing => frame.min(u64::from(neighbours.messages) * EVERY),
        }
    }

    fn send(
        &self,
        now: u64,
        detections: &mut CrossingOperator,
        neighbours: &mut CrossingOperator,
        exchange: &mut Exchange<'_>,
        answers: &mut Vec<Vec<VehicleState>>,
    ) {
        detections.operator.pass(now);
        neighbours.operator.pass(now);
        if now == captured(detections.messages) {
            let response = Some(nanos(self.ego.cloud_runtime + self.round_trip));
            let cloud = CloudRequest { deadline: UNLIMITED, response };
            let local = Some(nanos(self.ego.local_response));
            detections.send(&match self.approach {
                WarningSource::Cloud => {
                    ScenarioMessage { at: now, local: None, request: Some(cloud) }
                }
                WarningSource::Local | WarningSource::Sharing => {
                    ScenarioMessage { at: now, local, request: None }
                }
            });
        }
        if self.approach == WarningSource::Sharing && now == u64::from(neighbours.messages) * EVERY
        {
            answers.push(exchange.ego(now));
            let response = Some(nanos(self.round_trip));
            let request = Some(CloudRequest { deadline: DEADLINE, response });
            // Local knows no neighbours, so it returns at once.
            neighbours.send(&ScenarioMessage { at: now, local: Some(0), request });
        }
    }

    /// Returns `true` if a detector's output makes the planner brake.
    fn sees(&self, planner: &mut Planner, output: &ScenarioOutput) -> bool {
        let captured = seconds(captured(u32::try_from(output.t).unwrap_or(u32::MAX)));
        let sight = match output.source {
            None => FrameStatus::Missed,
            Some(source) => {
                let Ego { range_local, range_cloud, .. } = *self.ego;
                let range = if source == CLOUD { range_cloud } else { range_local };
                let is_seen = self.geometry.sees(captured, range);
                if is_seen { FrameStatus::Obstacle } else { FrameStatus::Clear }
            }
        };
        planner.take(usize::try_from(output.t).unwrap_or(usize::MAX), sight)
    }

    /// Returns `true` if the cloud's answer makes the planner brake.
    fn is_reported(&self, answers: &[Vec<VehicleState>], output: &ScenarioOutput) -> bool {
        let index = usize::try_from(output.t).unwrap_or(usize::MAX);
        let reported = answers.get(index).filter(|_| output.source == Some(CLOUD));
        reported.into_iter().flatten().any(|other| must_brake(&self.geometry, other, output.at))
    }
}

/// Returns the time from `bite` to the meeting, to a nanosecond.
fn before(bite: f64) -> f64 {
    ((MEETING - bite) * 1e9).round() / 1e9
}

fn captured(frame: u32) -> u64 {
    nanos(f64::from(frame) / f64::from(RATE))
}
