//! Runs either judge line by line, on a whole trace or a part of it.

use fuseline_traces::observed::{self, Slack, TimeOrderError};
use fuseline_traces::{
    Annotations, Doubt, DoubtKind, Event, Header, HeaderAnnotations, Judge, Verdict, Violation,
};

use crate::part::{PartFilter, TraceRange};

/// The way in which a trace is judged: strictly, or as observed within this slack.
pub type JudgeMode = Option<Slack>;

/// A judge of one trace.
#[derive(Debug)]
pub struct TraceJudge {
    judge: EitherJudge,
    part: Option<PartVerdict>,
}

#[derive(Debug)]
enum EitherJudge {
    /// Checks that the decisions are exactly what the rules demand.
    Strict(Box<Judge>),
    /// Checks that the rules can explain each timestamp.
    Observed(Box<observed::Judge>),
}

/// The findings in a part of the trace. The whole trace is judged, because the rules' demands
/// depend on everything before.
#[derive(Debug)]
struct PartVerdict {
    filter: PartFilter,
    /// The violations of the part.
    found: Verdict,
    keeps_places: bool,
    /// Judges the part alone, for doubts about the whole trace.
    alone: Option<Box<observed::Judge>>,
}

impl TraceJudge {
    /// Returns a judge of the trace `name`.
    #[must_use]
    pub fn new(mode: JudgeMode, name: &str, header: &Header) -> Self {
        let judge = match mode {
            None => EitherJudge::Strict(Box::new(Judge::new(name, header))),
            Some(slack) => {
                EitherJudge::Observed(Box::new(observed::Judge::new(name, header, slack)))
            }
        };
        Self { judge, part: None }
    }

    /// Judges for an operator that opens a timestamp each `period`, in nanoseconds (J1). The strict
    /// judge compares only decisions, so it ignores the period.
    #[must_use]
    pub fn with_period(self, period: u64) -> Self {
        self.map(|judge| judge, |judge| judge.with_period(period))
    }

    /// Judges a trace whose header has these annotations.
    #[must_use]
    pub fn with_header_annotations(self, annotations: &HeaderAnnotations) -> Self {
        self.map(
            |judge| judge.with_header_annotations(annotations),
            |judge| judge.with_header_annotations(annotations),
        )
    }

    /// Judges with this tolerance for the stamps of source `p` alone, in nanoseconds; source 0 is
    /// local. The strict judge takes stamps as they are.
    #[must_use]
    pub fn with_tolerance_of(self, p: u64, tolerance: u64) -> Self {
        self.map(|judge| judge, |judge| judge.with_tolerance_of(p, tolerance))
    }

    /// Also records the places of violations that it does not report in full.
    #[must_use]
    pub fn with_places(mut self) -> Self {
        if let Some(part) = &mut self.part {
            part.keeps_places = true;
            return self;
        }
        self.map(Judge::with_places, observed::Judge::with_places)
    }

    /// Gives a verdict on a part of the trace, with the counts and violations of that part.
    #[must_use]
    pub fn with_part(mut self, part: TraceRange) -> Self {
        let found = self.judge.so_far().clone();
        let alone = match &self.judge {
            EitherJudge::Strict(_) => None,
            EitherJudge::Observed(judge) => Some(judge.clone()),
        };
        let filter = PartFilter::new(part);
        self.part = Some(PartVerdict { filter, found, keeps_places: false, alone });
        self
    }

    /// Judges the next line, which has no annotations.
    ///
    /// # Errors
    /// Returns an error if an observed trace is further out of order than its tolerance.
    pub fn line(&mut self, line: u64, event: &Event) -> Result<(), TimeOrderError> {
        self.annotated_line(line, event, &Annotations::NONE)
    }

    /// Judges the next line with its annotations.
    ///
    /// # Errors
    /// Returns an error if an observed trace is further out of order than its tolerance.
    pub fn annotated_line(
        &mut self,
        line: u64,
        event: &Event,
        annotations: &Annotations,
    ) -> Result<(), TimeOrderError> {
        match &mut self.judge {
            EitherJudge::Strict(judge) => judge.annotated_line(line, event, annotations),
            EitherJudge::Observed(judge) => judge.annotated_line(line, event, annotations)?,
        }
        if let Some(part) = &mut self.part {
            if part.filter.takes(event)
                && let Some(alone) = &mut part.alone
            {
                alone.annotated_line(line, event, annotations)?;
            }
            part.take(self.judge.take_violations());
        }
        Ok(())
    }

    /// Returns the violations listed so far, except the first `known` of them.
    #[must_use]
    pub fn since(&self, known: usize) -> &[Violation] {
        let so_far = self.part.as_ref().map_or_else(|| self.judge.so_far(), |part| &part.found);
        so_far.violations.get(known..).unwrap_or_default()
    }

