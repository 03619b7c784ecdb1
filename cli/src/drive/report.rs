//! The report on a driven command, for people and as JSON.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use fuseline_testkit::{Coverage, VariedGenerator};
use fuseline_traces::{Event, Rule, Verdict};
use indicatif::HumanCount;
use textwrap::{Options, WordSplitter};

use super::case::{GENERATOR, MOST_CLOUDS, Suite};
use super::extent::DrivenExtent;
use super::peer::ProtocolViolation;
use super::reach::{DriveLimits, NotDriven, lines, missing};
use super::repeat::Need;
use super::shrink::{DriveFinding, FindingKind};
use super::text;
use crate::exit::Exit;
use crate::table::counted;
use crate::verdict::{BAD, GOOD, plain, print_violation};

/// At most this many failed cases are named.
const NAMED: usize = 5;
/// At most this many lines of a run are shown in words.
const LINES: usize = 16;
/// Lines are at most this many columns wide.
const WIDTH: usize = 96;
/// The column after a lead.
const INDENT: &str = "            ";
/// The kind of an answer.
const EXPECTED: &str =
    "its decisions, one a line, then {\"ev\":\"done\"}; nothing else goes to standard output";
/// The reason why cases were not tried.
const GAVE_UP: &str =
    "it does not follow the protocol, so no other case was tried; correct that first";

/// The results of driving a command.
pub(super) struct DriveReport {
    /// The implementation's name.
    pub(super) name: String,
    /// The command, as a shell takes it.
    pub(super) command: String,
    pub(super) suite: Suite,
    /// The fixed cases in their order, with what became of each.
    pub(super) fixed: Vec<(String, CaseOutcome)>,
    pub(super) limits: DriveLimits,
    /// The number of generated runs that passed, from the first one on.
    pub(super) passed: u64,
    /// Their inputs.
    pub(super) passed_inputs: u64,
    /// The generated run that did not pass.
    pub(super) failed: Option<(String, CaseOutcome)>,
    /// The first thing wrong in the fixed cases and in the generated ones.
    pub(super) findings: Vec<ReportedFinding>,
    /// The command's behaviour at the end of its input.
    pub(super) at_end: Option<ProtocolViolation>,
    pub(super) was_interrupted: bool,
    /// `true` if cases were not tried since the command did not answer by the protocol.
    pub(super) gave_up: bool,
    /// `true` if the time was over before all else.
    pub(super) was_out_of_time: bool,
    pub(super) inputs: u64,
    pub(super) took: Duration,
    pub(super) reach: Coverage,
    pub(super) extent: DrivenExtent,
}

/// The outcome of a case.
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
    /// The number of inputs of its case.
    pub(super) of: usize,
    pub(super) finding: DriveFinding,
    pub(super) need: Need,
    /// The files, in the order in which they are driven.
    pub(super) saved: Vec<PathBuf>,
    /// The command line that shows it again, if one does.
    pub(super) replay: Option<String>,
}

impl CaseOutcome {
    pub(super) fn of(finding: &DriveFinding) -> Self {
        match &finding.kind {
            FindingKind::Breaks(rule) => Self::Breaks(*rule),
            FindingKind::Misbehaves(_) => Self::Misbehaves,
        }
    }

    /// Returns the mark in a word or two.
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
    /// Returns the file or the case that shows it.
    pub(super) fn location(&self) -> String {
        self.saved.last().map_or_else(|| self.case.clone(), |saved| saved.display().to_string())
    }

    pub(super) fn verdict(&self) -> Option<Verdict> {
        match self.finding.kind {
            FindingKind::Breaks(_) => self.finding.reported.verdict(&self.location()),
            FindingKind::Misbehaves(_) => None,
        }
    }

    /// Returns the difference in its smallest run, in lines without colours.
    pub(super) fn text(&self) -> String {
        plain(|out| self.print_report(out))
    }

