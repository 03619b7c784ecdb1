//! The table of promises: the evidence for each from the run that just ended, and what is missing.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use crate::campaign::CampaignFindings;
use crate::citation;
use crate::error::FaultsError;
use crate::fault::SeededFault;
use crate::kind::WitnessKind;
use crate::tree::Tree;

/// The reasons why identifiers may have fewer than two kinds of witness, or fewer than two faults
/// that two kinds catch.
const GAPS: &str = "faults/gaps.toml";
/// The witnesses that must show each identifier.
const WITNESSES: &str = "faults/witnesses.toml";
/// The number of kinds of witness that each identifier needs, and of its faults that this many
/// kinds catch.
pub(crate) const ENOUGH: usize = 2;

/// The evidence for the rules and promises, with the mistakes.
#[derive(Debug, Serialize)]
pub struct Table {
    /// One row for each identifier, in the order of the specification.
    pub rows: Vec<PromiseRow>,
    /// The faults in their order.
    pub faults: Vec<FaultRow>,
    /// Identifiers that have less evidence than they should, each with the reason.
    pub gaps: BTreeMap<String, String>,
    /// Faults that only one kind catches.
    pub single: Vec<String>,
    /// The mistakes that must be corrected.
    pub wrong: Vec<String>,
}

/// The evidence for one rule, promise or ambiguity.
#[derive(Debug, Serialize)]
pub struct PromiseRow {
    /// Its identifier.
    pub id: String,
    /// Its title in the specification.
    pub title: String,
    /// The code that meets it, `file:line`.
    pub code: Vec<String>,
    /// The witnesses that cite the identifier and failed under a fault of it, by kind.
    pub witnesses: BTreeMap<&'static str, BTreeSet<String>>,
    /// The faults that violate it.
    pub faults: Vec<String>,
    /// The number of these faults that two kinds of witness caught.
    pub caught_twice: usize,
    /// `true` if all of these faults ran.
    pub is_whole: bool,
}

/// A fault with the witnesses that caught it.
#[derive(Debug, Serialize)]
pub struct FaultRow {
    /// Its name.
    pub name: String,
    /// The identifiers that it breaks.
    pub breaks: BTreeSet<String>,
    /// The witnesses that failed, by kind. Empty if the fault did not run.
    pub caught_by: BTreeMap<&'static str, BTreeSet<String>>,
    /// The kinds that ran out of time.
    pub out_of_time: BTreeSet<&'static str>,
    /// The reason why it had a build of its own, if it had one.
    pub own_build: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GapsFile {
    #[serde(default)]
    gap: Vec<GapReason>,
}

/// The reason for a gap. It states a fact about the code, and never the age of a result.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GapReason {
    ids: Vec<String>,
    because: String,
}

impl Table {
    /// Builds the table from the findings of a campaign. Without findings, it has only what the
    /// sources say.
    ///
    /// # Errors
    /// Returns an error if a file cannot be read. What is missing goes to [`wrong`](Self::wrong).
    pub fn build(
        tree: &Tree,
        faults: &[SeededFault],
        findings: &CampaignFindings,
    ) -> Result<Self, FaultsError> {
        let defined = citation::defined(tree)?;
        let known: BTreeSet<&str> = defined.iter().map(|(id, _)| &**id).collect();
        let mut wrong = Vec::new();
        for fault in faults {
            wrong.extend(unknown(&fault.name, &fault.breaks, &known));
        }
        let code = citation::code(tree)?;
        let rows = faults.iter().map(|fault| FaultRow::of(fault, findings));
        let fault_rows: Vec<FaultRow> = rows.collect();
        let shown = shown(tree, &fault_rows, &known, &mut wrong)?;
        let mut rows = Vec::new();
        for (id, title) in &defined {
            let of_it = || fault_rows.iter().filter(|fault| fault.breaks.contains(id));
            rows.push(PromiseRow {
                id: id.clone(),
                title: title.clone(),
                code: code.get(id).cloned().unwrap_or_default(),
                witnesses: shown.get(id).cloned().unwrap_or_default(),
                faults: of_it().map(|fault| fault.name.clone()).collect(),
                caught_twice: of_it().filter(|fault| fault.kinds() >= ENOUGH).count(),
                is_whole: of_it().all(|fault| !fault.caught_by.is_empty()),
            });
        }
        let ran = || fault_rows.iter().filter(|fault| !fault.caught_by.is_empty());
        wrong.extend(
            ran().filter(|it| it.kinds() == 0).map(|it| format!("nothing catches {}", it.name)),
        );
        // A guard has one case, so only one kind can catch its removal.
        let single = ran().filter(|it| it.kinds() == 1 && !it.breaks.is_empty());
        let single = single.map(|it| it.name.clone()).collect();
        let gaps = gaps(tree, &rows, &mut wrong)?;
        wrong.extend(missing(tree, &rows)?);
        Ok(Self { rows, faults: fault_rows, gaps, single, wrong })
    }

