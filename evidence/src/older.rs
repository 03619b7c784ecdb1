//! Results that are older than the sources they tell of, named with the reason until they are taken again.

use std::collections::BTreeMap;
use std::fs;

use crate::error::EvidenceError;
use crate::tree::Tree;

/// Where they are named.
const FILE: &str = "evidence/older.toml";

/// The reasons by the results' names; none if there is no such file.
///
/// # Errors
/// The file cannot be read, or a reason is empty.
pub(crate) fn declared(tree: &Tree) -> Result<BTreeMap<String, String>, EvidenceError> {
    let path = tree.path(FILE);
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let text = fs::read_to_string(&path).map_err(EvidenceError::file(&path))?;
    let reasons: BTreeMap<String, String> =
        toml::from_str(&text).map_err(|error| EvidenceError::content(&path, error.to_string()))?;
    match reasons.iter().find(|(_, because)| because.trim().is_empty()) {
        Some((name, _)) => Err(EvidenceError::content(&path, format!("{name}: no reason"))),
        None => Ok(reasons),
    }
}

/// Parts the results that are older than their sources, name and title, into the declared ones, given with their
/// reasons, and what is wrong: one that is not declared, and one that is declared and current or unknown.
pub(crate) fn sort(
    outdated: &[(&'static str, &'static str)],
    mut declared: BTreeMap<String, String>,
) -> (Vec<(&'static str, String)>, Vec<String>) {
    let (mut older, mut wrong) = (Vec::new(), Vec::new());
    for (name, title) in outdated {
        match declared.remove(*name) {
            Some(because) => older.push((*title, because)),
            None => wrong.push(format!("{title}: the sources changed since the results")),
        }
    }
    let current = declared.into_keys();
    wrong.extend(
        current.map(|name| format!("{name} is declared older than its sources, and is not")),
    );
    (older, wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_declared_and_older_is_let_pass() {
        let declared = [("test", "moved"), ("loom", "moved")];
        let declared = declared.map(|(name, because)| (name.to_owned(), because.to_owned()));
        let (older, wrong) = sort(&[("test", "tests"), ("model", "models")], declared.into());
        assert_eq!(older, [("tests", "moved".to_owned())]);
        assert_eq!(
            wrong,
            [
                "models: the sources changed since the results",
                "loom is declared older than its sources, and is not"
            ]
        );
    }
}
