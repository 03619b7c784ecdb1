//! Folds the attempts of a request into the one request that the rules know.
//!
//! A hedge, a retry or a replica of equal rank is another attempt of the same request. The first
//! request counts, with its due instant; the first result counts; and the request has failed when
//! all attempts have.

use std::collections::{BTreeMap, BTreeSet};

/// One request line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct RequestAttempt {
    pub(super) p: u64,
    pub(super) at: u64,
    pub(super) due: u64,
    /// The number of the attempt, or `None` for the request as a whole.
    pub(super) attempt: Option<u8>,
}

/// One failure line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct AttemptFailure {
    pub(super) p: u64,
    pub(super) at: u64,
    /// The number of the attempt, or `None` if the request as a whole has failed.
    pub(super) attempt: Option<u8>,
}

/// Returns the requests of the rules: source, instant and due instant. A source has one, or all of
/// them if one attempt is requested twice, which no rule explains.
pub(super) fn folded_requests(requests: &[RequestAttempt]) -> Vec<(u64, u64, u64)> {
    let plain = |request: &RequestAttempt| (request.p, request.at, request.due);
    // Most traces have no attempts, so there is nothing to fold.
    if requests.iter().all(|request| request.attempt.is_none()) {
        return requests.iter().map(plain).collect();
    }
    let mut by_source: BTreeMap<u64, Vec<&RequestAttempt>> = BTreeMap::new();
    for request in requests {
        by_source.entry(request.p).or_default().push(request);
    }
    let mut folded = Vec::new();
    for attempts in by_source.values() {
        let distinct: BTreeSet<_> = attempts.iter().map(|request| request.attempt).collect();
        if distinct.len() < attempts.len() {
            folded.extend(attempts.iter().map(|request| plain(request)));
        } else {
            // If several are at one instant, the first in the trace counts.
            let first = attempts.iter().min_by_key(|request| request.at);
            folded.extend(first.map(|request| plain(request)));
        }
    }
    folded
}

/// Returns the failures of the rules: those of whole requests, and the last of the attempts'
/// failures if each attempt has failed.
pub(super) fn folded_failures(
    requests: &[RequestAttempt],
    failures: &[AttemptFailure],
) -> Vec<(u64, u64)> {
    let mut folded: Vec<(u64, u64)> = Vec::new();
    // The first failure of each attempt, by source.
    let mut failed: BTreeMap<u64, BTreeMap<u8, u64>> = BTreeMap::new();
    for AttemptFailure { p, at, attempt } in failures {
        match attempt {
            None => folded.push((*p, *at)),
            Some(attempt) => {
                let first = failed.entry(*p).or_default().entry(*attempt).or_insert(*at);
                *first = (*first).min(*at);
            }
        }
    }
    for (p, failed) in failed {
        let mut attempts = requests.iter().filter(|request| request.p == p).peekable();
        if attempts.peek().is_none() {
            continue;
        }
        // A request as a whole fails by a line of its own.
        let ends: Option<Vec<u64>> =
            attempts.map(|request| failed.get(&request.attempt?).copied()).collect();
        folded.extend(ends.into_iter().flatten().max().map(|at| (p, at)));
    }
    folded
}
