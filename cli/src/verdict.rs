//! Verdicts of both judges, for people and for machines.

use std::io::{self, Write};
use std::time::Duration;

use anstyle::{AnsiColor, Style};
use fuseline_traces::{Verdict, Violation, observed};
use serde::Serialize;
use textwrap::Options;

use crate::exit::Exit;

/// The width of a rule's text, in columns.
const WIDTH: usize = 96;

pub(crate) const GOOD: Style = AnsiColor::Green.on_default().bold();
pub(crate) const BAD: Style = AnsiColor::Red.on_default().bold();

/// What one of the judges found.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(crate) enum Found {
    Strict(Verdict),
    Observed(observed::Verdict),
}

/// A verdict without its violations.
pub(crate) struct Summary<'a> {
    pub(crate) file: &'a str,
    pub(crate) conforms: bool,
    pub(crate) judged: u64,
    pub(crate) lines: u64,
    pub(crate) violations: u64,
}

/// One violation.
pub(crate) struct AnyViolation<'a> {
    pub(crate) line: u64,
    pub(crate) t: Option<u64>,
    /// The rule's identifier and its sentence.
    pub(crate) rule: (&'static str, &'static str),
    pub(crate) found: &'a str,
    pub(crate) expected: &'a str,
    pub(crate) late: Option<u64>,
    pub(crate) story: &'a [String],
}

impl Found {
    pub(crate) const fn exit(&self) -> Exit {
        if self.summary().conforms { Exit::Conforms } else { Exit::Differs }
    }

    /// Prints it, without the first violations, which were printed before.
    pub(crate) fn tell(&self, out: &mut impl Write, told: usize, json: bool) -> io::Result<()> {
        if json {
            serde_json::to_writer(&mut *out, self)?;
            return writeln!(out);
        }
        let summary = self.summary();
        summary.tell(out)?;
        let violations = self.violations();
        for violation in violations.iter().skip(told) {
            violation.tell(out, summary.file)?;
        }
        match summary.violations - violations.len() as u64 {
            0 => Ok(()),
            more => writeln!(out, "\n{} more not shown", count(more, "violation")),
        }
    }

    pub(crate) const fn summary(&self) -> Summary<'_> {
        match self {
            Self::Strict(Verdict { file, conforms, judged, lines, violations, more }) => Summary {
                file: file.as_str(),
                conforms: *conforms,
                judged: *judged,
                lines: *lines,
                violations: violations.len() as u64 + *more,
            },
            Self::Observed(observed::Verdict {
                file,
                conforms,
                judged,
                lines,
                violations,
                more,
            }) => Summary {
                file: file.as_str(),
                conforms: *conforms,
                judged: *judged,
                lines: *lines,
                violations: violations.len() as u64 + *more,
            },
        }
    }

    pub(crate) fn violations(&self) -> Vec<AnyViolation<'_>> {
        match self {
            Self::Strict(verdict) => verdict.violations.iter().map(AnyViolation::from).collect(),
            Self::Observed(verdict) => verdict.violations.iter().map(AnyViolation::from).collect(),
        }
    }
}

/// What `tell` prints, without colours.
pub(crate) fn plain(
    tell: impl FnOnce(&mut anstream::StripStream<Vec<u8>>) -> io::Result<()>,
) -> String {
    let mut out = anstream::StripStream::new(Vec::new());
    // Writing to memory does not fail.
    let _ = tell(&mut out);
    String::from_utf8_lossy(&out.into_inner()).trim().to_owned()
}

impl Summary<'_> {
    /// The line without colours.
    pub(crate) fn text(&self) -> String {
        plain(|out| self.tell(out))
    }

    /// One line.
    pub(crate) fn tell(&self, out: &mut impl Write) -> io::Result<()> {
        let Summary { file, conforms, judged, lines, violations } = *self;
        let word = match (conforms, violations) {
            (true, _) => format!("{GOOD}conforms{GOOD:#}"),
            (false, 0) => format!("{BAD}does not conform{BAD:#} (nothing to judge)"),
            (false, _) => {
                format!("{BAD}does not conform{BAD:#} ({})", count(violations, "violation"))
            }
        };
        let (judged, lines) = (count(judged, "timestamp"), count(lines, "line"));
        writeln!(out, "{file}: {word}, {judged} judged in {lines}")
    }
}

impl<'a> From<&'a Violation> for AnyViolation<'a> {
    fn from(violation: &'a Violation) -> Self {
        let Violation { line, t, rule, found, expected, story } = violation;
        let rule = (rule.id(), rule.sentence());
        Self { line: *line, t: *t, rule, found, expected, late: None, story }
    }
}

impl<'a> From<&'a observed::Violation> for AnyViolation<'a> {
    fn from(violation: &'a observed::Violation) -> Self {
        let observed::Violation { line, t, rule, found, expected, late, story } = violation;
        let rule = (rule.id(), rule.sentence());
        Self { line: *line, t: Some(*t), rule, found, expected, late: *late, story }
    }
}

impl AnyViolation<'_> {
    /// The lines without colours.
    pub(crate) fn text(&self, file: &str) -> String {
        plain(|out| self.tell(out, file))
    }

    /// A few lines, the first with the file.
    pub(crate) fn tell(&self, out: &mut impl Write, file: &str) -> io::Result<()> {
        let AnyViolation { line, t, rule: (id, sentence), found, expected, late, story } = *self;
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
}

fn count(count: u64, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}
