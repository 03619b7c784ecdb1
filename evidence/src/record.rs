//! What the witnesses of one kind did, as it is committed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use crate::citation::has_harness;
use crate::error::EvidenceError;
use crate::fault::SeededFault;
use crate::kind::{EvidenceKind, RunMethod};
use crate::tree::Tree;

/// The results of one kind of witness.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindRecord {
    /// A digest of the sources that the results depend on.
    pub sources: String,
    /// The compiler or interpreter.
    pub rustc: String,
    /// The witnesses that ran, and held, without a fault.
    pub held: BTreeSet<String>,
    /// By the faults' names, what happened under each.
    pub faults: BTreeMap<String, FaultResult>,
}

/// What happened under one fault.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultResult {
    /// A digest of the change that the fault makes.
    pub change: String,
    /// The witnesses that went red.
    pub by: BTreeSet<String>,
}

/// What the proofs keep of themselves, as far as it is of use here.
#[derive(Deserialize)]
struct Proofs {
    /// The harnesses, and how many covers each has.
    harnesses: BTreeMap<String, usize>,
    faults: BTreeMap<String, FaultResult>,
}

/// The folder of the records.
#[must_use]
pub fn folder(tree: &Tree) -> PathBuf {
    tree.path("evidence/results")
}

impl KindRecord {
    /// The committed record of a kind, if there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn load(tree: &Tree, kind: &EvidenceKind) -> Result<Option<Self>, EvidenceError> {
        let path = path(tree, kind);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read_to_string(&path).map_err(EvidenceError::file(&path))?;
        let wrong = |error: serde_json::Error| EvidenceError::content(&path, error.to_string());
        let RunMethod::Prove { files, .. } = kind.run else {
            return serde_json::from_str(&text).map(Some).map_err(wrong);
        };
        let Proofs { harnesses, mut faults } = serde_json::from_str(&text).map_err(wrong)?;
        let mut held = BTreeSet::new();
        for name in harnesses.into_keys() {
            if has_harness(tree, files, &name)? {
                held.insert(name);
            }
        }
        for caught in faults.values_mut() {
            caught.by.retain(|name| held.contains(name));
        }
        let (sources, rustc) = (kind.digest(tree)?, "proofs/prove".to_owned());
        Ok(Some(Self { sources, rustc, held, faults }))
    }

    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn save(&self, tree: &Tree, kind: &EvidenceKind) -> Result<(), EvidenceError> {
        let path = path(tree, kind);
        let mut text = serde_json::to_string_pretty(self)
            .map_err(|error| EvidenceError::content(&path, error.to_string()))?;
        text.push('\n');
        write_whole(&path, &text)
    }

    /// What happened under this fault, if it is the fault that was seeded.
    #[must_use]
    pub fn caught(&self, fault: &SeededFault) -> Option<&BTreeSet<String>> {
        let caught = self.faults.get(&fault.name)?;
        (caught.change == fault.digest()).then_some(&caught.by)
    }
}

/// Writes a file by another name first, then gives it its own.
pub(crate) fn write_whole(path: &std::path::Path, text: &str) -> Result<(), EvidenceError> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(EvidenceError::file(folder))?;
    let mut file = NamedTempFile::new_in(folder).map_err(EvidenceError::file(folder))?;
    file.write_all(text.as_bytes()).map_err(EvidenceError::file(path))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let shared = fs::Permissions::from_mode(0o644);
        file.as_file().set_permissions(shared).map_err(EvidenceError::file(path))?;
    }
    file.persist(path).map_err(|error| EvidenceError::file(path)(error.error))?;
    Ok(())
}

fn path(tree: &Tree, kind: &EvidenceKind) -> PathBuf {
    if kind.is_run_here() {
        folder(tree).join(format!("{}.json", kind.name))
    } else {
        tree.path("proofs/results/record.json")
    }
}
