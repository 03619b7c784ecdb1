//! Coverage: lines and branches that tests never take, by cargo-llvm-cov with the nightly compiler.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use crate::error::EvidenceError;
use crate::gap::CoverageGap;
use crate::tool::{Tests, version};
use crate::tree::Tree;

pub(crate) type BranchCounts = (String, BTreeMap<String, u64>, BTreeSet<CoverageGap>);

/// Runs the tests and reads what they took of `files`.
pub(crate) fn take(
    tree: &Tree,
    out: &Path,
    files: &[&str],
    tests: &Tests,
) -> Result<BranchCounts, EvidenceError> {
    let compiler = version(
        Command::new("cargo").args(["+nightly", "--version"]).env("RUSTUP_AUTO_INSTALL", "0"),
        "branches are distinguished by the nightly compiler alone",
    )?;
    let tool = version(
        Command::new("cargo").args(["llvm-cov", "--version"]),
        "cargo install --locked cargo-llvm-cov",
    )?;
    let llvm = llvm()?;
    let [cov, profdata] = ["llvm-cov", "llvm-profdata"].map(|tool| format!("{tool}-{llvm}"));
    version(Command::new(&cov).arg("--version"), &format!("apt-get install llvm-{llvm}"))?;
    let report = out.join("lcov.txt");
    let mut command = Command::new("cargo");
    command.args(["+nightly", "llvm-cov", "--branch", "--lcov", "--output-path"]).arg(&report);
    command.args(tests.packages.iter().flat_map(|package| ["--package", package]));
    command.args(tests.targets).current_dir(tree.root()).env("CARGO_TARGET_DIR", out);
    let fixed = [
        ("CARGO_LLVM_COV_SETUP", "no"),
        ("LLVM_COV", &cov),
        ("LLVM_PROFDATA", &profdata),
        ("RUSTUP_AUTO_INSTALL", "0"),
        ("CARGO_NET_OFFLINE", "true"),
    ];
    command.envs(fixed).env_remove("PROPTEST_CASES");
    let ended = command.status().map_err(EvidenceError::file(tree.root()))?;
    if !ended.success() {
        return Err(EvidenceError::content(out, format!("cargo llvm-cov ended with {ended}")));
    }
    let text = std::fs::read_to_string(&report).map_err(EvidenceError::file(&report))?;
    let (counts, gaps) = read(tree, files, &text)?;
    if counts["lines"] == 0 || counts["branches"] == 0 {
        return Err(EvidenceError::content(&report, "nothing was measured"));
    }
    Ok((format!("{tool}, {compiler}"), counts, gaps))
}

/// The version of LLVM in the nightly compiler, which that of its tools must equal.
fn llvm() -> Result<String, EvidenceError> {
    let rustc = Path::new("rustc");
    let printed = Command::new(rustc)
        .args(["+nightly", "-vV"])
        .env("RUSTUP_AUTO_INSTALL", "0")
        .output()
        .map_err(EvidenceError::file(rustc))?;
    let text = String::from_utf8_lossy(&printed.stdout);
    let version = text.lines().find_map(|line| line.strip_prefix("LLVM version: "));
    let major = version.and_then(|version| version.split('.').next()).map(str::to_owned);
    major.ok_or_else(|| EvidenceError::content(rustc, "it does not tell its version of LLVM"))
}

/// Reads a report in the format of lcov: `SF` a file, `DA` a line, `BRDA` one way of a branch, each with its count.
fn read(
    tree: &Tree,
    files: &[&str],
    report: &str,
) -> Result<(BTreeMap<String, u64>, BTreeSet<CoverageGap>), EvidenceError> {
    let mut line_counts = BTreeMap::new();
    let mut file = None;
    for line in report.lines() {
        let (kind, rest) = line.split_once(':').unwrap_or((line, ""));
        let cells: Vec<&str> = rest.split(',').collect();
        match (kind, &*cells) {
            ("SF", _) => file = name(tree, files, rest),
            ("DA", [line, count, ..]) => {
                note(&mut line_counts, file.as_deref(), [line, "", NEVER], count);
            }
            ("BRDA", [line, condition, branch, count]) => {
                let is_first = branch.parse::<u32>().is_ok_and(|branch| branch.is_multiple_of(2));
                let gap_kind = if is_first { NEVER_TRUE } else { NEVER_FALSE };
                note(&mut line_counts, file.as_deref(), [line, condition, gap_kind], count);
            }
            _ => {}
        }
    }
    let mut counts: BTreeMap<String, u64> =
        ["lines", "lines never run", "branches", "branches never taken"]
            .map(|kind| (kind.into(), 0))
            .into();
    let mut gaps = BTreeSet::new();
    for ((file, line, _, gap_kind), count) in line_counts {
        let (all, open) = if gap_kind == NEVER {
            ("lines", "lines never run")
        } else {
            ("branches", "branches never taken")
        };
        *counts.entry(all.to_owned()).or_default() += 1;
        if count == 0 {
            *counts.entry(open.to_owned()).or_default() += 1;
            gaps.insert(CoverageGap::at(&file, &tree.text(&file)?, line, gap_kind));
        }
    }
    Ok((counts, gaps))
}

const NEVER: &str = "never runs";
const NEVER_TRUE: &str = "is never true";
const NEVER_FALSE: &str = "is never false";

/// How often a line ran, or a condition of it went one way: by file, line, condition and way.
type LineCounts<'a> = BTreeMap<(String, usize, &'a str, &'a str), u64>;

/// A way counts as taken if any copy of the code takes it.
fn note<'a>(
    line_counts: &mut LineCounts<'a>,
    file: Option<&str>,
    [line, condition, gap_kind]: [&'a str; 3],
    count: &str,
) {
    let (Some(file), Ok(line)) = (file, line.parse()) else { return };
    let count: u64 = count.parse().unwrap_or(0);
    let sum = line_counts.entry((file.to_owned(), line, condition, gap_kind)).or_default();
    *sum = sum.saturating_add(count);
}

/// A file by its name from the root, if it is wanted.
fn name(tree: &Tree, files: &[&str], path: &str) -> Option<String> {
    let root = tree.root().canonicalize().ok()?;
    let name = Path::new(path).canonicalize().ok()?.strip_prefix(root).ok()?.to_str()?.to_owned();
    let is_in = |start: &&str| match start.strip_prefix('!') {
        Some(without) => !name.starts_with(without),
        None => name.starts_with(start),
    };
    let is_wanted = files.iter().all(is_in) && !name.ends_with("tests.rs");
    is_wanted.then_some(name)
}
