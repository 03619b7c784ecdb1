//! Shrinks a run that shows a difference to a smallest one that still shows it.
//!
//! A smaller run counts only if the command, driven through it, shows the same; runs and time are
//! bounded.

use std::collections::BTreeSet;
use std::mem::discriminant;
use std::time::{Duration, Instant};

use fuseline_testkit::{Run, Simplification};
use fuseline_traces::{Cloud, Header, Input, Rule};

use super::peer::ProtocolViolation;
use super::trial::{Bench, Comparison, DriveStop, Transcript};

/// The most inputs of all runs that are tried. They bound the time of a finding that needs hundreds
/// of inputs.
const INPUTS: usize = 40_000;
/// The longest that the search may take with a slow command.
const LONGEST: Duration = Duration::from_secs(30);

/// The finding of a run, with the inputs and the answers.
pub(super) struct DriveFinding {
    pub(super) reported: Transcript,
    pub(super) kind: FindingKind,
}

/// The finding about a command.
pub(super) enum FindingKind {
    /// It breaks a rule.
    Breaks(Rule),
    Misbehaves(ProtocolViolation),
}

impl DriveFinding {
    /// Returns the finding of a run, if there is one.
    pub(super) fn of(outcome: Comparison) -> Option<Self> {
        match outcome {
            Comparison::Same => None,
            Comparison::Differs(reported) => {
                let verdict = reported.verdict("")?;
                let rule = verdict.violations.first()?.rule;
                Some(Self { reported, kind: FindingKind::Breaks(rule) })
            }
            Comparison::Misbehaves(reported, misbehaviour) => {
                Some(Self { reported, kind: FindingKind::Misbehaves(misbehaviour) })
            }
        }
    }

    /// Returns `true` if it is worth trying again: not if that only waits as long again, or if
    /// nothing can be left out.
    pub(super) fn is_repeatable(&self) -> bool {
        match &self.kind {
            FindingKind::Breaks(_) => true,
            FindingKind::Misbehaves(misbehaviour) => {
                !misbehaviour.is_slow() && self.reported.inputs().next().is_some()
            }
        }
    }

    /// Returns `true` if another run shows the same.
    pub(super) fn is_as(&self, other: &Self) -> bool {
        match (&self.kind, &other.kind) {
            (FindingKind::Breaks(one), FindingKind::Breaks(two)) => one == two,
            (FindingKind::Misbehaves(one), FindingKind::Misbehaves(two)) => {
                discriminant(one) == discriminant(two)
            }
            (FindingKind::Breaks(_), FindingKind::Misbehaves(_))
            | (FindingKind::Misbehaves(_), FindingKind::Breaks(_)) => false,
        }
    }
}

/// Returns the smallest run found that shows what `first` shows, each tried in a new process if it
/// is to be `afresh`; what stops the command ends the search.
pub(super) fn shrink(bench: &mut Bench, first: DriveFinding, afresh: bool) -> DriveFinding {
    let run = first.reported.run();
    let (mut best, mut least) = (first, cost(&run));
    let (mut inputs, start) = (0, Instant::now());
    // The best so far stands whatever stopped the search.
    let _ = fuseline_testkit::shrink(run, simplifications, |run| {
        let mut priorities = BTreeSet::new();
        let is_header = run.header.clouds.iter().all(|cloud| priorities.insert(cloud.p));
        let is_over = inputs >= INPUTS || start.elapsed() >= LONGEST;
        if is_over || !is_header || cost(run) >= least {
            return Ok(false);
        }
        inputs += run.inputs.len();
        if afresh {
            bench.restart();
        }
        match DriveFinding::of(bench.try_run(run)?) {
            Some(finding) if finding.is_as(&best) => {
                (best, least) = (finding, cost(run));
                Ok(true)
            }
            Some(_) | None => Ok::<_, DriveStop>(false),
        }
    });
    best
}

