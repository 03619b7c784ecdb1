//! The history of one timestamp: the end of its message, and each source's request.

use std::time::Duration;

#[derive(Default)]
pub(super) struct TimestampHistory {
    /// The instant of the last open that no refusal has followed.
    pub(super) offered: Option<u64>,
    pub(super) opened: Option<u64>,
    pub(super) end: Option<CallEnd>,
    /// The last output of a timestamp that is not final yet, under progressive.
    pub(super) output: Option<CallEnd>,
    /// The requests by source, as far as the trace mentions them.
    pub(super) calls: Vec<RequestHistory>,
}

#[derive(Clone, Copy)]
pub(super) struct CallEnd {
    pub(super) at: u64,
    /// The source whose result was sent, or `None` if the message was missed.
    pub(super) source: Option<usize>,
}

/// A request, or a source that got none.
#[derive(Clone, Copy, Default)]
pub(super) struct RequestHistory {
    pub(super) is_requested: bool,
    pub(super) due: Option<u64>,
    pub(super) ended: Option<(RequestEnd, u64)>,
    /// The instant of its first result, whatever the outcome of that result.
    pub(super) arrived: Option<u64>,
    /// The instant of a result that no decision has followed.
    pub(super) answered: Option<u64>,
    /// The instant of a failure that has not been dropped.
    pub(super) failing: Option<u64>,
}

/// The way in which a request ceased to be pending.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum RequestEnd {
    InTime,
    Late,
    Failed,
    Superseded,
}

/// The index in [`COLUMNS`](super::COLUMNS).
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum OutcomeColumn {
    Forwarded = 1,
    Discarded = 2,
    Late = 3,
    Failed = 4,
    Superseded = 5,
    Open = 6,
}

impl TimestampHistory {
    pub(super) fn call(&mut self, source: usize) -> &mut RequestHistory {
        if self.calls.len() <= source {
            self.calls.resize(source + 1, RequestHistory::default());
        }
        &mut self.calls[source]
    }

    /// Accepts the open that no refusal followed.
    pub(super) fn accept(&mut self) {
        self.opened = self.opened.or(self.offered.take());
    }

    /// Returns the instant of its message, if the message was accepted.
    pub(super) fn begin(&self) -> Option<u64> {
        self.opened.or(self.offered)
    }

    pub(super) fn is_message(&self) -> bool {
        let is_requested = || self.calls.iter().any(|call| call.is_requested);
        self.begin().is_some() || self.end.is_some() || is_requested()
    }

    pub(super) fn response(&self, end: CallEnd) -> Option<Duration> {
        Some(Duration::from_nanos(end.at.saturating_sub(self.begin()?)))
    }

    pub(super) fn is_requested(&self, source: usize) -> bool {
        source == 0 || self.calls.get(source).is_some_and(|call| call.is_requested)
    }

    /// Returns the outcome of each source's request as its index in [`COLUMNS`](super::COLUMNS), or
    /// 0 for a source without a request.
    pub(super) fn fates(&self, sources: usize, is_observed: bool) -> Vec<u8> {
        let is_message = self.is_message();
        let fate = |source| self.request_outcome(source, is_observed).filter(|_| is_message);
        (0..sources).map(|source| fate(source).map_or(0, |fate| fate as u8)).collect()
    }

    /// Returns the outcome of the source's request, if there was one.
    pub(super) fn request_outcome(
        &self,
        source: usize,
        is_observed: bool,
    ) -> Option<OutcomeColumn> {
        if !self.is_requested(source) {
            return None;
        }
        let call = self.calls.get(source).copied().unwrap_or_default();
        Some(match (call.outcome(self.end.filter(|_| is_observed)), self.end) {
            (Some(RequestEnd::InTime), Some(end)) if end.source == Some(source) => {
                OutcomeColumn::Forwarded
            }
            (Some(RequestEnd::InTime), Some(_)) => OutcomeColumn::Discarded,
            (Some(RequestEnd::Late), _) => OutcomeColumn::Late,
            (Some(RequestEnd::Failed), _) => OutcomeColumn::Failed,
            (Some(RequestEnd::Superseded), _) | (None, Some(_)) => OutcomeColumn::Superseded,
            (Some(RequestEnd::InTime) | None, None) => OutcomeColumn::Open,
        })
    }
}

impl RequestHistory {
    /// Ends a request, unless it has ended already: the timer of a held result changes nothing.
    pub(super) fn end_with(&mut self, request_end: RequestEnd, at: u64) {
        self.ended.get_or_insert((request_end, at));
    }

    /// Accepts a failure that was not dropped (F4).
    pub(super) fn settle(&mut self) {
        if let Some(at) = self.failing.take() {
            self.end_with(RequestEnd::Failed, at);
        }
    }

    /// Returns how the request ceased to be pending, if it did. If no decision shows this but its
    /// message has ended (`end`), the request's own lines decide.
    pub(super) fn outcome(mut self, end: Option<CallEnd>) -> Option<RequestEnd> {
        self.settle();
        let is_late = |at: u64| self.due.is_some_and(|due| due <= at);
        match (self.ended, self.answered, end) {
            (Some((request_end, _)), ..) => Some(request_end),
            (None, Some(at), Some(end)) if at <= end.at && !is_late(at) => Some(RequestEnd::InTime),
            (None, _, Some(end)) if is_late(end.at) => Some(RequestEnd::Late),
            (None, ..) => None,
        }
    }
}
