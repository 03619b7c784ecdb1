//! Instants and durations of one run: its scale, where its clock begins, and how it moves.

use super::RunWriter;
use crate::draw::Draw;

/// Scales of time, in nanoseconds: from one to an hour.
const SCALES: [u64; 12] = [
    1,
    1,
    10,
    1_000,
    1_000,
    100_000,
    1_000_000,
    1_000_000,
    16_666_667,
    1_000_000_000,
    60_000_000_000,
    3_600_000_000_000,
];
/// The units, in nanoseconds, in which clocks may count.
const UNITS: [u64; 4] = [1, 1_000, 1_000_000, 1_000_000_000];
/// The longest pause is ten hours, except for pauses that test the width of numbers.
const PAUSE: u64 = 36_000_000_000_000;

/// The scale of a run, and where its clock begins.
pub(super) struct TimeScale {
    pub(super) scale: u64,
    pub(super) start: u64,
}

impl TimeScale {
    /// Returns the scale of a run. The run begins at 0, at any instant, or before an instant at
    /// which a clock of fewer bits would wrap.
    pub(super) fn draw(draw: &mut Draw) -> Self {
        let scale = SCALES[draw.index(SCALES.len())];
        let start = match draw.between(0, 15) {
            0..8 => 0,
            8 => draw.between(0, PAUSE),
            // The run begins at a wall clock's reading in the year 2025 or so.
            9 => 1_750_000_000_000_000_000 + draw.between(0, PAUSE),
            10 => u64::MAX.saturating_sub(scale.saturating_mul(draw.between(0, 40))),
            _ => {
                let unit =
                    draw.weighed(&[(3, UNITS[0]), (1, UNITS[1]), (2, UNITS[2]), (1, UNITS[3])]);
                let bits = draw.weighed(&[(2, 31), (3, 32), (2, 53), (2, 63)]);
                let wraps = (1_u64 << bits).saturating_mul(unit);
                let back = scale.saturating_mul(draw.between(0, 25));
                wraps.saturating_sub(back.saturating_add(draw.between(0, 3)))
            }
        };
        Self { scale, start }
    }
}

impl RunWriter<'_> {
    /// Returns from `least` to `most` tenths of the scale, seldom exactly.
    pub(super) fn tenths(&mut self, least: u64, most: u64) -> u64 {
        let count = self.draw.between(least, most);
        let whole =
            if self.time.scale < 10 { count } else { (self.time.scale / 10).saturating_mul(count) };
        match self.draw.between(0, 5) {
            0..3 => whole,
            3 => whole.saturating_add(self.draw.between(0, 2)),
            4 => whole.saturating_sub(self.draw.between(0, 2)),
            _ => whole.saturating_add(self.draw.between(0, self.time.scale)),
        }
    }

    /// Returns a time from a nanosecond to hours; each order of magnitude is about equally likely.
    fn any_span(&mut self) -> u64 {
        let bits = self.draw.between(0, 45);
        self.draw.between(0, 1 << bits).min(PAUSE)
    }

    /// Returns the instant of the next input.
    pub(super) fn instant(&mut self) -> u64 {
        let now = self.now();
        match self.draw.between(0, 99) {
            48..62 => now.saturating_add(self.tenths(0, 10)),
            62..80 => {
                let due = self.context.next_due().unwrap_or(now);
                self.edge(due)
            }
            80..84 => {
                let due = self.any_due().unwrap_or(now);
                self.edge(due)
            }
            84..88 => now.saturating_add(self.tenths(30, 300)),
            88..90 => now.saturating_add(self.any_span()),
            90..98 => self.back(now),
            98 if !self.is_long => self.far(now),
            _ => now,
        }
    }

    /// Returns an instant before the clock: by a little, by the scale, by hours, or the first of
    /// all.
    fn back(&mut self, now: u64) -> u64 {
        match self.draw.between(0, 7) {
            0..2 => now.saturating_sub(self.draw.between(1, 50)),
            2..5 => now.saturating_sub(self.tenths(1, 100)),
            5 => now.saturating_sub(self.any_span()),
            6 => now.wrapping_sub(1 << self.power()).min(now),
            _ => 0,
        }
    }

    /// Returns an instant that a clock of fewer bits takes for another one, or the end of time.
    fn far(&mut self, now: u64) -> u64 {
        if self.draw.one_in(8) {
            return u64::MAX;
        }
        let bits = self.draw.weighed(&[(3, 31), (4, 32), (2, 53), (1, 62)]);
        now.saturating_add(1 << bits)
    }

    /// Returns the due instant of some timer.
    fn any_due(&mut self) -> Option<u64> {
        let index = self.draw.index(self.context.requested().len());
        let (t, p) = self.context.requested().get(index).copied()?;
        self.context.due(t, p)
    }

    /// Returns the value, one less, or one more.
    pub(super) fn edge(&mut self, value: u64) -> u64 {
        match self.draw.between(0, 2) {
            0 => value.saturating_sub(1),
            1 => value,
            _ => value.saturating_add(1),
        }
    }

    /// Returns a deadline.
    pub(super) fn span(&mut self) -> u64 {
        match self.draw.between(0, 59) {
            0..3 => 0,
            3..6 => 1,
            6..38 => self.tenths(5, 90),
            // Until a due instant, so that timers coincide.
            38..48 => {
                let due = self.context.next_due();
                self.until(due)
            }
            48..52 => {
                let due = self.any_due();
                self.until(due)
            }
            52..55 => self.any_span(),
            // The clock soon passes what is due.
            _ if self.is_long => self.tenths(50, 60),
            55..57 => {
                let short = if self.draw.one_in(2) { 0 } else { self.tenths(0, 20) };
                short.wrapping_add(1 << self.power())
            }
            // The end of time, just before it, and beyond it.
            57 => {
                let rest = u64::MAX - self.now();
                self.edge(rest)
            }
            58 => u64::MAX,
            _ => self.draw.next(),
        }
    }

    /// Returns the time until `due`.
    fn until(&mut self, due: Option<u64>) -> u64 {
        match due {
            Some(due) => due.saturating_sub(self.now()),
            None => self.tenths(5, 20),
        }
    }

    pub(super) fn deadline_of_local(&mut self) -> Option<u64> {
        (!self.draw.one_in(3)).then(|| self.span())
    }
}