/// Leaves out all of a timestamp, of a source or a cloud, makes the window, the clouds and the
/// inputs plain, and numbers timestamps and clouds from 1.
fn simplifications(run: &Run) -> Vec<Simplification<Run>> {
    let mut all: Vec<Simplification<Run>> = Vec::new();
    for t in run.inputs.iter().map(Input::t).collect::<BTreeSet<_>>() {
        all.push(Box::new(move |run| run.inputs.retain(|input| input.t() != t)));
    }
    for p in run.inputs.iter().filter_map(source).collect::<BTreeSet<_>>() {
        all.push(Box::new(move |run| run.inputs.retain(|input| source(input) != Some(p))));
    }
    for p in run.header.clouds.iter().rev().map(|cloud| cloud.p) {
        all.push(Box::new(move |run| run.header.clouds.retain(|cloud| cloud.p != p)));
    }
    for window in [1, 2, 4, 16] {
        all.push(Box::new(move |run| run.header.window = window));
    }
    for i in 0..run.header.clouds.len() {
        for limit in [1, 2, 31] {
            all.push(Box::new(move |run| {
                if let Some(cloud) = run.header.clouds.get_mut(i) {
                    *cloud = Cloud { p: cloud.p, name: None, limit, resume: limit - 1 };
                }
            }));
        }
    }
    all.push(Box::new(number_timestamps));
    all.push(Box::new(number_clouds));
    for i in 0..run.inputs.len() {
        for field in 0..4 {
            for small in [None, Some(0), Some(1), Some(10), Some(100)] {
                all.push(Box::new(move |run| {
                    if let Some(input) = run.inputs.get_mut(i) {
                        replace(input, field, small);
                    }
                }));
            }
            for later in [0, 10] {
                all.push(Box::new(move |run| {
                    let before = i.checked_sub(1).and_then(|i| run.inputs.get(i));
                    let small = before.map_or(0, Input::at).saturating_add(later);
                    if let Some(input) = run.inputs.get_mut(i) {
                        replace(input, field, Some(small));
                    }
                }));
            }
        }
    }
    all
}

fn number_timestamps(run: &mut Run) {
    let names: BTreeSet<u64> = run.inputs.iter().filter_map(Input::t).collect();
    for input in &mut run.inputs {
        if let Input::Open { t, .. }
        | Input::Offer { t, .. }
        | Input::Result { t, .. }
        | Input::Fail { t, .. } = input
        {
            *t = rank(&names, *t);
        }
    }
}

fn number_clouds(run: &mut Run) {
    let clouds = &mut run.header.clouds;
    let names: BTreeSet<u64> = clouds.iter().map(|cloud| u64::from(cloud.p)).collect();
    for cloud in clouds {
        cloud.p = u16::try_from(rank(&names, cloud.p.into())).unwrap_or(cloud.p);
    }
    for input in &mut run.inputs {
        if let Input::Offer { p, .. } | Input::Result { p, .. } | Input::Fail { p, .. } = input
            && names.contains(p)
        {
            *p = rank(&names, *p);
        }
    }
}

/// Returns the size of a run for a reader: its inputs first, then its clouds, its digits and its
/// names.
fn cost(run: &Run) -> (usize, usize, usize, u128) {
    let Run { header: Header { window, clouds, .. }, inputs } = run;
    let odd = |cloud: &Cloud| usize::from(cloud.resume != cloud.limit - 1);
    let of_clouds = clouds.iter().map(|cloud| {
        digits(cloud.p.into()) + digits(cloud.limit) + digits(cloud.resume) * odd(cloud)
    });
    let of_inputs = inputs.iter().map(|input| match *input {
        Input::Open { at, t, deadline } => {
            digits(at) + digits(t) + deadline.map_or(0, |d| 1 + digits(d))
        }
        Input::Offer { at, t, p, deadline, backlog } => {
            [at, t, p, deadline, backlog].map(digits).iter().sum()
        }
        Input::Result { at, t, p } | Input::Fail { at, t, p } => digits(at) + digits(t) + digits(p),
        Input::Tick { at } => digits(at),
    });
    let whole = of_clouds.chain(of_inputs).sum::<usize>() + digits((*window).into());
    let names = inputs.iter().flat_map(|input| [input.t(), source(input)]).flatten();
    (inputs.len(), clouds.len(), whole, names.map(u128::from).sum())
}

/// Returns how hard a number is to read: two for each digit, and one less if only the first digit
/// is not 0.
fn digits(number: u64) -> usize {
    let text = number.to_string();
    2 * text.len() - usize::from(text.len() > 1 && text.trim_end_matches('0').len() == 1)
}

const fn source(input: &Input) -> Option<u64> {
    match input {
        Input::Offer { p, .. } | Input::Result { p, .. } | Input::Fail { p, .. } => Some(*p),
        Input::Open { .. } | Input::Tick { .. } => None,
    }
}

/// Puts a small number in a field, or none where it may be left out.
fn replace(input: &mut Input, field: usize, small: Option<u64>) {
    let target = match (input, field) {
        (Input::Open { deadline, .. }, 1) if deadline.is_some() => {
            *deadline = small;
            return;
        }
        (
            Input::Open { at, .. }
            | Input::Offer { at, .. }
            | Input::Result { at, .. }
            | Input::Fail { at, .. }
            | Input::Tick { at },
            0,
        ) => at,
        (Input::Offer { deadline, .. }, 1) => deadline,
        (Input::Offer { backlog, .. }, 2) => backlog,
        (Input::Offer { p, .. } | Input::Result { p, .. } | Input::Fail { p, .. }, 3) => p,
        _ => return,
    };
    if let Some(small) = small {
        *target = small;
    }
}

/// Returns the index of a name among all, from 1.
fn rank(names: &BTreeSet<u64>, name: u64) -> u64 {
    names.range(..=name).count() as u64
}
