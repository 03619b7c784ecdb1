//! The strict judge: compares a trace with the reference machine, decision by decision.
//!
//! [`Judge`] applies each input to the [`Reference`] machine, and compares the recorded decisions
//! with the demanded ones. The lines of a concurrent implementation have no
//! single order; [`observed`](crate::observed) judges their traces.

use std::collections::BTreeSet;
use std::io::BufRead;

use crate::annotations::{Annotations, HeaderAnnotations, ValueKeys, allowed_values, meant_value};
use crate::doubt::{Doubt, DoubtKind, DoubtfulMessages};
use crate::event::{Commit, Decision, Event, Header, Input};
use crate::read::{Events, ReadError};
use crate::reason::OfferRefusal;
use crate::recent::RecentLines;
use crate::reference::{ExpectedDecisions, Reference};
use crate::rule::Rule;
use crate::values::HeldValues;
use crate::verdict::{Verdict, Violation, ViolationPlace};

/// Judges one trace, line by line.
///
/// Every decision must be the one that the rules demand, in their order. The judge reports at most
/// one violation for an input, the first, and does not compare the other decisions about that
/// input. It continues with the next input, because the rules demand decisions from the inputs
/// alone. Its memory is bounded by the window, not by the trace's length.
#[derive(Debug)]
pub struct Judge {
    reference: Reference,
    /// The open timestamps for which a result or a failure came.
    touched: BTreeSet<u64>,
    /// The decisions that the rules demand for the input read last.
    demands: ExpectedDecisions,
    /// The number of demands that were met.
    met: usize,
    /// The input read last, with its line.
    input: Option<(u64, Input)>,
    /// `true` if a violation was reported for this input.
    differs: bool,
    /// The timestamps that the values of held results are of.
    values: HeldValues,
    annotations: HeaderAnnotations,
    recent: RecentLines,
    /// `true` if the places of all violations are wanted.
    keeps_places: bool,
    /// The latest timestamp with an output.
    answered: Option<u64>,
    verdict: Verdict,
}

/// Judges a whole trace. `file` names it in the verdict and in errors.
///
/// # Errors
/// Returns a [`ReadError`] if the trace cannot be read to its end.
pub fn judge(file: &str, trace: impl BufRead) -> Result<Verdict, ReadError> {
    let mut reader = Events::new(file, trace)?;
    let mut judge = Judge::new(file, reader.header());
    judge = judge.with_header_annotations(reader.header_annotations());
    while let Some(event) = reader.next_event()? {
        judge.annotated_line(reader.line(), &event, reader.annotations());
    }
    Ok(judge.finish())
}

impl Judge {
    /// Creates a judge of a trace with this header, its first line. `file` names the trace in the
    /// verdict.
    #[must_use]
    pub fn new(file: impl Into<String>, header: &Header) -> Self {
        Self {
            reference: Reference::new(header),
            touched: BTreeSet::new(),
            demands: ExpectedDecisions::new(),
            met: 0,
            input: None,
            differs: false,
            values: HeldValues::default(),
            annotations: HeaderAnnotations::default(),
            recent: RecentLines::default(),
            keeps_places: false,
            answered: None,
            verdict: Verdict::new(file.into()),
        }
    }

    /// Makes the judge also store the places of violations beyond the first 100, up to a million.
    #[must_use]
    pub const fn with_places(mut self) -> Self {
        self.keeps_places = true;
        self
    }

    /// Gives the judge the further keys of the trace's header. Call this before the first line.
    #[must_use]
    pub fn with_header_annotations(mut self, annotations: &HeaderAnnotations) -> Self {
        self.annotations = annotations.clone();
        self
    }

    /// Judges the next line, which has this number and no further keys.
    pub fn line(&mut self, line: u64, event: &Event) {
        self.annotated_line(line, event, &Annotations::NONE);
    }

    /// Judges the next line, which has this number and these further keys.
    pub fn annotated_line(&mut self, line: u64, event: &Event, annotations: &Annotations) {
        if let Event::Input(_) = event {
            self.close("no decision; the next input follows");
        }
        self.recent.push(line, event, annotations);
        self.verdict.lines = line;
        match event {
            Event::Input(input) => self.demand(line, input, annotations.value()),
            Event::Decision(decision) if !self.differs => {
                self.compare(decision, annotations.value());
            }
            Event::Decision(_) => {}
        }
    }

    /// Removes the listed violations from the verdict and returns them. The verdict then lists up
    /// to 100 further ones.
    #[must_use]
    pub fn take_violations(&mut self) -> Vec<Violation> {
        std::mem::take(&mut self.verdict.violations)
    }

    /// Returns the verdict so far. Decisions that the last input still lacks do not count yet.
    #[must_use]
    pub const fn so_far(&self) -> &Verdict {
        &self.verdict
    }

