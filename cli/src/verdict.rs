//! Verdicts of both judges, for people and for machines.

use std::io::{self, Write};
use std::time::Duration;

use anstyle::{AnsiColor, Style};
use fuseline_report::{AnyViolation, Findings, VerdictSummary};
use textwrap::Options;

use crate::exit::Exit;

/// The width of a rule's text, in columns.
const WIDTH: usize = 96;

pub(crate) const GOOD: Style = AnsiColor::Green.on_default().bold();
pub(crate) const BAD: Style = AnsiColor::Red.on_default().bold();

pub(crate) const fn exit(found: &Findings) -> Exit {
    if found.summary().conforms { Exit::Conforms } else { Exit::Differs }
}

/// Prints a verdict, without the first violations, which were printed before.
pub(crate) fn print_report(
    found: &Findings,
    out: &mut impl Write,
    reported: usize,
    json: bool,
) -> io::Result<()> {
    if json {
        serde_json::to_writer(&mut *out, found)?;
        return writeln!(out);
    }
    let summary = found.summary();
    print_summary(&summary, out)?;
    let violations = found.violations();
    for violation in violations.iter().skip(reported) {
        print_violation(violation, summary.file, out)?;
    }
    match summary.violations - violations.len() as u64 {
        0 => Ok(()),
        more => writeln!(out, "\n{} more not shown", count(more, "violation")),
    }
}

pub(crate) fn print_summary(summary: &VerdictSummary<'_>, out: &mut impl Write) -> io::Result<()> {
    let VerdictSummary { file, conforms, judged, unfinished, lines, violations } = *summary;
    let word = match (conforms, violations) {
        (true, _) => format!("{GOOD}conforms{GOOD:#}"),
        (false, 0) => format!("{BAD}does not conform{BAD:#} (nothing to judge)"),
        (false, _) => {
            format!("{BAD}does not conform{BAD:#} ({})", count(violations, "violation"))
        }
    };
    let (judged, lines) = (count(judged, "timestamp"), count(lines, "line"));
    let unfinished = match unfinished {
        None | Some(0) => String::new(),
        Some(unfinished) => format!(", {unfinished} unfinished"),
    };
    writeln!(out, "{file}: {word}, {judged} judged in {lines}{unfinished}")
}

/// What `print_report` prints, without colours.
pub(crate) fn plain(
    print_report: impl FnOnce(&mut anstream::StripStream<Vec<u8>>) -> io::Result<()>,
) -> String {
    let mut out = anstream::StripStream::new(Vec::new());
    // Writing to memory does not fail.
    let _ = print_report(&mut out);
    String::from_utf8_lossy(&out.into_inner()).trim().to_owned()
}

/// A few lines, the first with the file.
pub(crate) fn print_violation(
    violation: &AnyViolation<'_>,
    file: &str,
    out: &mut impl Write,
) -> io::Result<()> {
    let AnyViolation { line, t, rule: (id, sentence), found, expected, late, story } = *violation;
    let t = t.map_or_else(String::new, |t| format!("timestamp {t} "));
    writeln!(out, "\n{file}:{line}: {t}{BAD}breaks {id}{BAD:#}")?;
    let options =
        Options::new(WIDTH).initial_indent("  rule      ").subsequent_indent("            ");
    writeln!(out, "{}", textwrap::fill(sentence, options))?;
    writeln!(out, "  found     {found}")?;
    writeln!(out, "  expected  {expected}")?;
    if let Some(late) = late {
        let late = humantime::format_duration(Duration::from_nanos(late));
        writeln!(out, "  late by   {late}")?;
    }
    for (i, line) in story.iter().enumerate() {
        writeln!(out, "  {:<9} {line}", if i == 0 { "so far" } else { "" })?;
    }
    Ok(())
}

fn count(count: u64, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}
