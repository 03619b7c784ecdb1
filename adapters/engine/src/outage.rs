//! When it is logged that a source gives no results: not with each message, but at first, every so often, and once it is over.

/// At most one line of a source in so many nanoseconds.
const EVERY: u64 = 10_000_000_000;
/// So many requests in a row whose timers fired are an outage; of failures, which say so, one is.
const TIMERS: u64 = 16;

/// The requests of one source that ended without a result since its last one.
#[derive(Clone, Copy, Default)]
pub(crate) struct OutageLog {
    count: u64,
    /// When the first of them ended.
    began: u64,
    /// When the last line was logged, if there was one.
    logged: Option<u64>,
    /// Whether it was of this outage.
    is_logged: bool,
}

/// What a line says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct OutageLine {
    /// How many requests in a row had no result.
    pub(crate) count: u64,
    /// Since the first of them ended, in nanoseconds.
    pub(crate) lasts: u64,
}

impl OutageLog {
    /// F4: a request failed; what to log of it, if anything.
    pub(crate) fn failed(&mut self, at: u64) -> Option<OutageLine> {
        self.add(at);
        self.line(at)
    }

    /// F5: a request's timer fired; what to log of it, if anything.
    pub(crate) fn timed_out(&mut self, at: u64) -> Option<OutageLine> {
        self.add(at);
        if self.count < TIMERS && !self.is_logged { None } else { self.line(at) }
    }

    /// F3: a result came, in time or late; the outage that it ends, if that was logged and more than one request.
    pub(crate) fn answered(&mut self, at: u64) -> Option<OutageLine> {
        if self.count == 0 {
            return None;
        }
        let ended = Self { logged: self.logged, ..Self::default() };
        let Self { count, began, is_logged, .. } = std::mem::replace(self, ended);
        (is_logged && count > 1).then(|| OutageLine { count, lasts: at.saturating_sub(began) })
    }

    fn add(&mut self, at: u64) {
        if self.count == 0 {
            self.began = at;
        }
        self.count += 1;
    }

    fn line(&mut self, at: u64) -> Option<OutageLine> {
        if self.logged.is_some_and(|logged| at.saturating_sub(logged) < EVERY) {
            return None;
        }
        (self.logged, self.is_logged) = (Some(at), true);
        Some(OutageLine { count: self.count, lasts: at.saturating_sub(self.began) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn lines(log: impl Iterator<Item = Option<OutageLine>>) -> Vec<(u64, u64)> {
        log.flatten().map(|line| (line.count, line.lasts / S)).collect()
    }

    #[test]
    fn failures_are_logged_at_first_and_every_ten_seconds_and_their_end_once() {
        let mut outage = OutageLog::default();
        let tenths = |from: u64, to: u64| (from..to).map(|tenth| tenth * S / 10);
        assert_eq!(
            lines(tenths(0, 251).map(|at| outage.failed(at))),
            [(1, 0), (101, 10), (201, 20)]
        );
        let ends = tenths(251, 260).map(|at| outage.answered(at));
        assert_eq!(lines(ends), [(251, 25)]);
    }

    #[test]
    fn a_source_that_fails_now_and_then_is_logged_every_ten_seconds_too() {
        let mut outage = OutageLog::default();
        let mut log = Vec::new();
        for at in (0..300).map(|tenth| tenth * S / 10) {
            log.push(outage.failed(at));
            log.push(outage.answered(at));
        }
        assert_eq!(lines(log.into_iter()), [(1, 0); 3]);
    }

    #[test]
    fn timers_alone_are_an_outage_once_many_fired_in_a_row() {
        let mut outage = OutageLog::default();
        for _ in 0..3 {
            assert!((1..TIMERS).all(|at| outage.timed_out(at * S).is_none()));
            assert_eq!(outage.answered(TIMERS * S), None);
        }
        let log = (0..40).map(|at| outage.timed_out(at * S));
        assert_eq!(lines(log), [(16, 15), (26, 25), (36, 35)]);
        assert_eq!(lines([outage.answered(40 * S)].into_iter()), [(40, 40)]);
    }
}
