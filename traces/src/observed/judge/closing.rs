//! Judges a timestamp, and settles an open, once no later line can change the verdict.

use std::cmp::Reverse;

use super::Judge;
use crate::observed::causes::Suspicion;
use crate::observed::gap::{Gap, Opened};
use crate::observed::open::{OpenMessageHistory, WholeMessageHistory};
use crate::observed::violation::{
    UnlocatedViolation, of_again, of_late_open, of_refused, of_story,
};
use crate::rule::Rule;
use crate::verdict::Violation;

/// The number of timestamps that broke the rules and wait for an output that may come too late.
pub(super) const OVERDUE: usize = 1024;

impl Judge {
    /// Judges the timestamps that no line can change any more.
    pub(super) fn judge_closed(&mut self) {
        while let Some(Reverse((closed_from, t))) = self.closing.peek().copied() {
            if closed_from >= self.greatest {
                break;
            }
            self.closing.pop();
            let Some(open) = self.open.get(&t) else { continue };
            let closed_from = open.closed_from(self.header.commit, &self.slack);
            if closed_from >= self.greatest {
                // The timestamp has got another line since.
                self.closing.push(Reverse((closed_from, t)));
                continue;
            }
            let Some(mut open) = self.open.remove(&t) else { continue };
            open.is_queued = false;
            let whole = self.whole(t, &open);
            if open.has_ended(self.header.commit) || self.is_not_open(t, &whole) {
                self.close(t, &open, &whole, self.greatest);
                continue;
            }
            let end = self.certain();
            let is_broken = !open.is_overdue && self.violation(t, &whole, end).is_some();
            // The final line may be missing (F9).
            if open.has_come_out() && !is_broken {
                self.close(t, &open, &whole, self.greatest);
                continue;
            }
            if is_broken {
                open.is_overdue = true;
                self.overdue.push_back(t);
            }
            self.open.insert(t, open);
            if self.overdue.len() > OVERDUE
                && let Some(t) = self.overdue.pop_front()
                && let Some(open) = self.open.remove(&t)
            {
                self.close(t, &open, &self.whole(t, &open), self.greatest);
            }
        }
    }

    /// Returns an instant that the true instants of all further lines come after.
    pub(super) fn certain(&self) -> u64 {
        let greatest = self.slack.greatest();
        self.passed.saturating_sub(greatest.saturating_mul(2).saturating_add(1))
    }

    /// Returns `true` if a timestamp is not open and has no output: it was refused, never opened,
    /// or retired before.
    fn is_not_open(&self, t: u64, whole: &WholeMessageHistory) -> bool {
        Self::is_refused(whole) || whole.is_none() || self.ended.contains(&t)
    }

    fn is_refused(whole: &WholeMessageHistory) -> bool {
        !whole.is_opened() && whole.was_refused
    }

