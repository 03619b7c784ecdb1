//! Either judge, line by line, and what it found.

use fuseline_traces::observed::{self, Slack, TimeOrderError};
use fuseline_traces::{
    Annotations, Doubt, DoubtKind, Event, Header, HeaderAnnotations, Judge, Rule, Verdict,
    Violation, ViolationPlace,
};
use serde::Serialize;

use crate::part::{PartFilter, TraceRange};

/// At most this many violations of a part are listed in full.
const LISTED: usize = 100;

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
    /// Every decision is the one that the rules demand.
    Strict(Box<Judge>),
    /// The rules can explain each timestamp.
    Observed(Box<observed::Judge>),
}

/// The findings in a part of the trace. All of it is judged, since what the rules demand depends on what came before.
#[derive(Debug)]
struct PartVerdict {
    filter: PartFilter,
    /// The violations of the part.
    found: Findings,
    keeps_places: bool,
    /// Judges the part by itself, for what is in doubt about the whole of it.
    alone: Option<Box<observed::Judge>>,
}

/// The findings of one of the two judges.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Findings {
    /// The strict judge.
    Strict(Verdict),
    /// The verdict on an observed trace.
    Observed(observed::Verdict),
}

/// A verdict without its violations.
#[derive(Clone, Copy, Debug)]
pub struct VerdictSummary<'a> {
    /// The trace's name.
    pub file: &'a str,
    /// `true` if the rules explain all of it and nothing is in doubt.
    pub conforms: bool,
    /// The doubts: the things that the judge could not see.
    pub doubts: &'a [Doubt],
    /// The cause that explains most violations, if one cause does.
    pub cause: Option<&'a str>,
    /// Timestamps judged.
    pub judged: u64,
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
    /// The line or fact that was found.
    pub found: &'a str,
    /// The line or fact that the rules demand or allow.
    pub expected: &'a str,
    /// In an observed trace, the time by which it came too late, in nanoseconds.
    pub late: Option<u64>,
    /// The last lines about the timestamp.
    pub story: &'a [String],
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
    /// judge compares decisions alone and takes no notice of it.
    #[must_use]
    pub fn with_period(self, period: u64) -> Self {
        self.map(|judge| judge, |judge| judge.with_period(period))
    }

    /// Judges a trace whose header has these further keys.
    #[must_use]
    pub fn with_header_annotations(self, annotations: &HeaderAnnotations) -> Self {
        self.map(
            |judge| judge.with_header_annotations(annotations),
            |judge| judge.with_header_annotations(annotations),
        )
    }

    /// Judges with a tolerance for the stamps of source `p` alone, in nanoseconds; 0 is local. The
    /// strict judge takes stamps as they are.
    #[must_use]
    pub fn with_tolerance_of(self, p: u64, tolerance: u64) -> Self {
        self.map(|judge| judge, |judge| judge.with_tolerance_of(p, tolerance))
    }

    /// Also notes where each violation is beyond those that it reports in full.
    #[must_use]
    pub fn with_places(mut self) -> Self {
        if let Some(part) = &mut self.part {
            part.keeps_places = true;
            return self;
        }
        self.map(Judge::with_places, observed::Judge::with_places)
    }

    /// Gives a verdict about a part of the trace: what is counted and found there.
    #[must_use]
    pub fn with_part(mut self, part: TraceRange) -> Self {
        let (found, alone) = match &self.judge {
            EitherJudge::Strict(judge) => (Findings::Strict(judge.so_far().clone()), None),
            EitherJudge::Observed(judge) => {
                (Findings::Observed(judge.so_far().clone()), Some(judge.clone()))
            }
        };
        let filter = PartFilter::new(part);
        self.part = Some(PartVerdict { filter, found, keeps_places: false, alone });
        self
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
            part.take(&mut self.judge);
        }
        Ok(())
    }

    /// Returns the violations found so far, without the first `page_trace` of them.
    #[must_use]
    pub fn since(&self, page_trace: usize) -> Vec<AnyViolation<'_>> {
        let all = match (&self.part, &self.judge) {
            (Some(part), _) => part.found.violations(),
            (None, EitherJudge::Strict(judge)) => {
                judge.so_far().violations.iter().map(AnyViolation::from).collect()
            }
            (None, EitherJudge::Observed(judge)) => {
                judge.so_far().violations.iter().map(AnyViolation::from).collect()
            }
        };
        all.into_iter().skip(page_trace).collect()
    }

    /// Returns the verdict on the whole: what is not there is missing. Violations stand by their lines.
    #[must_use]
    pub fn finish(self) -> Findings {
        let found = match self.judge {
            EitherJudge::Strict(judge) => Findings::Strict(judge.finish()),
            EitherJudge::Observed(judge) => Findings::Observed(judge.finish()),
        };
        PartVerdict::of(self.part, found, observed::Judge::finish).sorted()
    }

    /// Returns the verdict on the whole trace of a run that is known to have ended: all that it owed is overdue. Violations stand by
    /// their lines.
    #[must_use]
    pub fn finish_ended(self) -> Findings {
        let found = match self.judge {
            EitherJudge::Strict(judge) => Findings::Strict(judge.finish_ended()),
            EitherJudge::Observed(judge) => Findings::Observed(judge.finish_ended()),
        };
        PartVerdict::of(self.part, found, observed::Judge::finish_ended).sorted()
    }

    /// Returns the verdict on a trace that may go on, or was cut short: what is not there may still have come. Violations stand as
    /// they were found. Also whether decisions of the last input were missing, which are not judged.
    #[must_use]
    pub fn finish_early(self) -> (Findings, bool) {
        let (found, is_cut) = match self.judge {
            EitherJudge::Strict(judge) => {
                let (verdict, is_cut) = without_last(*judge);
                (Findings::Strict(verdict), is_cut)
            }
            EitherJudge::Observed(judge) => (Findings::Observed(judge.finish_early()), false),
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

impl PartVerdict {
    /// Takes what the judge has found since.
    fn take(&mut self, judge: &mut EitherJudge) {
        let Self { filter, found, keeps_places, alone: _ } = self;
        match (judge, found) {
            (EitherJudge::Strict(judge), Findings::Strict(verdict)) => {
                let Verdict { violations, more, places, .. } = verdict;
                let listed = PartList { violations, more, places, keeps_places: *keeps_places };
                listed.extend(judge.take_violations(), filter, place_of);
            }
            (EitherJudge::Observed(judge), Findings::Observed(verdict)) => {
                let observed::Verdict { violations, more, places, .. } = verdict;
                let listed = PartList { violations, more, places, keeps_places: *keeps_places };
                listed.extend(judge.take_violations(), filter, observed_place_of);
            }
            (EitherJudge::Strict(_), Findings::Observed(_))
            | (EitherJudge::Observed(_), Findings::Strict(_)) => {}
        }
    }

    /// Returns the verdict on the part, if it is one, else on all; `finish` ends the judge of the part alone.
    fn of(
        part: Option<Self>,
        whole: Findings,
        finish: fn(observed::Judge) -> observed::Verdict,
    ) -> Findings {
        let Some(Self { filter, found, keeps_places, alone }) = part else { return whole };
        let judged = filter.judged();
        let doubts = doubts_of(whole.doubts(), judged, &filter);
        let alone = alone.and_then(|judge| filter.ends(*judge)).map(finish);
        let alone = alone.into_iter().flat_map(|verdict| verdict.doubts);
        let doubts: Vec<Doubt> = doubts.chain(alone.filter(is_of_whole)).collect();
        let found = match (whole, found) {
            (Findings::Strict(whole), Findings::Strict(mut found)) => {
                let Verdict { violations, more, places, .. } = &mut found;
                let listed = PartList { violations, more, places, keeps_places };
                listed.extend(whole.violations, &filter, place_of);
                Findings::Strict(Verdict { lines: whole.lines, judged, doubts, ..found })
            }
            (Findings::Observed(whole), Findings::Observed(mut found)) => {
                let observed::Verdict { violations, more, places, .. } = &mut found;
                let listed = PartList { violations, more, places, keeps_places };
                listed.extend(whole.violations, &filter, observed_place_of);
                let cause = whole.cause.filter(|_| !found.violations.is_empty());
                let lines = whole.lines;
                Findings::Observed(observed::Verdict { lines, judged, doubts, cause, ..found })
            }
            (whole, _) => whole,
        };
        found.accepting(&[])
    }
}

/// Returns the doubts about single messages of a part.
fn doubts_of(whole: &[Doubt], judged: u64, filter: &PartFilter) -> impl Iterator<Item = Doubt> {
    let of_messages = whole.iter().filter(|doubt| !doubt.messages.is_empty());
    let of_part = of_messages.filter_map(|doubt| doubt.of_messages(|t| filter.has(Some(t))));
    Doubt::unjudged(judged).into_iter().chain(of_part)
}

/// Returns whether a doubt is about the whole trace, not about single messages or about whether there are any.
fn is_of_whole(doubt: &Doubt) -> bool {
    doubt.messages.is_empty() && doubt.kind != DoubtKind::Unjudged
}

/// The violations of a part: the first ones whole, then their places.
struct PartList<'a, V, R> {
    violations: &'a mut Vec<V>,
    more: &'a mut u64,
    places: &'a mut Vec<ViolationPlace<R>>,
    keeps_places: bool,
}

impl<V, R> PartList<'_, V, R> {
    fn extend(self, found: Vec<V>, filter: &PartFilter, place_of: fn(&V) -> ViolationPlace<R>) {
        for violation in found {
            let place = place_of(&violation);
            if !filter.has(place.t) {
                continue;
            }
            if self.violations.len() < LISTED {
                self.violations.push(violation);
            } else {
                *self.more += 1;
                self.places.extend(self.keeps_places.then_some(place));
            }
        }
    }
}

