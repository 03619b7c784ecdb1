//! Time per input, by kind of input, in full windows of 4 to 1024 (P9), beside the same core about a balanced tree,
//! their passes in turns: the worst of dense, strided and random timestamps, touched in random order.

use fuseline_benches::beside::{in_turns, passes};
use fuseline_benches::window::{INPUTS, Kind, Load, Spacing, flat, tree};

/// ns an input, and its ratio to the tree's by the median and by the best; each the worst of the three spacings.
fn measure<const WINDOW: usize>(kind: Kind) -> [f64; 3] {
    let mut worst = [0.0_f64; 3];
    for spacing in [Spacing::Dense, Spacing::Strided, Spacing::Random] {
        let load = Load::new(WINDOW, spacing);
        let [flat, tree] = in_turns(
            passes(150),
            [&mut || flat::<WINDOW>(&load, kind), &mut || tree::<WINDOW>(&load, kind)],
        )
        .map(|times| times.an_input(INPUTS));
        let of_this = [flat.0, flat.0 / tree.0, flat.1 / tree.1];
        worst = std::array::from_fn(|i| worst[i].max(of_this[i]));
    }
    worst
}

fn main() {
    println!("ns an input (median), and its ratio to that about a tree (median, best)");
    println!("{:20}{:>18}{:>18}{:>18}{:>18}{:>18}", "window", 4, 16, 64, 256, 1024);
    for (name, kind) in Kind::ALL {
        print!("{name:20}");
        for [ns, median, best] in [
            measure::<4>(kind),
            measure::<16>(kind),
            measure::<64>(kind),
            measure::<256>(kind),
            measure::<1024>(kind),
        ] {
            print!("{ns:8.1}{median:5.2}{best:5.2}");
        }
        println!();
    }
}
