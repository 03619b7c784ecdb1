//! Measures the cost of the tokio adapter, compared with a hand-written `select!` for the same
//! three sources.
//!
//! Everything runs on one thread, so that all of the process's time is spent on the messages. Both
//! sides are measured in turns in one run. The figures are medians over the turns.

use std::time::Duration;

use fuseline_benches::adapter::{BACK_TO_BACK, PACED, Pace, runtime, with_adapter, with_select};
use rustix::time::{ClockId, clock_gettime};

/// The number of turns for each side. It is odd, so that there is a median.
const TURNS: usize = 9;

fn main() {
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

/// Returns the process's time for each message when `run` handles them.
fn nanos_for_each<F: Future<Output = ()>>(pace: Pace, run: fn(Pace) -> F) -> u128 {
    let runtime = runtime();
    let before = process_time();
    runtime.block_on(run(pace));
    process_time().saturating_sub(before).as_nanos() / u128::from(pace.messages)
}

fn process_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.try_into().expect("it is positive")
}
