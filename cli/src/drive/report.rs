//! The report on a driven command, for people and as JSON.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use fuseline_report::AnyViolation;
use fuseline_testkit::Coverage;
use fuseline_traces::{Event, Rule, Verdict};
use indicatif::HumanCount;
use textwrap::{Options, WordSplitter};

use super::case::Suite;
use super::extent::DrivenExtent;
use super::peer::ProtocolViolation;
use super::shrink::{DriveFinding, FindingKind};
use super::words;
use super::written::{GeneratedRuns, WrittenCase, WrittenFinding, WrittenReport, WrittenSuite};
use crate::exit::Exit;
use crate::verdict::{BAD, GOOD, plain, print_violation};

/// How many failed cases are named.
const NAMED: usize = 5;
/// How many lines of a run are shown in words.
const LINES: usize = 16;
/// Lines are at most so many columns wide.
const WIDTH: usize = 96;
/// Where what follows a lead begins.
const INDENT: &str = "            ";

/// The results of driving a command.
pub(super) struct DriveReport {
    /// What the implementation is called.
    pub(super) name: String,
    /// The command, as a shell takes it.
    pub(super) command: String,
    pub(super) suite: Suite,
    /// The fixed cases in their order, with what became of each.
    pub(super) fixed: Vec<(String, CaseOutcome)>,
    /// How many generated runs passed, from the first on.
    pub(super) passed: u64,
    /// The generated run that did not pass.
    pub(super) failed: Option<(String, CaseOutcome)>,
    /// The first thing wrong in the fixed cases and in the generated ones.
    pub(super) findings: Vec<ReportedFinding>,
    /// What the command did when its input ended.
    pub(super) at_end: Option<ProtocolViolation>,
    pub(super) was_interrupted: bool,
    pub(super) inputs: u64,
    pub(super) took: Duration,
    pub(super) reach: Coverage,
    pub(super) extent: DrivenExtent,
    /// How long generated runs could begin, if their number was not given.
    pub(super) budget: Option<Duration>,
}

/// What became of a case.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum CaseOutcome {
    Passes,
    Breaks(Rule),
    Misbehaves,
    NotRun,
}

/// A finding, in its smallest run.
pub(super) struct ReportedFinding {
    pub(super) case: String,
    /// How many inputs its case has.
    pub(super) of: usize,
    pub(super) finding: DriveFinding,
    pub(super) saved: Option<PathBuf>,
    /// The command line that shows it again.
    pub(super) replay: String,
}

impl CaseOutcome {
    pub(super) fn of(finding: &DriveFinding) -> Self {
        match &finding.kind {
            FindingKind::Breaks(rule) => Self::Breaks(*rule),
            FindingKind::Misbehaves(_) => Self::Misbehaves,
        }
    }

    /// The mark in a word or two.
    pub(super) fn word(self) -> String {
        match self {
            Self::Passes => "pass".to_owned(),
            Self::Breaks(rule) => format!("fail, {rule}"),
            Self::Misbehaves => "fail, misbehaves".to_owned(),
            Self::NotRun => "not run".to_owned(),
        }
    }
}

impl ReportedFinding {
    /// The file or the case that shows it.
    pub(super) fn location(&self) -> String {
        self.saved.as_ref().map_or_else(|| self.case.clone(), |saved| saved.display().to_string())
    }

    pub(super) fn verdict(&self) -> Option<Verdict> {
        match self.finding.kind {
            FindingKind::Breaks(_) => self.finding.reported.verdict(&self.location()),
            FindingKind::Misbehaves(_) => None,
        }
    }

    /// What is wrong in its smallest run, in lines without colours.
    pub(super) fn text(&self) -> String {
        plain(|out| self.print_report(out))
    }

    fn print_report(&self, out: &mut impl Write) -> io::Result<()> {
        let reported = &self.finding.reported;
        let small = reported.inputs().count();
        let of = if small < self.of { format!(" of {}", self.of) } else { String::new() };
        writeln!(out, "\nThe smallest run found, {}{of}, from {}:", inputs(small), self.case)?;
        match &self.finding.kind {
            FindingKind::Breaks(_) => {
                if let Some(verdict) = self.verdict()
                    && let Some(violation) = verdict.violations.first()
                {
                    print_violation(&AnyViolation::from(violation), &verdict.file, out)?;
                    self.print_story(out, "in words")?;
                    let [found, expected] = words::both(&violation.found, &violation.expected);
                    writeln!(out, "{INDENT}  found: {found}")?;
                    writeln!(out, "{INDENT}  expected: {expected}")?;
                }
            }
            FindingKind::Misbehaves(misbehaviour) => {
                writeln!(out, "\n{}: {BAD}{misbehaviour}{BAD:#}", self.location())?;
                writeln!(out, "  sent last {}", reported.last())?;
                self.print_story(out, "in words")?;
            }
        }
        writeln!(out, "  replay    {}", self.replay)
    }

