//! The live view: a line on a terminal, else a plain line now and then.

use std::io::{self, IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::complain::complain;
use crate::probe::log::ProbeLog;
use crate::probe::options::Args;
use crate::probe::summary::{counted, quantile};

/// What standard error shows while the probe runs.
pub(crate) struct ProbeProgress {
    bar: Option<ProgressBar>,
    span: Option<Duration>,
}

impl ProbeProgress {
    pub(crate) fn new(args: &Args) -> Self {
        let bar = io::stderr().is_terminal().then(|| {
            let total =
                args.seconds.map(|span| u64::try_from(span.as_millis()).unwrap_or(u64::MAX));
            // The words on a line of their own, which is cut at the terminal's edge.
            let bar = if total.is_some() { "{bar:24.cyan/dim} {prefix}" } else { "{prefix}" };
            let template = format!("{bar}\n{{wide_msg}}");
            let style = ProgressStyle::with_template(&template);
            let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
            total.map_or_else(ProgressBar::no_length, ProgressBar::new).with_style(style)
        });
        Self { bar, span: args.seconds }
    }

    pub(crate) const fn period(&self) -> Duration {
        match self.bar {
            Some(_) => Duration::from_millis(200),
            None => Duration::from_secs(5),
        }
    }

    /// Shows how things are, `now` since the beginning.
    pub(crate) fn show<W: Write>(&self, log: &ProbeLog<W>, now: Duration) {
        let (time, state) = (self.time(now), state(log));
        match &self.bar {
            Some(bar) => {
                bar.set_position(u64::try_from(now.as_millis()).unwrap_or(u64::MAX));
                bar.set_prefix(time);
                bar.set_message(state);
            }
            None => complain(format!("{time}: {state}")),
        }
    }

    pub(crate) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn time(&self, now: Duration) -> String {
        let of = self.span.map_or_else(String::new, |span| format!(" of {}", span.as_secs()));
        format!("{}{of} s", now.as_secs())
    }
}

fn state<W: Write>(log: &ProbeLog<W>) -> String {
    let counts = log.figures.counts;
    let queued = log.pace.queued();
    let state = if log.pace.is_paused() { "paused, " } else { "" };
    let latest = log.latest.map_or_else(String::new, |latest| {
        format!(", latest {:.0} ms", latest.as_secs_f64() * 1e3)
    });
    let median = quantile(log.figures.answers.quantile(50));
    let pauses = counted(counts.pauses, "pause");
    let (sent, failed) = (counts.sent, counts.failed);
    format!(
        "{state}{sent} sent, {queued} unanswered, {failed} failed, {pauses}; p50 {median}{latest}"
    )
}
