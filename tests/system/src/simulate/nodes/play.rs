//! Plays a scenario with the shipped loop, on a clock that stands still until everybody sleeps.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::future::pending;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use std::{fs, io};

use bytes::Bytes;
use fuseline_engine::{Tally, lock};
use fuseline_ros2::Payload;
use fuseline_ros2::in_process::{
    self, DiagnosticStatus, NodeSenders, PublishedTopic, ReceivedTopic, Surroundings,
};
use fuseline_testkit::shrink;
use fuseline_tokio::{Call, Error};
use fuseline_traces::nanos;
use tokio::runtime::Builder;
use tokio::time::{Instant, advance, sleep, sleep_until};

use crate::simulate::nodes::facts::Facts;
use crate::simulate::nodes::scenario::{
    Delivery, Disturbance, Form, Input, Reply, ReplyKind, STRAY_KEYS, Scenario,
};
use crate::simulate::nodes::shrink::simplifications;
use crate::simulate::simulator::{Drawn, Simulated};
use crate::simulate::value::{InstanceCounts, SampleBytes, ValueLabel};

/// The outcome of a scenario.
pub(crate) struct RunResult {
    pub(crate) log: Log,
    pub(crate) trace: Vec<u8>,
    pub(crate) tally: Tally,
    /// The number of messages and results that are still held.
    pub(crate) held: usize,
}

/// Records what was seen of the node. Instants are nanoseconds of its clock.
#[derive(Default, Debug)]
pub(crate) struct Log {
    /// The instant at which each input came.
    pub(crate) arrived_at: Vec<u64>,
    pub(crate) requested: Vec<SentRequest>,
    pub(crate) statuses: Vec<StatusReport>,
    /// The hints as they were published, each with the index of its peer.
    pub(crate) hints: Vec<(usize, Result<ValueLabel, Vec<u8>>)>,
    /// The other events, with their instants.
    pub(crate) turned: Vec<(u64, Disturbance)>,
    /// The samples on each peer's topic that are no result of a message because of their key or
    /// form, by index.
    pub(crate) unmatched: Vec<Unmatched>,
    pub(crate) diagnostics: Vec<(u64, Vec<DiagnosticStatus>)>,
    /// `true` if the node did not carry out an order.
    pub(crate) is_disobedient: bool,
    /// The output that was published last and has no status yet.
    output: Option<Output>,
}

/// The numbers of results with the key of no message, and of results without a key.
#[derive(Clone, Default, Debug)]
pub(crate) struct Unmatched {
    pub(crate) unknown_stamp: u64,
    pub(crate) malformed: u64,
}

/// A request at the instant at which it was sent.
#[derive(Debug)]
pub(crate) struct SentRequest {
    pub(crate) at: u64,
    pub(crate) index: usize,
    pub(crate) serial: usize,
    pub(crate) bytes: u64,
}

/// A status, with the output that was published for it.
#[derive(Debug)]
pub(crate) struct StatusReport {
    pub(crate) at: u64,
    pub(crate) status: DiagnosticStatus,
    pub(crate) output: Option<Output>,
}

/// An output, and whether a subscriber got it in time.
#[derive(Debug)]
pub(crate) struct Output {
    /// `true` if it is on the topic of revisions.
    pub(crate) is_revision: bool,
    pub(crate) value: Result<ValueLabel, Vec<u8>>,
    pub(crate) is_sent: bool,
}

/// The state that the simulated parts share.
struct SimulationState {
    inputs: Vec<Input>,
    start: Instant,
    log: Mutex<Log>,
    /// The health of each peer, by index.
    health: Mutex<Vec<Health>>,
    senders: NodeSenders,
    samples: InstanceCounts,
}

#[derive(Clone, Copy, Default)]
struct Health {
    is_dead: bool,
    is_gone: bool,
    deaths: usize,
}

impl Drawn for Scenario {
    const OPTION: &str = "node";
    const PANICS: &str = "d8_everything_ends";

    fn draw(seed: u64) -> Self {
        Self::of_seed(seed)
    }

