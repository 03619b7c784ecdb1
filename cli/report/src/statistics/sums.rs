//! Counts the outcomes of messages one by one, and their response times.

use std::time::Duration;

use crate::quantile::{Quantile, Response, quantiles};
use crate::statistics::history::{CallEnd, TimestampHistory};

/// Sums over messages.
#[derive(Default)]
pub(super) struct MessageSums {
    pub(super) forwarded: u64,
    pub(super) missed: u64,
    pub(super) open: u64,
    /// The counts by source in the order of [`COLUMNS`](super::COLUMNS), without refused offers.
    pub(super) rows: Vec<[u64; 8]>,
    /// The responses by source.
    responses: Vec<Vec<Response>>,
}

impl MessageSums {
    /// Counts a timestamp if it is a message. `fates` are the fates of its requests.
    pub(super) fn add(&mut self, story: &TimestampHistory, fates: &[u8]) {
        if !story.is_message() {
            return;
        }
        if self.rows.len() < fates.len() {
            self.rows.resize(fates.len(), [0; 8]);
        }
        match story.end {
            Some(end @ CallEnd { source: Some(source), .. }) => {
                self.forwarded += 1;
                if let Some(response) = story.response(end) {
                    self.add_response(source, response);
                }
            }
            Some(CallEnd { source: None, .. }) => self.missed += 1,
            None => self.open += 1,
        }
        for (row, fate) in self.rows.iter_mut().zip(fates).filter(|(_, fate)| **fate > 0) {
            row[0] += 1;
            row[usize::from(*fate)] += 1;
        }
    }

    fn add_response(&mut self, source: usize, response: Duration) {
        if self.responses.len() <= source {
            self.responses.resize(source + 1, Vec::new());
        }
        self.responses[source].push(Response::exactly(Some(response)));
    }

    /// Returns the quantiles of one source's response times.
    pub(super) fn response_of(&self, source: usize) -> [Option<Quantile>; 3] {
        quantiles(self.responses.get(source).map_or(&[], Vec::as_slice))
    }

    /// Returns the quantiles of all responses and of `never` more that never end.
    pub(super) fn response_of_all(&self, never: u64) -> [Option<Quantile>; 3] {
        let mut all = self.responses.concat();
        let never = usize::try_from(never).unwrap_or(0);
        all.resize(all.len() + never, Response::exactly(None));
        quantiles(&all)
    }
}
