//! One drive: sensors, the graph of operators, and what control did at each of its ticks.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::{
    Config, Ending, Error, Item, Items, Join, JoinConfig, Latency, Lineage, Operator, Reader,
    Recording, Running, RunningJoin, Trace, Writer, spawn, stream,
};
use tokio::time::{Instant, interval};

use super::operators::{
    Control, Detection, Drive, Frame, Mode, Order, PerceivedScene, Planning, Predicting,
    Prediction, Scene, Tracking,
};
use super::world::{Kill, Network, VehiclePart};

const MS: Duration = Duration::from_millis(1);
/// From capture to control.
const END_TO_END: Duration = Duration::from_millis(500);

/// What came of a drive.
#[derive(Clone, Default, Debug)]
pub(crate) struct Driven {
    /// How often control was due, and its outputs.
    pub(crate) ticks: u64,
    pub(crate) commands: Vec<Command>,
    /// How many frames each source of detection answered, and how often none did.
    pub(crate) detected_by: BTreeMap<String, u64>,
    /// Each operator's answer to one frame.
    pub(crate) life: Vec<Stage>,
    /// In how many sets of a join an input was missing.
    pub(crate) missing: BTreeMap<Arc<str>, u64>,
}

/// What the table says of a drive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Figures {
    /// The ages of what control acted upon: the median and the 99th percentile.
    pub(crate) ages: [Duration; 2],
    /// The mean box AP of the detectors behind it, at all ticks; a safe stop counts 0.
    pub(crate) accuracy: f64,
    pub(crate) stops: usize,
}

impl Driven {
    pub(crate) fn figures(&self) -> Figures {
        let plans = self.commands.iter().filter_map(|command| command.plan);
        let mut ages: Vec<Duration> = plans.clone().map(|(age, _)| age).collect();
        ages.sort_unstable();
        let age = |percent: usize| ages.get(ages.len() * percent / 100).copied();
        let ticks = f64::from(u32::try_from(self.ticks).unwrap_or(u32::MAX));
        Figures {
            ages: [50, 99].map(|percent| age(percent).unwrap_or_default()),
            accuracy: plans.map(|(_, accuracy)| accuracy).sum::<f64>() / ticks,
            stops: self.commands.len() - ages.len(),
        }
    }
}

/// One output of control.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Command {
    /// Since the tick.
    pub(crate) took: Duration,
    /// Of the frame behind the plan, and how accurate its detector is; none is a safe stop.
    pub(crate) plan: Option<(Duration, f64)>,
}

/// How one operator answered one frame.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Stage {
    pub(crate) operator: &'static str,
    /// The frame's age when it was taken in, and when it was answered.
    pub(crate) taken_in: Duration,
    pub(crate) answered: Duration,
    pub(crate) by: String,
}

/// How long to drive, what dies when, and where traces go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Options<'a> {
    pub(crate) mode: Mode,
    pub(crate) length: Duration,
    pub(crate) kill: Option<(VehiclePart, Duration)>,
    pub(crate) traces: Option<&'a Path>,
    /// The frame that is followed.
    pub(crate) frame: u64,
}

/// Drives once, on the clock of the runtime.
pub(crate) async fn drive(options: Options<'_>) -> Result<Driven, Error> {
    let start = Instant::now();
    let kill = match options.kill {
        Some((part, after)) => Kill::new(Some(part), start + after),
        None => Kill::new(None, start),
    };
    let drive = Drive {
        mode: options.mode,
        kill,
        west: Network::new(include_str!("../../../testkit/data/vnperf/highway.csv"), 1000 * MS, 2),
        east: Network::new(include_str!("../../../testkit/data/cicv5g/rural_n8_v10.csv"), MS, 1),
        tracking: Network::new(
            include_str!("../../../testkit/data/cicv5g/urban_n78_v40.csv"),
            MS,
            1,
        ),
    };
    let (left, lefts) = stream(4);
    let (right, rights) = stream(4);
    let (place, places) = stream(4);
    let (tick, ticks) = stream(4);
    let graph = Graph::start(&drive, options, (lefts, rights, places), ticks)?;
    let ticking = tokio::spawn(tick_at_20_hz(tick, options.length));
    let cameras = [(left, VehiclePart::LeftCamera), (right, VehiclePart::RightCamera)];
    for (camera, part) in cameras {
        tokio::spawn(film(camera, part, kill, options.length));
    }
    tokio::spawn(localize(place, kill, options.length));
    let mut driven = graph.watch(options.frame).await?;
    driven.ticks = ticking.await?;
    Ok(driven)
}

