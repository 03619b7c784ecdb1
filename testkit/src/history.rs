//! [`History`]: records what was requested for one timestamp and what came, from inputs and decisions alone. It knows no rule.

/// Records what was requested for one timestamp, what came, and by when more may come.
///
/// Local, priority 0, is requested with the open. Two histories are equal if they allow the same
/// future.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct History {
    is_limited: bool,
    /// The sources in ascending order of priority.
    sources: Vec<RequestedSource>,
    /// The latest due instant that was forgotten, while it still matters.
    latest: Option<u64>,
    /// The latest forgotten due instant of a request, without local's.
    latest_request: Option<u64>,
}

/// A source that was requested.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct RequestedSource {
    p: u64,
    stage: Stage,
    due: Option<u64>,
    /// `true` if its timer is live.
    is_armed: bool,
}

/// The stage of a request.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Stage {
    Pending,
    Held,
    /// The result is held although it came too late.
    HeldLate,
    Closed,
}

impl History {
    /// Creates the history of a timestamp that was just opened. `due` is the end of local's
    /// deadline, in ns.
    #[must_use]
    pub fn new(due: Option<u64>) -> Self {
        let (latest, latest_request) = (None, None);
        let is_limited = due.is_some();
        let mut history = Self { is_limited, sources: Vec::new(), latest, latest_request };
        history.ask(0, due);
        history
    }

    /// Notes that `p` was requested, with the due instant `due` in ns.
    pub fn ask(&mut self, p: u64, due: Option<u64>) {
        let source = self.entry(p);
        *source = RequestedSource { p, stage: Stage::Pending, due, is_armed: due.is_some() };
    }

    /// Notes the result of `p`. `is_late` is `true` if it came too late.
    pub fn hold(&mut self, p: u64, is_late: bool) {
        self.entry(p).stage = if is_late { Stage::HeldLate } else { Stage::Held };
    }

    /// Notes that nothing more is expected from `p`. A result that it sent stays held.
    pub fn close(&mut self, p: u64) {
        if let Some(source) = self.source_mut(p).filter(|source| source.stage == Stage::Pending) {
            source.stage = Stage::Closed;
        }
    }

    /// Notes that the timer of `p` is no longer live. Returns its due instant if it was.
    pub fn disarm(&mut self, p: u64) -> Option<u64> {
        let source = self.source_mut(p).filter(|source| source.is_armed)?;
        source.is_armed = false;
        source.due
    }

    /// Forgets each due instant that no longer matters.
    ///
    /// It forgets the due instants of timers that are not live. Two of them stay: the latest of
    /// all, and the latest of a request. Each stays while it lies after `now` and after every live
    /// due instant of its kind.
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

    /// Returns `true` if the timestamp was opened with a deadline for local.
    #[must_use]
    pub const fn is_limited(&self) -> bool {
        self.is_limited
    }

    /// Returns `true` if `p` was requested.
    #[must_use]
    pub fn is_requested(&self, p: u64) -> bool {
        self.source(p).is_some()
    }

    /// Returns `true` if `p` was requested, and no result, failure or timer has come.
    #[must_use]
    pub fn is_pending(&self, p: u64) -> bool {
        self.source(p).is_some_and(|source| source.stage == Stage::Pending)
    }

    /// Returns `true` if a result of `p` is available.
    #[must_use]
    pub fn is_held(&self, p: u64) -> bool {
        self.source(p).is_some_and(RequestedSource::is_held)
    }

    /// Returns `true` if a result of `p` is available that came too late.
    #[must_use]
    pub fn is_held_late(&self, p: u64) -> bool {
        self.source(p).is_some_and(|source| source.stage == Stage::HeldLate)
    }

    /// Returns `true` if only local was requested.
    #[must_use]
    pub fn is_local_alone(&self) -> bool {
        self.sources.len() == 1
    }

    /// Returns the sources that are pending, ascending.
    #[must_use]
    pub fn pending(&self) -> impl DoubleEndedIterator<Item = u64> {
        let pending = self.sources.iter().filter(|source| source.stage == Stage::Pending);
        pending.map(|source| source.p)
    }

    /// Returns the sources whose results are available, ascending.
    #[must_use]
    pub fn held(&self) -> impl DoubleEndedIterator<Item = u64> {
        self.sources.iter().filter(|source| source.is_held()).map(|source| source.p)
    }

    /// Returns the source of the best available result.
    #[must_use]
    pub fn best(&self) -> Option<u64> {
        self.held().next_back()
    }

    /// Returns `true` if a source that outranks `p` is pending.
    #[must_use]
    pub fn may_improve_on(&self, p: u64) -> bool {
        self.pending().next_back().is_some_and(|greatest| greatest > p)
    }

    /// Returns the due instant of the live timer of `p`, in ns.
    #[must_use]
    pub fn due(&self, p: u64) -> Option<u64> {
        self.source(p).filter(|source| source.is_armed)?.due
    }

    /// Returns the due instant with which `p` was requested, in ns, unless it was forgotten.
    #[must_use]
    pub fn requested_for(&self, p: u64) -> Option<u64> {
        self.source(p)?.due
    }

    /// Returns the live timers as priorities and due instants, in ascending priority.
    pub fn timers(&self) -> impl Iterator<Item = (u64, u64)> {
        let armed = self.sources.iter().filter(|source| source.is_armed);
        armed.filter_map(|source| Some((source.p, source.due?)))
    }

    /// Returns `true` if `now` has reached every due instant that the timestamp ever had.
    #[must_use]
    pub fn is_over(&self, now: u64) -> bool {
        let dues = self.sources.iter().filter_map(|source| source.due).chain(self.latest);
        dues.max().is_none_or(|latest| latest <= now)
    }

    /// Returns `true` if `now` has reached the due instant of every request that was ever admitted
    /// for the timestamp.
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

    /// Returns the source of this priority, and adds it if it is new.
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
