//! The report as `--json` writes it.

use std::collections::BTreeMap;
use std::path::PathBuf;

use fuseline_testkit::Run;
use fuseline_traces::Violation;
use serde::Serialize;

use super::case::Suite;
use super::extent::DrivenExtent;
use super::reach::NotDriven;
use super::repeat::Need;
use super::report::DriveReport;
use super::shrink::FindingKind;
use crate::exit::Exit;

/// The result of driving a command.
#[derive(Serialize)]
pub(super) struct WrittenReport {
    pub(super) name: String,
    /// The command as a shell reads it.
    pub(super) command: String,
    pub(super) conforms: bool,
    /// `true` if Ctrl-C ended it.
    pub(super) interrupted: bool,
    /// `true` if the cases that were left were not tried, since the command did not answer by the
    /// protocol.
    pub(super) gave_up: bool,
    pub(super) suite: WrittenSuite,
    pub(super) fixed: Vec<WrittenCase>,
    pub(super) generated: GeneratedRuns,
    pub(super) found: Vec<WrittenFinding>,
    /// The command's misbehaviour at the end of its input.
    pub(super) at_end: Option<String>,
    /// The extent of the runs that passed.
    pub(super) extent: DrivenExtent,
    /// The parts that were not driven, with the options that reach them.
    pub(super) not_driven: Vec<NotDriven>,
    pub(super) inputs: u64,
    pub(super) seconds: f64,
    /// The number of times that each rule, reason, pair, outcome and edge was met.
    pub(super) reached: BTreeMap<String, u64>,
}

/// The settings that drive the same runs again.
#[derive(Serialize)]
pub(super) struct WrittenSuite {
    pub(super) version: &'static str,
    /// The fixed cases.
    pub(super) hash: String,
    pub(super) generator: u8,
    pub(super) seed: u64,
    /// The number of the corpus's cases that were not driven, because they have another commit rule
    /// or more clouds.
    pub(super) left_out: usize,
    /// The commit rule of generated runs, or all.
    pub(super) commit: &'static str,
    /// The most clouds of a generated run.
    pub(super) clouds: u8,
}

/// A fixed case.
#[derive(Serialize)]
pub(super) struct WrittenCase {
    pub(super) case: String,
    /// pass, not run, or how it failed.
    pub(super) result: String,
}

/// The generated runs.
#[derive(Serialize)]
pub(super) struct GeneratedRuns {
    pub(super) runs: u64,
    pub(super) passed: u64,
    /// The inputs of those that passed.
    pub(super) inputs: u64,
    /// The case that did not pass.
    pub(super) failed: Option<String>,
}

/// A difference, in a smallest run.
#[derive(Serialize)]
pub(super) struct WrittenFinding {
    pub(super) case: String,
    pub(super) inputs: usize,
    /// The number of inputs that the run had at first.
    pub(super) of: usize,
    pub(super) violation: Option<Violation>,
    /// The breach of the protocol.
    pub(super) misbehaviour: Option<String>,
    pub(super) trace: String,
    /// `alone`, `after other runs` of the same process, `not again`, or `not tried`.
    pub(super) shows: &'static str,
    /// The runs before it that it needs, as they are sent.
    pub(super) before: Vec<String>,
    /// The files, in the order in which they are driven.
    pub(super) saved: Vec<PathBuf>,
    /// The command line that shows it again, if one does.
    pub(super) replay: Option<String>,
}

impl DriveReport {
    /// Returns the report as one JSON object.
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
                shows: match &entry.need {
                    Need::Nothing => "alone",
                    Need::Before { .. } => "after other runs",
                    Need::Unknown => "not again",
                    Need::Untried => "not tried",
                },
                before: match &entry.need {
                    Need::Before { runs, .. } => runs.iter().map(text).collect(),
                    Need::Nothing | Need::Unknown | Need::Untried => Vec::new(),
                },
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
            gave_up: self.gave_up,
            suite: WrittenSuite {
                version: env!("CARGO_PKG_VERSION"),
                hash: format!("sha256:{}", self.suite.hash()),
                generator: generator.version.number(),
                seed: generator.seed,
                left_out: self.suite.left_out,
                commit: generator.commit.map_or("all", fuseline_traces::Commit::as_str),
                clouds: generator.most_clouds(),
            },
            fixed: fixed
                .map(|(id, mark)| WrittenCase { case: id.clone(), result: mark.word() })
                .collect(),
            generated: GeneratedRuns {
                runs: *generated,
                passed: self.passed,
                inputs: self.passed_inputs,
                failed: self.failed.as_ref().map(|(id, _)| id.clone()),
            },
            found: entries.collect(),
            at_end: self.at_end.as_ref().map(ToString::to_string),
            extent: self.extent.clone(),
            not_driven: self.not_driven(),
            inputs: self.inputs,
            seconds: self.took.as_secs_f64(),
            reached: self.reach.counts().collect(),
        }
    }
}

/// Returns a run as it is sent.
fn text(run: &Run) -> String {
    let mut text = Vec::new();
    run.write(&mut text);
    String::from_utf8_lossy(&text).into_owned()
}
