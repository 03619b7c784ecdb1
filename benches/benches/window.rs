//! Time per input, by kind of input, in full windows of 4 to 1024 (P9): dense, strided and random timestamps,
//! touched in random order.
//!
//! Each sample sets up as many machines as give 1024 open timestamps and times one input for each of them, so that
//! small and great windows work on as much memory.

use std::hint::black_box;
use std::time::{Duration, Instant as Clock};

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use fuseline_core::{
    Admission, At, Cloud, Commit, Deadline, Fusion, Instant, Opening, Outcome, Priority, Ready,
    Source, Timestamp,
};

/// How many inputs one sample times.
const INPUTS: usize = 1024;
const NEAR: Priority = Priority::new(1);
const FAR: Priority = Priority::new(2);

type Machine<const WINDOW: usize> = Fusion<3, WINDOW>;

/// Steele and Vigna's `SplitMix64`.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, usize::try_from(self.next() % (i as u64 + 1)).unwrap_or_default());
        }
    }
}

/// What is timed, and what the open timestamps have seen before.
#[derive(Clone, Copy)]
enum Kind {
    Open,
    Offer,
    ResultHeld,
    ResultForwarded,
    ResultSuperseded,
    FailWaiting,
    FailMissed,
    ExpireWaiting,
    ExpireForwarded,
}

impl Kind {
    const ALL: [(&str, Self); 9] = [
        ("open", Self::Open),
        ("offer", Self::Offer),
        ("result_held", Self::ResultHeld),
        ("result_forwarded", Self::ResultForwarded),
        ("result_superseded", Self::ResultSuperseded),
        ("fail_waiting", Self::FailWaiting),
        ("fail_missed", Self::FailMissed),
        ("expire_waiting", Self::ExpireWaiting),
        ("expire_forwarded", Self::ExpireForwarded),
    ];
}

fn ready<const WINDOW: usize>(machine: &mut Machine<WINDOW>, at: u64) -> Ready<'_, 3, WINDOW> {
    match machine.at(Instant::from_nanos(at)) {
        At::Ready(ready) => ready,
        At::Fired(firing) => unreachable!("{firing:?}"),
    }
}

/// Timestamps of full windows, and the order in which they are touched, each with a due of its own.
struct Load {
    timestamps: Vec<(usize, Timestamp)>,
    touched: Vec<(usize, Timestamp, Deadline)>,
}

impl Load {
    fn new(window: usize, pattern: &str) -> Self {
        let mut random = SplitMix(window as u64);
        let mut timestamps = Vec::new();
        for machine in 0..INPUTS / window {
            let mut t = 1;
            for _ in 0..window {
                timestamps.push((machine, Timestamp::new(t)));
                t += match pattern {
                    "dense" => 1,
                    "strided" => 64,
                    _ => 1 + random.next() % 1_000_000,
                };
            }
        }
        let mut touched: Vec<_> = timestamps
            .iter()
            .map(|(machine, t)| {
                (*machine, *t, Deadline::from_nanos(1_000 + random.next() % 1_000_000))
            })
            .collect();
        random.shuffle(&mut touched);
        Self { timestamps, touched }
    }

