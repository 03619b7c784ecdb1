//! The seeded faults: their changes, and the places of the changes.

use std::collections::BTreeSet;
use std::ops::Range;

use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::error::FaultsError;
use crate::items::{Function, FunctionIndex};
use crate::tree::{Tree, hex};

/// The files of the faults: in the machine, in the code around it, and in the wheel.
pub(crate) const FILES: [&str; 3] =
    ["faults/machine.toml", "faults/around.toml", "faults/python.toml"];

/// The change of a fault, as its file states it.
#[derive(Clone, PartialEq, Eq, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenFault {
    name: String,
    breaks: BTreeSet<String>,
    /// The path of the function that it changes.
    item: Option<String>,
    /// The file, if the changed text is in no function.
    file: Option<String>,
    /// The text that occurs exactly once there.
    find: String,
    replace: String,
    /// The reason that it cannot share a build with other faults.
    own_build: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultsFile {
    fault: Vec<WrittenFault>,
}

/// One fault with its place in the sources.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SeededFault {
    /// Its name, which says what happens with the fault.
    pub name: String,
    /// The identifiers of the rules, promises and ambiguities that it violates.
    pub breaks: BTreeSet<String>,
    /// The file, from the root.
    pub file: String,
    /// The function that it changes, if it is in one.
    pub function: Option<Function>,
    /// The bytes of the file that it replaces.
    pub at: Range<usize>,
    /// The replacement.
    pub replace: String,
    /// The reason that it cannot share a build with other faults.
    pub own_build: Option<String>,
    /// The case of misuse that must fail, if it removes a guard.
    pub case: Option<MisuseCase>,
    /// The changes in other functions.
    pub(crate) also: Vec<SeededFault>,
    pub(crate) find: String,
}

/// A case of misuse that a guard meets.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MisuseCase {
    /// The interface that it comes through, such as `rust`.
    pub interface: String,
    /// Its name there.
    pub name: String,
}

/// Returns all faults, in their order.
///
/// # Errors
/// Returns an error if a file cannot be read, a name occurs twice, a fault breaks nothing, or its
/// place does not occur exactly once.
pub fn load(tree: &Tree) -> Result<Vec<SeededFault>, FaultsError> {
    let mut items = FunctionIndex::new(tree)?;
    let mut all = Vec::new();
    for file in FILES {
        let wrong =
            |error: toml::de::Error| FaultsError::content(&tree.path(file), error.to_string());
        let faults: FaultsFile = toml::from_str(&tree.text(file)?).map_err(wrong)?;
        for fault in faults.fault {
            all.push(fault.located(tree, &mut items)?);
        }
    }
    let mut names = BTreeSet::new();
    for fault in &all {
        if !names.insert(&fault.name) {
            return Err(error(&fault.name, "the name is taken"));
        }
        if fault.breaks.is_empty() {
            return Err(error(&fault.name, "it breaks nothing"));
        }
    }
    Ok(all)
}

impl WrittenFault {
    fn located(self, tree: &Tree, items: &mut FunctionIndex) -> Result<SeededFault, FaultsError> {
        let places = self.places(tree, items)?;
        let mut found = Vec::new();
        for (file, function) in places {
            let text = tree.text(&file)?;
            let within = function.as_ref().map_or(0..text.len(), |function| function.whole.clone());
            let part = text.get(within.clone()).unwrap_or_default();
            for (at, _) in part.match_indices(&self.find) {
                let start = within.start + at;
                found.push((file.clone(), function.clone(), start..start + self.find.len()));
            }
        }
        let place = self.item.as_ref().or(self.file.as_ref()).cloned().unwrap_or_default();
        match <[_; 1]>::try_from(found) {
            Ok([(file, function, at)]) => Ok(SeededFault {
                name: self.name,
                breaks: self.breaks,
                file,
                function,
                at,
                replace: self.replace,
                own_build: self.own_build,
                case: None,
                also: Vec::new(),
                find: self.find,
            }),
            Err(found) => {
                let why =
                    format!("{:?} occurs {} times in {place}, not once", self.find, found.len());
                Err(error(&self.name, &why))
            }
        }
    }

    /// Returns the functions with its item path, each with its file, or its file alone.
    fn places(
        &self,
        tree: &Tree,
        items: &mut FunctionIndex,
    ) -> Result<Vec<(String, Option<Function>)>, FaultsError> {
        match (&self.item, &self.file) {
            (Some(item), None) => {
                let name = item.split("::").next().unwrap_or_default();
                let functions = items.of_crate(name)?.iter().filter(|known| known.path == *item);
                let places: Vec<_> =
                    functions.map(|it| (it.file.clone(), Some(it.clone()))).collect();
                if places.is_empty() {
                    return Err(error(&self.name, &format!("there is no function {item}")));
                }
                Ok(places)
            }
            (None, Some(file)) if tree.path(file).exists() => Ok(vec![(file.clone(), None)]),
            (None, Some(file)) => Err(error(&self.name, &format!("there is no file {file}"))),
            _ => Err(error(&self.name, "it needs an `item` or a `file`, and not both")),
        }
    }
}

impl SeededFault {
    /// Returns the source with this fault.
    ///
    /// # Errors
    /// Returns an error if the text differs from the file in which the fault was found.
    pub fn seed(&self, source: &str) -> Result<String, FaultsError> {
        if source.get(self.at.clone()) != Some(&*self.find) {
            return Err(error(&self.name, &format!("{} has changed since it was read", self.file)));
        }
        Ok([&source[..self.at.start], &self.replace, &source[self.at.end..]].concat())
    }

    /// Returns a digest of the change.
    #[must_use]
    pub fn digest(&self) -> String {
        let item = self.function.as_ref().map_or(&self.file, |function| &function.path);
        let mut digest = Sha256::new();
        for part in [item, &self.find, &self.replace] {
            digest.update(part.len().to_le_bytes());
            digest.update(part);
        }
        hex(&digest.finalize())
    }

    /// Returns all changes of the fault, with the fault itself first.
    pub fn parts(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(&self.also)
    }
}

fn error(name: &str, why: &str) -> FaultsError {
    FaultsError::Seed { name: name.to_owned(), why: why.to_owned() }
}

#[cfg(test)]
impl SeededFault {
    pub(crate) fn of_test(function: Function, at: Range<usize>, find: &str, replace: &str) -> Self {
        Self {
            name: "x".into(),
            breaks: BTreeSet::new(),
            file: function.file.clone(),
            function: Some(function),
            at,
            replace: replace.into(),
            own_build: None,
            case: None,
            also: Vec::new(),
            find: find.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changed_source_is_refused() {
        let function = Function {
            path: "x::f".into(),
            file: "f.rs".into(),
            whole: 0..9,
            body: 0..9,
            constant: None,
        };
        let fault = SeededFault::of_test(function, 2..7, "a < b", "a <= b");
        assert_eq!(fault.seed("{ a < b }").expect("it is there"), "{ a <= b }");
        assert!(fault.seed("{  a < b }").is_err());
        assert!(fault.seed("").is_err());
    }

    #[test]
    fn every_fault_has_its_place() -> Result<(), FaultsError> {
        let tree = Tree::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..").into());
        for fault in load(&tree)? {
            assert_ne!(
                fault.seed(&tree.text(&fault.file)?)?,
                tree.text(&fault.file)?,
                "{}",
                fault.name
            );
        }
        Ok(())
    }
}
