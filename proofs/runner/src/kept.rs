//! The slow tier's last ledger, as it is committed.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use fuseline_evidence::hex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::Error;
use crate::ledger::Line;
use crate::record;
use crate::source::{Harness, Sources};

/// What a proof depends on.
const PROVED: [&str; 3] = ["core/src", "proofs/src", "proofs/engine"];

/// The verdict about a harness that no run proved.
const NOT_YET: &str = "not proved yet";

/// By harness, what was proved and what it cost.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Kept {
    /// The machine in a few words.
    machine: String,
    proved: BTreeMap<String, Proof>,
}

#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Proof {
    engine: String,
    bounds: String,
    solver: String,
    verdict: String,
    seconds: f64,
    memory_mib: u64,
    /// A digest of the sources that it is about.
    sources: String,
}

impl Kept {
    fn path(root: &Path) -> PathBuf {
        root.join("proofs/results/slow.json")
    }

    /// The committed one; empty if there is none yet.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn load(root: &Path) -> Result<Self, Error> {
        record::load(&Self::path(root))
    }

    /// Takes over which harnesses the slow tier has. A new one is not proved yet.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn take(&mut self, root: &Path, sources: &Sources) -> Result<(), Error> {
        let slow: Vec<&Harness> =
            sources.harnesses.iter().filter(|harness| harness.is_slow()).collect();
        self.proved.retain(|name, _| slow.iter().any(|harness| harness.name == *name));
        for harness in slow {
            self.proved.entry(harness.name.clone()).or_insert_with(|| Proof {
                bounds: harness.bounds.clone(),
                solver: harness.solver.clone(),
                verdict: NOT_YET.to_owned(),
                ..Proof::default()
            });
        }
        record::save(&Self::path(root), self)
    }

    /// Keeps a line, if it is of the slow tier.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn add(&mut self, root: &Path, line: &Line, digest: &str) -> Result<(), Error> {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        self.machine = format!("{cores} cores, {}", std::env::consts::ARCH.replace('_', "-"));
        let Some(proof) = self.proved.get_mut(&line.harness) else { return Ok(()) };
        *proof = Proof {
            engine: line.engine.clone(),
            bounds: line.bounds.clone(),
            solver: line.solver.clone(),
            verdict: line.verdict.clone(),
            seconds: line.seconds,
            memory_mib: line.memory_mib,
            sources: digest.to_owned(),
        };
        record::save(&Self::path(root), self)
    }

    /// What is wrong with it: a harness of the slow tier that it lacks, or one that is not of that tier.
    pub(crate) fn differs(&self, sources: &Sources) -> Vec<String> {
        let slow = slow(sources);
        let kept: BTreeSet<&str> = self.proved.keys().map(String::as_str).collect();
        let lacks = slow.difference(&kept).map(|name| format!("the slow ledger lacks {name}"));
        let more = kept.difference(&slow).map(|name| format!("{name} is not of the slow tier"));
        lacks.chain(more).collect()
    }

    /// How many are proved, and what is not or is of other sources than these, in words.
    pub(crate) fn told(&self, digest: &str) -> String {
        let names = |wanted: &dyn Fn(&Proof) -> bool| {
            let of = self.proved.iter().filter(|(_, proof)| wanted(proof));
            of.map(|(name, _)| name.as_str()).collect::<Vec<_>>()
        };
        let open = names(&|proof| proof.verdict == NOT_YET);
        let stale = names(&|proof| proof.verdict != NOT_YET && proof.sources != digest);
        let (proved, all) = (self.proved.len() - open.len(), self.proved.len());
        let mut told = format!("slow tier: {proved} of {all} proved");
        for (names, what) in [(open, NOT_YET), (stale, "of earlier sources")] {
            if !names.is_empty() {
                let _ = write!(told, "; {what}: {}", names.join(", "));
            }
        }
        told
    }
}

fn slow(sources: &Sources) -> BTreeSet<&str> {
    let slow = sources.harnesses.iter().filter(|harness| harness.is_slow());
    slow.map(|harness| harness.name.as_str()).collect()
}

/// A digest of what proofs are about.
///
/// # Errors
/// A file cannot be read.
pub(crate) fn digest(root: &Path) -> Result<String, Error> {
    let mut files = Vec::new();
    for name in PROVED {
        walk(&root.join(name), &mut files)?;
    }
    files.sort();
    let mut digest = Sha256::new();
    for path in &files {
        let content = fs::read(path).map_err(Error::file(path))?;
        let name = path.strip_prefix(root).unwrap_or(path).to_string_lossy().into_owned();
        for part in [name.as_bytes(), &content] {
            digest.update(part.len().to_le_bytes());
            digest.update(part);
        }
    }
    Ok(hex(&digest.finalize()))
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
mod tests {
    use super::*;
    use crate::source;

    #[test]
    fn the_committed_ledger_has_the_harnesses_of_the_slow_tier() {
        let tree = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let sources = source::read(tree).expect("the harnesses");
        let kept = Kept::load(tree).expect("a ledger");
        assert_eq!(kept.differs(&sources), Vec::<String>::new());
        assert_eq!(Kept::default().differs(&sources).len(), kept.proved.len());
        let told = kept.told("");
        assert!(told.ends_with(&format!("of {} proved", kept.proved.len())) || told.contains("; "));
    }
}
