//! Modified condition/decision coverage. It checks that the tests show, for each condition, that
//! this condition alone changes its decision.
//!
//! The compiler no longer offers this. So a copy of the crate is made in which each condition
//! records its value, and the tests run on the copy. A condition is covered by two evaluations that
//! differ in it and in the outcome, and in no other condition that both evaluated (unique cause). A
//! condition that `&&` or `||` skipped differs from nothing.

mod decision;
mod pair;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde::Deserialize;

pub use self::decision::SourceDecision;
pub use self::pair::{Evaluation, IndependencePair};

use crate::error::FaultsError;
use crate::tree::{Tree, write};
use crate::work::FaultyCopy;

/// The folders of the sources whose decisions count, each of one crate.
const SOURCES: [&str; 2] = ["core/src", "adapters/c/src"];
const HEAD: &str = "# Conditions of the core

This page shows that each condition in `core/src` and `adapters/c/src` can change its decision alone (MC/DC). Below each condition
stand two tests that differ only in this condition and in the decision's outcome. T is true, F is false, and - is not evaluated, in
the order of the conditions. [Seeded faults](evidence.md#conditions-of-the-core) explains the measurement.
";
/// The recorder in the copy of the crate.
const RECORDER: &str = include_str!("mcdc/recorder.rs.txt");
/// Constant functions record as well. The compiler takes another path if it evaluates them itself.
const UNSTABLE: &str =
    "#![feature(core_intrinsics, const_eval_select)]\n#![allow(internal_features, unused)]\n";
/// Conditions that no test can show, each with the reason.
const EXPLAINED: &str = "faults/mcdc.toml";
/// Selects the tests that run: the core's own, the tests of the rules, and the tests of the C
/// interface.
const TESTS: [&str; 12] = [
    "test",
    "--package=fuseline-core",
    "--package=fuseline-tests",
    "--package=fuseline-c",
    "--lib",
    "--test=wrong_use",
    "--test=shared",
    "--test=rules",
    "--test=surface",
    "--test=window",
    "--test=parts",
    "--no-fail-fast",
];

/// The decisions of the core and of the C interface, and the evaluations of each by the tests.
pub struct McdcReport {
    decisions: Vec<SourceDecision>,
    evaluations: BTreeMap<usize, BTreeSet<Evaluation>>,
    explained: Vec<ExplainedCondition>,
}

/// A condition that cannot be shown to change its decision alone.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExplainedCondition {
    file: String,
    decision: String,
    condition: String,
    because: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExplainedConditions {
    #[serde(default)]
    condition: Vec<ExplainedCondition>,
}

impl McdcReport {
    /// Runs the tests on a copy of the project in cargo's target folder. Skips tests whose names
    /// contain a text of `without`.
    ///
    /// # Errors
    /// Returns an error if the core cannot be read as Rust, the copy does not build, or a test
    /// fails.
    pub fn take(tree: &Tree, target: &Path, without: &[String]) -> Result<Self, FaultsError> {
        let path = tree.path(EXPLAINED);
        let explained: ExplainedConditions = toml::from_str(&tree.text(EXPLAINED)?)
            .map_err(|error| FaultsError::content(&path, error.to_string()))?;
        let copy = Tree::new(target.join("mcdc/copy"));
        let recorders = SOURCES.map(|folder| (format!("{folder}/mcdc.rs"), RECORDER.to_owned()));
        let mut changed = BTreeMap::from(recorders);
        let mut decisions = Vec::new();
        for file in tree.files(&SOURCES)? {
            let mut text = decision::instrument(&file, &tree.text(&file)?, &mut decisions)?;
            if SOURCES.iter().any(|folder| file == format!("{folder}/lib.rs")) {
                text = format!("{UNSTABLE}{text}\nmod mcdc;\n");
            }
            changed.insert(file, text);
        }
        tree.copy_to(&copy, changed)?;
        let recorded = target.join("mcdc/evaluations.txt");
        write(&recorded, "")?;
        let mut command = FaultyCopy::cargo(copy.root());
        command.args(TESTS).args(["--locked", "--quiet", "--"]);
        command.args(without.iter().flat_map(|name| ["--skip", name]));
        let ended = command
            // This is the folder of the seeded faults, which need the same dependencies.
            .env("CARGO_TARGET_DIR", target.join("faults/build/plain"))
            .env("FUSELINE_MCDC", &recorded)
            .env_remove("PROPTEST_CASES")
            .stdout(std::io::stderr())
            .status()
            .map_err(FaultsError::file(copy.root()))?;
        if !ended.success() {
            return Err(FaultsError::content(
                copy.root(),
                format!("cargo test ended with {ended}"),
            ));
        }
        let text = fs::read_to_string(&recorded).map_err(FaultsError::file(&recorded))?;
        let mut evaluations: BTreeMap<usize, BTreeSet<Evaluation>> = BTreeMap::new();
        for line in text.lines() {
            let (decision, evaluation) = Evaluation::parse(line).ok_or_else(|| {
                FaultsError::content(&recorded, format!("not understood: {line}"))
            })?;
            evaluations.entry(decision).or_default().insert(evaluation);
        }
        Ok(Self { decisions, evaluations, explained: explained.condition })
    }

    /// Returns a page with each decision, its conditions, and the two tests that show each of them.
    #[must_use]
    pub fn page(&self) -> String {
        let mut text = format!("{HEAD}\n{}.\n\n```text\n", self.summary());
        for (i, decision) in self.decisions.iter().enumerate() {
            let _ = writeln!(text, "{}:{}  {}", decision.file, decision.line, decision.text);
            for (c, condition) in decision.conditions.iter().enumerate() {
                let _ = match self.pair(i, c) {
                    Some(IndependencePair { holds, fails }) => {
                        writeln!(text, "  {condition}\n    {holds}\n    {fails}")
                    }
                    None => {
                        writeln!(text, "  {condition}\n    {}", self.reason(decision, condition))
                    }
                };
            }
        }
        text.push_str("```\n");
        text
    }

    /// Returns the report as JSON: an array of decisions, each with the tests of its pairs.
    #[must_use]
    pub fn json(&self) -> String {
        let decisions = self.decisions.iter().enumerate().map(|(i, it)| {
            let pairs = (0..it.conditions.len()).filter_map(|c| self.pair(i, c));
            let shown_by: Vec<[&str; 2]> = pairs.map(IndependencePair::tests).collect();
            serde_json::json!({
                "file": it.file, "line": it.line, "decision": it.text,
                "conditions": it.conditions, "shown_by": shown_by,
            })
        });
        serde_json::Value::from(decisions.collect::<Vec<_>>()).to_string() + "\n"
    }

    /// Returns a phrase with the numbers of conditions, and of those that are shown or explained.
    #[must_use]
    pub fn summary(&self) -> String {
        let conditions: usize = self.decisions.iter().map(|it| it.conditions.len()).sum();
        let (decisions, shown) = (self.decisions.len(), self.shown());
        let explained = self.explained.len();
        format!(
            "{shown} of {conditions} conditions in {decisions} decisions are shown, {explained} explained"
        )
    }

    /// Returns the mistakes: conditions that are neither shown nor explained, and explanations of
    /// shown or missing conditions.
    #[must_use]
    pub fn gaps(&self) -> Vec<String> {
        let mut explained: Vec<&ExplainedCondition> = self.explained.iter().collect();
        let mut gaps = Vec::new();
        for (i, decision) in self.decisions.iter().enumerate() {
            for (c, condition) in decision.conditions.iter().enumerate() {
                let known = explained.iter().position(|it| it.is_of(decision, condition));
                let place = format!("{}:{}: {condition}", decision.file, decision.line);
                match (self.pair(i, c), known) {
                    (Some(_), None) => {}
                    (None, Some(known)) => drop(explained.swap_remove(known)),
                    (None, None) => gaps.push(format!("{place}: no two evaluations show it")),
                    (Some(_), Some(_)) => {
                        gaps.push(format!("{place}: shown, and explained as not to be shown"));
                    }
                }
            }
        }
        gaps.extend(explained.iter().map(|it| {
            format!("{EXPLAINED}: no condition {} of {} in {}", it.condition, it.decision, it.file)
        }));
        gaps
    }

    fn shown(&self) -> usize {
        let all = self.decisions.iter().enumerate();
        all.map(|(i, it)| (0..it.conditions.len()).filter(|c| self.pair(i, *c).is_some()).count())
            .sum()
    }

    fn pair(&self, decision: usize, condition: usize) -> Option<IndependencePair<'_>> {
        IndependencePair::find(self.evaluations.get(&decision)?, condition)
    }

    fn reason(&self, decision: &SourceDecision, condition: &str) -> &str {
        let known = self.explained.iter().find(|it| it.is_of(decision, condition));
        known.map_or("NOT SHOWN", |it| &it.because)
    }
}

impl ExplainedCondition {
    fn is_of(&self, decision: &SourceDecision, condition: &str) -> bool {
        self.file == decision.file && self.decision == decision.text && self.condition == condition
    }
}
