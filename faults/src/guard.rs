//! Guards against misuse. Each guard is removed once, and the case that it guards against must fail
//! then.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::error::FaultsError;
use crate::fault::{MisuseCase, SeededFault};
use crate::items::FunctionIndex;
use crate::tree::Tree;

/// One guard in each line: the interface, the case, the file, the text, and its replacement. If a
/// case has several lines, all its guards are removed at once.
const GUARDS: &str = "docs/safety/misuse-guards";

/// The place of a guard: the file, and the bytes of the body of the function around it, if there is
/// one.
type Place = (String, Option<(usize, usize)>);

/// A replacement, in bytes of a file.
type Edit = (Range<usize>, String);

/// Returns all guards that can be removed, each as a fault that breaks its case.
///
/// # Errors
/// Returns an error if a file cannot be read, or a guard is not in its file.
pub fn load_guards(tree: &Tree) -> Result<Vec<SeededFault>, FaultsError> {
    let mut items = FunctionIndex::new(tree)?;
    let mut cases: Vec<(MisuseCase, BTreeMap<Place, Vec<Edit>>)> = Vec::new();
    for line in tree.text(GUARDS)?.lines().filter(|line| !line.starts_with('#')) {
        let line = format!("{line} ");
        let fields: Vec<&str> = line.splitn(5, " | ").collect();
        let [interface, case, file, find, replace] = fields[..] else { continue };
        let (interface, case) = (interface.trim().to_owned(), case.trim().to_owned());
        let case = MisuseCase { interface, name: case };
        if cases.iter().all(|(known, _)| *known != case) {
            cases.push((case.clone(), BTreeMap::new()));
        }
        let [find, replace] = [find, replace.trim_end()].map(|text| text.replace("\\n", "\n"));
        let text = tree.text(file)?;
        let found: Vec<usize> = text.match_indices(&find).map(|(at, _)| at).collect();
        if found.is_empty() {
            let why =
                format!("the guard of {}, {} is not there: {find}", case.interface, case.name);
            return Err(FaultsError::content(&tree.path(file), why));
        }
        let Some((_, places)) = cases.iter_mut().find(|(known, _)| *known == case) else {
            continue;
        };
        for at in found {
            let at = at..at + find.len();
            let function = items.around(file, &at)?;
            let body = function.map(|it| (it.body.start, it.body.end));
            places.entry((file.to_owned(), body)).or_default().push((at, replace.clone()));
        }
    }
    cases.into_iter().map(|(case, places)| removed(tree, &mut items, &case, places)).collect()
}

/// Returns the fault that removes the guards of a case, with one part for each function.
fn removed(
    tree: &Tree,
    items: &mut FunctionIndex,
    case: &MisuseCase,
    places: BTreeMap<Place, Vec<Edit>>,
) -> Result<SeededFault, FaultsError> {
    let mut parts = Vec::new();
    for ((file, _), mut edits) in places {
        edits.sort_by_key(|(at, _)| at.start);
        let text = tree.text(&file)?;
        let (start, end) = (edits[0].0.start, edits[edits.len() - 1].0.end);
        let (mut replace, mut done) = (String::new(), start);
        for (at, instead) in edits {
            replace.push_str(&text[done..at.start]);
            replace.push_str(&instead);
            done = at.end;
        }
        let function = items.around(&file, &(start..end))?;
        parts.push(SeededFault {
            name: format!("{}: {}", case.interface, case.name),
            breaks: BTreeSet::new(),
            function,
            replace,
            own_build: None,
            find: text[start..end].to_owned(),
            at: start..end,
            file,
            case: Some(case.clone()),
            also: Vec::new(),
        });
    }
    let mut first = parts.remove(0);
    first.also = parts;
    Ok(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_guard_has_its_place() -> Result<(), FaultsError> {
        let tree = Tree::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..").into());
        let guards = load_guards(&tree)?;
        for part in guards.iter().flat_map(SeededFault::parts) {
            let text = tree.text(&part.file)?;
            assert_ne!(part.seed(&text)?, text, "{}", part.name);
        }
        assert!(guards.len() > 200, "only {} guards", guards.len());
        Ok(())
    }
}
