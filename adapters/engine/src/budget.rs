//! The part of a message's end-to-end deadline that is left at one operator (E3).

use std::time::{Duration, Instant};

use fuseline_traces::nanos;

use crate::latency::Reserve;
use crate::lineage::Lineage;

/// One message's end-to-end deadline on the engine's clock.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Budget {
    due: u64,
    /// The two parts of the reserve. Local must end `on_board` before `due`, and requests
    /// `with_clouds`.
    on_board: u64,
    with_clouds: u64,
    /// The message's age when the operator accepted it; 0 if that is unknown.
    age: u64,
}

impl Budget {
    /// Returns a budget that is due at `due`, on a clock in nanoseconds, and keeps `reserve` for
    /// the operators downstream.
    #[must_use]
    pub fn ending_at(due: u64, reserve: Reserve) -> Self {
        let [on_board, with_clouds] = [reserve.on_board(), reserve.with_clouds()].map(nanos);
        Self { due, on_board, with_clouds, age: 0 }
    }

    /// Returns the budget of a message that is accepted at `now`, which is `instant`, or `None` if
    /// it has no end-to-end deadline.
    pub(crate) fn new(
        lineage: &Lineage,
        (now, instant): (u64, Option<Instant>),
        reserve: Reserve,
    ) -> Option<Self> {
        let within = nanos(lineage.within?);
        let age = instant.and_then(|instant| lineage.age(instant)).map_or(0, nanos);
        let due = now.saturating_add(within).saturating_sub(age);
        Some(Self { age, ..Self::ending_at(due, reserve) })
    }

    /// Returns how long a request that is made at `at` may take. It ends while the operators
    /// downstream still have time for their clouds.
    #[must_use]
    pub fn for_cloud(&self, at: u64) -> Duration {
        Duration::from_nanos(self.due.saturating_sub(self.with_clouds).saturating_sub(at))
    }

    /// Returns how long local may take from `at`, at least 1 ns because a deadline of 0 is refused
    /// (E2, F1).
    ///
    /// With a substitute, local ends while the operators downstream still have time to compute on
    /// board. It keeps no time for their clouds (E11). Without a substitute an earlier end gains
    /// nothing.
    #[must_use]
    pub fn for_local(&self, at: u64, has_substitute: bool) -> Duration {
        let reserve = if has_substitute { self.on_board } else { 0 };
        Duration::from_nanos(self.due.saturating_sub(reserve).saturating_sub(at).max(1))
    }

    /// Returns the part of the end-to-end deadline that no request of this operator can use: the
    /// message's age and the reserve.
    pub(crate) const fn spent(&self) -> u64 {
        self.age.saturating_add(self.with_clouds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::latency::Latency;

    const NS: Duration = Duration::from_nanos(1);

    /// Requests and local end before their reserve (E3).
    #[test]
    fn requests_and_local_end_before_their_reserve() {
        let captured = Instant::now();
        let lineage = Lineage::new("camera", 1, captured).within(500 * NS);
        let reserve = Latency::stated_with_clouds(100 * NS, 150 * NS).estimate();
        let budget = Budget::new(&lineage, (1000, Some(captured + 100 * NS)), reserve).unwrap();
        assert_eq!(budget.for_cloud(1000), 250 * NS);
        assert_eq!(budget.for_cloud(1249), NS);
        assert_eq!(budget.for_cloud(1250), Duration::ZERO);
        assert_eq!(budget.for_local(1249, true), 51 * NS);
        assert_eq!(budget.for_local(1299, true), NS);
        assert_eq!(budget.for_local(1301, true), NS, "F1 refuses 0");
        assert_eq!(budget.for_local(1301, false), 99 * NS);
        assert_eq!(budget.spent(), 250);
    }

    #[test]
    fn counts_from_intake_without_a_capture() {
        let lineage = Lineage { captured: None, ..Lineage::default() }.within(500 * NS);
        let reserve = Reserve::default();
        let budget = Budget::new(&lineage, (1000, Some(Instant::now())), reserve).unwrap();
        assert_eq!(budget.for_cloud(1000), 500 * NS);
        assert_eq!(Budget::new(&Lineage::default(), (0, None), reserve), None);
    }
}
