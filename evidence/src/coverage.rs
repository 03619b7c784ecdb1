//! Coverage: lines and branches that tests never take, by the compiler's own instrumentation and LLVM's tools.
//!
//! The stable compiler counts branches where `RUSTC_BOOTSTRAP` allows it the option.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

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
    let compiler = version(Command::new("rustc").arg("--version"), "install Rust")?;
    let llvm = llvm()?;
    let remedy = format!("apt-get install llvm-{llvm}");
    let [cov, profdata] = ["llvm-cov", "llvm-profdata"].map(|tool| format!("{tool}-{llvm}"));
    version(Command::new(&cov).arg("--version"), &remedy)?;
    let counters = out.join("counters");
    if counters.exists() {
        std::fs::remove_dir_all(&counters).map_err(EvidenceError::file(&counters))?;
    }
    let programs = test_programs(tree, out, tests)?;
    let mut run = cargo_test(tree, out, tests);
    run.env("LLVM_PROFILE_FILE", counters.join("%p-%m.profraw")).stdout(std::io::stderr());
    let ended = run.status().map_err(EvidenceError::file(tree.root()))?;
    if !ended.success() {
        return Err(EvidenceError::content(out, format!("cargo test ended with {ended}")));
    }
    let merged = out.join("merged.profdata");
    let mut merge = Command::new(&profdata);
    merge.args(["merge", "--sparse", "--output"]).args([&merged, &counters]);
    printed(&mut merge, &remedy)?;
    let mut export = Command::new(&cov);
    export.args(["export", "--format=lcov", "--instr-profile"]).arg(&merged);
    export.args(programs.iter().flat_map(|program| [Path::new("--object"), program]));
    let report = out.join("lcov.txt");
    let text = printed(&mut export, &remedy)?;
    std::fs::write(&report, &text).map_err(EvidenceError::file(&report))?;
    let (counts, gaps) = read(tree, files, &text)?;
    if counts["lines"] == 0 || counts["branches"] == 0 {
        return Err(EvidenceError::content(&report, "nothing was measured"));
    }
    Ok((format!("{compiler} and LLVM {llvm}"), counts, gaps))
}

/// `cargo test` of a build that counts, in a folder of its own.
fn cargo_test(tree: &Tree, out: &Path, tests: &Tests) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["test", "--locked", "--offline", "--quiet"]);
    command.args(tests.packages.iter().flat_map(|package| ["--package", package]));
    command.args(tests.targets).current_dir(tree.root());
    let fixed = [
        ("RUSTC_BOOTSTRAP", "1"),
        ("RUSTFLAGS", "-Cinstrument-coverage -Zcoverage-options=branch --cap-lints=allow"),
        ("CARGO_INCREMENTAL", "0"),
    ];
    command.envs(fixed).env("CARGO_TARGET_DIR", out.join("built")).env_remove("PROPTEST_CASES");
    // What the build itself runs counts too.
    command.env("LLVM_PROFILE_FILE", out.join("built/%m.profraw"));
    command
}

/// The programs of the tests, which have the map from counters to lines.
fn test_programs(tree: &Tree, out: &Path, tests: &Tests) -> Result<Vec<PathBuf>, EvidenceError> {
    let mut build = cargo_test(tree, out, tests);
    build.args(["--no-run", "--message-format=json-render-diagnostics"]);
    let text = printed(&mut build, "cargo test must build")?;
    let messages = text.lines().filter_map(|line| serde_json::from_str(line).ok());
    let programs = messages.filter_map(|message: serde_json::Value| {
        let is_test = message["profile"]["test"].as_bool() == Some(true);
        message["executable"].as_str().filter(|_| is_test).map(PathBuf::from)
    });
    Ok(programs.collect())
}

/// What a command prints, if it succeeds.
fn printed(command: &mut Command, remedy: &str) -> Result<String, EvidenceError> {
    let tool = command.get_program().to_string_lossy().into_owned();
    let missing = || EvidenceError::Tool { tool: tool.clone(), remedy: remedy.to_owned() };
    let printed = command.stderr(Stdio::inherit()).output().map_err(|_| missing())?;
    if !printed.status.success() {
        let why = format!("it ended with {}", printed.status);
        return Err(EvidenceError::content(Path::new(&tool), why));
    }
    Ok(String::from_utf8_lossy(&printed.stdout).into_owned())
}

/// The version of LLVM in the compiler, which that of its tools must equal.
fn llvm() -> Result<String, EvidenceError> {
    let text = printed(Command::new("rustc").arg("-vV"), "install Rust")?;
    let version = text.lines().find_map(|line| line.strip_prefix("LLVM version: "));
    let major = version.and_then(|version| version.split('.').next()).map(str::to_owned);
    let unknown = "it does not say its version of LLVM";
    major.ok_or_else(|| EvidenceError::content(Path::new("rustc"), unknown))
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
