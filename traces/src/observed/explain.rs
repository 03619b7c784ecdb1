//! Decides whether the rules can explain what was observed of one timestamp.
//!
//! Not all orders of all facts need to be tried. Three facts about explanations leave few
//! candidates:
//!
//! - **Requests may come as early as they can.** All of them precede the retirement, and one more
//!   pending source never brings it forward (F3, F6).
//! - **A source closes once.** Whatever else comes from it is dropped, and only needs a place after
//!   that. So a source is pending to the end, held, failed or fired, and each of these is possible
//!   within one interval ([`ObservedSource`]).
//! - **Later is better.** Until the retirement a pending source outranks every held result, and
//!   some source is pending (P4, P7). Among the ways in which a source may close, the one that
//!   leaves it pending longest serves the others best. One thing must not be late: under eager, a
//!   cloud's timer that is to find nothing available. All such timers fire before the first result
//!   is held. So the instant between the two, the *turn*, is tried.
//!
//! The search tries the cause of the retirement, its instant and the turn. For `n` clouds there are
//! at most `2n + 4` causes, `3n + 4` instants and `n + 2` turns, and each takes O(`n`²) steps.
//! Nothing depends on the number of events that overlap.

/// An instant in the arithmetic of intervals, wide enough for sums of any four numbers of a trace.
pub(super) type WideInstant = u128;

/// An instant after all others.
pub(super) const NEVER: WideInstant = WideInstant::MAX;

/// No instant of a trace comes after this, whatever may be added to it.
pub(super) const LAST: WideInstant = 1 << 67;

/// The greatest number of sources: local and as many clouds as a header may have.
const SOURCES: usize = 16;

/// The instants from the first to the last, both included.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct InstantRange {
    pub(super) from: WideInstant,
    pub(super) to: WideInstant,
}

/// A timer of one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct SourceTimer {
    /// The instants at which it may be served.
    pub(super) served: InstantRange,
    /// The instant until which it may stay unserved: the end of that range, or never if the trace
    /// ends before.
    pub(super) by: WideInstant,
}

/// One source of a timestamp: its request, and what became of it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ObservedSource {
    /// The earliest instant of its request.
    pub(super) requested: WideInstant,
    pub(super) timer: Option<SourceTimer>,
    /// The earliest instant at which a result may have come.
    pub(super) result: Option<WideInstant>,
    /// The earliest instant at which a failure may have come.
    pub(super) failure: Option<WideInstant>,
    /// The earliest of the instants by which its results and failures have certainly come.
    pub(super) last: WideInstant,
}

/// Everything that was observed of one timestamp, except its outputs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct ObservedFacts {
    pub(super) is_eager: bool,
    /// The earliest instant of its open.
    pub(super) open: WideInstant,
    /// Local and the requested clouds, in ascending priority.
    pub(super) sources: Vec<ObservedSource>,
}

/// The output with which a timestamp retires.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum RetirementOutput {
    /// The result of the source with this index.
    Emit(usize),
    Miss,
}

/// The step that retires a timestamp, with its source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum RetirementStep {
    Result(usize),
    Failure(usize),
    Timer(usize),
}

/// The state in which a source must be just before the retirement.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum SourceRole {
    Pending,
    Held,
    /// It failed or its timer fired.
    Closed,
    /// It is pending, or held with its timer running on.
    Live,
    NotHeld,
    Any,
}

impl ObservedFacts {
    /// Returns `true` if some explanation has this output, by a step at an instant of `when`.
    pub(super) fn yields(&self, output: RetirementOutput, when: InstantRange) -> bool {
        self.steps(output, when).next().is_some()
    }

    /// Returns the first and the last instant of a step that has this output in some explanation.
    pub(super) fn span(&self, output: RetirementOutput) -> Option<InstantRange> {
        // If there is such an instant, the first one is among those that are tried.
        let from = self.steps(output, InstantRange { from: 0, to: LAST }).min()?;
        let (mut to, mut beyond) = (from, LAST + 1);
        while to + 1 < beyond {
            let middle = to + (beyond - to) / 2;
            let is_later = self.yields(output, InstantRange { from: middle, to: LAST });
            (to, beyond) = if is_later { (middle, beyond) } else { (to, middle) };
        }
        Some(InstantRange { from, to })
    }

    /// Returns the tried instants at which a step has this output in some explanation.
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

    /// Returns `true` if some explanation leaves the timestamp open.
    pub(super) fn stays_open(&self) -> bool {
        let end = NEVER - 1;
        self.turns(end).any(|turn| self.is_timeline(end, turn, |_| SourceRole::Any))
    }

    /// Returns the earliest instant at which everything was requested, as it must be before the
    /// retirement.
    pub(super) fn ready(&self) -> WideInstant {
        self.sources.iter().map(|source| source.requested).fold(self.open, WideInstant::max)
    }

