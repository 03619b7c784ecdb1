//! Finds one cause of many violations that does not lie in the operator. It may be a clock that is
//! off, a log that was written twice, or a log that restarts.

use std::collections::BTreeMap;

use super::doubts::nanos;
use super::open::WholeMessageHistory;
use crate::event::{Decision, Event, Header, Input};

/// A day in ns. No operator lets so much time pass between two lines on its own.
const DAY: u64 = 86_400_000_000_000;
/// The number of outputs whose result is still looked for, and the number of clock differences that
/// are stored.
const SAMPLES: usize = 1024;
/// Time zones differ by multiples of this, in ns. Clocks of one host differ by less.
const ZONE: u64 = 900_000_000_000;
const ZONES: u64 = 54_000_000_000_000;
const DRIFT: u64 = 5_000_000_000;

/// A possible cause of a violation.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Suspicion {
    /// A line occurs twice in the trace, for the first time here.
    Repeated(Option<u64>),
    /// A timestamp is opened again.
    OpenedAgain,
    /// A result of `p` is recorded `by` ns after an output that has it.
    ResultAfterOutput { p: u64, by: u64 },
    /// A result of `p` is missing when an output that has it is recorded.
    ResultMissing { p: u64, at: u64 },
    /// A result of `p` is recorded `by` ns before its request.
    ResultBeforeRequest { p: u64, by: u64 },
    /// A timestamp that was never opened has an output.
    StrangeOutput,
    /// A timestamp that was opened has no output.
    NoOutput,
    /// An output is `by` ns too late.
    LateOutput { by: u64 },
}

/// Collects the possible causes of violations.
#[derive(Clone, Debug, Default)]
pub(super) struct CauseTracker {
    repeated: u64,
    first_repeated: Option<u64>,
    opened_again: u64,
    /// The first line at which timestamps restart, with its timestamp.
    restart: Option<(u64, u64)>,
    /// The timestamp opened last.
    last_open: Option<u64>,
    after: BTreeMap<u64, Vec<u64>>,
    before: BTreeMap<u64, Vec<u64>>,
    /// The outputs whose results did not come, with the instants at which they were recorded.
    missing: BTreeMap<(u64, u64), u64>,
    /// The first line: its number, timestamp and instant.
    first: Option<(u64, Option<u64>, u64)>,
    /// The least instant.
    least: u64,
    /// The line with the greatest instant, that instant, and the greatest one before it.
    greatest: Option<(u64, u64, Option<u64>)>,
    /// The number of lines when the greatest instant first grew by more than a day.
    first_jump: Option<(u64, u64)>,
    lines: u64,
    /// The number of violations of the first line's timestamp.
    of_first: u64,
    /// The delays of outputs that were more than half a day late.
    very_late: Vec<u64>,
    /// The delays of outputs.
    late: Vec<u64>,
    /// The times by which outputs come before the opens of their messages.
    early: Vec<u64>,
    /// The messages without an open: the first output of each, and `true` if it breaks a rule.
    unopened: BTreeMap<u64, (u64, bool)>,
    /// The number of outputs with a timestamp that was never opened that break a rule, and the
    /// first such timestamp.
    strange: (u64, Option<u64>),
    /// The number of messages without an output that break a rule.
    no_output: u64,
    /// `true` if there is any output in the whole trace.
    has_output: bool,
}

impl Suspicion {
    /// Returns the possible cause of these outputs, or of their absence.
    pub(super) fn of_outputs(whole: &WholeMessageHistory, late: Option<u64>) -> Option<Self> {
        let has_output = !(whole.outputs.is_empty() && whole.finals.is_empty());
        match (whole.is_opened(), has_output) {
            (false, true) => Some(Self::StrangeOutput),
            (true, false) => Some(Self::NoOutput),
            (true, true) => late.map(|by| Self::LateOutput { by }),
            (false, false) => None,
        }
    }
}

impl CauseTracker {
    /// Returns `true` if the event opens an earlier timestamp than the last open did.
    pub(super) fn goes_back(&self, event: &Event) -> bool {
        match *event {
            Event::Input(Input::Open { t, .. }) => self.last_open.is_some_and(|last| t < last),
            Event::Input(_) | Event::Decision(_) => false,
        }
    }

