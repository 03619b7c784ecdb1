//! Emulation: when a model on a device behind a recorded network would reply. Nothing is computed,
//! only waited.

use std::future;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use fuseline_testkit::networks::{Drive, DriveError};
use fuseline_tokio::grpc::tonic::Status;
use fuseline_tokio::grpc::{Description, Infer, Reply, Request};
use tokio::time::{Instant, sleep};

use crate::duration::ms;
use crate::fault::Fault;
use fuseline_evaluation::models::{Model, REPLY_BYTES};

/// A reply's payload; nothing reads it.
static REPLY: [u8; REPLY_BYTES] = [0; REPLY_BYTES];

/// One cloud, emulated: it takes its model's runtime, and its network the recorded round trip.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Emulation {
    /// The model that it runs.
    pub(crate) model: Model,
    /// The network on the way to it.
    pub(crate) drive: Drive,
    /// The time of the drive at which the emulation begins.
    pub(crate) start: Duration,
    /// Seeds the spread of its runtimes.
    pub(crate) seed: u64,
}

/// The reason why an emulation cannot be made.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EmulationError {
    #[error(transparent)]
    Drive(#[from] DriveError),
    #[error("the start of {start:?} is beyond the drive {drive}, which lasts {length:?}")]
    Start { start: Duration, drive: String, length: Duration },
}

impl From<EmulationError> for Fault {
    fn from(error: EmulationError) -> Self {
        Self::own(error)
    }
}

impl Emulation {
    /// Returns an emulation of `model` behind the drive of that name, from `start` on.
    ///
    /// # Errors
    /// If there is no such drive, or it is shorter.
    pub(crate) fn new(
        model: Model,
        drive: &str,
        start: Duration,
        seed: u64,
    ) -> Result<Self, EmulationError> {
        let drive = Drive::load(drive)?;
        if start >= drive.length() {
            let length = drive.length();
            return Err(EmulationError::Start { start, drive: drive.name().to_owned(), length });
        }
        Ok(Self { model, drive, start, seed })
    }

    /// Returns an emulation of `model` without a network of its own.
    pub(crate) fn direct(model: Model, seed: u64) -> Self {
        Self { model, drive: Drive::direct(), start: Duration::ZERO, seed }
    }

    /// Returns the time after which the request for message `t` is answered, or `None` if it never
    /// is.
    ///
    /// `moment` is when it is sent, since the emulation began.
    pub(crate) fn reply_after(&self, moment: Duration, t: u64) -> Option<Duration> {
        let round_trip = self.drive.round_trip(self.start + moment)?;
        Some(round_trip + self.model.runtime(self.seed, t))
    }

    /// Returns when requests that are sent every `period` for `span` are not answered before
    /// `deadline`, as spans since the emulation began.
    pub(crate) fn outages(
        &self,
        period: Duration,
        span: Duration,
        deadline: Duration,
    ) -> Vec<Outage> {
        let mut outages: Vec<Outage> = Vec::new();
        let mut was_lost = false;
        let moments = (0..).map(|t| (t, period.saturating_mul(t)));
        for (t, moment) in moments.take_while(|(_, moment)| *moment < span) {
            let reply = self.reply_after(moment, u64::from(t));
            let is_lost = reply.is_none_or(|reply| reply >= deadline);
            match outages.last_mut() {
                Some(outage) if is_lost && was_lost => outage.to = moment + period,
                _ if is_lost => outages.push(Outage { from: moment, to: moment + period }),
                _ => {}
            }
            was_lost = is_lost;
        }
        outages
    }
}

/// Answers requests when the emulation says; it began at `began`, or with the first request.
///
/// A request that is never answered waits until its caller gives up.
pub(crate) const fn answer(emulation: Emulation, began: Arc<OnceLock<Instant>>) -> impl Infer {
    Answering { emulation, began }
}

struct Answering {
    emulation: Emulation,
    began: Arc<OnceLock<Instant>>,
}

impl Infer for Answering {
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send {
        let moment = self.began.get_or_init(Instant::now).elapsed();
        let after = self.emulation.reply_after(moment, request.timestamp);
        async move {
            match after {
                Some(after) => sleep(after).await,
                None => future::pending().await,
            }
            Ok(Reply {
                payload: REPLY.as_slice().into(),
                of: Some(request.timestamp),
                ..Reply::default()
            })
        }
    }

