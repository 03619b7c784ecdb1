//! Times several contestants in one binary, with their passes in turns, so that memory placement
//! and a busy host affect all of them equally.

use std::time::Duration;

/// Returns how many passes `cargo bench` makes; a test run makes one.
#[must_use]
pub fn passes(of_bench: usize) -> usize {
    if std::env::args().any(|argument| argument == "--bench") { of_bench } else { 1 }
}

/// The middle one of the passes' times, and the least.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// The middle one.
    pub median: Duration,
    /// The least.
    pub best: Duration,
}

impl Times {
    /// Both in nanoseconds an input.
    #[expect(clippy::cast_precision_loss, reason = "shown with few digits")]
    #[must_use]
    pub fn an_input(self, inputs: usize) -> (f64, f64) {
        let of = |time: Duration| time.as_nanos() as f64 / inputs as f64;
        (of(self.median), of(self.best))
    }
}

/// Lets each take a pass, then each the next. A pass says how long it took.
#[must_use]
pub fn in_turns<const N: usize>(
    passes: usize,
    mut of: [&mut dyn FnMut() -> Duration; N],
) -> [Times; N] {
    let mut times = [const { Vec::new() }; N];
    for _ in 0..passes.max(1) {
        for (pass, times) in of.iter_mut().zip(&mut times) {
            times.push(pass());
        }
    }
    times.map(|mut times| {
        times.sort_unstable();
        Times { median: times[times.len() / 2], best: times[0] }
    })
}