/// The operators, and readers of their items.
struct Graph {
    running: Vec<Running>,
    joins: [RunningJoin; 2],
    detected: Items<PerceivedScene>,
    tracked: Items<PerceivedScene>,
    predicted: Items<Prediction>,
    planned: Items<PerceivedScene>,
    commands: Items<Option<PerceivedScene>>,
}

impl Graph {
    // ANCHOR: graph
    fn start(
        drive: &Drive,
        options: Options<'_>,
        (lefts, rights, places): (Reader<Frame>, Reader<Frame>, Reader<u64>),
        ticks: Reader<()>,
    ) -> Result<Self, Error> {
        let [tracking, predicting, planning] =
            [30, 20, 45].map(|ms| Latency::measured(90, ms * MS));
        let after_planning = || vec![Latency::stated(51 * MS)];
        let after = |those: &[&Latency]| {
            those.iter().map(|latency| (*latency).clone()).chain(after_planning()).collect()
        };
        let wait = 20 * MS;
        let reserve = after(&[&tracking, &predicting, &planning]);
        let mut cameras = Join::new(JoinConfig { wait, reserve, ..JoinConfig::default() });
        cameras
            .aligned("left", lefts, |scene: &mut Scene, frame, _| scene.left = Some(*frame))
            .aligned("right", rights, |scene, frame, _| scene.right = Some(*frame))
            .latest("localization", places, 200 * MS, |scene, place, _| scene.place = Some(*place));
        let (joining_scenes, scenes) = cameras.spawn()?;

        let config = |name: &str, after: Vec<Latency>, own: Option<&Latency>| Config {
            name: name.into(),
            reserve: after,
            latency: own.cloned(),
            output_len: 64,
            trace: options.traces.map(|folder| Trace {
                path: folder.join(format!("{name}.jsonl")),
                recording: Recording::default(),
            }),
            ..Config::default()
        };
        let mut running = Vec::new();
        let settings = config("detection", after(&[&tracking, &predicting, &planning]), None);
        let detected = start(Detection(drive.clone()), settings, scenes, &mut running)?;
        let settings = config("tracking", after(&[&predicting, &planning]), Some(&tracking));
        let in_order = detected.another().in_order(100 * MS, 200 * MS, |_| {});
        let tracked = start(Tracking(drive.clone()), settings, in_order, &mut running)?;
        let settings = config("prediction", after(&[&planning]), Some(&predicting));
        let predicted =
            start(Predicting(drive.clone()), settings, tracked.another(), &mut running)?;
        let settings = config("planning", after_planning(), Some(&planning));
        let planned = start(Planning(drive.clone()), settings, predicted.another(), &mut running)?;

        let mut orders = Join::new(JoinConfig { name: "orders".into(), ..JoinConfig::default() });
        orders.aligned("tick", ticks, |_: &mut Order, _, _| {});
        orders.latest_items("plan", planned.another(), 1000 * MS, |order, item| {
            order.plan = item.value().copied();
        });
        orders.origin_of("plan");
        let (joining_orders, orders) = orders.spawn()?;
        let commands = start(Control, config("control", Vec::new(), None), orders, &mut running)?;
        let joins = [joining_scenes, joining_orders];
        Ok(Self { running, joins, detected, tracked, predicted, planned, commands })
    }
    // ANCHOR_END: graph

