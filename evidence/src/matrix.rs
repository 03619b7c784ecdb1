//! The matrix: what shows each rule, promise and ambiguity.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::citation;
use crate::error::EvidenceError;
use crate::fault::{self, SeededFault};
use crate::gap::{self, CoverageGap};
use crate::kind::{EvidenceKind, KINDS};
use crate::measure::MEASURES;
use crate::older;
use crate::record::KindRecord;
use crate::tree::Tree;

/// The whole matrix, with whatever is wrong with it.
#[derive(Clone, Debug, Serialize)]
pub struct Matrix {
    /// The compilers that built the witnesses, by kind.
    pub built_by: BTreeMap<&'static str, String>,
    /// How many witnesses of each kind ran.
    pub ran: BTreeMap<&'static str, usize>,
    /// A row an identifier, in the order of the specification.
    pub rows: Vec<MatrixRow>,
    /// The faults in their order, each with who caught it.
    pub faults: Vec<Seeded>,
    /// The measurements of the tests, in their order.
    pub measured: Vec<MeasurementRow>,
    /// The results that are older than their sources, by title, each with the reason.
    pub older: Vec<(&'static str, String)>,
    /// What must be put right; the matrix stands only if this is empty.
    pub wrong: Vec<String>,
}

/// What shows one rule, promise or ambiguity.
#[derive(Clone, Debug, Serialize)]
pub struct MatrixRow {
    /// Its identifier.
    pub id: String,
    /// How the specification heads it.
    pub title: String,
    /// The code that meets it, `file:line`.
    pub code: Vec<String>,
    /// By kind: the witnesses that cite it and went red under a fault of it.
    pub witnesses: BTreeMap<&'static str, BTreeSet<String>>,
    /// The faults that violate it.
    pub faults: Vec<String>,
}

/// One fault with who caught it.
#[derive(Clone, Debug, Serialize)]
pub struct Seeded {
    /// Its name.
    pub name: String,
    /// What it violates.
    pub breaks: BTreeSet<String>,
    /// By kind: the witnesses that went red.
    pub caught_by: BTreeMap<&'static str, BTreeSet<String>>,
}

/// One measurement with the explanations of its gaps.
#[derive(Clone, Debug, Serialize)]
pub struct MeasurementRow {
    /// What is measured.
    pub title: &'static str,
    /// What measured it.
    pub by: String,
    /// How many there are of each kind.
    pub counts: BTreeMap<String, u64>,
    /// The gaps, each with the reason why it may stay; an empty one is wrong.
    pub gaps: Vec<(CoverageGap, String)>,
}

impl Matrix {
    /// Builds it from the specification, the sources, the faults and the records.
    ///
    /// # Errors
    /// One of them cannot be read. What they lack is in [`wrong`](Self::wrong).
    pub fn build(tree: &Tree) -> Result<Self, EvidenceError> {
        let faults = fault::load(tree)?;
        let mut wrong = Vec::new();
        for fault in &faults {
            wrong.extend(fault.seed(&tree.text(&fault.file)?).err().map(|error| error.to_string()));
        }
        let mut stale = Vec::new();
        let mut records = Vec::new();
        for kind in KINDS {
            let Some(record) = there(tree, kind, &mut wrong)? else {
                stale.push((kind.name, kind.title));
                continue;
            };
            wrong.extend(faults.iter().filter(|fault| kind.must_catch(fault)).filter_map(
                |fault| {
                    let is_caught = record.caught(fault).is_some_and(|by| !by.is_empty());
                    (!is_caught).then(|| format!("{}: none catches {}", kind.title, fault.name))
                },
            ));
            if record.sources == kind.digest(tree)? {
                wrong.extend(missing(kind, &record, &faults));
            } else {
                stale.push((kind.name, kind.title));
            }
            records.push((kind, record));
        }
        let defined = citation::defined(tree)?;
        let known: BTreeSet<&str> = defined.iter().map(|(id, _)| &**id).collect();
        let code = citation::code(tree)?;
        for (id, places) in &code {
            wrong.extend(unknown(&places.join(", "), std::iter::once(id), &known));
        }
        for fault in &faults {
            wrong.extend(unknown(&format!("fault {}", fault.name), fault.breaks.iter(), &known));
        }

        let seeded: Vec<Seeded> = faults.iter().map(|fault| seeded(fault, &records)).collect();
        for fault in &seeded {
            if !fault.caught_by.is_empty() && fault.caught_by.values().all(BTreeSet::is_empty) {
                wrong.push(format!("nothing catches the fault {}", fault.name));
            }
        }
        let shown = shown(tree, &seeded, &known, &stale, &mut wrong)?;
        let mut rows = Vec::new();
        for (id, title) in &defined {
            let row = row(id, title, &code, &seeded, &shown);
            wrong.extend(lacks(&row, &records, &stale));
            rows.push(row);
        }
        let measured = measured(tree, &mut stale, &mut wrong)?;
        let (older, undeclared) = older::sort(&stale, older::declared(tree)?);
        wrong.extend(undeclared);
        Ok(Self {
            built_by: records.iter().map(|(kind, r)| (kind.name, r.rustc.clone())).collect(),
            ran: records.iter().map(|(kind, record)| (kind.name, record.held.len())).collect(),
            rows,
            faults: seeded,
            measured,
            older,
            wrong,
        })
    }
}

/// The record of a kind; says if it has no witness. None counts as older than its sources.
fn there(
    tree: &Tree,
    kind: &EvidenceKind,
    wrong: &mut Vec<String>,
) -> Result<Option<KindRecord>, EvidenceError> {
    let record = KindRecord::load(tree, kind)?;
    if record.as_ref().is_some_and(|record| record.held.is_empty()) {
        wrong.push(format!("{}: none ran", kind.title));
    }
    Ok(record)
}

/// The faults under which the witnesses of a kind did not run.
fn missing(kind: &EvidenceKind, record: &KindRecord, faults: &[SeededFault]) -> Option<String> {
    let concerned = faults.iter().filter(|fault| kind.is_run_here() && (kind.concerns)(fault));
    let missing = concerned.filter(|fault| record.caught(fault).is_none());
    let missing: Vec<&str> = missing.map(|fault| &*fault.name).collect();
    let reported = || format!("{}: not run under {}", kind.title, missing.join(", "));
    (!missing.is_empty()).then(reported)
}

/// The measurements; says what is stale, missing, not explained, or explained without need.
fn measured(
    tree: &Tree,
    stale: &mut Vec<(&'static str, &'static str)>,
    wrong: &mut Vec<String>,
) -> Result<Vec<MeasurementRow>, EvidenceError> {
    let reasons = gap::explanations(tree)?;
    let mut standings = Vec::new();
    for measure in MEASURES {
        let Some(record) = measure.load(tree)? else {
            wrong.push(format!("{}: there is no result", measure.title));
            continue;
        };
        let is_current = record.sources == measure.digest(tree)?;
        if !is_current {
            stale.push((measure.name, measure.title));
        }
        let explain = |gap: CoverageGap| {
            let because = reasons.iter().find(|reason| reason.gap == gap);
            (gap, because.map(|reason| reason.because.clone()).unwrap_or_default())
        };
        let gaps: Vec<_> = record.gaps.into_iter().map(explain).collect();
        // Gaps of an older result may be elsewhere since.
        let open = gaps.iter().filter(|(_, because)| because.is_empty() && is_current);
        wrong.extend(open.map(|(gap, _)| format!("{}: no reason for {gap}", measure.title)));
        let (by, counts) = (record.by, record.counts);
        standings.push(MeasurementRow { title: measure.title, by, counts, gaps });
    }
    let is_older = MEASURES.iter().any(|m| stale.iter().any(|(name, _)| *name == m.name));
    for reason in reasons.iter().filter(|_| !is_older) {
        if !standings.iter().flat_map(|standing| &standing.gaps).any(|(gap, _)| *gap == reason.gap)
        {
            wrong.push(format!("a gap that is none is explained: {}", reason.gap));
        }
    }
    Ok(standings)
}

fn seeded(fault: &SeededFault, records: &[(&EvidenceKind, KindRecord)]) -> Seeded {
    let caught = records
        .iter()
        .filter_map(|(kind, record)| Some((kind.name, record.caught(fault)?.clone())));
    Seeded { name: fault.name.clone(), breaks: fault.breaks.clone(), caught_by: caught.collect() }
}

/// Who shows what: a witness that cites an identifier and went red under a fault of it.
type WitnessIndex = BTreeMap<String, BTreeMap<&'static str, BTreeSet<String>>>;

fn shown(
    tree: &Tree,
    faults: &[Seeded],
    known: &BTreeSet<&str>,
    stale: &[(&str, &str)],
    wrong: &mut Vec<String>,
) -> Result<WitnessIndex, EvidenceError> {
    let mut cache: BTreeMap<(&str, &str), BTreeSet<String>> = BTreeMap::new();
    let mut shown = WitnessIndex::new();
    for fault in faults {
        for (name, witnesses) in &fault.caught_by {
            let Some(kind) = EvidenceKind::find(name) else { continue };
            for witness in witnesses {
                if !cache.contains_key(&(kind.name, &**witness)) {
                    // A witness of an older result may be gone since; then it shows nothing.
                    let is_older = stale.iter().any(|(name, _)| *name == kind.name);
                    let cited = match (kind.cites)(tree, witness) {
                        Err(_) if is_older => BTreeSet::new(),
                        cited => cited?,
                    };
                    wrong.extend(unknown(witness, cited.iter(), known));
                    cache.insert((kind.name, witness), cited);
                }
                let cited = &cache[&(kind.name, &**witness)];
                for id in cited.intersection(&fault.breaks) {
                    let of_id = shown.entry(id.clone()).or_default();
                    of_id.entry(kind.name).or_default().insert(witness.clone());
                }
            }
        }
    }
    Ok(shown)
}

fn row(
    id: &str,
    title: &str,
    code: &BTreeMap<String, Vec<String>>,
    faults: &[Seeded],
    shown: &WitnessIndex,
) -> MatrixRow {
    let of_it = faults.iter().filter(|fault| fault.breaks.contains(id));
    MatrixRow {
        id: id.to_owned(),
        title: title.to_owned(),
        code: code.get(id).cloned().unwrap_or_default(),
        witnesses: shown.get(id).cloned().unwrap_or_default(),
        faults: of_it.map(|fault| fault.name.clone()).collect(),
    }
}

/// The kinds of what is promised of adapters.
const AROUND: [&str; 7] =
    ["operator", "grpc", "recorder", "simulation", "ros2", "command", "python"];

/// What a rule or promise must have and has not, by the results that are not older. An ambiguity is a reading of one and
/// needs nothing of its own.
fn lacks(
    row: &MatrixRow,
    records: &[(&EvidenceKind, KindRecord)],
    stale: &[(&str, &str)],
) -> Vec<String> {
    let mut lacks = Vec::new();
    if row.id.starts_with('A') {
        return lacks;
    }
    if row.code.is_empty() {
        lacks.push(format!("{}: no code cites it", row.id));
    }
    // What is promised around the machine needs one witness, of whatever kind, unless it says what is not guaranteed.
    let around = match row.id.split_at(1) {
        ("T", "4") => &[][..],
        ("T", _) => &["policy"][..],
        ("D", _) => &AROUND[..],
        ("E", _) => &["pipeline"][..],
        ("J", _) => &["judge"][..],
        _ => &[][..],
    };
    let is_stale = |name: &str| stale.iter().any(|(older, _)| *older == name);
    if !around.is_empty() && !around.iter().any(|name| is_stale(name)) && row.witnesses.is_empty() {
        lacks.push(format!("{}: no witness that went red cites it", row.id));
    }
    let current = records.iter().filter(|(kind, _)| !is_stale(kind.name));
    for (kind, _) in current.filter(|(kind, _)| (kind.applies)(&row.id)) {
        if row.witnesses.get(kind.name).is_none_or(BTreeSet::is_empty) {
            lacks.push(format!("{}: none of the {} that went red cites it", row.id, kind.title));
        }
    }
    lacks
}

fn unknown<'a>(
    location: &str,
    cited: impl Iterator<Item = &'a String>,
    known: &BTreeSet<&str>,
) -> Vec<String> {
    cited
        .filter(|id| !known.contains(id.as_str()))
        .map(|id| format!("{location} cites {id}, which SPEC.md does not define"))
        .collect()
}