    /// Returns the table as text for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for row in self.rows.iter().filter(|row| !row.witnesses.is_empty()) {
            let kinds = row.witnesses.iter().map(|(kind, by)| format!("{kind} {}", by.len()));
            let kinds: Vec<String> = kinds.collect();
            let _ = writeln!(
                text,
                "{:<4} {:>3} faults, shown by {}",
                row.id,
                row.faults.len(),
                kinds.join(", ")
            );
        }
        for fault in self.faults.iter().filter(|it| self.single.contains(&it.name)) {
            let by = fault.caught_by.iter().find(|(_, by)| !by.is_empty());
            let Some((kind, by)) = by else { continue };
            let _ = writeln!(text, "only {kind} catches {}: {}", fault.name, few(by));
        }
        for fault in self.faults.iter().filter(|it| !it.out_of_time.is_empty()) {
            let kinds: Vec<&str> = fault.out_of_time.iter().copied().collect();
            let _ = writeln!(text, "{} ran out of time under {}", kinds.join(", "), fault.name);
        }
        text
    }

    /// Returns the table as a page of the book.
    #[must_use]
    pub fn page(&self) -> String {
        let mut text = String::from(HEAD);
        let ran = self.faults.iter().filter(|fault| !fault.caught_by.is_empty()).count();
        let all = self.faults.len();
        let _ = writeln!(text, "\nThis run seeded {ran} of {all} faults.\n");
        if !self.wrong.is_empty() {
            text.push_str("## What is missing\n\n");
            self.wrong.iter().for_each(|line| text.extend(["- ", line, "\n"]));
            text.push('\n');
        }
        text.push_str("## Rules and promises\n\n| | | faults | shown by |\n|---|---|--:|---|\n");
        for row in &self.rows {
            let by = row.witnesses.iter().map(|(kind, by)| format!("{kind}: {}", few(by)));
            let mut by: Vec<String> = by.collect();
            if row.witnesses.len() < ENOUGH && !row.is_whole {
                by.push("*not all of its faults ran*".to_owned());
            }
            by.extend(self.gaps.get(&row.id).cloned());
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} |",
                row.id,
                row.title,
                row.faults.len(),
                by.join("<br>")
            );
        }
        text.push_str("\n## Seeded faults\n\n| fault | breaks | caught by |\n|---|---|---|\n");
        for fault in &self.faults {
            let kinds = fault.caught_by.iter().filter(|(_, by)| !by.is_empty());
            let kinds = kinds.map(|(kind, by)| {
                if fault.out_of_time.contains(kind) {
                    format!("{kind} (out of time)")
                } else {
                    format!("{kind} {}", by.len())
                }
            });
            let kinds: Vec<String> = kinds.collect();
            let kinds = if fault.caught_by.is_empty() {
                "*did not run*".to_owned()
            } else {
                kinds.join(", ")
            };
            let breaks: Vec<&str> = fault.breaks.iter().map(String::as_str).collect();
            let _ = writeln!(text, "| `{}` | {} | {kinds} |", fault.name, breaks.join(" "));
        }
        text
    }

    /// Returns the table as JSON.
    ///
    /// # Panics
    /// Never: the table contains only text and numbers.
    #[must_use]
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("it is text") + "\n"
    }
}

