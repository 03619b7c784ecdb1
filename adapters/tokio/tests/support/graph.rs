//! Draws graphs of operators from a seed: chains, diamonds and joins, with sensors that die,
//! sources that hang and fail, and readers that lag. In half of the graphs all calls share one
//! link. `fuseline-simulate` plays them too.

use std::collections::BTreeMap;
use std::future::pending;
use std::sync::Arc;
use std::time::Duration;

use fuseline_testkit::Rng;
use fuseline_tokio::deadline::LinkDirection;
use fuseline_tokio::{
    Call, Config, Error, Item, Items, Join, JoinConfig, Latency, Lineage, Local, Operator, Reader,
    Setup, SharedState, spawn, stream,
};
use tokio::time::{Instant, sleep};

use super::link::EmulatedLink;

const MS: Duration = Duration::from_millis(1);
/// The greatest lateness of one timer of tokio.
const LATENESS: Duration = Duration::from_millis(1);

/// Describes how a source treats each message: it takes a while, fails or hangs.
#[derive(Clone, Copy, Debug)]
struct Behaviour {
    at_most_ms: u32,
    /// One in this many messages has no result. 0 means none.
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
    link: DrawnLink,
    wrong: SharedState<Vec<String>>,
}

/// The vehicle's link, if its rate is limited, and the number of requests that it refused.
#[derive(Clone, Debug)]
struct DrawnLink {
    link: Option<EmulatedLink>,
    request_bytes: usize,
    refused: SharedState<u64>,
}

/// A message of any stage, with the number of stages that it has passed.
#[derive(Clone, Default, Debug)]
struct Work(u32);

impl Behaviour {
    fn draw(rng: &mut Rng) -> Self {
        let at_most_ms = 1 + rng.u32(0..120);
        let hangs = if rng.u64(0..3) == 0 { 1 + rng.u32(0..6) } else { 0 };
        let fails = if rng.u64(0..4) == 0 { 1 + rng.u32(0..6) } else { 0 };
        Self { at_most_ms, hangs, fails }
    }