    fn print_report(&self, out: &mut impl Write) -> io::Result<()> {
        let reported = &self.finding.reported;
        let small = reported.inputs().count();
        let of = if small < self.of { format!(" of {}", self.of) } else { String::new() };
        writeln!(
            out,
            "\nThe smallest run found, {}{of}, from {}:",
            counted(small as u64, "input"),
            self.case
        )?;
        if let Some(needs) = self.needs() {
            writeln!(out, "{needs}")?;
        }
        match &self.finding.kind {
            FindingKind::Breaks(_) => {
                if let Some(verdict) = self.verdict()
                    && let Some(violation) = verdict.violations.first()
                {
                    print_violation(violation, &verdict.file, out)?;
                    self.print_story(out)?;
                    let [found, expected] = text::both(&violation.found, &violation.expected);
                    writeln!(out, "{INDENT}  found: {found}")?;
                    writeln!(out, "{INDENT}  expected: {expected}")?;
                }
            }
            FindingKind::Misbehaves(misbehaviour) => {
                writeln!(out, "\n{}: {BAD}{misbehaviour}{BAD:#}", self.location())?;
                writeln!(out, "  sent last {}", reported.last())?;
                writeln!(out, "  expected  {EXPECTED}")?;
                self.print_story(out)?;
            }
        }
        match &self.replay {
            Some(replay) => writeln!(out, "  replay    {replay}"),
            None => writeln!(out, "  replay    give --save FOLDER to save the run and replay it"),
        }
    }

    /// Returns the runs that it needs to appear again, if it needs more than its own.
    fn needs(&self) -> Option<String> {
        match &self.need {
            Need::Nothing | Need::Untried => None,
            Need::Before { runs, .. } => {
                let runs = match runs.len() {
                    1 => "another run".to_owned(),
                    count => format!("{count} runs"),
                };
                Some(format!(
                    "It passes in a process of its own and fails after {runs} in the same process."
                ))
            }
            Need::Unknown => Some(
                "It did not appear again, alone or after the runs before it: the command decides \
                 the same inputs differently each time."
                    .to_owned(),
            ),
        }
    }

    /// Prints the smallest run in words, its last input's decisions left out.
    fn print_story(&self, out: &mut impl Write) -> io::Result<()> {
        let events = &self.finding.reported.events;
        let last = events.iter().rposition(|(event, _)| matches!(event, Event::Input(_)));
        let reported = events.get(..last.map_or(0, |last| last + 1)).unwrap_or_default();
        if reported.len() > LINES {
            return Ok(());
        }
        for (i, (event, _)) in reported.iter().enumerate() {
            let at = match event {
                Event::Input(input) => format!("at {}: ", input.at()),
                Event::Decision(_) => "  ".to_owned(),
            };
            let lead = if i == 0 { "in words" } else { "" };
            writeln!(out, "  {lead:<9} {at}{}", text::event(event))?;
        }
        Ok(())
    }
}

impl DriveReport {
    pub(super) fn exit(&self) -> Exit {
        if !self.findings.is_empty() || self.at_end.is_some() {
            Exit::Differs
        } else if self.was_interrupted {
            // Only driven runs are judged.
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

    /// Returns the findings, one of each kind.
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
            Exit::Doubt => "no violation found".to_owned(),
            Exit::BadInput => "no difference so far".to_owned(),
        };
        let stopped = if self.was_interrupted { ", interrupted" } else { "" };
        writeln!(out, "{}: {word}{stopped}\n", self.name)?;
        print_fact(out, "  fixed     ", &self.fixed_line())?;
        if self.suite.generated > 0 || self.was_out_of_time {
            print_fact(out, "  generated ", &self.generated_line())?;
        }
        if self.exit() == Exit::Conforms {
            let shares = self.reach.shares().into_iter();
            let reached: Vec<_> = shares
                .map(|share| format!("{} of {} {}", share.reached, share.all, share.kind))
                .collect();
            print_fact(out, "  reached   ", &reached.join(", "))?;
            for (lead, line) in lines(&self.extent) {
                print_fact(out, &format!("  {lead:<9} "), &line)?;
            }
            print_fact(out, "  beyond    ", &self.beyond())?;
        }
        print_fact(out, "  driven    ", &self.pace())?;
        if self.gave_up {
            print_fact(out, "  stopped   ", GAVE_UP)?;
        }
        for entry in self.reported() {
            entry.print_report(out)?;
        }
        if let Some(misbehaviour) = &self.at_end {
            writeln!(out, "\nAfter the last case: {BAD}{misbehaviour}{BAD:#}")?;
        }
        Ok(())
    }

