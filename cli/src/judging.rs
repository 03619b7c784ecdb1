//! Either judge, line by line.

use std::io::BufRead;

use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{Event, Header, Judge, Reader};

use crate::fault::Fault;
use crate::verdict::{Breach, Found};

/// How a trace is judged: strictly, or as observed within this.
pub(crate) type Manner = Option<Slack>;

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
