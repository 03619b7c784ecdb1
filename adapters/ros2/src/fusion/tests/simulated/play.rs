//! Plays a scenario with the shipped loop, on a clock that stands still until everybody sleeps.

use std::cmp::Reverse;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use bytes::Bytes;
use fuseline_engine::Tally;
use fuseline_tokio::Call;
use tokio::runtime::Builder;
use tokio::time::{Instant, advance, sleep, sleep_until};

use super::super::node::{Publications, mouths, run};
use super::scenario::{
    Delivery, Disturbance, DisturbanceKind, Form, Input, Reply, STRAY_KEYS, Scenario,
};
use crate::fusion::LOCAL;
use crate::lifecycle::{LifecycleTask, TransitionResult};
use crate::middleware::{DecodeError, Endpoint, Publish, ReceivedPayload};
use crate::node;
use crate::raw::Payload;
use crate::report::DiagnosticStatus;
use crate::source::{Handle, NodeSource, Route, UnmatchedResults};
use crate::status_publisher::PublishStatus;

/// The outcome of a scenario.
pub(super) struct RunResult {
    pub(super) log: Log,
    pub(super) trace: Vec<u8>,
    pub(super) tally: Tally,
    /// The number of messages and results that are still held.
    pub(super) held: usize,
}

/// Records what was seen of the node. Instants are nanoseconds of its clock.
#[derive(Default, Debug)]
pub(super) struct Log {
    /// The instant at which each input came.
    pub(super) arrived_at: Vec<u64>,
    pub(super) requested: Vec<SentRequest>,
    pub(super) statuses: Vec<StatusReport>,
    /// The hints as they were published, each with the index of its peer.
    pub(super) hints: Vec<(usize, Result<Value, Vec<u8>>)>,
    /// The other events, with their instants.
    pub(super) turned: Vec<(u64, Disturbance)>,
    /// The samples on each peer's topic that are no result of a message because of their key or
    /// form, by index.
    pub(super) unmatched: Vec<UnmatchedResults>,
    pub(super) diagnostics: Vec<(u64, Vec<DiagnosticStatus>)>,
    /// The result of an order that the node did not carry out.
    pub(super) disobeyed: Option<TransitionResult>,
    /// The output that was published last and has no status yet.
    output: Option<Output>,
}

/// A request at the instant at which it was sent.
#[derive(Debug)]
pub(super) struct SentRequest {
    pub(super) at: u64,
    pub(super) index: usize,
    pub(super) serial: usize,
    pub(super) bytes: u64,
}

/// A status, with the output that was published for it.
#[derive(Debug)]
pub(super) struct StatusReport {
    pub(super) at: u64,
    pub(super) status: DiagnosticStatus,
    pub(super) output: Option<Output>,
}

/// An output, and whether a subscriber got it in time.
#[derive(Debug)]
pub(super) struct Output {
    /// `true` if it is on the topic of revisions.
    pub(super) is_revision: bool,
    pub(super) value: Result<Value, Vec<u8>>,
    pub(super) is_sent: bool,
}

/// The facts that a result states about itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Value {
    pub(super) key: u64,
    pub(super) serial: usize,
    pub(super) index: usize,
}

/// The state that the simulated parts share.
struct SimulationState {
    inputs: Vec<Input>,
    start: Instant,
    log: Mutex<Log>,
    /// The health of each peer, by index.
    health: Mutex<Vec<Health>>,
    mouths: Publications,
    payloads: Arc<AtomicUsize>,
}

#[derive(Clone, Copy, Default)]
struct Health {
    is_dead: bool,
    is_gone: bool,
    deaths: usize,
}

/// Bytes that are counted until they are dropped.
struct CountedBytes(Vec<u8>, Arc<AtomicUsize>);

/// A topic's publisher: a peer's requests or hints, or the node's output.
struct SimulatedPublisher {
    simulation: Arc<SimulationState>,
    kind: Kind,
    end: Arc<Endpoint>,
}

enum Kind {
    Requests(usize),
    Hints(usize),
    Output,
    Revisions,
}

