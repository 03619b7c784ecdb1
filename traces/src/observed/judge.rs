//! The observed judge, line by line. `closing` judges what no later line can change.
//!
//! [`Judge`] collects what was recorded of each timestamp and judges it once no later line can
//! change the verdict. `explain` decides whether the rules can explain a timestamp, and `violation`
//! decides what to report if they cannot.

mod closing;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::io::BufRead;

use rangemap::RangeInclusiveSet;

use super::causes::CauseTracker;
use super::doubts::DoubtTracker;
use super::gap::{Gaps, Opened};
use super::open::OpenMessageHistory;
use super::slack::{Slack, SourceSlack};
use super::window::CrowdedOpens;
use crate::annotations::{Annotations, HeaderAnnotations};
use crate::event::{Commit, Decision, Event, Header, Input};
use crate::read::{Events, ReadError};
use crate::reason::DropReason;
use crate::recent::RecentLines;
use crate::verdict::{Verdict, Violation};

/// Judges one trace, line by line.
///
/// A timestamp is judged when no further line can change the decision about it, or when the trace
/// ends. Memory grows with the open timestamps, with the lines within a few tolerances of each
/// other, and with the gaps between the timestamps that are done. It does not grow with the trace's
/// length.
#[derive(Clone, Debug)]
pub struct Judge {
    header: Header,
    annotations: HeaderAnnotations,
    slack: SourceSlack,
    /// `true` if an open was read.
    records_opens: bool,
    /// The greatest instant so far. Stamps with a greater error than the operator's count as
    /// earlier by the difference.
    greatest: u64,
    /// The greatest instant that has certainly passed.
    passed: u64,
    open: BTreeMap<u64, Box<OpenMessageHistory>>,
    /// The instant at which each timestamp can be judged, or could before it got another line.
    closing: BinaryHeap<Reverse<(u64, u64)>>,
    /// The open timestamps that broke the rules.
    overdue: VecDeque<u64>,
    /// The timestamps that are done.
    ended: RangeInclusiveSet<u64>,
    /// The timestamps whose opens were all refused.
    refused: RangeInclusiveSet<u64>,
    /// The refused timestamps that have an output.
    broken: RangeInclusiveSet<u64>,
    /// The gaps, if a period is known.
    gaps: Option<Gaps>,
    crowded: CrowdedOpens,
    doubts: DoubtTracker,
    causes: CauseTracker,
    recent: RecentLines,
    /// `true` if the places of all violations are wanted.
    keeps_places: bool,
    /// `true` if the run is known to have ended.
    is_ended: bool,
    verdict: Verdict,
}

/// The reason why a trace cannot be judged.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// The trace cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The lines of the trace are out of order.
    #[error(transparent)]
    TimeOrderError(#[from] TimeOrderError),
}

/// Reports a line that is further out of order than the tolerances allow.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "{file}:{line}:1: the line at {at} follows a line at {greatest}, but the tolerances of both \
     allow only {tolerance} ns; {remedy}"
)]
pub struct TimeOrderError {
    /// The name that the trace was given.
    pub file: String,
    /// The line, counted from 1.
    pub line: u64,
    /// The line's instant in ns.
    pub at: u64,
    /// The greatest instant before it, in ns.
    pub greatest: u64,
    /// The sum of the errors that the two instants may have, in ns.
    pub tolerance: u64,
    /// The likely cause and the remedy.
    pub remedy: String,
}

/// Judges a whole trace. `file` names it in the verdict and in errors.
///
/// ```
/// use fuseline_traces::observed::{Slack, judge};
///
/// let trace = r#"{"fuseline":1,"window":16,"clouds":[]}
/// {"ev":"open","at":0,"t":1}
/// {"ev":"result","at":9,"t":1,"p":0}
/// {"ev":"emit","at":11,"t":1,"p":0}
/// "#;
/// // Stamps may be 2 ns off, and the operator may act 5 ns late.
/// let verdict = judge("run.jsonl", Slack { tolerance: 2, lateness: 5 }, trace.as_bytes())?;
/// assert!(verdict.violations.is_empty(), "{verdict:?}");
/// # Ok::<(), fuseline_traces::observed::JudgeError>(())
/// ```
///
/// # Errors
/// Returns a [`JudgeError`] if the trace cannot be read to its end or is out of order.
pub fn judge(file: &str, slack: Slack, trace: impl BufRead) -> Result<Verdict, JudgeError> {
    let mut reader = Events::observed(file, trace)?;
    let mut judge = Judge::new(file, reader.header(), slack)
        .with_header_annotations(reader.header_annotations());
    while let Some(event) = reader.next_event()? {
        judge.annotated_line(reader.line(), &event, reader.annotations())?;
    }
    Ok(judge.finish().sorted())
}

