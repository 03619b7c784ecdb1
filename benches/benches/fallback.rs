//! Compares `FallbackLayer` with tower-resilience's hedge, time limit and fallback on the recorded
//! drives: which detector's answer a vehicle gets, when, and at what cost in processor time.
//!
//! The detectors take the paper's runtimes and the drive's round trips, in virtual time. So answers
//! and latencies are the same in each run, and only the processor time depends on the host. A frame
//! comes every 100 ms and is wanted within 500 ms.

use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use fuseline_benches::beside::passes;
use fuseline_tokio::tower::FallbackLayer;
use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::Builder;
use tokio::sync::Mutex;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::{Instant, sleep};
use tower::util::BoxCloneService;
use tower::{Layer, Service, ServiceExt, service_fn};
use tower_resilience::fallback::FallbackLayer as OnFailureLayer;
use tower_resilience::hedge::HedgeLayer;
use tower_resilience::timelimiter::TimeLimiterLayer;

const MS: Duration = Duration::from_millis(1);
const PERIOD: Duration = Duration::from_millis(100);
const WANTED_WITHIN: Duration = Duration::from_millis(500);
/// A call that takes longer counts as slow. In good coverage one call in a hundred does.
const HEDGE_AFTER: Duration = Duration::from_millis(150);
/// The longest part of a drive that is played.
const LONGEST: Duration = Duration::from_secs(600);
const TURNS: usize = 5;

/// A detector: its runtime in µs, and its box AP in tenths.
type Detector = (u64, u32);
/// DETR-ResNet-50 on an Orin.
const ON_BOARD: Detector = (301_700, 420);
/// DETR-ResNet-101 on an A100.
const NEARBY: Detector = (118_200, 435);
/// DINO-SWIN-Tiny on an A100.
const BEST: Detector = (90_100, 513);

/// A drive and its columns for the best cloud and the one nearby.
const DRIVES: [(&str, [&str; 2]); 8] = [
    ("cicv5g/arterial_n78_v80", ["rtt_ms"; 2]),
    ("cicv5g/rural_n8_v0", ["rtt_ms"; 2]),
    ("cicv5g/rural_n8_v10", ["rtt_ms"; 2]),
    ("cicv5g/strong_to_weak_n8_v30", ["rtt_ms"; 2]),
    ("cicv5g/urban_n78_v40", ["rtt_ms"; 2]),
    ("cicv5g/weak_to_strong_n8_v50", ["rtt_ms"; 2]),
    ("vnperf/downtown", ["verizon_rtt_ms", "sprint_rtt_ms"]),
    ("vnperf/highway", ["verizon_rtt_ms", "sprint_rtt_ms"]),
];

/// States how a vehicle uses its detectors.
#[derive(Clone, Copy)]
enum DetectorUse {
    /// Calls the best cloud, hedged and limited to this time, and then computes on board.
    HedgeThenOnBoard(Duration),
    /// Calls the best cloud, hedged, and computes on board at the same time.
    HedgeBesideOnBoard,
    /// Calls the best cloud, hedged by the other cloud, and computes on board at the same time.
    HedgeByNearby,
    /// Calls all three through the layer.
    Layer,
}

/// A frame on its way to the detectors.
#[derive(Clone)]
struct HedgedFrame {
    /// The number of times that a cloud was called for it.
    calls: Arc<AtomicUsize>,
    /// The computation on board, if it began with the frame.
    on_board: Arc<Mutex<Option<JoinHandle<u32>>>>,
}

type DetectorService = BoxCloneService<HedgedFrame, u32, String>;

/// The round trips of one network.
struct RecordedTrips {
    start: Instant,
    /// The instants of sending, each with the round trip, or `None` if there was no network.
    samples: Vec<(Duration, Option<Duration>)>,
}

/// The results of some drives.
#[derive(Default)]
struct AnswerFigures {
    /// Each frame's response time, and its AP in tenths.
    answers: Vec<(Duration, u32)>,
    calls: usize,
    processor: Duration,
}

