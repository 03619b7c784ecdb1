//! What the core's tests reach of it: each line, and each branch both ways, or a reason why no valid state does.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde::Deserialize;

use crate::citation::has_function;
use crate::coverage;
use crate::error::EvidenceError;
use crate::gap::CoverageGap;
use crate::sources::CORE;
use crate::table::GeneratedFile;
use crate::tool::Tests;
use crate::tree::Tree;

const HEAD: &str = "# Lines and branches of the core

Each line of `core/src` is run by the tests of the core and of the rules, and each branch is taken both ways, but for those below: no valid
state reaches them, and what is named last shows it. [How it is measured](evidence.md#lines-and-branches-of-the-core).
";
/// What no test can reach, each with the reason.
const UNREACHABLE: &str = "evidence/coverage.toml";
/// Where what shows it stands.
const WITNESSES: &[&str] = &["proofs/src/harness", "tests/tests", CORE];

/// The lines and branches of the core, as far as the tests leave some open.
pub struct CoverageReport {
    by: String,
    counts: BTreeMap<String, u64>,
    unreachable: Vec<UnreachableCode>,
    wrong: Vec<String>,
}

/// Why nothing reaches a line or branch.
#[derive(Deserialize)]
struct UnreachableCode {
    #[serde(flatten)]
    gap: CoverageGap,
    because: String,
    /// A harness of the proofs, or a test.
    shown_by: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct UnreachableCodes {
    gap: Vec<UnreachableCode>,
}

impl CoverageReport {
    /// Runs `tests`, built to count, in cargo's target folder.
    ///
    /// # Errors
    /// The compiler or LLVM's tools cannot measure, or a test fails.
    pub(crate) fn of(tree: &Tree, target: &Path, tests: &Tests) -> Result<Self, EvidenceError> {
        let path = tree.path(UNREACHABLE);
        let UnreachableCodes { gap: unreachable } = toml::from_str(&tree.text(UNREACHABLE)?)
            .map_err(|error| EvidenceError::content(&path, error.to_string()))?;
        let mut wrong = Vec::new();
        let mut seen = BTreeSet::new();
        for it in &unreachable {
            if !seen.insert(&it.gap) || it.because.trim().is_empty() {
                wrong.push(format!("{UNREACHABLE}: {}: twice, or without a reason", it.gap));
            }
            if !has_function(tree, WITNESSES, &it.shown_by)? {
                wrong.push(format!("{UNREACHABLE}: no harness or test {}", it.shown_by));
            }
        }
        let out = target.join("coverage");
        fs::create_dir_all(&out).map_err(EvidenceError::file(&out))?;
        let (by, counts, gaps) = coverage::take(tree, &out, &[CORE], tests)?;
        for gap in gaps.iter().filter(|gap| !unreachable.iter().any(|it| it.gap == **gap)) {
            wrong.push(format!("{gap}, and {UNREACHABLE} does not say why"));
        }
        for it in unreachable.iter().filter(|it| !gaps.contains(&it.gap)) {
            wrong.push(format!("{UNREACHABLE}: reached, or not there: {}", it.gap));
        }
        Ok(Self { by, counts, unreachable, wrong })
    }

    /// A page with what is not reached, and why.
    #[must_use]
    pub fn page(&self) -> GeneratedFile {
        let mut text = format!("{HEAD}\n{}, by {}.\n", self.summary(), self.by);
        text.push_str("\n| where | what | why | shown by |\n|---|---|---|---|\n");
        for UnreachableCode { gap, because, shown_by } in &self.unreachable {
            let cell = |text: &str| text.replace('|', "\\|");
            let (line, what) = (cell(&gap.line), &gap.what);
            let because = cell(because);
            let _ =
                writeln!(text, "| `{}`: `{line}` | {what} | {because} | `{shown_by}` |", gap.file);
        }
        GeneratedFile { name: "coverage.md", text }
    }

    /// How much there is, and how much of it is reached.
    #[must_use]
    pub fn summary(&self) -> String {
        let of = |all: &str, open: &str| {
            let (all, open) = (self.counts[all], self.counts[open]);
            (all.saturating_sub(open), all)
        };
        let (lines, all_lines) = of("lines", "lines never run");
        let (branches, all_branches) = of("branches", "branches never taken");
        let explained = self.unreachable.len();
        format!(
            "{lines} of {all_lines} lines and {branches} of {all_branches} branches are reached, \
             {explained} gaps explained"
        )
    }

    /// What is neither reached nor explained, and explanations of what is reached or not there.
    #[must_use]
    pub fn wrong(&self) -> &[String] {
        &self.wrong
    }
}
