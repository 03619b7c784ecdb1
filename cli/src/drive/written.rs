//! The report as `--json` writes it.

use std::collections::BTreeMap;
use std::path::PathBuf;

use fuseline_testkit::Run;
use fuseline_traces::{Commit, Violation};
use serde::Serialize;

use super::case::GENERATOR;
use super::extent::DrivenExtent;
use super::reach::NotDriven;
use super::repeat::Need;
use super::report::{DriveReport, ReportedFinding};
use super::shrink::FindingKind;
use crate::exit::Exit;

/// The result of driving a command.
#[derive(Serialize)]
pub(super) struct WrittenReport<'a> {
    name: &'a str,
    /// The command as a shell reads it.
    command: &'a str,
    conforms: bool,
    /// `true` if Ctrl-C ended it.
    interrupted: bool,
    /// `true` if cases were not tried since the command did not answer by the protocol.
    gave_up: bool,
    suite: WrittenSuite,
    fixed: Vec<WrittenCase<'a>>,
    generated: GeneratedRuns<'a>,
    found: Vec<WrittenFinding<'a>>,
    /// The command's misbehaviour at the end of its input.
    at_end: Option<String>,
    extent: &'a DrivenExtent,
    /// The parts that were not driven, with the options that reach them.
    not_driven: Vec<NotDriven>,
    inputs: u64,
    seconds: f64,
    /// The number of times that each rule, reason, pair, outcome and edge was met.
    reached: BTreeMap<String, u64>,
}

/// The settings that drive the same runs again.
#[derive(Serialize)]
struct WrittenSuite {
    version: &'static str,
    /// The fixed cases.
    hash: String,
    generator: u8,
    seed: u64,
    left_out: usize,
    /// The commit rule of generated runs, or all.
    commit: &'static str,
    /// The most clouds of a generated run.
    clouds: u8,
}

#[derive(Serialize)]
struct WrittenCase<'a> {
    case: &'a str,
    /// pass, not run, or how it failed.
    result: String,
}

#[derive(Serialize)]
struct GeneratedRuns<'a> {
    runs: u64,
    passed: u64,
    /// The inputs of those that passed.
    inputs: u64,
    /// The case that did not pass.
    failed: Option<&'a str>,
}

/// A difference, in a smallest run.
#[derive(Serialize)]
struct WrittenFinding<'a> {
    case: &'a str,
    inputs: usize,
    /// The number of inputs that the run had at first.
    of: usize,
    violation: Option<Violation>,
    /// The breach of the protocol.
    misbehaviour: Option<String>,
    trace: String,
    /// `alone`, `after other runs` of the same process, `not again`, or `not tried`.
    shows: &'static str,
    /// The runs before it that it needs, as they are sent.
    before: Vec<String>,
    /// The files, in the order in which they are driven.
    saved: &'a [PathBuf],
    /// The command line that shows it again, if one does.
    replay: Option<&'a str>,
}

impl DriveReport {
    /// Returns the report as one JSON object.
    pub(super) fn json(&self) -> WrittenReport<'_> {
        let suite = &self.suite;
        WrittenReport {
            name: &self.name,
            command: &self.command,
            conforms: self.exit() == Exit::Conforms,
            interrupted: self.was_interrupted,
            gave_up: self.gave_up,
            suite: WrittenSuite {
                version: env!("CARGO_PKG_VERSION"),
                hash: format!("sha256:{}", suite.hash()),
                generator: GENERATOR,
                seed: suite.generator.seed,
                left_out: suite.left_out,
                commit: suite.generator.commit.map_or("all", Commit::as_str),
                clouds: suite.generator.clouds,
            },
            fixed: self
                .fixed
                .iter()
                .map(|(case, mark)| WrittenCase { case, result: mark.word() })
                .collect(),
            generated: GeneratedRuns {
                runs: suite.generated,
                passed: self.passed,
                inputs: self.passed_inputs,
                failed: self.failed.as_ref().map(|(id, _)| id.as_str()),
            },
            found: self.findings.iter().map(WrittenFinding::new).collect(),
            at_end: self.at_end.as_ref().map(ToString::to_string),
            extent: &self.extent,
            not_driven: self.not_driven(),
            inputs: self.inputs,
            seconds: self.took.as_secs_f64(),
            reached: self.reach.counts().collect(),
        }
    }
}

impl<'a> WrittenFinding<'a> {
    fn new(entry: &'a ReportedFinding) -> Self {
        let misbehaviour = match &entry.finding.kind {
            FindingKind::Misbehaves(misbehaviour) => Some(misbehaviour.to_string()),
            FindingKind::Breaks(_) => None,
        };
        let verdict = entry.verdict();
        Self {
            case: &entry.case,
            inputs: entry.finding.reported.inputs().count(),
            of: entry.of,
            violation: verdict.and_then(|verdict| verdict.violations.into_iter().next()),
            misbehaviour,
            trace: text(&entry.finding.reported.trace()),
            shows: match entry.need {
                Need::Nothing => "alone",
                Need::Before { .. } => "after other runs",
                Need::Unknown => "not again",
                Need::Untried => "not tried",
            },
            before: entry.need.runs().iter().map(sent).collect(),
            saved: &entry.saved,
            replay: entry.replay.as_deref(),
        }
    }
}

/// Returns a run as it is sent.
fn sent(run: &Run) -> String {
    let mut bytes = Vec::new();
    run.write(&mut bytes);
    text(&bytes)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