fn main() {
    let turns = passes(TURNS);
    let longest = if turns > 1 { LONGEST } else { 20 * PERIOD };
    println!(
        "AP and latency of answers, calls of clouds; processor time: medians of {turns} turns"
    );
    println!("{:52} AP  p50 ms  p99 ms  late  calls  µs", "");
    let before_on_board = WANTED_WITHIN.saturating_sub(Duration::from_micros(ON_BOARD.0));
    let uses = [
        ("hedge, limit 500 ms, then on board", DetectorUse::HedgeThenOnBoard(WANTED_WITHIN)),
        ("hedge, limit 198 ms, then on board", DetectorUse::HedgeThenOnBoard(before_on_board)),
        ("hedge, limit 500 ms, on board beside it", DetectorUse::HedgeBesideOnBoard),
        ("the same, hedged by the other cloud", DetectorUse::HedgeByNearby),
        ("FallbackLayer", DetectorUse::Layer),
    ];
    let mut figures: Vec<Vec<AnswerFigures>> = uses.iter().map(|_| Vec::new()).collect();
    for _ in 0..turns {
        for ((_, detectors), turns) in uses.iter().zip(&mut figures) {
            turns.push(drive_all(*detectors, longest));
        }
    }
    for ((name, _), turns) in uses.iter().zip(&mut figures) {
        println!("{name:48} {}", shown(turns));
    }
}

/// Plays all drives once.
fn drive_all(detectors: DetectorUse, longest: Duration) -> AnswerFigures {
    let mut all = AnswerFigures::default();
    for (name, columns) in DRIVES {
        let runtime =
            Builder::new_current_thread().enable_time().start_paused(true).build().expect("time");
        let file = format!("{}/../testkit/data/{name}.csv", env!("CARGO_MANIFEST_DIR"));
        let text = fs::read_to_string(file).expect("a recorded drive");
        let networks = columns.map(|column| samples(&text, column));
        let before = process_time();
        let (answers, calls) = runtime.block_on(drive(detectors, networks, longest));
        all.processor += process_time().saturating_sub(before);
        all.answers.extend(answers);
        all.calls += calls;
    }
    all.answers.sort_unstable();
    all
}

fn shown(turns: &mut [AnswerFigures]) -> String {
    turns.sort_unstable_by_key(|turn| turn.processor);
    let AnswerFigures { answers, calls, processor } = &turns[turns.len() / 2];
    let count = |number: usize| f64::from(u32::try_from(number).expect("a few thousand"));
    let frames = count(answers.len());
    let ap = answers.iter().map(|(_, ap)| f64::from(*ap)).sum::<f64>() / frames / 10.0;
    let at = |percent: usize| answers[(answers.len() - 1) * percent / 100].0.as_secs_f64() * 1e3;
    let late = answers.iter().filter(|(took, _)| *took > WANTED_WITHIN + MS).count();
    let [late, calls] = [100.0 * count(late) / frames, count(*calls) / frames];
    let micros = processor.as_secs_f64() * 1e6 / frames;
    let [p50, p99] = [at(50), at(99)];
    format!("{ap:6.2} {p50:7.0} {p99:7.0} {late:4.1}% {calls:6.2} {micros:5.1}")
}

fn process_time() -> Duration {
    clock_gettime(ClockId::ProcessCPUTime).try_into().expect("it is positive")
}

fn samples(text: &str, column: &str) -> Vec<(Duration, Option<Duration>)> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("names").split(',').collect();
    let index = names.iter().position(|name| *name == column).expect("its column");
    let unit = if names[0] == "second" { 1.0 } else { 0.001 };
    let row = |line: &str| {
        let number = |i| line.split(',').nth(i).and_then(|field| field.parse::<f64>().ok());
        let sent = Duration::from_secs_f64(number(0).expect("a time") * unit);
        (sent, Duration::try_from_secs_f64(number(index).expect("a round trip") / 1e3).ok())
    };
    lines.map(row).collect()
}

/// Plays one drive. Returns each frame's time and AP, in no particular order, and the number of
/// calls to clouds.
async fn drive(
    detectors: DetectorUse,
    networks: [Vec<(Duration, Option<Duration>)>; 2],
    longest: Duration,
) -> (Vec<(Duration, u32)>, usize) {
    let start = Instant::now();
    let length = networks[0].last().expect("rows").0.min(longest);
    let networks = networks.map(|samples| Arc::new(RecordedTrips { start, samples }));
    let service = service(detectors, &networks);
    let (mut frames, mut answers) = (JoinSet::new(), Vec::new());
    let calls = Arc::new(AtomicUsize::new(0));
    while start.elapsed() < length {
        frames.spawn(answer(detectors, service.clone(), Arc::clone(&calls)));
        sleep(PERIOD).await;
        while let Some(done) = frames.try_join_next() {
            answers.push(done.expect("an answer"));
        }
    }
    answers.extend(frames.join_all().await);
    (answers, calls.load(Ordering::Relaxed))
}

