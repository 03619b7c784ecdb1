//! Drives the command through the cases of a suite and gathers the results.

use std::ffi::OsString;
use std::time::{Duration, Instant};

use fuseline_testkit::Coverage;
use indicatif::{HumanCount, ProgressBar};

use super::case::{CasePlace, DriveCase, Suite};
use super::extent::DrivenExtent;
use super::options::Args;
use super::reach::DriveLimits;
use super::repeat::{Need, RepeatedFinding, repeat};
use super::report::{CaseOutcome, DriveReport, ReportedFinding};
use super::save;
use super::shrink::{DriveFinding, FindingKind};
use super::trial::{Bench, DriveStop, SentCase};
use crate::diagnostics::print_line;
use crate::interrupt::Interrupt;
use crate::progress::styled;

/// Progress is printed this often if there is no terminal.
const TELL: Duration = Duration::from_secs(10);
/// After this many cases in a row to which the command did not answer by the protocol, no other is
/// tried.
const PATIENCE: usize = 3;

/// Ranks differences, the most telling one first: by whether the case is of another rule, then by
/// the length of the trace.
type DifferenceRank = (bool, usize);

/// A difference in a case, and what its process was sent before.
struct CaseDifference {
    case: DriveCase,
    finding: DriveFinding,
    sent: Vec<SentCase>,
}

pub(super) struct CaseRunner<'a> {
    args: &'a Args,
    bench: Bench,
    bar: ProgressBar,
    since: Instant,
    /// The instant at which progress was last printed, if there is no bar.
    reported: Instant,
    pub(super) report: DriveReport,
}

impl<'a> CaseRunner<'a> {
    pub(super) fn new(args: &'a Args, suite: Suite) -> Self {
        let bench = Bench::new(args.command.clone(), args.wait, args.values, Interrupt::watch());
        let limits = args.limits();
        let bar = bar(limits, suite.fixed.len() as u64, args.cases);
        let command = quoted(&args.command);
        let report = DriveReport {
            name: args.name.clone().unwrap_or_else(|| command.clone()),
            command,
            fixed: suite.fixed.iter().map(|case| (case.id.clone(), CaseOutcome::NotRun)).collect(),
            suite,
            limits,
            passed: 0,
            passed_inputs: 0,
            failed: None,
            findings: Vec::new(),
            at_end: None,
            was_interrupted: false,
            gave_up: false,
            was_out_of_time: false,
            inputs: 0,
            took: Duration::ZERO,
            reach: Coverage::default(),
            extent: DrivenExtent::default(),
        };
        let now = Instant::now();
        Self { args, bench, bar, since: now, reported: now, report }
    }

    /// Drives all fixed cases, and the generated ones up to the first difference.
    pub(super) fn all(&mut self) -> Result<(), DriveStop> {
        let mut first = None;
        let driven = self.fixed(&mut first);
        if let Some((_, difference)) = first {
            self.find(difference);
        }
        if driven? {
            self.generated()?;
            self.report.at_end = self.bench.end()?;
        }
        Ok(())
    }

    /// Drives the generated cases up to the first difference, or until there are enough.
    fn generated(&mut self) -> Result<(), DriveStop> {
        for number in 0..self.report.suite.generated {
            if self.report.passed_inputs >= self.report.limits.inputs {
                break;
            }
            if self.report.limits.time.is_some_and(|time| self.since.elapsed() >= time) {
                self.report.was_out_of_time = true;
                break;
            }
            let case = self.report.suite.case(number);
            let inputs = case.run.inputs.len() as u64;
            if let Some(difference) = self.run(case, CasePlace::Generated(number))? {
                let outcome = CaseOutcome::of(&difference.finding);
                self.report.failed = Some((difference.case.id.clone(), outcome));
                self.find(difference);
                break;
            }
            self.report.passed += 1;
            self.report.passed_inputs += inputs;
            if self.report.limits.inputs < u64::MAX {
                self.bar.inc(inputs);
            }
        }
        Ok(())
    }

