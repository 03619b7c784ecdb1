//! Timestamps, priorities and backlogs, and the numbers that fewer bits would confuse with them.

use super::RunWriter;
use crate::draw::Draw;

/// The widths, in bits, at which numbers are cut off or rounded.
const POWERS: [u32; 7] = [4, 8, 16, 31, 32, 53, 63];
/// A step usually looks back at most this many timestamps or requests.
const RECENT: usize = 12;

/// Returns the first timestamp of a run. It is 0, a small number, or a number at which an integer
/// of fewer bits ends.
pub(super) fn first_timestamp(draw: &mut Draw) -> u64 {
    match draw.between(0, 15) {
        0..7 => 0,
        7 => draw.between(1, 300),
        8 => draw.next() >> 1,
        9 => u64::MAX - draw.between(0, 12),
        _ => (1 << POWERS[draw.index(POWERS.len())]) - draw.between(0, 8),
    }
}

impl RunWriter<'_> {
    pub(super) fn power(&mut self) -> u32 {
        POWERS[self.draw.index(POWERS.len())]
    }

    /// Returns a timestamp to open.
    pub(super) fn fresh(&mut self) -> u64 {
        match self.draw.between(0, 39) {
            0..24 => self.next_t,
            24..28 => self.next_t.saturating_add(self.draw.between(1, 9)),
            28..30 => {
                let window = u64::from(self.header.window);
                let times = self.draw.between(1, 3);
                let last = self.tried.last().copied().unwrap_or_default();
                last.saturating_add(window * times).max(self.next_t)
            }
            30..33 => {
                let last = self.tried.last().copied().unwrap_or_default();
                let most = if self.is_long { 2 } else { POWERS.len() - 1 };
                let bits = POWERS[self.draw.index(most)];
                last.saturating_add(1 << bits).max(self.next_t)
            }
            33..39 => self.tried_before(),
            _ if self.is_long => self.next_t,
            _ => self.draw.weighed(&[(1, u64::MAX), (3, self.next_t.saturating_add(1 << 63))]),
        }
    }

    /// Returns a timestamp for an offer, a result or a failure.
    pub(super) fn timestamp(&mut self) -> u64 {
        match self.draw.between(0, 39) {
            0..26 => self.opened(),
            26..32 => self.tried_before(),
            32..35 => self.next_t.saturating_add(self.draw.between(0, 2)),
            35..39 => {
                let t = self.opened();
                self.alias(t)
            }
            _ => self.draw.next(),
        }
    }

    /// Returns an open timestamp, usually a recent one.
    fn opened(&mut self) -> u64 {
        let open = self.context.open();
        let back = self.draw.weighed(&[(6, 2), (2, RECENT), (1, usize::MAX)]);
        let back = self.draw.index(back.min(open.len()));
        open.iter().rev().nth(back).copied().unwrap_or(self.next_t)
    }

    pub(super) fn tried_before(&mut self) -> u64 {
        let index = if self.draw.one_in(4) {
            self.draw.index(self.tried.len())
        } else {
            self.recent(self.tried.len())
        };
        self.tried.get(index).copied().unwrap_or(self.next_t)
    }

    /// Returns another number that fewer bits cannot tell from this one.
    pub(super) fn alias(&mut self, number: u64) -> u64 {
        let power = 1_u64 << self.power();
        match self.draw.between(0, 6) {
            0..4 => number.wrapping_add(power),
            4 => number.wrapping_sub(power),
            5 => number.wrapping_neg(),
            _ => number ^ 1,
        }
    }

    pub(super) fn priority(&mut self) -> u64 {
        match self.draw.between(0, 39) {
            0..33 => self.cloud(),
            33 => 0,
            34..38 => {
                let p = if self.draw.one_in(4) { 0 } else { self.cloud() };
                self.alias(p)
            }
            38 => self.draw.between(1, 20),
            _ => self.draw.next(),
        }
    }

    pub(super) fn cloud(&mut self) -> u64 {
        let index = self.draw.index(self.header.clouds.len());
        self.header.clouds.get(index).map_or(1, |cloud| u64::from(cloud.p))
    }

    /// Returns the timestamp and the source of a result or a failure.
    pub(super) fn call(&mut self) -> (u64, u64) {
        match self.draw.between(0, 11) {
            0..6 if !self.context.requested().is_empty() => {
                let len = self.context.requested().len();
                let index =
                    if self.draw.one_in(6) { self.draw.index(len) } else { self.recent(len) };
                self.context.requested()[index]
            }
            6..8 => (self.timestamp(), 0),
            _ => (self.timestamp(), self.priority()),
        }
    }

    pub(super) fn backlog(&mut self, p: u64) -> u64 {
        let (limit, resume) = self.context.gate(p).map_or((1, 0), |gate| (gate.limit, gate.resume));
        match self.draw.between(0, 23) {
            0..8 => 0,
            8..13 => self.edge(limit),
            13..17 => self.edge(resume),
            17 => self.draw.between(resume, limit),
            18..20 => {
                let edge = if self.draw.one_in(2) { resume } else { limit - 1 };
                self.alias(edge)
            }
            20..22 => limit,
            22 => u64::MAX,
            _ => self.draw.next(),
        }
    }

    /// Returns one of the last few of `len` indices.
    pub(super) fn recent(&mut self, len: usize) -> usize {
        let back = self.draw.index(len.min(RECENT));
        len.saturating_sub(1).saturating_sub(back)
    }
}
