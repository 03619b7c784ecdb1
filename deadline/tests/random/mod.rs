//! Random numbers.

use fuseline_testkit::splitmix64;

/// A small generator of random numbers (splitmix64); a run is its seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        splitmix64(&mut self.0)
    }

    /// From `low` to `high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from((self.bits() >> 32) as u32) / f64::from(u32::MAX)
    }

    pub(crate) fn chance(&mut self, share: f64) -> bool {
        self.between(0.0, 1.0) < share
    }

    pub(crate) fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[(self.bits() >> 32) as usize % choices.len()]
    }
}