    /// Drives the fixed cases; `first` becomes the difference that shows most. Returns `false` if
    /// the command does not answer, or not by the protocol, so that no other case is tried.
    fn fixed(
        &mut self,
        first: &mut Option<(DifferenceRank, CaseDifference)>,
    ) -> Result<bool, DriveStop> {
        let mut misbehaved = 0;
        for (index, case) in self.report.suite.fixed.clone().into_iter().enumerate() {
            let Some(difference) = self.run(case, CasePlace::Fixed(index))? else {
                self.report.fixed[index].1 = CaseOutcome::Passes;
                misbehaved = 0;
                continue;
            };
            let CaseDifference { case, finding, .. } = &difference;
            self.report.fixed[index].1 = CaseOutcome::of(finding);
            let (count, is_slow) = match &finding.kind {
                FindingKind::Misbehaves(misbehaviour) => (misbehaved + 1, misbehaviour.is_slow()),
                FindingKind::Breaks(_) => (0, false),
            };
            misbehaved = count;
            let key = (!is_telling(case, finding), finding.reported.events.len());
            if first.as_ref().is_none_or(|(least, _)| key < *least) {
                *first = Some((key, difference));
            }
            if is_slow || misbehaved >= PATIENCE {
                self.report.gave_up =
                    index + 1 < self.report.fixed.len() || !self.report.limits.is_named;
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn run(
        &mut self,
        case: DriveCase,
        place: CasePlace,
    ) -> Result<Option<CaseDifference>, DriveStop> {
        let (outcome, sent) = self.bench.try_case(place, &case.run)?;
        let finding = DriveFinding::of(outcome);
        if finding.is_none() {
            self.report.extent.add(&case.run, &mut self.report.reach);
        }
        if self.report.limits.inputs == u64::MAX || self.report.limits.is_named {
            self.bar.inc(1);
        }
        self.report.inputs = self.bench.inputs;
        self.report.took = self.since.elapsed();
        if self.bar.is_hidden() && self.reported.elapsed() >= TELL {
            self.reported = Instant::now();
            print_line(format_args!("{}", self.progress()));
        }
        Ok(finding.map(|finding| CaseDifference { case, finding, sent }))
    }

    /// Returns the progress as a line for a log.
    fn progress(&self) -> String {
        let report = &self.report;
        let runs = HumanCount(report.runs());
        if report.passed == 0 {
            return format!("{runs} runs; {} cases come first", report.fixed.len());
        }
        let inputs = HumanCount(report.passed_inputs);
        match (self.report.limits.inputs, self.args.cases) {
            (u64::MAX, Some(cases)) => {
                format!("{} of {} generated runs", HumanCount(report.passed), HumanCount(cases))
            }
            (u64::MAX, None) => format!("{runs} runs, {inputs} inputs of generated ones"),
            (all, _) => format!("{inputs} of {} inputs of generated runs", HumanCount(all)),
        }
    }

    /// Notes what is wrong, in a smallest run that shows it again.
    fn find(&mut self, difference: CaseDifference) {
        let CaseDifference { case, finding, sent } = difference;
        let of = case.run.inputs.len();
        let RepeatedFinding { finding, need } =
            repeat(&mut self.bench, &self.report.suite, finding, &sent);
        // Trials must not affect later runs.
        self.bench.restart();
        let (before, replaces) = (need.runs().len(), self.args.overwrite.force);
        let folder = self.args.save.as_deref();
        let saved = folder.map(|folder| save::paths(folder, &case.id, before, replaces));
        let cases = match &saved {
            Some(saved) => Some(saved.iter().map(Into::into).collect()),
            None => self.names(&need, &case.name),
        };
        let saved = saved.unwrap_or_default();
        let replay = cases.map(|cases| self.replay(&cases, !saved.is_empty()));
        let entry = ReportedFinding { case: case.id, of, finding, need, saved, replay };
        self.report.findings.push(entry);
    }

    /// Returns the cases that show it again, by their names, if names do.
    fn names(&self, need: &Need, name: &str) -> Option<Vec<OsString>> {
        let mut names = Vec::new();
        if let Need::Before { cases, .. } = need {
            for place in cases.as_ref()? {
                names.push(self.report.suite.at(*place)?.name.into());
            }
        }
        names.push(name.into());
        Some(names)
    }

    /// Returns the command line that shows it again.
    fn replay(&self, cases: &[OsString], are_files: bool) -> String {
        let mut words: Vec<OsString> = ["fuseline", "drive"].map(Into::into).into();
        if !are_files {
            let commit = self.report.suite.generator.commit;
            words
                .extend(commit.iter().flat_map(|rule| ["--commit", rule.as_str()]).map(Into::into));
            let clouds = self.args.clouds.map(|clouds| clouds.to_string());
            words.extend(clouds.iter().flat_map(|clouds| ["--clouds", clouds]).map(Into::into));
        }
        if self.args.values {
            words.push("--values".into());
        }
        words.push("--run".into());
        words.extend(cases.iter().cloned());
        words.push("--".into());
        words.extend(self.args.command.iter().cloned());
        quoted(&words)
    }

    pub(super) fn finish(mut self) -> DriveReport {
        self.bar.finish_and_clear();
        // With a number of runs, those that were not driven count; with a bound, those that were
        // begun are all.
        if self.args.cases.is_none() {
            let failed = u64::from(self.report.failed.is_some());
            self.report.suite.generated = self.report.passed + failed;
        }
        self.report
    }
}

fn bar(limits: DriveLimits, fixed: u64, cases: Option<u64>) -> ProgressBar {
    let runs = "{wide_bar} {human_pos} of {human_len} runs, {eta}";
    match (limits.inputs, cases) {
        _ if limits.is_named => styled(Some(fixed), runs),
        (u64::MAX, Some(cases)) => styled(Some(fixed.saturating_add(cases)), runs),
        (u64::MAX, None) => styled(None, "{spinner} {human_pos} runs, {elapsed}"),
        (inputs, _) => styled(Some(inputs), "{wide_bar} {human_pos} of {human_len} inputs, {eta}"),
    }
}

/// Returns `true` if a case is one of the rule that it shows broken.
fn is_telling(case: &DriveCase, finding: &DriveFinding) -> bool {
    let FindingKind::Breaks(rule) = finding.kind else { return false };
    case.id.split('-').next().is_some_and(|id| id.eq_ignore_ascii_case(rule.id()))
}

/// Returns the words, quoted for a shell.
pub(super) fn quoted(words: &[OsString]) -> String {
    let words: Vec<_> = words.iter().map(|word| word.to_string_lossy()).collect();
    let quote = |word: &str| shlex::try_quote(word).map_or_else(|_| word.into(), Into::into);
    words.iter().map(|word| quote(word)).collect::<Vec<String>>().join(" ")
}
