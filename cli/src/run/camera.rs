//! The camera: a detector operator that is fed with frames and has clouds behind gRPC.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::Bytes;
use fuseline_tokio::grpc::{self, Connection, Reply, Request};
use fuseline_tokio::{
    Config, Items, JoinError, Lineage, Local, Operator, Recording, Running, Setup, SourceTally,
    SpawnError, Trace, Trigger, WriteError, Writer, spawn, stream,
};
use tokio::task::JoinSet;
use tokio::time::{Instant, interval, sleep, timeout};

use crate::fault::Fault;
use crate::interrupt::Interrupt;
use crate::link::EmulatedLink;
use crate::run::deadlines::RunDeadlines;
use crate::run::error::RunError;
use crate::run::metadata::RunMetadata;
use crate::run::network::Network;
use crate::run::plan::{DeadlinePolicy, RunPlan};
use crate::run::progress::{RunProgress, recording_error};
use fuseline_evaluation::models::{REPLY_BYTES, REQUEST_BYTES};

/// The origin of the camera's frames in the trace.
const STREAM: &str = "camera";
/// The time between two checks whether local has caught up.
const LOOK: Duration = Duration::from_millis(20);
/// The time between two checks whether there is room for a frame that waits.
const ROOM: Duration = Duration::from_millis(1);

/// A camera, its operator and its clouds, started.
pub(crate) struct Camera<'a> {
    plan: &'a RunPlan,
    frames: Writer<Picture>,
    running: Running,
    output: Items<Detections>,
    begun: Vec<Arc<AtomicU64>>,
    /// The servers end when this is dropped.
    _servers: JoinSet<Result<(), grpc::ServeError>>,
}

/// One picture.
struct Picture(Bytes);

/// The objects that were detected in a picture. Nothing reads them.
type Detections = Bytes;

/// The operator: detects objects in frames.
struct Detector<'a> {
    plan: &'a RunPlan,
    connections: Vec<Connection>,
    begun: Vec<Arc<AtomicU64>>,
    /// The settings that all clouds share.
    link: EmulatedLink,
}

impl Operator for Detector<'_> {
    type Input = Picture;
    type Output = Detections;

    fn setup(self, setup: &mut Setup<Picture, Detections>) -> Local<Picture, Detections> {
        let deadline = self.plan.deadline();
        let policy = self.plan.policy == DeadlinePolicy::Expected;
        let deadlines = policy.then(|| RunDeadlines::new(self.plan));
        let clouds = self.plan.clouds.iter().zip(self.connections).zip(self.begun);
        for (index, ((cloud, connection), begun)) in clouds.enumerate() {
            let (link, infer) = (self.link.clone(), Arc::new(grpc::infer(connection)));
            let handle = move |request, call| {
                begun.fetch_add(1, Ordering::Relaxed);
                let (link, infer) = (link.clone(), Arc::clone(&infer));
                async move {
                    let send = async |call| infer(request, call).await;
                    link.carry([REQUEST_BYTES, REPLY_BYTES], call, send).await
                }
            };
            let message_handler = move |frame: &Picture, timestamp| {
                Some((
                    Request { timestamp, payload: frame.0.clone(), ..Request::default() },
                    deadline,
                ))
            };
            let response_handler = |reply: Reply| Ok(reply.stamped());
            let registered =
                setup.use_stamped_cloud(handle, message_handler, response_handler, cloud.priority);
            registered.name.clone_from(&cloud.name);
            registered.calls = self.plan.calls;
            if let Some(deadlines) = &deadlines {
                registered.policy = Some(deadlines.of(index));
                registered.linger = deadlines.linger();
            }
        }
        if let Some(deadlines) = deadlines {
            setup.use_situation(move |_, _| deadlines.next());
        }
        let (model, seed) = (self.plan.local.clone(), self.plan.seed);
        Local::futures(self.plan.workers, move |_, timestamp| {
            let runtime = model.runtime(seed, timestamp);
            async move {
                sleep(runtime).await;
                Ok(Bytes::from_static(&[0; REPLY_BYTES]))
            }
        })
    }
}

