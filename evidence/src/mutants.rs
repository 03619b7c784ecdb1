//! Mutants: cargo-mutants changes the code, one place at a time, and some test must notice.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use serde::Deserialize;

use crate::coverage::BranchCounts;
use crate::error::EvidenceError;
use crate::gap::CoverageGap;
use crate::tool::{Tests, version};
use crate::tree::Tree;
use crate::work_copy::BOUNDED;

/// Makes and tests all mutants of `files`.
pub(crate) fn take(
    tree: &Tree,
    out: &Path,
    files: &[&str],
    tests: &Tests,
    jobs: u8,
) -> Result<BranchCounts, EvidenceError> {
    let remedy = "cargo install --locked cargo-mutants";
    let by = version(Command::new("cargo").args(["mutants", "--version"]), remedy)?;
    let mut command = Command::new("sh");
    command.args(["-c", BOUNDED, "sh", "cargo", "mutants", "--workspace", "--no-shuffle"]);
    command.args(["--colors", "never", "--minimum-test-timeout", "40"]);
    command.arg("--jobs").arg(jobs.to_string()).arg("--output").arg(out);
    command.args(files.iter().flat_map(|file| match file.strip_prefix('!') {
        None => ["--file".to_owned(), (*file).to_owned()],
        Some(without) => ["--exclude".to_owned(), format!("{without}*")],
    }));
    // Beside the tests of the package that is changed, which it chooses itself.
    command.args(tests.packages.iter().map(|package| format!("--cargo-arg=--package={package}")));
    command.args(tests.targets.iter().map(|target| format!("--cargo-arg={target}")));
    let fixed = [
        ("CARGO_NET_OFFLINE", "true"),
        ("CARGO_PROFILE_DEV_OPT_LEVEL", "1"),
        ("CARGO_PROFILE_DEV_DEBUG", "0"),
    ];
    command.current_dir(tree.root()).envs(fixed).env_remove("PROPTEST_CASES");
    // Each job has a folder of its own: in one they would test each other's mutants.
    command.env_remove("CARGO_TARGET_DIR");
    let ended = command.status().map_err(EvidenceError::file(tree.root()))?;
    // 2: some survived; 3: some ran out of time.
    if !matches!(ended.code(), Some(0 | 2 | 3)) {
        return Err(EvidenceError::content(out, format!("cargo mutants ended with {ended}")));
    }
    let (counts, gaps) = read(tree, &out.join("mutants.out/outcomes.json"))?;
    Ok((by, counts, gaps))
}

/// What happened to the mutants.
#[derive(Deserialize)]
struct MutantOutcomes {
    outcomes: Vec<CargoMutantsOutcome>,
}

#[derive(Deserialize)]
struct CargoMutantsOutcome {
    scenario: MutantScenario,
    summary: String,
}

#[derive(Deserialize)]
enum MutantScenario {
    Baseline,
    Mutant { name: String, file: String, span: LineSpan },
}

#[derive(Deserialize)]
struct LineSpan {
    start: SourceSpan,
}

#[derive(Deserialize)]
struct SourceSpan {
    line: usize,
}

fn read(
    tree: &Tree,
    path: &Path,
) -> Result<(BTreeMap<String, u64>, BTreeSet<CoverageGap>), EvidenceError> {
    let text = std::fs::read_to_string(path).map_err(EvidenceError::file(path))?;
    let outcomes: MutantOutcomes = serde_json::from_str(&text)
        .map_err(|error| EvidenceError::content(path, error.to_string()))?;
    let mut counts: BTreeMap<String, u64> =
        ["caught", "out of time", "not built", "survived"].map(|kind| (kind.into(), 0)).into();
    let mut gaps = BTreeSet::new();
    for outcome in outcomes.outcomes {
        let MutantScenario::Mutant { name, file, span } = outcome.scenario else { continue };
        let kind = match &*outcome.summary {
            "CaughtMutant" => "caught",
            "Timeout" => "out of time",
            "Unviable" => "not built",
            "MissedMutant" => "survived",
            other => return Err(EvidenceError::content(path, format!("{name}: what is {other}?"))),
        };
        *counts.entry(kind.to_owned()).or_default() += 1;
        if kind == "survived" {
            // After file, line and column.
            let what = name.splitn(4, ':').last().unwrap_or_default().trim();
            gaps.insert(CoverageGap::at(&file, &tree.text(&file)?, span.start.line, what));
        }
    }
    Ok((counts, gaps))
}