struct StatusPublisher(Arc<SimulationState>);

/// Plays a scenario.
pub(super) fn play(scenario: &Scenario) -> RunResult {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.unwrap();
    let path = folder.path().join("trace.jsonl");
    let settings = scenario.settings(&path);
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
    let payloads = Arc::<AtomicUsize>::default();
    let (simulation, tally) = runtime.block_on(async {
        let (engine, created) = node::recorded(&settings).unwrap();
        created.keep();
        let counting = engine.counts();
        let (mouths, subscription) = mouths();
        let peers = scenario.peers.len();
        let simulation = Arc::new(SimulationState {
            inputs: scenario.all_inputs(),
            start: Instant::now(),
            log: Mutex::new(Log {
                unmatched: vec![UnmatchedResults::default(); peers],
                ..Log::default()
            }),
            health: Mutex::new(vec![Health::default(); peers]),
            mouths,
            payloads: Arc::clone(&payloads),
        });
        let sources = (0..peers).map(|index| source(&simulation, scenario, index));
        let outputs = [(Kind::Output, "/output"), (Kind::Revisions, "/output/revisions")];
        let outputs = outputs
            .map(|(kind, topic)| Box::new(simulation.publisher(kind, topic)) as Box<dyn Publish>);
        let status_publisher = StatusPublisher(Arc::clone(&simulation));
        let running = run(
            &settings,
            engine,
            sources.collect(),
            outputs,
            Box::new(status_publisher),
            subscription,
        );
        let turning = tokio::spawn(turn(Arc::clone(&simulation), scenario.all_turns(&settings)));
        feed(&simulation).await;
        turning.await.unwrap();
        sleep_until(simulation.start + scenario.end()).await;
        simulation.publish_report(LifecycleTask::CleanUp).await;
        running.await.unwrap();
        (simulation, counting.tally())
    });
    drop(runtime);
    let log = std::mem::take(&mut *simulation.log());
    drop(simulation);
    let held = payloads.load(Ordering::Relaxed);
    RunResult { log, trace: fs::read(path).unwrap(), tally, held }
}

/// Returns a peer in the form that the node takes.
fn source(simulation: &Arc<SimulationState>, scenario: &Scenario, index: usize) -> NodeSource {
    let peer = scenario.peers[index];
    let name = if index == LOCAL { "local".to_owned() } else { format!("cloud{index}") };
    let route = if peer.is_called {
        Route::Grpc(called(simulation, index))
    } else {
        let requests = simulation.publisher(Kind::Requests(index), &format!("/{name}/input"));
        let results = Endpoint::new(&format!("/{name}/output"), "tests/msg/Text");
        results.change([7; 16], 1, None);
        Route::Topics { requests: Box::new(requests), results: Arc::new(results) }
    };
    let hints = simulation.publisher(Kind::Hints(index), &format!("/late{index}"));
    NodeSource {
        priority: u16::try_from(index).unwrap(),
        name,
        route,
        enabled: true,
        deadline: (index == LOCAL).then_some(Duration::from_secs(1)),
        hints: peer.hints.then(|| Box::new(hints) as Box<dyn Publish>),
        unmatched: UnmatchedResults::default(),
    }
}

/// Sends the inputs, each at its time.
async fn feed(simulation: &Arc<SimulationState>) {
    for (serial, input) in simulation.inputs.iter().enumerate() {
        sleep_until(simulation.start + input.at).await;
        simulation.log().arrived_at.push(simulation.now());
        let body = match input.form {
            Form::NotCdr => None,
            Form::Short => Some(vec![1, 2, 3]),
            Form::Whole => Some([input.key, serial as u64].map(u64::to_le_bytes).concat()),
        };
        simulation.mouths.inputs.send(simulation.sample(body)).await.unwrap();
    }
}

