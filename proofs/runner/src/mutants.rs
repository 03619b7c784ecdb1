//! Checks that the harnesses catch each mutant of the façade and of its window that `cargo mutants` lists.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use fuseline_faults::Tree;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::record;

/// The façade and its window, each with the group of harnesses that use it.
pub(crate) const FILES: [(&str, &str); 2] =
    [("core/src/fusion.rs", "fusion"), ("core/src/window.rs", "window")];

const EXCLUDED: &str = "proofs/mutants.toml";

/// One change at one place.
#[derive(Deserialize)]
pub(crate) struct Mutant {
    /// The file, line and column, and the change.
    pub(crate) name: String,
    pub(crate) file: String,
    replacement: String,
    span: MutantSpan,
    /// `None` if the change is outside of functions.
    function: Option<MutantFunction>,
}

#[derive(PartialEq, Eq, Deserialize)]
struct MutantFunction {
    #[serde(rename = "function_name")]
    name: String,
}

#[derive(Deserialize)]
struct MutantSpan {
    start: LineColumn,
    end: LineColumn,
}

/// A place in a file. Both numbers count from 1.
#[derive(Deserialize)]
struct LineColumn {
    line: usize,
    column: usize,
}

impl Mutant {
    /// Returns the file's text with the change, or `None` if it does not have the place.
    pub(crate) fn seed(&self, text: &str) -> Option<String> {
        let at = |position: &LineColumn| {
            let line = text.split_inclusive('\n').take(position.line.checked_sub(1)?);
            let before: usize = line.map(str::len).sum();
            let rest = text.get(before..)?;
            let (within, _) = rest.char_indices().nth(position.column.checked_sub(1)?)?;
            before.checked_add(within)
        };
        let (start, end) = (at(&self.span.start)?, at(&self.span.end)?);
        Some(format!("{}{}{}", text.get(..start)?, self.replacement, text.get(end..)?))
    }

    /// Returns all mutants, and the name of the tool that lists them.
    ///
    /// # Errors
    /// Returns an error if `cargo mutants` is not installed or fails.
    pub(crate) fn list(root: &Path) -> Result<(Vec<Self>, String), Error> {
        let files = FILES.iter().flat_map(|(file, _)| ["--file", file]);
        let words = ["mutants", "--list", "--json", "--package", "fuseline-core"];
        let listed = cargo(root, &words.into_iter().chain(files).collect::<Vec<_>>())?;
        let mutants = serde_json::from_str(&listed)
            .map_err(|error| Error::content(Path::new("cargo mutants"), &error))?;
        Ok((mutants, cargo(root, &["mutants", "--version"])?.trim().to_owned()))
    }
}

fn cargo(root: &Path, words: &[&str]) -> Result<String, Error> {
    let mut command = Command::new("cargo");
    command.current_dir(root).args(words).stdin(Stdio::null());
    let output = command.output().map_err(Error::file(Path::new("cargo")))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let what = "the list of mutants; cargo install cargo-mutants installs it".to_owned();
    Err(Error::Tool { tool: "cargo mutants", what, message })
}

/// The outcome of each mutant.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mutants {
    /// The tool that listed them.
    pub(crate) by: String,
    /// A digest of the files.
    pub(crate) files: String,
    /// A digest of everything that the verdicts depend on.
    pub(crate) sources: String,
    pub(crate) of: BTreeMap<String, MutantOutcome>,
}

#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum MutantOutcome {
    /// An assertion of this harness fails.
    CaughtBy(String),
    /// The compiler refuses it.
    NotBuilt,
    /// No harness of its group notices it.
    Missed,
    /// No harness is checked for it; `mutants.toml` has the reason.
    Excluded,
}

impl Mutants {
    /// Reads the earlier outcomes, or returns no outcomes if they are of other sources.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read.
    pub(crate) fn current(root: &Path, by: String, sources: String) -> Result<Self, Error> {
        let (mut recorded, exclusions) = (Self::load(root)?, Exclusions::load(root)?);
        if recorded.sources != sources || recorded.by != by {
            recorded.of.clear();
        }
        recorded.of.retain(|name, outcome| {
            (*outcome == MutantOutcome::Excluded) == exclusions.holds(name)
        });
        Ok(Self { by, files: digest(root)?, sources, of: recorded.of })
    }