const HEAD: &str = "\
# Promises and witnesses

This page lists the witnesses that show each rule, promise and ambiguity of `SPEC.md`. A witness is in a row only if it cites the
identifier and failed under a seeded fault that violates it ([Seeded faults](evidence.md)). `fuseline-faults run` makes this page.
";

impl FaultRow {
    fn of(fault: &SeededFault, findings: &CampaignFindings) -> Self {
        let caught = findings.faults.get(&fault.name).cloned().unwrap_or_default();
        Self {
            name: fault.name.clone(),
            breaks: fault.breaks.clone(),
            caught_by: caught.by,
            out_of_time: caught.out_of_time,
            own_build: caught.own_build,
        }
    }

    /// Returns the number of kinds that caught the fault.
    fn kinds(&self) -> usize {
        self.caught_by.values().filter(|by| !by.is_empty()).count()
    }
}

/// Returns the first of some witnesses, and how many more there are.
fn few(witnesses: &BTreeSet<String>) -> String {
    let first =
        witnesses.iter().take(3).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    match witnesses.len().checked_sub(3) {
        Some(more @ 1..) => format!("{first} and {more} more"),
        _ => first,
    }
}

/// The witnesses that cite an identifier and failed under a fault of it, by identifier and kind.
type Shown = BTreeMap<String, BTreeMap<&'static str, BTreeSet<String>>>;

fn shown(
    tree: &Tree,
    faults: &[FaultRow],
    known: &BTreeSet<&str>,
    wrong: &mut Vec<String>,
) -> Result<Shown, FaultsError> {
    let mut cited: BTreeMap<(&str, &str), BTreeSet<String>> = BTreeMap::new();
    let mut shown = Shown::new();
    for fault in faults {
        for (kind, witnesses) in &fault.caught_by {
            let Some(kind) = WitnessKind::find(kind) else { continue };
            // A witness that ends in a parenthesis is a program whose failed test is unknown.
            for witness in witnesses.iter().filter(|witness| !witness.ends_with(')')) {
                let of = match cited.entry((kind.name, witness)) {
                    std::collections::btree_map::Entry::Occupied(known) => known.into_mut(),
                    std::collections::btree_map::Entry::Vacant(new) => {
                        let ids = (kind.cites)(tree, witness)?;
                        wrong.extend(unknown(witness, &ids, known));
                        new.insert(ids)
                    }
                };
                for id in of.intersection(&fault.breaks) {
                    let by = shown.entry(id.clone()).or_default().entry(kind.name).or_default();
                    by.insert(witness.clone());
                }
            }
        }
    }
    Ok(shown)
}

/// Finds the identifiers that have too few faults or kinds, with the reason. An identifier without
/// a reason is an error, and so is a reason without need.
fn gaps(
    tree: &Tree,
    rows: &[PromiseRow],
    wrong: &mut Vec<String>,
) -> Result<BTreeMap<String, String>, FaultsError> {
    let parsed: Result<GapsFile, _> = toml::from_str(&tree.text(GAPS)?);
    let file = parsed.map_err(|e| FaultsError::content(&tree.path(GAPS), e.to_string()))?;
    let mut reasons: BTreeMap<String, String> = BTreeMap::new();
    for GapReason { ids, because } in file.gap {
        reasons.extend(ids.into_iter().map(|id| (id, because.clone())));
    }
    let mut gaps = BTreeMap::new();
    // An ambiguity is a reading of a rule, so it needs no evidence of its own.
    for row in rows.iter().filter(|row| !row.id.starts_with('A')) {
        let (twice, kinds) = (row.caught_twice, row.witnesses.len());
        let is_short = row.is_whole && (twice < ENOUGH || kinds < ENOUGH);
        match reasons.remove(&row.id) {
            None if is_short => wrong.push(format!(
                "{} has {kinds} kinds of witness, and two kinds catch {twice} of its {} faults; {GAPS} has no reason",
                row.id,
                row.faults.len()
            )),
            Some(because) if is_short || !row.is_whole => {
                drop(gaps.insert(row.id.clone(), because));
            }
            Some(_) => wrong.push(format!("{GAPS}: {} has enough faults and witnesses", row.id)),
            None => {}
        }
    }
    wrong.extend(reasons.into_keys().map(|id| format!("{GAPS}: {id} needs no witness of its own")));
    Ok(gaps)
}

