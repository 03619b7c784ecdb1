//! The values of held results, for a caller who has nowhere else to keep them.
//!
//! The machine decides about timestamps and priorities alone and has no values. This stores the value of the best held
//! result of each open timestamp, and returns it when that result is forwarded.

use crate::answer::{Firing, Outcome};
use crate::priority::Priority;
use crate::time::Timestamp;

/// The values of held results: for each of up to `WINDOW` open timestamps, the value of its best result.
///
/// Only the best available result can ever be forwarded (P3), so a value is dropped as soon as a better result is held
/// or its timestamp is retired. Give it every outcome and every firing, and nothing leaks. Each call looks at all
/// `WINDOW` values at most twice.
#[derive(Debug)]
pub struct Held<V, const WINDOW: usize> {
    values: [Option<HeldValue<V>>; WINDOW],
}

#[derive(Debug)]
struct HeldValue<V> {
    timestamp: Timestamp,
    source: Priority,
    value: V,
}

impl<V, const WINDOW: usize> Held<V, WINDOW> {
    /// Nothing is held. `WINDOW` is the machine's.
    #[must_use]
    pub const fn new() -> Self {
        Self { values: [const { None }; WINDOW] }
    }

    /// F3: takes a result's value and its outcome. Returns the value to send downstream, if one is forwarded.
    #[must_use = "a forwarded value must be sent"]
    pub fn result<const CLOUDS: usize>(
        &mut self,
        timestamp: Timestamp,
        source: Priority,
        value: V,
        outcome: &Outcome<CLOUDS>,
    ) -> Option<V> {
        match outcome {
            Outcome::Held => {
                self.hold(HeldValue { timestamp, source, value });
                None
            }
            // F9: nothing is held under progressive.
            Outcome::Preliminary { by, .. } => (*by == source).then_some(value),
            Outcome::Forwarded { by, .. } if *by == source => {
                // F7: what else was held for it is discarded.
                self.take(timestamp);
                Some(value)
            }
            Outcome::Forwarded { .. }
            | Outcome::Final { .. }
            | Outcome::Dropped(_)
            | Outcome::Waiting
            | Outcome::Missed => self.apply(timestamp, outcome),
        }
    }

    /// F4: takes a failure's outcome. Returns the value to send downstream, if one is forwarded.
    #[must_use = "a forwarded value must be sent"]
    pub fn failure<const CLOUDS: usize>(
        &mut self,
        timestamp: Timestamp,
        outcome: &Outcome<CLOUDS>,
    ) -> Option<V> {
        self.apply(timestamp, outcome)
    }

    /// F5: timers fired. Returns the value to send downstream, if one is forwarded.
    #[must_use = "a forwarded value must be sent"]
    pub fn firing<const CLOUDS: usize>(&mut self, firing: &Firing<CLOUDS>) -> Option<V> {
        self.apply(firing.timestamp, &firing.outcome)
    }

    /// How many values are held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.iter().flatten().count()
    }

    /// Whether nothing is held.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.iter().all(Option::is_none)
    }

    fn apply<const CLOUDS: usize>(
        &mut self,
        timestamp: Timestamp,
        outcome: &Outcome<CLOUDS>,
    ) -> Option<V> {
        match outcome {
            // Retired: what was held is removed, whether it is sent or not.
            Outcome::Forwarded { by, .. } => {
                let best = self.take(timestamp)?;
                (best.source == *by).then_some(best.value)
            }
            Outcome::Missed => {
                self.take(timestamp);
                None
            }
            Outcome::Dropped(_)
            | Outcome::Held
            | Outcome::Waiting
            | Outcome::Preliminary { .. }
            | Outcome::Final { .. } => None,
        }
    }

    /// Stores the better of this one and what is held for its timestamp.
    fn hold(&mut self, new: HeldValue<V>) {
        let is_same = |held: &HeldValue<V>| held.timestamp == new.timestamp;
        if let Some(held) = self.values.iter_mut().flatten().find(|held| is_same(held)) {
            if held.source < new.source {
                *held = new;
            }
            return;
        }
        let free = self.values.iter_mut().find(|value| value.is_none());
        debug_assert!(free.is_some(), "more values are held than timestamps are open");
        if let Some(free) = free {
            *free = Some(new);
        }
    }

    fn take(&mut self, timestamp: Timestamp) -> Option<HeldValue<V>> {
        let is_same = |held: &HeldValue<V>| held.timestamp == timestamp;
        self.values.iter_mut().find(|value| value.as_ref().is_some_and(is_same))?.take()
    }
}

impl<V, const WINDOW: usize> Default for Held<V, WINDOW> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
