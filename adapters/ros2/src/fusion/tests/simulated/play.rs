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

use super::super::node::{Mouths, mouths, run, settings};
use super::scenario::{Fate, Form, Input, Reply, STRAY_KEYS, Scenario, Turn, What};
use crate::fusion::LOCAL;
use crate::lifecycle::{Done, Order, Task};
use crate::middleware::{End, Publish, Sample, Unread};
use crate::node;
use crate::raw::Payload;
use crate::report::DiagnosticStatus;
use crate::source::{Handle, Source, Strays, Way};
use crate::voice::Speak;

/// What came of a scenario.
pub(super) struct Played {
    pub(super) log: Log,
    pub(super) trace: Vec<u8>,
    pub(super) tally: Tally,
    /// Messages and results that are still held.
    pub(super) left: usize,
}

/// What was seen of the node. Instants are nanoseconds of its clock.
#[derive(Default, Debug)]
pub(super) struct Log {
    /// When each input came.
    pub(super) came: Vec<u64>,
    pub(super) asked: Vec<Asked>,
    pub(super) statuses: Vec<Told>,
    /// By place: hints as they were published.
    pub(super) hints: Vec<(usize, Result<Value, Vec<u8>>)>,
    /// What else happened, and when.
    pub(super) turned: Vec<(u64, Turn)>,
    /// By place: what came on its topic that is no result of a message, by key or form.
    pub(super) strays: Vec<Strays>,
    pub(super) diagnostics: Vec<(u64, Vec<DiagnosticStatus>)>,
    /// An order that the node did not carry out.
    pub(super) disobeyed: Option<Done>,
    /// The output before its status.
    output: Option<Output>,
}

/// A request as it left.
#[derive(Debug)]
pub(super) struct Asked {
    pub(super) at: u64,
    pub(super) place: usize,
    pub(super) serial: usize,
    pub(super) bytes: u64,
}

/// A status, and the output that was published for it.
#[derive(Debug)]
pub(super) struct Told {
    pub(super) at: u64,
    pub(super) status: DiagnosticStatus,
    pub(super) output: Option<Output>,
}

/// An output, and whether it found its subscriber in time.
#[derive(Debug)]
pub(super) struct Output {
    pub(super) value: Result<Value, Vec<u8>>,
    pub(super) is_sent: bool,
}

/// What a result says of itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Value {
    pub(super) key: u64,
    pub(super) serial: usize,
    pub(super) place: usize,
}

/// All that the simulated parts share.
struct World {
    inputs: Vec<Input>,
    start: Instant,
    log: Mutex<Log>,
    /// By place: whether it is dead, and since how many deaths.
    health: Mutex<Vec<Health>>,
    mouths: Mouths,
    payloads: Arc<AtomicUsize>,
}

#[derive(Clone, Copy, Default)]
struct Health {
    is_dead: bool,
    is_gone: bool,
    deaths: usize,
}

/// Bytes that are counted as long as somebody has them.
struct Counted(Vec<u8>, Arc<AtomicUsize>);

/// A topic's publisher: a peer's requests or hints, or the node's output.
struct Outlet {
    world: Arc<World>,
    what: Kind,
    end: Arc<End>,
}

enum Kind {
    Requests(usize),
    Hints(usize),
    Output,
}

struct Voice(Arc<World>);

/// Plays it.
pub(super) fn play(scenario: &Scenario) -> Played {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.unwrap();
    let path = folder.path().join("trace.jsonl");
    let parameters = scenario.parameters().into_iter().flat_map(|it| ["-p".to_owned(), it]);
    let trace = ["-p".to_owned(), format!("trace.file:={}", path.display())];
    let parameters: Vec<_> = parameters.chain(trace).collect();
    let parameters: Vec<_> = parameters.iter().map(String::as_str).collect();
    let settings = settings(scenario.peers.len() - 1, &parameters);
    let runtime = Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
    let payloads = Arc::<AtomicUsize>::default();
    let (world, tally) = runtime.block_on(async {
        let engine = node::recorded(&settings).unwrap();
        let counting = engine.counts();
        let (mouths, ears) = mouths();
        let peers = scenario.peers.len();
        let world = Arc::new(World {
            inputs: scenario.all_inputs(),
            start: Instant::now(),
            log: Mutex::new(Log { strays: vec![Strays::default(); peers], ..Log::default() }),
            health: Mutex::new(vec![Health::default(); peers]),
            mouths,
            payloads: Arc::clone(&payloads),
        });
        let sources = (0..peers).map(|place| source(&world, scenario, place));
        let (output, voice) = (world.outlet(Kind::Output, "/output"), Voice(Arc::clone(&world)));
        let running =
            run(&settings, engine, sources.collect(), Box::new(output), Box::new(voice), ears);
        let turning = tokio::spawn(turn(Arc::clone(&world), scenario.all_turns(&settings)));
        feed(&world).await;
        turning.await.unwrap();
        sleep_until(world.start + scenario.end()).await;
        world.tell(Task::CleanUp).await;
        running.await.unwrap();
        (world, counting.tally())
    });
    drop(runtime);
    let log = std::mem::take(&mut *world.log());
    drop(world);
    let left = payloads.load(Ordering::Relaxed);
    Played { log, trace: fs::read(path).unwrap(), tally, left }
}

