//! Whether the rules can explain what was observed of one timestamp.
//!
//! All orders of all facts need not be tried. Three things are true of every explanation and leave few to try:
//!
//! - **Requests may come as early as they can.** All of them precede the retirement, and one pending source more
//!   never brings it forward (F3, F6).
//! - **A source closes once.** What else comes from it is dropped, and only has to find a place after that. So a source
//!   is pending to the end, held, failed or fired, and each of these is possible within one interval ([`ObservedSource`]).
//! - **Later is better.** Until the retirement something pending outranks all that is held, and something is pending
//!   (P4, P7). Of the ways that a source may close, the one that leaves it pending longest serves the others best.
//!   The one thing that must not be late is, under eager, a cloud's timer that is to find nothing available: all such
//!   fire before the first result is held. So the instant between the two, the *turn*, is tried.
//!
//! What retires the timestamp, when it does and where the turn is are tried in turn: for `n` clouds at most
//! `2n + 4` causes, `3n + 4` instants and `n + 2` turns, each in O(`n`²) steps. Nothing depends on how many events overlap.

/// An instant in the arithmetic of intervals, wide enough for sums of any four numbers of a trace.
pub(super) type WideInstant = u128;

/// After all instants.
pub(super) const NEVER: WideInstant = WideInstant::MAX;

/// No instant of a trace, with all that may be added to it, comes after this.
pub(super) const LAST: WideInstant = 1 << 67;

/// Local and as many clouds as a header may have.
const SOURCES: usize = 16;

/// From the first instant to the last.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct InstantRange {
    pub(super) from: WideInstant,
    pub(super) to: WideInstant,
}

/// A timer of one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct SourceTimer {
    /// When it may be served.
    pub(super) served: InstantRange,
    /// Until when it may stay unserved: to the end of that, or for ever if the trace ends before.
    pub(super) by: WideInstant,
}

/// One source of a timestamp: when it was requested, and what came of it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ObservedSource {
    /// The earliest instant of its request.
    pub(super) requested: WideInstant,
    pub(super) timer: Option<SourceTimer>,
    /// The earliest instant at which a result may have come.
    pub(super) result: Option<WideInstant>,
    /// The earliest instant at which a failure may have come.
    pub(super) failure: Option<WideInstant>,
    /// The earliest of the instants by which its results and failures have come at the latest.
    pub(super) last: WideInstant,
}

/// All that was observed of one timestamp, but what came out of it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct ObservedFacts {
    pub(super) is_eager: bool,
    /// The earliest instant of its open.
    pub(super) open: WideInstant,
    /// Local and the requested clouds, in ascending priority.
    pub(super) sources: Vec<ObservedSource>,
}

/// What comes out of a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum RetirementOutput {
    /// The result of the source with this index.
    Emit(usize),
    Miss,
}

/// The step that retires a timestamp: whose, and which.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum RetirementStep {
    Result(usize),
    Failure(usize),
    Timer(usize),
}

/// What a source must be just before the retirement.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum SourceRole {
    Pending,
    Held,
    /// Failed or fired.
    Closed,
    /// Pending, or held with its timer running on.
    Live,
    NotHeld,
    Any,
}

impl ObservedFacts {
    /// Whether some explanation has this output, by a step at an instant of `when`.
    pub(super) fn yields(&self, output: RetirementOutput, when: InstantRange) -> bool {
        self.steps(output, when).next().is_some()
    }

    /// The first and the last instant of a step that has this output in some explanation.
    pub(super) fn span(&self, output: RetirementOutput) -> Option<InstantRange> {
        // Where there is one, the first is among those that are tried.
        let from = self.steps(output, InstantRange { from: 0, to: LAST }).min()?;
        let (mut to, mut beyond) = (from, LAST + 1);
        while to + 1 < beyond {
            let middle = to + (beyond - to) / 2;
            let is_later = self.yields(output, InstantRange { from: middle, to: LAST });
            (to, beyond) = if is_later { (middle, beyond) } else { (to, middle) };
        }
        Some(InstantRange { from, to })
    }