impl Judge {
    /// Creates a judge of a trace with this header, its first line. `file` names the trace in the
    /// verdict.
    #[must_use]
    pub fn new(file: impl Into<String>, header: &Header, slack: Slack) -> Self {
        Self {
            header: header.clone(),
            annotations: HeaderAnnotations::default(),
            slack: slack.into(),
            records_opens: false,
            greatest: 0,
            passed: 0,
            open: BTreeMap::new(),
            closing: BinaryHeap::new(),
            overdue: VecDeque::new(),
            ended: RangeInclusiveSet::new(),
            refused: RangeInclusiveSet::new(),
            broken: RangeInclusiveSet::new(),
            gaps: None,
            crowded: CrowdedOpens::new(header.window),
            doubts: DoubtTracker::new(header),
            causes: CauseTracker::default(),
            recent: RecentLines::default(),
            keeps_places: false,
            is_ended: false,
            verdict: Verdict::new(file.into()),
        }
    }

    /// Makes the judge also store the places of violations beyond the first 100, up to a million.
    #[must_use]
    pub const fn with_places(mut self) -> Self {
        self.keeps_places = true;
        self
    }

    /// Sets the period, in ns, at which the operator opens timestamps (J1). Call this before the
    /// first line.
    #[must_use]
    pub fn with_period(mut self, period: u64) -> Self {
        self.gaps = Some(Gaps::new(period, self.slack.own()));
        self
    }

    /// Gives the judge the further keys of the trace's header. Call this before the first line.
    #[must_use]
    pub fn with_header_annotations(mut self, annotations: &HeaderAnnotations) -> Self {
        self.annotations = annotations.clone();
        self
    }

    /// Sets the error of source `p`'s stamps, in ns; 0 is local. Call this before the first line.
    #[must_use]
    pub fn with_tolerance_of(mut self, p: u64, tolerance: u64) -> Self {
        self.slack = self.slack.with_tolerance_of(p, tolerance);
        self
    }

    /// Judges the next line, which has this number and no further keys.
    ///
    /// # Errors
    /// Returns a [`TimeOrderError`] if the line's instant lies before one that was read by more
    /// than the tolerances of both.
    pub fn line(&mut self, line: u64, event: &Event) -> Result<(), TimeOrderError> {
        self.annotated_line(line, event, &Annotations::NONE)
    }

    /// Judges the next line, which has this number and these further keys.
    ///
    /// # Errors
    /// Returns a [`TimeOrderError`] if the line's instant lies before one that was read by more
    /// than the tolerances of both.
    pub fn annotated_line(
        &mut self,
        line: u64,
        event: &Event,
        annotations: &Annotations,
    ) -> Result<(), TimeOrderError> {
        let (at, own) = (event.at(), self.slack.tolerance());
        let tolerance = source(event).map_or(own, |p| self.slack.tolerance_of(p));
        if at.saturating_add(tolerance) < self.passed {
            return Err(self.out_of_order(line, event, tolerance));
        }
        self.recent.push(line, event, annotations);
        self.verdict.lines = line;
        // Earlier opens matter only where timestamps go back.
        let is_again = self.causes.goes_back(event) && self.was_opened(event);
        self.causes.sees(line, event, is_again);
        self.doubts.sees(at, event, annotations, &self.slack);
        if let Some(t) = event.t() {
            self.take(t, line, event, annotations);
        }
        if let Some(gaps) = &mut self.gaps {
            gaps.sees(at);
            if let Event::Input(Input::Open { t, .. }) = *event {
                gaps.opens(Opened { at, line, t });
            }
        }
        self.passed = self.passed.max(at.saturating_sub(tolerance));
        // A stamp with a greater error does not bring the end nearer.
        let at = at.saturating_sub(tolerance.saturating_sub(own));
        if at > self.greatest {
            self.greatest = at;
            if self.gaps.is_some() {
                self.settle(Some(at));
            }
            if !self.crowded.is_empty() {
                self.settle_crowded(Some(self.passed), self.certain());
            }
            self.judge_closed();
        }
        Ok(())
    }

    /// Returns `true` if an open with the timestamp of this line was read before.
    fn was_opened(&self, event: &Event) -> bool {
        let is_known =
            |t| self.ended.contains(&t) || self.open.get(&t).is_some_and(|it| it.is_opened());
        event.t().is_some_and(is_known)
    }

    fn out_of_order(&self, line: u64, event: &Event, tolerance: u64) -> TimeOrderError {
        let both = tolerance.saturating_add(self.greatest.saturating_sub(self.passed));
        let file = self.verdict.file.clone();
        let remedy = self.causes.remedy(line, event, self.was_opened(event));
        let (at, greatest) = (event.at(), self.greatest);
        TimeOrderError { file, line, at, greatest, tolerance: both, remedy }
    }

    /// Removes the listed violations from the verdict and returns them. The verdict then lists up
    /// to 100 further ones.
    #[must_use]
    pub fn take_violations(&mut self) -> Vec<Violation> {
        std::mem::take(&mut self.verdict.violations)
    }

    /// Returns the verdict so far. Timestamps that may still get a line do not count yet.
    #[must_use]
    pub const fn so_far(&self) -> &Verdict {
        &self.verdict
    }

    /// Ends the trace and returns the verdict.
    #[must_use]
    pub fn finish(self) -> Verdict {
        let end = self.greatest;
        self.finish_at(end, end)
    }

