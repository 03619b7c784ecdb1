//! Runs with many clouds, any priorities and many inputs.
//!
//! They reach cases that other runs seldom reach. Priorities sort differently by their digits or
//! bytes, many sources are pending, only a refusal could have changed a gate, and states are old.

use fuseline_traces::{Cloud, Commit, Header, Input};

use super::{Generator, InputGenerator};
use crate::draw::Draw;
use crate::run::Run;

/// One run in this many is long.
const LONGS: u64 = 16;
/// One step in this many checks whether a refusal changed a gate.
const PROBES: u64 = 8;
/// The starts of neighbouring priorities whose digits or bytes change.
const EDGES: [u64; 7] = [1, 6, 95, 250, 995, 9_995, 32_761];
/// The ranges of priorities of each length.
const LENGTHS: [(u64, u64); 5] = [(1, 9), (10, 99), (100, 999), (1_000, 9_999), (10_000, 65_535)];

impl Generator {
    /// Returns the wide run with this number, which is always the same.
    #[must_use]
    pub fn wide(&self, number: u64) -> Run {
        let mut draw = Draw::new(!self.seed, number);
        let header = self.wide_header(&mut draw);
        let is_long = number % LONGS == LONGS / 4;
        let steps = if is_long { draw.between(700, 1_500) } else { draw.between(10, 80) };
        let mut writer = InputGenerator { is_long, ..InputGenerator::new(&header, draw) };
        if !is_long {
            writer.start();
        }
        for _ in 0..steps {
            if writer.draw.one_in(PROBES) {
                writer.probe_gate(&header);
            } else {
                writer.step(&header);
            }
        }
        Run { inputs: writer.inputs, header }
    }

    fn wide_header(&self, draw: &mut Draw) -> Header {
        let count = draw.between(u64::from(self.clouds.min(1)), u64::from(self.clouds));
        let mut priorities = priorities(draw, count);
        draw.shuffle(&mut priorities);
        let clouds = priorities.into_iter().map(|p| {
            let limit = draw.weighed(&[(1, 1), (2, 3), (2, 7), (1, u64::MAX)]);
            let resume = if draw.one_in(2) { 0 } else { draw.between(0, limit - 1) };
            Cloud { p, name: None, limit, resume }
        });
        let clouds = clouds.collect();
        let window = draw.weighed(&[(3, 4), (3, 16), (1, 64)]);
        let commit = draw.weighed(&Commit::ALL.map(|commit| (1, commit)));
        Header { operator: None, window, commit: self.commit.unwrap_or(commit), clouds }
    }
}

/// Returns `count` different priorities: neighbours, any, or of all lengths.
fn priorities(draw: &mut Draw, count: u64) -> Vec<u16> {
    let top = u64::from(u16::MAX);
    if draw.one_in(2) {
        let greatest = top + 1 - count.max(1);
        let first = EDGES.get(draw.index(EDGES.len() + 1)).copied().unwrap_or(greatest);
        return (first..first + count).filter_map(|p| u16::try_from(p).ok()).collect();
    }
    distinct_priorities(draw, count)
}

/// Returns `count` different priorities: any, or of all lengths.
pub(crate) fn distinct_priorities(draw: &mut Draw, count: u64) -> Vec<u16> {
    let is_any = draw.one_in(2);
    let mut priorities = Vec::new();
    while (priorities.len() as u64) < count {
        let (least, most) =
            if is_any { (1, u64::from(u16::MAX)) } else { LENGTHS[draw.index(LENGTHS.len())] };
        let p = u16::try_from(draw.between(least, most)).unwrap_or(u16::MAX);
        if !priorities.contains(&p) {
            priorities.push(p);
        }
    }
    priorities
}

impl InputGenerator {
    /// Checks that an offer that is refused for another reason does not change a gate, which comes
    /// last (F2).
    ///
    /// The first offer, which would shut or open the gate, is refused for another reason. The next
    /// one shows the gate's state.
    fn probe_gate(&mut self, header: &Header) {
        let index = self.draw.index(header.clouds.len());
        let Some(cloud) = header.clouds.get(index) else { return };
        let (p, limit) = (u64::from(cloud.p), cloud.limit);
        let (at, t) = (self.context.now(), self.next_t);
        self.open(at, t, None);
        let is_shut = self.draw.one_in(2);
        if is_shut {
            self.push(Input::Offer { at, t, p, deadline: 50, backlog: limit });
        }
        let other = match self.draw.between(0, 2) {
            0 => self.next_t.saturating_add(5),
            1 => self.tried_before(),
            _ => t,
        };
        let backlog = if is_shut { 0 } else { limit };
        self.push(Input::Offer { at, t: other, p, deadline: 0, backlog });
        self.push(Input::Offer { at, t, p, deadline: 50, backlog: limit - 1 });
    }
}
