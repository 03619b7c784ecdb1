//! Shows the progress of a probe.

use std::io::Write;
use std::time::Duration;

use crate::duration::{short, whole};
use crate::percentile::shown;
use crate::probe::log::ProbeLog;
use crate::probe::options::Args;
use crate::progress::ProgressLine;
use crate::table::counted;

/// The progress on standard error while the probe runs.
pub(crate) struct ProbeProgress {
    line: ProgressLine,
    span: Option<Duration>,
}

impl ProbeProgress {
    pub(crate) fn new(args: &Args) -> Self {
        Self { line: ProgressLine::new(args.span), span: args.span }
    }

    pub(crate) const fn period(&self) -> Duration {
        self.line.period()
    }

    /// Shows how things are, `now` since the beginning.
    pub(crate) fn show<W: Write>(&self, log: &ProbeLog<W>, now: Duration) {
        self.line.show(now, time(self.span, now), state(log));
    }

    pub(crate) fn end(&self) {
        self.line.end();
    }
}

fn time(span: Option<Duration>, now: Duration) -> String {
    let of = span.map_or_else(String::new, |span| format!(" of {}", span.as_secs()));
    format!("{}{of} s", now.as_secs())
}

fn state<W: Write>(log: &ProbeLog<W>) -> String {
    let counts = log.figures.counts;
    let queued = log.pace.queued();
    let state = if log.pace.is_paused() { "paused, " } else { "" };
    let latest =
        log.latest.map_or_else(String::new, |latest| format!(", latest {}", whole(latest)));
    let median = shown(log.figures.answers.quantile(50), short);
    let pauses = counted(counts.pauses, "pause");
    let (sent, failed) = (counts.sent, counts.failed);
    format!(
        "{state}{sent} sent, {queued} unanswered, {failed} failed, {pauses}; p50 {median}{latest}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::row::SlotRows;

    #[test]
    fn the_state_is_that_of_the_log() {
        let ms = Duration::from_millis;
        let rows = SlotRows::new(Vec::new()).unwrap();
        let mut log = ProbeLog::new(rows, ms(10), (Duration::ZERO, ms(100)));
        assert_eq!(state(&log), "0 sent, 0 unanswered, 0 failed, 0 pauses; p50 –");
        for slot in 0..32 {
            log.slot(ms(10 * slot), ms(10 * slot), 0);
        }
        log.ended(0, Some(ms(20)), ms(320));
        log.ended(1, Some(ms(40)), ms(330));
        log.ended(2, None, ms(330));
        let paused = "paused, 31 sent, 28 unanswered, 1 failed, 1 pause; p50 20 ms, latest 40 ms";
        assert_eq!(state(&log), paused);
    }

    #[test]
    fn the_time_is_of_the_whole_where_that_is_known() {
        let time =
            |span: Option<u64>| time(span.map(Duration::from_secs), Duration::from_millis(5900));
        assert_eq!([time(Some(60)), time(None)], ["5 of 60 s", "5 s"]);
    }
}
