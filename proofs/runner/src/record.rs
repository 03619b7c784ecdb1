//! The committed record: the harnesses that there must be, and which of them catches which fault.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use fuseline_faults::SeededFault;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::source::HarnessSources;
use crate::uncatchable::UncatchableFaults;

/// The ratchet. `--record` may raise the numbers; a lower number fails the run.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Record {
    /// The number of covers of each harness.
    pub(crate) harnesses: BTreeMap<String, usize>,
    /// The number of assertions of each function, by file.
    pub(crate) assertions: BTreeMap<String, usize>,
    /// The harnesses that caught each fault.
    pub(crate) faults: BTreeMap<String, CatchRecord>,
}

/// The harnesses that caught a fault.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CatchRecord {
    /// A digest of the fault's change.
    pub(crate) change: String,
    /// The harnesses with an assertion that failed.
    pub(crate) by: BTreeSet<String>,
}

impl Record {
    pub(crate) fn path(root: &Path) -> PathBuf {
        root.join("proofs/results/record.json")
    }

    /// Reads the committed record, or returns an empty one if there is none yet.
    ///
    /// # Errors
    /// Returns an error if the record cannot be read.
    pub(crate) fn load(root: &Path) -> Result<Self, Error> {
        load(&Self::path(root))
    }

    /// # Errors
    /// Returns an error if the record cannot be written.
    pub(crate) fn save(&self, root: &Path) -> Result<(), Error> {
        save(&Self::path(root), self)
    }

    /// Updates the record from the sources.
    pub(crate) fn take(&mut self, sources: &HarnessSources) {
        let harnesses = sources.harnesses.iter();
        self.harnesses = harnesses.map(|h| (h.name.clone(), h.covers.len())).collect();
        self.assertions.clone_from(&sources.assertions);
        for caught in self.faults.values_mut() {
            caught.by.retain(|name| self.harnesses.contains_key(name));
        }
    }

    /// Returns descriptions of everything that the sources have less of than the record.
    pub(crate) fn shrunk(&self, sources: &HarnessSources) -> Vec<String> {
        let mut wrong = Vec::new();
        for (name, covers) in &self.harnesses {
            match sources.harnesses.iter().find(|harness| harness.name == *name) {
                None => wrong.push(format!("the harness {name} is gone")),
                Some(harness) if harness.covers.len() < *covers => {
                    wrong.push(format!("{name} has fewer covers than {covers}"));
                }
                Some(_) => {}
            }
        }
        for (function, assertions) in &self.assertions {
            if sources.assertions.get(function).is_none_or(|now| now < assertions) {
                wrong.push(format!("{function} makes fewer assertions than {assertions}"));
            }
        }
        for harness in &sources.harnesses {
            if !self.harnesses.contains_key(&harness.name) {
                wrong.push(format!("{} is not recorded yet: use --record", harness.name));
            }
        }
        wrong
    }

    /// Returns the faults that a harness should catch, but that the record has no harness for in
    /// their current form.
    pub(crate) fn uncaught(
        &self,
        faults: &[SeededFault],
        uncatchable: &UncatchableFaults,
    ) -> Vec<String> {
        let wrong = |fault: &SeededFault| match self.faults.get(&fault.name) {
            Some(caught) if caught.change != fault.digest() => {
                Some(format!("{} is not the fault of the record: search again", fault.name))
            }
            Some(caught) if !caught.by.is_empty() => None,
            _ => Some(format!("no harness is recorded to catch {}", fault.name)),
        };
        faults.iter().filter(|fault| !uncatchable.holds(fault)).filter_map(wrong).collect()
    }

    /// Selects pairs of a fault and a harness to run. Each fault that some of `harnesses` can catch
    /// is in a pair, and so is each of these harnesses that catches a fault.
    pub(crate) fn pairs(
        &self,
        faults: &[SeededFault],
        harnesses: &BTreeSet<&str>,
    ) -> BTreeSet<(String, String)> {
        let names: BTreeSet<&str> = faults.iter().map(|fault| fault.name.as_str()).collect();
        let caught: Vec<(&String, BTreeSet<&String>)> = self
            .faults
            .iter()
            .filter(|(fault, _)| names.contains(fault.as_str()))
            .map(|(fault, caught)| {
                let able = caught.by.iter().filter(|name| harnesses.contains(name.as_str()));
                (fault, able.collect())
            })
            .collect();
        let mut pairs = BTreeSet::new();
        let mut used = BTreeSet::new();
        for (fault, caught) in &caught {
            // A harness without a pair is preferred, so that few pairs suffice.
            let fresh = caught.iter().find(|name| !used.contains(**name));
            if let Some(name) = fresh.or_else(|| caught.first()) {
                used.insert((*name).clone());
                pairs.insert(((*fault).clone(), (*name).clone()));
            }
        }
        for name in self.harnesses.keys().filter(|name| !used.contains(*name)) {
            if let Some((fault, _)) = caught.iter().find(|(_, caught)| caught.contains(name)) {
                pairs.insert(((*fault).clone(), name.clone()));
            }
        }
        pairs
    }
}

/// Reads a value from JSON, or returns an empty one if there is no file yet.
///
/// # Errors
/// Returns an error if the file cannot be read.
pub(crate) fn load<T: DeserializeOwned + Default>(path: &Path) -> Result<T, Error> {
    if !path.exists() {
        return Ok(T::default());
    }
    let text = fs::read_to_string(path).map_err(Error::file(path))?;
    serde_json::from_str(&text).map_err(|error| Error::content(path, &error))
}

/// Writes a value as JSON.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub(crate) fn save(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut text =
        serde_json::to_string_pretty(value).map_err(|error| Error::content(path, &error))?;
    text.push('\n');
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::file(folder))?;
    }
    fs::write(path, text).map_err(Error::file(path))
}

#[cfg(test)]
mod tests;
