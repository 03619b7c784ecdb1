//! The ledger of proved harnesses and caught faults, which is committed in
//! `proofs/results/ledger.json`.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fuseline_faults::hex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::Error;
use crate::line::LedgerLine;
use crate::record;
use crate::source::{Harness, HarnessSources};
use crate::tools::Tools;
use crate::translate;

/// The sources of the runner that run the checker and read its answer.
const CHECKER: [&str; 2] = ["proofs/runner/src/check.rs", "proofs/runner/src/translate.rs"];

/// The verdict about a harness that no run has proved.
const NOT_YET: &str = "not proved yet";

/// The good verdicts and their cost, by question: a harness, or a fault and a harness.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VerdictLedger {
    /// A short description of the host.
    machine: String,
    proved: BTreeMap<String, Proof>,
}

#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
struct Proof {
    solver: String,
    verdict: String,
    seconds: f64,
    memory_mib: u64,
    #[serde(flatten)]
    provenance: Provenance,
}

/// The conditions of a verdict. The same conditions lead to the same verdict.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Provenance {
    /// The bounds of the harness, and how far its loops are unwound.
    #[serde(default)]
    bounds: String,
    /// A digest of the sources, including those that run the checker.
    sources: String,
    /// The checker and the compiler, with their versions.
    tools: String,
    /// A digest of the seeded fault's change, or empty if there is no fault.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    change: String,
}

impl Provenance {
    /// Returns the conditions of the current sources, without a fault and without a harness.
    ///
    /// # Errors
    /// Returns an error if a file cannot be read or a tool does not state its version.
    pub(crate) fn now(root: &Path, tools: &Tools) -> Result<Self, Error> {
        Ok(Self { sources: digest(root)?, tools: tools.versions()?, ..Self::default() })
    }

    /// Returns the same conditions for a harness.
    pub(crate) fn about(&self, harness: &Harness) -> Self {
        Self { bounds: harness.stated_bounds(), ..self.clone() }
    }

    /// Returns the same conditions with a fault.
    pub(crate) fn with(&self, change: String) -> Self {
        Self { change, ..self.clone() }
    }
}

impl VerdictLedger {
    fn path(root: &Path) -> PathBuf {
        root.join("proofs/results/ledger.json")
    }

    /// Reads the committed ledger, or returns an empty one if there is none yet.
    ///
    /// # Errors
    /// Returns an error if the ledger cannot be read.
    pub(crate) fn load(root: &Path) -> Result<Self, Error> {
        record::load(&Self::path(root))
    }

