//! Either judge, line by line.

use std::io::BufRead;
use std::time::Duration;

use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{Event, Header, Judge, Reader};

use crate::fault::Fault;
use crate::verdict::{Breach, Found};

/// How a trace is judged: strictly, or as observed within this.
pub(crate) type Manner = Option<Slack>;

/// The options that tell the manner.
#[derive(clap::Args)]
pub(crate) struct How {
    /// Judge what a concurrent implementation recorded, each timestamp by itself.
    #[arg(long, requires = "tolerance", requires = "lateness")]
    observed: bool,
    /// How far a recorded instant may be off either way, such as 2ms or 500us.
    #[arg(long, value_name = "TIME", requires = "observed", value_parser = humantime::parse_duration)]
    tolerance: Option<Duration>,
    /// How late a timer may be served, and an output be put out, such as 5ms.
    #[arg(long, value_name = "TIME", requires = "observed", value_parser = humantime::parse_duration)]
    lateness: Option<Duration>,
}

/// A judge of one trace.
pub(crate) enum Judging {
    Strict(Judge),
    Observed(observed::Judge),
}

/// Judges a whole trace.
pub(crate) fn judge(manner: Manner, name: &str, trace: impl BufRead) -> Result<Found, Fault> {
    Ok(match manner {
        None => Found::Strict(fuseline_traces::judge(name, trace)?),
        Some(slack) => Found::Observed(observed::judge(name, slack, trace)?),
    })
}

/// Reads a trace's header for the judge of that manner.
pub(crate) fn reader<R: BufRead>(manner: Manner, name: &str, trace: R) -> Result<Reader<R>, Fault> {
    let read = if manner.is_none() { Reader::new } else { Reader::observed };
    Ok(read(name, trace)?)
}

impl How {
    pub(crate) fn manner(&self) -> Manner {
        let nanos = |time: Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let (tolerance, lateness) = (nanos(self.tolerance?), nanos(self.lateness?));
        Some(Slack { tolerance, lateness })
    }
}

impl Judging {
    pub(crate) fn new(manner: Manner, name: &str, header: &Header) -> Self {
        match manner {
            None => Self::Strict(Judge::new(name, header)),
            Some(slack) => Self::Observed(observed::Judge::new(name, header, slack)),
        }
    }

    pub(crate) fn line(&mut self, line: u64, event: &Event) -> Result<(), Fault> {
        match self {
            Self::Strict(judge) => judge.line(line, event),
            Self::Observed(judge) => judge.line(line, event)?,
        }
        Ok(())
    }

    /// The violations found so far, without the first of them.
    pub(crate) fn since(&self, told: usize) -> Vec<Breach<'_>> {
        match self {
            Self::Strict(judge) => {
                judge.so_far().violations.iter().skip(told).map(Breach::from).collect()
            }
            Self::Observed(judge) => {
                judge.so_far().violations.iter().skip(told).map(Breach::from).collect()
            }
        }
    }

    pub(crate) fn finish(self) -> Found {
        match self {
            Self::Strict(judge) => Found::Strict(judge.finish()),
            Self::Observed(judge) => Found::Observed(judge.finish()),
        }
    }
}