    /// Returns the verdict on the whole trace. Lines that are not there are missing. Violations are
    /// in the order of their lines.
    #[must_use]
    pub fn finish(self) -> Verdict {
        let found = match self.judge {
            EitherJudge::Strict(judge) => judge.finish(),
            EitherJudge::Observed(judge) => judge.finish(),
        };
        PartVerdict::of(self.part, found, observed::Judge::finish).sorted()
    }

    /// Returns the verdict on the whole trace of a run that is known to have ended, so everything
    /// that it still owed is overdue. Violations are in the order of their lines.
    #[must_use]
    pub fn finish_ended(self) -> Verdict {
        let found = match self.judge {
            EitherJudge::Strict(judge) => judge.finish_ended(),
            EitherJudge::Observed(judge) => judge.finish_ended(),
        };
        PartVerdict::of(self.part, found, observed::Judge::finish_ended).sorted()
    }

    /// Returns the verdict on a trace that may continue or was cut short. Lines that are not there
    /// may still come. Violations are in the order in which they were found. The second value is
    /// `true` if decisions of the last input were missing; these are not judged.
    #[must_use]
    pub fn finish_early(self) -> (Verdict, bool) {
        let (found, is_cut) = match self.judge {
            EitherJudge::Strict(judge) => without_last(*judge),
            EitherJudge::Observed(judge) => (judge.finish_early(), false),
        };
        (PartVerdict::of(self.part, found, observed::Judge::finish_early), is_cut)
    }

    fn map(
        self,
        strict: impl FnOnce(Judge) -> Judge,
        observed: impl FnOnce(observed::Judge) -> observed::Judge,
    ) -> Self {
        let judge = match self.judge {
            EitherJudge::Strict(judge) => EitherJudge::Strict(Box::new(strict(*judge))),
            EitherJudge::Observed(judge) => EitherJudge::Observed(Box::new(observed(*judge))),
        };
        Self { judge, part: self.part }
    }
}

impl EitherJudge {
    const fn so_far(&self) -> &Verdict {
        match self {
            Self::Strict(judge) => judge.so_far(),
            Self::Observed(judge) => judge.so_far(),
        }
    }

    fn take_violations(&mut self) -> Vec<Violation> {
        match self {
            Self::Strict(judge) => judge.take_violations(),
            Self::Observed(judge) => judge.take_violations(),
        }
    }
}

impl PartVerdict {
    /// Takes the violations that belong to the part.
    fn take(&mut self, violations: Vec<Violation>) {
        for violation in violations.into_iter().filter(|it| self.filter.has(it.t)) {
            self.found.count(violation.place(), self.keeps_places, || violation);
        }
    }

    /// Returns the verdict on the part if there is one, or else the verdict on the whole trace.
    /// `finish` ends the judge of the part alone.
    fn of(part: Option<Self>, whole: Verdict, finish: fn(observed::Judge) -> Verdict) -> Verdict {
        let Some(mut part) = part else { return whole };
        part.take(whole.violations);
        let Self { filter, found, alone, .. } = part;
        let judged = filter.judged();
        let doubts = doubts_of(&whole.doubts, judged, &filter);
        let alone = alone.and_then(|judge| filter.ends(*judge)).map(finish);
        let alone = alone.into_iter().flat_map(|verdict| verdict.doubts);
        let doubts: Vec<Doubt> = doubts.chain(alone.filter(is_of_whole)).collect();
        let cause = whole.cause.filter(|_| !found.violations.is_empty());
        Verdict { lines: whole.lines, judged, doubts, cause, ..found }.accepting(&[])
    }
}

/// Returns the doubts about single messages of a part.
fn doubts_of(whole: &[Doubt], judged: u64, filter: &PartFilter) -> impl Iterator<Item = Doubt> {
    let of_messages = whole.iter().filter(|doubt| !doubt.messages.is_empty());
    let of_part = of_messages.filter_map(|doubt| doubt.of_messages(|t| filter.has(Some(t))));
    Doubt::unjudged(judged).into_iter().chain(of_part)
}

/// Returns `true` if a doubt is about the whole trace, and neither about single messages nor about
/// whether there are any.
fn is_of_whole(doubt: &Doubt) -> bool {
    doubt.messages.is_empty() && doubt.kind != DoubtKind::Unjudged
}

/// Returns the verdict without the decisions that the last input still lacks, and `true` if there
/// are any.
fn without_last(judge: Judge) -> (Verdict, bool) {
    let so_far = judge.so_far();
    let (known, more, all) = (so_far.violations.len(), so_far.more, so_far.broken());
    let places = so_far.places.len();
    let mut verdict = judge.finish();
    let is_cut = verdict.broken() > all;
    if is_cut {
        verdict.violations.truncate(known);
        verdict.places.truncate(places);
        verdict.more = more;
    }
    (verdict.accepting(&[]), is_cut)
}
