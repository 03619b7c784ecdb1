//! The deadlines of requests, and the times from a message to the due instants of its requests.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use fuseline_traces::{Commit, Decision, Event, Input, OpenRefusal};

/// The greatest number of messages that are remembered with the instants of their opens.
const OPEN: usize = 4096;
/// The number of decimal digits to which the times from the message are rounded. Requests are sent
/// some microseconds after their message.
const DIGITS: u32 = 3;

/// Counts the requests of each source by their deadlines, in nanoseconds.
pub(crate) struct RequestDeadlines {
    commit: Commit,
    of: BTreeMap<u64, Counts>,
    /// The times from a request's message until the request is due, rounded.
    after_open: Counts,
    /// The instants at which the messages were opened.
    opened: BTreeMap<u64, u64>,
}

/// The number of times that each value occurs.
type Counts = BTreeMap<u64, u64>;

impl RequestDeadlines {
    pub(crate) fn new(commit: Commit) -> Self {
        Self { commit, of: BTreeMap::new(), after_open: Counts::new(), opened: BTreeMap::new() }
    }

    pub(crate) fn event(&mut self, event: &Event) {
        match *event {
            Event::Input(Input::Open { at, t, .. }) => {
                self.opened.entry(t).or_insert(at);
                if self.opened.len() > OPEN {
                    self.opened.pop_first();
                }
            }
            Event::Decision(Decision::Request { at, t, p, due }) => {
                self.add(p, due.saturating_sub(at));
                let opened = self.opened.get(&t).copied().unwrap_or(at);
                *self.after_open.entry(rounded(due.saturating_sub(opened))).or_default() += 1;
            }
            Event::Decision(
                Decision::RefuseOpen { t, why: OpenRefusal::Full | OpenRefusal::Deadline, .. }
                | Decision::Final { t, .. }
                | Decision::Miss { t, .. },
            ) => {
                self.opened.remove(&t);
            }
            Event::Decision(Decision::Emit { t, .. }) if self.commit != Commit::Progressive => {
                self.opened.remove(&t);
            }
            _ => {}
        }
    }

    fn add(&mut self, p: u64, deadline: u64) {
        *self.of.entry(p).or_default().entry(deadline).or_default() += 1;
    }

    /// Returns the commonest times from a message until a request is due, at most `most` of them.
    pub(crate) fn commonest(&self, most: usize) -> Vec<u64> {
        let mut counted: Vec<(&u64, &u64)> = self.after_open.iter().collect();
        counted.sort_by_key(|(deadline, count)| (Reverse(**count), **deadline));
        counted.into_iter().take(most).map(|(deadline, _)| *deadline).collect()
    }

    /// Returns the least deadline of a source's requests, the median by nearest rank, and the
    /// greatest, or `None` if the source got no request.
    pub(crate) fn spread(&self, p: u64) -> Option<[u64; 3]> {
        let counts = self.of.get(&p)?;
        let rank = counts.values().sum::<u64>().div_ceil(2);
        let mut passed = 0;
        let median = counts.iter().find_map(|(deadline, count)| {
            passed += count;
            (passed >= rank).then_some(*deadline)
        });
        Some([*counts.first_key_value()?.0, median?, *counts.last_key_value()?.0])
    }
}

/// Rounds to the nearest number with [`DIGITS`] digits.
fn rounded(nanos: u64) -> u64 {
    let unit = 10_u64.pow(nanos.checked_ilog10().unwrap_or(0).saturating_sub(DIGITS - 1));
    nanos.saturating_add(unit / 2) / unit * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_counts_from_the_message() {
        let mut deadlines = RequestDeadlines::new(Commit::Eager);
        deadlines.event(&Event::Input(Input::Open { at: 1_000_000, t: 4, deadline: None }));
        for (at, due) in [(31_000_000, 131_000_000), (31_000_400, 131_000_400)] {
            deadlines.event(&Event::Decision(Decision::Request { at, t: 4, p: 1, due }));
        }
        assert_eq!(deadlines.commonest(3), [130_000_000]);
        assert_eq!(deadlines.spread(1), Some([100_000_000; 3]));
        assert_eq!(
            [0, 9, 1234, 123_499, u64::MAX].map(rounded),
            [0, 9, 1230, 123_000, 18_400_000_000_000_000_000]
        );
    }

    #[test]
    fn a_spread_is_least_median_and_greatest() {
        let mut deadlines = RequestDeadlines::new(Commit::Eager);
        for deadline in [500, 300, 300, 500, 400, 300] {
            deadlines.add(1, deadline);
        }
        deadlines.add(2, 500);
        assert_eq!(deadlines.spread(1), Some([300, 300, 500]));
        assert_eq!(deadlines.spread(2), Some([500; 3]));
        assert_eq!(deadlines.spread(3), None);
    }
}
