//! Whether the rules can explain what was observed of one timestamp.
//!
//! All orders of all facts need not be tried. Three things are true of every explanation and leave few to try:
//!
//! - **Requests may come as early as they can.** All of them precede the retirement, and one pending source more
//!   never brings it forward (F3, F6).
//! - **A source closes once.** What else comes from it is dropped, and only has to find a place after that. So a source
//!   is pending to the end, held, failed or fired, and each of these is possible within one interval ([`Source`]).
//! - **Later is better.** Until the retirement something pending outranks all that is held, and something is pending
//!   (P4, P7). Of the ways that a source may close, the one that leaves it pending longest serves the others best.
//!   The one thing that must not be late is, under eager, a cloud's timer that is to find nothing available: all such
//!   fire before the first result is held. So the instant between the two, the *turn*, is tried.
//!
//! What retires the timestamp, when it does and where the turn is are tried in turn: for `n` clouds at most
//! `2n + 4` causes, `3n + 4` instants and `n + 2` turns, each in O(`n`²) steps. Nothing depends on how many events overlap.

/// An instant in the arithmetic of intervals, wide enough for sums of any four numbers of a trace.
pub(super) type Time = u128;

/// After all instants.
pub(super) const NEVER: Time = Time::MAX;

/// No instant of a trace, with all that may be added to it, comes after this.
pub(super) const LAST: Time = 1 << 67;

/// From the first instant to the last.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Span {
    pub(super) from: Time,
    pub(super) to: Time,
}

/// A timer of one source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Timer {
    /// When it may be served.
    pub(super) served: Span,
    /// Until when it may stay unserved: to the end of that, or for ever if the trace ends before.
    pub(super) by: Time,
}

/// One source of a timestamp: when it was requested, and what came of it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Source {
    /// The earliest instant of its request.
    pub(super) requested: Time,
    pub(super) timer: Option<Timer>,
    /// The earliest instant at which a result may have come.
    pub(super) result: Option<Time>,
    /// The earliest instant at which a failure may have come.
    pub(super) failure: Option<Time>,
    /// The earliest of the instants by which its results and failures have come at the latest.
    pub(super) last: Time,
}

/// All that was observed of one timestamp, but what came out of it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct ObservedFacts {
    pub(super) is_eager: bool,
    /// The earliest instant of its open.
    pub(super) open: Time,
    /// Local and the requested clouds, in ascending priority.
    pub(super) sources: Vec<Source>,
}

/// What comes out of a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Output {
    /// The result of the source with this index.
    Emit(usize),
    Miss,
}

/// The step that retires a timestamp: whose, and which.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Cause {
    Result(usize),
    Failure(usize),
    Timer(usize),
}

/// What a source must be just before the retirement.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Role {
    Pending,
    Held,
    /// Failed or fired.
    Closed,
    /// Pending, or held with its timer running on.
    Live,
    NotHeld,
    Any,
}

/// What a source is just before the retirement, and until when it was pending.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct SourceTimeline {
    is_held: bool,
    until: Time,
}

impl ObservedFacts {
    /// Whether some explanation has this output, by a step at an instant of `when`.
    pub(super) fn yields(&self, output: Output, when: Span) -> bool {
        self.steps(output, when).next().is_some()
    }

    /// The first and the last instant of a step that has this output in some explanation.
    pub(super) fn span(&self, output: Output) -> Option<Span> {
        // Where there is one, the first is among those that are tried.
        let from = self.steps(output, Span { from: 0, to: LAST }).min()?;
        let (mut to, mut beyond) = (from, LAST + 1);
        while to + 1 < beyond {
            let middle = to + (beyond - to) / 2;
            let is_later = self.yields(output, Span { from: middle, to: LAST });
            (to, beyond) = if is_later { (middle, beyond) } else { (to, middle) };
        }
        Some(Span { from, to })
    }

