//! Draws a pipeline from a seed and plays it twice, on board alone and with clouds, with the same
//! arrivals and local runtimes (E11). `fuseline-simulate` plays it too.

use std::collections::BTreeMap;
use std::future::pending;
use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Duration;

use fuseline_testkit::Rng;
use fuseline_tokio::{
    Commit, Config, Error, Item, Items, Join, JoinConfig, Joined, Latency, Lineage, Local,
    Operator, Reader, Setup, SharedState, spawn, stream,
};
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);
/// The part of the reserve on board that exceeds the longest computation. Timers of tokio are up to
/// 1 ms late, here and upstream.
const MARGIN: Duration = Duration::from_millis(4);

/// A condition of E11 that is broken on purpose.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Breach {
    /// All conditions hold.
    None,
    /// Requests and local end before the same reserve, which includes the waits for clouds.
    OneReserve,
    /// The reserve is shorter than the longest local computation downstream.
    ShortReserve,
    /// Some operators that are not the last have no substitute, so they keep a message until its
    /// end-to-end deadline.
    NoSubstitute,
    /// Local computes one message at a time, so messages that clouds delay wait for each other.
    OneWorker,
    /// The window has room for two messages, and clouds keep messages open for longer.
    SmallWindow,
}

/// For each condition, the seed of a pipeline that loses a result if the condition is broken. If
/// the drawing changes, a seed may give a different pipeline. Then the test fails and names another
/// seed.
pub(crate) const COUNTEREXAMPLES: [(Breach, u64); 5] = [
    (Breach::OneReserve, 0),
    (Breach::ShortReserve, 1),
    (Breach::NoSubstitute, 5),
    (Breach::OneWorker, 8),
    (Breach::SmallWindow, 2),
];

/// Describes how one source treats each message, by the message's key: it takes a while, fails or
/// hangs.
#[derive(Clone, Copy, Debug)]
struct Behaviour {
    least_ms: u32,
    most_ms: u32,
    /// One in this many messages hangs, and one in this many fails. 0 means none.
    hangs: u64,
    fails: u64,
    /// From this key on the source never answers.
    breaks_at: u64,
    seed: u64,
}

/// One operator.
#[derive(Clone, Debug)]
struct Stage {
    id: usize,
    local: Behaviour,
    clouds: Vec<(Behaviour, Duration)>,
    commit: Commit,
    may_lack_substitute: bool,
    sends_last_only: bool,
    /// The stated extra time that it takes with its clouds.
    extra: Duration,
}

/// A camera: when it begins, how many frames it has, and which frames are not sent.
#[derive(Clone, Copy, Debug)]
struct Sensor {
    offset: Duration,
    count: u64,
    dead: (u64, u64),
}

/// A chain, a diamond, or several sensors joined.
#[derive(Clone, Debug)]
pub(crate) struct Pipeline {
    within: Duration,
    period: Duration,
    sensors: Vec<Sensor>,
    /// The sensor of each branch, and its operators.
    branches: Vec<(usize, Vec<Stage>)>,
    wait: Duration,
    /// The operators behind the join. Empty if there is only one branch.
    tail: Vec<Stage>,
}

/// By operator and key: `true` if the message has a result, and its age at that time.
type Answers = BTreeMap<(usize, u64), (bool, Duration)>;

/// The value that operators send: the key of the frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Work(u64);

/// A message of any operator. Its key is the number of its frame, or `None` if the operators
/// upstream have no value for it.
///
/// Behind a join an operator computes with the inputs that it has.
trait Keyed {
    fn key(&self) -> Option<u64>;
}

impl Keyed for Work {
    fn key(&self) -> Option<u64> {
        Some(self.0)
    }
}

impl Keyed for Item<Work> {
    fn key(&self) -> Option<u64> {
        self.value().and_then(|_| frame_of(self.lineage.as_deref()?))
    }
}

impl Keyed for Joined<u32> {
    fn key(&self) -> Option<u64> {
        Some(self.key)
    }
}

fn frame_of(lineage: &Lineage) -> Option<u64> {
    lineage.origin.as_ref()?.seq
}

impl Behaviour {
    fn draw(rng: &mut Rng, most_ms: u32) -> Self {
        let least_ms = 1 + rng.u32(0..most_ms);
        let rarely = |rng: &mut Rng| if rng.one_in(4) { 2 + rng.u64(0..6) } else { 0 };
        Self {
            least_ms,
            most_ms: least_ms + rng.u32(0..most_ms),
            hangs: rarely(rng),
            fails: rarely(rng),
            breaks_at: if rng.one_in(5) { rng.u64(0..12) } else { u64::MAX },
            seed: rng.next_u64(),
        }
    }

    async fn act(self, key: u64) -> Result<Work, Error> {
        let mut rng = Rng::with_seed(self.seed ^ (key << 8));
        sleep(rng.u32(self.least_ms..self.most_ms + 1) * MS).await;
        if key >= self.breaks_at || (self.hangs > 0 && rng.one_in(self.hangs)) {
            pending::<()>().await;
        }
        if self.fails > 0 && rng.one_in(self.fails) {
            return Err("as drawn".into());
        }
        Ok(Work(key))
    }
}