    /// Returns the part that was not driven.
    pub(super) fn not_driven(&self) -> Vec<NotDriven> {
        missing(&self.suite, self.limits, &self.extent, &self.reach)
    }

    /// Says in one line what lies beyond, by the options that reach it.
    fn beyond(&self) -> String {
        let mut by_option: Vec<(String, Vec<String>)> = Vec::new();
        for NotDriven { what, option } in self.not_driven() {
            match by_option.iter_mut().find(|(it, _)| *it == option) {
                Some((_, all)) => all.push(what),
                None => by_option.push((option, vec![what])),
            }
        }
        let parts: Vec<_> = by_option
            .iter()
            .map(|(option, all)| format!("not driven: {} ({option})", all.join(", ")))
            .collect();
        if parts.is_empty() {
            "everything that drive knows of was driven".to_owned()
        } else {
            parts.join("; ")
        }
    }

    /// Says why the verdict is not whole, if Ctrl-C ended the command before a difference.
    pub(super) fn unfinished(&self) -> Option<String> {
        (self.exit() == Exit::BadInput).then(|| format!("interrupted; {}", self.summary()))
    }

    /// Says in one line how many cases pass.
    pub(super) fn summary(&self) -> String {
        match self.suite.generated {
            0 => self.fixed_line(),
            _ => format!("{}; {}", self.fixed_line(), self.generated_line()),
        }
    }

    fn fixed_line(&self) -> String {
        let passed = self.fixed_count(|mark| mark == CaseOutcome::Passes);
        let mut line = format!("{passed} of {} cases pass", self.fixed.len());
        let failed =
            |mark: &CaseOutcome| matches!(mark, CaseOutcome::Breaks(_) | CaseOutcome::Misbehaves);
        let failed = self.fixed.iter().filter(|(_, mark)| failed(mark));
        let names: Vec<&str> = failed.map(|(name, _)| name.as_str()).collect();
        // Writing to a string does not fail.
        if !names.is_empty() {
            let _ = write!(line, "; not {}", names[..names.len().min(NAMED)].join(", "));
        }
        if names.len() > NAMED {
            let _ = write!(line, " and {} more", names.len() - NAMED);
        }
        let remaining = self.fixed_count(|mark| mark == CaseOutcome::NotRun);
        if remaining > 0 {
            let _ = write!(line, "; {remaining} not run");
        }
        if self.suite.left_out > 0 {
            let VariedGenerator { commit, clouds, .. } = self.suite.generator;
            let options = match (commit, clouds < MOST_CLOUDS) {
                (Some(_), true) => "--commit and --clouds",
                (Some(_), false) => "--commit",
                (None, _) => "--clouds",
            };
            let _ = write!(line, "; {} skipped because of {options}", self.suite.left_out);
        }
        line
    }

    fn generated_line(&self) -> String {
        let (passed, all) = (HumanCount(self.passed), HumanCount(self.suite.generated));
        let inputs = HumanCount(self.passed_inputs);
        let source = format!("generator {GENERATOR}, seed {}", self.suite.generator.seed);
        let is_counted = self.limits.inputs == u64::MAX && self.limits.time.is_none();
        let passed = if is_counted && self.passed < self.suite.generated {
            format!("{passed} of {all} runs with {inputs} inputs pass")
        } else {
            format!("{passed} runs with {inputs} inputs pass")
        };
        match (&self.failed, self.limits.time) {
            (Some((id, _)), _) => format!("{passed}, then {id} does not"),
            (None, _) if self.was_interrupted => format!("{passed} until then ({source})"),
            (None, Some(time)) if self.was_out_of_time => {
                let time = humantime::format_duration(time);
                let of = match self.limits.inputs {
                    u64::MAX => String::new(),
                    all => format!(", before all {} inputs", HumanCount(all)),
                };
                format!("{passed} ({source}); --for ended them after {time}{of}")
            }
            (None, _) => format!("{passed} ({source})"),
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
}

fn print_fact(out: &mut impl Write, lead: &str, fact: &str) -> io::Result<()> {
    let options = Options::new(WIDTH).initial_indent(lead).subsequent_indent(INDENT);
    let options = options.word_splitter(WordSplitter::NoHyphenation);
    writeln!(out, "{}", textwrap::fill(fact, options))
}
