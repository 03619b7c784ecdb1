//! Shows the progress of a run.

use std::path::Path;
use std::time::Duration;

use fuseline_tokio::Tally;
use tokio::time::Instant;

use crate::duration::secs;
use crate::progress::ProgressLine;
use crate::run::plan::RunPlan;
use crate::table::counted;

/// The progress on standard error while the camera runs.
pub(crate) struct RunProgress<'a> {
    plan: &'a RunPlan,
    began: Instant,
    line: ProgressLine,
    /// `true` if the trace's end was reported.
    is_warned: bool,
}

impl<'a> RunProgress<'a> {
    pub(crate) fn new(plan: &'a RunPlan) -> Self {
        let line = ProgressLine::new(Some(plan.span));
        Self { plan, began: Instant::now(), line, is_warned: false }
    }

    pub(crate) const fn period(&self) -> Duration {
        self.line.period()
    }

    /// Shows the current state.
    pub(crate) fn show(&mut self, tally: &Tally) {
        self.warn(tally);
        let elapsed = self.began.elapsed();
        if let Some((time, state)) = self.shown(elapsed, tally) {
            self.line.show(elapsed, time, state);
        }
    }

    pub(crate) fn end(&self) {
        self.line.end();
    }

    /// Reports once that the trace has ended before its run.
    fn warn(&mut self, tally: &Tally) {
        let Some(why) = tally.recording_error.as_deref().filter(|_| !self.is_warned) else {
            return;
        };
        self.is_warned = true;
        let trace = &self.plan.trace;
        let why = recording_error(trace, why);
        self.line.print(format!("warning: {}: {why}", trace.display()));
    }

    /// Returns the time and the state, or `None` at the beginning.
    fn shown(&self, elapsed: Duration, tally: &Tally) -> Option<(String, String)> {
        if elapsed.is_zero() || tally.messages == 0 {
            return None;
        }
        Some((self.time(elapsed), state(tally)))
    }

    fn time(&self, elapsed: Duration) -> String {
        format!("{} s of {}", elapsed.min(self.plan.span).as_secs(), secs(self.plan.span))
    }
}

/// Describes all messages that came, as the tables count them, and the sources of the forwarded
/// results.
fn state(tally: &Tally) -> String {
    let refused: u64 = tally.refused.values().sum();
    let messages = counted(tally.messages + refused, "message");
    let sources = tally.sources.iter();
    let forwarded = sources.map(|source| format!("{} {}", source.source, source.forwarded()));
    let forwarded = forwarded.collect::<Vec<_>>().join(", ");
    format!("{messages}, {} missed, {refused} refused; forwarded {forwarded}", tally.missed)
}

/// Returns the reason why the trace ends before its run, without the trace's name and the system's
/// error number.
pub(crate) fn recording_error(trace: &Path, why: &str) -> String {
    let name = trace.display().to_string();
    let why = why.strip_prefix(&name).and_then(|why| why.strip_prefix(": ")).unwrap_or(why);
    why.split(" (os error").next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use fuseline_traces::OpenRefusal;

    use super::*;
    use crate::run::table::tests::plan;

    #[test]
    fn a_line_has_the_time_and_all_that_came() {
        let plan = plan(&["--for", "30s"]);
        let progress = RunProgress::new(&plan);
        let refused = [(OpenRefusal::Full, 2), (OpenRefusal::Order, 1)].into();
        let tally = Tally { messages: 5, missed: 4, refused, ..Tally::default() };
        let shown = |ms, tally: &Tally| progress.shown(Duration::from_millis(ms), tally);
        let (time, state) = shown(2900, &tally).unwrap();
        assert_eq!(time, "2 s of 30 s");
        assert_eq!(state, "8 messages, 4 missed, 3 refused; forwarded ");
        assert_eq!(shown(31_000, &tally).unwrap().0, "30 s of 30 s");
        assert_eq!([shown(0, &tally), shown(2900, &Tally::default())], [None, None]);
    }

    #[test]
    fn a_trace_that_ended_is_reported_without_its_name_and_the_systems_number() {
        let why = |why| recording_error(Path::new("t.jsonl"), why);
        assert_eq!(why("t.jsonl: no space left (os error 28)"), "no space left");
        assert_eq!(why("t.jsonlx: no space left"), "t.jsonlx: no space left");
        assert_eq!(why("it is full"), "it is full");
    }
}
