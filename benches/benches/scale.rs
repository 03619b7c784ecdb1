//! Measures how many operators one core carries at 30 messages a second each, until outputs come
//! late, and how much memory an operator takes.
//!
//! Each operator has local, which takes 20 ms, and two clouds of 30 and 40 ms; the best answers.
//! All run on one thread. An output is late if it comes more than 5 ms after its cloud answered,
//! which is the guard's default lateness.
//!
//! For comparison it measures hand-written code: a channel, and for each message a task that waits
//! for the best result with a `select!`. That code has no window, queue, gate, counts or reasons.
//!
//! With the feature `virtual-time` no host is too slow. Then the bench finds the number of
//! operators for which the processor time of one core suffices.

use std::env;
use std::fs;
use std::pin::pin;
use std::process::{self, Command};
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::{Config, Error, Local, Operator, Setup, Writer, spawn, stream};
use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::Builder;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{Instant, Interval, MissedTickBehavior, interval_at, sleep};

/// The time from one message of an operator to the next.
const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / 30);
const MESSAGES: u64 = 90;
const ANSWERS: Duration = Duration::from_millis(40);
const LATENESS: Duration = Duration::from_millis(5);
/// There are too many operators if more than this percentage of all outputs is late. On a busy host
/// some outputs are always late.
const SHARE: usize = 50;

struct Small;

impl Operator for Small {
    type Input = u64;
    type Output = u64;

    fn setup(self, setup: &mut Setup<u64, u64>) -> Local<u64, u64> {
        for (priority, ms) in [(1, 30), (2, 40)] {
            let handle = move |message, _| async move {
                sleep(Duration::from_millis(ms)).await;
                Ok::<u64, Error>(message)
            };
            setup.use_cloud(handle, |m, _| Some((*m, Duration::from_millis(500))), Ok, priority);
        }
        Local::futures(4, |message: Arc<u64>, _| async move {
            sleep(Duration::from_millis(20)).await;
            Ok(*message)
        })
    }
}

/// The task that feeds an operator, and the task that reads how late its outputs were.
type Ends = (JoinHandle<()>, JoinHandle<Vec<Duration>>);

fn main() {
    // `scale 1000` tries only this many operators. `scale 1000 Fuseline` tries them with one
    // contestant and fails if there are too many.
    let mut arguments = env::args().skip(1).filter(|argument| argument != "--bench");
    let only: Option<usize> = arguments.next().and_then(|argument| argument.parse().ok());
    let of = arguments.next();
    let contestants = [("Fuseline", with_adapter as fn(Instant) -> Ends), ("by hand", by_hand)];
    for (name, spawn) in contestants {
        match (only, &of) {
            (Some(operators), Some(of)) if of == name => {
                process::exit(i32::from(!carries(operators, spawn)));
            }
            (Some(_), Some(_)) => {}
            (Some(operators), None) => {
                header(name);
                carries(operators, spawn);
            }
            (None, _) => {
                header(name);
                let most = most(name);
                let messages = 30 * most;
                println!(
                    "{most} of 30 messages a second on one core, {messages} messages a second"
                );
            }
        }
    }
}

fn header(name: &str) {
    println!(
        "{name:<9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "busy", "a message", "p50", "p99", "late", "memory"
    );
}

/// Doubles the number until it is too large, and then halves the gap. Each number runs in a process
/// of its own, with fresh memory.
fn most(name: &str) -> usize {
    let program = env::current_exe().expect("this program");
    let carries = |operators: usize| {
        let status = Command::new(&program).args([&operators.to_string(), name]).status();
        status.expect("it starts").success()
    };
    let mut operators = 1;
    let (mut most, mut least) = (0, usize::MAX);
    while least - most > most / 16 + 1 {
        if carries(operators) {
            most = operators;
        } else {
            least = operators;
        }
        operators = if least == usize::MAX { 2 * most.max(1) } else { most.midpoint(least) };
    }
    most
}