    fn play(&self, folder: &Path) -> io::Result<Simulated> {
        let played = play(self, folder)?;
        let (findings, kinds) = match Facts::new(self, &played) {
            Ok(facts) => (facts.findings(), facts.kinds()),
            Err(reason) => (Simulated::broken("d10_whole_trace", reason).findings, BTreeSet::new()),
        };
        let RunResult { log, trace, tally, held } = played;
        let (messages, life) = (log.arrived_at.len() as u64, self.end());
        let external_log = Some(Box::new((log, tally, held)) as Box<_>);
        Ok(Simulated { findings, kinds, messages, life, trace, external_log, hangs: false })
    }

    fn smallest(&self, breaks: impl FnMut(&Self) -> io::Result<bool>) -> io::Result<Self> {
        shrink(self.clone(), simplifications, breaks)
    }

    fn text(&self) -> String {
        self.to_string()
    }
}

/// Plays a scenario. Its trace goes to the empty `folder`.
fn play(scenario: &Scenario, folder: &Path) -> io::Result<RunResult> {
    let path = folder.join("trace.jsonl");
    let settings = scenario.settings(&path);
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build()?;
    let samples = InstanceCounts::default();
    let (simulation, tally) = runtime.block_on(async {
        let peers = scenario.peers.len();
        let unmatched = vec![Unmatched::default(); peers];
        let turns = scenario.all_turns(&settings);
        let simulation = |senders| SimulationState {
            inputs: scenario.all_inputs(),
            start: Instant::now(),
            log: Mutex::new(Log { unmatched, ..Log::default() }),
            health: Mutex::new(vec![Health::default(); peers]),
            senders,
            samples: samples.clone(),
        };
        let (simulation, running, _) =
            in_process::start(settings, simulation).map_err(io::Error::other)?;
        let turning = tokio::spawn(turn(Arc::clone(&simulation), turns));
        feed(&simulation).await;
        turning.await.expect("the events happen");
        sleep_until(simulation.start + scenario.end()).await;
        let is_done = simulation.senders.clean_up().await;
        simulation.log().is_disobedient |= !is_done;
        let tally = running.await.expect("the node ends").expect("the node ends well");
        Ok::<_, io::Error>((simulation, tally))
    })?;
    drop(runtime);
    let log = std::mem::take(&mut *simulation.log());
    drop(simulation);
    Ok(RunResult { log, trace: fs::read(path)?, tally, held: samples.now() })
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
        let sample = body.map(|it| simulation.sample(it));
        assert!(simulation.senders.send(ReceivedTopic::Input, sample).await, "the node ended");
    }
}

/// Carries out the other events, each at its time.
async fn turn(simulation: Arc<SimulationState>, turns: Vec<(Duration, Disturbance)>) {
    simulation.activate(true).await;
    for (at, turn) in turns {
        sleep_until(simulation.start + at).await;
        simulation.log().turned.push((simulation.now(), turn));
        match turn {
            Disturbance::Set(change) => assert!(simulation.senders.set(change), "the node ended"),
            Disturbance::Deadline(seconds) => {
                let sample = simulation.sample(seconds.to_le_bytes().to_vec());
                simulation.senders.send(ReceivedTopic::Deadline, Some(sample)).await;
            }
            Disturbance::Activate(is_active) => simulation.activate(is_active).await,
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
            simulation.reply(index, key, serial, kind).await;
        });
    }
}

impl SimulationState {
    fn now(&self) -> u64 {
        nanos(self.start.elapsed())
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        lock(&self.log)
    }

