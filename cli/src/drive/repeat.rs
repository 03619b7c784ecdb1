//! Shows a finding again: alone in a new process, or after the runs before it that it needs.

use std::ops::Range;
use std::time::{Duration, Instant};

use fuseline_testkit::{Run, Steps};

use super::case::{CasePlace, Suite};
use super::shrink::{DriveFinding, shrink};
use super::trial::{Bench, DriveStop, SentCase};

/// The longest that a search for the runs before may take.
const LONGEST: Duration = Duration::from_secs(8);

/// A finding in its smallest form.
pub(super) struct RepeatedFinding {
    pub(super) finding: DriveFinding,
    pub(super) need: Need,
}

/// The runs that a finding needs in order to appear again.
pub(super) enum Need {
    /// Its run alone shows it, in a process of its own.
    Nothing,
    /// It passes alone, and shows after these runs in the same process.
    Before {
        runs: Vec<Run>,
        /// The cases that the runs are, if each is a whole one.
        cases: Option<Vec<CasePlace>>,
    },
    /// Neither shows it again.
    Unknown,
    /// It was not tried.
    Untried,
}

impl Need {
    /// Returns the runs before it that it needs.
    pub(super) fn runs(&self) -> &[Run] {
        match self {
            Self::Before { runs, .. } => runs,
            Self::Nothing | Self::Unknown | Self::Untried => &[],
        }
    }
}

/// Runs of one process, the last of which shows a finding.
#[derive(Clone, PartialEq)]
struct RunSequence {
    runs: Vec<Run>,
}

impl Steps for RunSequence {
    fn count(&self) -> usize {
        self.runs.iter().map(|run| run.inputs.len()).sum()
    }

    fn remove(&mut self, steps: Range<usize>) {
        let mut first = 0;
        for run in &mut self.runs {
            let len = run.inputs.len();
            let place = |step: usize| step.clamp(first, first + len) - first;
            run.inputs.drain(place(steps.start)..place(steps.end));
            first += len;
        }
    }
}

/// Shows `first` again in new processes and makes it small; `sent` is what its process was sent
/// before. What stops the command ends the search.
pub(super) fn repeat(
    bench: &mut Bench,
    suite: &Suite,
    first: DriveFinding,
    sent: &[SentCase],
) -> RepeatedFinding {
    if !first.is_repeatable() {
        return RepeatedFinding { finding: first, need: Need::Untried };
    }
    let run = first.reported.run();
    match shows(bench, &[], &run, &first) {
        Ok(Some(finding)) => alone(bench, finding),
        Ok(None) => after(bench, suite, first, sent),
        Err(_) => RepeatedFinding { finding: first, need: Need::Untried },
    }
}

/// Returns the finding of a run in a new process after other runs, if it is the finding of `like`.
fn shows(
    bench: &mut Bench,
    before: &[Run],
    run: &Run,
    like: &DriveFinding,
) -> Result<Option<DriveFinding>, DriveStop> {
    bench.restart();
    for run in before {
        if !bench.feed(run)? {
            return Ok(None);
        }
    }
    Ok(DriveFinding::of(bench.try_run(run)?).filter(|finding| finding.is_as(like)))
}

/// Makes a finding small that shows alone. Most commands begin afresh with a header, so that one
/// process does for all tries; whether that held is tried at the end.
fn alone(bench: &mut Bench, finding: DriveFinding) -> RepeatedFinding {
    let run = finding.reported.run();
    let small = shrink(bench, finding, false);
    match shows(bench, &[], &small.reported.run(), &small) {
        Ok(None) => {}
        Ok(Some(_)) | Err(_) => return RepeatedFinding { finding: small, need: Need::Nothing },
    }
    let again = shows(bench, &[], &run, &small);
    match again {
        Ok(Some(finding)) => {
            let finding = shrink(bench, finding, true);
            RepeatedFinding { finding, need: Need::Nothing }
        }
        Ok(None) => RepeatedFinding { finding: small, need: Need::Unknown },
        Err(_) => RepeatedFinding { finding: small, need: Need::Untried },
    }
}

/// Looks for the runs before that a finding needs, the latest first.
fn after(
    bench: &mut Bench,
    suite: &Suite,
    first: DriveFinding,
    sent: &[SentCase],
) -> RepeatedFinding {
    let until = Instant::now() + LONGEST;
    let run = first.reported.run();
    let mut best = None;
    let mut count = 1;
    while best.is_none() && !sent.is_empty() {
        let count_now = count.min(sent.len());
        let latest = &sent[sent.len() - count_now..];
        match shows(bench, &runs(suite, latest), &run, &first) {
            Ok(Some(finding)) => best = Some((latest.to_vec(), finding)),
            Ok(None) if count_now < sent.len() => count *= 4,
            Ok(None) => break,
            Err(_) => return RepeatedFinding { finding: first, need: Need::Untried },
        }
    }
    let Some((latest, finding)) = best else {
        return RepeatedFinding { finding: first, need: Need::Unknown };
    };
    fewer(bench, suite, latest, finding, until)
}

/// Leaves out runs, and then inputs, that the finding does not need.
fn fewer(
    bench: &mut Bench,
    suite: &Suite,
    latest: Vec<SentCase>,
    finding: DriveFinding,
    until: Instant,
) -> RepeatedFinding {
    let run = finding.reported.run();
    let mut best = finding;
    let mut needed = latest.clone();
    // The best so far stands whatever stopped the search.
    let _ = fuseline_testkit::shrink(
        latest,
        |_| Vec::new(),
        |cases| {
            if Instant::now() >= until {
                return Ok(false);
            }
            let found = shows(bench, &runs(suite, cases), &run, &best)?;
            if let Some(finding) = found {
                (best, needed) = (finding, cases.clone());
                return Ok::<_, DriveStop>(true);
            }
            Ok(false)
        },
    );
    let whole = |sent: &SentCase| {
        suite.at(sent.place).is_some_and(|case| case.run.inputs.len() == sent.inputs)
    };
    let cases = needed.iter().all(whole).then(|| needed.iter().map(|sent| sent.place).collect());
    let mut before = runs(suite, &needed);
    let sequence = RunSequence { runs: [&before[..], &[run]].concat() };
    let _ = fuseline_testkit::shrink(
        sequence,
        |_| Vec::new(),
        |sequence| {
            let Some((run, others)) = sequence.runs.split_last() else { return Ok(false) };
            if Instant::now() >= until {
                return Ok(false);
            }
            if let Some(finding) = shows(bench, others, run, &best)? {
                (best, before) = (finding, others.to_vec());
                return Ok::<_, DriveStop>(true);
            }
            Ok(false)
        },
    );
    RepeatedFinding { finding: best, need: Need::Before { runs: before, cases } }
}

/// Returns the runs as they were sent.
fn runs(suite: &Suite, sent: &[SentCase]) -> Vec<Run> {
    let run = |sent: &SentCase| {
        let mut run = suite.at(sent.place)?.run;
        run.inputs.truncate(sent.inputs);
        Some(run)
    };
    sent.iter().filter_map(run).collect()
}
