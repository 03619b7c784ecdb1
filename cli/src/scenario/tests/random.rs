//! Random numbers.

use fuseline_testkit::splitmix64;

/// A small generator (splitmix64); a run is its seed.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        splitmix64(&mut self.0)
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        let share = u32::try_from(self.bits() >> 32).map_or(0.0, f64::from) / f64::from(u32::MAX);
        low + (high - low) * share
    }

    pub(super) fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        let place = usize::try_from(self.bits() >> 33).unwrap_or_default();
        choices[place % choices.len()]
    }
}
