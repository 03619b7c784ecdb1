//! The seeded faults.

use std::collections::BTreeSet;
use std::fs;

use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::error::EvidenceError;
use crate::tree::{Tree, hex};

/// Where they are kept: those of the machine, those of what is around it, and those of the wheel's modules in Python.
pub(crate) const FILES: [&str; 3] =
    ["tests/faults.toml", "tests/faults-around.toml", "tests/faults-python.toml"];

/// One passage of the source with what a fault would make of it.
#[derive(Clone, PartialEq, Eq, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeededFault {
    /// Its name, which says what the machine then does.
    pub name: String,
    /// The identifiers of the rules, promises and ambiguities that it violates.
    pub breaks: BTreeSet<String>,
    /// The file, from the root.
    pub file: String,
    /// What occurs exactly once there.
    pub find: String,
    /// What takes its place.
    pub replace: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultsFile {
    fault: Vec<SeededFault>,
}

/// All faults, in their order.
///
/// # Errors
/// A file cannot be read, a name is there twice, or a fault breaks nothing.
pub fn load(tree: &Tree) -> Result<Vec<SeededFault>, EvidenceError> {
    let mut all = Vec::new();
    for file in FILES {
        let path = tree.path(file);
        let text = fs::read_to_string(&path).map_err(EvidenceError::file(&path))?;
        let faults: FaultsFile = toml::from_str(&text)
            .map_err(|error| EvidenceError::content(&path, error.to_string()))?;
        all.extend(faults.fault);
    }
    let mut names = BTreeSet::new();
    for fault in &all {
        if !names.insert(&fault.name) {
            return Err(fault.error("the name is taken"));
        }
        if fault.breaks.is_empty() {
            return Err(fault.error("it breaks nothing"));
        }
    }
    Ok(all)
}

impl SeededFault {
    /// The source with this fault.
    ///
    /// # Errors
    /// The passage does not occur exactly once.
    pub fn seed(&self, source: &str) -> Result<String, EvidenceError> {
        match source.matches(&self.find).count() {
            1 => Ok(source.replacen(&self.find, &self.replace, 1)),
            count => Err(self.error(&format!("its place occurs {count} times in {}", self.file))),
        }
    }

    /// A digest of the change that it makes.
    #[must_use]
    pub fn digest(&self) -> String {
        let mut digest = Sha256::new();
        for part in [&self.file, &self.find, &self.replace] {
            digest.update(part.len().to_le_bytes());
            digest.update(part);
        }
        hex(&digest.finalize())
    }

    fn error(&self, why: &str) -> EvidenceError {
        EvidenceError::Seed { name: self.name.clone(), why: why.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_that_is_not_there_exactly_once_is_refused() {
        let fault = SeededFault {
            name: "x".into(),
            breaks: BTreeSet::new(),
            file: "f".into(),
            find: "a < b".into(),
            replace: "a <= b".into(),
        };
        assert_eq!(fault.seed("if a < b {").expect("it is there once"), "if a <= b {");
        assert!(fault.seed("").is_err());
        assert!(fault.seed("a < b || a < b").is_err());
    }
}
