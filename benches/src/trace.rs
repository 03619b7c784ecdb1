//! Generates a trace of a camera's run for benches that read and judge.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use fuseline_testkit::Rng;
use fuseline_traces::{Cloud, Commit, ExpectedDecisions, Header, Input, Reference};

/// The relative deadline of each request.
const DEADLINE: u64 = 500_000_000;
/// The time from one message to the next.
const PERIOD: u64 = 100_000_000;
/// The sources' usual response times. A cloud's tail reaches beyond its deadline.
const USUAL: [u64; 4] = [301_700_000, 90_000_000, 180_000_000, 240_000_000];

/// Returns a camera's run at 10 Hz with three clouds, as JSON Lines of at least this many lines,
/// and how many it has.
#[must_use]
pub fn trace(least: usize) -> (Vec<u8>, u64) {
    let cloud = |p| Cloud { p, name: None, limit: 31, resume: 0 };
    let header = Header {
        operator: Some("bench".into()),
        window: 16,
        commit: Commit::Eager,
        clouds: vec![cloud(1), cloud(2), cloud(3)],
    };
    let mut run = Run::new(&header);
    for t in 0.. {
        let at = t * PERIOD;
        run.until(at);
        run.take(&Input::Open { at, t, deadline: None });
        for p in 1..=3 {
            run.take(&Input::Offer { at, t, p, deadline: DEADLINE, backlog: 0 });
        }
        for (p, usual) in (0..).zip(USUAL) {
            // One arrival in sixteen takes four times as long.
            let noise = run.random.u64(0..usual);
            let delay = if run.random.one_in(16) { 4 * usual } else { usual / 2 + noise };
            run.arrivals.push(Reverse((at + delay, t, p)));
        }
        if run.lines >= least {
            break;
        }
    }
    run.until(u64::MAX);
    (run.out, run.lines as u64)
}

/// A run that is being generated. The reference machine's decisions are written as it goes.
struct Run {
    reference: Reference,
    demands: ExpectedDecisions,
    arrivals: BinaryHeap<Reverse<(u64, u64, u64)>>,
    random: Rng,
    out: Vec<u8>,
    lines: usize,
}

impl Run {
    fn new(header: &Header) -> Self {
        let mut out = Vec::new();
        header.write(&mut out);
        out.push(b'\n');
        let reference = Reference::new(header);
        let (demands, arrivals) = (ExpectedDecisions::new(), BinaryHeap::new());
        Self { reference, demands, arrivals, random: Rng::with_seed(1), out, lines: 1 }
    }

    /// Plays the arrivals and the timers that come before `at`.
    fn until(&mut self, at: u64) {
        loop {
            let arrival = self.arrivals.peek().map(|Reverse(arrival)| *arrival);
            let due = self.reference.next_due().filter(|due| *due < at);
            match (arrival.filter(|arrival| arrival.0 < at), due) {
                (Some((arrives, t, p)), due) if due.is_none_or(|due| arrives < due) => {
                    self.arrivals.pop();
                    self.take(&Input::Result { at: arrives, t, p });
                }
                (_, Some(due)) => self.take(&Input::Tick { at: due }),
                (_, None) => return,
            }
        }
    }

    fn take(&mut self, input: &Input) {
        self.reference.apply(input, &mut self.demands);
        input.write(&mut self.out);
        self.out.push(b'\n');
        self.lines += 1 + self.demands.len();
        for (decision, _) in self.demands.drain(..) {
            decision.write(&mut self.out);
            self.out.push(b'\n');
        }
    }
}
