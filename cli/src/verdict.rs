//! Verdicts of both judges, for people and for machines.

use std::io::{self, Write};
use std::time::Duration;

use anstyle::{AnsiColor, Style};
use fuseline_traces::{Verdict, Violation};
use textwrap::Options;

use crate::exit::Exit;
use crate::table::counted;

/// The width of a rule's text, in columns.
const WIDTH: usize = 96;

pub(crate) const GOOD: Style = AnsiColor::Green.on_default().bold();
pub(crate) const BAD: Style = AnsiColor::Red.on_default().bold();
const DOUBT: Style = AnsiColor::Yellow.on_default().bold();

pub(crate) fn exit(found: &Verdict) -> Exit {
    match (found.conforms, found.broken()) {
        (true, _) => Exit::Conforms,
        (false, 0) => Exit::Doubt,
        (false, _) => Exit::Differs,
    }
}

/// Prints a verdict, without the first violations, which were printed before.
pub(crate) fn print_report(
    found: &Verdict,
    out: &mut impl Write,
    reported: usize,
    json: bool,
) -> io::Result<()> {
    if json {
        serde_json::to_writer(&mut *out, found)?;
        return writeln!(out);
    }
    print_summary(found, out)?;
    print_doubts(found, out)?;
    for violation in found.violations.iter().skip(reported) {
        print_violation(violation, &found.file, out)?;
    }
    match found.more {
        0 => Ok(()),
        more => writeln!(out, "\n{} more not shown", counted(more, "violation")),
    }
}

/// The verdict in a line.
pub(crate) fn print_summary(found: &Verdict, out: &mut impl Write) -> io::Result<()> {
    let Verdict { file, judged, lines, doubts, .. } = found;
    let style = match exit(found) {
        Exit::Conforms => GOOD,
        Exit::Doubt => DOUBT,
        Exit::Differs | Exit::BadInput => BAD,
    };
    let word = found.in_short();
    let broken = match found.broken() {
        0 => String::new(),
        violations => format!(" ({})", counted(violations, "violation")),
    };
    let open: Vec<_> = doubts.iter().filter(|doubt| !doubt.accepted).collect();
    let open: Vec<_> = open.iter().map(|it| format!("{} {}", it.count, it.kind)).collect();
    let in_doubt =
        if open.is_empty() { String::new() } else { format!("; in doubt: {}", open.join(", ")) };
    let (judged, lines) = (counted(*judged, "timestamp"), counted(*lines, "line"));
    writeln!(out, "{file}: {style}{word}{style:#}{broken}, {judged} judged in {lines}{in_doubt}")
}

/// The likely cause of the violations, and what is in doubt, a line each.
pub(crate) fn print_doubts(found: &Verdict, out: &mut impl Write) -> io::Result<()> {
    if let Some(cause) = &found.cause {
        writeln!(out, "  likely    {cause}")?;
    }
    for doubt in &found.doubts {
        let lead = if doubt.accepted { "accepted" } else { "in doubt" };
        writeln!(out, "  {lead}  {doubt}")?;
    }
    Ok(())
}

/// Returns the output of `print_report`, without colours.
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
    violation: &Violation,
    file: &str,
    out: &mut impl Write,
) -> io::Result<()> {
    let Violation { line, t, rule, found, expected, late, story } = violation;
    let t = t.map_or_else(String::new, |t| format!("timestamp {t} "));
    writeln!(out, "\n{file}:{line}: {t}{BAD}breaks {rule}{BAD:#}")?;
    let options =
        Options::new(WIDTH).initial_indent("  rule      ").subsequent_indent("            ");
    writeln!(out, "{}", textwrap::fill(rule.sentence(), options))?;
    writeln!(out, "  found     {found}")?;
    writeln!(out, "  expected  {expected}")?;
    if let Some(late) = late {
        let late = humantime::format_duration(Duration::from_nanos(*late));
        writeln!(out, "  late by   {late}")?;
    }
    for (i, line) in story.iter().enumerate() {
        writeln!(out, "  {:<9} {line}", if i == 0 { "lines" } else { "" })?;
    }
    Ok(())
}
