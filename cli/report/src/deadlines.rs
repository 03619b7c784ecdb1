//! How long requests had.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use crate::counts::ValueCounts;

/// How often requests of each source had so long, in nanoseconds.
#[derive(Default)]
pub(crate) struct RequestDeadlines {
    of: BTreeMap<u64, SourceDeadlines>,
    is_bounded: bool,
}

/// Those of one source.
#[derive(Default)]
struct SourceDeadlines {
    counts: ValueCounts,
    /// The greatest, exactly.
    greatest: u64,
}

impl RequestDeadlines {
    pub(crate) fn add(&mut self, p: u64, deadline: u64) {
        let is_bounded = self.is_bounded;
        let source = self.of.entry(p).or_insert_with(|| {
            let mut source = SourceDeadlines::default();
            if is_bounded {
                source.counts.bound();
            }
            source
        });
        source.counts.add(deadline, 1);
        source.greatest = source.greatest.max(deadline);
    }

    /// Bounds its memory: very many different deadlines are rounded down from here on.
    pub(crate) fn bound(&mut self) {
        self.is_bounded = true;
        self.of.values_mut().for_each(|source| source.counts.bound());
    }

    /// The commonest over all sources, so many at most.
    pub(crate) fn commonest(&self, most: usize) -> Vec<u64> {
        let mut all = ValueCounts::default();
        self.of.values().for_each(|source| all.extend(&source.counts));
        let mut counted: Vec<(u64, u64)> = all.iter().collect();
        counted.sort_by_key(|(deadline, count)| (Reverse(*count), *deadline));
        counted.into_iter().take(most).map(|(deadline, _)| deadline).collect()
    }

    /// The least, the median by nearest rank, and the greatest of a source; none if nothing was requested of it.
    pub(crate) fn spread(&self, p: u64) -> Option<[u64; 3]> {
        let SourceDeadlines { counts, greatest } = self.of.get(&p)?;
        let (least, _) = counts.iter().next()?;
        Some([least, counts.of_rank(counts.total().div_ceil(2))?, *greatest])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_least_median_and_greatest() {
        let mut deadlines = RequestDeadlines::default();
        for deadline in [500, 300, 300, 500, 400, 300] {
            deadlines.add(1, deadline);
        }
        deadlines.add(2, 500);
        assert_eq!(deadlines.spread(1), Some([300, 300, 500]));
        assert_eq!(deadlines.spread(2), Some([500; 3]));
        assert_eq!(deadlines.spread(3), None);
        assert_eq!(deadlines.commonest(2), [300, 500]);
    }
}
