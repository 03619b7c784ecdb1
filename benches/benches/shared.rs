//! Compares the machine for many threads with the plain machine behind a lock of the standard
//! library or of `parking_lot`. 1, 2 and 4 threads give results for the same messages, and all are
//! measured in turns in one run.
//!
//! The threads go through the messages side by side, so that their calls meet at the same messages.
//! The owner's part, which is opens and offers, is measured before that on one thread.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant as Clock};

use fuseline_core::{
    Admission, At, Cloud, Commit, Deadline, Fusion, Instant, Opening, Outcome, Priority, Timestamp,
};
use fuseline_threads::Shared;
use fuseline_traces::nanos;

const WINDOW: usize = 1024;
/// The priorities of local and the clouds.
const PRIORITIES: [Priority; 4] =
    [Priority::LOCAL, Priority::new(1), Priority::new(2), Priority::new(3)];
const SOURCES: usize = PRIORITIES.len();
/// The number of machines. There are enough operations that every thread begins long before the
/// first one ends.
const MACHINES: usize = 32;
const MESSAGES: usize = MACHINES * WINDOW;
const CALLS: usize = MESSAGES * SOURCES;
/// The number of turns. It is odd, so that there is a median.
const TURNS: usize = 21;
/// A deadline so long that no timer fires.
const LONG: Deadline = Deadline::from_millis(1_000_000);
const NOW: Instant = Instant::from_nanos(1);

/// Gives a source's result for one of the messages. Returns `true` if it is to be forwarded.
type GiveResult<'a> = dyn Fn(usize, Priority) -> bool + Sync + 'a;

/// A machine with as many open messages as its window holds.
trait Machine {
    const NAME: &str;

    fn new(clouds: &[Cloud]) -> Self;

    /// Opens messages from `t` on and offers each to all clouds. Returns a function that gives
    /// their results, and how long this took.
    fn fill(&mut self, t: u64) -> (Box<GiveResult<'_>>, Duration);
}

struct LockFree(Box<Shared<3, WINDOW>>);

impl Machine for LockFree {
    const NAME: &str = "shared";

    fn new(clouds: &[Cloud]) -> Self {
        let shared = Shared::new(WINDOW, Commit::Eager, clouds).expect("a valid configuration");
        Self(Box::new(shared))
    }

    fn fill(&mut self, t: u64) -> (Box<GiveResult<'_>>, Duration) {
        let (mut owner, handle) = self.0.split();
        let mut tickets = Vec::with_capacity(WINDOW);
        let start = Clock::now();
        for t in (t..).take(WINDOW) {
            let message_id = owner.open(NOW, Timestamp::new(t), None).expect("there is room");
            for p in 1..=3 {
                let (_, admission) = owner.offer(NOW, message_id, Priority::new(p), LONG, 0);
                assert!(matches!(admission, Admission::Admitted { .. }));
            }
            tickets.push(message_id);
        }
        let took = start.elapsed();
        let give = move |message: usize, source| {
            is_forwarded(&handle.result(NOW, tickets[message], source).1)
        };
        (Box::new(give), took)
    }
}

/// Makes opens and offers on a plain machine, one call at a time as an owner would. Returns how
/// long that took.
fn fill(t: u64, mut at: impl FnMut(&mut dyn FnMut(&mut Fusion<3, WINDOW>))) -> Duration {
    let start = Clock::now();
    for t in (t..).take(WINDOW).map(Timestamp::new) {
        at(&mut |fusion| {
            let At::Ready(mut ready) = fusion.at(NOW) else { unreachable!("nothing is due") };
            assert_eq!(ready.open(t, None), Opening::Accepted);
        });
        for p in 1..=3 {
            at(&mut |fusion| {
                let At::Ready(mut ready) = fusion.at(NOW) else { unreachable!("nothing is due") };
                let admission = ready.offer(t, Priority::new(p), LONG, 0);
                assert!(matches!(admission, Admission::Admitted { .. }));
            });
        }
    }
    start.elapsed()
}

fn give(fusion: &mut Fusion<3, WINDOW>, t: u64, source: Priority) -> bool {
    let At::Ready(mut ready) = fusion.at(NOW) else { unreachable!("nothing is due") };
    is_forwarded(&ready.result(Timestamp::new(t), source))
}

fn plain(clouds: &[Cloud]) -> Fusion<3, WINDOW> {
    Fusion::new(WINDOW, Commit::Eager, clouds).expect("a valid configuration")
}

struct Locked(Box<Mutex<Fusion<3, WINDOW>>>);

impl Machine for Locked {
    const NAME: &str = "std Mutex";

    fn new(clouds: &[Cloud]) -> Self {
        Self(Box::new(Mutex::new(plain(clouds))))
    }

    fn fill(&mut self, t: u64) -> (Box<GiveResult<'_>>, Duration) {
        let machine = &*self.0;
        let took = fill(t, |then| then(&mut machine.lock().expect("nobody panicked")));
        let give = move |message, source| {
            give(&mut machine.lock().expect("nobody panicked"), t + message as u64, source)
        };
        (Box::new(give), took)
    }
}

struct ParkingLot(Box<parking_lot::Mutex<Fusion<3, WINDOW>>>);

impl Machine for ParkingLot {
    const NAME: &str = "parking_lot";

    fn new(clouds: &[Cloud]) -> Self {
        Self(Box::new(parking_lot::Mutex::new(plain(clouds))))
    }

