//! Measures the memory of the process, and how late the host's timers and processors are. Checks
//! must allow for this lateness.

use std::alloc::System;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use cap::Cap;
use tokio::runtime::Handle;
use tokio::time::{Instant, sleep_until};

/// Counts the memory that is allocated.
#[global_allocator]
static ALLOCATED: Cap<System> = Cap::new(System, usize::MAX);

/// The resources of the process at one moment.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct ResourceUsage {
    /// The memory that the system holds for the process, including memory that was freed but not
    /// returned.
    pub(crate) resident_kib: u64,
    /// The memory that is allocated and not freed.
    pub(crate) live_kib: u64,
    pub(crate) files: u64,
    pub(crate) tasks: u64,
}

impl ResourceUsage {
    pub(crate) fn now() -> std::io::Result<Self> {
        let pages = std::fs::read_to_string("/proc/self/statm")?;
        let pages: u64 = pages.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
        let page = rustix::param::page_size() as u64;
        let files = std::fs::read_dir("/proc/self/fd")?.count() as u64;
        let tasks = Handle::current().metrics().num_alive_tasks() as u64;
        let live_kib = ALLOCATED.allocated() as u64 / 1024;
        Ok(Self { resident_kib: pages * page / 1024, live_kib, files, tasks })
    }

    /// Returns the median of each field.
    pub(crate) fn median(of: &[Self]) -> Self {
        let middle = |one: fn(&Self) -> u64| {
            let mut all: Vec<u64> = of.iter().map(one).collect();
            all.sort_unstable();
            all.get(all.len() / 2).copied().unwrap_or(0)
        };
        Self {
            resident_kib: middle(|usage| usage.resident_kib),
            live_kib: middle(|usage| usage.live_kib),
            files: middle(|usage| usage.files),
            tasks: middle(|usage| usage.tasks),
        }
    }
}

/// Something that ended later than it should have.
#[derive(Clone, Copy, Debug)]
struct Overrun {
    /// The instant when it ended.
    at: Instant,
    /// The delay.
    by: Duration,
}

/// The greatest overrun of all operators in each tenth of a second.
pub(crate) struct Overruns {
    start: Instant,
    greatest: Mutex<BTreeMap<u128, Overrun>>,
}

impl Overruns {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self { start: Instant::now(), greatest: Mutex::default() })
    }

    /// Records that something ends now with this delay.
    pub(crate) fn note(&self, by: Duration) {
        let at = Instant::now();
        let mut greatest = self.greatest.lock().unwrap_or_else(PoisonError::into_inner);
        let tenth = (at - self.start).as_millis() / TENTH;
        let before = greatest.entry(tenth).or_insert(Overrun { at, by });
        if before.by < by {
            *before = Overrun { at, by };
        }
    }

    /// Returns the overruns that neither an operator's turn nor the host's lateness explains.
    pub(crate) fn beyond(&self, lateness: &Lateness) -> Vec<String> {
        let greatest = self.greatest.lock().unwrap_or_else(PoisonError::into_inner);
        let reported = greatest.values().map(|over| (over, lateness.allows(*over)));
        reported
            .filter(|(over, allowed)| over.by > TURN + *allowed)
            .map(|(over, allowed)| {
                let at = (over.at - self.start).as_secs_f64();
                format!("at {at:.1} s by {:?}, the machine by {allowed:?}", over.by)
            })
            .collect()
    }
}

/// The delay beyond the host's own lateness that is allowed: the turn of an operator's loop.
const TURN: Duration = Duration::from_millis(2);

/// The time between two looks at the timer.
const LOOK: Duration = Duration::from_millis(5);
/// The time between two looks at the threads, in milliseconds.
const TENTH: u128 = 100;

/// The host's delays in a tenth of a second.
#[derive(Clone, Copy, Debug, Default)]
struct HostStall {
    /// The delay of the timer.
    timer: Duration,
    /// The longest time that one of the process's threads was ready and had no processor.
    thread: Duration,
}

/// Delays for which no operator is to blame: the lateness of a timer in the same runtime, and the
/// waits of threads, as Linux reports them.
pub(crate) struct Lateness {
    start: Instant,
    tenths: Mutex<Vec<HostStall>>,
}

impl Lateness {
    pub(crate) fn start() -> Arc<Self> {
        let lateness = Arc::new(Self { start: Instant::now(), tenths: Mutex::default() });
        let measured = Arc::clone(&lateness);
        tokio::spawn(async move {
            let (mut looked, mut waited) = (Instant::now(), waits());
            loop {
                let due = Instant::now() + LOOK;
                sleep_until(due).await;
                let now = Instant::now();
                measured.note(due, now, |held| held.timer = held.timer.max(now - due));
                if (now - looked).as_millis() >= TENTH {
                    let waits = waits();
                    let thread = longest(&waited, &waits);
                    measured.note(looked, now, |held| held.thread = held.thread.max(thread));
                    (looked, waited) = (now, waits);
                }
            }
        });
        lateness
    }

    /// Returns the allowed delay of something that was due and ended at about these instants: twice
    /// the timer's lateness, and the time that a thread waited for a processor.
    fn allows(&self, Overrun { at, by }: Overrun) -> Duration {
        let tenths = self.tenths.lock().unwrap_or_else(PoisonError::into_inner);
        let last = self.tenth(at) + 3;
        let first = self.tenth(at.checked_sub(by).unwrap_or(self.start)).saturating_sub(2);
        let about = tenths.iter().take(last).skip(first);
        let timer = about.clone().map(|held| held.timer).max().unwrap_or_default();
        timer * 2 + about.map(|held| held.thread).sum::<Duration>()
    }

    /// Returns the greatest lateness of the timer.
    pub(crate) fn greatest(&self) -> Duration {
        let tenths = self.tenths.lock().unwrap_or_else(PoisonError::into_inner);
        tenths.iter().map(|held| held.timer).max().unwrap_or_default()
    }

    fn note(&self, from: Instant, to: Instant, note: impl Fn(&mut HostStall)) {
        let mut tenths = self.tenths.lock().unwrap_or_else(PoisonError::into_inner);
        let (first, last) = (self.tenth(from), self.tenth(to));
        if tenths.len() <= last {
            tenths.resize(last + 1, HostStall::default());
        }
        tenths[first..=last].iter_mut().for_each(note);
    }

    fn tenth(&self, at: Instant) -> usize {
        usize::try_from((at - self.start).as_millis() / TENTH).unwrap_or(0)
    }
}

/// Returns how long each thread has been ready without a processor since it began. The map is empty
/// if Linux does not count this.
fn waits() -> BTreeMap<std::ffi::OsString, Duration> {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let waits = threads.filter_map(|thread| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        let waited = text.split_whitespace().nth(1)?.parse().ok()?;
        Some((thread.file_name(), Duration::from_nanos(waited)))
    });
    waits.collect()
}

/// Returns the longest wait of one thread between two looks.
fn longest<K: Ord>(before: &BTreeMap<K, Duration>, now: &BTreeMap<K, Duration>) -> Duration {
    let waited = now.iter().map(|(thread, waited)| {
        waited.saturating_sub(before.get(thread).copied().unwrap_or_default())
    });
    waited.max().unwrap_or_default()
}
