//! Inputs chosen to be expensive, one function a kind, for tools that count instructions and stack from outside.
//!
//! `benches/worst-case` runs it. Argument `inputs`: the whole sequence; `stack`: the same on a thread of its own;
//! `idle`: a thread that does nothing, to subtract.

use std::hint::black_box;

use fuseline_core::{At, Cloud, Commit, Deadline, Fusion, Instant, Priority, Ready, Timestamp};

type Machine = Fusion<3, 16>;

/// Enough for timestamps to take all seats many times over.
const ROUNDS: u64 = 4_000;

/// Steele and Vigna's `SplitMix64`.
struct SplitMix(u64);

impl SplitMix {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % bound
    }
}

/// The input alone: nothing is due at the instants given.
fn ready(machine: &mut Machine, now: u64) -> Option<Ready<'_, 3, 16>> {
    match machine.at(Instant::from_nanos(now)) {
        At::Ready(ready) => Some(ready),
        At::Fired(_) => None,
    }
}

#[inline(never)]
fn worst_open(machine: &mut Machine, now: u64, t: u64, deadline: Option<Deadline>) {
    if let Some(mut ready) = ready(machine, now) {
        let _ = black_box(ready.open(Timestamp::new(t), deadline));
    }
}

#[inline(never)]
fn worst_offer(machine: &mut Machine, now: u64, t: u64, p: u16, deadline: u64) {
    if let Some(mut ready) = ready(machine, now) {
        let deadline = Deadline::from_nanos(deadline);
        let _ = black_box(ready.offer(Timestamp::new(t), Priority::new(p), deadline, 0));
    }
}

#[inline(never)]
fn worst_result(machine: &mut Machine, now: u64, t: u64, p: u16) {
    if let Some(mut ready) = ready(machine, now) {
        let _ = black_box(ready.result(Timestamp::new(t), Priority::new(p)));
    }
}

#[inline(never)]
fn worst_fail(machine: &mut Machine, now: u64, t: u64, p: u16) {
    if let Some(mut ready) = ready(machine, now) {
        let _ = black_box(ready.fail(Timestamp::new(t), Priority::new(p)));
    }
}

#[inline(never)]
fn worst_firing(machine: &mut Machine, now: u64) -> bool {
    matches!(black_box(machine.at(Instant::from_nanos(now))), At::Fired(_))
}

/// Marks the end of an input for a tool that dumps its counters at the start of functions.
#[inline(never)]
fn input_done() {
    black_box(());
}

fn inputs() {
    let clouds = [3, 1, 2].map(|p| Cloud::new(Priority::new(p), 31));
    for commit in [Commit::Eager, Commit::Patient] {
        let mut machine = Machine::new(16, commit, &clouds).expect("a valid configuration");
        let mut random = SplitMix(1);
        let (mut now, mut newest) = (0, 0);
        for _ in 0..ROUNDS {
            // Kept nearly full, touched anywhere, with dues that now and then coincide.
            if machine.len() < 16 - usize::try_from(random.below(3)).unwrap_or_default() {
                newest += 1 + random.below(5);
                let deadline =
                    (random.below(2) == 0).then(|| Deadline::from_nanos(1 + random.below(40)));
                worst_open(&mut machine, now, newest, deadline);
                input_done();
            }
            let nth = usize::try_from(random.below(16)).unwrap_or_default() % machine.len().max(1);
            let t = machine.open().nth(nth).map_or(newest, |open| open.0.as_u64());
            let p = u16::try_from(random.below(4)).unwrap_or_default();
            match random.below(4) {
                0 | 1 => worst_offer(&mut machine, now, t, p, 1 + random.below(60)),
                2 => worst_result(&mut machine, now, t, p),
                _ => worst_fail(&mut machine, now, t, p),
            }
            input_done();
            if random.below(4) == 0 {
                now += random.below(10);
                while machine.next_due().is_some_and(|due| due.as_nanos() <= now) {
                    worst_firing(&mut machine, now);
                    input_done();
                }
            }
        }
        println!("{commit:?}: {} open at the end, {} ns", machine.len(), now);
    }
}

fn main() {
    let mode = std::env::args().nth(1).unwrap_or_default();
    match mode.as_str() {
        "inputs" => inputs(),
        "stack" | "idle" => {
            let busy = mode == "stack";
            let thread = std::thread::spawn(move || if busy { inputs() } else { println!("idle") });
            assert!(thread.join().is_ok());
        }
        _ => {
            let (machine, great) = (size_of::<Machine>(), size_of::<Fusion<15, 1024>>());
            println!("Fusion<3, 16>: {machine} bytes");
            println!("Fusion<15, 1024>: {great} bytes");
        }
    }
}