    async fn act(self, mut rng: Rng, work: Work) -> Result<Work, Error> {
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

impl DrawnLink {
    /// Draws from a generator of its own, so that the graph's draws stay the same.
    fn draw(seed: u64) -> Self {
        let mut rng = Rng::with_seed(!seed);
        let (rate, queue) = (rng.u64(1..20) * 1_000_000, rng.u64(10..400) * 1_000);
        let link = rng.bool().then(|| EmulatedLink::new(queue, [rate; 2]));
        let request_bytes = rng.usize(1_000..100_000);
        Self { link, request_bytes, refused: SharedState::default() }
    }

    /// Makes a call over the link, which the calls of all operators share.
    async fn call(self, act: impl Future<Output = Result<Work, Error>>) -> Result<Work, Error> {
        let Some(link) = self.link else { return act.await };
        if !link.pass(LinkDirection::Uplink, self.request_bytes).await {
            self.refused.with(|refused| *refused += 1);
            return Err("the uplink's queue is full".into());
        }
        let answer = act.await?;
        if !link.pass(LinkDirection::Downlink, 1_000).await {
            pending::<()>().await;
        }
        Ok(answer)
    }
}

impl Stage {
    fn draw(
        rng: &mut Rng,
        reserve: Duration,
        link: &DrawnLink,
        wrong: &SharedState<Vec<String>>,
    ) -> Self {
        let clouds = (0..rng.u64(0..3)).map(|_| Behaviour::draw(rng)).collect();
        Self {
            local: Behaviour::draw(rng),
            at_once: 1 + rng.usize(0..4),
            clouds,
            has_substitute: rng.u64(0..2) == 0,
            reserve,
            seed: rng.next_u64(),
            link: link.clone(),
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
        let Stage { local, at_once, clouds, has_substitute, reserve, seed, link, wrong } =
            self.stage;
        for (priority, cloud) in (1..).zip(clouds) {
            let (wrong, link) = (wrong.clone(), link.clone());
            let handle = move |(), call: Call| {
                let left = call.lineage.as_ref().and_then(|lineage| lineage.due(Instant::now()));
                let left = left.map(|due| due.saturating_duration_since(Instant::now().into_std()));
                if left.is_none_or(|left| call.deadline + reserve > left) {
                    wrong.with(|wrong| wrong.push(format!("E3: {:?} of {left:?}", call.deadline)));
                }
                let rng = Rng::with_seed(seed ^ (call.timestamp << 8 | u64::from(priority)));
                link.clone().call(cloud.act(rng, Work::default()))
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

/// One drawn graph, and the errors that were found in it.
struct DrawnGraph {
    rng: Rng,
    within: Duration,
    /// The number of operators in each branch.
    stages: u32,
    is_joined: bool,
    /// The instant at which each frame of each sensor was captured.
    captures: Vec<SharedState<BTreeMap<u64, Instant>>>,
    link: DrawnLink,
    wrong: SharedState<Vec<String>>,
}

impl DrawnGraph {
    fn new(seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let within = (50 + rng.u32(0..300)) * MS;
        let stages = 1 + rng.u32(0..3);
        let (captures, wrong) = (Vec::new(), SharedState::default());
        let link = DrawnLink::draw(seed);
        Self { rng, within, stages, is_joined: false, captures, link, wrong }
    }

    /// Starts a chain, a diamond, or a join of several sensors. Returns the last operator's items.
    fn start(&mut self) -> Items<Work> {
        let sensors = 1 + self.rng.usize(0..3);
        let is_diamond = sensors == 1 && self.rng.bool();
        let mut branches = Vec::new();
        for sensor in 0..sensors {
            let reader = self.film(sensor);
            if is_diamond {
                branches.push(self.branch(reader.new_reader()));
            }
            branches.push(self.branch(reader));
        }
        self.is_joined = branches.len() > 1;
        if self.is_joined { self.join(branches) } else { branches.remove(0) }
    }

    /// Starts a sensor, which may be silent for a while or end early.
    fn film(&mut self, sensor: usize) -> Reader<()> {
        let (mut writer, reader) = stream(64);
        let (count, dead_from) = (1 + self.rng.u64(0..20), self.rng.u64(0..40));
        let (period, within) = (self.rng.u32(0..80) * MS, self.within);
        let captures = SharedState::<BTreeMap<u64, Instant>>::default();
        self.captures.push(captures.clone());
        tokio::spawn(async move {
            for seq in 0..count {
                sleep(period).await;
                if seq < dead_from || seq % 3 == 0 {
                    let lineage = Lineage::new(format!("s{sensor}"), seq, Instant::now());
                    if writer.write_with((), lineage.within(within)).is_ok() {
                        captures.with(|captures| captures.insert(seq, Instant::now()));
                    }
                }
            }
            sleep(10 * within).await;
        });
        reader
    }

    fn branch(&mut self, reader: Reader<()>) -> Items<Work> {
        // The reserve is for the branch's later operators and for the operator behind a join.
        let reserve = |stage: u32| (self.stages - stage) * 20 * MS;
        let mut items =
            Stage::draw(&mut self.rng, reserve(0), &self.link, &self.wrong).start(reader);
        for stage in 1..self.stages {
            items =
                Stage::draw(&mut self.rng, reserve(stage), &self.link, &self.wrong).start(items);
        }
        items
    }

    fn join(&mut self, branches: Vec<Items<Work>>) -> Items<Work> {
        let (reserve, wait) = (vec![Latency::stated(20 * MS)], self.rng.u32(0..100) * MS);
        let config = JoinConfig { wait, reserve, window: 64, ..JoinConfig::default() };
        let mut join = Join::<Vec<u64>>::new(config);
        for (index, items) in branches.into_iter().enumerate() {
            join.items(format!("b{index}"), items, |set, item: Arc<Item<Work>>| {
                set.push(item.timestamp);
            });
        }
        let (_, sets) = join.spawn().unwrap();
        Stage::draw(&mut self.rng, Duration::ZERO, &self.link, &self.wrong).start(sets)
    }

    /// Checks an item when it is read. Returns the stream and the number of its message.
    fn check(&self, item: &Item<Work>, reader_lags: bool) -> (String, u64) {
        let lineage = item.lineage.as_ref().expect("each message has a lineage");
        let origin = lineage.origin.as_ref().expect("an origin");
        let (seq, within) = (origin.seq.expect("a number"), self.within);
        let age = lineage.age(Instant::now()).expect("a capture");
        // Each operator of the branch, the join, and the operator behind it have one timer.
        if !reader_lags && age > within + (self.stages + 2) * LATENESS {
            self.report(format!("E2: {seq} of {} is {age:?} old of {within:?}", origin.stream));
        }
        if !reader_lags && item.age.is_some_and(|reported| reported != age) {
            self.report(format!("E7: {seq} is {age:?} old, not {:?}", item.age));
        }
        let captured = lineage.captured.map(Instant::from_std);
        if self.captures.iter().all(|it| it.with(|it| it.get(&seq).copied()) != captured) {
            self.report(format!("E7: {seq} was never captured then"));
        }
        (if self.is_joined { String::new() } else { origin.stream.to_string() }, seq)
    }

    /// Checks that each frame led to one item. The frames of joined sensors lead to one item
    /// together.
    fn check_counts(&self, answered: &BTreeMap<(String, u64), u32>) {
        for (sensor, captures) in self.captures.iter().enumerate() {
            let stream = if self.is_joined { String::new() } else { format!("s{sensor}") };
            for seq in captures.with(|captures| captures.keys().copied().collect::<Vec<_>>()) {
                if answered.get(&(stream.clone(), seq)) != Some(&1) {
                    self.report(format!("E1, E6: {seq} of {sensor}: {answered:?}"));
                }
            }
        }
    }

    fn report(&self, wrong: String) {
        self.wrong.with(|all| all.push(wrong));
    }
}

/// Returns the errors in a seed's graph, and the number of requests that its link refused.
pub(crate) async fn wrongs(seed: u64) -> (Vec<String>, u64) {
    let mut graph = DrawnGraph::new(seed);
    let mut last = graph.start();
    let reader_lags = graph.rng.one_in(4);
    let mut answered = BTreeMap::<(String, u64), u32>::new();
    while let Some(item) = last.read().await {
        if reader_lags {
            sleep(40 * MS).await;
        }
        *answered.entry(graph.check(&item, reader_lags)).or_default() += 1;
    }
    graph.check_counts(&answered);
    (graph.wrong.with(std::mem::take), graph.link.refused.with(|refused| *refused))
}