    /// Returns the harnesses that caught another mutant of the same function.
    pub(crate) fn catchers(&self, listed: &[Mutant], mutant: &Mutant) -> BTreeSet<String> {
        let same = listed.iter().filter(|other| other.function == mutant.function);
        let outcomes = same.filter_map(|other| self.of.get(&other.name));
        outcomes
            .filter_map(|outcome| match outcome {
                MutantOutcome::CaughtBy(harness) => Some(harness.clone()),
                MutantOutcome::NotBuilt | MutantOutcome::Missed | MutantOutcome::Excluded => None,
            })
            .collect()
    }

    fn load(root: &Path) -> Result<Self, Error> {
        record::load(&results(root))
    }

    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn save(&self, root: &Path) -> Result<(), Error> {
        record::save(&results(root), self)
    }

    /// Describes how many mutants have each outcome.
    pub(crate) fn summary(&self) -> String {
        let count = |wanted: fn(&MutantOutcome) -> bool| {
            self.of.values().filter(|outcome| wanted(outcome)).count()
        };
        format!(
            "mutants of façade and window: {} caught, {} missed, {} excluded with a reason, {} do not build",
            count(|outcome| matches!(outcome, MutantOutcome::CaughtBy(_))),
            count(|outcome| *outcome == MutantOutcome::Missed),
            count(|outcome| *outcome == MutantOutcome::Excluded),
            count(|outcome| *outcome == MutantOutcome::NotBuilt),
        )
    }
}

/// Returns the path of the outcomes while the sources stay the same. It is in cargo's target folder, because
/// nobody keeps them.
fn results(root: &Path) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    root.join(target).join("proofs/mutants.json")
}

/// Mutants that no harness is checked for, each with the reason.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Exclusions {
    excluded: Vec<ExclusionReason>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExclusionReason {
    /// A part of their names: the change, or the function.
    what: String,
    #[expect(dead_code, reason = "it is for who reads the file")]
    because: String,
}

impl Exclusions {
    /// # Errors
    /// Returns an error if the file cannot be read.
    pub(crate) fn load(root: &Path) -> Result<Self, Error> {
        let path = root.join(EXCLUDED);
        let text = fs::read_to_string(&path).map_err(Error::file(&path))?;
        toml::from_str(&text).map_err(|error| Error::content(&path, &error))
    }

    pub(crate) fn holds(&self, name: &str) -> bool {
        self.excluded.iter().any(|reason| name.contains(&reason.what))
    }
}

/// Returns the faults of the outcomes and a summary. A fault is an outcome of other files, or a
/// mutant that is missed without a reason.
///
/// # Errors
/// Returns an error if a file cannot be read.
pub(crate) fn checked(root: &Path) -> Result<(Vec<String>, String), Error> {
    let (recorded, exclusions) = (Mutants::load(root)?, Exclusions::load(root)?);
    let mut wrong = Vec::new();
    if recorded.files != digest(root)? {
        wrong.push("the mutants are those of other files: use --mutants".to_owned());
    }
    for (name, outcome) in &recorded.of {
        if *outcome == MutantOutcome::Missed {
            wrong.push(format!("no harness catches {name}"));
        } else if *outcome == MutantOutcome::Excluded && !exclusions.holds(name) {
            wrong.push(format!("no harness was checked for {name}: use --mutants"));
        }
    }
    for ExclusionReason { what, .. } in &exclusions.excluded {
        if !recorded
            .of
            .iter()
            .any(|(name, outcome)| *outcome == MutantOutcome::Excluded && name.contains(what))
        {
            wrong.push(format!("{EXCLUDED}: no mutant is excluded that says {what:?}"));
        }
    }
    Ok((wrong, recorded.summary()))
}

fn digest(root: &Path) -> Result<String, Error> {
    Ok(Tree::new(root.to_owned()).digest(&FILES.map(|(file, _)| file))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mutant(start: (usize, usize), end: (usize, usize)) -> Mutant {
        let position = |(line, column)| LineColumn { line, column };
        let span = MutantSpan { start: position(start), end: position(end) };
        Mutant {
            name: String::new(),
            file: String::new(),
            replacement: ">".to_owned(),
            span,
            function: None,
        }
    }

    #[test]
    fn change_is_where_line_and_column_say() {
        let text = "à < b\nc <= d\n";
        assert_eq!(mutant((1, 3), (1, 4)).seed(text).as_deref(), Some("à > b\nc <= d\n"));
        assert_eq!(mutant((2, 3), (2, 5)).seed(text).as_deref(), Some("à < b\nc > d\n"));
        assert_eq!(mutant((1, 3), (2, 5)).seed(text).as_deref(), Some("à > d\n"));
        assert_eq!(mutant((4, 1), (4, 2)).seed(text), None);
    }
}
