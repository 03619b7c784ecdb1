//! Gaps in the tests: a change that they do not notice, code that they never run. Each has its explanation.

use std::collections::BTreeSet;
use std::fs;

use serde::{Deserialize, Serialize};

use crate::error::EvidenceError;
use crate::tree::Tree;

/// Where the explanations are kept.
const FILE: &str = "evidence/gaps.toml";

/// One gap. It is known by what its line says, so that it keeps its explanation when code above it moves.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoverageGap {
    /// The file, from the root.
    pub file: String,
    /// The line, without the white space around it.
    pub line: String,
    /// What is not noticed there, or does not happen.
    pub what: String,
}

/// Why a gap may stay.
#[derive(Clone, PartialEq, Eq, Debug, Deserialize)]
pub(crate) struct ExplainedGap {
    #[serde(flatten)]
    pub(crate) gap: CoverageGap,
    /// The reason.
    pub(crate) because: String,
}

/// All explanations, in their order.
///
/// # Errors
/// The file cannot be read, a gap is explained twice, or a reason is empty.
pub(crate) fn explanations(tree: &Tree) -> Result<Vec<ExplainedGap>, EvidenceError> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        gap: Vec<ExplainedGap>,
    }
    let path = tree.path(FILE);
    let text = fs::read_to_string(&path).map_err(EvidenceError::file(&path))?;
    let file: File =
        toml::from_str(&text).map_err(|error| EvidenceError::content(&path, error.to_string()))?;
    let mut seen = BTreeSet::new();
    for explained in &file.gap {
        if !seen.insert(&explained.gap) || explained.because.trim().is_empty() {
            let why = format!("{}: explained twice, or with nothing", explained.gap);
            return Err(EvidenceError::content(&path, why));
        }
    }
    Ok(file.gap)
}

impl CoverageGap {
    /// The gap at a line, counted from 1, of a text. One of brackets alone is shown with what stands before it.
    pub(crate) fn at(file: &str, text: &str, line: usize, what: impl Into<String>) -> Self {
        let lines: Vec<&str> = text.lines().take(line).map(str::trim).collect();
        let is_reported = |line: &&&str| line.contains(char::is_alphanumeric);
        let reported = lines.iter().rev().position(|line| is_reported(&line)).unwrap_or_default();
        let line = lines[lines.len().saturating_sub(reported + 1)..].join(" ");
        Self { file: file.to_owned(), line, what: what.into() }
    }
}

impl std::fmt::Display for CoverageGap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: `{}`: {}", self.file, self.line, self.what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_brackets_alone_is_reported_with_what_stands_before_it() {
        let text = "fn f() {\n    loop {\n        g();\n    }\n}\n";
        let reported = |line| CoverageGap::at("f.rs", text, line, "never runs").line;
        assert_eq!(reported(3), "g();");
        assert_eq!(reported(5), "g(); } }");
        assert_eq!(CoverageGap::at("f.rs", "", 1, "never runs").line, "");
    }
}