    /// Ends the trace and returns the verdict.
    #[must_use]
    pub fn finish(mut self) -> Verdict {
        self.close("no decision; the trace ends");
        self.verdict.judged += self.touched.len() as u64;
        // A timestamp that is open without a timer waits for local (P7).
        let answered = self.answered;
        let is_passed = |t: u64| answered.is_some_and(|answered| t < answered);
        let waiting = self.reference.waiting().filter(|(t, has_timer)| !has_timer && is_passed(*t));
        let mut unanswered = DoubtfulMessages::default();
        waiting.for_each(|(t, _)| unanswered.push(t));
        self.in_doubt(unanswered, DoubtKind::Unanswered)
    }

    /// Ends the trace of a run that is known to have ended, and returns the verdict. Each timer
    /// that is left should have fired at its due instant (A44).
    #[must_use]
    pub fn finish_ended(mut self) -> Verdict {
        self.close("no decision; the trace ends");
        while let Some(at) = self.reference.next_due() {
            self.demand(self.verdict.lines, &Input::Tick { at }, ValueKeys::default());
            self.close("no decision; the run has ended");
        }
        // A timestamp that is open without a timer waits for local (P7).
        let mut unfinished = DoubtfulMessages::default();
        self.reference.waiting().for_each(|(t, _)| unfinished.push(t));
        self.in_doubt(unfinished, DoubtKind::Unfinished)
    }

    /// Returns the verdict with a doubt about these messages.
    fn in_doubt(mut self, messages: DoubtfulMessages, kind: DoubtKind) -> Verdict {
        let doubts = [Doubt::unjudged(self.verdict.judged), messages.doubt(kind)];
        self.verdict.doubts = doubts.into_iter().flatten().collect();
        self.verdict.accepting(&[])
    }