impl Stage {
    fn draw(rng: &mut Rng, id: usize) -> Self {
        let clouds =
            (0..rng.u64(0..3)).map(|_| (Behaviour::draw(rng, 200), (10 + rng.u32(0..400)) * MS));
        Self {
            id,
            clouds: clouds.collect(),
            local: Behaviour::draw(rng, 40),
            commit: [Commit::Eager, Commit::Patient, Commit::Progressive][rng.index(3)],
            may_lack_substitute: rng.one_in(4),
            sends_last_only: rng.bool(),
            extra: rng.u32(0..150) * MS,
        }
    }

    /// Returns the latency that this operator states.
    fn latency(&self, with_clouds: bool, breach: Breach) -> Latency {
        let longest = if breach == Breach::ShortReserve { MS } else { self.local.most_ms * MS };
        let on_board = longest + MARGIN;
        let extra = if with_clouds { self.extra } else { Duration::ZERO };
        match breach {
            Breach::OneReserve => Latency::stated(on_board + extra),
            _ => Latency::stated_with_clouds(on_board, on_board + extra),
        }
    }
}

/// One play of a pipeline.
struct Play<'a> {
    pipeline: &'a Pipeline,
    with_clouds: bool,
    breach: Breach,
    answers: SharedState<Answers>,
    readers: Vec<tokio::task::JoinHandle<()>>,
}

struct Runner<I> {
    stage: Stage,
    has_substitute: bool,
    with_clouds: bool,
    at_once: usize,
    input: PhantomData<fn(I)>,
}

impl<I: Keyed + Send + Sync + 'static> Operator for Runner<I> {
    type Input = I;
    type Output = Work;

    fn setup(self, setup: &mut Setup<I, Work>) -> Local<I, Work> {
        let Stage { clouds, local, .. } = self.stage;
        for (priority, (cloud, deadline)) in (1..).zip(clouds).filter(|_| self.with_clouds) {
            let request = move |message: &I, _| Some((message.key()?, deadline));
            setup.use_cloud(move |key, _| cloud.act(key), request, Ok, priority);
        }
        if self.has_substitute {
            setup.use_substitute(|_| Some(Work(u64::MAX)));
        }
        Local::futures(self.at_once, move |message: Arc<I>, _| {
            let key = message.key();
            async move { local.act(key.ok_or("nothing was computed upstream")?).await }
        })
    }
}

impl Play<'_> {
    /// Starts an operator whose successors take `after`, and notes its answers.
    fn start<I>(&mut self, stage: &Stage, after: Vec<Latency>, input: Reader<I>) -> Items<Work>
    where
        I: Keyed + Send + Sync + 'static,
    {
        let runner = Runner {
            stage: stage.clone(),
            has_substitute: match self.breach {
                Breach::NoSubstitute => after.is_empty(),
                _ => !stage.may_lack_substitute || !after.is_empty(),
            },
            with_clouds: self.with_clouds,
            at_once: if self.breach == Breach::OneWorker { 1 } else { 64 },
            input: PhantomData::<fn(I)>,
        };
        let config = Config {
            window: if self.breach == Breach::SmallWindow { 2 } else { 256 },
            commit: stage.commit,
            reserve: after,
            output_len: 256,
            ..Config::default()
        };
        let (_, items) = spawn(runner, config, input).expect("a configuration that holds");
        let (mut noted, answers, id) = (items.new_reader(), self.answers.clone(), stage.id);
        self.readers.push(tokio::spawn(async move {
            while let Some(item) = noted.read().await {
                note(&answers, id, &item);
            }
        }));
        // Under progressive the next operator may read every item or only the last one.
        if stage.sends_last_only { items.last_only() } else { items }
    }

    /// Starts the operators of a chain whose successors take `after`. Returns the last one's items.
    fn chain(
        &mut self,
        stages: &[Stage],
        after: &[Latency],
        first: impl FnOnce(&mut Self, &Stage, Vec<Latency>) -> Items<Work>,
    ) -> Items<Work> {
        let reserve = |play: &Self, from: usize| {
            let (with_clouds, breach) = (play.with_clouds, play.breach);
            let downstream = stages[from..].iter().map(|it| it.latency(with_clouds, breach));
            downstream.chain(after.iter().cloned()).collect::<Vec<_>>()
        };
        let reserve_of_first = reserve(self, 1);
        let mut items = first(self, &stages[0], reserve_of_first);
        for (index, stage) in stages.iter().enumerate().skip(1) {
            let after = reserve(self, index + 1);
            items = self.start(stage, after, items);
        }
        items
    }

    async fn run(mut self) -> Answers {
        let Pipeline { sensors, branches, wait, tail, .. } = self.pipeline;
        let (with_clouds, breach) = (self.with_clouds, self.breach);
        let behind: Vec<_> = tail.iter().map(|it| it.latency(with_clouds, breach)).collect();
        let films: Vec<_> = (0..sensors.len()).map(|sensor| self.film(sensor)).collect();
        let mut ends = Vec::new();
        for (sensor, stages) in branches {
            let film = films[*sensor].new_reader();
            ends.push(
                self.chain(stages, &behind, |play, stage, after| play.start(stage, after, film)),
            );
        }
        drop(films);
        if !tail.is_empty() {
            let config =
                JoinConfig { wait: *wait, reserve: behind, window: 256, ..JoinConfig::default() };
            let mut join = Join::<u32>::new(config);
            for (index, items) in ends.drain(..).enumerate() {
                join.items(format!("b{index}"), items, |count, _: Arc<Item<Work>>| *count += 1);
            }
            let (_, sets) = join.spawn().expect("inputs of different names");
            self.chain(tail, &[], |play, stage, after| play.start(stage, after, sets));
        }
        drop(ends);
        for reader in self.readers {
            reader.await.expect("no panic");
        }
        self.answers.with(std::mem::take)
    }

    fn film(&self, index: usize) -> Reader<Work> {
        let (mut writer, reader) = stream(64);
        let Sensor { offset, count, dead } = self.pipeline.sensors[index];
        let (period, within) = (self.pipeline.period, self.pipeline.within);
        tokio::spawn(async move {
            sleep(offset).await;
            for seq in 0..count {
                if !(dead.0..dead.1).contains(&seq) {
                    let lineage = Lineage::new(format!("s{index}"), seq, Instant::now());
                    let _ = writer.write_with(Work(seq), lineage.within(within));
                }
                sleep(period).await;
            }
            sleep(10 * within).await;
        });
        reader
    }
}