    /// Updates the list of harnesses. A new harness is not proved yet.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn take(&mut self, root: &Path, sources: &HarnessSources) -> Result<(), Error> {
        let harnesses = &sources.harnesses;
        self.proved
            .retain(|question, _| harnesses.iter().any(|of| of.name == harness_of(question)));
        for harness in harnesses {
            self.proved.entry(harness.name.clone()).or_insert_with(|| Proof {
                solver: harness.solver.clone(),
                verdict: NOT_YET.to_owned(),
                provenance: Provenance::default().about(harness),
                ..Proof::default()
            });
        }
        record::save(&Self::path(root), self)
    }

    /// Stores a line if it is good.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn add(
        &mut self,
        root: &Path,
        line: &LedgerLine,
        provenance: &Provenance,
    ) -> Result<(), Error> {
        if !line.good {
            return Ok(());
        }
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        self.machine = format!("{cores} cores, {}", std::env::consts::ARCH.replace('_', "-"));
        let proof = Proof {
            solver: line.solver.clone(),
            verdict: line.verdict.clone(),
            seconds: line.seconds,
            memory_mib: line.memory_mib,
            provenance: provenance.clone(),
        };
        self.proved.insert(line.name(), proof);
        record::save(&Self::path(root), self)
    }

    /// Returns how long the answer to a question took, or 0 if there is none.
    pub(crate) fn seconds(&self, question: &str) -> f64 {
        self.proved.get(question).map_or(0.0, |proof| proof.seconds)
    }

    /// Selects the questions to ask. These are all questions without an answer for these sources,
    /// and a random sample of the others. The sample took about `budget`, and has at least one
    /// question. Also returns a description of how many are left out.
    pub(crate) fn sample(
        &self,
        questions: &[(String, Provenance)],
        budget: Duration,
    ) -> (BTreeSet<String>, String) {
        let answered = |(name, provenance): &&(String, Provenance)| {
            self.proved
                .get(name)
                .is_some_and(|p| p.verdict != NOT_YET && p.provenance == *provenance)
        };
        let (mut known, open): (Vec<_>, Vec<_>) = questions.iter().partition(answered);
        let mut chosen: BTreeSet<String> = open.into_iter().map(|(name, _)| name.clone()).collect();
        let (new, all) = (chosen.len(), known.len());
        fastrand::shuffle(&mut known);
        let mut left = budget.as_secs_f64();
        let all_too_long = known.iter().all(|(name, _)| self.seconds(name) > left);
        for (nth, (name, _)) in known.into_iter().enumerate() {
            let seconds = self.seconds(name);
            if nth == 0 && all_too_long || seconds <= left {
                left -= seconds;
                chosen.insert(name.clone());
            }
        }
        let summary = format!(
            "{all} of {} are in the ledger of these very sources: {} of them, drawn anew, and {new} others are checked",
            questions.len(),
            chosen.len() - new,
        );
        (chosen, summary)
    }

    /// Returns the differences: harnesses that the ledger lacks, and harnesses that no longer exist.
    pub(crate) fn differs(&self, sources: &HarnessSources) -> Vec<String> {
        let there: BTreeSet<&str> = sources.harnesses.iter().map(|h| h.name.as_str()).collect();
        let recorded: BTreeSet<&str> =
            self.proved.keys().map(|question| harness_of(question)).collect();
        let own = self.proved.keys().map(String::as_str).collect();
        let lacks = there.difference(&own).map(|name| format!("the ledger lacks {name}"));
        let more = recorded.difference(&there).map(|name| format!("the ledger has {name}"));
        lacks.chain(more).collect()
    }

    /// Describes how many harnesses are proved, which are not, and which were proved with other sources.
    pub(crate) fn summary(&self, digest: &str) -> String {
        let harnesses =
            || self.proved.iter().filter(|(question, _)| harness_of(question) == *question);
        let names = |wanted: &dyn Fn(&Proof) -> bool| {
            let of = harnesses().filter(|(_, proof)| wanted(proof));
            of.map(|(name, _)| name.as_str()).collect::<Vec<_>>()
        };
        let open = names(&|proof| proof.verdict == NOT_YET);
        let stale = names(&|proof| proof.verdict != NOT_YET && proof.provenance.sources != digest);
        let all = harnesses().count();
        let mut summary = format!("ledger: {} of {all} harnesses proved", all - open.len());
        for (names, what) in [(open, NOT_YET), (stale, "of earlier sources")] {
            match names.len() {
                0 => {}
                many @ 9.. => drop(write!(summary, "; {what}: {many}")),
                _ => drop(write!(summary, "; {what}: {}", names.join(", "))),
            }
        }
        summary
    }
}

/// Returns the harness of a question.
fn harness_of(question: &str) -> &str {
    question.rsplit_once(" / ").map_or(question, |(_, harness)| harness)
}

/// Returns a digest of everything that verdicts depend on. It leaves out the lines of Rust that do
/// not change what the code does.
///
/// # Errors
/// Returns an error if a file cannot be read.
pub(crate) fn digest(root: &Path) -> Result<String, Error> {
    let mut files = Vec::new();
    for name in translate::SOURCES.iter().chain(&CHECKER) {
        walk(&root.join(name), &mut files)?;
    }
    files.sort();
    let mut digest = Sha256::new();
    for path in &files {
        let mut content = fs::read(path).map_err(Error::file(path))?;
        if path.extension().is_some_and(|extension| extension == "rs") {
            content = meaning(&content);
        }
        let name = path.strip_prefix(root).unwrap_or(path).to_string_lossy().into_owned();
        for part in [name.as_bytes(), &content] {
            digest.update(part.len().to_le_bytes());
            digest.update(part);
        }
    }
    Ok(hex(&digest.finalize()))
}

/// Returns the lines other than comments, `#[inline]` and bounds of loops, which have a field of their own.
fn meaning(content: &[u8]) -> Vec<u8> {
    let lines = content.split_inclusive(|byte| *byte == b'\n');
    let is_silent = |line: &[u8]| {
        let line = line.trim_ascii();
        line.starts_with(b"//") || line == b"#[inline]" || line.starts_with(b"#[kani::unwind(")
    };
    lines.filter(|line| !is_silent(line)).flatten().copied().collect()
}

fn walk(path: &Path, files: &mut Vec<PathBuf>) -> Result<(), Error> {
    if path.is_dir() {
        for entry in fs::read_dir(path).map_err(Error::file(path))? {
            walk(&entry.map_err(Error::file(path))?.path(), files)?;
        }
    } else {
        files.push(path.to_owned());
    }
    Ok(())
}

#[cfg(test)]
mod tests;