    fn describe(&self) -> Option<Description> {
        let Emulation { model, drive, .. } = &self.emulation;
        Some(Description {
            model: model.to_string(),
            runtime_ms: Some(ms(model.runtime)),
            ap: model.ap,
            drive: drive.name().to_owned(),
            emulated: true,
        })
    }
}

/// A time without replies in time, since the emulation began.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Outage {
    pub(crate) from: Duration,
    pub(crate) to: Duration,
}

impl Outage {
    pub(crate) fn length(&self) -> Duration {
        self.to.saturating_sub(self.from)
    }

    /// Returns the outages that both lists have in common.
    pub(crate) fn common(one: &[Self], other: &[Self]) -> Vec<Self> {
        let pairs = one.iter().flat_map(|a| other.iter().map(move |b| (a, b)));
        let both = pairs.map(|(a, b)| Self { from: a.from.max(b.from), to: a.to.min(b.to) });
        both.filter(|both| both.from < both.to).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn default(model: &str, drive: &str, start: u64) -> Emulation {
        let start = Duration::from_secs(start);
        Emulation::new(model.parse().unwrap(), drive, start, 1).unwrap()
    }

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_reply_takes_round_trip_and_runtime() {
        let cloud = default("DETR-ResNet-101", "cicv5g/rural_n8_v10", 0);
        let runtime = cloud.model.runtime(1, 7);
        assert_eq!(cloud.reply_after(ms(0), 7), Some(ms(48) + runtime));
        assert_eq!(cloud.reply_after(ms(55), 7), Some(ms(25) + runtime));
        let later = Emulation { start: ms(55), ..cloud };
        assert_eq!(later.reply_after(ms(0), 7), Some(ms(25) + runtime));
    }

    #[test]
    fn the_default_clouds_fall_out_apart_and_once_together() {
        let outages = |cloud: &Emulation| {
            let all = cloud.outages(ms(100), ms(30_000), ms(500));
            all.into_iter().filter(|outage| outage.length() >= ms(1000)).collect::<Vec<_>>()
        };
        let west = outages(&default("DETR-ResNet-101", "cicv5g/rural_n8_v10", 62));
        let east = outages(&default("DINO-SWIN-Tiny", "vnperf/highway:sprint", 150));
        assert_eq!(west, [Outage { from: ms(11_600), to: ms(22_800) }]);
        assert_eq!(east, [Outage { from: ms(14_000), to: ms(30_000) }]);
        let both = Outage::common(&west, &east);
        assert_eq!(both, [Outage { from: ms(14_000), to: ms(22_800) }]);
    }

    #[test]
    fn a_network_that_is_never_there_is_one_outage() {
        let cloud = default("DINO-SWIN-Tiny", "vnperf/highway:wifi", 0);
        assert_eq!(cloud.reply_after(ms(0), 0), None);
        let outages = cloud.outages(ms(100), ms(1_000), ms(500));
        assert_eq!(outages, [Outage { from: ms(0), to: ms(1_000) }]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_request_is_answered_when_the_emulation_says() {
        let cloud = default("DETR-ResNet-101", "cicv5g/rural_n8_v10", 0);
        let after = cloud.reply_after(ms(0), 7).unwrap();
        let infer = answer(cloud, Arc::default());
        let start = Instant::now();
        let request = Request { timestamp: 7, ..Request::default() };
        let reply = infer.infer(request).await.unwrap();
        // Timers are served by the millisecond.
        assert_eq!(start.elapsed().as_millis(), after.as_millis() + 1);
        assert_eq!(reply.payload.len(), REPLY_BYTES);
    }

    #[test]
    fn a_start_beyond_the_drive_is_refused() {
        let drive = "cicv5g/rural_n8_v10";
        let model: Model = "DETR-ResNet-50".parse().unwrap();
        let error = Emulation::new(model, drive, Duration::from_secs(114), 1).unwrap_err();
        assert!(matches!(error, EmulationError::Start { .. }), "{error}");
    }
}