    /// Reads all outputs until they end.
    async fn watch(self, frame: u64) -> Result<Driven, Error> {
        let Self { running, joins, detected, tracked, predicted, planned, mut commands } = self;
        let stages = tokio::spawn(async move {
            let (detected, tracked, predicted, planned) = tokio::join!(
                note("detection", detected, frame),
                note("tracking", tracked, frame),
                note("prediction", predicted, frame),
                note("planning", planned, frame),
            );
            (detected.0, [detected.1, tracked.1, predicted.1, planned.1].concat())
        });
        let (mut driven, mut control) = (Driven::default(), None);
        while let Some(item) = commands.read().await {
            let now = std::time::Instant::from(Instant::now());
            let plan = item.value().copied().flatten();
            let by = if plan.is_some() { "local" } else { "safe stop" };
            control = control.or_else(|| Stage::of("control", &item, frame, by));
            let plan = plan.map(|seen| (now - seen.captured, seen.accuracy));
            driven.commands.push(Command { took: item.took(), plan });
        }
        (driven.detected_by, driven.life) = stages.await?;
        driven.life.extend(control);
        for operator in running {
            operator.join().await?;
        }
        for join in joins {
            driven.missing.extend(join.join().await.missing);
        }
        Ok(driven)
    }
}

/// Starts an operator.
fn start<P: Operator>(
    operator: P,
    config: Config,
    input: Reader<P::Input>,
    running: &mut Vec<Running>,
) -> Result<Items<P::Output>, Error> {
    let (started, items) = spawn(operator, config, input)?;
    running.push(started);
    Ok(items)
}

/// Who answered how many messages, and how this operator answered the frame.
async fn note<O: Send + Sync + 'static>(
    operator: &'static str,
    mut items: Items<O>,
    frame: u64,
) -> (BTreeMap<String, u64>, Vec<Stage>) {
    let (mut by_source, mut stages) = (BTreeMap::new(), Vec::new());
    while let Some(item) = items.read().await {
        let by = match &item.ending {
            Ending::Preliminary(it) | Ending::Forwarded(it) => it.source.name.to_string(),
            Ending::Final(source) => source.name.to_string(),
            Ending::Missed => "substitute, missed".into(),
            Ending::Refused(_) => "substitute, refused".into(),
        };
        stages.extend(Stage::of(operator, &item, frame, &by));
        *by_source.entry(by).or_default() += 1;
    }
    (by_source, stages)
}

impl Stage {
    /// The answer just read, if it is to this frame of a camera.
    fn of<O>(operator: &'static str, item: &Item<O>, frame: u64, by: &str) -> Option<Self> {
        let lineage = item.lineage.as_deref()?;
        let origin = lineage.origin.as_ref()?;
        if origin.seq != Some(frame) || !origin.stream.ends_with("-camera") {
            return None;
        }
        let answered = std::time::Instant::from(Instant::now()) - lineage.captured?;
        let taken_in = answered.saturating_sub(item.took());
        Some(Self { operator, taken_in, answered, by: by.to_owned() })
    }
}

/// Frames at 10 Hz, each with the end-to-end deadline. Somebody walks towards the road for half of each 10 s.
async fn film(mut camera: Writer<Frame>, part: VehiclePart, kill: Kill, length: Duration) {
    let (start, mut period) = (Instant::now(), interval(100 * MS));
    for seq in 0.. {
        let captured = period.tick().await.into_std();
        if start.elapsed() >= length {
            return;
        }
        if !kill.hits(part) {
            let frame = Frame { captured, walker: seq % 100 < 50 };
            let lineage = Lineage::new(part.name(), seq, captured).within(END_TO_END);
            // A frame that finds no room is not taken: the next one is worth more.
            let _ = camera.write_with(frame, lineage);
        }
    }
}

async fn localize(mut places: Writer<u64>, kill: Kill, length: Duration) {
    let (start, mut period) = (Instant::now(), interval(50 * MS));
    for seq in 0.. {
        let captured = period.tick().await;
        if start.elapsed() >= length {
            return;
        }
        if !kill.hits(VehiclePart::Localization) {
            let _ = places.write_with(seq, Lineage::new("localization", seq, captured));
        }
    }
}

/// How many ticks there were. Each has to be answered before the next one.
async fn tick_at_20_hz(mut ticks: Writer<()>, length: Duration) -> u64 {
    let (start, mut period) = (Instant::now(), interval(50 * MS));
    for seq in 0.. {
        let now = period.tick().await;
        if start.elapsed() >= length {
            return seq;
        }
        let _ = ticks.write_with((), Lineage::new("control", seq, now).within(40 * MS));
    }
    0
}