/// The witness that must show an identifier, by identifier and kind.
pub type ExpectedWitnesses = BTreeMap<String, BTreeMap<String, String>>;

/// Returns the witnesses that must show each identifier.
///
/// # Errors
/// Returns an error if the file cannot be read.
pub fn expected(tree: &Tree) -> Result<ExpectedWitnesses, FaultsError> {
    let parsed = toml::from_str(&tree.text(WITNESSES)?);
    parsed.map_err(|error| FaultsError::content(&tree.path(WITNESSES), error.to_string()))
}

/// Returns the witnesses that should have shown an identifier but did not. It looks only at
/// identifiers whose faults all ran.
fn missing(tree: &Tree, rows: &[PromiseRow]) -> Result<Vec<String>, FaultsError> {
    let mut expected = expected(tree)?;
    let mut missing = Vec::new();
    for row in rows.iter().filter(|row| !row.id.starts_with('A')) {
        let named = expected.remove(&row.id).unwrap_or_default();
        if !row.is_whole || row.faults.is_empty() {
            continue;
        }
        let is_there =
            |kind: &str, name: &String| row.witnesses.get(kind).is_some_and(|by| by.contains(name));
        let gone: Vec<String> = named
            .iter()
            .filter(|(kind, name)| !is_there(kind, name))
            .map(|(kind, name)| format!("{kind} {name}"))
            .collect();
        if !gone.is_empty() {
            let left = named.len() - gone.len();
            missing.push(format!(
                "{}: {} of its witnesses in {WITNESSES} is left; missing or blind: {}",
                row.id,
                left,
                gone.join(", ")
            ));
        }
    }
    missing.extend(expected.into_keys().map(|id| format!("{WITNESSES}: SPEC.md defines no {id}")));
    Ok(missing)
}

fn unknown(place: &str, cited: &BTreeSet<String>, known: &BTreeSet<&str>) -> Vec<String> {
    let unknown = cited.iter().filter(|id| !known.contains(id.as_str()));
    unknown.map(|id| format!("{place} cites {id}, which SPEC.md does not define")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_kinds_must_catch_two_faults() -> Result<(), FaultsError> {
        let tree = Tree::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..").into());
        let row = |id: &str, caught_twice, faults: &[&str]| PromiseRow {
            id: id.into(),
            title: String::new(),
            code: Vec::new(),
            witnesses: ["model", "harness"].map(|kind| (kind, BTreeSet::new())).into(),
            faults: faults.iter().map(|&name| name.into()).collect(),
            caught_twice,
            is_whole: true,
        };
        let wrong = |caught_twice| {
            let mut wrong = Vec::new();
            gaps(&tree, &[row("P2", caught_twice, &["a", "b"]), row("T4", 0, &[])], &mut wrong)?;
            Ok(wrong)
        };
        assert_eq!(wrong(2)?, [""; 0]);
        assert_eq!(
            wrong(1)?,
            [
                "P2 has 2 kinds of witness, and two kinds catch 1 of its 2 faults; faults/gaps.toml has no reason"
            ]
        );
        Ok(())
    }
}