    /// Notes a line of the trace. `was_opened` says whether it returns to a timestamp that was
    /// opened.
    pub(super) fn sees(&mut self, line: u64, event: &Event, was_opened: bool) {
        let at = event.at();
        self.lines += 1;
        match &mut self.greatest {
            None => {
                self.first = Some((line, event.t(), at));
                self.least = at;
                self.greatest = Some((line, at, None));
            }
            Some((last, greatest, before)) if at > *greatest => {
                if at - *greatest > DAY && self.first_jump.is_none() {
                    self.first_jump = Some((self.lines, at - *greatest));
                }
                (*last, *before, *greatest) = (line, Some(*greatest), at);
            }
            Some(_) => self.least = self.least.min(at),
        }
        if let Event::Input(Input::Open { t, .. }) = *event {
            if was_opened && self.restart.is_none() {
                self.restart = Some((line, t));
            }
            self.last_open = Some(t);
        }
        if let Event::Decision(
            Decision::Emit { .. } | Decision::Final { .. } | Decision::Miss { .. },
        ) = event
        {
            self.has_output = true;
        }
    }

    /// Returns the least and the greatest instant, if there is a line.
    pub(super) fn span(&self) -> Option<(u64, u64)> {
        self.greatest.map(|(_, greatest, _)| (self.least, greatest))
    }

    /// Notes a message without an open that is done.
    pub(super) fn closes_unopened(&mut self, t: u64, output: Option<u64>, is_broken: bool) {
        if let Some(at) = output
            && self.unopened.len() < SAMPLES
        {
            self.unopened.insert(t, (at, is_broken));
        }
    }

    /// Notes that a message that was done without an open is opened at `at` after all. Returns how
    /// long before that its output came, and `true` if the output broke a rule.
    pub(super) fn opens_late(&mut self, t: u64, at: u64) -> Option<(u64, bool)> {
        let (output, is_broken) = self.unopened.remove(&t)?;
        let by = at.saturating_sub(output);
        if self.early.len() < SAMPLES {
            self.early.push(by);
        }
        self.strange.0 = self.strange.0.saturating_sub(u64::from(is_broken));
        Some((by, is_broken))
    }

    /// Notes a violation.
    pub(super) fn takes(&mut self, t: u64, suspicion: Option<Suspicion>, late: Option<u64>) {
        self.of_first += u64::from(self.first.is_some_and(|(_, first, _)| first == Some(t)));
        if let Some(late) = late.filter(|late| *late > DAY / 2)
            && self.very_late.len() < SAMPLES
        {
            self.very_late.push(late);
        }
        match suspicion {
            Some(Suspicion::Repeated(line)) => {
                self.repeated += 1;
                self.first_repeated = self.first_repeated.or(line);
            }
            Some(Suspicion::OpenedAgain) => self.opened_again += 1,
            Some(Suspicion::ResultAfterOutput { p, by }) => sample(&mut self.after, p, by),
            Some(Suspicion::ResultBeforeRequest { p, by }) => sample(&mut self.before, p, by),
            Some(Suspicion::StrangeOutput) => {
                self.strange.0 += 1;
                self.strange.1 = self.strange.1.or(Some(t));
            }
            Some(Suspicion::NoOutput) => self.no_output += 1,
            Some(Suspicion::LateOutput { by }) if self.late.len() < SAMPLES => self.late.push(by),
            Some(Suspicion::ResultMissing { p, at }) if self.missing.len() < SAMPLES => {
                self.missing.insert((t, p), at);
            }
            None | Some(Suspicion::ResultMissing { .. } | Suspicion::LateOutput { .. }) => {}
        }
    }

    /// Notes a result of a timestamp that is done. Returns `true` if an earlier output lacked this
    /// result.
    pub(super) fn finds(&mut self, t: u64, p: u64, at: u64) -> bool {
        if self.missing.is_empty() {
            return false;
        }
        let Some(output) = self.missing.remove(&(t, p)) else { return false };
        let by = at.saturating_sub(output);
        sample(&mut self.after, p, by);
        by > 0
    }

    /// Returns the advice for a line that is out of order, which reads `event`.
    pub(super) fn remedy(&self, line: u64, event: &Event, was_opened: bool) -> String {
        let at = event.at();
        if let Some((off, greatest, before)) = self.greatest
            && greatest.saturating_sub(at) > DAY
        {
            let jump = before.map_or(0, |before| greatest - before);
            return if jump > DAY {
                format!(
                    "line {off} is {} later than every line before it; is its stamp right?",
                    nanos(jump)
                )
            } else {
                let by = nanos(greatest - at);
                format!("line {line} is {by} earlier than the others; is its stamp right?")
            };
        }
        if was_opened && matches!(event, Event::Input(Input::Open { .. })) {
            return "the log restarts here; judge each run by itself".to_owned();
        }
        "sort the lines, or give a greater tolerance".to_owned()
    }

