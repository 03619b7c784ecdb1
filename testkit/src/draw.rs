//! The random draws of the generator.

/// `SplitMix64` by Steele and Vigna. Everything else draws from [`Rng`](crate::Rng).
///
/// `fuseline drive` calls its runs by number. They come from this stream, and a recorded digest
/// pins them.
pub(crate) struct Draw(u64);

impl Draw {
    /// Creates the stream of one case of one seed.
    pub(crate) fn new(seed: u64, case: u64) -> Self {
        let mut draw = Self(seed);
        Self(draw.next().wrapping_add(case))
    }

    /// Returns any number.
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number from `least` to `most`, both included.
    pub(crate) fn between(&mut self, least: u64, most: u64) -> u64 {
        match (most - least).checked_add(1) {
            Some(count) => least + self.next() % count,
            None => self.next(),
        }
    }

    /// Returns an index into something of this length, or 0 if it is empty.
    pub(crate) fn index(&mut self, len: usize) -> usize {
        let len = u64::try_from(len).unwrap_or(u64::MAX).max(1);
        usize::try_from(self.next() % len).unwrap_or(0)
    }

    /// Returns `true` once in `times`.
    pub(crate) fn one_in(&mut self, times: u64) -> bool {
        self.next().is_multiple_of(times)
    }

    /// Shuffles the items; every order is equally likely.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.index(last + 1));
        }
    }

    /// Returns one of these, each as often as its weight says. At least one weight must not be 0.
    pub(crate) fn weighed<T: Copy>(&mut self, choices: &[(u64, T)]) -> T {
        let whole: u64 = choices.iter().map(|(weight, _)| weight).sum();
        let mut remaining = self.next() % whole;
        for (weight, choice) in choices {
            match remaining.checked_sub(*weight) {
                Some(rest) => remaining = rest,
                None => return *choice,
            }
        }
        choices[0].1
    }
}
