//! What became of all timestamps, by when they began: counts for each of some thousand equal spans of time.

use std::collections::BTreeMap;

use serde::Serialize;

/// How many spans there are at most.
const MOST: u64 = 8192;

/// The counts of each span in which a timestamp began.
pub(crate) struct TimeTiles {
    /// How long a span is, in nanoseconds; it begins at a multiple of that.
    width: u64,
    /// By the span's number.
    tiles: BTreeMap<u64, TileCounts>,
}

/// What became of the timestamps that began in one span.
#[derive(Clone, Default)]
struct TileCounts {
    missed: u64,
    open: u64,
    /// Forwarded, by the place of the source.
    forwarded: Vec<u64>,
}

/// How a message ended.
#[derive(Clone, Copy)]
pub(crate) enum TileOutcome {
    /// With the result of the source at this place.
    Forwarded(usize),
    Missed,
    Open,
}

/// The tiles as the page has them.
#[derive(Serialize)]
pub(crate) struct TileColumns {
    width: u64,
    /// Since when they count, after the trace's origin.
    first: i128,
    /// Each tile's number as its difference from the one before.
    tile: Vec<u64>,
    /// For each tile: missed, open, then forwarded by source, without zeros at the end.
    counts: Vec<Vec<u64>>,
}

impl Default for TimeTiles {
    fn default() -> Self {
        Self { width: 1, tiles: BTreeMap::new() }
    }
}

impl TimeTiles {
    /// Counts a message that began at this instant.
    pub(crate) fn add(&mut self, at: u64, outcome: TileOutcome) {
        let number = |tile: Option<(&u64, &TileCounts)>| tile.map(|(number, _)| *number);
        loop {
            let own = at / self.width;
            let first = number(self.tiles.first_key_value()).unwrap_or(own).min(own);
            let last = number(self.tiles.last_key_value()).unwrap_or(own).max(own);
            if last - first < MOST {
                break;
            }
            self.double();
        }
        let tile = self.tiles.entry(at / self.width).or_default();
        match outcome {
            TileOutcome::Missed => tile.missed += 1,
            TileOutcome::Open => tile.open += 1,
            TileOutcome::Forwarded(place) => {
                if tile.forwarded.len() <= place {
                    tile.forwarded.resize(place + 1, 0);
                }
                tile.forwarded[place] += 1;
            }
        }
    }

    /// For a page whose instants count from `origin`.
    pub(crate) fn columns(&self, origin: u64) -> TileColumns {
        let first = self.tiles.keys().next().copied().unwrap_or_default();
        let mut before = first;
        let mut columns = TileColumns {
            width: self.width,
            first: i128::from(first) * i128::from(self.width) - i128::from(origin),
            tile: Vec::with_capacity(self.tiles.len()),
            counts: Vec::with_capacity(self.tiles.len()),
        };
        for (number, TileCounts { missed, open, forwarded }) in &self.tiles {
            columns.tile.push(number - before);
            before = *number;
            columns.counts.push([&[*missed, *open], &forwarded[..]].concat());
        }
        columns
    }

    /// Makes two spans one.
    fn double(&mut self) {
        self.width = self.width.saturating_mul(2);
        for (number, tile) in std::mem::take(&mut self.tiles) {
            self.tiles.entry(number / 2).or_default().extend(&tile);
        }
    }
}

impl TileCounts {
    fn extend(&mut self, other: &Self) {
        self.missed += other.missed;
        self.open += other.open;
        self.forwarded.resize(self.forwarded.len().max(other.forwarded.len()), 0);
        for (own, others) in self.forwarded.iter_mut().zip(&other.forwarded) {
            *own += others;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_widen_so_that_they_are_few_and_count_all() {
        let mut tiles = TimeTiles::default();
        let instants = (0..50_000_u64).map(|n| 1_000_000 + n * 1_000_003);
        let instants: Vec<u64> = instants.chain([5, 7, u64::MAX]).collect();
        let outcomes = [TileOutcome::Missed, TileOutcome::Open, TileOutcome::Forwarded(3)];
        for (at, outcome) in instants.iter().zip(outcomes.into_iter().cycle()) {
            tiles.add(*at, outcome);
            let (first, last) = (tiles.tiles.keys().next(), tiles.tiles.keys().next_back());
            assert!(last.zip(first).is_some_and(|(last, first)| last - first < MOST));
        }
        let columns = tiles.columns(5);
        let mut expected = BTreeMap::<u64, Vec<u64>>::new();
        for (n, at) in instants.iter().enumerate() {
            let counts = expected.entry(at / columns.width).or_insert_with(|| vec![0; 6]);
            counts[[0, 1, 5][n % 3]] += 1;
        }
        let mut number = expected.keys().next().copied().unwrap();
        assert_eq!(columns.tile.len(), expected.len());
        for (step, mut counts) in columns.tile.iter().zip(columns.counts) {
            number += step;
            counts.resize(6, 0);
            assert_eq!(expected.get(&number), Some(&counts), "{number}");
        }
        // The first begins at a multiple of the width, at or before the first instant.
        assert!(columns.first <= 0 && i128::from(columns.width) + columns.first > 0);
    }
}
