//! Measures the cost of one hop in a pipeline. A chain of operators with lineages and one
//! end-to-end deadline is compared with hand-written tasks, channels and a `select!`.
//!
//! Each hop has local and a cloud, and both are ready after a few turns of the runtime. Everything
//! runs on one thread, with both sides in turns in one run. The figures are medians over the turns.

use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_benches::beside::passes;
use fuseline_tokio::{
    Config, Error, Item, Items, Latency, Lineage, Local, Operator, Setup, spawn, stream,
};
use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::Builder;
use tokio::sync::mpsc;
use tokio::task::yield_now;
use tokio::time::{interval, sleep_until};

const END_TO_END: Duration = Duration::from_millis(500);
const TURNS: usize = 5;

/// The number of operators in a chain, and the pace of messages.
#[derive(Clone, Copy)]
struct ChainPace {
    hops: u32,
    hertz: u32,
    messages: u32,
}

/// The cost of a hop on one side: the processor time, and the latency's median and 99th percentile.
struct HopCost {
    processor: Duration,
    p50: Duration,
    p99: Duration,
}

fn main() {
    let turns = passes(TURNS);
    let is_bench = turns > 1;
    println!("a hop's processor time and latency, µs, medians of {turns} turns");
    println!("{:28} {:>22} {:>22} {:>6}", "", "operators", "by hand", "ratio");
    for (hops, hertz, messages) in [(5, 30, 60), (5, 200, 400), (100, 30, 60)] {
        let messages = if is_bench { messages } else { 3 };
        let pace = ChainPace { hops, hertz, messages };
        let (mut operators, mut by_hand) = (Vec::new(), Vec::new());
        for _ in 0..turns {
            operators.push(cost(pace, with_operators));
            by_hand.push(cost(pace, with_channels));
        }
        let [operators, by_hand] = [median(&operators), median(&by_hand)];
        let ratio = operators.processor.as_secs_f64() / by_hand.processor.as_secs_f64();
        let name = format!("{hops} hops at {hertz} Hz");
        println!("{name:28} {} {} {ratio:>6.2}", shown(&operators), shown(&by_hand));
        let of_core = operators.processor.as_secs_f64() * f64::from(hops) * f64::from(hertz);
        println!("{:28} {:.1} % of a core", "", 100.0 * of_core);
    }
}

/// Runs one turn of one side.
fn cost<F: Future<Output = Vec<Duration>>>(pace: ChainPace, run: fn(ChainPace) -> F) -> HopCost {
    let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
    let before = process_time();
    let mut latencies = runtime.block_on(run(pace));
    let processor = process_time().saturating_sub(before) / (pace.messages * pace.hops);
    latencies.sort_unstable();
    let at = |percent: usize| latencies[(latencies.len() - 1) * percent / 100] / pace.hops;
    HopCost { processor, p50: at(50), p99: at(99) }
}

fn median(turns: &[HopCost]) -> HopCost {
    let of = |figure: fn(&HopCost) -> Duration| {
        let mut figures: Vec<Duration> = turns.iter().map(figure).collect();
        figures.sort_unstable();
        figures[figures.len() / 2]
    };
    HopCost { processor: of(|it| it.processor), p50: of(|it| it.p50), p99: of(|it| it.p99) }
}

fn shown(cost: &HopCost) -> String {
    let [processor, p50, p99] =
        [cost.processor, cost.p50, cost.p99].map(|time| time.as_secs_f64() * 1e6);
    format!("{processor:6.1} {p50:7.1} {p99:7.1}")
}

fn process_time() -> Duration {
    clock_gettime(ClockId::ProcessCPUTime).try_into().expect("it is positive")
}

async fn source(rounds: u32, value: u64) -> u64 {
    for _ in 0..rounds {
        yield_now().await;
    }
    value
}

