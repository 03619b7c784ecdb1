//! The seeded faults, and which harness catches each.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::error::Error;

/// One place of the source with what a fault would make of it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Fault {
    pub(crate) name: String,
    pub(crate) breaks: BTreeSet<String>,
    pub(crate) file: String,
    find: String,
    replace: String,
}

#[derive(Deserialize)]
struct Faults {
    fault: Vec<Fault>,
}

/// What no harness can catch, each with the reason.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Beyond {
    /// By the beginnings of their files' names.
    files: BTreeMap<String, String>,
    /// By their own names.
    faults: BTreeMap<String, String>,
}

impl Beyond {
    pub(crate) fn holds(&self, fault: &Fault) -> bool {
        self.faults.contains_key(&fault.name)
            || self.files.keys().any(|start| fault.file.starts_with(start))
    }
}

/// All faults of the project, in their order.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn load(root: &Path) -> Result<Vec<Fault>, Error> {
    let faults: Faults = toml_at(&root.join("tests/faults.toml"))?;
    Ok(faults.fault)
}

/// The faults that no harness can catch.
///
/// # Errors
/// The file cannot be read, or names a fault or files that there are not.
pub(crate) fn beyond(root: &Path, faults: &[Fault]) -> Result<Beyond, Error> {
    let path = root.join("proofs/beyond.toml");
    let beyond: Beyond = toml_at(&path)?;
    let lone = |name: &&String| !faults.iter().any(|fault| fault.name == **name);
    let empty = |start: &&String| !faults.iter().any(|fault| fault.file.starts_with(*start));
    let stale = beyond.faults.keys().find(lone).or_else(|| beyond.files.keys().find(empty));
    match stale {
        Some(name) => Err(Error::content(&path, &format!("there is no fault of {name}"))),
        None => Ok(beyond),
    }
}

fn toml_at<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let text = fs::read_to_string(path).map_err(Error::file(path))?;
    toml::from_str(&text).map_err(|error| Error::content(path, &error))
}

impl Fault {
    /// Its file with it.
    ///
    /// # Errors
    /// The file cannot be read, or the place is not there exactly once.
    pub(crate) fn seed(&self, root: &Path) -> Result<String, Error> {
        let path = root.join(&self.file);
        let text = fs::read_to_string(&path).map_err(Error::file(&path))?;
        match text.matches(&self.find).count() {
            1 => Ok(text.replacen(&self.find, &self.replace, 1)),
            count => Err(Error::content(
                &path,
                &format!("the place of {} is there {count} times", self.name),
            )),
        }
    }

    /// A digest of the change that it makes, as the records of evidence have it.
    pub(crate) fn digest(&self) -> String {
        let mut digest = Sha256::new();
        for part in [&self.file, &self.find, &self.replace] {
            digest.update(part.len().to_le_bytes());
            digest.update(part);
        }
        hex(&digest.finalize())
    }
}

/// Lower-case digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