/// A peer as the node has it.
fn source(world: &Arc<World>, scenario: &Scenario, place: usize) -> Source {
    let peer = scenario.peers[place];
    let name = if place == LOCAL { "local".to_owned() } else { format!("cloud{place}") };
    let way = if peer.is_called {
        Way::Grpc(called(world, place))
    } else {
        let requests = world.outlet(Kind::Requests(place), &format!("/{name}/input"));
        let results = End::new(&format!("/{name}/output"), "tests/msg/Text");
        results.change([7; 16], 1, None);
        Way::Topics { requests: Box::new(requests), results: Arc::new(results) }
    };
    let hints = world.outlet(Kind::Hints(place), &format!("/late{place}"));
    Source {
        priority: u16::try_from(place).unwrap(),
        name,
        way,
        enabled: true,
        deadline: (place == LOCAL).then_some(Duration::from_secs(1)),
        hints: peer.hints.then(|| Box::new(hints) as Box<dyn Publish>),
        strays: Strays::default(),
    }
}

/// Sends the inputs, each at its time.
async fn feed(world: &Arc<World>) {
    for (serial, input) in world.inputs.iter().enumerate() {
        sleep_until(world.start + input.at).await;
        world.log().came.push(world.now());
        let body = match input.form {
            Form::NotCdr => None,
            Form::Short => Some(vec![1, 2, 3]),
            Form::Whole => Some([input.key, serial as u64].map(u64::to_le_bytes).concat()),
        };
        world.mouths.inputs.send(world.sample(body)).await.unwrap();
    }
}

/// Whatever else happens, each at its time.
async fn turn(world: Arc<World>, turns: Vec<(Duration, Turn)>) {
    world.tell(Task::Activate).await;
    for (at, turn) in turns {
        sleep_until(world.start + at).await;
        world.log().turned.push((world.now(), turn));
        match turn {
            Turn::Set(change) => world.mouths.changes.send(change).unwrap(),
            Turn::Deadline(seconds) => {
                let sample = world.sample(Some(seconds.to_le_bytes().to_vec()));
                world.mouths.deadlines.send(sample).await.unwrap();
            }
            Turn::Activate(true) => world.tell(Task::Activate).await,
            Turn::Activate(false) => world.tell(Task::Deactivate).await,
            Turn::Dies { peer, is_seen } => {
                let health = &mut world.health()[peer];
                let deaths = health.deaths + 1;
                *health = Health { is_dead: true, is_gone: is_seen, deaths };
            }
            Turn::Lives(peer) => {
                let health = &mut world.health()[peer];
                (health.is_dead, health.is_gone) = (false, false);
            }
            Turn::Stalls(long) => advance(long).await,
        }
    }
}

/// A request on its way to its peer and back.
async fn travel(world: Arc<World>, place: usize, serial: usize) {
    let Input { key, fates, .. } = &world.inputs[serial];
    let Fate { way: Some(way), took, replies } = &fates[place] else { return };
    sleep(*way).await;
    let before = world.health()[place];
    sleep(*took).await;
    let after = world.health()[place];
    if before.is_dead || before.deaths < after.deaths {
        return;
    }
    // The later ones are sent first: they overtake nobody by that.
    let mut replies = replies.clone();
    replies.sort_by_key(|reply| Reverse(reply.way));
    for Reply { way, what } in replies {
        let (world, key) = (Arc::clone(&world), *key);
        tokio::spawn(async move {
            sleep(way).await;
            world.reply(Value { key, serial, place }, what).await;
        });
    }
}

/// A cloud that is called: what gets lost on topics is an answer that never comes.
fn called(world: &Arc<World>, place: usize) -> Handle {
    let world = Arc::clone(world);
    Arc::new(move |request: Payload, _: Call| {
        let world = Arc::clone(&world);
        let serial = world.asked(place, &request);
        drop(request);
        Box::pin(async move {
            let Input { key, fates, .. } = &world.inputs[serial];
            let Fate { way, took, replies } = &fates[place];
            if world.health()[place].is_gone {
                return Err("connection refused".into());
            }
            let (Some(way), Some(reply)) = (way, replies.first()) else {
                return std::future::pending().await;
            };
            sleep(*way + *took + reply.way).await;
            if world.health()[place].is_dead {
                return std::future::pending().await;
            }
            match reply.what {
                What::Result => {
                    let value = Value { key: *key, serial, place };
                    Ok(world.sample(Some(value.bytes())).unwrap())
                }
                What::Stray | What::Short | What::NotCdr => Err("it fails".into()),
            }
        })
    })
}

