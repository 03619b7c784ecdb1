//! One drive: the sensors, the graph of operators, and what control did at each of its ticks.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::{
    Config, Ending, Error, Item, Items, Join, JoinConfig, Latency, Lineage, Operator, Reader,
    Running, RunningJoin, Trace, Writer, spawn, stream,
};
use tokio::time::{Instant, interval, interval_at, sleep_until};

use super::operators::{
    Control, Detection, Drive, Frame, Order, PerceivedScene, Planning, Predicting, Prediction,
    Rule, Scene, Tracking,
};
use super::recording::Recording;
use super::score::{Command, Figures};
use super::world::{Kill, Network, VehiclePart};

const MS: Duration = Duration::from_millis(1);
/// The deadline from capture to control.
const END_TO_END: Duration = Duration::from_millis(500);
/// Control's ticks lie between two steps of everything that happens before them.
const FIRST_TICK: Duration = MS;
const TICK: Duration = Duration::from_millis(50);

/// The outcome of a drive.
#[derive(Clone, Default, Debug)]
pub(crate) struct Driven {
    /// The number of control's ticks, and control's outputs.
    pub(crate) ticks: u64,
    pub(crate) commands: Vec<Command>,
    /// The number of detection's items by source, with [`SUBSTITUTE`] as one of the sources.
    pub(crate) detected_by: BTreeMap<String, usize>,
    /// The number of items of the operators before control that are substitutes.
    pub(crate) substitutes: usize,
    /// How each operator handled the frame that is followed.
    pub(crate) life: Vec<Stage>,
}

/// The head of the table, without the end of its line.
pub(crate) const HEAD: &str = "| rule | AP50 | older | age p50 | p99 | substitutes | safe stops ";

impl Driven {
    /// Formats a line of the table.
    pub(crate) fn row(&self, rule: Rule, recording: &Recording) -> String {
        let Figures { ap50, old, ages, stops } = Figures::of(recording, &self.commands, END_TO_END);
        let ([p50, p99], substitutes) = (ages.map(|age| age.as_millis()), self.substitutes);
        let rule = rule.name();
        format!(
            "| {rule} | {ap50:.1} | {old:.1} % | {p50} ms | {p99} ms | {substitutes} | {stops} |"
        )
    }
}

/// States how one operator answered one frame.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Stage {
    pub(crate) operator: &'static str,
    /// The frame's age when the operator received it, and when the operator sent its output.
    pub(crate) taken_in: Duration,
    pub(crate) answered: Duration,
    pub(crate) by: String,
}

/// The options of a drive: its length, what dies when, and where traces go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Options<'a> {
    pub(crate) rule: Rule,
    pub(crate) recording: &'a Arc<Recording>,
    pub(crate) length: Duration,
    pub(crate) kill: Option<(VehiclePart, Duration)>,
    pub(crate) traces: Option<&'a Path>,
    /// The frame that is followed.
    pub(crate) frame: usize,
}

/// Drives once, on the clock of the runtime.
pub(crate) async fn drive(options: Options<'_>) -> Result<Driven, Error> {
    let start = Instant::now();
    let kill = match options.kill {
        Some((part, after)) => Kill::new(Some(part), start + after),
        None => Kill::new(None, start),
    };
    let drive = Drive {
        rule: options.rule,
        recording: Arc::clone(options.recording),
        start,
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
        tokio::spawn(film(camera, part, drive.clone(), options.length));
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
    fn start(
        drive: &Drive,
        options: Options<'_>,
        (lefts, rights, places): (Reader<Frame>, Reader<Frame>, Reader<u64>),
        ticks: Reader<()>,
    ) -> Result<Self, Error> {
        let [tracking, predicting, planning] =
            [30, 20, 46].map(|ms| Latency::measured(90, ms * MS));
        // This covers control, including the wait for its next tick.
        let after_planning = || vec![Latency::stated(52 * MS)];
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
                recording: fuseline_tokio::Recording::default(),
            }),
            ..Config::default()
        };
        let mut running = Vec::new();
        let mut settings = config("detection", after(&[&tracking, &predicting, &planning]), None);
        settings.commit = drive.rule.commit();
        let detected = start(Detection(drive.clone()), settings, scenes, &mut running)?;
        let settings = config("tracking", after(&[&predicting, &planning]), Some(&tracking));
        // Under progressive an old frame's better boxes may come after a newer frame's.
        let boxes = match drive.rule {
            Rule::Progressive => newest(detected.new_reader()),
            _ => detected.new_reader().in_order(100 * MS, 200 * MS, |_| {}),
        };
        let tracked = start(Tracking(drive.clone()), settings, boxes, &mut running)?;
        let settings = config("prediction", after(&[&planning]), Some(&predicting));
        let in_order = tracked.new_reader().in_order(100 * MS, 150 * MS, |_| {});
        let predicted = start(Predicting(drive.clone()), settings, in_order, &mut running)?;
        let settings = config("planning", after_planning(), Some(&planning));
        let planned =
            start(Planning(drive.clone()), settings, predicted.new_reader(), &mut running)?;

        let mut orders = Join::new(JoinConfig { name: "orders".into(), ..JoinConfig::default() });
        orders.aligned("tick", ticks, |_: &mut Order, _, _| {});
        orders.latest_items("plan", planned.new_reader(), 1000 * MS, |order, item| {
            order.plan = item.value().copied();
        });
        orders.origin_of("plan");
        let (joining_orders, orders) = orders.spawn()?;
        let commands = start(
            Control(drive.clone()),
            config("control", Vec::new(), None),
            orders,
            &mut running,
        )?;
        let joins = [joining_scenes, joining_orders];
        Ok(Self { running, joins, detected, tracked, predicted, planned, commands })
    }

    /// Reads all outputs until they end.
    async fn watch(self, frame: usize) -> Result<Driven, Error> {
        let Self { running, joins, detected, tracked, predicted, planned, mut commands } = self;
        let stages = tokio::spawn(async move {
            tokio::join!(
                note("detection", detected, frame),
                note("tracking", tracked, frame),
                note("prediction", predicted, frame),
                note("planning", planned, frame),
            )
        });
        let (mut driven, mut control) = (Driven::default(), None);
        while let Some(item) = commands.read().await {
            let plan = item.value().copied().flatten();
            let by = if plan.is_some() { "local" } else { "safe stop" };
            control = control.or_else(|| Stage::of("control", &item, frame, by));
            let tick = FIRST_TICK + TICK * u32::try_from(item.timestamp)?;
            let seen = plan.map(|scene| scene.seen);
            driven.commands.push(Command { tick, took: item.latency(), seen });
        }
        let (detected, tracked, predicted, planned) = stages.await?;
        for (by, stages) in [&detected, &tracked, &predicted, &planned] {
            driven.substitutes += by.get(SUBSTITUTE).copied().unwrap_or_default();
            driven.life.extend(stages.iter().cloned());
        }
        driven.detected_by = detected.0;
        driven.life.extend(control);
        for operator in running {
            operator.join().await?;
        }
        for join in joins {
            join.join().await;
        }
        Ok(driven)
    }
}

