//! Writes verdicts for people, for scripts, and as files.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

use anstyle::{AnsiColor, Style};
use comfy_table::{CellAlignment, LineStyle, Table, TableStyle};
use fuseline_models::{Claim, Exploration, Size, WORLDS};
use serde::Serialize;
use tempfile::NamedTempFile;

use crate::error::ModelsError;

const BAD: Style = AnsiColor::Red.on_default().bold();
const STYLE: TableStyle =
    TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// A verdict for scripts.
#[derive(Serialize)]
struct JsonVerdict<'a> {
    config: &'a str,
    holds: bool,
    states: usize,
    expected_states: usize,
    depth: usize,
    seconds: f64,
    claims: usize,
    sightings: usize,
    /// The names of the broken properties, each with the lines of its counterexample.
    violations: BTreeMap<&'a str, Vec<&'a str>>,
    /// The names of the sightings that no state showed.
    unmet: Vec<&'a str>,
}

/// Returns the verdict on one line.
pub(crate) fn line(verdict: &Exploration) -> String {
    let Exploration { config, states, took, .. } = verdict;
    let word = word(verdict);
    format!("{}: {word}, {states} states in {:.1} s", config.name, took.as_secs_f64())
}

/// Writes a table of verdicts, then everything that does not hold.
pub(crate) fn write_table(
    out: &mut impl Write,
    verdicts: &[Exploration],
) -> Result<(), ModelsError> {
    let mut table = Table::new();
    table.load_style(STYLE);
    table.set_header(["config", "states", "depth", "seconds", "claims", "sightings", ""]);
    for verdict in verdicts {
        table.add_row([
            verdict.config.name.to_owned(),
            verdict.states.to_string(),
            verdict.depth.to_string(),
            format!("{:.1}", verdict.took.as_secs_f64()),
            Claim::ALL.len().to_string(),
            verdict.config.sightings().count().to_string(),
            word(verdict).to_owned(),
        ]);
    }
    let numbers = table.column_iter_mut().skip(1).take(5);
    numbers.for_each(|column| column.set_cell_alignment(CellAlignment::Right));
    writeln!(out, "{table}")?;
    let states: usize = verdicts.iter().map(|verdict| verdict.states).sum();
    let seconds: f64 = verdicts.iter().map(|verdict| verdict.took.as_secs_f64()).sum();
    writeln!(out, "{states} states in {seconds:.1} s")?;
    verdicts.iter().try_for_each(|verdict| print_faults(out, verdict)).map_err(ModelsError::Output)
}

/// Writes a JSON object on one line.
pub(crate) fn json(out: &mut impl Write, verdict: &Exploration) -> Result<(), ModelsError> {
    let violations = verdict.violations.iter();
    let summary = JsonVerdict {
        config: verdict.config.name,
        holds: verdict.holds(),
        states: verdict.states,
        expected_states: verdict.config.states,
        depth: verdict.depth,
        seconds: verdict.took.as_secs_f64(),
        claims: Claim::ALL.len(),
        sightings: verdict.config.sightings().count(),
        violations: violations.map(|run| (run.claim.name(), run.trace.lines().collect())).collect(),
        unmet: verdict.unmet.iter().map(|sighting| sighting.name()).collect(),
    };
    serde_json::to_writer(&mut *out, &summary).map_err(io::Error::from)?;
    Ok(writeln!(out)?)
}

/// Writes the counterexamples. Each file is written whole or not at all.
pub(crate) fn save(folder: &Path, verdict: &Exploration) -> Result<(), ModelsError> {
    for run in &verdict.violations {
        let id = run.claim.name().split(' ').next().unwrap_or_default().to_lowercase();
        let path = folder.join(format!("{}.{id}.jsonl", verdict.config.name));
        write_whole(folder, &path, &run.trace)
            .map_err(|source| ModelsError::Save { name: path.display().to_string(), source })?;
    }
    Ok(())
}

/// Writes the configurations.
pub(crate) fn list(out: &mut impl Write) -> Result<(), ModelsError> {
    let mut table = Table::new();
    table.load_style(STYLE);
    table.set_header([
        "config",
        "when",
        "rule",
        "clouds",
        "timestamps",
        "window",
        "instants",
        "states",
    ]);
    for config in WORLDS {
        let when = match config.size {
            Size::Quick => "quick",
            Size::Standard => "standard",
            Size::Large => "large",
        };
        table.add_row([
            config.name.to_owned(),
            when.to_owned(),
            config.commit.to_string(),
            config.clouds.len().to_string(),
            config.timestamps.len().to_string(),
            config.window.to_string(),
            config.clock.len().to_string(),
            config.states.to_string(),
        ]);
    }
    let numbers = table.column_iter_mut().skip(3);
    numbers.for_each(|column| column.set_cell_alignment(CellAlignment::Right));
    Ok(writeln!(out, "{table}")?)
}

fn print_faults(out: &mut impl Write, verdict: &Exploration) -> io::Result<()> {
    let name = verdict.config.name;
    for run in &verdict.violations {
        writeln!(out, "\n{name}: {BAD}broken: {}{BAD:#}", run.claim.name())?;
        write!(out, "{}", run.trace)?;
    }
    for sighting in &verdict.unmet {
        writeln!(out, "{name}: {BAD}not met: {}{BAD:#}", sighting.name())?;
    }
    if verdict.violations.is_empty() && verdict.states != verdict.config.states {
        let (states, expected) = (verdict.states, verdict.config.states);
        writeln!(
            out,
            "\n{name}: {BAD}{states} states instead of {expected}{BAD:#}: the machine or its \
             environment changed"
        )?;
    }
    Ok(())
}

fn word(verdict: &Exploration) -> &'static str {
    if verdict.holds() { "holds" } else { "does not hold" }
}

fn write_whole(folder: &Path, path: &Path, text: &str) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut file = NamedTempFile::new_in(folder)?;
    file.write_all(text.as_bytes())?;
    file.persist(path)?;
    Ok(())
}
