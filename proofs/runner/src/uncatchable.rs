//! The seeded faults that no harness can catch, each with its reason in `proofs/uncatchable.toml`.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use fuseline_faults::SeededFault;
use serde::Deserialize;

use crate::error::Error;

/// The faults that no harness can catch, each with the reason.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct UncatchableFaults {
    /// The reasons for whole files, by the beginnings of the files' names.
    files: BTreeMap<String, String>,
    /// The reasons for single faults, by their names.
    faults: BTreeMap<String, String>,
}

impl UncatchableFaults {
    /// Reads the list, and checks that each of its names is a fault's or a file's of these faults.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or names a fault or files that do not exist.
    pub(crate) fn load(root: &Path, faults: &[SeededFault]) -> Result<Self, Error> {
        let path = root.join("proofs/uncatchable.toml");
        let text = fs::read_to_string(&path).map_err(Error::file(&path))?;
        let uncatchable: Self =
            toml::from_str(&text).map_err(|error| Error::content(&path, &error))?;
        let lone = |name: &&String| !faults.iter().any(|fault| fault.name == **name);
        let empty = |start: &&String| !faults.iter().any(|fault| fault.file.starts_with(*start));
        let stale =
            uncatchable.faults.keys().find(lone).or_else(|| uncatchable.files.keys().find(empty));
        match stale {
            Some(name) => Err(Error::content(&path, &format!("there is no fault of {name}"))),
            None => Ok(uncatchable),
        }
    }

    pub(crate) fn holds(&self, fault: &SeededFault) -> bool {
        self.faults.contains_key(&fault.name)
            || self.files.keys().any(|start| fault.file.starts_with(start))
    }
}
