//! [`History`]: what was requested of one timestamp and what came, by inputs and decisions alone. It knows no rule.

/// What was requested of one timestamp, what came, and by when more may come.
///
/// Local, priority 0, is requested with the open. Equal histories bind what may follow alike.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct History {
    is_limited: bool,
    /// In ascending order of their priorities.
    sources: Vec<RequestedSource>,
    /// The latest due instant that was forgotten, while it binds.
    latest: Option<u64>,
    /// The same of requests alone, without local's.
    latest_request: Option<u64>,
}

/// A source that was requested.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct RequestedSource {
    p: u64,
    stage: Stage,
    due: Option<u64>,
    /// Whether its timer is live.
    is_armed: bool,
}

/// How far a request came.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Stage {
    Pending,
    Held,
    /// Held although it came too late.
    HeldLate,
    Closed,
}

impl History {
    /// A timestamp just opened; `due` is when local's deadline ends.
    #[must_use]
    pub fn new(due: Option<u64>) -> Self {
        let (latest, latest_request) = (None, None);
        let is_limited = due.is_some();
        let mut history = Self { is_limited, sources: Vec::new(), latest, latest_request };
        history.ask(0, due);
        history
    }

    /// `p` was requested, for an answer before `due`.
    pub fn ask(&mut self, p: u64, due: Option<u64>) {
        let source = self.entry(p);
        *source = RequestedSource { p, stage: Stage::Pending, due, is_armed: due.is_some() };
    }

    /// The result of `p` came; `is_late` says whether it came too late.
    pub fn hold(&mut self, p: u64, is_late: bool) {
        self.entry(p).stage = if is_late { Stage::HeldLate } else { Stage::Held };
    }

    /// Nothing is expected from `p` any more; what it sent stays held.
    pub fn close(&mut self, p: u64) {
        if let Some(source) = self.source_mut(p).filter(|source| source.stage == Stage::Pending) {
            source.stage = Stage::Closed;
        }
    }

    /// The timer of `p` is live no more; its due instant, if it was.
    pub fn disarm(&mut self, p: u64) -> Option<u64> {
        let source = self.source_mut(p).filter(|source| source.is_armed)?;
        source.is_armed = false;
        source.due
    }

    /// Forgets each due instant that binds nothing: those of timers that are not live, but for the latest
    /// of all and the latest of a request, while it lies after `now` and after every live one of its kind.
    pub fn forget(&mut self, now: u64) {
        let (mut latest, mut of_requests) = (self.latest, self.latest_request);
        for source in self.sources.iter_mut().filter(|source| !source.is_armed) {
            let due = source.due.take();
            latest = latest.max(due);
            if source.p > 0 {
                of_requests = of_requests.max(due);
            }
        }
        let armed = self.timers().map(|(_, due)| due).max();
        self.latest = latest.filter(|due| *due > now && Some(*due) > armed);
        let armed = self.timers().filter(|(p, _)| *p > 0).map(|(_, due)| due).max();
        self.latest_request = of_requests.filter(|due| *due > now && Some(*due) > armed);
    }

    /// Whether it was opened with a deadline for local.
    #[must_use]
    pub const fn is_limited(&self) -> bool {
        self.is_limited
    }

    /// Whether `p` was requested.
    #[must_use]
    pub fn is_requested(&self, p: u64) -> bool {
        self.source(p).is_some()
    }

    /// Whether `p` was requested, and neither result nor failure nor timer has come.
    #[must_use]
    pub fn is_pending(&self, p: u64) -> bool {
        self.source(p).is_some_and(|source| source.stage == Stage::Pending)
    }

    /// Whether a result of `p` is available.
    #[must_use]
    pub fn is_held(&self, p: u64) -> bool {
        self.source(p).is_some_and(RequestedSource::is_held)
    }

    /// Whether a result of `p` is available that came too late.
    #[must_use]
    pub fn is_held_late(&self, p: u64) -> bool {
        self.source(p).is_some_and(|source| source.stage == Stage::HeldLate)
    }

    /// Whether local alone was requested.
    #[must_use]
    pub fn is_local_alone(&self) -> bool {
        self.sources.len() == 1
    }

    /// The sources that are pending, ascending.
    #[must_use]
    pub fn pending(&self) -> impl DoubleEndedIterator<Item = u64> {
        let pending = self.sources.iter().filter(|source| source.stage == Stage::Pending);
        pending.map(|source| source.p)
    }

    /// The sources whose results are available, ascending.
    #[must_use]
    pub fn held(&self) -> impl DoubleEndedIterator<Item = u64> {
        self.sources.iter().filter(|source| source.is_held()).map(|source| source.p)
    }

    /// The best available result.
    #[must_use]
    pub fn best(&self) -> Option<u64> {
        self.held().next_back()
    }

    /// Whether something pending outranks `p`.
    #[must_use]
    pub fn may_improve_on(&self, p: u64) -> bool {
        self.pending().next_back().is_some_and(|greatest| greatest > p)
    }

    /// The due instant of the live timer of `p`.
    #[must_use]
    pub fn due(&self, p: u64) -> Option<u64> {
        self.source(p).filter(|source| source.is_armed)?.due
    }

    /// The due instant that `p` was requested with, unless it was forgotten.
    #[must_use]
    pub fn requested_for(&self, p: u64) -> Option<u64> {
        self.source(p)?.due
    }

    /// The live timers, each with its priority and due instant, by ascending priority.
    pub fn timers(&self) -> impl Iterator<Item = (u64, u64)> {
        let armed = self.sources.iter().filter(|source| source.is_armed);
        armed.filter_map(|source| Some((source.p, source.due?)))
    }

    /// Whether every due instant that it ever had is `now` or before it.
    #[must_use]
    pub fn is_over(&self, now: u64) -> bool {
        let dues = self.sources.iter().filter_map(|source| source.due).chain(self.latest);
        dues.max().is_none_or(|latest| latest <= now)
    }

    /// Whether the due instant of every request that was ever admitted for it is `now` or before it.
    #[must_use]
    pub fn are_requests_over(&self, now: u64) -> bool {
        let requests = self.sources.iter().filter(|source| source.p > 0);
        let dues = requests.filter_map(|source| source.due).chain(self.latest_request);
        dues.max().is_none_or(|latest| latest <= now)
    }

    fn source(&self, p: u64) -> Option<&RequestedSource> {
        self.sources.iter().find(|source| source.p == p)
    }

    fn source_mut(&mut self, p: u64) -> Option<&mut RequestedSource> {
        self.sources.iter_mut().find(|source| source.p == p)
    }

    /// The source of this priority, noted now if it was not before.
    fn entry(&mut self, p: u64) -> &mut RequestedSource {
        let index = self.sources.partition_point(|source| source.p < p);
        if self.sources.get(index).is_none_or(|source| source.p != p) {
            let new = RequestedSource { p, stage: Stage::Closed, due: None, is_armed: false };
            self.sources.insert(index, new);
        }
        &mut self.sources[index]
    }
}

impl RequestedSource {
    const fn is_held(&self) -> bool {
        matches!(self.stage, Stage::Held | Stage::HeldLate)
    }
}