    /// Ends the trace of a run that is known to have ended, and returns the verdict. Nothing more
    /// was to come, so everything that the run owed is overdue (A44).
    #[must_use]
    pub fn finish_ended(mut self) -> Verdict {
        self.is_ended = true;
        let last = self.greatest;
        self.finish_at(u64::MAX, last)
    }

    /// Ends a trace that continues or was cut short, and returns the verdict. An output that may
    /// still come does not count as missing.
    #[must_use]
    pub fn finish_early(self) -> Verdict {
        let end = self.certain();
        self.finish_at(end, end)
    }

    /// Ends the trace: timers and outputs were owed by `end`, and opens by `last`.
    fn finish_at(mut self, end: u64, last: u64) -> Verdict {
        self.settle(None);
        self.settle_crowded(None, end);
        if let Some(gap) = self.gaps.as_ref().and_then(|gaps| gaps.ends(last)) {
            self.tell_gap(self.verdict.lines, gap.after, gap);
        }
        while let Some((t, open)) = self.open.pop_first() {
            self.close(t, &open, &self.whole(t, &open), end);
        }
        let (judged, broken, span) =
            (self.verdict.judged, self.verdict.broken(), self.causes.span());
        self.verdict.doubts = self.doubts.doubts(judged, self.is_ended, &self.slack, span);
        self.verdict.cause = self.causes.most(broken, &self.header);
        self.verdict.accepting(&[])
    }

    /// Notes a line of a timestamp.
    fn take(&mut self, t: u64, line: u64, event: &Event, annotations: &Annotations) {
        let open = if let Some(open) = self.open.get_mut(&t) {
            open
        } else if self.begins(t, event) {
            self.open.entry(t).or_default()
        } else {
            self.finds(t, line, event, annotations);
            return;
        };
        let clouds = &self.header.clouds;
        let is_cloud = |p| clouds.iter().any(|cloud| u64::from(cloud.p) == p);
        // Each source has at most one output (P1).
        let most = match self.header.commit {
            Commit::Eager | Commit::Patient => 1,
            Commit::Progressive => clouds.len() + 1,
        };
        if !self.doubts.is_ordered() {
            open.lasts(event.at());
        }
        let change = open.take(line, event, annotations, is_cloud, self.records_opens, most);
        self.crowded.changes(change);
        if let Event::Input(Input::Open { at, .. }) = *event {
            self.records_opens = true;
            self.crowded.opens(Opened { at, line, t });
        }
        if open.is_large() {
            // No later line has an instant before that.
            open.compact(self.passed.saturating_sub(self.slack.greatest()));
        }
        if !open.is_queued {
            open.is_queued = true;
            let closed_from = open.closed_from(self.header.commit, &self.slack);
            self.closing.push(Reverse((closed_from, t)));
        }
    }

    /// Notes a result of a timestamp that is done, which an output may have lacked.
    fn finds(&mut self, t: u64, line: u64, event: &Event, annotations: &Annotations) {
        let Event::Input(Input::Result { at, p, .. }) = *event else { return };
        if !self.causes.finds(t, p, at) {
            return;
        }
        let mut violations = self.verdict.violations.iter_mut().rev();
        if let Some(violation) = violations.find(|violation| violation.t == Some(t)) {
            violation.story.push(format!("{line}: {}", event.annotated(annotations)));
        }
    }

    /// Returns `true` if a line makes a timestamp open that is not.
    fn begins(&self, t: u64, event: &Event) -> bool {
        match event {
            Event::Input(Input::Open { .. })
            | Event::Decision(
                Decision::Request { .. }
                | Decision::RefuseOpen { .. }
                | Decision::Emit { .. }
                | Decision::Final { .. }
                | Decision::Miss { .. },
            ) => true,
            // A timestamp that is done drops these inputs.
            Event::Input(Input::Result { .. } | Input::Fail { .. })
            | Event::Decision(Decision::Drop {
                why: DropReason::Unknown | DropReason::Superseded,
                ..
            }) => !self.ended.contains(&t),
            Event::Input(Input::Offer { .. } | Input::Tick { .. })
            | Event::Decision(
                Decision::Timer { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Hold { .. }
                | Decision::Drop { .. }
                | Decision::Cancel { .. },
            ) => false,
        }
    }
}

/// Returns the source whose clock or call stamped the line, or `None` for the operator.
const fn source(event: &Event) -> Option<u64> {
    match event {
        Event::Input(Input::Result { p, .. } | Input::Fail { p, .. })
        | Event::Decision(Decision::Request { p, .. }) => Some(*p),
        Event::Input(Input::Open { .. } | Input::Offer { .. } | Input::Tick { .. })
        | Event::Decision(
            Decision::Timer { .. }
            | Decision::RefuseOpen { .. }
            | Decision::RefuseOffer { .. }
            | Decision::Hold { .. }
            | Decision::Drop { .. }
            | Decision::Emit { .. }
            | Decision::Final { .. }
            | Decision::Miss { .. }
            | Decision::Cancel { .. },
        ) => None,
    }
}

#[cfg(test)]
mod tests;