/// Starts the operator, within a runtime.
///
/// # Errors
/// Returns an error if the operator cannot be started.
pub(crate) fn start(plan: &RunPlan, network: Network) -> Result<Camera<'_>, Fault> {
    let Network { connections, servers, began } = network;
    let begun: Vec<Arc<AtomicU64>> = plan.clouds.iter().map(|_| Arc::default()).collect();
    began.get_or_init(Instant::now);
    let drive = plan.link_drive().map(|cloud| (cloud.drive.clone(), cloud.start));
    let link = EmulatedLink::new(plan.link, drive);
    let detector = Detector { plan, connections, begun: begun.clone(), link };
    let config = Config {
        name: "detector".to_owned(),
        window: plan.window,
        commit: plan.commit,
        trace: Some(Trace { path: plan.trace.clone(), recording: Recording::default() }),
        ..Config::default()
    };
    let (frames, input) = stream(1);
    let (running, output) = spawn(detector, config, input).map_err(cannot_spawn)?;
    Ok(Camera { plan, frames, running, output, begun, _servers: servers })
}

impl Camera<'_> {
    /// Feeds the operator until the plan is done or the user ends it.
    pub(crate) async fn drive(
        mut self,
        live: &mut RunProgress<'_>,
        interrupt: &Interrupt,
    ) -> RunMetadata {
        let interrupted = self.shoot(live, interrupt).await;
        self.catch_up().await;
        // Dropping the writer ends the operator once everything is answered.
        drop((self.frames, self.output));
        let so_far = self.running.tally();
        let (tally, recording_error) = match self.running.join().await {
            Ok(tally) => (tally, None),
            Err(JoinError::Trace { error, tally }) => {
                let why = tally.recording_error.as_deref().map(ToOwned::to_owned);
                let why = why.unwrap_or_else(|| error.to_string());
                (*tally, Some(recording_error(&self.plan.trace, &why)))
            }
            Err(error @ JoinError::Stopped { .. }) => (so_far, Some(error.to_string())),
        };
        live.show(&tally);
        let begun = self.begun.iter().map(|begun| begun.load(Ordering::Relaxed)).collect();
        RunMetadata { begun, tally, interrupted, recording_error }
    }

    /// Writes a frame every period. Returns `true` if the user ended the run.
    async fn shoot(&mut self, live: &mut RunProgress<'_>, interrupt: &Interrupt) -> bool {
        let Self { plan, frames, running, output, .. } = self;
        let image = Bytes::from(vec![0; REQUEST_BYTES]);
        let (mut period, mut looks) = (interval(plan.period), interval(live.period()));
        // If the operator lags behind, a frame waits until outputs are read.
        let (mut shot, mut waiting) = (0, None);
        while shot < plan.frames {
            tokio::select! {
                () = interrupt.wait() => return true,
                captured = period.tick(), if waiting.is_none() => {
                    let lineage = Arc::new(Lineage::new(STREAM, shot, captured));
                    waiting = Some((Picture(image.clone()), lineage));
                }
                () = sleep(ROOM), if waiting.is_some() => {}
                Some(_) = output.read() => {}
                _ = looks.tick() => live.show(&running.tally()),
            }
            if let Some((frame, lineage)) = waiting.take() {
                match frames.write_with(frame, Arc::clone(&lineage)) {
                    Ok(_) => shot += 1,
                    Err(WriteError::Full(frame)) => waiting = Some((frame, lineage)),
                    Err(WriteError::Closed(_)) => break,
                }
            }
        }
        false
    }

    /// Waits for local's last results, because the comparison of policies needs the instants of
    /// their arrival.
    async fn catch_up(&mut self) {
        let grace = self.plan.deadline().max(self.plan.local.runtime.saturating_mul(2));
        let caught_up = async {
            while self.running.tally().sources.first().is_some_and(is_behind) {
                sleep(LOOK).await;
            }
        };
        let reading = async { while self.output.read().await.is_some() {} };
        tokio::select! {
            _ = timeout(grace, caught_up) => {}
            () = reading => {}
        }
    }
}

/// Returns why the operator could not be started.
fn cannot_spawn(error: SpawnError) -> Fault {
    match error {
        SpawnError::Trace { path, error } => {
            Fault::Create { name: path.display().to_string(), source: error }
        }
        error => RunError::from(error).into(),
    }
}

/// Returns `true` if computations were begun that have not come to an end.
fn is_behind(local: &SourceTally) -> bool {
    let ended = local.outputs.get(&Trigger::Arrival).copied().unwrap_or_default()
        + local.held
        + local.dropped.values().sum::<u64>()
        + local.failed
        + local.failures_dropped.values().sum::<u64>();
    ended < local.admitted
}