    /// Of the instants that are tried, those of steps that have this output in some explanation.
    fn steps(&self, output: Output, when: Span) -> impl Iterator<Item = Time> {
        self.causes(output).into_iter().flat_map(move |cause| {
            let step = self.step(cause, output);
            let from = step.from.max(when.from).max(self.ready());
            let when = Span { from, to: step.to.min(when.to) };
            self.instants(when).filter(move |at| {
                let roles = |q| self.role(cause, output, q);
                self.turns(*at).any(|turn| self.is_timeline(*at, turn, roles))
            })
        })
    }

    /// Whether some explanation leaves the timestamp open.
    pub(super) fn stays_open(&self) -> bool {
        let end = NEVER - 1;
        self.turns(end).any(|turn| self.is_timeline(end, turn, |_| Role::Any))
    }

    /// The earliest instant at which everything was requested, as it must be before the retirement.
    fn ready(&self) -> Time {
        self.sources.iter().map(|source| source.requested).fold(self.open, Time::max)
    }

    /// The steps that may end in this output (F3, F6).
    fn causes(&self, output: Output) -> Vec<Cause> {
        let all = 0..self.sources.len();
        match output {
            Output::Miss => all.flat_map(|q| [Cause::Failure(q), Cause::Timer(q)]).collect(),
            Output::Emit(best) => {
                let above = all.clone().skip(best + 1);
                let frees = above.clone().flat_map(|q| [Cause::Failure(q), Cause::Timer(q)]);
                // Eager: the best available, whoever's timer it is.
                let commits = all.take(best + 1).skip(1).map(Cause::Timer);
                let commits = commits.filter(|_| self.is_eager);
                std::iter::once(Cause::Result(best)).chain(frees).chain(commits).collect()
            }
        }
    }

    /// When a step may happen.
    fn step(&self, cause: Cause, output: Output) -> Span {
        match cause {
            Cause::Result(q) => self.sources[q].returns(),
            Cause::Failure(q) => self.sources[q].fails(),
            // What is held may have been followed by anything: it is dropped.
            Cause::Timer(q) if output == Output::Emit(q) => self.sources[q].serves(),
            Cause::Timer(q) if self.role(cause, output, q) == Role::Live => {
                self.sources[q].serves()
            }
            Cause::Timer(q) => self.sources[q].fires(),
        }
    }

    /// What a source must be for the cause to have this output.
    fn role(&self, cause: Cause, output: Output, q: usize) -> Role {
        let by = match cause {
            Cause::Result(q) | Cause::Failure(q) | Cause::Timer(q) => q,
        };
        let best = match output {
            Output::Miss => return if q == by { Role::Pending } else { Role::Closed },
            Output::Emit(best) => best,
        };
        let commits = self.is_eager && matches!(cause, Cause::Timer(by) if by > 0);
        match cause {
            Cause::Result(_) if q == best => Role::Pending,
            _ if q == best => Role::Held,
            _ if q == by && by > best => Role::Pending,
            _ if q == by => Role::Live,
            _ if q > best && commits => Role::NotHeld,
            _ if q > best => Role::Closed,
            _ => Role::Any,
        }
    }

    /// The instants in `when` to try: its beginning, and wherever something becomes possible.
    fn instants(&self, when: Span) -> impl Iterator<Item = Time> {
        let begins = self.sources.iter().flat_map(|source| {
            [source.returns(), source.fails(), source.fires()].map(|span| span.from)
        });
        let later = begins.filter(move |begin| when.from < *begin && *begin <= when.to);
        Some(when.from).filter(|from| *from <= when.to).into_iter().chain(later)
    }

    /// The turns to try: as late as each result may be held.
    fn turns(&self, at: Time) -> impl Iterator<Item = Time> {
        let held = self.sources.iter().map(move |source| source.returns().to.min(at));
        std::iter::once(at).chain(held.filter(|_| self.is_eager))
    }

