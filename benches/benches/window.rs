//! Measures the time per input in full windows of 4 to 1024 (P9), by kind of input. It is the worst
//! of four loads: dense, strided and random timestamps in random order, and dense timestamps with
//! the oldest first.

use fuseline_benches::beside::{in_turns, passes};
use fuseline_benches::window::{BenchKind, INPUTS, Load, Spacing, flat};

/// Returns the ns per input of the median and of the best pass, each for the worst of the four
/// loads.
fn measure<const WINDOW: usize>(kind: BenchKind) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    for spacing in Spacing::ALL {
        let load = Load::new(WINDOW, spacing);
        let [times] = in_turns(passes(150), [&mut || flat::<WINDOW>(&load, kind)]);
        let (median, best) = times.an_input(INPUTS);
        let of_this = [median, best];
        worst = std::array::from_fn(|i| worst[i].max(of_this[i]));
    }
    worst
}

fn main() {
    println!("ns an input: median, best");
    println!("{:20}{:>18}{:>18}{:>18}{:>18}{:>18}", "window", 4, 16, 64, 256, 1024);
    for (name, kind) in BenchKind::ALL {
        print!("{name:20}");
        for [median, best] in [
            measure::<4>(kind),
            measure::<16>(kind),
            measure::<64>(kind),
            measure::<256>(kind),
            measure::<1024>(kind),
        ] {
            print!("{median:10.1}{best:8.1}");
        }
        println!();
    }
}
