//! Shrinks a run that shows a difference to a smallest one that still shows it.
//!
//! A smaller run counts only if the command, driven through it, shows the same; runs and time are bounded.

use std::collections::BTreeSet;
use std::mem::discriminant;
use std::time::{Duration, Instant};

use fuseline_testkit::Run;
use fuseline_traces::{Cloud, Header, Input, Rule};

use super::peer::ProtocolViolation;
use super::trial::{Bench, Comparison, Stop, Transcript};

/// The most runs that are tried.
const TRIES: u32 = 4000;
/// The longest that the search may take.
const LONGEST: Duration = Duration::from_secs(20);

/// What a run shows, with what was sent and answered.
pub(super) struct Finding {
    pub(super) reported: Transcript,
    pub(super) what: FindingKind,
}

/// What is wrong with a command.
pub(super) enum FindingKind {
    /// It breaks a rule.
    Breaks(Rule),
    Misbehaves(ProtocolViolation),
}

impl Finding {
    /// What a run shows, if anything.
    pub(super) fn of(outcome: Comparison) -> Option<Self> {
        match outcome {
            Comparison::Same => None,
            Comparison::Differs(reported) => {
                let verdict = reported.verdict("")?;
                let rule = verdict.violations.first()?.rule;
                Some(Self { reported, what: FindingKind::Breaks(rule) })
            }
            Comparison::Misbehaves(reported, how) => {
                Some(Self { reported, what: FindingKind::Misbehaves(how) })
            }
        }
    }

    /// Whether another run shows the same.
    pub(super) fn is_as(&self, other: &Self) -> bool {
        match (&self.what, &other.what) {
            (FindingKind::Breaks(one), FindingKind::Breaks(two)) => one == two,
            (FindingKind::Misbehaves(one), FindingKind::Misbehaves(two)) => {
                discriminant(one) == discriminant(two)
            }
            (FindingKind::Breaks(_), FindingKind::Misbehaves(_))
            | (FindingKind::Misbehaves(_), FindingKind::Breaks(_)) => false,
        }
    }
}

/// The smallest run found that shows what `first` shows; what stops the command ends the search.
pub(super) fn shrink(bench: &mut Bench, first: Finding) -> Finding {
    if matches!(&first.what, FindingKind::Misbehaves(how) if how.is_slow()) {
        return first;
    }
    let mut search = Search { bench, best: first, tries: 0, since: Instant::now() };
    while let Ok(true) = search.pass() {}
    search.best
}

struct Search<'a> {
    bench: &'a mut Bench,
    best: Finding,
    tries: u32,
    since: Instant,
}