    fn health(&self) -> MutexGuard<'_, Vec<Health>> {
        lock(&self.health)
    }

    fn sample(&self, bytes: Vec<u8>) -> Payload {
        let body = Bytes::from_owner(SampleBytes::new(bytes, &self.samples));
        Payload { big_endian: false, body }
    }

    /// Returns the label of a result that is made now.
    fn label(&self, index: usize, key: u64, serial: usize) -> ValueLabel {
        let p = u16::try_from(index).unwrap_or(u16::MAX);
        ValueLabel { p, t: key, serial, at: self.now() }
    }

    /// Records a request that was sent, and returns the index of its input.
    fn requested(&self, index: usize, request: &Payload) -> usize {
        let serial = request.body[8..].try_into().map(u64::from_le_bytes).expect("a request");
        let serial = usize::try_from(serial).unwrap_or(usize::MAX);
        let bytes = request.body.len() as u64;
        self.log().requested.push(SentRequest { at: self.now(), index, serial, bytes });
        serial
    }

    /// Sends a sample to the node on a peer's topic.
    async fn reply(&self, index: usize, key: u64, serial: usize, kind: ReplyKind) {
        let label = self.label(index, key, serial);
        let body = match kind {
            ReplyKind::Result => Some(label.bytes()),
            ReplyKind::Stray => {
                self.log().unmatched[index].unknown_stamp += 1;
                Some(ValueLabel { t: STRAY_KEYS + serial as u64, ..label }.bytes())
            }
            ReplyKind::Short | ReplyKind::NotCdr => {
                self.log().unmatched[index].malformed += 1;
                (kind == ReplyKind::Short).then(|| vec![4; 7])
            }
        };
        // The node may have ended.
        self.senders.send(ReceivedTopic::Results(index), body.map(|it| self.sample(it))).await;
    }

    /// Activates or deactivates the node.
    async fn activate(&self, is_active: bool) {
        let is_done = self.senders.activate(is_active).await;
        self.log().is_disobedient |= !is_done;
    }
}

fn label(payload: &Payload) -> Result<ValueLabel, Vec<u8>> {
    ValueLabel::read(&payload.body).ok_or_else(|| payload.body.to_vec())
}

impl Surroundings for SimulationState {
    fn publish(self: &Arc<Self>, topic: PublishedTopic, payload: Payload) -> bool {
        match topic {
            PublishedTopic::Requests(index) => {
                let serial = self.requested(index, &payload);
                tokio::spawn(travel(Arc::clone(self), index, serial));
                true
            }
            PublishedTopic::Hints(index) => {
                self.log().hints.push((index, label(&payload)));
                true
            }
            PublishedTopic::Output | PublishedTopic::Revisions => {
                let is_revision = topic == PublishedTopic::Revisions;
                let value = label(&payload);
                let input = value.as_ref().ok().and_then(|value| self.inputs.get(value.serial));
                let is_sent = input.is_none_or(|input| !input.is_unsent);
                self.log().output = Some(Output { is_revision, value, is_sent });
                is_sent
            }
        }
    }

    fn subscribers(&self, topic: PublishedTopic) -> usize {
        match topic {
            PublishedTopic::Requests(index) => usize::from(!self.health()[index].is_gone),
            PublishedTopic::Hints(_) | PublishedTopic::Output | PublishedTopic::Revisions => 1,
        }
    }

    /// A call never ends if a topic would lose its request or its result.
    fn call(
        self: &Arc<Self>,
        index: usize,
        request: Payload,
        _: Call,
    ) -> impl Future<Output = Result<Payload, Error>> + Send + 'static {
        let simulation = Arc::clone(self);
        let serial = simulation.requested(index, &request);
        async move {
            let Input { key, fates, .. } = &simulation.inputs[serial];
            let Delivery { delay, took, replies } = &fates[index];
            if simulation.health()[index].is_gone {
                return Err("connection refused".into());
            }
            let (Some(delay), Some(reply)) = (delay, replies.first()) else {
                return pending().await;
            };
            sleep(*delay + *took + reply.delay).await;
            if simulation.health()[index].is_dead {
                return pending().await;
            }
            match reply.kind {
                ReplyKind::Result => {
                    Ok(simulation.sample(simulation.label(index, *key, serial).bytes()))
                }
                ReplyKind::Stray | ReplyKind::Short | ReplyKind::NotCdr => Err("it fails".into()),
            }
        }
    }

    fn status(&self, status: DiagnosticStatus) {
        let at = self.now();
        let mut log = self.log();
        let output = log.output.take();
        log.statuses.push(StatusReport { at, status, output });
    }

    fn diagnostics(&self, statuses: Vec<DiagnosticStatus>) {
        let at = self.now();
        self.log().diagnostics.push((at, statuses));
    }
}
