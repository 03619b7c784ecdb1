//! The matrix as files to read: Markdown, CSV and JSON.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::error::EvidenceError;
use crate::kind::{EvidenceKind, KINDS};
use crate::matrix::{Matrix, MatrixRow, MeasurementRow};

/// One file made of the matrix.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct GeneratedFile {
    /// The name of the file.
    pub name: &'static str,
    /// Its content.
    pub text: String,
}

impl GeneratedFile {
    /// Writes it below cargo's target folder, whole or not at all; returns where it is.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn save(&self, target: &Path) -> Result<PathBuf, EvidenceError> {
        let path = target.join("evidence").join(self.name);
        crate::record::write_whole(&path, &self.text)?;
        Ok(path)
    }
}

/// All files made of the matrix: a chapter of the book, and the same as CSV and JSON.
///
/// They are built into the target folder and are not tracked.
///
/// # Errors
/// Never in practice: the matrix consists of text.
pub fn artefacts(matrix: &Matrix) -> Result<[GeneratedFile; 3], EvidenceError> {
    let mut json = serde_json::to_string_pretty(matrix)
        .map_err(|error| EvidenceError::content(JSON.as_ref(), error.to_string()))?;
    json.push('\n');
    Ok([
        GeneratedFile { name: CHAPTER, text: markdown(matrix) },
        GeneratedFile { name: CSV, text: csv(matrix)? },
        GeneratedFile { name: JSON, text: json },
    ])
}

const CHAPTER: &str = "matrix.md";
const CSV: &str = "evidence.csv";
const JSON: &str = "evidence.json";

const HEAD: &str = "\
# The matrix

Which witnesses show each rule, promise and ambiguity of `SPEC.md`, by the results of the last campaigns. A witness is in a row
only if it cites the identifier and failed under a seeded fault that violates it; [Seeded faults and the matrix](evidence.md)
explains how this is measured. The command `cargo run -p fuseline-evidence -- matrix` writes this chapter; do not edit it.
";

fn markdown(matrix: &Matrix) -> String {
    let mut text = String::from(HEAD);
    text.push('\n');
    for kind in ran(matrix) {
        let _ = writeln!(
            text,
            "- {}: {} ran and held without a fault, built by {}",
            kind.title, matrix.ran[kind.name], matrix.built_by[kind.name]
        );
    }
    if !matrix.wrong.is_empty() {
        text.push_str("\n## What is missing\n\n");
        matrix.wrong.iter().for_each(|line| text.extend(["- ", line, "\n"]));
    }
    if !matrix.older.is_empty() {
        text.push_str(
            "\n## Older than their sources\n\nThese results are of an earlier state of the sources and are to be measured again.\n\n",
        );
        for (title, because) in &matrix.older {
            let _ = writeln!(text, "- {title}: {because}");
        }
    }
    text.push_str(
        "\n## What the proofs are about\n\n[Proofs](proofs.md) has the code that each proof covers, the sizes for which it holds, and what \
         it trusts.\n\n## In short\n\nHow many places of the code cite each identifier, how many witnesses of each kind show it, and \
         how many seeded faults violate it.\n\n",
    );
    overview(matrix, &mut text);
    for (family, title) in [
        ('F', "Rules"),
        ('P', "Promises"),
        ('A', "Ambiguities"),
        ('T', "Promises of deadlines"),
        ('D', "Promises of adapters"),
        ('E', "Promises of pipelines"),
        ('J', "Judging"),
    ] {
        let _ = writeln!(text, "\n## {title}");
        for row in matrix.rows.iter().filter(|row| row.id.starts_with(family)) {
            section(matrix, row, &mut text);
        }
    }
    text.push_str(
        "\n## Seeded faults\n\nHow many witnesses of each kind failed under each fault.\n\n",
    );
    faults(matrix, &mut text);
    matrix.measured.iter().for_each(|standing| measurement(standing, &mut text));
    text
}

/// The kinds that have results.
fn ran(matrix: &Matrix) -> impl Iterator<Item = &'static EvidenceKind> {
    KINDS.iter().filter(|kind| matrix.ran.contains_key(kind.name))
}

fn overview(matrix: &Matrix, text: &mut String) {
    let titles: Vec<&str> = ran(matrix).map(|kind| kind.title).collect();
    let _ = writeln!(text, "| | | code | {} | faults |", titles.join(" | "));
    let _ = writeln!(text, "|---|---|{}", "--:|".repeat(titles.len() + 2));
    for row in &matrix.rows {
        let counts = ran(matrix).map(|kind| count(&row.witnesses, kind));
        let counts: Vec<String> = counts.map(number).collect();
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} |",
            row.id,
            row.title,
            number(row.code.len()),
            counts.join(" | "),
            number(row.faults.len())
        );
    }
}

fn section(matrix: &Matrix, row: &MatrixRow, text: &mut String) {
    let _ = writeln!(text, "\n### {}: {}\n", row.id, row.title);
    let mut line = |title: &str, items: Vec<String>| {
        if !items.is_empty() {
            let _ = writeln!(text, "- {title}: {}", items.join(", "));
        }
    };
    line("code", locations(&row.code));
    for kind in ran(matrix) {
        let witnesses = row.witnesses.get(kind.name).into_iter().flatten();
        line(kind.title, witnesses.map(|name| format!("`{name}`")).collect());
    }
    line("faults", row.faults.iter().map(|name| format!("`{name}`")).collect());
}

