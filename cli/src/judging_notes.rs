//! Notes about a trace besides its verdict, for the user who judges it.

use fuseline_report::JudgeMode;
use fuseline_traces::{Decision, Event, Input, Verdict};

use crate::diagnostics::print_line;

/// The facts that are noted while a trace is judged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JudgingNotes {
    mode: JudgeMode,
    offers: u64,
    requests: u64,
}

impl JudgingNotes {
    pub(crate) const fn new(mode: JudgeMode) -> Self {
        Self { mode, offers: 0, requests: 0 }
    }

    pub(crate) fn event(&mut self, event: &Event) {
        match event {
            Event::Input(Input::Offer { .. }) => self.offers += 1,
            Event::Decision(Decision::Request { .. }) => self.requests += 1,
            Event::Input(_) | Event::Decision(_) => {}
        }
    }

    /// Warns of everything that makes the verdict worth little.
    pub(crate) fn warn(&self, found: &Verdict) {
        let (file, requests) = (&found.file, self.requests);
        if self.mode.is_none() && found.broken() > 0 && self.offers == 0 && requests > 0 {
            print_line(format_args!(
                "note: {file}: it has requests but no offers, like a recording of several threads or hosts; judge it with \
                 --observed --tolerance TIME --lateness TIME"
            ));
        }
    }
}
