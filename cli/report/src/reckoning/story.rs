//! What happened to one timestamp: its message's end and each source's request.

use std::time::Duration;

#[derive(Default)]
pub(super) struct Story {
    /// The last open that no refusal has followed.
    pub(super) offered: Option<u64>,
    pub(super) opened: Option<u64>,
    pub(super) end: Option<End>,
    /// By source, as far as they were mentioned.
    pub(super) calls: Vec<Call>,
}

#[derive(Clone, Copy)]
pub(super) struct End {
    pub(super) at: u64,
    /// Whose result went; none if the message was missed.
    pub(super) source: Option<usize>,
}

/// One request, or a source that was not asked.
#[derive(Clone, Copy, Default)]
pub(super) struct Call {
    pub(super) is_asked: bool,
    pub(super) due: Option<u64>,
    pub(super) sealed: Option<(Seal, u64)>,
    /// When its first result came, whatever became of it.
    pub(super) arrived: Option<u64>,
    /// A result that no decision has followed.
    pub(super) answered: Option<u64>,
    /// A failure that was not dropped, so far.
    pub(super) failing: Option<u64>,
}

/// How a request ceased to be pending.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Seal {
    InTime,
    Late,
    Failed,
    Superseded,
}

/// The place in [`COLUMNS`](super::COLUMNS).
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    Forwarded = 1,
    Discarded = 2,
    Late = 3,
    Failed = 4,
    Superseded = 5,
    Open = 6,
}

impl Story {
    pub(super) fn call(&mut self, source: usize) -> &mut Call {
        if self.calls.len() <= source {
            self.calls.resize(source + 1, Call::default());
        }
        &mut self.calls[source]
    }

    /// The open that no refusal followed was accepted.
    pub(super) fn accept(&mut self) {
        self.opened = self.opened.or(self.offered.take());
    }

    /// When its message came, if it was taken on.
    pub(super) fn begin(&self) -> Option<u64> {
        self.opened.or(self.offered)
    }

    pub(super) fn is_message(&self) -> bool {
        let is_asked = || self.calls.iter().any(|call| call.is_asked);
        self.begin().is_some() || self.end.is_some() || is_asked()
    }

    pub(super) fn response(&self, end: End) -> Option<Duration> {
        Some(Duration::from_nanos(end.at.saturating_sub(self.begin()?)))
    }

    pub(super) fn is_asked(&self, source: usize) -> bool {
        source == 0 || self.calls.get(source).is_some_and(|call| call.is_asked)
    }

    /// What became of the source's request, if it was asked.
    pub(super) fn fate(&self, source: usize, is_observed: bool) -> Option<Fate> {
        if !self.is_asked(source) {
            return None;
        }
        let call = self.calls.get(source).copied().unwrap_or_default();
        Some(match (call.outcome(self.end.filter(|_| is_observed)), self.end) {
            (Some(Seal::InTime), Some(end)) if end.source == Some(source) => Fate::Forwarded,
            (Some(Seal::InTime), Some(_)) => Fate::Discarded,
            (Some(Seal::Late), _) => Fate::Late,
            (Some(Seal::Failed), _) => Fate::Failed,
            (Some(Seal::Superseded), _) | (None, Some(_)) => Fate::Superseded,
            (Some(Seal::InTime) | None, None) => Fate::Open,
        })
    }
}

impl Call {
    /// What is sealed stays so: a held result's timer changes nothing.
    pub(super) fn seal(&mut self, seal: Seal, at: u64) {
        self.sealed.get_or_insert((seal, at));
    }

    /// A failure that was not dropped was accepted (F4).
    pub(super) fn settle(&mut self) {
        if let Some(at) = self.failing.take() {
            self.seal(Seal::Failed, at);
        }
    }

    /// How it ceased to be pending, if it did; by its own lines alone if `end`, its message's, is
    /// given and no decision tells.
    pub(super) fn outcome(mut self, end: Option<End>) -> Option<Seal> {
        self.settle();
        let is_late = |at: u64| self.due.is_some_and(|due| due <= at);
        match (self.sealed, self.answered, end) {
            (Some((seal, _)), ..) => Some(seal),
            (None, Some(at), Some(end)) if at <= end.at && !is_late(at) => Some(Seal::InTime),
            (None, _, Some(end)) if is_late(end.at) => Some(Seal::Late),
            (None, ..) => None,
        }
    }
}
