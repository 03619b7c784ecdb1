//! Situations in which implementations go wrong, and the runs, inputs and steps that reach them.

use fuseline_traces::{Decision, Input};

use crate::context::{RuleDecision, RunContext};
use crate::run::Run;

/// The number of inputs from which on a run counts as long.
const LONG: usize = 400;
/// The greatest window.
const GREATEST: usize = 1024;

/// A situation in which implementations go wrong.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
#[expect(missing_docs, reason = "each has its name in ALL")]
pub enum Edge {
    ArrivalBeforeDue,
    ArrivalAtDue,
    ArrivalAfterDue,
    TickBeforeDue,
    TickAtDue,
    TickAfterDue,
    ClockBack,
    ClockEnd,
    CounterEnd,
    DueSaturates,
    CloudsDueTogether,
    LocalDueWithCloud,
    TimestampsDueTogether,
    ManyDue,
    WindowFull,
    GreatestWindowFull,
    BacklogBelowLimit,
    BacklogAtLimit,
    BacklogAtResume,
    BacklogAboveResume,
    NoCloud,
    OfferToLocal,
    PriorityBeyondAll,
    LongRun,
}

impl Edge {
    /// All situations, with their names.
    pub const ALL: [(Self, &str); 24] = [
        (Self::ArrivalBeforeDue, "arrival just before its due instant"),
        (Self::ArrivalAtDue, "arrival at its due instant"),
        (Self::ArrivalAfterDue, "arrival just after its due instant"),
        (Self::TickBeforeDue, "tick just before a due instant"),
        (Self::TickAtDue, "tick at a due instant"),
        (Self::TickAfterDue, "tick just after a due instant"),
        (Self::ClockBack, "clock going back"),
        (Self::ClockEnd, "clock at its end"),
        (Self::CounterEnd, "greatest timestamp opened"),
        (Self::DueSaturates, "due instant beyond the clock's end"),
        (Self::CloudsDueTogether, "two clouds due together"),
        (Self::LocalDueWithCloud, "local and cloud due together"),
        (Self::TimestampsDueTogether, "two timestamps due together"),
        (Self::ManyDue, "several due instants passed at one input"),
        (Self::WindowFull, "window full"),
        (Self::GreatestWindowFull, "window of 1024 full"),
        (Self::BacklogBelowLimit, "backlog just below an open gate's limit"),
        (Self::BacklogAtLimit, "backlog at an open gate's limit"),
        (Self::BacklogAtResume, "backlog at a shut gate's resume"),
        (Self::BacklogAboveResume, "backlog just above a shut gate's resume"),
        (Self::NoCloud, "no cloud"),
        (Self::OfferToLocal, "offer to local"),
        (Self::PriorityBeyondAll, "priority beyond 65535"),
        (Self::LongRun, "run of 400 inputs and more"),
    ];

