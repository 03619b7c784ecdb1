//! Headers in families, to find an implementation that keeps state by header or mistakes one header
//! for another.

use fuseline_traces::{Cloud, Commit, Header};

use super::{FAMILY, RunKind, SALT, VariedGenerator};
use crate::draw::Draw;
use crate::generate::wide::distinct_priorities;

/// The greatest window.
const GREATEST: u64 = 1024;
/// The starts of neighbouring priorities whose digits or bytes change.
const EDGES: [u64; 8] = [1, 6, 95, 122, 250, 995, 9_995, 32_761];
/// The distances between priorities.
const STRIDES: [u64; 6] = [10, 16, 100, 256, 1_000, 4_096];

impl VariedGenerator {
    /// Returns a header of a family. The first two are equal, the third differs in one thing, and
    /// the fourth is like the first or differs in another thing.
    pub(super) fn header(&self, number: u64) -> Header {
        let (family, place) = (number / FAMILY, number % FAMILY);
        let mut header = self.first(family);
        let mut draw = Draw::new(!(self.seed ^ SALT), number);
        if place == 2 || place == 3 && draw.one_in(2) {
            self.change(&mut header, &mut draw);
        }
        header
    }

    fn first(&self, family: u64) -> Header {
        let mut draw = Draw::new((self.seed ^ SALT).rotate_left(32), family);
        let kind = RunKind::of_family(family);
        let commit = draw.weighed(&Commit::ALL.map(|commit| (1, commit)));
        let commit = self.commit.unwrap_or(commit);
        let window = window(&mut draw, kind);
        let most = draw.weighed(&[(1, 0), (2, 2), (4, 5), (2, 9), (3, 15)]);
        let most = if kind == RunKind::Mixed { most } else { most.max(2) };
        let most = most.min(u64::from(self.clouds));
        let count = draw.between(most.min(1).max(most * 2 / 3), most);
        let mut priorities = priorities(&mut draw, count);
        draw.shuffle(&mut priorities);
        let clouds = priorities.into_iter().map(|p| cloud(&mut draw, p)).collect();
        Header { operator: None, window, commit, clouds }
    }

    /// Changes one thing.
    fn change(&self, header: &mut Header, draw: &mut Draw) {
        let index = draw.index(header.clouds.len());
        match draw.between(0, 6) {
            0..2 if self.commit.is_none() => {
                let others = Commit::ALL.into_iter().filter(|commit| *commit != header.commit);
                let others: Vec<_> = others.collect();
                header.commit = others[draw.index(others.len())];
            }
            2 if header.clouds.len() > 1 => header.clouds.rotate_left(1),
            3 if header.clouds.len() > 1 => {
                header.clouds.remove(index);
            }
            4 if !header.clouds.is_empty() => {
                let p = header.clouds[index].p;
                header.clouds[index] = cloud(draw, p);
            }
            5 if !header.clouds.is_empty() => {
                let p = header.clouds[index].p ^ 1;
                if p > 0 && header.clouds.iter().all(|cloud| cloud.p != p) {
                    header.clouds[index].p = p;
                }
            }
            _ => header.window = if header.window == 1 { 2 } else { header.window / 2 },
        }
    }
}

fn window(draw: &mut Draw, kind: RunKind) -> u16 {
    let (least, most) = match kind {
        RunKind::Fill => draw.weighed(&[(2, (2, 64)), (6, (65, 1_023)), (1, (GREATEST, GREATEST))]),
        RunKind::Long | RunKind::Shut | RunKind::Giant => (2, 64),
        RunKind::Mixed => {
            draw.weighed(&[(5, (1, 3)), (5, (1, 16)), (2, (1, 64)), (1, (1, GREATEST))])
        }
    };
    u16::try_from(draw.between(least, most)).unwrap_or(1)
}

fn cloud(draw: &mut Draw, p: u16) -> Cloud {
    let power = [8, 16, 31, 32, 53, 63][draw.index(6)];
    let limit = match draw.between(0, 11) {
        0..3 => 1,
        3..7 => draw.between(2, 5),
        7 => 31,
        8..10 => (1 << power) + draw.between(0, 2) - 1,
        10 => u64::MAX,
        _ => draw.between(6, 200),
    };
    let resume = match draw.between(0, 7) {
        0..3 => limit - 1,
        3..5 => 0,
        5 => limit / 2,
        _ => draw.between(0, limit - 1),
    };
    Cloud { p, name: None, limit, resume }
}

/// Returns `count` different priorities: small ones, neighbours, a stride apart, any, or of all
/// lengths.
fn priorities(draw: &mut Draw, count: u64) -> Vec<u16> {
    let top = u64::from(u16::MAX);
    let in_row = |first: u64, stride: u64| {
        (0..count).filter_map(|i| u16::try_from(first + i * stride).ok()).collect()
    };
    match draw.between(0, 9) {
        0..3 => return in_row(draw.between(1, 3), 1),
        3 => return in_row(EDGES[draw.index(EDGES.len())], 1),
        4 => return in_row(top + 1 - count.max(1), 1),
        5 => return in_row(draw.between(1, 20), STRIDES[draw.index(STRIDES.len())]),
        _ => {}
    }
    distinct_priorities(draw, count)
}
