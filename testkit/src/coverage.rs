//! Counts what runs and files reached: each [`Mark`] is something to reach, and [`Coverage`] counts
//! them. It judges nothing.

use std::collections::HashMap;

use fuseline_traces::{
    Commit, Decision, Defect, DropReason, Event, Input, Line, OfferRefusal, OpenRefusal, ReadError,
    Rule,
};

use crate::context::{HoldingReasons, RuleDecision, RunContext};
use crate::edge::Edge;
use crate::run::Run;

/// Something that a check can reach.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Mark {
    /// A run had this commit rule.
    Commit(Commit),
    /// A rule demanded something.
    Rule(Rule),
    /// An open was refused.
    Open(OpenRefusal),
    /// An offer was refused.
    Offer(OfferRefusal),
    /// A result was dropped.
    Result(DropReason),
    /// A failure was dropped.
    Fail(DropReason),
    /// An open was refused for the first reason, although the second holds too.
    Opens(OpenRefusal, OpenRefusal),
    /// An offer was refused for the first reason, although the second holds too.
    Offers(OfferRefusal, OfferRefusal),
    /// A result was dropped for the first reason, although the second holds too.
    Results(DropReason, DropReason),
    /// A failure was dropped for the first reason, although the second holds too.
    Fails(DropReason, DropReason),
    /// An input, or a timer that was due before it, had this effect.
    Outcome(Cause, Consequence),
    /// A situation occurred in which implementations go wrong.
    Edge(Edge),
    /// The judge found a violation of this rule.
    Violation(Rule),
    /// A line of this kind was read.
    Line(&'static str),
    /// A file could not be read for this reason.
    Defect(&'static str),
}

/// The cause of a decision.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Cause {
    /// Timers that fire.
    Timer,
    /// A result that arrives.
    Result,
    /// A failure that arrives.
    Fail,
}

/// The effect of a decision on its timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Consequence {
    /// Local's result is held.
    HoldsLocal,
    /// A cloud's result is held.
    HoldsCloud,
    /// Local's result is forwarded.
    EmitsLocal,
    /// A cloud's result is forwarded.
    EmitsCloud,
    /// A pending call is cancelled.
    Cancels,
    /// The last output is final.
    Ends,
    /// The timestamp is missed.
    Misses,
    /// The timestamp stays open and waits.
    Waits,
}

/// Counts how often each mark was reached.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Coverage(HashMap<Mark, u64>);

/// The marks of one kind: how many exist, how many were reached, and which were not.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct CoverageShare {
    /// The name of the kind.
    pub kind: &'static str,
    /// The number of marks that were reached.
    pub reached: usize,
    /// The number of all marks.
    pub all: usize,
    /// The names of the marks that were not reached.
    pub missing: Vec<String>,
}

impl Coverage {
    /// Notes the marks of a whole run.
    pub fn watch(&mut self, run: &Run) {
        let mut context = self.begin(run);
        for input in &run.inputs {
            self.follow(&mut context, input);
        }
    }

    /// Notes the marks of a run as a whole. Returns the context before its first input.
    pub fn begin(&mut self, run: &Run) -> RunContext {
        self.edges(Edge::of_run(run));
        RunContext::new(&run.header)
    }

    /// Applies an input and notes its marks. Returns the decisions about it.
    pub fn follow(&mut self, context: &mut RunContext, input: &Input) -> RuleDecision {
        self.mark(Mark::Commit(context.commit()));
        self.edges(Edge::of_input(context, input));
        let gate: Vec<_> = Edge::of_gate(context, input).collect();
        let step = context.apply(input);
        self.edges(Edge::of_step(context, input, &step));
        let own = step.own.first().map(|(decision, _)| *decision);
        if let Some(
            Decision::Request { .. } | Decision::RefuseOffer { why: OfferRefusal::Queue, .. },
        ) = own
        {
            self.edges(gate.into_iter());
        }
        self.rules(input, &step);
        self.reasons(&step.reasons);
        self.outcomes(input, &step);
        step
    }

    /// Notes a mark. Returns `false` if it was reached before.
    pub fn mark(&mut self, mark: Mark) -> bool {
        let count = self.0.entry(mark).or_default();
        *count += 1;
        *count == 1
    }

