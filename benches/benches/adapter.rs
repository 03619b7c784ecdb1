//! What the tokio adapter costs beside a `select!` written by hand for the same three sources.
//!
//! Everything runs on one thread, so that the process's time is that of the messages. Both sides
//! are measured in turns in one run; the figures are medians over the turns.

use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

use fuseline_tokio::{Config, Error, Items, Local, Operator, Setup, Writer, spawn, stream};
use futures_util::task::AtomicWaker;
use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc;
use tokio::task::yield_now;
use tokio::time::{interval, sleep};

/// Turns for each side; odd, so that there is a median.
const TURNS: usize = 9;
/// Long enough that no timer fires.
const LONG: Duration = Duration::from_secs(10);

/// How a bench's sources take their time; local's first, then the clouds'.
#[derive(Clone, Copy)]
struct Pace {
    name: &'static str,
    messages: u64,
    /// From one message to the next; none waits for the answer.
    period: Option<Duration>,
    sources: [Take; 3],
}

/// How a source takes its time.
#[derive(Clone, Copy)]
enum Take {
    /// Of the runtime.
    Rounds(u32),
    Sleeps(Duration),
}

const BACK_TO_BACK: Pace = Pace {
    name: "back to back",
    messages: 20_000,
    period: None,
    sources: [Take::Rounds(1), Take::Rounds(2), Take::Rounds(3)],
};

const PACED: Pace = Pace {
    name: "200 Hz, sources of 5, 10 and 20 ms",
    messages: 200,
    period: Some(Duration::from_millis(5)),
    sources: [
        Take::Sleeps(Duration::from_millis(5)),
        Take::Sleeps(Duration::from_millis(10)),
        Take::Sleeps(Duration::from_millis(20)),
    ],
};

fn main() {
    // `adapter --bench back adapter 1`: one side of one pace, for a profiler.
    let arguments: Vec<String> = std::env::args().filter(|it| it != "--bench").skip(1).collect();
    if let [pace, side, turns] = &arguments[..] {
        let pace = if pace == "back" { BACK_TO_BACK } else { PACED };
        for _ in 0..turns.parse().expect("a number of turns") {
            // Without a look at the process's time, which ends the program under valgrind.
            if side == "adapter" {
                runtime().block_on(with_adapter(pace));
            } else {
                runtime().block_on(with_select(pace));
            }
        }
        return;
    }
    println!("processor time for a message with local and two clouds, medians of {TURNS} turns");
    println!("{:38} {:>10} {:>10} {:>6}", "", "adapter", "by hand", "ratio");
    for pace in [BACK_TO_BACK, PACED] {
        let mut times = [Vec::new(), Vec::new()];
        for _ in 0..TURNS {
            times[0].push(nanos_for_each(pace, with_adapter));
            times[1].push(nanos_for_each(pace, with_select));
        }
        let [adapter, hand] = times.map(|mut times| {
            times.sort_unstable();
            times[TURNS / 2]
        });
        let ratio = adapter * 100 / hand;
        let (name, whole, hundredths) = (pace.name, ratio / 100, ratio % 100);
        println!("{name:38} {adapter:>7} ns {hand:>7} ns {whole:>3}.{hundredths:02}");
    }
}

/// The process's time for a message when `run` handles them.
fn nanos_for_each<F: Future<Output = ()>>(pace: Pace, run: fn(Pace) -> F) -> u128 {
    let runtime = runtime();
    let before = process_time();
    runtime.block_on(run(pace));
    process_time().saturating_sub(before).as_nanos() / u128::from(pace.messages)
}

fn runtime() -> Runtime {
    Builder::new_current_thread().enable_all().build().expect("a runtime")
}

fn process_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.try_into().expect("it is positive")
}

async fn source(take: Take, value: u64) -> u64 {
    match take {
        Take::Rounds(remaining) => Rounds { remaining, alarm: None }.await,
        Take::Sleeps(time) => sleep(time).await,
    }
    value
}

/// Ready once the runtime has woken it so many times. Unlike `yield_now`, and like an answer from a network, it gains
/// nothing from being polled besides, as `select!` does to all sources whenever one of them is ready.
struct Rounds {
    remaining: u32,
    alarm: Option<Arc<Alarm>>,
}

struct Alarm {
    is_woken: AtomicBool,
    task: AtomicWaker,
}

