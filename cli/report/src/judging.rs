//! Either judge, line by line, and what it found.

use fuseline_traces::observed::{self, Slack, TimeOrderError};
use fuseline_traces::{
    Annotations, Event, Header, HeaderAnnotations, Judge, Rule, Verdict, Violation, ViolationPlace,
};
use serde::Serialize;

/// How a trace is judged: strictly, or as observed within this.
pub type JudgeMode = Option<Slack>;

/// A judge of one trace.
#[derive(Debug)]
pub enum TraceJudge {
    /// Every decision is the one that the rules demand.
    Strict(Judge),
    /// The rules can explain each timestamp.
    Observed(observed::Judge),
}

/// What one of the judges found.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Findings {
    /// The strict judge.
    Strict(Verdict),
    /// That of observed traces.
    Observed(observed::Verdict),
}

/// A verdict without its violations.
#[derive(Clone, Copy, Debug)]
pub struct VerdictSummary<'a> {
    /// The trace's name.
    pub file: &'a str,
    /// Whether the rules explain all of it.
    pub conforms: bool,
    /// Timestamps judged.
    pub judged: u64,
    /// Timestamps that local owed a result when the run ended, if it is known to have ended.
    pub unfinished: Option<u64>,
    /// Lines, the header's too.
    pub lines: u64,
    /// All violations, those that are not listed too.
    pub violations: u64,
}

/// One violation of either judge.
#[derive(Clone, Copy, Debug)]
pub struct AnyViolation<'a> {
    /// From 1.
    pub line: u64,
    /// The timestamp that it is about.
    pub t: Option<u64>,
    /// The rule's identifier and its sentence.
    pub rule: (&'static str, &'static str),
    /// What was found.
    pub found: &'a str,
    /// What the rules demand or allow.
    pub expected: &'a str,
    /// Of an observed trace: by how much it came too late, in nanoseconds.
    pub late: Option<u64>,
    /// The last lines about the timestamp.
    pub story: &'a [String],
}

impl TraceJudge {
    /// A judge of the trace `name`.
    #[must_use]
    pub fn new(mode: JudgeMode, name: &str, header: &Header) -> Self {
        match mode {
            None => Self::Strict(Judge::new(name, header)),
            Some(slack) => Self::Observed(observed::Judge::new(name, header, slack)),
        }
    }

    /// The same, for an operator that opens a timestamp each `period`, in nanoseconds (J1). The strict judge compares
    /// decisions alone and takes no notice of it.
    #[must_use]
    pub fn with_period(self, period: u64) -> Self {
        match self {
            Self::Strict(_) => self,
            Self::Observed(judge) => Self::Observed(judge.with_period(period)),
        }
    }

    /// The same, of a trace whose header has these further keys.
    #[must_use]
    pub fn with_header_annotations(self, annotations: &HeaderAnnotations) -> Self {
        match self {
            Self::Strict(judge) => Self::Strict(judge.with_header_annotations(annotations)),
            Self::Observed(judge) => Self::Observed(judge.with_header_annotations(annotations)),
        }
    }

    /// The same, where the stamps of source `p` have an error of their own, in nanoseconds; 0 is local. The strict judge
    /// takes stamps as they are.
    #[must_use]
    pub fn with_tolerance_of(self, p: u64, tolerance: u64) -> Self {
        match self {
            Self::Strict(_) => self,
            Self::Observed(judge) => Self::Observed(judge.with_tolerance_of(p, tolerance)),
        }
    }

    /// The same, which also notes where each violation is beyond those that it reports in full.
    #[must_use]
    pub fn with_places(self) -> Self {
        match self {
            Self::Strict(judge) => Self::Strict(judge.with_places()),
            Self::Observed(judge) => Self::Observed(judge.with_places()),
        }
    }

    /// Judges the next line, which has no further keys.
    ///
    /// # Errors
    /// If an observed trace is further out of order than its tolerance.
    pub fn line(&mut self, line: u64, event: &Event) -> Result<(), TimeOrderError> {
        self.annotated_line(line, event, &Annotations::NONE)
    }

    /// Judges the next line, which has these further keys.
    ///
    /// # Errors
    /// If an observed trace is further out of order than its tolerance.
    pub fn annotated_line(
        &mut self,
        line: u64,
        event: &Event,
        annotations: &Annotations,
    ) -> Result<(), TimeOrderError> {
        match self {
            Self::Strict(judge) => judge.annotated_line(line, event, annotations),
            Self::Observed(judge) => judge.annotated_line(line, event, annotations)?,
        }
        Ok(())
    }