    /// Notes a line that was read.
    pub fn line(&mut self, line: &Line) {
        self.mark(Mark::Line(name_of_line(line)));
    }

    /// Notes the reason why a file could not be read.
    pub fn defect(&mut self, error: &ReadError) {
        self.mark(Mark::Defect(name_of_defect(&error.defect)));
    }

    /// Returns `true` if the mark was reached.
    #[must_use]
    pub fn has(&self, mark: Mark) -> bool {
        self.0.contains_key(&mark)
    }

    /// Returns the given marks that were not reached.
    #[must_use]
    pub fn missing(&self, mut marks: Vec<Mark>) -> Vec<Mark> {
        marks.retain(|mark| !self.has(*mark));
        marks
    }

    /// Returns the share of marks that was reached, for each kind that runs can reach.
    #[must_use]
    pub fn shares(&self) -> Vec<CoverageShare> {
        let share = |(kind, marks): (&'static str, Vec<Mark>)| {
            let all = marks.len();
            let missing: Vec<_> = self.missing(marks).into_iter().map(Mark::name).collect();
            CoverageShare { kind, reached: all - missing.len(), all, missing }
        };
        Mark::kinds().into_iter().map(share).collect()
    }

    /// Returns the name of every mark that runs can reach, and how often it was reached.
    pub fn counts(&self) -> impl Iterator<Item = (String, u64)> {
        let all = Mark::kinds().into_iter().flat_map(|(_, marks)| marks);
        all.map(|mark| (mark.name(), self.0.get(&mark).copied().unwrap_or(0)))
    }

    fn edges(&mut self, edges: impl Iterator<Item = Edge>) {
        for edge in edges {
            self.mark(Mark::Edge(edge));
        }
    }

    /// Notes the rules that an input shows.
    fn rules(&mut self, input: &Input, step: &RuleDecision) {
        // An accepted failure that decides nothing is the only sign of F4.
        if matches!(input, Input::Fail { .. }) {
            self.mark(Mark::Rule(Rule::F4));
        }
        for (decision, rule) in step.fired.iter().chain(&step.own) {
            self.mark(Mark::Rule(*rule));
            // The clock went back, which shows F0.
            if decision.at() != input.at() {
                self.mark(Mark::Rule(Rule::F0));
            }
            // An input for a timestamp that was forwarded or missed shows P1.
            if let Decision::Drop { why: DropReason::Superseded, .. } = decision {
                self.mark(Mark::Rule(Rule::P1));
            }
        }
    }

    /// Notes the reason that decides, and each other reason that holds.
    fn reasons(&mut self, reasons: &HoldingReasons) {
        match reasons {
            HoldingReasons::None => {}
            HoldingReasons::Open(all) => self.first(all, Mark::Open, Mark::Opens),
            HoldingReasons::Offer(all) => self.first(all, Mark::Offer, Mark::Offers),
            HoldingReasons::Result(all) => self.first(all, Mark::Result, Mark::Results),
            HoldingReasons::Fail(all) => self.first(all, Mark::Fail, Mark::Fails),
        }
    }

    fn first<T: Copy>(&mut self, all: &[T], one: fn(T) -> Mark, two: fn(T, T) -> Mark) {
        let Some((first, more)) = all.split_first() else { return };
        self.mark(one(*first));
        for second in more {
            self.mark(two(*first, *second));
        }
    }

    /// Notes what became of the timestamps that an input, or a timer before it, was for.
    fn outcomes(&mut self, input: &Input, step: &RuleDecision) {
        let effects = step.fired.iter().filter_map(|(decision, _)| Consequence::of(decision));
        for effect in effects {
            self.mark(Mark::Outcome(Cause::Timer, effect));
        }
        let settles = |d: &Decision| {
            matches!(d, Decision::Emit { .. } | Decision::Final { .. } | Decision::Miss { .. })
        };
        let fires = step.fired.iter().any(|(d, _)| matches!(d, Decision::Timer { .. }));
        if fires && !step.fired.iter().any(|(decision, _)| settles(decision)) {
            self.mark(Mark::Outcome(Cause::Timer, Consequence::Waits));
        }
        let cause = match input {
            Input::Result { .. } => Cause::Result,
            Input::Fail { .. } => Cause::Fail,
            Input::Open { .. } | Input::Offer { .. } | Input::Tick { .. } => return,
        };
        for effect in step.own.iter().filter_map(|(decision, _)| Consequence::of(decision)) {
            self.mark(Mark::Outcome(cause, effect));
        }
        if step.own.is_empty() {
            self.mark(Mark::Outcome(cause, Consequence::Waits));
        }
    }
}