/// Notes whether a message has a result. Under progressive any of its items may have it.
fn note(answers: &SharedState<Answers>, id: usize, item: &Item<Work>) {
    let Some(lineage) = item.lineage.as_deref() else { return };
    let key = frame_of(lineage).expect("a sensor's number");
    let age = lineage.age(Instant::now()).expect("a capture");
    let is_result = item.forwarded().is_some();
    answers.with(|answers| {
        let answer = answers.entry((id, key)).or_insert((is_result, age));
        if is_result && !answer.0 {
            *answer = (true, age);
        }
    });
}

impl Pipeline {
    pub(crate) fn draw(seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let mut ids = 0..;
        let mut stages = |rng: &mut Rng, most: usize| -> Vec<Stage> {
            (0..=rng.usize(0..most)).zip(&mut ids).map(|(_, id)| Stage::draw(rng, id)).collect()
        };
        let sensor_count = 1 + rng.usize(0..3);
        let is_diamond = sensor_count == 1 && rng.bool();
        let sensors = (0..sensor_count).map(|_| {
            let (count, from) = (4 + rng.u64(0..12), rng.u64(0..16));
            let dead = if rng.one_in(3) { (from, from + rng.u64(0..10)) } else { (0, 0) };
            Sensor { offset: rng.u32(0..30) * MS, count, dead }
        });
        let sensors: Vec<_> = sensors.collect();
        let of_branches = if is_diamond { vec![0, 0] } else { (0..sensor_count).collect() };
        let branches: Vec<_> =
            of_branches.into_iter().map(|sensor| (sensor, stages(&mut rng, 3))).collect();
        let tail = if branches.len() > 1 { stages(&mut rng, 2) } else { Vec::new() };
        Self {
            within: (100 + rng.u32(0..500)) * MS,
            period: (20 + rng.u32(0..100)) * MS,
            wait: rng.u32(0..60) * MS,
            sensors,
            branches,
            tail,
        }
    }

    async fn play(&self, with_clouds: bool, breach: Breach) -> Answers {
        let answers = SharedState::default();
        Play { pipeline: self, with_clouds, breach, answers, readers: Vec::new() }.run().await
    }
}

/// Returns the messages that are answered in time on board alone but not with clouds, and the
/// number of messages that are answered on board alone.
pub(crate) async fn lost(seed: u64, breach: Breach) -> (Vec<String>, usize) {
    let pipeline = Pipeline::draw(seed);
    // The latencies stated without clouds are right: a breach concerns the pipeline with clouds.
    let alone = match breach {
        Breach::OneReserve => Breach::None,
        other => other,
    };
    let on_board = pipeline.play(false, alone).await;
    let both = pipeline.play(true, breach).await;
    let answered = on_board.iter().filter(|(_, (has, age))| *has && *age <= pipeline.within);
    let answered: Vec<_> = answered.collect();
    let is_lost = |key| both.get(key).is_none_or(|(has_result, _)| !has_result);
    let lost = answered.iter().filter(|(key, _)| is_lost(*key)).map(|((id, key), (_, age))| {
        format!(
            "E11: operator {id}, message {key}: on board a result after {age:?}, with clouds none"
        )
    });
    (lost.collect(), answered.len())
}