    /// The violations found so far, without the first `page_trace` of them.
    #[must_use]
    pub fn since(&self, page_trace: usize) -> Vec<AnyViolation<'_>> {
        match self {
            Self::Strict(judge) => {
                judge.so_far().violations.iter().skip(page_trace).map(AnyViolation::from).collect()
            }
            Self::Observed(judge) => {
                judge.so_far().violations.iter().skip(page_trace).map(AnyViolation::from).collect()
            }
        }
    }

    /// The verdict on the whole: what is not there is missing. Violations stand by their lines.
    #[must_use]
    pub fn finish(self) -> Findings {
        match self {
            Self::Strict(judge) => Findings::Strict(judge.finish()),
            Self::Observed(judge) => Findings::observed(judge.finish()),
        }
    }

    /// The verdict on the whole trace of a run that is known to have ended: all that it owed is overdue. Violations stand by
    /// their lines.
    #[must_use]
    pub fn finish_ended(self) -> Findings {
        match self {
            Self::Strict(judge) => Findings::Strict(judge.finish_ended()),
            Self::Observed(judge) => Findings::observed(judge.finish_ended()),
        }
    }

    /// The verdict on a trace that may go on, or was cut short: what is not there may still have come. Violations stand as
    /// they were found. Also whether decisions of the last input were missing, which are not judged.
    #[must_use]
    pub fn finish_early(self) -> (Findings, bool) {
        match self {
            Self::Strict(judge) => {
                let (verdict, is_cut) = without_last(judge);
                (Findings::Strict(verdict), is_cut)
            }
            Self::Observed(judge) => (Findings::Observed(judge.finish_early()), false),
        }
    }
}

/// The verdict without decisions that the last input still lacks, and whether there are any.
fn without_last(judge: Judge) -> (Verdict, bool) {
    let so_far = judge.so_far();
    let (conforms, known, more) = (so_far.conforms, so_far.violations.len(), so_far.more);
    let places = so_far.places.len();
    let mut verdict = judge.finish();
    let is_cut = verdict.violations.len() as u64 + verdict.more > known as u64 + more;
    if is_cut {
        verdict.violations.truncate(known);
        verdict.places.truncate(places);
        (verdict.more, verdict.conforms) = (more, conforms);
    }
    (verdict, is_cut)
}

impl Findings {
    fn observed(mut verdict: observed::Verdict) -> Self {
        verdict.violations.sort_by_key(|violation| violation.line);
        Self::Observed(verdict)
    }

    /// The verdict in short.
    #[must_use]
    pub const fn summary(&self) -> VerdictSummary<'_> {
        match self {
            Self::Strict(Verdict {
                file,
                conforms,
                judged,
                unfinished,
                lines,
                violations,
                more,
                places: _,
            }) => VerdictSummary {
                file: file.as_str(),
                conforms: *conforms,
                judged: *judged,
                unfinished: *unfinished,
                lines: *lines,
                violations: violations.len() as u64 + *more,
            },
            Self::Observed(observed::Verdict {
                file,
                conforms,
                judged,
                unfinished,
                lines,
                violations,
                more,
                places: _,
            }) => VerdictSummary {
                file: file.as_str(),
                conforms: *conforms,
                judged: *judged,
                unfinished: *unfinished,
                lines: *lines,
                violations: violations.len() as u64 + *more,
            },
        }
    }

    /// The violations that are listed.
    #[must_use]
    pub fn violations(&self) -> Vec<AnyViolation<'_>> {
        match self {
            Self::Strict(verdict) => verdict.violations.iter().map(AnyViolation::from).collect(),
            Self::Observed(verdict) => verdict.violations.iter().map(AnyViolation::from).collect(),
        }
    }

    /// Where each of the others is: line, timestamp, and the rule with its sentence.
    pub(crate) fn places(&self) -> Vec<ViolationPlace<(&'static str, &'static str)>> {
        let strict = |place: &ViolationPlace<Rule>| place.map(|it| (it.id(), it.sentence()));
        let observed = |place: &ViolationPlace<_>| {
            place.map(|it: observed::BrokenRule| (it.id(), it.sentence()))
        };
        match self {
            Self::Strict(verdict) => verdict.places.iter().map(strict).collect(),
            Self::Observed(verdict) => verdict.places.iter().map(observed).collect(),
        }
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
        Self { line: *line, t: *t, rule, found, expected, late: *late, story }
    }
}
