//! What a trace looks like beside what the judge says of it: hints for who judges it.

use std::time::Duration;

use fuseline_report::{Findings, JudgeMode};
use fuseline_traces::{Decision, Event, Input};
use humantime::format_duration;

use crate::complain::complain;

/// What is looked at while a trace is judged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JudgingHints {
    mode: JudgeMode,
    offers: u64,
    requests: u64,
    /// Requests whose deadline is no longer than what a result may be late by and pass.
    swallowed: u64,
}

impl JudgingHints {
    pub(crate) const fn new(mode: JudgeMode) -> Self {
        Self { mode, offers: 0, requests: 0, swallowed: 0 }
    }

    pub(crate) fn event(&mut self, event: &Event) {
        match event {
            Event::Input(Input::Offer { .. }) => self.offers += 1,
            Event::Decision(Decision::Request { at, due, .. }) => {
                self.requests += 1;
                let had = due.saturating_sub(*at);
                self.swallowed += u64::from(self.unnoticed().is_some_and(|late| had <= late));
            }
            Event::Input(_) | Event::Decision(_) => {}
        }
    }

    /// Warns of what makes the verdict worth little.
    pub(crate) fn warn(&self, found: &Findings) {
        let summary = found.summary();
        let (file, requests) = (summary.file, self.requests);
        if let Some(late) = self.unnoticed().filter(|_| self.swallowed > 0) {
            let late = format_duration(Duration::from_nanos(late));
            complain(format_args!(
                "warning: {file}: a result that is up to {late} late may pass (lateness and twice the tolerance), and \
                 {} of {requests} requests had no longer than that; take both as small as the clocks allow",
                self.swallowed
            ));
        }
        if self.mode.is_none() && !summary.conforms && self.offers == 0 && requests > 0 {
            complain(format_args!(
                "note: {file}: it has requests and no offers, as what several threads or machines recorded; judge that \
                 with --observed --tolerance TIME --lateness TIME"
            ));
        }
    }

    /// By how much a result may be late without being noticed, in nanoseconds; see SPEC.md, section 7.
    fn unnoticed(&self) -> Option<u64> {
        let slack = self.mode?;
        Some(slack.lateness.saturating_add(slack.tolerance.saturating_mul(2)))
    }
}
