//! What is left of a message's end-to-end deadline at one operator (E3).

use std::time::{Duration, Instant};

use crate::engine::nanos;
use crate::lineage::Lineage;

/// One message's end-to-end deadline on the engine's clock.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Budget {
    due: u64,
    reserve: u64,
    /// How old the message was when it was taken in; 0 if that is unknown.
    age: u64,
}

impl Budget {
    /// One that is due at `due` on a clock in nanoseconds, of which `reserve` is kept for the operators downstream.
    #[must_use]
    pub const fn ending_at(due: u64, reserve: u64) -> Self {
        Self { due, reserve, age: 0 }
    }

    /// Of a message that is taken in at `now`, which is `instant`; none if it has no end-to-end deadline.
    pub(crate) fn new(
        lineage: &Lineage,
        (now, instant): (u64, Option<Instant>),
        reserve: u64,
    ) -> Option<Self> {
        let within = nanos(lineage.within?);
        let age = instant.and_then(|instant| lineage.age(instant)).map_or(0, nanos);
        Some(Self { due: now.saturating_add(within).saturating_sub(age), reserve, age })
    }

    /// What a request may take at `at`: none of the reserve.
    #[must_use]
    pub fn for_cloud(&self, at: u64) -> Duration {
        Duration::from_nanos(self.due.saturating_sub(self.reserve).saturating_sub(at))
    }

    /// E2: what local may take, at least 1 ns, for F1 refuses less. Only if a substitute is sent for a missed message is the
    /// reserve kept from it: else nothing is gained by its end.
    #[must_use]
    pub fn for_local(&self, at: u64, has_substitute: bool) -> Duration {
        let reserve = if has_substitute { self.reserve } else { 0 };
        Duration::from_nanos(self.due.saturating_sub(reserve).saturating_sub(at).max(1))
    }

    /// What of the end-to-end deadline no request of this operator can use: the message's age and the reserve.
    pub(crate) const fn spent(&self) -> u64 {
        self.age.saturating_add(self.reserve)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NS: Duration = Duration::from_nanos(1);

    /// E3.
    #[test]
    fn deadlines_end_where_the_reserve_begins() {
        let captured = Instant::now();
        let lineage = Lineage::new("camera", 1, captured).within(500 * NS);
        let budget = Budget::new(&lineage, (1000, Some(captured + 100 * NS)), 150).unwrap();
        assert_eq!(budget.for_cloud(1000), 250 * NS);
        assert_eq!(budget.for_cloud(1249), NS);
        assert_eq!(budget.for_cloud(1250), Duration::ZERO);
        assert_eq!(budget.for_local(1249, true), NS);
        assert_eq!(budget.for_local(1251, true), NS, "F1 refuses 0");
        assert_eq!(budget.for_local(1251, false), 149 * NS);
        assert_eq!(budget.spent(), 250);
    }

    #[test]
    fn without_a_capture_it_counts_from_when_the_message_is_taken_in() {
        let lineage = Lineage { captured: None, ..Lineage::default() }.within(500 * NS);
        let budget = Budget::new(&lineage, (1000, Some(Instant::now())), 0).unwrap();
        assert_eq!(budget.for_cloud(1000), 500 * NS);
        assert_eq!(Budget::new(&Lineage::default(), (0, None), 0), None);
    }
}
