//! How often values occur, in bounded memory where that is wanted.

use std::collections::BTreeMap;

/// How many values are told apart once memory is bounded.
const MOST: usize = 1 << 16;
/// To how many binary digits values are rounded first.
const DIGITS: u32 = 14;

/// How often each value occurs.
#[derive(Clone, Default)]
pub(crate) struct ValueCounts {
    counts: BTreeMap<u64, u64>,
    /// How many values there may be; none is any number.
    most: Option<usize>,
    /// To how many binary digits values are rounded down; none is exact.
    digits: Option<u32>,
}

impl ValueCounts {
    /// Counts a value so many times.
    pub(crate) fn add(&mut self, value: u64, times: u64) {
        *self.counts.entry(rounded(value, self.digits)).or_default() += times;
        if self.most.is_some_and(|most| self.counts.len() > most) {
            self.shrink();
        }
    }

    /// Counts all that another counts.
    pub(crate) fn extend(&mut self, other: &Self) {
        // Both are rounded alike then, so that equal values are one.
        self.digits = match (self.digits, other.digits) {
            (Some(own), Some(others)) => Some(own.min(others)),
            (own, others) => own.or(others),
        };
        self.round();
        other.iter().for_each(|(value, times)| self.add(value, times));
    }

    /// Bounds its memory: where values are too many to be told apart, they are rounded down from here on.
    pub(crate) fn bound(&mut self) {
        self.bound_to(MOST);
    }

    /// The same with so many values at most.
    pub(crate) fn bound_to(&mut self, most: usize) {
        self.most = Some(most);
        if self.counts.len() > most {
            self.shrink();
        }
    }

    /// By how much a value may be too low, as a part of it.
    pub(crate) fn error(&self) -> f64 {
        self.digits
            .map_or(0.0, |digits| 0.5_f64.powi(i32::try_from(digits - 1).unwrap_or(i32::MAX)))
    }

    /// How many values were counted.
    pub(crate) fn total(&self) -> u64 {
        self.counts.values().sum()
    }

    /// The values with their counts, ascending.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = (u64, u64)> {
        self.counts.iter().map(|(value, times)| (*value, *times))
    }

    /// The value of that rank, counted from 1, in ascending order; none beyond them.
    pub(crate) fn of_rank(&self, rank: u64) -> Option<u64> {
        let mut passed = 0;
        self.iter().find_map(|(value, times)| {
            passed += times;
            (passed >= rank).then_some(value)
        })
    }

    /// Rounds until half of the room is free.
    fn shrink(&mut self) {
        let most = self.most.unwrap_or(usize::MAX) / 2;
        while self.counts.len() > most && self.digits != Some(1) {
            self.digits = Some(self.digits.map_or(DIGITS, |digits| digits - 1));
            self.round();
        }
    }

    fn round(&mut self) {
        let mut counts = BTreeMap::new();
        for (value, times) in &self.counts {
            *counts.entry(rounded(*value, self.digits)).or_default() += times;
        }
        self.counts = counts;
    }
}

/// A value's first binary digits, the others 0.
fn rounded(value: u64, digits: Option<u32>) -> u64 {
    let len = u64::BITS - value.leading_zeros();
    let cut = digits.map_or(0, |digits| len.saturating_sub(digits));
    value >> cut << cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_are_exact_and_many_are_rounded_by_no_more_than_is_said() {
        let mut counts = ValueCounts::default();
        counts.bound_to(1000);
        (1..=1000).for_each(|value| counts.add(value * 7919, 1));
        assert!(counts.error() == 0.0 && counts.of_rank(500) == Some(500 * 7919));
        (1001..=100_000).for_each(|value| counts.add(value * 7919, 1));
        assert!(counts.iter().count() <= 1000 && counts.total() == 100_000);
        assert!(0.0 < counts.error() && counts.error() < 0.05, "{}", counts.error());
        for rank in [1, 500, 50_000, 99_000, 100_000] {
            let exact = rank * 7919;
            let found = counts.of_rank(rank).unwrap();
            #[expect(clippy::cast_precision_loss, reason = "small")]
            let error = (exact as f64 - found as f64) / exact as f64;
            assert!((0.0..=counts.error()).contains(&error), "{rank}: {found} for {exact}");
        }
        assert_eq!(counts.of_rank(100_001), None);
    }

    #[test]
    fn two_counts_are_one_whatever_they_are_rounded_to() {
        let [mut all, mut rounded, mut exact] = [(); 3].map(|()| ValueCounts::default());
        rounded.bound_to(64);
        (0..5000).for_each(|value| rounded.add(value, 1));
        (0..50).for_each(|value| exact.add(value * 100, 2));
        all.extend(&exact);
        all.extend(&rounded);
        assert_eq!(all.total(), 5100);
        assert!((all.error() - rounded.error()).abs() < f64::EPSILON);
    }
}
