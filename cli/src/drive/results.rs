//! The report for other tools.

use crate::drive::report::{DriveReport, ReportedFinding};
use crate::exit::Exit;
use crate::results::{Level, Problem, Subject, text_of};

/// The rules that a wrong answer breaks.
const PROTOCOL: (&str, &str) = (
    "protocol",
    "The command answers each line with its decisions and then done, and ends with code 0 when its input ends.",
);

/// Returns the report as one verdict.
pub(super) fn judged(report: &DriveReport) -> Subject {
    let mut problems: Vec<Problem> = report.reported().map(problem).collect();
    problems.extend(report.at_end.as_ref().map(|misbehaviour| Problem {
        level: Level::Violation,
        rule: PROTOCOL,
        file: report.name.clone(),
        line: None,
        text: misbehaviour.to_string(),
    }));
    Subject {
        name: report.name.clone(),
        conforms: report.exit() == Exit::Conforms,
        verdict: report.unfinished().map_or_else(|| Ok(report.summary()), Err),
        problems,
    }
}

/// Returns the verdict on a command that could not be started.
pub(super) fn not_started(name: &str, why: &str) -> Subject {
    let (name, verdict) = (name.to_owned(), Err(why.to_owned()));
    Subject { name, conforms: false, verdict, problems: Vec::new() }
}

fn problem(entry: &ReportedFinding) -> Problem {
    let verdict = entry.verdict();
    let first = verdict.as_ref().and_then(|verdict| verdict.violations.first());
    Problem {
        level: Level::Violation,
        rule: first.map_or(PROTOCOL, |violation| text_of(violation.rule)),
        file: entry.location(),
        line: first.map(|violation| violation.line),
        text: entry.text(),
    }
}
