//! Records how far the runs went. Whatever lies beyond was not driven.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use fuseline_testkit::{Coverage, RuleDecision, Run, RunContext};
use fuseline_traces::{Decision, Header, Input};
use serde::Serialize;

/// The extent of the runs that passed.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize)]
pub(super) struct DrivenExtent {
    /// The number of runs of each commit rule.
    pub(super) commits: BTreeMap<&'static str, u64>,
    /// The most clouds registered.
    pub(super) clouds: usize,
    /// The greatest priority of a cloud.
    pub(super) priority: u16,
    /// The greatest window.
    pub(super) window: u16,
    /// The windows that were full at some time.
    pub(super) filled: BTreeSet<u16>,
    /// The most inputs of one run.
    pub(super) inputs: usize,
    /// The steps by which the clock went forward at one input, in nanoseconds.
    pub(super) forward: Option<StepRange>,
    /// The steps by which an input's instant lay before the clock, in nanoseconds.
    pub(super) back: Option<StepRange>,
    /// The most results held for one timestamp at a time.
    pub(super) held: usize,
    /// The most outputs of one timestamp, under progressive.
    pub(super) outputs: usize,
    /// The most inputs in a row while a gate was shut.
    pub(super) shut: usize,
    /// The number of runs that had the header of the run before.
    pub(super) same_header: u64,
    /// The greatest number of each kind, in bits.
    pub(super) bits: NumberBits,
    /// The header of the run before.
    #[serde(skip)]
    last: Option<Header>,
}

/// The least and the greatest of some durations, in nanoseconds.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
pub(super) struct StepRange {
    pub(super) least: u64,
    pub(super) greatest: u64,
}

/// The number of bits of the greatest number of each kind.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize)]
pub(super) struct NumberBits {
    pub(super) timestamps: u32,
    pub(super) instants: u32,
    pub(super) deadlines: u32,
    /// The priorities of inputs, many of which no cloud has.
    pub(super) priorities: u32,
    pub(super) backlogs: u32,
    pub(super) limits: u32,
}

impl NumberBits {
    /// Returns all of them, with their names.
    pub(super) const fn all(self) -> [(&'static str, u32); 6] {
        [
            ("timestamps", self.timestamps),
            ("instants", self.instants),
            ("deadlines", self.deadlines),
            ("priorities", self.priorities),
            ("backlogs", self.backlogs),
            ("limits", self.limits),
        ]
    }
}

impl DrivenExtent {
    /// Notes a run that passed, here and in what was reached.
    pub(super) fn add(&mut self, run: &Run, reach: &mut Coverage) {
        self.header(&run.header);
        self.inputs = self.inputs.max(run.inputs.len());
        let mut context = reach.begin(run);
        let (mut held, mut outputs) = (HashMap::new(), HashMap::new());
        // Since which input each cloud's gate is shut.
        let mut shut = HashMap::new();
        for (index, input) in run.inputs.iter().enumerate() {
            self.numbers(input);
            self.step(context.now(), input.at());
            let step = reach.follow(&mut context, input);
            self.chains(&step, &mut held, &mut outputs);
            if context.open().len() == context.window() {
                self.filled.insert(run.header.window);
            }
            self.gate(input, index, &context, &mut shut);
        }
    }

    fn header(&mut self, header: &Header) {
        *self.commits.entry(header.commit.as_str()).or_default() += 1;
        let priority = header.clouds.iter().map(|cloud| cloud.p).max().unwrap_or_default();
        self.clouds = self.clouds.max(header.clouds.len());
        self.priority = self.priority.max(priority);
        self.window = self.window.max(header.window);
        let limits = header.clouds.iter().map(|cloud| cloud.limit);
        widen(&mut self.bits.limits, limits.max().unwrap_or_default());
        self.same_header += u64::from(self.last.as_ref() == Some(header));
        self.last = Some(header.clone());
    }

    fn numbers(&mut self, input: &Input) {
        let bits = &mut self.bits;
        widen(&mut bits.instants, input.at());
        widen(&mut bits.timestamps, input.t().unwrap_or_default());
        match *input {
            Input::Open { deadline, .. } => widen(&mut bits.deadlines, deadline.unwrap_or(0)),
            Input::Offer { p, deadline, backlog, .. } => {
                widen(&mut bits.priorities, p);
                widen(&mut bits.deadlines, deadline);
                widen(&mut bits.backlogs, backlog);
            }
            Input::Result { p, .. } | Input::Fail { p, .. } => widen(&mut bits.priorities, p),
            Input::Tick { .. } => {}
        }
    }

    fn step(&mut self, now: u64, at: u64) {
        let (range, length) =
            if at > now { (&mut self.forward, at - now) } else { (&mut self.back, now - at) };
        if length > 0 {
            let before = range.unwrap_or(StepRange { least: length, greatest: length });
            let least = before.least.min(length);
            *range = Some(StepRange { least, greatest: before.greatest.max(length) });
        }
    }

    fn chains(
        &mut self,
        step: &RuleDecision,
        held: &mut HashMap<u64, usize>,
        outputs: &mut HashMap<u64, usize>,
    ) {
        for decision in step.decisions() {
            let (counts, greatest, t) = match decision {
                Decision::Hold { t, .. } => (&mut *held, &mut self.held, *t),
                Decision::Emit { t, .. } => (&mut *outputs, &mut self.outputs, *t),
                Decision::Timer { .. }
                | Decision::RefuseOpen { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Request { .. }
                | Decision::Drop { .. }
                | Decision::Final { .. }
                | Decision::Miss { .. }
                | Decision::Cancel { .. } => continue,
            };
            let count = counts.entry(t).or_default();
            *count += 1;
            *greatest = (*greatest).max(*count);
        }
    }

    fn gate(
        &mut self,
        input: &Input,
        index: usize,
        context: &RunContext,
        shut: &mut HashMap<u64, usize>,
    ) {
        if let Input::Offer { p, .. } = *input
            && let Some(gate) = context.gate(p)
        {
            if gate.is_shut {
                shut.entry(p).or_insert(index);
            } else {
                shut.remove(&p);
            }
        }
        let longest = shut.values().map(|since| index - since).max();
        self.shut = self.shut.max(longest.unwrap_or_default());
    }
}

/// Notes how many bits a number has.
fn widen(bits: &mut u32, number: u64) {
    *bits = (*bits).max(u64::BITS - number.leading_zeros());
}