impl Search<'_> {
    /// Tries everything once; says whether that made it smaller.
    fn pass(&mut self) -> Result<bool, Stop> {
        let before = cost(&self.best.reported.run());
        self.remove()?;
        self.simplify_header()?;
        self.simplify_inputs()?;
        Ok(cost(&self.best.reported.run()) < before && !self.is_over())
    }

    /// Keeps a run as the best so far if it is smaller and shows the same.
    fn attempt(&mut self, run: &Run) -> Result<bool, Stop> {
        let mut taken = BTreeSet::new();
        let is_header = run.header.clouds.iter().all(|cloud| taken.insert(cloud.p));
        if self.is_over() || !is_header || cost(run) >= cost(&self.best.reported.run()) {
            return Ok(false);
        }
        self.tries += 1;
        match Finding::of(self.bench.try_run(run)?) {
            Some(finding) if finding.is_as(&self.best) => self.best = finding,
            Some(_) | None => return Ok(false),
        }
        Ok(true)
    }

    fn is_over(&self) -> bool {
        self.tries >= TRIES || self.since.elapsed() >= LONGEST
    }

    /// Leaves out all of a timestamp, all of a source, and stretches, shorter and shorter ones.
    fn remove(&mut self) -> Result<(), Stop> {
        let timestamps: BTreeSet<_> = self.best.reported.inputs().map(|input| input.t()).collect();
        for t in timestamps {
            let mut run = self.best.reported.run();
            run.inputs.retain(|input| input.t() != t);
            self.attempt(&run)?;
        }
        let sources: BTreeSet<_> =
            self.best.reported.inputs().map(|input| source(&input)).collect();
        for p in sources.into_iter().flatten() {
            let mut run = self.best.reported.run();
            run.inputs.retain(|input| source(input) != Some(p));
            self.attempt(&run)?;
        }
        let mut stretch = (self.best.reported.inputs().count() / 2).max(1);
        loop {
            let mut from = 0;
            while from < self.best.reported.inputs().count() {
                let mut run = self.best.reported.run();
                let to = (from + stretch).min(run.inputs.len());
                run.inputs.drain(from..to);
                if !self.attempt(&run)? {
                    from += stretch;
                }
            }
            if stretch == 1 {
                return Ok(());
            }
            stretch /= 2;
        }
    }

    /// Leaves out clouds, and makes the others and the window plain.
    fn simplify_header(&mut self) -> Result<(), Stop> {
        for i in (0..self.best.reported.header.clouds.len()).rev() {
            let mut run = self.best.reported.run();
            run.header.clouds.remove(i);
            self.attempt(&run)?;
        }
        for window in [1, 2, 4, 16] {
            let mut run = self.best.reported.run();
            run.header.window = window;
            self.attempt(&run)?;
        }
        for i in 0..self.best.reported.header.clouds.len() {
            for limit in [1, 2, 31] {
                let mut run = self.best.reported.run();
                let p = run.header.clouds[i].p;
                run.header.clouds[i] = Cloud { p, name: None, limit, resume: limit - 1 };
                self.attempt(&run)?;
            }
        }
        self.rename()
    }

    /// Numbers timestamps and clouds from 1, in their order.
    fn rename(&mut self) -> Result<(), Stop> {
        let mut run = self.best.reported.run();
        let names: BTreeSet<u64> = run.inputs.iter().filter_map(Input::t).collect();
        run.inputs.iter_mut().filter_map(timestamp).for_each(|t| *t = rank(&names, *t));
        self.attempt(&run)?;
        let mut run = self.best.reported.run();
        let names: BTreeSet<u64> =
            run.header.clouds.iter().map(|cloud| u64::from(cloud.p)).collect();
        for cloud in &mut run.header.clouds {
            cloud.p = u16::try_from(rank(&names, cloud.p.into())).unwrap_or(cloud.p);
        }
        let registered = run.inputs.iter_mut().filter_map(priority);
        registered.filter(|p| names.contains(p)).for_each(|p| *p = rank(&names, *p));
        self.attempt(&run)?;
        Ok(())
    }

    /// Makes the numbers of each input small, and leaves out limits.
    fn simplify_inputs(&mut self) -> Result<(), Stop> {
        for i in 0..self.best.reported.inputs().count() {
            for field in 0..4 {
                let run = self.best.reported.run();
                let before = i.checked_sub(1).and_then(|i| run.inputs.get(i)).map_or(0, Input::at);
                for small in [
                    None,
                    Some(0),
                    Some(1),
                    Some(10),
                    Some(100),
                    Some(before),
                    Some(before.saturating_add(10)),
                ] {
                    let mut run = self.best.reported.run();
                    let Some(input) = run.inputs.get_mut(i) else { return Ok(()) };
                    if replace(input, field, small) && self.attempt(&run)? {
                        break;
                    }
                }
            }
        }
        Ok(())
    }
}

/// What makes a run hard to read: its inputs first, then its clouds, its digits, its names.
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

/// How much a number takes to read: its digits, less for one that ends in noughts.
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

/// Puts a small number in a field, or none where it may be left out; says whether there is one.
fn replace(input: &mut Input, field: usize, small: Option<u64>) -> bool {
    let place = match (input, field) {
        (Input::Open { deadline, .. }, 1) if deadline.is_some() => {
            *deadline = small;
            return true;
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
        _ => return false,
    };
    small.map(|small| *place = small).is_some()
}

const fn timestamp(input: &mut Input) -> Option<&mut u64> {
    match input {
        Input::Open { t, .. }
        | Input::Offer { t, .. }
        | Input::Result { t, .. }
        | Input::Fail { t, .. } => Some(t),
        Input::Tick { .. } => None,
    }
}

const fn priority(input: &mut Input) -> Option<&mut u64> {
    match input {
        Input::Offer { p, .. } | Input::Result { p, .. } | Input::Fail { p, .. } => Some(p),
        Input::Open { .. } | Input::Tick { .. } => None,
    }
}

/// The place of a name among all, from 1.
fn rank(names: &BTreeSet<u64>, name: u64) -> u64 {
    names.range(..=name).count() as u64
}