/// Registers a cloud whose result is sent, and returns a local computation that is ready before it.
fn set_up<I: Send + Sync + 'static>(
    setup: &mut Setup<I, u64>,
    value: fn(&I) -> u64,
) -> Local<I, u64> {
    let handle = |value, _| async move { Ok::<_, Error>(source(2, value).await) };
    setup.use_cloud(handle, move |it: &I, _| Some((value(it), END_TO_END)), Ok, 1);
    Local::future(move |it: Arc<I>, _| async move { Ok(source(1, value(&it)).await) })
}

/// The first hop, which reads numbers.
struct FirstHop;
/// A later hop, which reads items.
struct NextHop;

impl Operator for FirstHop {
    type Input = u64;
    type Output = u64;

    fn setup(self, setup: &mut Setup<u64, u64>) -> Local<u64, u64> {
        set_up(setup, |value| *value)
    }
}

impl Operator for NextHop {
    type Input = Item<u64>;
    type Output = u64;

    fn setup(self, setup: &mut Setup<Item<u64>, u64>) -> Local<Item<u64>, u64> {
        set_up(setup, |item| item.value().copied().unwrap_or_default())
    }
}

async fn with_operators(pace: ChainPace) -> Vec<Duration> {
    let (mut writer, input) = stream(64);
    // The reserve is the latency of the hops downstream.
    let config = |hop: u32| Config {
        reserve: vec![Latency::stated((pace.hops - hop) * Duration::from_millis(1))],
        ..Config::default()
    };
    let mut items: Items<u64> = spawn(FirstHop, config(1), input).expect("it is configured").1;
    for hop in 2..=pace.hops {
        items = spawn(NextHop, config(hop), items).expect("it is configured").1;
    }
    tokio::spawn(async move {
        let mut ticks = interval(Duration::from_secs(1) / pace.hertz);
        for seq in 0..u64::from(pace.messages) {
            ticks.tick().await;
            let lineage = Lineage::new("camera", seq, Instant::now()).within(END_TO_END);
            writer.write_with(seq, lineage).expect("the operator reads");
        }
    });
    let mut latencies = Vec::new();
    while let Some(item) = items.read().await {
        assert!(item.value().is_some(), "nothing was missed");
        latencies
            .push(item.lineage.as_ref().and_then(|it| it.age(Instant::now())).expect("an age"));
    }
    latencies
}

/// A message of the hand-written side: the instant of its capture, and its value.
type Captured = (Instant, u64);

async fn with_channels(pace: ChainPace) -> Vec<Duration> {
    let (writer, mut input) = mpsc::channel::<Captured>(64);
    for _ in 0..pace.hops {
        let (sender, output) = mpsc::channel(64);
        tokio::spawn(hop_by_hand(input, sender));
        input = output;
    }
    tokio::spawn(async move {
        let mut ticks = interval(Duration::from_secs(1) / pace.hertz);
        for seq in 0..u64::from(pace.messages) {
            ticks.tick().await;
            writer.send((Instant::now(), seq)).await.expect("the first task reads");
        }
    });
    let mut latencies = Vec::new();
    while let Some((captured, _)) = input.recv().await {
        latencies.push(captured.elapsed());
    }
    latencies
}

/// Plays one hop as one would write it without the library: one message at a time, one deadline,
/// and no window, queue, gate, count, trace, reserve or reason.
async fn hop_by_hand(mut input: mpsc::Receiver<Captured>, output: mpsc::Sender<Captured>) {
    while let Some((captured, value)) = input.recv().await {
        let mut local = std::pin::pin!(source(1, value));
        let mut cloud = std::pin::pin!(source(2, value));
        let mut timer = std::pin::pin!(sleep_until((captured + END_TO_END).into()));
        let mut best = None;
        let answer = loop {
            tokio::select! {
                value = &mut cloud => break value,
                value = &mut local, if best.is_none() => best = Some(value),
                () = &mut timer, if best.is_some() => break best.unwrap_or_default(),
            }
        };
        output.send((captured, answer)).await.expect("the next task reads");
    }
}
