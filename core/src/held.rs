//! Stores the values of held results, for callers that do not store them elsewhere.
//!
//! The machine decides by timestamps and priorities alone and never sees a value. [`Held`] stores
//! the value of the best held result of each open timestamp, and returns it when that result is
//! forwarded.

use crate::answer::{Firing, Outcome};
use crate::priority::Priority;
use crate::time::Timestamp;

/// Stores the value of the best held result of each open timestamp, for up to `WINDOW` of them.
///
/// Only the best available result can be forwarded (P3). So a value is dropped as soon as a better
/// result is held, or when its timestamp is retired without it. No value stays behind if you pass
/// every outcome and every firing to this store. Each call looks at each of the `WINDOW` values at
/// most twice.
///
/// ```
/// use fuseline_core::*;
///
/// let mut fusion = Fusion::<0, 4>::new(4, Commit::Eager, &[])?;
/// let mut held = Held::<&str, 4>::new();
/// let t = Timestamp::new(0);
/// let mut ready = fusion.ready(Instant::START, |firing| drop(held.firing(&firing)));
/// assert_eq!(ready.open(t, None), Opening::Accepted);
/// let outcome = ready.result(t, Priority::LOCAL);
/// assert_eq!(held.result(t, Priority::LOCAL, "a guess", &outcome), Some("a guess"));
/// # Ok::<(), ConfigError>(())
/// ```
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
    /// Creates an empty store. `WINDOW` is the machine's capacity.
    #[must_use]
    pub const fn new() -> Self {
        Self { values: [const { None }; WINDOW] }
    }

    /// Applies the outcome of a result with this value (F3). Returns the value to send downstream,
    /// if one is forwarded.
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
            // Nothing is held under the progressive rule (F9).
            Outcome::Preliminary { by, .. } => (*by == source).then_some(value),
            Outcome::Forwarded { by, .. } if *by == source => {
                // Forwarding discards the other held results of the timestamp (F7).
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

    /// Applies the outcome of a failure (F4). Returns the value to send downstream, if one is
    /// forwarded.
    #[must_use = "a forwarded value must be sent"]
    pub fn failure<const CLOUDS: usize>(
        &mut self,
        timestamp: Timestamp,
        outcome: &Outcome<CLOUDS>,
    ) -> Option<V> {
        self.apply(timestamp, outcome)
    }

    /// Applies a firing (F5). Returns the value to send downstream, if one is forwarded.
    #[must_use = "a forwarded value must be sent"]
    pub fn firing<const CLOUDS: usize>(&mut self, firing: &Firing<CLOUDS>) -> Option<V> {
        self.apply(firing.timestamp, &firing.outcome)
    }

    /// Returns the number of values held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.iter().flatten().count()
    }

    /// Returns `true` if no value is held.
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
            // The timestamp is retired, so its value is removed whether it is sent or not.
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

    /// Stores a value, unless an equal or better one is held for its timestamp.
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