    pub(super) fn whole<'a>(
        &self,
        t: u64,
        open: &'a OpenMessageHistory,
    ) -> WholeMessageHistory<'a> {
        let mut whole = open.whole(&self.slack, self.refused.contains(&t));
        whole.story.without_local = self.annotations.without_local;
        whole
    }

    fn violation(
        &self,
        t: u64,
        whole: &WholeMessageHistory,
        end: u64,
    ) -> Option<UnlocatedViolation> {
        of_story(t, whole, (self.header.commit, &self.annotations), &self.slack, end)
    }

    /// Judges a timestamp. `end` is the greatest instant that its trace is known to have.
    pub(super) fn close(
        &mut self,
        t: u64,
        open: &OpenMessageHistory,
        whole: &WholeMessageHistory,
        end: u64,
    ) {
        if open.is_overdue {
            self.overdue.retain(|overdue| *overdue != t);
        }
        self.crowded.changes(open.stops_waiting());
        if let Some(gaps) = &mut self.gaps {
            open.refused(t, &self.slack).into_iter().for_each(|opened| gaps.refuses(opened));
        }
        let unplaced = if self.ended.contains(&t) {
            self.again(t, whole)
        } else if Self::is_refused(whole) {
            self.refused.insert(t..=t);
            let unplaced = of_refused(t, whole);
            if unplaced.is_some() {
                self.broken.insert(t..=t);
            }
            unplaced
        } else if whole.is_none() {
            None
        } else {
            self.ended.insert(t..=t);
            self.refused.remove(t..=t);
            let unplaced = self.violation(t, whole, end);
            let is_broken = unplaced.is_some() || self.broken.contains(&t);
            self.doubts.closes(t, open, whole, &self.slack, (is_broken, end));
            if !whole.is_opened() {
                let first = whole.outputs.iter().map(|output| output.at).min();
                self.causes.closes_unopened(t, first, unplaced.is_some());
            }
            // A timestamp that breaks nothing and stays open waits for local (P7).
            if self.is_ended && !is_broken && !open.has_come_out() {
                self.doubts.leaves_unfinished(t);
            } else {
                let is_judged = whole.is_opened() && whole.is_reported_of();
                self.verdict.judged += u64::from(is_judged);
            }
            unplaced
        };
        if let Some(mut unplaced) = unplaced {
            let of_outputs = Suspicion::of_outputs(whole, unplaced.late);
            if unplaced.suspicion.is_none() || of_outputs == Some(Suspicion::StrangeOutput) {
                unplaced.suspicion = of_outputs;
            }
            if self.is_ended && unplaced.line.is_none() {
                // The output never came.
                unplaced.late = None;
            }
            self.report(t, open, unplaced);
        }
    }

    /// Judges lines for a timestamp that is done. It was retired before, or its open comes after
    /// its output.
    fn again(&mut self, t: u64, whole: &WholeMessageHistory) -> Option<UnlocatedViolation> {
        let opened = whole.story.open.filter(|_| whole.outputs.is_empty());
        let late = opened.and_then(|(at, _)| self.causes.opens_late(t, at));
        let Some((by, is_broken)) = late else { return of_again(t, whole) };
        self.doubts.opens_late(t);
        self.verdict.judged += 1;
        (!is_broken).then(|| of_late_open(t, whole, by))
    }

    /// Settles the opens that no line can change any more in a trace that has come to `greatest`,
    /// or all opens at its end (J1).
    pub(super) fn settle(&mut self, greatest: Option<u64>) {
        while let Some(gaps) = &mut self.gaps
            && let Some(opened) = gaps.next()
        {
            let Opened { line, t, .. } = opened;
            // A timestamp that is done has reported its refusals.
            let open = self.open.get(&t).map(Box::as_ref).filter(|open| open.has_open(line));
            let may_change = |open: &OpenMessageHistory| {
                greatest.is_some_and(|it| open.opens_by(&self.slack) >= it)
            };
            if open.is_some_and(may_change) {
                break;
            }
            let is_accepted =
                open.is_none_or(|open| !open.refused(t, &self.slack).contains(&opened));
            if let Some(gap) = gaps.settle(is_accepted) {
                self.tell_gap(line, Some(t), gap);
            }
        }
    }

    /// Settles the opens that came while others were open, in a trace that has certainly come to
    /// `passed` (P9).
    pub(super) fn settle_crowded(&mut self, passed: Option<u64>, end: u64) {
        while let Some(Opened { at, line, t }) = self.crowded.next(passed, &self.slack) {
            let window = usize::try_from(self.crowded.window()).unwrap_or(usize::MAX);
            let has_local = !self.annotations.without_local;
            let refused = |open: &OpenMessageHistory| {
                open.refused(t, &self.slack).iter().any(|refused| refused.line == line)
            };
            if self.open.get(&t).is_none_or(|open| refused(open)) {
                continue;
            }
            let others = self.open.iter().filter(|(other, open)| {
                **other != t
                    && !self.ended.contains(other)
                    && open.is_surely_open(at, &self.slack, has_local, end)
            });
            if others.take(window).count() < window {
                continue;
            }
            let found = format!("an open of timestamp {t} while {window} others were open");
            let expected = format!("a refusal: full, the window is {window}");
            let story = self.recent.story(t, None);
            self.causes.takes(t, None, None);
            self.violate(Violation {
                line,
                t: Some(t),
                rule: Rule::P9,
                found,
                expected,
                late: None,
                story,
            });
        }
    }

    pub(super) fn tell_gap(&mut self, line: u64, t: Option<u64>, gap: Gap) {
        let (found, expected, late) = (gap.found(), gap.expected(), Some(gap.excess()));
        let story = t.map_or_else(Vec::new, |t| self.recent.story(t, None));
        self.violate(Violation { line, t, rule: Rule::J1, found, expected, late, story });
    }

    fn report(&mut self, t: u64, open: &OpenMessageHistory, unplaced: UnlocatedViolation) {
        let UnlocatedViolation { line, rule, found, expected, late, suspicion } = unplaced;
        self.causes.takes(t, suspicion, late);
        let line = line.unwrap_or(open.line);
        let story = self.recent.story(t, None);
        self.violate(Violation { line, t: Some(t), rule, found, expected, late, story });
    }

    fn violate(&mut self, violation: Violation) {
        self.verdict.count(violation.place(), self.keeps_places, || violation);
    }
}