    /// Returns the situation's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(edge, _)| *edge == self).map_or("", |(_, name)| name)
    }

    /// Returns the situations that a whole run is in.
    pub(crate) fn of_run(run: &Run) -> impl Iterator<Item = Self> {
        holding([
            (Self::NoCloud, run.header.clouds.is_empty()),
            (Self::LongRun, run.inputs.len() >= LONG),
        ])
    }

    /// Returns the situations of an input, before it is applied.
    pub(crate) fn of_input(context: &RunContext, input: &Input) -> impl Iterator<Item = Self> {
        let at = input.at();
        let beyond = |p: u64| p > u64::from(u16::MAX);
        let (edges, due) = match *input {
            Input::Result { t, p, .. } | Input::Fail { t, p, .. } => {
                let due = context.due(t, p);
                ([Self::ArrivalBeforeDue, Self::ArrivalAtDue, Self::ArrivalAfterDue], due)
            }
            Input::Open { .. } | Input::Offer { .. } | Input::Tick { .. } => {
                let is_tick = matches!(input, Input::Tick { .. });
                let due = context.next_due().filter(|_| is_tick);
                ([Self::TickBeforeDue, Self::TickAtDue, Self::TickAfterDue], due)
            }
        };
        let away = due.map(|due| i128::from(at) - i128::from(due));
        let p = match *input {
            Input::Offer { p, .. } | Input::Result { p, .. } | Input::Fail { p, .. } => Some(p),
            Input::Open { .. } | Input::Tick { .. } => None,
        };
        holding([
            (edges[0], away == Some(-1)),
            (edges[1], away == Some(0)),
            (edges[2], away == Some(1)),
            (Self::ClockBack, at < context.now()),
            (Self::ClockEnd, at == u64::MAX),
            (Self::OfferToLocal, matches!(input, Input::Offer { p: 0, .. })),
            (Self::PriorityBeyondAll, p.is_some_and(beyond)),
        ])
    }

    /// Returns the situations that follow from an input.
    pub(crate) fn of_step(
        context: &RunContext,
        input: &Input,
        step: &RuleDecision,
    ) -> impl Iterator<Item = Self> {
        let dues: Vec<_> =
            step.fired.iter().filter_map(|(decision, _)| due(context, decision)).collect();
        let together = |of: fn(&FiredTimer, &FiredTimer) -> bool| {
            dues.windows(2).any(|pair| pair[0].at == pair[1].at && of(&pair[0], &pair[1]))
        };
        let full = context.open().len() == context.window();
        let opened = matches!(input, Input::Open { .. }) && step.own.is_empty();
        let saturates = match (input, step.own.first()) {
            (Input::Offer { deadline, .. }, Some((Decision::Request { at, .. }, _))) => {
                at.checked_add(*deadline).is_none()
            }
            (Input::Open { deadline: Some(deadline), .. }, None) => {
                context.now().checked_add(*deadline).is_none()
            }
            _ => false,
        };
        holding([
            (Self::CloudsDueTogether, together(|a, b| a.t == b.t && a.p > 0)),
            (Self::LocalDueWithCloud, together(|a, b| a.t == b.t && a.p == 0)),
            (Self::TimestampsDueTogether, together(|a, b| a.t != b.t)),
            (Self::ManyDue, dues.windows(2).any(|pair| pair[0].at != pair[1].at)),
            (Self::WindowFull, full),
            (Self::GreatestWindowFull, full && context.window() == GREATEST),
            (Self::CounterEnd, opened && input.t() == Some(u64::MAX)),
            (Self::DueSaturates, saturates),
        ])
    }

    /// Returns how a backlog compares with the gate, before the gate changes.
    pub(crate) fn of_gate(context: &RunContext, input: &Input) -> impl Iterator<Item = Self> {
        let (gate, backlog) = match *input {
            Input::Offer { p, backlog, .. } => (context.gate(p), backlog),
            Input::Open { .. } | Input::Result { .. } | Input::Fail { .. } | Input::Tick { .. } => {
                (None, 0)
            }
        };
        let of = |shut: bool, is_at: fn(u64, u64, u64) -> bool| {
            gate.is_some_and(|gate| gate.is_shut == shut && is_at(backlog, gate.limit, gate.resume))
        };
        holding([
            (Self::BacklogBelowLimit, of(false, |backlog, limit, _| backlog == limit - 1)),
            (Self::BacklogAtLimit, of(false, |backlog, limit, _| backlog == limit)),
            (Self::BacklogAtResume, of(true, |backlog, _, resume| backlog == resume)),
            (Self::BacklogAboveResume, of(true, |backlog, _, resume| backlog == resume + 1)),
        ])
    }
}

/// A timer that fired.
struct FiredTimer {
    at: u64,
    t: u64,
    p: u64,
}

fn due(context: &RunContext, decision: &Decision) -> Option<FiredTimer> {
    let Decision::Timer { t, p, .. } = *decision else { return None };
    let at = context.due(t, p)?;
    Some(FiredTimer { at, t, p })
}

/// Returns the situations that hold.
fn holding<const N: usize>(edges: [(Edge, bool); N]) -> impl Iterator<Item = Edge> {
    edges.into_iter().filter(|(_, holds)| *holds).map(|(edge, _)| edge)
}
