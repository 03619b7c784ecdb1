//! Decides when to log that a source gives no results: at first, every ten seconds, and when it is
//! over, but not for each message.

/// The least time, in ns, between two lines about a source.
const EVERY: u64 = 10_000_000_000;
/// The number of timers in a row that count as an outage. A single failure counts as one, because
/// it says that no result will come.
const TIMERS: u64 = 16;

/// The requests of one source that ended without a result since its last one.
#[derive(Clone, Copy, Default)]
pub(crate) struct OutageLog {
    count: u64,
    /// The instant when the first of them ended.
    began: u64,
    /// The instant of the last line, if there was one.
    logged: Option<u64>,
    /// `true` if that line was about this outage.
    is_logged: bool,
}

/// The contents of a line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct OutageLine {
    /// The number of requests in a row without a result.
    pub(crate) count: u64,
    /// The time since the first of them ended, in ns.
    pub(crate) lasts: u64,
}

impl OutageLog {
    /// Notes a failed request. Returns what to log about it, if anything (F4).
    pub(crate) fn failed(&mut self, at: u64) -> Option<OutageLine> {
        self.add(at);
        self.line(at)
    }

    /// Notes a request whose timer fired. Returns what to log about it, if anything (F5).
    pub(crate) fn timed_out(&mut self, at: u64) -> Option<OutageLine> {
        self.add(at);
        if self.count < TIMERS && !self.is_logged { None } else { self.line(at) }
    }

    /// Notes a result, in time or late. Returns the outage that it ends, if that was logged and had
    /// more than one request (F3).
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
    fn failures_are_logged_at_first_and_at_the_end() {
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
    fn occasional_failures_are_logged_every_ten_seconds() {
        let mut outage = OutageLog::default();
        let mut log = Vec::new();
        for at in (0..300).map(|tenth| tenth * S / 10) {
            log.push(outage.failed(at));
            log.push(outage.answered(at));
        }
        assert_eq!(lines(log.into_iter()), [(1, 0); 3]);
    }

    #[test]
    fn many_timers_in_a_row_are_an_outage() {
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