/// Carries out the other events, each at its time.
async fn turn(simulation: Arc<SimulationState>, turns: Vec<(Duration, Disturbance)>) {
    simulation.publish_report(LifecycleTask::Activate).await;
    for (at, turn) in turns {
        sleep_until(simulation.start + at).await;
        simulation.log().turned.push((simulation.now(), turn));
        match turn {
            Disturbance::Set(change) => simulation.mouths.changes.send(change).unwrap(),
            Disturbance::Deadline(seconds) => {
                let sample = simulation.sample(Some(seconds.to_le_bytes().to_vec()));
                simulation.mouths.deadlines.send(sample).await.unwrap();
            }
            Disturbance::Activate(true) => simulation.publish_report(LifecycleTask::Activate).await,
            Disturbance::Activate(false) => {
                simulation.publish_report(LifecycleTask::Deactivate).await;
            }
            Disturbance::Dies { peer, is_seen } => {
                let health = &mut simulation.health()[peer];
                let deaths = health.deaths + 1;
                *health = Health { is_dead: true, is_gone: is_seen, deaths };
            }
            Disturbance::Lives(peer) => {
                let health = &mut simulation.health()[peer];
                (health.is_dead, health.is_gone) = (false, false);
            }
            Disturbance::Stalls(long) => advance(long).await,
        }
    }
}

/// Sends a request to its peer, and the replies back.
async fn travel(simulation: Arc<SimulationState>, index: usize, serial: usize) {
    let Input { key, fates, .. } = &simulation.inputs[serial];
    let Delivery { delay: Some(delay), took, replies } = &fates[index] else { return };
    sleep(*delay).await;
    let before = simulation.health()[index];
    sleep(*took).await;
    let after = simulation.health()[index];
    if before.is_dead || before.deaths < after.deaths {
        return;
    }
    // Later replies are sent first, which cannot change their order of arrival.
    let mut replies = replies.clone();
    replies.sort_by_key(|reply| Reverse(reply.delay));
    for Reply { delay, kind } in replies {
        let (simulation, key) = (Arc::clone(&simulation), *key);
        tokio::spawn(async move {
            sleep(delay).await;
            simulation.reply(Value { key, serial, index }, kind).await;
        });
    }
}

/// Returns the handle of a cloud that is called. Where a topic would lose a message, its answer
/// never comes.
fn called(simulation: &Arc<SimulationState>, index: usize) -> Handle {
    let simulation = Arc::clone(simulation);
    Arc::new(move |request: Payload, _: Call| {
        let simulation = Arc::clone(&simulation);
        let serial = simulation.requested(index, &request);
        drop(request);
        Box::pin(async move {
            let Input { key, fates, .. } = &simulation.inputs[serial];
            let Delivery { delay, took, replies } = &fates[index];
            if simulation.health()[index].is_gone {
                return Err("connection refused".into());
            }
            let (Some(delay), Some(reply)) = (delay, replies.first()) else {
                return std::future::pending().await;
            };
            sleep(*delay + *took + reply.delay).await;
            if simulation.health()[index].is_dead {
                return std::future::pending().await;
            }
            match reply.kind {
                DisturbanceKind::Result => {
                    let value = Value { key: *key, serial, index };
                    Ok(simulation.sample(Some(value.bytes())).unwrap().into())
                }
                DisturbanceKind::Stray | DisturbanceKind::Short | DisturbanceKind::NotCdr => {
                    Err("it fails".into())
                }
            }
        })
    })
}