impl Future for Rounds {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        let alarm = Arc::clone(self.alarm.get_or_insert_with(|| {
            Arc::new(Alarm { is_woken: AtomicBool::new(true), task: AtomicWaker::new() })
        }));
        alarm.task.register(context.waker());
        if !alarm.is_woken.swap(false, Ordering::AcqRel) {
            return Poll::Pending;
        }
        if self.remaining == 0 {
            return Poll::Ready(());
        }
        self.remaining -= 1;
        let waker = Waker::from(alarm);
        pin!(yield_now()).poll(&mut Context::from_waker(&waker))
    }
}

impl Wake for Alarm {
    fn wake(self: Arc<Self>) {
        self.is_woken.store(true, Ordering::Release);
        self.task.wake();
    }
}

/// Three sources whose best is always in time.
struct Fused(Pace);

impl Operator for Fused {
    type Input = u64;
    type Output = u64;

    fn setup(self, setup: &mut Setup<u64, u64>) -> Local<u64, u64> {
        let [local, clouds @ ..] = self.0.sources;
        for (priority, take) in (1..).zip(clouds) {
            let handle = move |value, _| async move { Ok(source(take, value).await) };
            let response_handler = move |value| Ok(value + u64::from(priority));
            setup.use_cloud(
                handle,
                |message, _| Some((*message, LONG)),
                response_handler,
                priority,
            );
        }
        Local::futures(1024, move |message: Arc<u64>, _| async move {
            Ok::<_, Error>(source(local, *message).await)
        })
    }
}

async fn with_adapter(pace: Pace) {
    let (mut writer, input) = stream(1024);
    // A machine that stalls must not make it refuse messages.
    let config = Config { window: 1024, output_len: 1024, ..Config::default() };
    let (_, mut output) = spawn(Fused(pace), config, input).expect("it is configured");
    let mut sum = 0;
    match pace.period {
        None => {
            for t in 0..pace.messages {
                writer.write(t).expect("the operator reads");
                sum += best(&mut output).await;
            }
        }
        Some(period) => {
            let feeder = tokio::spawn(feed(writer, pace.messages, period));
            for _ in 0..pace.messages {
                sum += best(&mut output).await;
            }
            feeder.await.expect("it does not panic");
        }
    }
    assert_best(pace, sum);
}

async fn best(output: &mut Items<u64>) -> u64 {
    let item = output.read().await.expect("an item for each message");
    item.forwarded().expect("sources do not fail").value
}

async fn feed(mut writer: Writer<u64>, messages: u64, period: Duration) {
    let mut ticks = interval(period);
    for t in 0..messages {
        ticks.tick().await;
        writer.write(t).expect("the operator reads");
    }
}

async fn with_select(pace: Pace) {
    let (sender, mut output) = mpsc::channel(1024);
    let mut sum = 0;
    match pace.period {
        None => {
            for t in 0..pace.messages {
                tokio::spawn(by_hand(pace.sources, t, sender.clone()));
                sum += output.recv().await.expect("an answer for each message");
            }
        }
        Some(period) => {
            let feeder = tokio::spawn(async move {
                let mut ticks = interval(period);
                for t in 0..pace.messages {
                    ticks.tick().await;
                    tokio::spawn(by_hand(pace.sources, t, sender.clone()));
                }
            });
            for _ in 0..pace.messages {
                sum += output.recv().await.expect("an answer for each message");
            }
            feeder.await.expect("it does not panic");
        }
    }
    assert_best(pace, sum);
}

/// What one writes for one message when there is nothing ready: one task, one deadline for both
/// clouds, and no window, queue, gate, count, trace or word about why.
async fn by_hand(sources: [Take; 3], message: u64, output: mpsc::Sender<u64>) {
    let [local, one, two] = sources;
    let mut local = pin!(source(local, message));
    let mut one = pin!(source(one, message + 1));
    let mut two = pin!(source(two, message + 2));
    let mut timer = pin!(sleep(LONG));
    let (mut has_local, mut has_one, mut best) = (false, false, None);
    let answer = loop {
        tokio::select! {
            value = &mut two => break value,
            value = &mut one, if !has_one => {
                has_one = true;
                best = Some(value);
            }
            value = &mut local, if !has_local => {
                has_local = true;
                best = best.or(Some(value));
            }
            () = &mut timer, if best.is_some() => break best.unwrap_or_default(),
        }
    };
    output.send(answer).await.expect("somebody waits for it");
}

/// The best source, which adds 2, answered every message.
fn assert_best(pace: Pace, sum: u64) {
    let expected: u64 = (0..pace.messages).map(|message| message + 2).sum();
    assert_eq!(sum, expected);
}