    /// Machines with all timestamps open, as far as the kind needs it.
    fn machines<const WINDOW: usize>(&self, kind: Kind) -> Vec<Machine<WINDOW>> {
        let clouds = [1, 2, 3].map(|p| Cloud::new(Priority::new(p), 31));
        let machine =
            || Fusion::new(WINDOW, Commit::Eager, &clouds).expect("a valid configuration");
        let mut machines: Vec<Machine<WINDOW>> = (0..INPUTS / WINDOW).map(|_| machine()).collect();
        if matches!(kind, Kind::Open) {
            return machines;
        }
        let limited = matches!(kind, Kind::ExpireWaiting);
        for (i, t) in &self.timestamps {
            // A deadline long after every cloud's due.
            let deadline = limited.then_some(Deadline::from_nanos(1_000_000_000));
            assert_eq!(ready(&mut machines[*i], 0).open(*t, deadline), Opening::Accepted);
        }
        for (nth, (i, t, deadline)) in self.touched.iter().enumerate() {
            let mut ready = ready(&mut machines[*i], 0);
            let mut offer = |cloud| {
                let admission = ready.offer(*t, cloud, *deadline, 0);
                assert!(matches!(admission, Admission::Admitted { .. }));
            };
            match kind {
                Kind::Open | Kind::Offer | Kind::FailMissed => {}
                Kind::ResultHeld | Kind::ExpireWaiting => offer(NEAR),
                Kind::FailWaiting | Kind::ResultForwarded => {
                    offer(NEAR);
                    offer(FAR);
                }
                Kind::ResultSuperseded => {
                    if nth % 2 == 0 {
                        assert!(matches!(
                            ready.result(*t, Priority::LOCAL),
                            Outcome::Forwarded { .. }
                        ));
                    }
                }
                Kind::ExpireForwarded => {
                    offer(FAR);
                    assert_eq!(ready.result(*t, Priority::LOCAL), Outcome::Held);
                }
            }
        }
        machines
    }

    /// Times one input of the kind for every timestamp.
    fn time<const WINDOW: usize>(&self, kind: Kind) -> Duration {
        let mut machines = self.machines::<WINDOW>(kind);
        let start = Clock::now();
        match kind {
            Kind::Open => {
                for (i, t) in &self.timestamps {
                    let _ = black_box(ready(&mut machines[*i], 0).open(*t, None));
                }
            }
            Kind::ExpireWaiting | Kind::ExpireForwarded => {
                for machine in &mut machines {
                    // A tick at each due instant, as a driver would.
                    for _ in 0..WINDOW {
                        let Some(due) = machine.next_due() else { break };
                        assert!(matches!(black_box(machine.at(due)), At::Fired(_)));
                    }
                }
            }
            _ => {
                for (i, t, deadline) in &self.touched {
                    let mut ready = ready(&mut machines[*i], 0);
                    match kind {
                        Kind::Offer => {
                            let _ = black_box(ready.offer(*t, NEAR, *deadline, 0));
                        }
                        Kind::ResultHeld => {
                            let _ = black_box(ready.result(*t, Priority::LOCAL));
                        }
                        Kind::ResultForwarded | Kind::ResultSuperseded => {
                            let _ = black_box(ready.result(*t, FAR));
                        }
                        Kind::FailWaiting => {
                            let _ = black_box(ready.fail(*t, FAR));
                        }
                        _ => {
                            let _ = black_box(ready.fail(*t, Priority::LOCAL));
                        }
                    }
                }
            }
        }
        let elapsed = start.elapsed();
        black_box(&machines);
        elapsed
    }
}

fn measure<const WINDOW: usize>(group: &mut BenchmarkGroup<'_, WallTime>, kind: Kind, name: &str) {
    for pattern in ["dense", "strided", "random"] {
        let load = Load::new(WINDOW, pattern);
        group.bench_function(format!("{name}_{pattern}_window_{WINDOW}"), |b| {
            b.iter_custom(|samples| {
                let total: Duration = (0..samples).map(|_| load.time::<WINDOW>(kind)).sum();
                // Reported per input.
                Duration::from_nanos(
                    u64::try_from(total.as_nanos()).unwrap_or(u64::MAX) / INPUTS as u64,
                )
            });
        });
    }
}

fn windows(c: &mut Criterion) {
    assert_eq!(usize::from(Source::COUNT), 16);
    for (name, kind) in Kind::ALL {
        let mut group = c.benchmark_group("window");
        group.sample_size(20);
        group.warm_up_time(Duration::from_millis(100));
        group.measurement_time(Duration::from_millis(400));
        measure::<4>(&mut group, kind, name);
        measure::<16>(&mut group, kind, name);
        measure::<64>(&mut group, kind, name);
        measure::<256>(&mut group, kind, name);
        measure::<1024>(&mut group, kind, name);
        group.finish();
    }
}

criterion_group!(benches, windows);
criterion_main!(benches);
