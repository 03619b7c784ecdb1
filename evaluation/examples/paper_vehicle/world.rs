//! The emulated world of the vehicle: parts that can be killed, and recorded networks.

use std::future::pending;
use std::time::Duration;

use fuseline_tokio::Error;
use tokio::time::{Instant, sleep};

use super::recording::in_steps;

/// A part that can be killed while the vehicle drives.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum VehiclePart {
    LeftCamera,
    RightCamera,
    Localization,
    WestDetector,
    EastDetector,
    CloudTracker,
    LocalDetector,
    LocalTracker,
    LocalPredictor,
    LocalPlanner,
}

/// The part that dies, and the instant. A dead sensor sends nothing; a dead cloud or computation
/// never answers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kill {
    part: Option<VehiclePart>,
    at: Instant,
}

/// The round trips of one network, by time. A round trip is `None` while the network was not there.
#[derive(Clone, Debug)]
pub(crate) struct Network {
    round_trips: Vec<(Duration, Option<Duration>)>,
    start: Instant,
}

impl VehiclePart {
    pub(crate) const ALL: [Self; 10] = [
        Self::LeftCamera,
        Self::RightCamera,
        Self::Localization,
        Self::WestDetector,
        Self::EastDetector,
        Self::CloudTracker,
        Self::LocalDetector,
        Self::LocalTracker,
        Self::LocalPredictor,
        Self::LocalPlanner,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::LeftCamera => "left-camera",
            Self::RightCamera => "right-camera",
            Self::Localization => "localization",
            Self::WestDetector => "west-detector",
            Self::EastDetector => "east-detector",
            Self::CloudTracker => "cloud-tracker",
            Self::LocalDetector => "local-detector",
            Self::LocalTracker => "local-tracker",
            Self::LocalPredictor => "local-predictor",
            Self::LocalPlanner => "local-planner",
        }
    }
}

impl Kill {
    pub(crate) const fn new(part: Option<VehiclePart>, at: Instant) -> Self {
        Self { part, at }
    }

    pub(crate) fn hits(&self, part: VehiclePart) -> bool {
        self.part == Some(part) && self.at <= Instant::now()
    }

    /// Computes for `runtime` and returns `result`, or never ends if `part` is dead.
    pub(crate) async fn compute<T>(
        self,
        part: VehiclePart,
        runtime: Duration,
        result: T,
    ) -> Result<T, Error> {
        sleep(runtime).await;
        if self.hits(part) { pending().await } else { Ok(result) }
    }
}

impl Network {
    /// Reads a file of `testkit/data`, with instants in its first column, in units of `unit`, and
    /// round trips in ms in `column`.
    pub(crate) fn new(file: &str, unit: Duration, column: usize) -> Self {
        let row = |line: &str| {
            let mut fields = line.split(',');
            let at: u32 = fields.next()?.parse().ok()?;
            let ms: f64 = fields.nth(column - 1)?.parse().ok()?;
            Some((at * unit, (ms >= 0.0 && ms.is_finite()).then(|| in_steps(ms))))
        };
        let round_trips = file.lines().filter_map(row).collect();
        Self { round_trips, start: Instant::now() }
    }

    /// Waits as long as a message and its reply took when the network was recorded, or forever if
    /// the network was not there.
    pub(crate) async fn round_trip(self) {
        let length = self.round_trips.last().map_or(Duration::MAX, |(at, _)| *at);
        let since = self.start.elapsed().as_nanos() % length.as_nanos().max(1);
        let index = self.round_trips.partition_point(|(at, _)| at.as_nanos() <= since);
        match index.checked_sub(1).and_then(|index| self.round_trips[index].1) {
            Some(round_trip) => sleep(round_trip).await,
            None => pending().await,
        }
    }
}
