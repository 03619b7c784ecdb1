//! What messages come to: counted one by one, and response times exactly or in bounded memory.

use std::time::Duration;

use fuseline_traces::nanos;

use crate::counts::ValueCounts;
use crate::quantile::{PERCENT, Quantile, Response, quantiles};
use crate::statistics::history::{CallEnd, TimestampHistory};

/// Sums over messages.
#[derive(Clone, Default)]
pub(super) struct MessageSums {
    pub(super) forwarded: u64,
    pub(super) missed: u64,
    pub(super) open: u64,
    /// By source, as [`COLUMNS`](super::COLUMNS) says, without what was refused.
    pub(super) rows: Vec<[u64; 8]>,
    pub(super) responses: ResponseTimes,
}

/// Response times by source.
#[derive(Clone)]
pub(super) enum ResponseTimes {
    Exact(Vec<Vec<Response>>),
    /// In nanoseconds.
    Counted(Vec<ValueCounts>),
}

impl Default for ResponseTimes {
    fn default() -> Self {
        Self::Exact(Vec::new())
    }
}

impl MessageSums {
    /// Sums whose memory is bounded.
    pub(super) fn bounded() -> Self {
        Self { responses: ResponseTimes::Counted(Vec::new()), ..Self::default() }
    }

    /// Counts a timestamp, if it is a message; `fates` are those of its requests.
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
                    self.responses.add(source, response);
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
}

impl ResponseTimes {
    fn add(&mut self, source: usize, response: Duration) {
        match self {
            Self::Exact(times) => {
                if times.len() <= source {
                    times.resize(source + 1, Vec::new());
                }
                times[source].push(Response::exactly(Some(response)));
            }
            Self::Counted(times) => {
                if times.len() <= source {
                    times.resize_with(source + 1, bounded);
                }
                times[source].add(nanos(response), 1);
            }
        }
    }

    /// The quantiles of one source.
    pub(super) fn of(&self, source: usize) -> [Option<Quantile>; 3] {
        match self {
            Self::Exact(times) => quantiles(times.get(source).map_or(&[], Vec::as_slice)),
            Self::Counted(times) => times.get(source).map_or([None; 3], |times| counted(times, 0)),
        }
    }

    /// The quantiles of all, with as many that never end.
    pub(super) fn all(&self, never: u64) -> [Option<Quantile>; 3] {
        match self {
            Self::Exact(times) => {
                let mut all = times.concat();
                let never = usize::try_from(never).unwrap_or(0);
                all.resize(all.len() + never, Response::exactly(None));
                quantiles(&all)
            }
            Self::Counted(times) => {
                let mut all = bounded();
                for times in times {
                    all.extend(times);
                }
                counted(&all, never)
            }
        }
    }
}

fn bounded() -> ValueCounts {
    let mut counts = ValueCounts::default();
    counts.bound();
    counts
}

/// By nearest ranks, as [`quantiles`]; `never` of them are above all others.
fn counted(times: &ValueCounts, never: u64) -> [Option<Quantile>; 3] {
    let total = times.total() + never;
    PERCENT.map(|percent| {
        let rank = total.checked_mul(percent as u64)?.div_ceil(100).max(1);
        (total > 0).then(|| {
            times
                .of_rank(rank)
                .map_or(Quantile::Never, |at| Quantile::Exactly(Duration::from_nanos(at)))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counted_quantiles_are_those_of_exact_times() {
        let mut sums = [ResponseTimes::default(), MessageSums::bounded().responses];
        for n in 0..777_u64 {
            for times in &mut sums {
                times.add((n % 3) as usize, Duration::from_nanos(n * n % 6011));
            }
        }
        let [exact, counted] = &sums;
        for never in [0, 1, 50, 300, 5000] {
            assert_eq!(exact.all(never), counted.all(never), "{never}");
        }
        for source in 0..4 {
            assert_eq!(exact.of(source), counted.of(source), "{source}");
        }
    }
}
