//! Computes which of the same requests each policy sends.

use fuseline_report::RequestRow;
use fuseline_report::policies::ComparedPolicy;

/// The bytes by source. Local sends none.
pub(super) struct SentBytes {
    /// The bytes of the requests that were sent.
    sent: Vec<u64>,
    /// The bytes if fusion had cancelled no request. Each is assumed to cost as much as those that
    /// were begun.
    needed: Vec<u64>,
    /// `true` for each source whose bytes are all known. An answered request was sent whole, but
    /// part of any other request may be missing.
    is_whole: Vec<bool>,
}

impl SentBytes {
    /// Creates the counts. `begun` has the number of calls begun to each cloud.
    pub(super) fn new(rows: &[RequestRow], sent: Vec<u64>, begun: &[u64]) -> Self {
        let begun = |i: usize| i.checked_sub(1).and_then(|i| begun.get(i)).copied();
        let needed = rows.iter().zip(&sent).enumerate().map(|(i, (row, sent))| {
            (row.requests() * sent).checked_div(begun(i).unwrap_or(0)).unwrap_or(0)
        });
        let is_whole = rows.iter().enumerate().map(|(i, row)| {
            i == 0 || (begun(i) == Some(row.requests()) && row.answered() == row.requests())
        });
        Self { needed: needed.collect(), is_whole: is_whole.collect(), sent }
    }

    /// Returns the bytes that a policy sends, and `true` if there may be more.
    pub(super) fn of(&self, policy: &ComparedPolicy) -> (u64, bool) {
        let is_at_least = match *policy {
            ComparedPolicy::Fusion | ComparedPolicy::LocalOnly => false,
            ComparedPolicy::CloudOnly(source) => !self.is_whole[source],
            // These policies make every call, but fusion may have cancelled some before they were
            // sent.
            ComparedPolicy::Constant(_)
            | ComparedPolicy::FirstWins
            | ComparedPolicy::Progressive(_) => !self.is_whole.iter().all(|is_whole| *is_whole),
        };
        (policy.needs(&self.needed).unwrap_or_else(|| self.sent.iter().sum()), is_at_least)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use fuseline_report::COLUMNS;

    use super::*;
    use fuseline_report::policies::ConstantPolicy;

    /// Returns a row of requests, some answered and the others cancelled.
    fn row(p: u64, answered: u64, cancelled: u64) -> RequestRow {
        let mut counts = [0; COLUMNS.len()];
        let of = |word: &str| COLUMNS.iter().position(|(name, _)| *name == word);
        counts[of("requests").expect("a column")] = answered + cancelled;
        counts[of("discarded").expect("a column")] = answered;
        counts[of("superseded").expect("a column")] = cancelled;
        RequestRow { p, counts, response: [None; 3] }
    }

    /// A rival policy pays for the requests that fusion cancelled before they were sent. West's
    /// requests have 100 bytes and east's have 1000 (D11).
    #[test]
    fn a_rival_sends_each_request_that_fusion_cancelled_before_it_was_sent() {
        for (answered, cancelled, begun) in [(30, 0, 30), (20, 10, 30), (20, 10, 25), (0, 9, 3)] {
            let rows = [row(0, 30, 0), row(1, answered, cancelled), row(2, 40, 0)];
            let sent = SentBytes::new(&rows, vec![0, 100 * begun, 40_000], &[begun, 40]);
            let west = 100 * (answered + cancelled);
            let is_open = begun < answered + cancelled || cancelled > 0;
            let constant = ConstantPolicy { deadline: Duration::ZERO, priorities: vec![1, 2] };
            for (policy, expected) in [
                (ComparedPolicy::Fusion, (100 * begun + 40_000, false)),
                (ComparedPolicy::LocalOnly, (0, false)),
                (ComparedPolicy::CloudOnly(1), (west, is_open)),
                (ComparedPolicy::CloudOnly(2), (40_000, false)),
                (ComparedPolicy::FirstWins, (west + 40_000, is_open)),
                (ComparedPolicy::Progressive(vec![1, 2]), (west + 40_000, is_open)),
                (ComparedPolicy::Constant(constant), (100 * begun + 40_000, is_open)),
            ] {
                assert_eq!(sent.of(&policy), expected, "{policy:?} of {answered} and {cancelled}");
            }
        }
    }
}