impl Consequence {
    /// Returns the effect of a decision about a result, a failure or a timer, or `None` if it drops
    /// it.
    const fn of(decision: &Decision) -> Option<Self> {
        match decision {
            Decision::Hold { p: 0, .. } => Some(Self::HoldsLocal),
            Decision::Hold { .. } => Some(Self::HoldsCloud),
            Decision::Emit { p: 0, .. } => Some(Self::EmitsLocal),
            Decision::Emit { .. } => Some(Self::EmitsCloud),
            Decision::Cancel { .. } => Some(Self::Cancels),
            Decision::Final { .. } => Some(Self::Ends),
            Decision::Miss { .. } => Some(Self::Misses),
            Decision::Timer { .. }
            | Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Request { .. }
            | Decision::Drop { .. } => None,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::HoldsLocal => "holds local",
            Self::HoldsCloud => "holds a cloud",
            Self::EmitsLocal => "forwards local",
            Self::EmitsCloud => "forwards a cloud",
            Self::Cancels => "cancels",
            Self::Ends => "ends after its last output",
            Self::Misses => "misses",
            Self::Waits => "waits",
        }
    }
}

impl Cause {
    const fn name(self) -> &'static str {
        match self {
            Self::Timer => "timer",
            Self::Result => "result",
            Self::Fail => "failure",
        }
    }
}

impl Mark {
    /// Returns the mark's name, for people.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Commit(commit) => commit.to_string(),
            Self::Rule(rule) => rule.to_string(),
            Self::Open(why) => format!("open refused {why}"),
            Self::Offer(why) => format!("offer refused {why}"),
            Self::Result(why) => format!("result dropped {why}"),
            Self::Fail(why) => format!("failure dropped {why}"),
            Self::Opens(why, though) => format!("open refused {why} though {though}"),
            Self::Offers(why, though) => format!("offer refused {why} though {though}"),
            Self::Results(why, though) => format!("result dropped {why} though {though}"),
            Self::Fails(why, though) => format!("failure dropped {why} though {though}"),
            Self::Outcome(cause, effect) => format!("{} {}", cause.name(), effect.name()),
            Self::Edge(edge) => edge.name().to_owned(),
            Self::Violation(rule) => format!("violation of {rule}"),
            Self::Line(name) => format!("line {name}"),
            Self::Defect(name) => format!("file refused: {name}"),
        }
    }

    /// Returns all marks that runs can reach, by kind.
    #[must_use]
    pub fn kinds() -> [(&'static str, Vec<Self>); 5] {
        [
            ("rules", Rule::OF_DECISIONS.map(Self::Rule).into()),
            ("reasons", Self::of_reasons()),
            ("pairs of reasons", Self::of_pairs()),
            ("outcomes", Self::of_outcomes()),
            ("edges", Edge::ALL.map(|(edge, _)| Self::Edge(edge)).into()),
        ]
    }

    /// Returns the marks that a few runs can reach: all commit rules, every rule and every reason.
    #[must_use]
    pub fn of_runs() -> Vec<Self> {
        let mut all = Vec::from(Commit::ALL.map(Self::Commit));
        all.extend(Rule::OF_DECISIONS.map(Self::Rule));
        all.extend(Self::of_reasons());
        all
    }

    /// Returns the violations that the judge can find.
    #[must_use]
    pub fn of_violations() -> Vec<Self> {
        Rule::OF_DECISIONS.map(Self::Violation).into()
    }

    /// Returns the marks that reading files can reach: every line, and every reason why one cannot
    /// be read.
    #[must_use]
    pub fn of_files() -> Vec<Self> {
        LINES.map(Self::Line).into_iter().chain(DEFECTS.map(Self::Defect)).collect()
    }

    fn of_reasons() -> Vec<Self> {
        let mut all: Vec<_> = OpenRefusal::ALL.map(Self::Open).into();
        all.extend(OfferRefusal::ALL.map(Self::Offer));
        all.extend(DropReason::ALL.map(Self::Result));
        all.extend(DropReason::ALL.map(Self::Fail));
        all
    }

    fn of_pairs() -> Vec<Self> {
        use DropReason::{Duplicate, Unknown, Unsolicited};
        let drops = DropReason::ALL;
        // A source that was not requested, or cannot be, has no available result.
        let can_be = |(first, second): &(DropReason, DropReason)| {
            !matches!(first, Unknown | Unsolicited) || *second != Duplicate
        };
        let mut all: Vec<_> = ordered(&OpenRefusal::ALL).map(|(a, b)| Self::Opens(a, b)).collect();
        all.extend(ordered(&OfferRefusal::ALL).map(|(a, b)| Self::Offers(a, b)));
        all.extend(ordered(&drops).filter(can_be).map(|(a, b)| Self::Results(a, b)));
        all.extend(ordered(&drops).filter(can_be).map(|(a, b)| Self::Fails(a, b)));
        all
    }

    fn of_outcomes() -> Vec<Self> {
        use Consequence::{
            Cancels, EmitsCloud, EmitsLocal, Ends, HoldsCloud, HoldsLocal, Misses, Waits,
        };
        // After a result, one is available, so none of its effects is a miss. Timers and failures
        // hold nothing.
        let of_result = [HoldsLocal, HoldsCloud, EmitsLocal, EmitsCloud, Cancels, Ends];
        let settled = [EmitsLocal, EmitsCloud, Cancels, Ends, Misses, Waits];
        let mut all: Vec<_> = of_result.map(|effect| Self::Outcome(Cause::Result, effect)).into();
        for cause in [Cause::Timer, Cause::Fail] {
            all.extend(settled.map(|effect| Self::Outcome(cause, effect)));
        }
        all
    }
}