    /// The smallest run in words, its last input's decisions left out.
    fn print_story(&self, out: &mut impl Write, lead: &str) -> io::Result<()> {
        let events = &self.finding.reported.events;
        let last = events.iter().rposition(|event| matches!(event, Event::Input(_)));
        let reported = events.get(..last.map_or(0, |last| last + 1)).unwrap_or_default();
        if reported.len() > LINES {
            return Ok(());
        }
        for (i, event) in reported.iter().enumerate() {
            let at = match event {
                Event::Input(input) => format!("at {}: ", input.at()),
                Event::Decision(_) => "  ".to_owned(),
            };
            let lead = if i == 0 { lead } else { "" };
            writeln!(out, "  {lead:<9} {at}{}", words::event(event))?;
        }
        Ok(())
    }
}

impl DriveReport {
    pub(super) fn exit(&self) -> Exit {
        if !self.findings.is_empty() || self.at_end.is_some() {
            Exit::Differs
        } else if self.was_interrupted {
            // What was not driven was not judged.
            Exit::BadInput
        } else {
            Exit::Conforms
        }
    }

    pub(super) fn runs(&self) -> u64 {
        self.fixed_count(|mark| mark != CaseOutcome::NotRun) as u64
            + self.passed
            + u64::from(self.failed.is_some())
    }

    pub(super) fn fixed_count(&self, counts: impl Fn(CaseOutcome) -> bool) -> usize {
        self.fixed.iter().filter(|(_, mark)| counts(*mark)).count()
    }

    /// The findings, one of each kind.
    pub(super) fn reported(&self) -> impl Iterator<Item = &ReportedFinding> {
        let first = self.findings.first();
        self.findings
            .iter()
            .enumerate()
            .filter(move |(i, entry)| {
                *i == 0 || first.is_none_or(|first| !first.finding.is_as(&entry.finding))
            })
            .map(|(_, entry)| entry)
    }

    pub(super) fn print_report(&self, out: &mut impl Write) -> io::Result<()> {
        let word = match self.exit() {
            Exit::Conforms => format!("{GOOD}conforms{GOOD:#}"),
            Exit::Differs => format!("{BAD}does not conform{BAD:#}"),
            Exit::BadInput => "no difference so far".to_owned(),
        };
        let stopped = if self.was_interrupted { ", interrupted" } else { "" };
        writeln!(out, "{}: {word}{stopped}\n", self.name)?;
        print_fact(out, "  fixed     ", &self.fixed_line())?;
        if self.suite.generated > 0 {
            print_fact(out, "  generated ", &self.generated_line())?;
        }
        if self.exit() == Exit::Conforms {
            let shares = self.reach.shares().into_iter();
            let reached: Vec<_> = shares
                .map(|share| format!("{} of {} {}", share.reached, share.all, share.kind))
                .collect();
            print_fact(out, "  reached   ", &reached.join(", "))?;
            print_fact(out, "  up to     ", &self.extent.to_string())?;
        }
        print_fact(out, "  driven    ", &self.pace())?;
        for entry in self.reported() {
            entry.print_report(out)?;
        }
        if let Some(misbehaviour) = &self.at_end {
            writeln!(out, "\nAfter the last case: {BAD}{misbehaviour}{BAD:#}")?;
        }
        Ok(())
    }

    /// How many cases pass, in a line.
    pub(super) fn summary(&self) -> String {
        let generated =
            if self.suite.generated > 0 { self.generated_line() } else { String::new() };
        [self.fixed_line(), generated]
            .into_iter()
            .filter(|it| !it.is_empty())
            .collect::<Vec<_>>()
            .join("; ")
    }

