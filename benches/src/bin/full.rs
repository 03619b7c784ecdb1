//! Runs full windows of 16 and of 1024, one pass for each kind of input and load, under a tool that
//! counts instructions.
//!
//! `benches/worst-case` runs it. It prints a line for each pass: the window, the number of inputs,
//! and the kind.

use std::hint::black_box;

use fuseline_benches::window::{BenchKind, INPUTS, Load, Spacing, flat};

fn pass<const WINDOW: usize>() {
    for (name, kind) in BenchKind::ALL {
        for spacing in [Spacing::Random, Spacing::OldestFirst] {
            black_box(flat::<WINDOW>(&Load::new(WINDOW, spacing), kind));
            println!("{WINDOW} {INPUTS} {name}");
        }
    }
}

fn main() {
    pass::<16>();
    pass::<1024>();
}