    /// Applies an input to the reference machine. `value` has the keys that concern its value.
    fn demand(&mut self, line: u64, input: &Input, value: ValueKeys) {
        self.demands.clear();
        self.met = 0;
        self.differs = false;
        self.input = Some((line, *input));
        self.reference.apply(input, &mut self.demands);
        if !self.values.is_idle(value) {
            self.values.apply(input, value, self.demands.iter().map(|(decision, _)| decision));
        }
        for (decision, _) in &self.demands {
            match decision {
                // Better outputs may follow (F9).
                Decision::Emit { t, .. } if self.reference.commit() == Commit::Progressive => {
                    self.answered = self.answered.max(Some(*t));
                }
                Decision::Emit { t, .. } | Decision::Final { t, .. } | Decision::Miss { t, .. } => {
                    self.answered = self.answered.max(Some(*t));
                    self.verdict.judged += 1;
                    self.touched.remove(t);
                }
                Decision::Timer { .. }
                | Decision::RefuseOpen { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Request { .. }
                | Decision::Hold { .. }
                | Decision::Drop { .. }
                | Decision::Cancel { .. } => {}
            }
        }
        if let Input::Result { t, .. } | Input::Fail { t, .. } = input
            && self.reference.is_open(*t)
        {
            self.touched.insert(*t);
        }
    }

    /// Compares a decision with the one that is demanded next. `value` has the keys that concern
    /// its value.
    fn compare(&mut self, found: &Decision, value: ValueKeys) {
        let demand = self.demands.get(self.met).copied();
        if demand.is_some_and(|(expected, _)| expected == *found) {
            self.met += 1;
            if !self.values.is_idle(value) {
                self.compare_value(found, value);
            }
            return;
        }
        let lack = match self.input {
            None => "an input first",
            Some(_) if self.met == 0 => "no decision",
            Some(_) => "no further decision",
        };
        self.differ(Some(*found), demand, lack);
    }

    /// Checks the value of an emit. It repeats the keys of the result that it sends, is not too
    /// old, and is meant for this timestamp (D2, D18).
    fn compare_value(&mut self, found: &Decision, value: ValueKeys) {
        let Decision::Emit { t, p, .. } = *found else { return };
        let written = |value: ValueKeys| Event::Decision(*found).annotated(&value.into());
        let expected = self.values.sent(found);
        let allowed = self.annotations.values_of(t, p);
        let ValueKeys { of, meant_for } = value;
        if of != expected.of {
            self.violate(Some(t), Rule::D2, || (written(value), written(expected)));
        } else if of.is_some_and(|of| of < allowed.0 || of > allowed.1) {
            self.violate(Some(t), Rule::D2, || (written(value), allowed_values(allowed)));
        } else if meant_for != expected.meant_for {
            self.violate(Some(t), Rule::D18, || (written(value), written(expected)));
        } else if meant_for.is_some_and(|it| it != t) {
            self.violate(Some(t), Rule::D18, || (written(value), meant_value(t)));
        }
    }

    /// Ends the last input, whose demands must all have been met.
    fn close(&mut self, lack: &str) {
        let demand = self.demands.get(self.met).copied();
        if demand.is_some() && !self.differs {
            self.differ(None, demand, lack);
        }
    }

    /// Reports a violation. `lack` replaces the found or the demanded decision if that one is
    /// missing.
    fn differ(&mut self, found: Option<Decision>, demand: Option<(Decision, Rule)>, lack: &str) {
        let (t, rule) = self.blame(found, demand);
        let reported = |reported: Option<Decision>| {
            reported.map_or(lack.into(), |reported| reported.to_string())
        };
        let expected = demand.map(|(expected, _)| expected);
        self.violate(t, rule, || (reported(found), reported(expected)));
    }

    /// Reports a violation at the last line, with what was found and what was expected.
    fn violate(&mut self, t: Option<u64>, rule: Rule, reported: impl FnOnce() -> (String, String)) {
        self.differs = true;
        let line = self.verdict.lines;
        self.verdict.count(ViolationPlace { line, t, rule }, self.keeps_places, || {
            let (found, expected) = reported();
            let cause = self.input.map(|(line, _)| line);
            let story = t.map_or_else(Vec::new, |t| self.recent.story(t, cause));
            Violation { line, t, rule, found, expected, late: None, story }
        });
    }

    /// Returns the timestamp that a difference is about, and the rule that it breaks.
    fn blame(
        &self,
        found: Option<Decision>,
        demand: Option<(Decision, Rule)>,
    ) -> (Option<u64>, Rule) {
        let (t, rule) = match (found, demand) {
            // The timestamp was forwarded or missed before (P1).
            (Some(found), _) if self.is_second_end(&found) => (found.t(), Rule::P1),
            // The right decision was made at another instant (F0).
            (Some(found), Some((expected, _))) if found.redated(expected.at()) == expected => {
                (found.t(), Rule::F0)
            }
            // The timer is not due, or it is not its turn (F5).
            (Some(Decision::Timer { t, .. }), _) => (t, Rule::F5),
            // The gate was shut when it should have been open (F2g).
            (
                Some(Decision::RefuseOffer { t, why: OfferRefusal::Queue, .. }),
                Some((Decision::Request { .. }, _)) | None,
            ) => (t, Rule::F2g),
            (_, Some((expected, rule))) => (expected.t(), rule),
            (Some(found), None) => (found.t(), self.rule_of(&found)),
            // There is no difference in this case.
            (None, None) => return (None, Rule::F0),
        };
        (Some(t), rule)
    }

    /// Returns the rule that would demand this decision, which is not demanded.
    fn rule_of(&self, found: &Decision) -> Rule {
        let input = self.input.map(|(_, input)| input);
        let of_result = matches!(input, Some(Input::Result { .. }));
        let of_failure = matches!(input, Some(Input::Fail { .. }));
        let is_progressive = self.reference.commit() == Commit::Progressive;
        match found {
            Decision::Timer { .. } => Rule::F5,
            Decision::RefuseOpen { .. } => Rule::F1,
            Decision::RefuseOffer { .. } | Decision::Request { .. } => Rule::F2,
            Decision::Hold { .. } | Decision::Drop { .. } if of_failure => Rule::F4,
            Decision::Hold { .. } | Decision::Drop { .. } => Rule::F3,
            Decision::Emit { .. } | Decision::Cancel { .. } if is_progressive => Rule::F9,
            Decision::Emit { .. } if of_result => Rule::F3,
            Decision::Emit { .. } | Decision::Miss { .. } => Rule::F6,
            Decision::Cancel { .. } => Rule::F7,
            Decision::Final { .. } => Rule::F9,
        }
    }

    /// Returns `true` if the decision sends or ends a timestamp that ended before or, under
    /// progressive, sends no better result than before (P1).
    fn is_second_end(&self, found: &Decision) -> bool {
        let is_progressive = self.reference.commit() == Commit::Progressive;
        let is_output = |decision: &Decision| {
            matches!(
                decision,
                Decision::Emit { .. } | Decision::Final { .. } | Decision::Miss { .. }
            )
        };
        let excludes = |before: &Decision| match (before, found) {
            (Decision::Emit { p: before, .. }, Decision::Emit { p, .. }) if is_progressive => {
                p <= before
            }
            (Decision::Emit { .. }, Decision::Final { .. }) if is_progressive => false,
            _ => is_output(before),
        };
        let before = self.recent.iter().rev().skip(1);
        is_output(found)
            && before.into_iter().any(|(_, event)| match event {
                Event::Decision(decision) => decision.t() == found.t() && excludes(decision),
                Event::Input(_) => false,
            })
    }
}
