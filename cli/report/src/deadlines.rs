//! How long requests had.

use std::cmp::Reverse;
use std::collections::BTreeMap;

/// How often requests of each source had so long, in nanoseconds.
#[derive(Default)]
pub(crate) struct RequestDeadlines(BTreeMap<u64, BTreeMap<u64, u64>>);

impl RequestDeadlines {
    pub(crate) fn add(&mut self, p: u64, deadline: u64) {
        *self.0.entry(p).or_default().entry(deadline).or_default() += 1;
    }

    /// The commonest over all sources, so many at most.
    pub(crate) fn commonest(&self, most: usize) -> Vec<u64> {
        let mut all: BTreeMap<u64, u64> = BTreeMap::new();
        for (deadline, count) in self.0.values().flatten() {
            *all.entry(*deadline).or_default() += count;
        }
        let mut counted: Vec<(u64, u64)> = all.into_iter().collect();
        counted.sort_by_key(|(deadline, count)| (Reverse(*count), *deadline));
        counted.into_iter().take(most).map(|(deadline, _)| deadline).collect()
    }

    /// The least, the median by nearest rank, and the greatest of a source; none if nothing was requested of it.
    pub(crate) fn spread(&self, p: u64) -> Option<[u64; 3]> {
        let counts = self.0.get(&p)?;
        let (least, greatest) = (*counts.first_key_value()?.0, *counts.last_key_value()?.0);
        let all: u64 = counts.values().sum();
        let mut passed = 0;
        let median = counts.iter().find(|(_, count)| {
            passed += **count;
            2 * passed >= all
        });
        Some([least, *median?.0, greatest])
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
