//! The last calls of one cloud.

use core::time::Duration;

use crate::policy::End;
use crate::survival::Observation;

/// Stores the ends of the last `WINDOW` calls, in fixed memory, in the order that
/// [`Survival`](crate::Survival) needs.
///
/// Older calls have no effect: `WINDOW` calls after a network changed, only its new state is known.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Observations<const WINDOW: usize> {
    /// The calls, sorted. Entries from `len` on are unused.
    calls: [CallRecord; WINDOW],
    len: usize,
    /// The number of calls that have ended so far.
    ended: u64,
}

#[derive(Clone, Copy, PartialEq, Debug)]
struct CallRecord {
    observation: Observation,
    /// The number of calls that ended before this one.
    number: u64,
}

const NONE: Observation = Observation { response: Duration::ZERO, is_answered: false, count: 0 };

impl<const WINDOW: usize> Observations<WINDOW> {
    /// Creates an empty store.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(WINDOW > 0, "a window of no calls remembers nothing") };
        Self { calls: [CallRecord { observation: NONE, number: 0 }; WINDOW], len: 0, ended: 0 }
    }

    /// Adds the end of a call, and removes the call `WINDOW` ends ago. Takes `WINDOW` comparisons.
    pub fn add(&mut self, end: End) {
        let (response, is_answered) = match end {
            End::Answered(response) => (response, true),
            // The call was seen until then and no longer (T5).
            End::Censored(age) => (age, false),
            // The call was seen to its end: no result will ever come.
            End::Failed(_) => (Duration::MAX, false),
        };
        let observation = Observation { response, is_answered, count: 1 };
        if self.len == WINDOW {
            let oldest = self.ended.wrapping_sub(WINDOW as u64);
            let index = self.calls.iter().position(|call| call.number == oldest);
            self.close(index.unwrap_or_default());
        }
        let sorted = self.calls.get(..self.len).unwrap_or_default();
        let index = sorted.partition_point(|call| call.observation.key() <= observation.key());
        self.insert(index, CallRecord { observation, number: self.ended });
        self.ended = self.ended.wrapping_add(1);
    }

    /// Returns the calls that are remembered, in the order that [`Survival`](crate::Survival)
    /// needs.
    #[must_use]
    pub fn sorted(&self) -> impl ExactSizeIterator<Item = Observation> + Clone {
        let calls = self.calls.get(..self.len).unwrap_or_default();
        calls.iter().map(|call| call.observation)
    }

    /// Removes the call at `index`.
    fn close(&mut self, index: usize) {
        if let Some(calls) = self.calls.get_mut(index..self.len) {
            calls.rotate_left(usize::from(!calls.is_empty()));
            self.len = self.len.saturating_sub(1);
        }
    }

    /// Inserts a call at `index`; there must be room for it.
    fn insert(&mut self, index: usize, call: CallRecord) {
        if let Some(calls) = self.calls.get_mut(index..=self.len) {
            calls.rotate_right(1);
            if let Some(first) = calls.first_mut() {
                *first = call;
                self.len = self.len.saturating_add(1);
            }
        }
    }
}

impl<const WINDOW: usize> Default for Observations<WINDOW> {
    fn default() -> Self {
        Self::new()
    }
}
