//! The matrix as files to read: Markdown, CSV and JSON.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use crate::error::Error;
use crate::kind::{KINDS, Kind};
use crate::matrix::{Matrix, MeasurementRow, Row};
use crate::tree::Tree;

/// One file made of the matrix.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct GeneratedFile {
    /// Its name from the root.
    pub name: &'static str,
    /// What it says.
    pub text: String,
}

impl GeneratedFile {
    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn save(&self, tree: &Tree) -> Result<(), Error> {
        crate::record::write_whole(&tree.path(self.name), &self.text)
    }

    /// Whether the file in this tree says the same.
    #[must_use]
    pub fn is_current(&self, tree: &Tree) -> bool {
        std::fs::read_to_string(tree.path(self.name)).is_ok_and(|text| text == self.text)
    }
}

/// All files made of the matrix.
///
/// # Errors
/// Never in practice: the matrix consists of text.
pub fn artefacts(matrix: &Matrix) -> Result<[GeneratedFile; 3], Error> {
    let json = "evidence/evidence.json";
    let mut text = serde_json::to_string_pretty(matrix)
        .map_err(|error| Error::content(json.as_ref(), error.to_string()))?;
    text.push('\n');
    Ok([
        GeneratedFile { name: "EVIDENCE.md", text: markdown(matrix) },
        GeneratedFile { name: "evidence/evidence.csv", text: csv(matrix)? },
        GeneratedFile { name: json, text },
    ])
}

const HEAD: &str = "\
# Evidence

What shows each rule, promise and ambiguity of `SPEC.md`, by result: a witness stands in its row only if it cites
the identifier and went red under a seeded fault that violates it. The faults are in `tests/faults.toml` and
`tests/faults-around.toml`, the results in `evidence/results/`. The obligations of the rules have faults of their own, in
`proofs/rules/faults.toml`. This file is made by `cargo run -p fuseline-evidence -- matrix`; do not edit it.
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
        text.push_str("\n## Older than their sources\n\nTo be taken again; what they say is of an earlier state.\n\n");
        for (title, because) in &matrix.older {
            let _ = writeln!(text, "- {title}: {because}");
        }
    }
    let _ = writeln!(text, "\n## What the proofs show of which code\n\n{}", matrix.proved);
    text.push_str("\n## In short\n\n");
    overview(matrix, &mut text);
    for (family, title) in [
        ('F', "Rules"),
        ('P', "Promises"),
        ('A', "Ambiguities"),
        ('T', "Promises of deadlines"),
        ('D', "Promises of adapters"),
        ('J', "Judging"),
    ] {
        let _ = writeln!(text, "\n## {title}");
        for row in matrix.rows.iter().filter(|row| row.id.starts_with(family)) {
            section(matrix, row, &mut text);
        }
    }
    text.push_str(
        "\n## Seeded faults\n\nHow many witnesses of each kind each fault turned red.\n\n",
    );
    faults(matrix, &mut text);
    matrix.measured.iter().for_each(|standing| measurement(standing, &mut text));
    text
}

/// The kinds that have results.
fn ran(matrix: &Matrix) -> impl Iterator<Item = &'static Kind> {
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

fn section(matrix: &Matrix, row: &Row, text: &mut String) {
    let _ = writeln!(text, "\n### {}: {}\n", row.id, row.title);
    let mut line = |title: &str, items: Vec<String>| {
        if !items.is_empty() {
            let _ = writeln!(text, "- {title}: {}", items.join(", "));
        }
    };
    line("code", places(&row.code));
    for kind in ran(matrix) {
        let witnesses = row.witnesses.get(kind.name).into_iter().flatten();
        line(kind.title, witnesses.map(|name| format!("`{name}`")).collect());
    }
    line("faults", row.faults.iter().map(|name| format!("`{name}`")).collect());
}

/// `file:1, 2` for `file:1` and `file:2`.
fn places(code: &[String]) -> Vec<String> {
    let mut files: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for place in code {
        let (file, line) = place.rsplit_once(':').unwrap_or((place, ""));
        files.entry(file).or_default().push(line);
    }
    files.into_iter().map(|(file, lines)| format!("`{file}:{}`", lines.join(","))).collect()
}

fn faults(matrix: &Matrix, text: &mut String) {
    let ran = |matrix| ran(matrix).filter(|kind| !kind.has_own_faults());
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
        let (line, what) = (cell(&gap.line), cell(&gap.what));
        let _ = writeln!(text, "| `{}`: `{line}` | {what} | {} |", gap.file, cell(because));
    }
}

fn count(witnesses: &BTreeMap<&'static str, BTreeSet<String>>, kind: &Kind) -> usize {
    witnesses.get(kind.name).map_or(0, BTreeSet::len)
}

/// A number, or nothing for none.
fn number(count: usize) -> String {
    if count == 0 { String::new() } else { count.to_string() }
}

/// A line for each thing that stands in a row of the matrix.
fn csv(matrix: &Matrix) -> Result<String, Error> {
    let name = "evidence/evidence.csv".as_ref();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |cells: [&str; 3]| {
        writer.write_record(cells).map_err(|error| Error::content(name, error.to_string()))
    };
    write(["id", "kind", "witness"])?;
    for row in &matrix.rows {
        for place in &row.code {
            write([&row.id, "code", place])?;
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
    let bytes =
        writer.into_inner().map_err(|error| Error::content(name, error.error().to_string()))?;
    String::from_utf8(bytes).map_err(|error| Error::content(name, error.to_string()))
}
