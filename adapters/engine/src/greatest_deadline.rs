//! The greatest deadline that may be offered: a longer one is a mistake, such as milliseconds read as seconds, and would hold a
//! result as long (A14).

use std::time::Duration;

use tracing::warn;

/// The bound, and whose offers were above it.
pub(crate) struct GreatestDeadline {
    limit: Duration,
    /// The clouds of which it was logged.
    reported: Vec<u16>,
}

impl GreatestDeadline {
    pub(crate) const fn new(limit: Duration) -> Self {
        Self { limit, reported: Vec::new() }
    }

    /// What a cloud is offered: 0, which the machine refuses (F2, A11), for what is above the bound; at most the bound as the cap
    /// of a policy.
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
    fn what_is_above_the_bound_is_0_and_a_cap_is_the_bound() {
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
