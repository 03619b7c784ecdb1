//! The last calls of one cloud.

use core::time::Duration;

use crate::policy::End;
use crate::survival::Observation;

/// The ends of the last `WINDOW` calls, in fixed memory, sorted for [`Survival`](crate::Survival).
///
/// Nothing older has any effect: `WINDOW` calls after a network changed, only its new state is known.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Observations<const WINDOW: usize> {
    /// Sorted; entries from `len` on mean nothing.
    calls: [CallRecord; WINDOW],
    len: usize,
    /// How many calls have ended so far.
    ended: u64,
}

#[derive(Clone, Copy, PartialEq, Debug)]
struct CallRecord {
    observation: Observation,
    /// How many calls ended before this one.
    number: u64,
}

const NONE: Observation = Observation { response: Duration::ZERO, is_answered: false, count: 0 };

impl<const WINDOW: usize> Observations<WINDOW> {
    /// Nothing observed yet.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(WINDOW > 0, "a window of no calls remembers nothing") };
        Self { calls: [CallRecord { observation: NONE, number: 0 }; WINDOW], len: 0, ended: 0 }
    }

    /// Adds how a call ended, and removes the one `WINDOW` calls ago. It costs `WINDOW` comparisons.
    pub fn add(&mut self, end: End) {
        let (response, is_answered) = match end {
            End::Answered(response) => (response, true),
            // T5: it was seen until then and no longer.
            End::Censored(age) => (age, false),
            // It was seen to its end: no result will ever come.
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

    /// What is remembered, in the order that [`Survival`](crate::Survival) needs.
    #[must_use]
    pub fn sorted(&self) -> impl ExactSizeIterator<Item = Observation> + Clone {
        let calls = self.calls.get(..self.len).unwrap_or_default();
        calls.iter().map(|call| call.observation)
    }

    /// Takes the call at `index` out.
    fn close(&mut self, index: usize) {
        if let Some(calls) = self.calls.get_mut(index..self.len) {
            calls.rotate_left(usize::from(!calls.is_empty()));
            self.len = self.len.saturating_sub(1);
        }
    }

    /// Puts a call at `index`, where there is room for it.
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
