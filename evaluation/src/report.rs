//! Tables with notes, printed as text for a terminal and as Markdown.

use std::iter::once;

use anstyle::{AnsiColor, Style};

/// The number of columns of a terminal.
const WIDTH: usize = 80;

/// A table and the paragraphs around it.
#[derive(Default)]
pub(crate) struct Report {
    /// The paragraph above the table.
    pub(crate) title: Option<String>,
    /// The heading of each column.
    pub(crate) columns: Vec<Cell>,
    pub(crate) rows: Vec<Vec<Cell>>,
    /// The paragraphs below the table.
    pub(crate) notes: Vec<String>,
}

/// A cell: a text, and its colour on a terminal.
pub(crate) struct Cell {
    text: String,
    style: Style,
}

impl Cell {
    /// Returns a green cell if it is good, and a red one if not.
    pub(crate) fn rated(is_good: bool, text: impl Into<Self>) -> Self {
        let colour = if is_good { AnsiColor::Green } else { AnsiColor::Red };
        Self { style: colour.on_default(), ..text.into() }
    }
}

impl<T: ToString> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: text.to_string(), style: Style::new() }
    }
}

/// Returns reports as text. The colours are removed if the output is not a terminal.
pub(crate) fn text(reports: &[Report]) -> String {
    joined(reports, Report::text, wrapped)
}

/// Returns reports as Markdown.
pub(crate) fn markdown(reports: &[Report]) -> String {
    joined(reports, Report::markdown, str::to_owned)
}

fn joined(
    reports: &[Report],
    table: fn(&Report) -> String,
    paragraph: fn(&str) -> String,
) -> String {
    let blocks = reports.iter().flat_map(|report| {
        let title = report.title.iter().map(|title| paragraph(title));
        let notes = report.notes.iter().map(|note| paragraph(note));
        title.chain(once(table(report))).chain(notes)
    });
    blocks.collect::<Vec<_>>().join("\n\n") + "\n"
}

impl Report {
    fn lines(&self) -> impl Iterator<Item = &Vec<Cell>> {
        once(&self.columns).chain(&self.rows)
    }

    /// Returns the table with its first column set left and all others set right.
    fn text(&self) -> String {
        let width = |column: usize| {
            let cells = self.lines().filter_map(|cells| cells.get(column));
            cells.map(|cell| cell.text.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let line = |cells: &Vec<Cell>| {
            let padded = cells.iter().zip(&widths).enumerate();
            let padded = padded.map(|(column, (Cell { text, style }, &width))| match column {
                0 => format!("{style}{text:<width$}{style:#}"),
                _ => format!("{style}{text:>width$}{style:#}"),
            });
            padded.collect::<Vec<_>>().join("  ")
        };
        let mut lines: Vec<String> = self.lines().map(line).collect();
        let gaps = 2 * widths.len().saturating_sub(1);
        lines.insert(1, "─".repeat(widths.iter().sum::<usize>() + gaps));
        lines.join("\n")
    }

    fn markdown(&self) -> String {
        let line = |cells: &Vec<Cell>| {
            let cells = cells.iter().map(|cell| format!(" {} |", cell.text.replace('|', "\\|")));
            format!("|{}", cells.collect::<String>())
        };
        let mut lines: Vec<String> = self.lines().map(line).collect();
        let others = self.columns.len().saturating_sub(1);
        lines.insert(1, format!("|---|{}", "---:|".repeat(others)));
        lines.join("\n")
    }
}

/// Breaks a paragraph into lines that fit a terminal.
fn wrapped(text: &str) -> String {
    let (mut wrapped, mut width) = (String::new(), 0);
    for word in text.split(' ') {
        let length = word.chars().count();
        let is_first = width == 0;
        let is_full = width + 1 + length > WIDTH;
        if !is_first {
            wrapped.push(if is_full { '\n' } else { ' ' });
        }
        wrapped.push_str(word);
        width = if is_first || is_full { length } else { width + 1 + length };
    }
    wrapped
}