    /// Of the instants that are tried, those of steps that have this output in some explanation.
    fn steps(
        &self,
        output: RetirementOutput,
        when: InstantRange,
    ) -> impl Iterator<Item = WideInstant> {
        self.causes(output).into_iter().flat_map(move |cause| {
            let step = self.step(cause, output);
            let from = step.from.max(when.from).max(self.ready());
            let when = InstantRange { from, to: step.to.min(when.to) };
            self.instants(when).filter(move |at| {
                let roles = |q| self.role(cause, output, q);
                self.turns(*at).any(|turn| self.is_timeline(*at, turn, roles))
            })
        })
    }

    /// Whether some explanation leaves the timestamp open.
    pub(super) fn stays_open(&self) -> bool {
        let end = NEVER - 1;
        self.turns(end).any(|turn| self.is_timeline(end, turn, |_| SourceRole::Any))
    }

    /// The earliest instant at which everything was requested, as it must be before the retirement.
    pub(super) fn ready(&self) -> WideInstant {
        self.sources.iter().map(|source| source.requested).fold(self.open, WideInstant::max)
    }

    /// The steps that may end in this output (F3, F6).
    fn causes(&self, output: RetirementOutput) -> Vec<RetirementStep> {
        let all = 0..self.sources.len();
        match output {
            RetirementOutput::Miss => {
                all.flat_map(|q| [RetirementStep::Failure(q), RetirementStep::Timer(q)]).collect()
            }
            RetirementOutput::Emit(best) => {
                let above = all.clone().skip(best + 1);
                let frees = above
                    .clone()
                    .flat_map(|q| [RetirementStep::Failure(q), RetirementStep::Timer(q)]);
                // Eager: the best available, whoever's timer it is.
                let commits = all.take(best + 1).skip(1).map(RetirementStep::Timer);
                let commits = commits.filter(|_| self.is_eager);
                std::iter::once(RetirementStep::Result(best)).chain(frees).chain(commits).collect()
            }
        }
    }

    /// When a step may happen.
    fn step(&self, cause: RetirementStep, output: RetirementOutput) -> InstantRange {
        match cause {
            RetirementStep::Result(q) => self.sources[q].returns(),
            RetirementStep::Failure(q) => self.sources[q].fails(),
            // What is held may have been followed by anything: it is dropped.
            RetirementStep::Timer(q) if output == RetirementOutput::Emit(q) => {
                self.sources[q].serves()
            }
            RetirementStep::Timer(q) if self.role(cause, output, q) == SourceRole::Live => {
                self.sources[q].serves()
            }
            RetirementStep::Timer(q) => self.sources[q].fires(),
        }
    }

    /// What a source must be for the cause to have this output.
    fn role(&self, cause: RetirementStep, output: RetirementOutput, q: usize) -> SourceRole {
        let by = match cause {
            RetirementStep::Result(q) | RetirementStep::Failure(q) | RetirementStep::Timer(q) => q,
        };
        let best = match output {
            RetirementOutput::Miss => {
                return if q == by { SourceRole::Pending } else { SourceRole::Closed };
            }
            RetirementOutput::Emit(best) => best,
        };
        let commits = self.is_eager && matches!(cause, RetirementStep::Timer(by) if by > 0);
        match cause {
            RetirementStep::Result(_) if q == best => SourceRole::Pending,
            _ if q == best => SourceRole::Held,
            _ if q == by && by > best => SourceRole::Pending,
            _ if q == by => SourceRole::Live,
            _ if q > best && commits => SourceRole::NotHeld,
            _ if q > best => SourceRole::Closed,
            _ => SourceRole::Any,
        }
    }

    /// The instants in `when` to try: its beginning, and wherever something becomes possible.
    fn instants(&self, when: InstantRange) -> impl Iterator<Item = WideInstant> {
        let begins = self.sources.iter().flat_map(|source| {
            [source.returns(), source.fails(), source.fires()].map(|span| span.from)
        });
        let later = begins.filter(move |begin| when.from < *begin && *begin <= when.to);
        Some(when.from).filter(|from| *from <= when.to).into_iter().chain(later)
    }

    /// The turns to try: as late as each result may be held.
    fn turns(&self, at: WideInstant) -> impl Iterator<Item = WideInstant> {
        let held = self.sources.iter().map(move |source| source.returns().to.min(at));
        std::iter::once(at).chain(held.filter(|_| self.is_eager))
    }

