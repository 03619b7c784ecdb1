//! Full windows of 4 to 1024 timestamps, touched in random order or the oldest first.

use std::hint::black_box;
use std::time::{Duration, Instant as Clock};

use fuseline_core::{
    Admission, At, Cloud, Commit, Deadline, Fusion, Instant, Opening, Outcome, Priority, Ready,
    Timestamp,
};
use fuseline_testkit::Rng;

/// The number of inputs that one pass times. A pass uses as many machines as together hold this
/// many open timestamps, so small and large windows work on the same amount of memory.
pub const INPUTS: usize = 1024;

/// The timed inputs, and the earlier inputs of the open timestamps.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "an input and what comes of it")]
pub enum BenchKind {
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

impl BenchKind {
    /// Each by its name.
    pub const ALL: [(&str, Self); 9] = [
        ("open", Self::Open),
        ("offer", Self::Offer),
        ("result, held", Self::ResultHeld),
        ("result, forwarded", Self::ResultForwarded),
        ("result, superseded", Self::ResultSuperseded),
        ("fail, waiting", Self::FailWaiting),
        ("fail, missed", Self::FailMissed),
        ("expire, waiting", Self::ExpireWaiting),
        ("expire, forwarded", Self::ExpireForwarded),
    ];
}

/// The distances between open timestamps.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "their names say it")]
pub enum Spacing {
    Dense,
    Strided,
    Random,
    OldestFirst,
}

impl Spacing {
    /// Dense ones are touched in random order as well as the oldest first: then all others move
    /// when one is retired.
    pub const ALL: [Self; 4] = [Self::Dense, Self::Strided, Self::Random, Self::OldestFirst];
}

/// Timestamps of full windows, and the order in which they are touched, each with a due instant of
/// its own.
#[derive(Debug)]
pub struct Load {
    timestamps: Vec<(usize, u64)>,
    touched: Vec<(usize, u64, u64)>,
}

impl Load {
    /// Makes a load for windows of this many timestamps.
    #[must_use]
    pub fn new(window: usize, spacing: Spacing) -> Self {
        let mut random = Rng::with_seed(window as u64);
        let mut timestamps = Vec::new();
        for machine in 0..INPUTS / window {
            let mut t = 1;
            for _ in 0..window {
                timestamps.push((machine, t));
                t += match spacing {
                    Spacing::Dense | Spacing::OldestFirst => 1,
                    Spacing::Strided => 64,
                    Spacing::Random => random.u64(1..1_000_001),
                };
            }
        }
        let mut touched: Vec<_> = timestamps
            .iter()
            .map(|(machine, t)| (*machine, *t, random.u64(1_000..1_001_000)))
            .collect();
        if matches!(spacing, Spacing::OldestFirst) {
            for ((_, _, deadline), nanos) in touched.iter_mut().zip(1_000..) {
                *deadline = nanos;
            }
        } else {
            random.shuffle(&mut touched);
        }
        Self { timestamps, touched }
    }
}

const NEAR: Priority = Priority::new(1);
const FAR: Priority = Priority::new(2);
type SizedFusion<const WINDOW: usize> = Fusion<3, WINDOW>;

fn ready<const WINDOW: usize>(machine: &mut SizedFusion<WINDOW>) -> Ready<'_, 3, WINDOW> {
    match machine.at(Instant::START) {
        At::Ready(ready) => ready,
        At::Fired(firing) => unreachable!("{firing:?}"),
    }
}

