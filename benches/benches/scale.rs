//! How many operators one core carries at 30 messages a second each, until outputs come late, and how
//! much memory an operator takes.
//!
//! Each operator has local, which takes 20 ms, and two clouds of 30 and 40 ms; the best answers. All run
//! on one thread. An output is late if it comes more than 5 ms after its cloud answered: that is the
//! lateness that the guard counts on by default.
//!
//! With the feature `virtual-time` no host is too slow: what is found is how many operators the processor time of one
//! core is enough for.

use std::fs;
use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::{Config, Error, Local, Operator, Setup, Writer, spawn, stream};
use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::Builder;
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep};

/// From one message of an operator to the next.
const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / 30);
const MESSAGES: u64 = 90;
const ANSWERS: Duration = Duration::from_millis(40);
const LATENESS: Duration = Duration::from_millis(5);
/// Outputs run late if more than this share of them is, in per cent: on a machine with other work on it
/// some always are.
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

fn main() {
    println!(
        "{:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "operators", "busy", "a message", "p50", "p99", "late", "memory"
    );
    // `scale 1000`: so many alone, whose memory nothing has taken before.
    let mut arguments = std::env::args().skip(1).filter_map(|argument| argument.parse().ok());
    if let Some(operators) = arguments.next() {
        carries(operators);
        return;
    }
    let mut operators = 1;
    let (mut most, mut least) = (0, usize::MAX);
    // Doubles until it is too much, then halves the gap.
    while least - most > most / 16 + 1 {
        if carries(operators) {
            most = operators;
        } else {
            least = operators;
        }
        operators = if least == usize::MAX { 2 * most.max(1) } else { most.midpoint(least) };
    }
    println!(
        "{most} operators of 30 messages a second on one core, {} messages a second",
        30 * most
    );
}

/// Runs so many for three seconds; whether outputs were in time.
fn carries(operators: usize) -> bool {
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
            let (writer, input) = stream(64);
            let (_, mut output) = spawn(Small, Config::default(), input).expect("it is configured");
            // All cameras have phases of their own.
            let share = u32::try_from(index * 1000 / operators).unwrap_or(0);
            feeders.push(tokio::spawn(feed(writer, began + PERIOD * share / 1000)));
            readers.push(tokio::spawn(async move {
                let mut late = Vec::new();
                while let Some(item) = output.read().await {
                    late.push(item.took().saturating_sub(ANSWERS));
                }
                late
            }));
        }
        let spent = process_time();
        for feeder in feeders {
            feeder.await.expect("it does not panic");
        }
        // What an earlier round took and gave back is taken again first.
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

async fn feed(mut writer: Writer<u64>, first: Instant) {
    let mut ticks = interval_at(first, PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Burst);
    for t in 0..MESSAGES {
        ticks.tick().await;
        // Who lags this far is seen to by what it answers.
        let _ = writer.write(t);
    }
}

fn process_time() -> Duration {
    clock_gettime(ClockId::ProcessCPUTime).try_into().expect("it is positive")
}

/// The process's memory, in bytes.
fn resident() -> usize {
    let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: usize = statm.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
    pages * 4096
}