fn place_of(violation: &Violation) -> ViolationPlace<Rule> {
    ViolationPlace { line: violation.line, t: violation.t, rule: violation.rule }
}

fn observed_place_of(violation: &observed::Violation) -> ViolationPlace<observed::BrokenRule> {
    ViolationPlace { line: violation.line, t: violation.t, rule: violation.rule }
}

/// Returns the verdict without decisions that the last input still lacks, and whether there are any.
fn without_last(judge: Judge) -> (Verdict, bool) {
    let so_far = judge.so_far();
    let (known, more) = (so_far.violations.len(), so_far.more);
    let places = so_far.places.len();
    let mut verdict = judge.finish();
    let is_cut = verdict.violations.len() as u64 + verdict.more > known as u64 + more;
    if is_cut {
        verdict.violations.truncate(known);
        verdict.places.truncate(places);
        verdict.more = more;
    }
    (verdict.accepting(&[]), is_cut)
}

impl Findings {
    /// Sorts the violations by their lines.
    fn sorted(mut self) -> Self {
        if let Self::Observed(verdict) = &mut self {
            verdict.violations.sort_by_key(|violation| violation.line);
        }
        self
    }

    /// Accepts these kinds of doubt.
    #[must_use]
    pub fn accepting(self, kinds: &[DoubtKind]) -> Self {
        match self {
            Self::Strict(verdict) => Self::Strict(verdict.accepting(kinds)),
            Self::Observed(verdict) => Self::Observed(verdict.accepting(kinds)),
        }
    }

