//! Bounds the deadlines of offers. A longer deadline is a mistake, such as milliseconds read as
//! seconds, and could hold a result for that long (A14).

use std::time::Duration;

use tracing::warn;

/// The bound, and the clouds whose offers exceeded it.
pub(crate) struct GreatestDeadline {
    limit: Duration,
    /// The clouds for which this was logged.
    reported: Vec<u16>,
}

impl GreatestDeadline {
    pub(crate) const fn new(limit: Duration) -> Self {
        Self { limit, reported: Vec::new() }
    }

    /// Returns the deadline to offer. A policy's cap above the bound becomes the bound. Any other
    /// deadline above the bound becomes 0, which the machine refuses (F2, A11).
    pub(crate) fn of_offer(
        &mut self,
        offered: Duration,
        (operator, p): (&str, u16),
        is_cap: bool,
    ) -> Duration {
        if offered <= self.limit {
            return offered;
        }
        if is_cap {
            return self.limit;
        }
        if !self.reported.contains(&p) {
            self.reported.push(p);
            let greatest = self.limit;
            warn!(
                operator,
                priority = p,
                ?offered,
                ?greatest,
                "the deadline is above the greatest"
            );
        }
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offer_above_the_bound_is_0_and_a_cap_the_bound() {
        let second = Duration::from_secs(1);
        let mut greatest = GreatestDeadline::new(Duration::MAX);
        let mut of = |offered, is_cap| greatest.of_offer(offered, ("fusion", 1), is_cap);
        assert_eq!([of(Duration::MAX, false), of(Duration::MAX, true)], [Duration::MAX; 2]);
        let mut greatest = GreatestDeadline::new(second);
        let mut of = |offered, is_cap| greatest.of_offer(offered, ("fusion", 1), is_cap);
        let next = second + Duration::from_nanos(1);
        assert_eq!([of(second, false), of(second, true), of(next, true)], [second; 3]);
        assert_eq!([of(next, false), of(next, false)], [Duration::ZERO; 2]);
        assert_eq!(greatest.reported, [1]);
    }
}