    fn fill(&mut self, t: u64) -> (Box<GiveResult<'_>>, Duration) {
        let machine = &*self.0;
        let took = fill(t, |then| then(&mut machine.lock()));
        let give = move |message, source| give(&mut machine.lock(), t + message as u64, source);
        (Box::new(give), took)
    }
}

const fn is_forwarded(outcome: &Outcome<3>) -> bool {
    matches!(outcome, Outcome::Forwarded { .. })
}

/// The measurements of one machine with this number of threads.
#[derive(Default)]
struct Figures {
    /// The calls per second of each turn.
    rates: Vec<f64>,
    /// The time for a message's open and offers in each turn, in ns.
    fills: Vec<f64>,
    /// The time of each single call in ns, including its two readings of the clock.
    times: Vec<u64>,
}

struct Bench<M> {
    machines: Vec<M>,
    t: u64,
}

impl<M: Machine> Bench<M> {
    fn new() -> Self {
        let clouds = [1, 2, 3].map(|p| Cloud::new(Priority::new(p), 31));
        Self { machines: (0..MACHINES).map(|_| M::new(&clouds)).collect(), t: 0 }
    }

    /// Runs one turn: this many threads give all results, which are timed together or one by one.
    fn turn(&mut self, threads: usize, each_alone: bool, figures: &mut Figures) {
        let filled = self.machines.iter_mut().map(|machine| machine.fill(self.t));
        let (gives, fills): (Vec<_>, Vec<_>) = filled.unzip();
        self.t += WINDOW as u64;
        let gives = &gives;
        let waiting = &AtomicUsize::new(threads);
        let ends: Vec<_> = thread::scope(|scope| {
            let workers: Vec<_> = (0..threads)
                .map(|number| {
                    scope.spawn(move || {
                        let mut times = Vec::with_capacity(if each_alone { CALLS } else { 0 });
                        waiting.fetch_sub(1, Ordering::AcqRel);
                        while waiting.load(Ordering::Acquire) > 0 {
                            thread::yield_now();
                        }
                        let began = Clock::now();
                        let forwarded = work(gives, number, threads, each_alone, &mut times);
                        (began, Clock::now(), forwarded, times)
                    })
                })
                .collect();
            workers.into_iter().map(|worker| worker.join().expect("no panic")).collect()
        });
        let forwarded: usize = ends.iter().map(|(_, _, forwarded, _)| forwarded).sum();
        assert_eq!(forwarded, MESSAGES, "each message is forwarded once");
        let began = ends.iter().map(|end| end.0).min().expect("a thread");
        let ended = ends.iter().map(|end| end.1).max().expect("a thread");
        if each_alone {
            figures.times.extend(ends.iter().flat_map(|end| &end.3));
        } else {
            figures.rates.push(float(CALLS) / (ended - began).as_secs_f64());
        }
        let fill: Duration = fills.iter().sum();
        figures.fills.push(fill.as_secs_f64() * 1e9 / float(MESSAGES));
    }
}

/// Makes one thread's share of the calls. The calls of each message go to the threads in turn.
fn work(
    gives: &[Box<GiveResult>],
    number: usize,
    threads: usize,
    alone: bool,
    times: &mut Vec<u64>,
) -> usize {
    let mut forwarded = 0;
    for call in (number..CALLS).step_by(threads) {
        let (message, source) = (call / SOURCES, PRIORITIES[call % SOURCES]);
        let begin = alone.then(Clock::now);
        forwarded += usize::from(gives[message / WINDOW](message % WINDOW, source));
        times.extend(begin.map(|begin| nanos(begin.elapsed())));
    }
    forwarded
}

fn float(count: usize) -> f64 {
    u32::try_from(count).map_or(f64::MAX, f64::from)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn report(name: &str, threads: usize, mut figures: Figures) {
    figures.times.sort_unstable();
    let times = &figures.times;
    let at = |per_mille: usize| times[(times.len() - 1) * per_mille / 1000];
    println!(
        "{threads:>7} | {name:<11} | {:>10.2} | {:>6} | {:>8} | {:>10} | {:>12.0}",
        median(figures.rates) / 1e6,
        at(500),
        at(999),
        at(1000),
        median(figures.fills),
    );
}

fn main() {
    println!(
        "{TURNS} turns of {CALLS} results, 4 for each message, in {MACHINES} windows of {WINDOW}; medians of the"
    );
    println!("turns, percentiles of all calls; a call's time includes two readings of the clock\n");
    println!(
        "threads | machine     | M calls/s  | p50 ns | p99.9 ns | worst ns   | ns to open and offer"
    );
    for threads in [1, 2, 4] {
        let mut benches =
            (Bench::<LockFree>::new(), Bench::<Locked>::new(), Bench::<ParkingLot>::new());
        let mut figures: [Figures; 3] = Default::default();
        for turn in 0..2 * TURNS {
            let each_alone = turn % 2 == 1;
            benches.0.turn(threads, each_alone, &mut figures[0]);
            benches.1.turn(threads, each_alone, &mut figures[1]);
            benches.2.turn(threads, each_alone, &mut figures[2]);
        }
        let [shared, locked, parking_lot] = figures;
        report(LockFree::NAME, threads, shared);
        report(Locked::NAME, threads, locked);
        report(ParkingLot::NAME, threads, parking_lot);
    }
}