    /// Returns the steps that may end in this output (F3, F6).
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
                // Under eager, any timer commits the best available result.
                let commits = all.take(best + 1).skip(1).map(RetirementStep::Timer);
                let commits = commits.filter(|_| self.is_eager);
                std::iter::once(RetirementStep::Result(best)).chain(frees).chain(commits).collect()
            }
        }
    }

    /// Returns the instants at which a step may happen.
    fn step(&self, cause: RetirementStep, output: RetirementOutput) -> InstantRange {
        match cause {
            RetirementStep::Result(q) => self.sources[q].returns(),
            RetirementStep::Failure(q) => self.sources[q].fails(),
            // After a result is held, anything may follow it: it is dropped.
            RetirementStep::Timer(q) if output == RetirementOutput::Emit(q) => {
                self.sources[q].serves()
            }
            RetirementStep::Timer(q) if self.role(cause, output, q) == SourceRole::Live => {
                self.sources[q].serves()
            }
            RetirementStep::Timer(q) => self.sources[q].fires(),
        }
    }

    /// Returns the state in which source `q` must be for the cause to have this output.
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

    /// Returns the instants in `when` to try: its beginning, and each instant at which something
    /// becomes possible.
    fn instants(&self, when: InstantRange) -> impl Iterator<Item = WideInstant> {
        let begins = self.sources.iter().flat_map(|source| {
            [source.returns(), source.fails(), source.fires()].map(|span| span.from)
        });
        let later = begins.filter(move |begin| when.from < *begin && *begin <= when.to);
        Some(when.from).filter(|from| *from <= when.to).into_iter().chain(later)
    }

    /// Returns the turns to try: the latest instant at which each result may be held.
    fn turns(&self, at: WideInstant) -> impl Iterator<Item = WideInstant> {
        let held = self.sources.iter().map(move |source| source.returns().to.min(at));
        std::iter::once(at).chain(held.filter(|_| self.is_eager))
    }

    /// Returns `true` if all sources can be in the state that they must have just before a
    /// retirement at `at`, with the turn at `turn`.
    fn is_timeline(
        &self,
        at: WideInstant,
        turn: WideInstant,
        role: impl Fn(usize) -> SourceRole,
    ) -> bool {
        // The intervals in which each source is pending, from the highest source down.
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
        // Some source is always pending (P7).
        covers(pending, self.open, at)
    }

    /// Returns the latest instant until which a source can be pending, given the sources above it.
    /// Returns `None` if it cannot be in the state that it must have.
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
        // A cloud's timer that finds a result available commits it.
        let commits = self.is_eager && q > 0;
        let mut latest = None;
        if matches!(role, Held | Live | Any) && (outlasts || !commits) {
            let held = before(source.returns()).filter(|until| *until >= turn || !self.is_eager);
            // From then on some pending source outranks it (P4).
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
    /// Returns the instant until which its timer may stay unserved.
    fn patience(&self) -> WideInstant {
        self.timer.map_or(NEVER, |timer| timer.by)
    }

    /// Returns the instant until which it may be pending.
    pub(super) fn lasts(&self) -> WideInstant {
        self.last.min(self.patience())
    }

    /// Returns the instants at which one of its results may close it while its timer is live.
    pub(super) fn returns(&self) -> InstantRange {
        self.closes(self.result, self.patience())
    }

    /// Returns the instants at which a failure may close it.
    pub(super) fn fails(&self) -> InstantRange {
        self.closes(self.failure, self.patience())
    }

    /// Returns the instants at which its timer may close it.
    pub(super) fn fires(&self) -> InstantRange {
        match self.timer {
            Some(timer) => self.closes(Some(timer.served.from), timer.served.to),
            None => InstantRange { from: NEVER, to: 0 },
        }
    }

    /// Returns the instants at which its timer may be served, perhaps with its result available.
    fn serves(&self) -> InstantRange {
        match self.timer {
            Some(timer) => {
                InstantRange { from: self.requested.max(timer.served.from), to: timer.served.to }
            }
            None => InstantRange { from: NEVER, to: 0 },
        }
    }

    /// Returns the instants from an event on, as long as everything else that came can still come
    /// after it.
    fn closes(&self, from: Option<WideInstant>, by: WideInstant) -> InstantRange {
        let from = from.map_or(NEVER, |from| from.max(self.requested));
        InstantRange { from, to: self.last.min(by) }
    }
}

/// Returns `true` if one of them is pending at every instant from `from` until just before the
/// retirement.
fn covers(pending: &[InstantRange], from: WideInstant, at: WideInstant) -> bool {
    reach(pending, from) > at
}

/// Returns the instant until which, from `from` on, one of them is always pending.
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