    /// Returns the one cause that explains most of these violations, if there is one.
    pub(super) fn most(self, violations: u64, header: &Header) -> Option<String> {
        let name = |p: u64| {
            let cloud = header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
            let named = cloud.and_then(|cloud| cloud.name.clone());
            if p == 0 { "local".to_owned() } else { named.unwrap_or_else(|| format!("p {p}")) }
        };
        let mut causes = vec![self.far_end(), self.far_start()];
        if let Some((line, t)) = self.restart {
            let text = format!(
                "the log restarts at line {line}, where timestamp {t} is opened again; judge each run by itself"
            );
            causes.push(Some((self.opened_again, text)));
        }
        let line =
            self.first_repeated.map_or_else(String::new, |line| format!(", line {line} first"));
        let text =
            format!("lines stand twice in the trace{line}; was the log written or exported twice?");
        causes.push(Some((self.repeated, text)));
        let clocks = [
            (self.after, "after the outputs that contain them", "ahead"),
            (self.before, "before their requests", "behind"),
        ];
        for (samples, than, is) in clocks {
            causes.extend(samples.into_iter().map(|(p, by)| {
                let (explained, by) = constant(by)?;
                // A message's open is local's request.
                let than =
                    if p == 0 { than.replace("requests", "messages") } else { than.to_owned() };
                let about = if is_zone(by) {
                    "; does its clock use another time zone?".to_owned()
                } else {
                    format!("; is its clock {is}?")
                };
                Some((
                    explained,
                    format!("results of {} come {} {than}{about}", name(p), nanos(by)),
                ))
            }));
        }
        causes.push(of_early(self.early));
        causes.push(of_late(self.late));
        causes.push(of_outputs(self.has_output, self.strange, self.no_output));
        let most = causes.into_iter().flatten().max_by_key(|(explained, _)| *explained);
        let (explained, text) = most.filter(|(explained, _)| explained * 2 > violations)?;
        Some(format!("{text} ({explained} of {violations} violations)"))
    }

    /// Explains violations by a last line that is far from all others, so that everything open by
    /// then seems far too late.
    fn far_end(&self) -> Option<(u64, String)> {
        let (line, greatest, before) = self.greatest?;
        let jump = greatest - before?;
        if jump < DAY || self.lines < 3 {
            return None;
        }
        let explained = self.very_late.iter().filter(|late| **late > jump / 2).count() as u64;
        Some((explained, format!("line {line} is {} off; is its stamp right?", nanos(jump))))
    }

    /// Explains violations by a first line that is far from all others.
    fn far_start(&self) -> Option<(u64, String)> {
        let ((line, ..), (2, jump)) = (self.first?, self.first_jump?) else { return None };
        Some((self.of_first, format!("line {line} is {} off; is its stamp right?", nanos(jump))))
    }
}

/// Returns `true` if two clocks differ as two time zones do.
const fn is_zone(by: u64) -> bool {
    let is_near = ZONE - by % ZONE <= DRIFT || by % ZONE <= DRIFT;
    is_near && by > ZONE && by <= ZONES + DRIFT
}

fn of_early(samples: Vec<u64>) -> Option<(u64, String)> {
    let (explained, by) = constant(samples)?;
    let what =
        if is_zone(by) { "do they use another time zone?" } else { "is their clock behind?" };
    let text = format!("outputs come {} before the opens of their messages; {what}", nanos(by));
    Some((explained, text))
}

/// Explains outputs that are late by whole quarters of an hour, which is hardly the operator's own
/// delay.
fn of_late(samples: Vec<u64>) -> Option<(u64, String)> {
    let (explained, by) = constant(samples).filter(|(_, by)| is_zone(*by))?;
    Some((explained, format!("outputs come {} late; do they use another time zone?", nanos(by))))
}

/// Explains outputs that are missing, or that have timestamps without a message.
fn of_outputs(
    has_output: bool,
    (strange, first): (u64, Option<u64>),
    missing: u64,
) -> Option<(u64, String)> {
    if !has_output {
        let text = "the trace has no output at all; does the log have outputs under another name?";
        return (missing > 1).then(|| (missing, text.to_owned()));
    }
    let first = first.filter(|_| strange > 1)?;
    let text = format!(
        "outputs have timestamps that no open has, {first} first; do they have the timestamps of \
         their messages?"
    );
    Some((strange + missing.min(strange), text))
}

fn sample(samples: &mut BTreeMap<u64, Vec<u64>>, p: u64, by: u64) {
    let samples = samples.entry(p).or_default();
    if samples.len() < SAMPLES {
        samples.push(by);
    }
}

/// Returns the median and the number of samples near it, if most samples lie within half of it or
/// 20 ms.
fn constant(mut samples: Vec<u64>) -> Option<(u64, u64)> {
    samples.sort_unstable();
    let median = *samples.get(samples.len() / 2)?;
    let near = |by: &&u64| by.abs_diff(median) <= (median / 2).clamp(1_000, 20_000_000);
    let explained = samples.iter().filter(near).count() as u64;
    (median > 0).then_some((explained, median))
}
