//! What checks came to: a check that reaches little proves little.

use std::collections::HashSet;

use fuseline_traces::{
    Commit, Decision, DropReason, Event, Fault, Input, Line, OfferRefusal, OpenRefusal, Rule,
};

/// Something that a check can come to.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Mark {
    /// A run under this commit rule.
    Commit(Commit),
    /// A rule demanded something.
    Rule(Rule),
    /// The judge found this rule broken.
    Broken(Rule),
    /// An open was refused.
    Open(OpenRefusal),
    /// An offer was refused.
    Offer(OfferRefusal),
    /// A result was dropped.
    Result(DropReason),
    /// A failure was dropped.
    Fail(DropReason),
    /// Such a line was read.
    Line(&'static str),
    /// A file was not read, for such a reason.
    Fault(&'static str),
}

/// The marks that were reached.
#[derive(Clone, Debug, Default)]
pub struct Reach(HashSet<Mark>);

/// Every line, by its name.
const LINES: [&str; 14] = [
    "header", "open", "offer", "result", "fail", "tick", "timer", "refuse", "request", "hold",
    "drop", "emit", "miss", "cancel",
];
/// Every reason for which a file is not read.
const FAULTS: [&str; 7] =
    ["bytes", "empty", "no header", "second header", "unterminated", "too long", "line"];

impl Reach {
    /// Notes a mark; false if it was reached before.
    pub fn mark(&mut self, mark: Mark) -> bool {
        self.0.insert(mark)
    }

    /// Those of `marks` that were not reached.
    #[must_use]
    pub fn missing(&self, mut marks: Vec<Mark>) -> Vec<Mark> {
        marks.retain(|mark| !self.has(*mark));
        marks
    }

    /// Whether a mark was reached.
    #[must_use]
    pub fn has(&self, mark: Mark) -> bool {
        self.0.contains(&mark)
    }

    /// Notes what the rules demand of an input.
    pub(super) fn demands(&mut self, commit: Commit, input: &Input, demands: &[(Decision, Rule)]) {
        self.mark(Mark::Commit(commit));
        // An accepted failure that decides nothing is all that there is to see of F4.
        if matches!(input, Input::Fail { .. }) {
            self.mark(Mark::Rule(Rule::F4));
        }
        for (decision, rule) in demands {
            self.mark(Mark::Rule(*rule));
            // F0 shows where the clock went back.
            if decision.at() != input.at() {
                self.mark(Mark::Rule(Rule::F0));
            }
            match (decision, input) {
                (Decision::RefuseOpen { why, .. }, _) => {
                    self.mark(Mark::Open(*why));
                }
                (Decision::RefuseOffer { why, .. }, _) => {
                    self.mark(Mark::Offer(*why));
                }
                (Decision::Drop { why, .. }, _) => {
                    // P1 shows where something comes for what was forwarded or missed.
                    if *why == DropReason::Superseded {
                        self.mark(Mark::Rule(Rule::P1));
                    }
                    let is_failure = matches!(input, Input::Fail { .. });
                    self.mark(if is_failure { Mark::Fail(*why) } else { Mark::Result(*why) });
                }
                _ => {}
            }
        }
    }

    /// Notes a line that was read.
    pub(super) fn line(&mut self, line: &Line) {
        self.mark(Mark::Line(match line {
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
                Decision::Miss { .. } => "miss",
                Decision::Cancel { .. } => "cancel",
            },
        }));
    }

    /// Notes why a file was not read.
    pub(super) fn fault(&mut self, fault: &Fault) {
        self.mark(Mark::Fault(match fault {
            Fault::Io(_) => "bytes",
            Fault::Empty => "empty",
            Fault::NoHeader => "no header",
            Fault::SecondHeader => "second header",
            Fault::Unterminated => "unterminated",
            Fault::TooLong => "too long",
            Fault::Line(_) => "line",
        }));
    }
}

impl Mark {
    /// All that [`step`](super::step) can reach: both commit rules, every rule, every reason.
    #[must_use]
    pub fn of_step() -> Vec<Self> {
        let mut all = Vec::from(Commit::ALL.map(Self::Commit));
        all.extend(Rule::ALL.map(Self::Rule));
        all.extend(OpenRefusal::ALL.map(Self::Open));
        all.extend(OfferRefusal::ALL.map(Self::Offer));
        all.extend(DropReason::ALL.map(Self::Result));
        all.extend(DropReason::ALL.map(Self::Fail));
        all
    }

    /// All that [`judge`](super::judge) can reach: what a run can, and every rule broken.
    #[must_use]
    pub fn of_judge() -> Vec<Self> {
        let mut all = Self::of_step();
        all.extend(Rule::ALL.map(Self::Broken));
        all
    }

    /// All that [`trace_parse`](super::trace_parse) can reach: every line and every fault.
    #[must_use]
    pub fn of_trace_parse() -> Vec<Self> {
        LINES.map(Self::Line).into_iter().chain(FAULTS.map(Self::Fault)).collect()
    }
}
