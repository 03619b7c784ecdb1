//! Graphs of operators drawn by seed, in virtual time: chains, diamonds and joins, with sensors that die, sources that hang and
//! readers that lag (E1 to E7). `GRAPH_SEED=N` runs one again, `GRAPHS=N` so many.

use std::collections::BTreeMap;
use std::future::pending;
use std::sync::Arc;
use std::time::Duration;

use fuseline_testkit::Rng;
use fuseline_tokio::{
    Call, Config, Item, Items, Join, JoinConfig, Latency, Lineage, Local, Operator, Reader, Setup,
    SharedState, spawn, stream,
};
use tokio::runtime::Builder;
use tokio::time::{Instant, sleep};

const MS: Duration = Duration::from_millis(1);
/// The lateness of one timer of tokio.
const LATENESS: Duration = Duration::from_millis(1);

/// A source's way with each message: a time, or never.
#[derive(Clone, Copy, Debug)]
struct Behaviour {
    at_most_ms: u32,
    /// One in so many messages has no result; 0 is none.
    hangs: u32,
    fails: u32,
}

/// One operator of a drawn graph.
#[derive(Clone, Debug)]
struct Stage {
    local: Behaviour,
    at_once: usize,
    clouds: Vec<Behaviour>,
    has_substitute: bool,
    reserve: Duration,
    seed: u64,
    wrong: SharedState<Vec<String>>,
}

/// A message of any stage: how many stages are behind it.
#[derive(Clone, Default, Debug)]
struct Work(u32);

impl Behaviour {
    fn draw(rng: &mut Rng) -> Self {
        let at_most_ms = 1 + rng.u32(0..120);
        let hangs = if rng.u64(0..3) == 0 { 1 + rng.u32(0..6) } else { 0 };
        let fails = if rng.u64(0..4) == 0 { 1 + rng.u32(0..6) } else { 0 };
        Self { at_most_ms, hangs, fails }
    }

    async fn act(self, mut rng: Rng, work: Work) -> Result<Work, fuseline_tokio::Error> {
        sleep(rng.u32(0..self.at_most_ms) * MS).await;
        if self.hangs > 0 && rng.u64(0..u64::from(self.hangs)) == 0 {
            pending::<()>().await;
        }
        if self.fails > 0 && rng.u64(0..u64::from(self.fails)) == 0 {
            return Err("as drawn".into());
        }
        Ok(Work(work.0 + 1))
    }
}

impl Stage {
    fn draw(rng: &mut Rng, reserve: Duration, wrong: &SharedState<Vec<String>>) -> Self {
        let clouds = (0..rng.u64(0..3)).map(|_| Behaviour::draw(rng)).collect();
        Self {
            local: Behaviour::draw(rng),
            at_once: 1 + rng.usize(0..4),
            clouds,
            has_substitute: rng.u64(0..2) == 0,
            reserve,
            seed: rng.next_u64(),
            wrong: wrong.clone(),
        }
    }

    fn start<I: Send + Sync + 'static>(self, input: Reader<I>) -> Items<Work>
    where
        Runner<I>: Operator<Input = I, Output = Work>,
    {
        let reserve = vec![Latency::stated(self.reserve)];
        let config = Config { reserve, ..Config::default() };
        spawn(Runner { stage: self, input: std::marker::PhantomData::<fn(I)> }, config, input)
            .unwrap()
            .1
    }
}

struct Runner<I> {
    stage: Stage,
    input: std::marker::PhantomData<fn(I)>,
}

impl<I: Send + Sync + 'static> Operator for Runner<I> {
    type Input = I;
    type Output = Work;

    fn setup(self, setup: &mut Setup<I, Work>) -> Local<I, Work> {
        let Stage { local, at_once, clouds, has_substitute, reserve, seed, wrong } = self.stage;
        for (priority, cloud) in (1..).zip(clouds) {
            let wrong = wrong.clone();
            let handle = move |(), call: Call| {
                let left = call.lineage.as_ref().and_then(|lineage| lineage.due(Instant::now()));
                let left = left.map(|due| due.saturating_duration_since(Instant::now().into_std()));
                if left.is_none_or(|left| call.deadline + reserve > left) {
                    wrong.with(|wrong| wrong.push(format!("E3: {:?} of {left:?}", call.deadline)));
                }
                let rng = Rng::with_seed(seed ^ (call.timestamp << 8 | u64::from(priority)));
                cloud.act(rng, Work::default())
            };
            setup.use_cloud(handle, |_, _| Some(((), 150 * MS)), Ok, priority);
        }
        if has_substitute {
            setup.use_substitute(|_| Some(Work::default()));
        }
        Local::futures(at_once, move |_, t| {
            local.act(Rng::with_seed(seed ^ t << 8), Work::default())
        })
    }
}