/// Runs this many operators for three seconds. Returns `true` if their outputs were in time.
fn carries(operators: usize, spawn: fn(Instant) -> Ends) -> bool {
    let mut builder = Builder::new_current_thread();
    #[cfg(feature = "virtual-time")]
    builder.start_paused(true);
    let runtime = builder.enable_all().build().expect("a runtime");
    let before = resident();
    let (mut late, memory, busy) = runtime.block_on(async {
        let mut readers = Vec::new();
        let mut feeders = Vec::new();
        let began = Instant::now() + PERIOD;
        for index in 0..operators {
            // Each camera has a different phase.
            let share = u32::try_from(index * 1000 / operators).unwrap_or(0);
            let (feeder, reader) = spawn(began + PERIOD * share / 1000);
            feeders.push(feeder);
            readers.push(reader);
        }
        let spent = process_time();
        for feeder in feeders {
            feeder.await.expect("it does not panic");
        }
        let memory = resident().saturating_sub(before) / operators;
        let busy = process_time().saturating_sub(spent);
        let busy = busy.as_secs_f64() / began.elapsed().as_secs_f64();
        let mut late = Vec::new();
        for reader in readers {
            late.extend(reader.await.expect("it does not panic"));
        }
        (late, memory, busy)
    });
    late.sort_unstable();
    let at = |per_cent: usize| late[(late.len() - 1) * per_cent / 100];
    let beyond = late.len() - late.partition_point(|late| *late <= LATENESS);
    let messages = usize::try_from(MESSAGES).unwrap_or(usize::MAX) * operators;
    let is_in_time = beyond * 100 <= messages * SHARE && late.len() == messages && busy <= 1.0;
    println!(
        "{operators:>9} {:>7.0} % {:>6.1} µs {:>6.1} ms {:>6.1} ms {:>4}.{:02} % {:>6} kB",
        busy * 100.0,
        busy * PERIOD.as_secs_f64() * 1e6 / f64::from(u32::try_from(operators).unwrap_or(1)),
        at(50).as_secs_f64() * 1e3,
        at(99).as_secs_f64() * 1e3,
        beyond * 100 / messages,
        beyond * 10_000 / messages % 100,
        memory / 1000
    );
    is_in_time
}

/// Starts an operator whose first message comes at `first`.
fn with_adapter(first: Instant) -> Ends {
    let (writer, input) = stream(64);
    let (_, mut output) = spawn(Small, Config::default(), input).expect("it is configured");
    let reader = tokio::spawn(async move {
        let mut late = Vec::new();
        while let Some(item) = output.read().await {
            late.push(item.latency().saturating_sub(ANSWERS));
        }
        late
    });
    (tokio::spawn(feed(writer, first)), reader)
}

/// Starts the same work by hand.
fn by_hand(first: Instant) -> Ends {
    let (sender, mut output) = mpsc::channel(64);
    let reader = tokio::spawn(async move {
        let mut late = Vec::new();
        while let Some(took) = output.recv().await {
            late.push(Duration::saturating_sub(took, ANSWERS));
        }
        late
    });
    let feeder = tokio::spawn(async move {
        let mut ticks = ticks(first);
        for t in 0..MESSAGES {
            ticks.tick().await;
            tokio::spawn(best(t, sender.clone()));
        }
    });
    (feeder, reader)
}

/// Waits for the best result of one message, with one deadline for both clouds.
async fn best(message: u64, output: mpsc::Sender<Duration>) {
    let source = |ms| async move {
        sleep(Duration::from_millis(ms)).await;
        message
    };
    let began = Instant::now();
    let mut local = pin!(source(20));
    let mut one = pin!(source(30));
    let mut two = pin!(source(40));
    let mut timer = pin!(sleep(Duration::from_millis(500)));
    let (mut has_local, mut has_one) = (false, false);
    loop {
        tokio::select! {
            _ = &mut two => break,
            _ = &mut one, if !has_one => has_one = true,
            _ = &mut local, if !has_local => has_local = true,
            () = &mut timer, if has_local || has_one => break,
        }
    }
    output.send(began.elapsed()).await.expect("somebody waits for it");
}

fn ticks(first: Instant) -> Interval {
    let mut ticks = interval_at(first, PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Burst);
    ticks
}

async fn feed(mut writer: Writer<u64>, first: Instant) {
    let mut ticks = ticks(first);
    for t in 0..MESSAGES {
        ticks.tick().await;
        // If the stream is full, the operator's late outputs show that it lags.
        let _ = writer.write(t);
    }
}

fn process_time() -> Duration {
    clock_gettime(ClockId::ProcessCPUTime).try_into().expect("it is positive")
}

/// Returns the process's resident memory in bytes.
fn resident() -> usize {
    let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: usize = statm.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
    pages * 4096
}