    /// Whether all sources can be what they must be just before a retirement `at` then, the turn being at `turn`.
    fn is_timeline(
        &self,
        at: WideInstant,
        turn: WideInstant,
        role: impl Fn(usize) -> SourceRole,
    ) -> bool {
        // When each is pending, from the highest source down.
        let (mut few, mut many) = ([InstantRange { from: 0, to: 0 }; SOURCES], Vec::new());
        let pending = if let Some(few) = few.get_mut(..self.sources.len()) {
            few
        } else {
            many.resize(self.sources.len(), InstantRange { from: 0, to: 0 });
            &mut many[..]
        };
        for (known, (q, source)) in self.sources.iter().enumerate().rev().enumerate() {
            let Some(until) = self.lasts(q, at, turn, role(q), &pending[..known]) else {
                return false;
            };
            pending[known] = InstantRange { from: source.requested, to: until };
        }
        // P7: something always is pending.
        covers(pending, self.open, at)
    }

    /// Until when a source can be pending at the latest, as far as those above it are `pending`; none if it cannot be what it
    /// must be.
    fn lasts(
        &self,
        q: usize,
        at: WideInstant,
        turn: WideInstant,
        role: SourceRole,
        pending: &[InstantRange],
    ) -> Option<WideInstant> {
        use SourceRole::{Any, Closed, Held, Live, NotHeld, Pending};
        let source = &self.sources[q];
        let before = |span: InstantRange| {
            let to = span.to.min(at);
            (span.from <= to).then_some(to)
        };
        let outlasts = at <= source.patience();
        if matches!(role, Pending | Live | NotHeld | Any) && outlasts && at <= source.last {
            return Some(NEVER);
        }
        // A cloud's timer that finds something available commits it.
        let commits = self.is_eager && q > 0;
        let mut latest = None;
        if matches!(role, Held | Live | Any) && (outlasts || !commits) {
            let held = before(source.returns()).filter(|until| *until >= turn || !self.is_eager);
            // P4: something pending outranks it from then on.
            latest = held.filter(|until| covers(pending, *until, at));
        }
        if matches!(role, Closed | NotHeld | Any) {
            let mut fired = source.fires();
            if commits {
                fired.to = fired.to.min(turn);
            }
            latest = latest.max(before(source.fails())).max(before(fired));
        }
        latest
    }
}

impl ObservedSource {
    /// Until when its timer may stay unserved.
    fn patience(&self) -> WideInstant {
        self.timer.map_or(NEVER, |timer| timer.by)
    }

    /// Until when it may be pending.
    pub(super) fn lasts(&self) -> WideInstant {
        self.last.min(self.patience())
    }

    /// When a result of it may close it while its timer is live.
    pub(super) fn returns(&self) -> InstantRange {
        self.closes(self.result, self.patience())
    }

    /// When a failure may close it.
    pub(super) fn fails(&self) -> InstantRange {
        self.closes(self.failure, self.patience())
    }

    /// When its timer may close it.
    pub(super) fn fires(&self) -> InstantRange {
        match self.timer {
            Some(timer) => self.closes(Some(timer.served.from), timer.served.to),
            None => InstantRange { from: NEVER, to: 0 },
        }
    }

    /// When its timer may be served, its result perhaps available.
    fn serves(&self) -> InstantRange {
        match self.timer {
            Some(timer) => {
                InstantRange { from: self.requested.max(timer.served.from), to: timer.served.to }
            }
            None => InstantRange { from: NEVER, to: 0 },
        }
    }

    /// From an event on, while what else came can still come after it.
    fn closes(&self, from: Option<WideInstant>, by: WideInstant) -> InstantRange {
        let from = from.map_or(NEVER, |from| from.max(self.requested));
        InstantRange { from, to: self.last.min(by) }
    }
}

/// Whether at every instant from `from` until just before the retirement one of them is pending.
fn covers(pending: &[InstantRange], from: WideInstant, at: WideInstant) -> bool {
    reach(pending, from) > at
}

/// Until when at every instant from `from` on one of them is pending.
pub(super) fn reach(pending: &[InstantRange], from: WideInstant) -> WideInstant {
    let mut reached = from;
    loop {
        let then = pending.iter().filter(|span| span.from <= reached && span.to > reached);
        match then.map(|span| span.to).max() {
            None => return reached,
            Some(to) => reached = to,
        }
    }
}