async fn answer(
    detectors: DetectorUse,
    mut service: DetectorService,
    all_calls: Arc<AtomicUsize>,
) -> (Duration, u32) {
    let is_beside =
        matches!(detectors, DetectorUse::HedgeBesideOnBoard | DetectorUse::HedgeByNearby);
    let on_board = is_beside.then(|| tokio::spawn(on_board()));
    let calls = Arc::new(AtomicUsize::new(0));
    let frame = HedgedFrame { calls: Arc::clone(&calls), on_board: Arc::new(Mutex::new(on_board)) };
    let start = Instant::now();
    let answer = service.ready().await.expect("a service").call(frame).await;
    all_calls.fetch_add(calls.load(Ordering::Relaxed), Ordering::Relaxed);
    (start.elapsed(), answer.expect("on board answers"))
}

async fn on_board() -> u32 {
    sleep(Duration::from_micros(ON_BOARD.0)).await;
    ON_BOARD.1
}

fn service(detectors: DetectorUse, networks: &[Arc<RecordedTrips>; 2]) -> DetectorService {
    let [best, nearby] = [(BEST, &networks[0]), (NEARBY, &networks[1])];
    match detectors {
        DetectorUse::HedgeThenOnBoard(limit) => hedged(best, best, limit),
        DetectorUse::HedgeBesideOnBoard => hedged(best, best, WANTED_WITHIN),
        DetectorUse::HedgeByNearby => hedged(best, nearby, WANTED_WITHIN),
        DetectorUse::Layer => {
            let local = service_fn(|_: HedgedFrame| async { Ok::<_, String>(on_board().await) });
            let layer = FallbackLayer::new(local).fallback(cloud(nearby), WANTED_WITHIN);
            let service = layer.deadline(WANTED_WITHIN).layer(cloud(best));
            BoxCloneService::new(service.map_err(|error| error.to_string()))
        }
    }
}

/// Returns a service that calls the first cloud and then the second one, and takes the first
/// answer.
fn hedged(
    first: (Detector, &Arc<RecordedTrips>),
    second: (Detector, &Arc<RecordedTrips>),
    limit: Duration,
) -> DetectorService {
    let clouds = [cloud(first), cloud(second)];
    let inner = service_fn(move |frame: HedgedFrame| {
        let called = frame.calls.load(Ordering::Relaxed);
        clouds[called.min(1)].clone().oneshot(frame)
    });
    let hedge = HedgeLayer::builder().delay(HEDGE_AFTER).max_hedged_attempts(2).build();
    let hedged = hedge.layer(inner).map_err(|error| format!("{error:?}"));
    let limit = TimeLimiterLayer::builder().timeout_duration(limit).build();
    let limited = limit.layer(hedged).map_err(|error| format!("{error:?}"));
    let fallback = OnFailureLayer::<HedgedFrame, u32, String>::builder().service(
        |frame: HedgedFrame| async move {
            match frame.on_board.lock().await.take() {
                Some(begun) => begun.await.map_err(|error| error.to_string()),
                None => Ok(on_board().await),
            }
        },
    );
    BoxCloneService::new(fallback.build().layer(limited).map_err(|error| format!("{error:?}")))
}

/// Returns a detector in a cloud.
fn cloud(
    ((runtime, ap), network): (Detector, &Arc<RecordedTrips>),
) -> impl Service<HedgedFrame, Response = u32, Error = String, Future: Send> + Clone + Send + 'static
{
    let network = Arc::clone(network);
    service_fn(move |frame: HedgedFrame| {
        frame.calls.fetch_add(1, Ordering::Relaxed);
        let took = network.round_trip() + Duration::from_micros(runtime);
        async move {
            sleep(took).await;
            Ok(ap)
        }
    })
}

impl RecordedTrips {
    /// Returns the round trip of a message that is sent now, including the wait for the network.
    fn round_trip(&self) -> Duration {
        let now = self.start.elapsed();
        let next = self.samples.partition_point(|(sent, _)| *sent <= now);
        let mut samples = self.samples[next.max(1) - 1..].iter();
        let found = samples.find_map(|(sent, trip)| Some(sent.saturating_sub(now) + (*trip)?));
        found.unwrap_or(LONGEST)
    }
}
