//! Verdicts as files for other tools: SARIF for code hosts, `JUnit` for continuous integration.

mod junit;
mod sarif;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use fuseline_traces::{Doubt, Rule, Verdict, Violation};

use crate::exit::Exit;
use crate::fault::Fault;
use crate::output::{Output, Overwrite};
use crate::verdict::{self, plain, print_doubts, print_summary, print_violation};

/// A rule's identifier and its sentence.
type RuleText = (&'static str, &'static str);

/// The files of the results, and the writer of each.
pub(crate) struct Outputs(Vec<(Output, ResultWriter)>);

type ResultWriter = fn(&[Subject], &mut dyn Write) -> io::Result<()>;

/// The verdict on a trace.
pub(crate) struct Subject {
    /// The trace's name.
    pub(crate) name: String,
    pub(crate) conforms: bool,
    /// The verdict in a few lines; or why there is none.
    pub(crate) verdict: Result<String, String>,
    pub(crate) problems: Vec<Problem>,
}

/// The weight of a problem.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Level {
    /// It breaks a rule.
    Violation,
    /// It is in doubt.
    Doubt,
    /// It is in doubt, and accepted.
    Accepted,
}

/// Something that breaks a rule, or is in doubt.
pub(crate) struct Problem {
    pub(crate) level: Level,
    pub(crate) rule: RuleText,
    pub(crate) file: String,
    /// From 1; none if it is about the whole.
    pub(crate) line: Option<u64>,
    /// The violations, in lines without colours.
    pub(crate) text: String,
}

impl Outputs {
    /// Returns the files that are wanted.
    ///
    /// # Errors
    /// If a file cannot be written, or is one of `inputs`.
    pub(crate) fn new(
        [sarif, junit]: [Option<&Path>; 2],
        inputs: &[&Path],
        overwrite: Overwrite,
    ) -> Result<Self, Fault> {
        let wanted = [(sarif, sarif::write as ResultWriter), (junit, junit::write)];
        let wanted = wanted.into_iter().filter_map(|(path, write)| Some((path?, write)));
        let open = |(path, write)| Ok::<_, Fault>((Output::new(path, inputs, overwrite)?, write));
        wanted.map(open).collect::<Result<_, _>>().map(Self)
    }

    /// Returns `true` if nothing is to be written.
    pub(crate) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// # Errors
    /// If a file cannot be written.
    pub(crate) fn write(&self, judged: &[Subject]) -> Result<(), Fault> {
        self.0.iter().try_for_each(|(output, put)| {
            output.write(|out| put(judged, out).map_err(Fault::Output))
        })
    }
}

impl Subject {
    /// Returns the outcome of a trace that was judged.
    pub(crate) fn found(found: &Verdict) -> Self {
        let file = &found.file;
        let problem = |violation: &Violation| Problem {
            level: Level::Violation,
            rule: text_of(violation.rule),
            file: file.clone(),
            line: Some(violation.line),
            text: plain(|out| print_violation(violation, file, out)),
        };
        let doubts = found.doubts.iter().map(|doubt| in_doubt(doubt, file));
        Self {
            name: file.clone(),
            conforms: verdict::exit(found) == Exit::Conforms,
            verdict: Ok(plain(|out| {
                print_summary(found, out).and_then(|()| print_doubts(found, out))
            })),
            problems: found.violations.iter().map(problem).chain(doubts).collect(),
        }
    }

    /// Returns the outcome of a trace that cannot be read, or not to its end.
    pub(crate) fn unread(name: &Path, fault: &Fault) -> Self {
        let (name, verdict) = (name.display().to_string(), Err(fault.to_string()));
        Self { name, conforms: false, verdict, problems: Vec::new() }
    }
}

/// Returns a doubt as a problem of the file.
fn in_doubt(doubt: &Doubt, file: &str) -> Problem {
    Problem {
        level: if doubt.accepted { Level::Accepted } else { Level::Doubt },
        rule: (doubt.kind.as_str(), doubt.kind.sentence()),
        file: file.to_owned(),
        line: None,
        text: format!("{file}: {doubt}"),
    }
}

/// Returns all rules that a trace is judged by, and those that were broken besides.
fn rules(judged: &[Subject]) -> BTreeMap<&'static str, &'static str> {
    let broken = judged.iter().flat_map(|judged| &judged.problems).map(|problem| problem.rule);
    Rule::ALL.into_iter().map(text_of).chain(broken).collect()
}

const fn text_of(rule: Rule) -> RuleText {
    (rule.id(), rule.sentence())
}
