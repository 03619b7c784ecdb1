//! Random numbers that never change for a seed.

use std::ops::Range;
use std::time::{SystemTime, UNIX_EPOCH};

/// A stream of random numbers: Wang Yi's `WyRand`, whose next state is a sum and whose output is
/// one multiplication.
///
/// The stream and its draws never change, so a recorded seed always means the same case; a
/// library's stream may change from version to version. The draws are those of `fastrand` 2.5, with
/// which the simulators' seeds were found. Do not use it for secrets.
///
/// ```
/// let mut rng = fuseline_testkit::Rng::with_seed(7);
/// let dice = rng.u64(1..7);
/// assert_eq!(dice, fuseline_testkit::Rng::with_seed(7).u64(1..7));
/// ```
#[derive(Clone, Debug)]
pub struct Rng(u64);

impl Rng {
    /// Creates the stream of a seed.
    #[must_use]
    pub const fn with_seed(seed: u64) -> Self {
        Self(seed)
    }

    /// Creates a stream from the system's clock, for a seed that was never used before.
    #[must_use]
    pub fn by_chance() -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self(low(now.as_nanos()))
    }

    /// Returns any number.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x2d35_8dcc_aa6c_78a5);
        let product = u128::from(self.0) * u128::from(self.0 ^ 0x8bb8_4b93_962e_acc9);
        low(product) ^ high(product)
    }

    /// Returns a number in this range, or its start if the range is empty.
    pub fn u64(&mut self, range: Range<u64>) -> u64 {
        range.start + self.below(range.end.saturating_sub(range.start))
    }

    /// Returns a number in this range, or its start if the range is empty.
    pub fn usize(&mut self, range: Range<usize>) -> usize {
        range.start + self.index(range.end.saturating_sub(range.start))
    }

    /// Returns a number in this range, or its start if the range is empty.
    pub fn u32(&mut self, range: Range<u32>) -> u32 {
        range.start + self.below_u32(range.end.saturating_sub(range.start))
    }

    /// Returns a number in this range, or its start if the range is empty.
    pub fn u8(&mut self, range: Range<u8>) -> u8 {
        let offset = self.below_u32(range.end.saturating_sub(range.start).into());
        range.start + u8::try_from(offset).unwrap_or_default()
    }

    /// Returns an index into something of this length, or 0 if it is empty.
    pub fn index(&mut self, len: usize) -> usize {
        usize::try_from(self.below(len as u64)).unwrap_or_default()
    }

    /// Returns a number from 0 up to 1, without 1 itself.
    #[expect(clippy::cast_precision_loss, reason = "a share, rounded")]
    pub fn f64(&mut self) -> f64 {
        loop {
            let share = (self.next_u64() >> 1) as f64 / (1_u64 << 63) as f64;
            // The greatest words are rounded up to 1.
            if share < 1.0 {
                return share;
            }
        }
    }

    /// Returns a number from `low` up to `high`.
    pub fn f64_between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.f64()
    }

    /// Returns `true` or `false`, which are equally likely.
    pub fn bool(&mut self) -> bool {
        self.next_u64().is_multiple_of(2)
    }

    /// Returns `true` once in `times`, or always if `times` is 0.
    pub fn one_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }

    /// Returns one of these, all equally likely.
    ///
    /// # Panics
    /// Panics if there is none.
    pub fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.index(choices.len())]
    }

    /// Shuffles the items; every order is equally likely.
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in 1..items.len() {
            items.swap(i, self.index(i + 1));
        }
    }

    /// Returns `count` of the items, or all if they are fewer. Every choice is equally likely, but
    /// its order is not random.
    pub fn sample<T>(&mut self, items: impl IntoIterator<Item = T>, count: usize) -> Vec<T> {
        let mut items = items.into_iter();
        let mut sample: Vec<T> = items.by_ref().take(count).collect();
        for (item, number) in items.zip(count + 1..) {
            if let Some(replaced) = sample.get_mut(self.index(number)) {
                *replaced = item;
            }
        }
        sample
    }

    /// Returns a number below `bound`, all equally likely (Lemire's method), or 0 if `bound` is 0.
    fn below(&mut self, bound: u64) -> u64 {
        let mut product = u128::from(self.next_u64()) * u128::from(bound);
        if low(product) < bound {
            let uneven = bound.wrapping_neg() % bound;
            while low(product) < uneven {
                product = u128::from(self.next_u64()) * u128::from(bound);
            }
        }
        high(product)
    }

    /// Returns the same from half of the bits, for small bounds.
    fn below_u32(&mut self, bound: u32) -> u32 {
        let mut draw = || (self.next_u64() & u64::from(u32::MAX)) * u64::from(bound);
        let low = |product: u64| product & u64::from(u32::MAX);
        let mut product = draw();
        if low(product) < bound.into() {
            let uneven = u64::from(bound.wrapping_neg() % bound);
            while low(product) < uneven {
                product = draw();
            }
        }
        u32::try_from(product >> 32).unwrap_or_default()
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the low half")]
const fn low(product: u128) -> u64 {
    product as u64
}

const fn high(product: u128) -> u64 {
    (product >> 64) as u64
}
