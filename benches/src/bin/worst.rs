//! Applies inputs that were chosen to be expensive, with one function for each kind, under tools
//! that count instructions and stack.
//!
//! `benches/worst-case` runs it. The argument `inputs` runs the whole sequence. `stack` runs it on
//! a thread of its own, with the machines on the heap. `idle` runs a thread that does nothing,
//! whose figures are subtracted.

use std::hint::black_box;

use fuseline_core::{At, Cloud, Commit, Deadline, Fusion, Instant, Priority, Ready, Timestamp};
use fuseline_testkit::Rng;

type SmallFusion = Fusion<3, 16>;

/// The number of rounds, which is enough for timestamps to take every place many times.
const ROUNDS: u64 = 4_000;

/// Returns the ready machine. Nothing is due at the given instants, so only the input is counted.
fn ready(machine: &mut SmallFusion, now: u64) -> Option<Ready<'_, 3, 16>> {
    match machine.at(Instant::from_nanos(now)) {
        At::Ready(ready) => Some(ready),
        At::Fired(_) => None,
    }
}

#[inline(never)]
fn worst_open(machine: &mut SmallFusion, now: u64, t: u64, deadline: Option<Deadline>) {
    if let Some(mut ready) = ready(machine, now) {
        let _ = black_box(ready.open(Timestamp::new(t), deadline));
    }
}

#[inline(never)]
fn worst_offer(machine: &mut SmallFusion, now: u64, t: u64, p: u16, deadline: u64) {
    if let Some(mut ready) = ready(machine, now) {
        let deadline = Deadline::from_nanos(deadline);
        let _ = black_box(ready.offer(Timestamp::new(t), Priority::new(p), deadline, 0));
    }
}

#[inline(never)]
fn worst_result(machine: &mut SmallFusion, now: u64, t: u64, p: u16) {
    if let Some(mut ready) = ready(machine, now) {
        let _ = black_box(ready.result(Timestamp::new(t), Priority::new(p)));
    }
}

#[inline(never)]
fn worst_fail(machine: &mut SmallFusion, now: u64, t: u64, p: u16) {
    if let Some(mut ready) = ready(machine, now) {
        let _ = black_box(ready.fail(Timestamp::new(t), Priority::new(p)));
    }
}

#[inline(never)]
fn worst_firing(machine: &mut SmallFusion, now: u64) -> bool {
    matches!(black_box(machine.at(Instant::from_nanos(now))), At::Fired(_))
}

/// Marks the end of an input for a tool that dumps its counters at the start of functions.
#[inline(never)]
fn input_done() {
    black_box(());
}

/// Returns a machine for each commit rule, on the heap, so that the thread's stack contains no
/// machine.
fn machines() -> [Box<SmallFusion>; 2] {
    let clouds = [3, 1, 2].map(|p| Cloud::new(Priority::new(p), 31));
    [Commit::Eager, Commit::Patient].map(|commit| {
        Box::new(SmallFusion::new(16, commit, &clouds).expect("a valid configuration"))
    })
}

fn inputs(machines: &mut [Box<SmallFusion>; 2]) {
    for machine in machines {
        let mut random = Rng::with_seed(1);
        let (mut now, mut newest) = (0, 0);
        for _ in 0..ROUNDS {
            // The window is kept nearly full and touched at random places, and due instants
            // sometimes coincide.
            if machine.len() < 16 - random.usize(0..3) {
                newest += random.u64(1..6);
                let deadline = random.bool().then(|| Deadline::from_nanos(random.u64(1..41)));
                worst_open(machine, now, newest, deadline);
                input_done();
            }
            let nth = random.usize(0..16) % machine.len().max(1);
            let t = machine.open().nth(nth).map_or(newest, |open| open.0.as_u64());
            let p = random.u8(0..4).into();
            match random.u8(0..4) {
                0 | 1 => worst_offer(machine, now, t, p, random.u64(1..61)),
                2 => worst_result(machine, now, t, p),
                _ => worst_fail(machine, now, t, p),
            }
            input_done();
            if random.one_in(4) {
                now += random.u64(0..10);
                while machine.next_due().is_some_and(|due| due.as_nanos() <= now) {
                    worst_firing(machine, now);
                    input_done();
                }
            }
        }
    }
}

/// Runs deeper in the stack than a thread's start and end ever are, so that `run` determines the
/// greatest depth.
#[inline(never)]
fn below_all_else(run: impl FnOnce()) {
    let above = black_box([0_u8; 1 << 14]);
    run();
    black_box(above);
}

fn main() {
    let mode = std::env::args().nth(1).unwrap_or_default();
    match mode.as_str() {
        "inputs" => inputs(&mut machines()),
        "stack" | "idle" => {
            let busy = mode == "stack";
            let mut machines = machines();
            let thread = std::thread::spawn(move || {
                below_all_else(|| {
                    if busy {
                        inputs(&mut machines);
                    }
                });
            });
            assert!(thread.join().is_ok());
        }
        _ => {
            let (machine, great) = (size_of::<SmallFusion>(), size_of::<Fusion<15, 1024>>());
            println!("Fusion<3, 16>: {machine} bytes");
            println!("Fusion<15, 1024>: {great} bytes");
        }
    }
}