/// `file:1, 2` for `file:1` and `file:2`.
fn locations(code: &[String]) -> Vec<String> {
    let mut files: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for location in code {
        let (file, line) = location.rsplit_once(':').unwrap_or((location, ""));
        files.entry(file).or_default().push(line);
    }
    files.into_iter().map(|(file, lines)| format!("`{file}:{}`", lines.join(","))).collect()
}

fn faults(matrix: &Matrix, text: &mut String) {
    let titles: Vec<&str> = ran(matrix).map(|kind| kind.title).collect();
    let _ = writeln!(text, "| fault | violates | {} |", titles.join(" | "));
    let _ = writeln!(text, "|---|---|{}", "--:|".repeat(titles.len()));
    for fault in &matrix.faults {
        let breaks: Vec<&str> = fault.breaks.iter().map(String::as_str).collect();
        let counts = ran(matrix).map(|kind| count(&fault.caught_by, kind));
        let counts: Vec<String> = counts.map(number).collect();
        let breaks = breaks.join(" ");
        let _ = writeln!(text, "| `{}` | {breaks} | {} |", fault.name, counts.join(" | "));
    }
}

fn measurement(standing: &MeasurementRow, text: &mut String) {
    let counts: Vec<String> =
        standing.counts.iter().map(|(kind, count)| format!("{kind} {count}")).collect();
    let title = standing.title;
    let _ =
        writeln!(text, "\n## Tests measured: {title}\n\n{}: {}.", standing.by, counts.join(", "));
    if standing.gaps.is_empty() {
        return;
    }
    let _ = writeln!(text, "\n| where | what | why it may stay |\n|---|---|---|");
    for (gap, because) in &standing.gaps {
        let cell = |text: &str| text.replace('|', "\\|");
        // Types with parameters are no HTML.
        let (line, what) = (cell(&gap.line), cell(&gap.what).replace('<', "\\<"));
        let _ = writeln!(text, "| `{}`: `{line}` | {what} | {} |", gap.file, cell(because));
    }
}

fn count(witnesses: &BTreeMap<&'static str, BTreeSet<String>>, kind: &EvidenceKind) -> usize {
    witnesses.get(kind.name).map_or(0, BTreeSet::len)
}

/// A number, or nothing for none.
fn number(count: usize) -> String {
    if count == 0 { String::new() } else { count.to_string() }
}

/// A line for each thing that stands in a row of the matrix.
fn csv(matrix: &Matrix) -> Result<String, EvidenceError> {
    let name = CSV.as_ref();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |cells: [&str; 3]| {
        writer.write_record(cells).map_err(|error| EvidenceError::content(name, error.to_string()))
    };
    write(["id", "kind", "witness"])?;
    for row in &matrix.rows {
        for location in &row.code {
            write([&row.id, "code", location])?;
        }
        for (kind, witnesses) in &row.witnesses {
            for witness in witnesses {
                write([&row.id, kind, witness])?;
            }
        }
        for fault in &row.faults {
            write([&row.id, "fault", fault])?;
        }
    }
    let bytes = writer
        .into_inner()
        .map_err(|error| EvidenceError::content(name, error.error().to_string()))?;
    String::from_utf8(bytes).map_err(|error| EvidenceError::content(name, error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::CoverageGap;
    use crate::tree::Tree;

    #[test]
    fn what_is_made_is_written_below_the_target_folder_alone() -> Result<(), EvidenceError> {
        let root =
            tempfile::tempdir().map_err(EvidenceError::file("a temporary folder".as_ref()))?;
        let tree = Tree::new(root.path().to_owned());
        let gap = CoverageGap {
            file: "core/src/clouds.rs".to_owned(),
            line: "a | b".to_owned(),
            what: "replace | with ^ in Clouds<CLOUDS>::insert".to_owned(),
        };
        let matrix = Matrix {
            built_by: BTreeMap::new(),
            ran: BTreeMap::new(),
            rows: Vec::new(),
            faults: Vec::new(),
            measured: vec![MeasurementRow {
                title: "mutants of the core",
                by: "cargo-mutants".to_owned(),
                counts: BTreeMap::new(),
                gaps: vec![(gap, "The two are equal.".to_owned())],
            }],
            older: vec![("races under loom", "the window moved".to_owned())],
            wrong: Vec::new(),
        };
        for artefact in artefacts(&matrix)? {
            artefact.save(root.path())?;
        }
        let written = ["evidence.csv", "evidence.json", "matrix.md"];
        assert_eq!(tree.files(&["."])?, written.map(|name| format!("evidence/{name}")));
        let chapter = tree.text("evidence/matrix.md")?;
        assert!(chapter.contains("- races under loom: the window moved\n"));
        assert!(
            chapter.contains(r"`a \| b` | replace \| with ^ in Clouds\<CLOUDS>::insert | The two")
        );
        Ok(())
    }
}