/// The names of all lines.
const LINES: [&str; 15] = [
    "header", "open", "offer", "result", "fail", "tick", "timer", "refuse", "request", "hold",
    "drop", "emit", "final", "miss", "cancel",
];
/// All reasons why a file cannot be read.
const DEFECTS: [&str; 7] =
    ["bytes", "empty", "no header", "second header", "unterminated", "too long", "line"];

const fn name_of_line(line: &Line) -> &'static str {
    match line {
        Line::Header(_) => "header",
        Line::Event(Event::Input(input)) => match input {
            Input::Open { .. } => "open",
            Input::Offer { .. } => "offer",
            Input::Result { .. } => "result",
            Input::Fail { .. } => "fail",
            Input::Tick { .. } => "tick",
        },
        Line::Event(Event::Decision(decision)) => match decision {
            Decision::Timer { .. } => "timer",
            Decision::RefuseOpen { .. } | Decision::RefuseOffer { .. } => "refuse",
            Decision::Request { .. } => "request",
            Decision::Hold { .. } => "hold",
            Decision::Drop { .. } => "drop",
            Decision::Emit { .. } => "emit",
            Decision::Final { .. } => "final",
            Decision::Miss { .. } => "miss",
            Decision::Cancel { .. } => "cancel",
        },
    }
}

const fn name_of_defect(defect: &Defect) -> &'static str {
    match defect {
        Defect::Io(_) => "bytes",
        Defect::Empty => "empty",
        Defect::NoHeader => "no header",
        Defect::SecondHeader => "second header",
        Defect::Unterminated => "unterminated",
        Defect::TooLong => "too long",
        Defect::Line(_) => "line",
    }
}

/// Returns each pair of these, with the earlier one first.
fn ordered<T: Copy>(of: &[T]) -> impl Iterator<Item = (T, T)> {
    let after = |i: usize| of.iter().skip(i + 1);
    of.iter().enumerate().flat_map(move |(i, first)| after(i).map(|second| (*first, *second)))
}
