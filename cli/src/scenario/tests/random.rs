//! Random numbers.

/// A small generator (splitmix64); a run is its seed.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let bits = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
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