    /// Adds a doubt that the reader of the trace has.
    #[must_use]
    pub fn doubting(mut self, doubt: Doubt) -> Self {
        match &mut self {
            Self::Strict(Verdict { doubts, .. })
            | Self::Observed(observed::Verdict { doubts, .. }) => doubts.push(doubt),
        }
        self.accepting(&[])
    }

    /// Returns the doubts.
    #[must_use]
    pub fn doubts(&self) -> &[Doubt] {
        match self {
            Self::Strict(Verdict { doubts, .. })
            | Self::Observed(observed::Verdict { doubts, .. }) => doubts,
        }
    }

    /// Returns the verdict in a few words, such as *conforms*.
    #[must_use]
    pub fn in_short(&self) -> String {
        match self {
            Self::Strict(verdict) => verdict.in_short(),
            Self::Observed(verdict) => verdict.in_short(),
        }
    }

    /// Returns the verdict without its violations.
    #[must_use]
    pub fn summary(&self) -> VerdictSummary<'_> {
        match self {
            Self::Strict(verdict) => {
                let Verdict { file, judged, lines, violations, more, .. } = verdict;
                VerdictSummary {
                    file,
                    conforms: verdict.conforms,
                    doubts: &verdict.doubts,
                    cause: None,
                    judged: *judged,
                    lines: *lines,
                    violations: violations.len() as u64 + *more,
                }
            }
            Self::Observed(verdict) => {
                let observed::Verdict { file, judged, lines, violations, more, .. } = verdict;
                VerdictSummary {
                    file,
                    conforms: verdict.conforms,
                    doubts: &verdict.doubts,
                    cause: verdict.cause.as_deref(),
                    judged: *judged,
                    lines: *lines,
                    violations: violations.len() as u64 + *more,
                }
            }
        }
    }

    /// Returns the violations that are listed.
    #[must_use]
    pub fn violations(&self) -> Vec<AnyViolation<'_>> {
        match self {
            Self::Strict(verdict) => verdict.violations.iter().map(AnyViolation::from).collect(),
            Self::Observed(verdict) => verdict.violations.iter().map(AnyViolation::from).collect(),
        }
    }

    /// Returns the place of each of the others: line, timestamp, and the rule with its sentence.
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