/// Stands for a source in the counts of items that no source computed.
const SUBSTITUTE: &str = "substitute";

/// Passes on the items that a consumer would keep under progressive. Drops an item that is older
/// than an earlier one, or of the same timestamp and from a source that is not better.
fn newest(mut items: Items<PerceivedScene>) -> Items<PerceivedScene> {
    let (mut writer, reader) = stream(64);
    tokio::spawn(async move {
        let mut last = None;
        while let Some(item) = items.read().await {
            let priority = item.forwarded().map_or(0, |it| it.source.priority);
            let place = Some((item.timestamp, priority));
            if item.value().is_some() && last < place {
                last = place;
                let _ = writer.write_with(Item::clone(&item), item.lineage.clone());
            }
        }
    });
    reader
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

/// Counts the items of each source, and records how this operator handled the frame.
async fn note<O: Send + Sync + 'static>(
    operator: &'static str,
    mut items: Items<O>,
    frame: usize,
) -> (BTreeMap<String, usize>, Vec<Stage>) {
    let (mut by_source, mut stages) = (BTreeMap::new(), Vec::new());
    while let Some(item) = items.read().await {
        let by = match &item.ending {
            Ending::Preliminary(it) | Ending::Forwarded(it) => &it.source.name,
            // The same output was already counted as a preliminary one.
            Ending::Final(_) => continue,
            Ending::Missed | Ending::Refused(_) => SUBSTITUTE,
        };
        stages.extend(Stage::of(operator, &item, frame, by));
        *by_source.entry(by.to_owned()).or_default() += 1;
    }
    (by_source, stages)
}

impl Stage {
    /// Describes the item that was just read, or returns `None` if it is not about this frame of a
    /// camera.
    fn of<O>(operator: &'static str, item: &Item<O>, frame: usize, by: &str) -> Option<Self> {
        let lineage = item.lineage.as_deref()?;
        let origin = lineage.origin.as_ref()?;
        if origin.seq != u64::try_from(frame).ok() || !origin.stream.ends_with("-camera") {
            return None;
        }
        let answered = std::time::Instant::from(Instant::now()) - lineage.captured?;
        let taken_in = answered.saturating_sub(item.latency());
        Some(Self { operator, taken_in, answered, by: by.to_owned() })
    }
}

/// Writes the recorded frames, each with the end-to-end deadline. Somebody walks towards the road
/// for half of each 10 s.
async fn film(mut camera: Writer<Frame>, part: VehiclePart, drive: Drive, length: Duration) {
    let frames = (0..drive.recording.len()).map(|number| (number, Recording::captured(number)));
    for (number, captured) in frames.take_while(|(_, captured)| *captured < length) {
        let captured = drive.start + captured;
        sleep_until(captured).await;
        if !drive.kill.hits(part) {
            let frame = Frame { number, walker: number % 70 < 35 };
            let seq = u64::try_from(number).unwrap_or(u64::MAX);
            let lineage = Lineage::new(part.name(), seq, captured).within(END_TO_END);
            // A frame that finds no room is dropped, because the next one is worth more.
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

/// Sends control's ticks and returns how many there were. Control has to answer each before the
/// next.
async fn tick_at_20_hz(mut ticks: Writer<()>, length: Duration) -> u64 {
    let start = Instant::now();
    let mut period = interval_at(start + FIRST_TICK, TICK);
    for seq in 0.. {
        let now = period.tick().await;
        if start.elapsed() >= length {
            return seq;
        }
        let _ = ticks.write_with((), Lineage::new("control", seq, now).within(40 * MS));
    }
    0
}