/// Creates machines in which all timestamps are open, as far as the kind of input needs that.
fn machines<const WINDOW: usize>(load: &Load, kind: BenchKind) -> Vec<SizedFusion<WINDOW>> {
    let clouds = [1, 2, 3].map(|p| Cloud::new(Priority::new(p), 31));
    let machine = || Fusion::new(WINDOW, Commit::Eager, &clouds).expect("a valid configuration");
    let mut machines: Vec<SizedFusion<WINDOW>> = (0..INPUTS / WINDOW).map(|_| machine()).collect();
    if matches!(kind, BenchKind::Open) {
        return machines;
    }
    let limited = matches!(kind, BenchKind::ExpireWaiting);
    for (i, t) in &load.timestamps {
        // The deadline is long after every cloud's due instant.
        let deadline = limited.then_some(Deadline::from_nanos(1_000_000_000));
        let opening = ready(&mut machines[*i]).open(Timestamp::new(*t), deadline);
        assert_eq!(opening, Opening::Accepted);
    }
    for (nth, (i, t, deadline)) in load.touched.iter().enumerate() {
        let t = Timestamp::new(*t);
        let mut ready = ready(&mut machines[*i]);
        let mut offer = |cloud| {
            let admission = ready.offer(t, cloud, Deadline::from_nanos(*deadline), 0);
            assert!(matches!(admission, Admission::Admitted { .. }));
        };
        match kind {
            BenchKind::Open | BenchKind::Offer | BenchKind::FailMissed => {}
            BenchKind::ResultHeld | BenchKind::ExpireWaiting => offer(NEAR),
            BenchKind::FailWaiting | BenchKind::ResultForwarded => {
                offer(NEAR);
                offer(FAR);
            }
            BenchKind::ResultSuperseded => {
                if nth % 2 == 0 {
                    let outcome = ready.result(t, Priority::LOCAL);
                    assert!(matches!(outcome, Outcome::Forwarded { .. }));
                }
            }
            BenchKind::ExpireForwarded => {
                offer(FAR);
                assert_eq!(ready.result(t, Priority::LOCAL), Outcome::Held);
            }
        }
    }
    machines
}

/// Times one input of the kind for every timestamp of the load.
///
/// # Panics
/// If the machine does not decide as the kind says.
#[must_use]
pub fn flat<const WINDOW: usize>(load: &Load, kind: BenchKind) -> Duration {
    let mut machines = machines::<WINDOW>(load, kind);
    let start = Clock::now();
    touch(&mut machines, load, kind);
    let elapsed = start.elapsed();
    touch_done();
    black_box(&machines);
    elapsed
}

/// Applies one input of the kind for every timestamp. It is not inlined, so that tools can count
/// its instructions.
#[inline(never)]
fn touch<const WINDOW: usize>(machines: &mut [SizedFusion<WINDOW>], load: &Load, kind: BenchKind) {
    match kind {
        BenchKind::Open => {
            for (i, t) in &load.timestamps {
                let _ = black_box(ready(&mut machines[*i]).open(Timestamp::new(*t), None));
            }
        }
        BenchKind::ExpireWaiting | BenchKind::ExpireForwarded => {
            for machine in machines {
                // This ticks at each due instant, as a driver would.
                for _ in 0..WINDOW {
                    let Some(due) = machine.next_due() else { break };
                    assert!(matches!(black_box(machine.at(due)), At::Fired(_)));
                }
            }
        }
        _ => {
            for (i, t, deadline) in &load.touched {
                let t = Timestamp::new(*t);
                let mut ready = ready(&mut machines[*i]);
                match kind {
                    BenchKind::Offer => {
                        let deadline = Deadline::from_nanos(*deadline);
                        let _ = black_box(ready.offer(t, NEAR, deadline, 0));
                    }
                    BenchKind::ResultHeld => {
                        let _ = black_box(ready.result(t, Priority::LOCAL));
                    }
                    BenchKind::ResultForwarded | BenchKind::ResultSuperseded => {
                        let _ = black_box(ready.result(t, FAR));
                    }
                    BenchKind::FailWaiting => {
                        let _ = black_box(ready.fail(t, FAR));
                    }
                    _ => {
                        let _ = black_box(ready.fail(t, Priority::LOCAL));
                    }
                }
            }
        }
    }
}

/// Marks the end of the counted part.
#[inline(never)]
fn touch_done() {
    black_box(());
}