    fn fixed_line(&self) -> String {
        let passed = self.fixed_count(|mark| mark == CaseOutcome::Passes);
        let mut line = format!("{passed} of {} cases pass", self.fixed.len());
        let failed =
            |mark: &CaseOutcome| matches!(mark, CaseOutcome::Breaks(_) | CaseOutcome::Misbehaves);
        let names: Vec<_> = self.fixed.iter().filter(|(_, mark)| failed(mark)).collect();
        for (i, (name, _)) in names.iter().take(NAMED).enumerate() {
            // Writing to a string does not fail.
            let _ = write!(line, "{}{name}", if i == 0 { "; not " } else { ", " });
        }
        if names.len() > NAMED {
            let _ = write!(line, " and {} more", names.len() - NAMED);
        }
        let remaining = self.fixed_count(|mark| mark == CaseOutcome::NotRun);
        if remaining > 0 {
            let _ = write!(line, "; {remaining} not run");
        }
        line
    }

    fn generated_line(&self) -> String {
        let (passed, all) = (HumanCount(self.passed), HumanCount(self.suite.generated));
        if let Some(budget) = self.budget {
            let seed = self.suite.generator.seed;
            return match &self.failed {
                Some((id, _)) => format!("{passed} runs pass, then {id} does not"),
                None if self.was_interrupted => format!("{passed} runs pass until then"),
                None => {
                    let budget = humantime::format_duration(budget);
                    format!("{passed} runs pass, as many as begin in {budget} (seed {seed})")
                }
            };
        }
        match &self.failed {
            Some((id, _)) => format!("{passed} of {all} runs pass, then {id} does not"),
            None if self.passed < self.suite.generated => {
                format!("{passed} of {all} runs pass; the others were not run")
            }
            None => format!("{passed} of {all} runs pass (seed {})", self.suite.generator.seed),
        }
    }

    fn pace(&self) -> String {
        let seconds = self.took.as_secs_f64();
        #[expect(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a rate for people"
        )]
        let rate = (self.inputs as f64 / seconds.max(1e-9)) as u64;
        let (runs, all) = (HumanCount(self.runs()), HumanCount(self.inputs));
        let word = if self.runs() == 1 { "run" } else { "runs" };
        let rate = HumanCount(rate);
        format!("{runs} {word}, {all} inputs in {seconds:.1} s, {rate} inputs a second")
    }

    /// The report as one JSON object.
    pub(super) fn json(&self) -> WrittenReport {
        let Suite { generator, generated, .. } = &self.suite;
        let entries = self.findings.iter().map(|entry| {
            let verdict = entry.verdict();
            let violation = verdict.as_ref().and_then(|verdict| verdict.violations.first());
            let misbehaviour = match &entry.finding.kind {
                FindingKind::Misbehaves(misbehaviour) => Some(misbehaviour.to_string()),
                FindingKind::Breaks(_) => None,
            };
            WrittenFinding {
                case: entry.case.clone(),
                inputs: entry.finding.reported.inputs().count(),
                of: entry.of,
                violation: violation.cloned(),
                misbehaviour,
                trace: String::from_utf8_lossy(&entry.finding.reported.trace()).into_owned(),
                saved: entry.saved.clone(),
                replay: entry.replay.clone(),
            }
        });
        let fixed = self.fixed.iter();
        WrittenReport {
            name: self.name.clone(),
            command: self.command.clone(),
            conforms: self.exit() == Exit::Conforms,
            interrupted: self.was_interrupted,
            suite: WrittenSuite {
                version: env!("CARGO_PKG_VERSION"),
                hash: format!("sha256:{}", self.suite.hash()),
                seed: generator.seed,
                commit: generator.commit.map_or("all", fuseline_traces::Commit::as_str),
                clouds: generator.most_clouds(),
            },
            fixed: fixed
                .map(|(id, mark)| WrittenCase { case: id.clone(), result: mark.word() })
                .collect(),
            generated: GeneratedRuns {
                runs: *generated,
                passed: self.passed,
                failed: self.failed.as_ref().map(|(id, _)| id.clone()),
            },
            found: entries.collect(),
            at_end: self.at_end.as_ref().map(ToString::to_string),
            extent: self.extent,
            inputs: self.inputs,
            seconds: self.took.as_secs_f64(),
            reached: self.reach.counts().collect(),
        }
    }
}

fn print_fact(out: &mut impl Write, lead: &str, fact: &str) -> io::Result<()> {
    let options = Options::new(WIDTH).initial_indent(lead).subsequent_indent(INDENT);
    let options = options.word_splitter(WordSplitter::NoHyphenation);
    writeln!(out, "{}", textwrap::fill(fact, options))
}

fn inputs(count: usize) -> String {
    if count == 1 { "1 input".to_owned() } else { format!("{count} inputs") }
}
