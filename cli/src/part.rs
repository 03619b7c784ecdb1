//! The options that choose a part of a trace.

use std::time::Duration;

use fuseline_report::PartFilter;
use fuseline_report::TraceRange;
use fuseline_traces::Event;
use fuseline_traces::nanos;
use humantime::format_duration;
use thiserror::Error;

use crate::duration::{ANY, duration};
use crate::fault::Fault;

/// Selects messages of a trace. All of the trace is read.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct PartOptions {
    /// Only messages that begin at this time after the trace's first instant, such as 90s, or
    /// later.
    #[arg(long, value_name = "TIME", value_parser = time, allow_hyphen_values = true)]
    from: Option<Duration>,
    /// Only messages that begin before this time after the trace's first instant, such as 2m.
    #[arg(long, value_name = "TIME", value_parser = time, allow_hyphen_values = true)]
    to: Option<Duration>,
    /// Only messages with timestamps from FIRST to LAST, both included; either end may be omitted.
    #[arg(long, value_name = "FIRST..LAST", value_parser = timestamps)]
    timestamps: Option<(u64, u64)>,
}

/// No message can be meant.
#[derive(Debug, Error)]
#[error("--from {} is not before --to {}: no message begins between them", format_duration(*.from), format_duration(*.to))]
struct EmptyPartError {
    from: Duration,
    to: Duration,
}

impl PartOptions {
    /// Selects all messages of the trace.
    pub(crate) const fn all() -> Self {
        Self { from: None, to: None, timestamps: None }
    }

    /// Returns the part, if it is not the whole.
    pub(crate) fn part(&self) -> Result<Option<TraceRange>, Fault> {
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from >= to
        {
            return Err(Fault::own(EmptyPartError { from, to }));
        }
        let (first, last) = self.timestamps.unwrap_or((0, u64::MAX));
        let (from, to) = (self.from.map_or(0, nanos), self.to.map_or(u64::MAX, nanos));
        let part = TraceRange { from, to, first, last };
        Ok((part != TraceRange::default()).then_some(part))
    }

    /// Selects the events of a part of a trace, from its first one on.
    pub(crate) fn filter(&self) -> Result<impl FnMut(&Event) -> bool + use<>, Fault> {
        let mut filter = self.part()?.map(PartFilter::new);
        Ok(move |event: &Event| filter.as_mut().is_none_or(|filter| filter.takes(event)))
    }
}

fn time(text: &str) -> Result<Duration, String> {
    duration(text, "90s", &ANY)
}

fn timestamps(text: &str) -> Result<(u64, u64), &'static str> {
    let wrong = "write FIRST..LAST, such as 100..200, 100.. or a single one";
    let number = |text: &str, none: u64| match text {
        "" => Ok(none),
        text => text.parse().map_err(|_| wrong),
    };
    let (first, last) = if let Some((first, last)) = text.split_once("..") {
        (number(first, 0)?, number(last, u64::MAX)?)
    } else {
        let only = text.parse().map_err(|_| wrong)?;
        (only, only)
    };
    (first <= last).then_some((first, last)).ok_or(wrong)
}