/// What is wrong with the graph of a seed.
async fn wrongs(seed: u64) -> Vec<String> {
    let mut rng = Rng::with_seed(seed);
    let wrong = SharedState::<Vec<String>>::default();
    let within = (50 + rng.u32(0..300)) * MS;
    let sensors = 1 + rng.usize(0..3);
    let stages = 1 + rng.u32(0..3);
    let is_diamond = sensors == 1 && rng.u64(0..2) == 0;
    let reader_lags = rng.u64(0..4) == 0;
    // What is after a stage of each branch: others of it, and a join's operator.
    let after = |stage: u32| (stages - stage) * 20 * MS;
    let mut branches = Vec::new();
    let mut written = Vec::new();
    for sensor in 0..sensors {
        let (mut writer, reader) = stream(64);
        let count = 1 + rng.u64(0..20);
        let (period, dead_from) = (rng.u32(0..80) * MS, rng.u64(0..40));
        let sent = SharedState::<BTreeMap<u64, Instant>>::default();
        written.push(sent.clone());
        let readers = if is_diamond { vec![reader.another(), reader] } else { vec![reader] };
        tokio::spawn(async move {
            for seq in 0..count {
                sleep(period).await;
                // One that is dead says nothing for a while; another ends.
                if seq < dead_from || seq % 3 == 0 {
                    let lineage = Lineage::new(format!("s{sensor}"), seq, Instant::now());
                    if writer.write_with((), lineage.within(within)).is_ok() {
                        sent.with(|sent| sent.insert(seq, Instant::now()));
                    }
                }
            }
            sleep(10 * within).await;
        });
        for reader in readers {
            let mut items = Stage::draw(&mut rng, after(0), &wrong).start(reader);
            for stage in 1..stages {
                items = Stage::draw(&mut rng, after(stage), &wrong).start(items);
            }
            branches.push(items);
        }
    }
    let operators = stages + 2;
    let is_joined = branches.len() > 1;
    let mut last = if is_joined {
        let reserve = vec![Latency::stated(20 * MS)];
        let wait = rng.u32(0..100) * MS;
        let mut join = Join::<Vec<u64>>::new(JoinConfig {
            wait,
            reserve,
            window: 64,
            ..JoinConfig::default()
        });
        for (index, items) in branches.into_iter().enumerate() {
            join.items(format!("b{index}"), items, |set, item: Arc<Item<Work>>| {
                set.push(item.timestamp);
            });
        }
        let (_, sets) = join.spawn().unwrap();
        Stage::draw(&mut rng, Duration::ZERO, &wrong).start(sets)
    } else {
        branches.remove(0)
    };
    let mut answered = BTreeMap::<(String, u64), u32>::new();
    while let Some(item) = last.read().await {
        if reader_lags {
            sleep(40 * MS).await;
        }
        let lineage = item.lineage.clone().expect("each message has a lineage");
        let origin = lineage.origin.clone().expect("an origin");
        let seq = origin.seq.expect("a number");
        let key = if is_joined { String::new() } else { origin.stream.to_string() };
        *answered.entry((key, seq)).or_default() += 1;
        let age = lineage.age(Instant::now()).expect("a capture");
        let tell = |what: String| wrong.with(|wrong| wrong.push(what));
        if !reader_lags && age > within + operators * LATENESS {
            tell(format!("E2: {seq} of {} is {age:?} old, due at {within:?}", origin.stream));
        }
        let captured = lineage.captured.map(Instant::from_std).expect("a capture");
        let oldest = written.iter().filter_map(|sent| sent.with(|sent| sent.get(&seq).copied()));
        if oldest.clone().all(|sent| sent != captured) {
            tell(format!("E7: {seq} was never captured then"));
        }
        if !reader_lags && item.age.is_some_and(|told| told != age) {
            tell(format!("E7: {seq} is {age:?} old, not {:?}", item.age));
        }
    }
    for (index, sent) in written.iter().enumerate() {
        let key = if is_joined { String::new() } else { format!("s{index}") };
        sent.with(|sent| {
            for seq in sent.keys() {
                if answered.get(&(key.clone(), *seq)) != Some(&1) {
                    wrong.with(|wrong| {
                        wrong.push(format!("E1, E6: {seq} of {index}: {answered:?}"));
                    });
                }
            }
        });
    }
    wrong.with(std::mem::take)
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|number| number.parse().expect("a number"))
}

/// E1, E2, E3, E6, E7: whatever is drawn.
#[test]
fn a_graph_of_any_shape_keeps_its_promises() {
    let seeds = match number("GRAPH_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("GRAPHS").unwrap_or(150),
    };
    for seed in seeds {
        let runtime = Builder::new_current_thread().enable_time().start_paused(true).build();
        let wrong = runtime.unwrap().block_on(wrongs(seed));
        assert!(wrong.is_empty(), "GRAPH_SEED={seed}: {wrong:#?}");
    }
}
