//! Measures how late outputs are sent with tokio's timers and with the kernel's. They are compared
//! with a hand-written `select!` and with a thread that sleeps by `clock_nanosleep` (cyclictest's
//! method), on an idle host and with twice as many busy threads as cores.

use std::future::pending;
use std::hint::spin_loop;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, available_parallelism};
use std::time::{Duration, Instant};

use fuseline_tokio::{Config, Error, Local, Operator, Setup, Timers, spawn, stream};
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc;
use tokio::time::{interval, sleep};

const MESSAGES: u64 = 1500;
const PERIOD: Duration = Duration::from_millis(2);

/// Runs one way to wait. Returns how late each timer was.
type Run = fn() -> Vec<Duration>;

fn main() {
    println!("µs late of {MESSAGES} timers of 7 ms to 16 ms, one each 2 ms; on one thread");
    println!("{:26}{:^30}{:^30}", "", "idle", "every core twice busy");
    println!(
        "{:26}{:>8}{:>8}{:>8}{:>6}{:>8}{:>8}{:>8}",
        "", "p50", "p99", "max", "", "p50", "p99", "max"
    );
    let runs: [(&str, Run); 6] = [
        ("adapter, tokio's timers", || of_adapter(Timers::Tokio)),
        ("adapter, kernel's timers", || of_adapter(Timers::Kernel)),
        ("the same, SCHED_FIFO", || first(|| of_adapter(Timers::Kernel))),
        ("select! by hand", of_select),
        ("clock_nanosleep", of_sleeping_thread),
        ("the same, SCHED_FIFO", || first(of_sleeping_thread)),
    ];
    for (name, run) in runs {
        let idle = quantiles(run());
        let busy = Busy::new();
        let loaded = quantiles(run());
        drop(busy);
        print!("{name:26}");
        for [p50, p99, max] in [idle, loaded] {
            print!("{p50:>8}{p99:>8}{max:>8}{:>6}", "");
        }
        println!();
    }
}

/// Returns the median, the 99th percentile and the greatest, in µs.
fn quantiles(mut late: Vec<Duration>) -> [u128; 3] {
    late.sort_unstable();
    [50, 99, 100].map(|per_cent| late[(late.len() - 1) * per_cent / 100].as_micros())
}

/// Threads that keep the cores busy until this is dropped.
struct Busy(Arc<AtomicBool>);

impl Busy {
    fn new() -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        for _ in 0..2 * available_parallelism().map_or(1, usize::from) {
            let is_over = Arc::clone(&is_over);
            thread::spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    spin_loop();
                }
            });
        }
        Self(is_over)
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn runtime() -> Runtime {
    Builder::new_current_thread().enable_all().build().expect("a runtime")
}

/// Returns a deadline from 7 ms to 16 ms, mostly between tokio's ticks.
fn deadline(message: u64) -> Duration {
    Duration::from_millis(7) + Duration::from_micros(message * 137 % 9000)
}

/// An operator whose cloud never answers.
struct UnansweredOperator;

impl Operator for UnansweredOperator {
    type Input = u64;
    type Output = u64;

    fn setup(self, setup: &mut Setup<u64, u64>) -> Local<u64, u64> {
        let message_handler = |message: &u64, _| Some(((), deadline(*message)));
        setup.use_cloud(|(), _| pending::<Result<u64, Error>>(), message_handler, Ok, 1).calls =
            1024;
        Local::futures(1024, |message: Arc<u64>, _| async move { Ok(*message) })
    }
}

/// Runs it on a thread under `SCHED_FIFO`.
fn first(run: Run) -> Vec<Duration> {
    let run = move || {
        let priority = ThreadPriority::Crossplatform(50_u8.try_into().expect("from 1 to 99"));
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        set_thread_priority_and_policy(thread_native_id(), priority, policy)
            .unwrap_or_else(|error| panic!("SCHED_FIFO 50: {error:?}"));
        run()
    };
    thread::spawn(run).join().expect("it does not panic")
}

fn of_adapter(timers: Timers) -> Vec<Duration> {
    runtime().block_on(async {
        let (mut writer, input) = stream(1024);
        let config = Config { window: 1024, output_len: 1024, timers, ..Config::default() };
        let (_, mut output) = spawn(UnansweredOperator, config, input).expect("it is configured");
        let feeder = tokio::spawn(async move {
            let mut ticks = interval(PERIOD);
            for message in 0..MESSAGES {
                ticks.tick().await;
                writer.write(message).expect("the operator reads");
            }
        });
        let mut late = Vec::new();
        while let Some(item) = output.read().await {
            let message = item.forwarded().expect("local does not fail").value;
            late.push(item.latency().saturating_sub(deadline(message)));
        }
        feeder.await.expect("it does not panic");
        late
    })
}

fn of_select() -> Vec<Duration> {
    runtime().block_on(async {
        let (sender, mut output) = mpsc::channel(1024);
        tokio::spawn(async move {
            let mut ticks = interval(PERIOD);
            for message in 0..MESSAGES {
                ticks.tick().await;
                tokio::spawn(by_hand(message, sender.clone()));
            }
        });
        let mut late = Vec::new();
        while let Some(lateness) = output.recv().await {
            late.push(lateness);
        }
        late
    })
}

/// Waits with a hand-written `select!` for a cloud that never answers, and for a timer.
async fn by_hand(message: u64, output: mpsc::Sender<Duration>) {
    let began = Instant::now();
    let late = tokio::select! {
        late = pending() => late,
        () = sleep(deadline(message)) => began.elapsed().saturating_sub(deadline(message)),
    };
    output.send(late).await.expect("somebody waits for it");
}

fn of_sleeping_thread() -> Vec<Duration> {
    let now = || clock_gettime(ClockId::Monotonic);
    let late = (0..MESSAGES).map(|message| {
        let length = Timespec::try_from(deadline(message) / 4).expect("it is short");
        let due = now() + length;
        clock_nanosleep_absolute(ClockId::Monotonic, &due).expect("nobody signals");
        Duration::try_from(now() - due).expect("it does not wake before")
    });
    late.collect()
}