impl SimulationState {
    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap()
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        self.log.lock().unwrap()
    }

    fn health(&self) -> MutexGuard<'_, Vec<Health>> {
        self.health.lock().unwrap()
    }

    fn publisher(self: &Arc<Self>, kind: Kind, topic: &str) -> SimulatedPublisher {
        let end = Arc::new(Endpoint::new(topic, "tests/msg/Text"));
        SimulatedPublisher { simulation: Arc::clone(self), kind, end }
    }

    /// Returns a message of these bytes, or an error if there are none.
    fn sample(&self, body: Option<Vec<u8>>) -> ReceivedPayload {
        let body = body.ok_or_else(|| DecodeError("not CDR".into()))?;
        self.payloads.fetch_add(1, Ordering::Relaxed);
        let body = Bytes::from_owner(CountedBytes(body, Arc::clone(&self.payloads)));
        Ok(Payload { big_endian: false, body })
    }

    /// Records a request that was sent, and returns the index of its input.
    fn requested(&self, index: usize, request: &Payload) -> usize {
        let serial = u64::from_le_bytes(request.body[8..].try_into().unwrap());
        let serial = usize::try_from(serial).unwrap();
        let bytes = request.body.len() as u64;
        self.log().requested.push(SentRequest { at: self.now(), index, serial, bytes });
        serial
    }

    /// Sends a sample to the node on a peer's topic.
    async fn reply(&self, value: Value, kind: DisturbanceKind) {
        let body = match kind {
            DisturbanceKind::Result => Some(value.bytes()),
            DisturbanceKind::Stray => {
                Some(Value { key: STRAY_KEYS + value.serial as u64, ..value }.bytes())
            }
            DisturbanceKind::Short => Some(vec![4; 7]),
            DisturbanceKind::NotCdr => None,
        };
        match kind {
            DisturbanceKind::Result => {}
            DisturbanceKind::Stray => self.log().unmatched[value.index].unknown_stamp += 1,
            DisturbanceKind::Short | DisturbanceKind::NotCdr => {
                self.log().unmatched[value.index].malformed += 1;
            }
        }
        // The node may have ended.
        drop(self.mouths.results.send((value.index, self.sample(body))).await);
    }

    /// Sends the node an order, and receives its result.
    async fn publish_report(&self, task: LifecycleTask) {
        let done = self.mouths.order(task).await.await.unwrap();
        if done != TransitionResult::Success {
            self.log().disobeyed = Some(done);
        }
    }
}

impl Value {
    fn bytes(self) -> Vec<u8> {
        [self.key, self.serial as u64, self.index as u64].map(u64::to_le_bytes).concat()
    }

    fn read(payload: &Payload) -> Result<Self, Vec<u8>> {
        let numbers: Vec<u64> = payload
            .body
            .chunks_exact(8)
            .map(|number| u64::from_le_bytes(number.try_into().unwrap()))
            .collect();
        let value = match numbers[..] {
            [key, serial, index] => {
                let [serial, index] = [serial, index].map(|it| usize::try_from(it).unwrap());
                Some(Self { key, serial, index })
            }
            _ => None,
        };
        value.filter(|it| it.bytes() == payload.body).ok_or_else(|| payload.body.to_vec())
    }
}

impl Publish for SimulatedPublisher {
    fn publish(&self, payload: Payload) -> bool {
        let Self { simulation, kind, .. } = self;
        match *kind {
            Kind::Requests(index) => {
                let serial = simulation.requested(index, &payload);
                tokio::spawn(travel(Arc::clone(simulation), index, serial));
                true
            }
            Kind::Hints(index) => {
                simulation.log().hints.push((index, Value::read(&payload)));
                true
            }
            Kind::Output | Kind::Revisions => {
                let is_revision = matches!(kind, Kind::Revisions);
                let value = Value::read(&payload);
                let input =
                    value.as_ref().ok().and_then(|value| simulation.inputs.get(value.serial));
                let is_sent = input.is_none_or(|input| !input.is_unsent);
                simulation.log().output = Some(Output { is_revision, value, is_sent });
                is_sent
            }
        }
    }

    fn matched(&self) -> usize {
        match self.kind {
            Kind::Requests(index) => usize::from(!self.simulation.health()[index].is_gone),
            Kind::Hints(_) | Kind::Output | Kind::Revisions => 1,
        }
    }

    fn end(&self) -> &Arc<Endpoint> {
        &self.end
    }
}

impl PublishStatus for StatusPublisher {
    fn status(&self, status: DiagnosticStatus) {
        let at = self.0.now();
        let mut log = self.0.log();
        let output = log.output.take();
        log.statuses.push(StatusReport { at, status, output });
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let at = self.0.now();
        self.0.log().diagnostics.push((at, status));
    }
}

impl AsRef<[u8]> for CountedBytes {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl Drop for CountedBytes {
    fn drop(&mut self) {
        self.1.fetch_sub(1, Ordering::Relaxed);
    }
}