    /// Whether all sources can be what they must be just before a retirement `at` then, the turn being at `turn`.
    fn is_timeline(&self, at: Time, turn: Time, role: impl Fn(usize) -> Role) -> bool {
        // By the time that they are pending, from the highest source down.
        let mut pending: Vec<Span> = Vec::with_capacity(self.sources.len());
        for (q, source) in self.sources.iter().enumerate().rev() {
            let courses = self.courses(q, at, turn, role(q));
            // P4: something pending outranks it from then on.
            let possible = courses
                .into_iter()
                .flatten()
                .filter(|timeline| !timeline.is_held || covers(&pending, timeline.until, at));
            let Some(timeline) = possible.max_by_key(|timeline| timeline.until) else {
                return false;
            };
            pending.push(Span { from: source.requested, to: timeline.until });
        }
        // P7: something always is pending.
        covers(&pending, self.open, at)
    }

    /// The courses of a source that are possible, each as late as it may be.
    fn courses(&self, q: usize, at: Time, turn: Time, role: Role) -> [Option<SourceTimeline>; 4] {
        let source = &self.sources[q];
        let within = |span: Span| (span.from <= span.to).then_some(span.to);
        let before = |span: Span| within(Span { to: span.to.min(at), ..span });
        let outlasts = at <= source.patience();

        let stays = (outlasts && at <= source.last).then_some(NEVER);
        let mut held = before(source.returns()).filter(|until| *until >= turn || !self.is_eager);
        let mut fired = source.fires();
        // A cloud's timer that finds something available commits it.
        if self.is_eager && q > 0 {
            held = held.filter(|_| outlasts);
            fired.to = fired.to.min(turn);
        }
        let [stays, held, failed, fired] = match role {
            Role::Pending => [stays, None, None, None],
            Role::Held => [None, held, None, None],
            Role::Closed => [None, None, before(source.fails()), before(fired)],
            Role::Live => [stays, held, None, None],
            Role::NotHeld => [stays, None, before(source.fails()), before(fired)],
            Role::Any => [stays, held, before(source.fails()), before(fired)],
        };
        let timeline = |is_held| move |until| SourceTimeline { is_held, until };
        [
            stays.map(timeline(false)),
            held.map(timeline(true)),
            failed.map(timeline(false)),
            fired.map(timeline(false)),
        ]
    }
}

impl Source {
    /// Until when its timer may stay unserved.
    fn patience(&self) -> Time {
        self.timer.map_or(NEVER, |timer| timer.by)
    }

    /// When a result of it may close it while its timer is live.
    fn returns(&self) -> Span {
        self.closes(self.result, self.patience())
    }

    /// When a failure may close it.
    fn fails(&self) -> Span {
        self.closes(self.failure, self.patience())
    }

    /// When its timer may close it.
    fn fires(&self) -> Span {
        match self.timer {
            Some(timer) => self.closes(Some(timer.served.from), timer.served.to),
            None => Span { from: NEVER, to: 0 },
        }
    }

    /// When its timer may be served, its result perhaps available.
    fn serves(&self) -> Span {
        match self.timer {
            Some(timer) => {
                Span { from: self.requested.max(timer.served.from), to: timer.served.to }
            }
            None => Span { from: NEVER, to: 0 },
        }
    }

    /// From an event on, while what else came can still come after it.
    fn closes(&self, from: Option<Time>, by: Time) -> Span {
        let from = from.map_or(NEVER, |from| from.max(self.requested));
        Span { from, to: self.last.min(by) }
    }
}

/// Whether at every instant from `from` until just before the retirement one of them is pending.
fn covers(pending: &[Span], from: Time, at: Time) -> bool {
    let mut reached = from;
    loop {
        let then = pending.iter().filter(|span| span.from <= reached && span.to > reached);
        match then.map(|span| span.to).max() {
            None => return false,
            Some(to) if to > at => return true,
            Some(to) => reached = to,
        }
    }
}