impl World {
    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap()
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        self.log.lock().unwrap()
    }

    fn health(&self) -> MutexGuard<'_, Vec<Health>> {
        self.health.lock().unwrap()
    }

    fn outlet(self: &Arc<Self>, what: Kind, topic: &str) -> Outlet {
        let end = Arc::new(End::new(topic, "tests/msg/Text"));
        Outlet { world: Arc::clone(self), what, end }
    }

    /// A message of these bytes, or one that cannot be read.
    fn sample(&self, body: Option<Vec<u8>>) -> Sample {
        let body = body.ok_or_else(|| Unread("not CDR".into()))?;
        self.payloads.fetch_add(1, Ordering::Relaxed);
        let body = Bytes::from_owner(Counted(body, Arc::clone(&self.payloads)));
        Ok(Payload { big_endian: false, body })
    }

    /// A request left.
    fn asked(&self, place: usize, request: &Payload) -> usize {
        let serial = u64::from_le_bytes(request.body[8..].try_into().unwrap());
        let serial = usize::try_from(serial).unwrap();
        let bytes = request.body.len() as u64;
        self.log().asked.push(Asked { at: self.now(), place, serial, bytes });
        serial
    }

    /// Something comes on a peer's topic.
    async fn reply(&self, value: Value, what: What) {
        let body = match what {
            What::Result => Some(value.bytes()),
            What::Stray => Some(Value { key: STRAY_KEYS + value.serial as u64, ..value }.bytes()),
            What::Short => Some(vec![4; 7]),
            What::NotCdr => None,
        };
        match what {
            What::Result => {}
            What::Stray => self.log().strays[value.place].unknown_stamp += 1,
            What::Short | What::NotCdr => self.log().strays[value.place].malformed += 1,
        }
        // The node may have ended.
        drop(self.mouths.results.send((value.place, self.sample(body))).await);
    }

    /// Tells the node what to do, and hears how that went.
    async fn tell(&self, task: Task) {
        let (order, done) = Order::new(task);
        assert!(self.mouths.orders.send(order).await.is_ok(), "the node ended");
        let done = done.await.unwrap();
        if done != Done::Success {
            self.log().disobeyed = Some(done);
        }
    }
}

impl Value {
    fn bytes(self) -> Vec<u8> {
        [self.key, self.serial as u64, self.place as u64].map(u64::to_le_bytes).concat()
    }

    fn read(payload: &Payload) -> Result<Self, Vec<u8>> {
        let numbers: Vec<u64> = payload
            .body
            .chunks_exact(8)
            .map(|number| u64::from_le_bytes(number.try_into().unwrap()))
            .collect();
        let value = match numbers[..] {
            [key, serial, place] => {
                let [serial, place] = [serial, place].map(|it| usize::try_from(it).unwrap());
                Some(Self { key, serial, place })
            }
            _ => None,
        };
        value.filter(|it| it.bytes() == payload.body).ok_or_else(|| payload.body.to_vec())
    }
}

impl Publish for Outlet {
    fn publish(&self, payload: Payload) -> bool {
        let Self { world, what, .. } = self;
        match *what {
            Kind::Requests(place) => {
                let serial = world.asked(place, &payload);
                tokio::spawn(travel(Arc::clone(world), place, serial));
                true
            }
            Kind::Hints(place) => {
                world.log().hints.push((place, Value::read(&payload)));
                true
            }
            Kind::Output => {
                let value = Value::read(&payload);
                let input = value.as_ref().ok().and_then(|value| world.inputs.get(value.serial));
                let is_sent = input.is_none_or(|input| !input.is_unsent);
                world.log().output = Some(Output { value, is_sent });
                is_sent
            }
        }
    }

    fn matched(&self) -> usize {
        match self.what {
            Kind::Requests(place) => usize::from(!self.world.health()[place].is_gone),
            Kind::Hints(_) | Kind::Output => 1,
        }
    }

    fn end(&self) -> &Arc<End> {
        &self.end
    }
}

impl Speak for Voice {
    fn status(&self, status: DiagnosticStatus) {
        let at = self.0.now();
        let mut log = self.0.log();
        let output = log.output.take();
        log.statuses.push(Told { at, status, output });
    }

    fn diagnostics(&self, status: Vec<DiagnosticStatus>) {
        let at = self.0.now();
        self.0.log().diagnostics.push((at, status));
    }
}

impl AsRef<[u8]> for Counted {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.1.fetch_sub(1, Ordering::Relaxed);
    }
}
