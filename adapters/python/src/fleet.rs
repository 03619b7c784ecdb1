//! One trace of a fleet: judged and counted as it is read, once.

use std::io::BufRead;

use fuseline_traces::observed::{self, Slack};
use fuseline_traces::{Event, Events, Judge};
use pyo3::prelude::*;

use crate::judging::{Told, seen, strict};
use crate::raised::{unjudged, unreadable};
use crate::reading::with_trace;
use crate::tally::{Counted, Tally};
use crate::time::Nanos;

/// The operator's name, the verdict, and what was counted.
type Survey = (Option<String>, Told, Counted);

/// Judges a trace, as observed if a tolerance and a lateness are given, and counts what came out.
#[pyfunction]
#[pyo3(signature = (trace, name, slack))]
pub(crate) fn survey(
    trace: &Bound<'_, PyAny>,
    name: Option<String>,
    slack: Option<(Nanos, Nanos)>,
) -> PyResult<Survey> {
    with_trace(trace, name, |name, trace| match slack {
        None => strictly(name, trace),
        Some((tolerance, lateness)) => {
            as_observed(name, trace, Slack { tolerance: tolerance.0, lateness: lateness.0 })
        }
    })
}

fn strictly(name: &str, trace: impl BufRead) -> PyResult<Survey> {
    let mut reader = Events::new(name, trace).map_err(unreadable)?;
    let mut judge = Judge::new(name, reader.header());
    let tally = tallied(&mut reader, |line, event| {
        judge.line(line, event);
        Ok(())
    })?;
    Ok((reader.header().operator.clone(), strict(judge.finish()), tally.counted(reader.header())))
}

fn as_observed(name: &str, trace: impl BufRead, slack: Slack) -> PyResult<Survey> {
    let mut reader = Events::observed(name, trace).map_err(unreadable)?;
    let mut judge = observed::Judge::new(name, reader.header(), slack);
    let tally = tallied(&mut reader, |line, event| {
        judge.line(line, event).map_err(|disorder| unjudged(disorder.into()))
    })?;
    let mut verdict = judge.finish();
    verdict.violations.sort_by_key(|violation| violation.line);
    Ok((reader.header().operator.clone(), seen(verdict), tally.counted(reader.header())))
}

/// Gives each event to the judge and to the tally.
fn tallied(
    reader: &mut Events<impl BufRead>,
    mut judge: impl FnMut(u64, &Event) -> PyResult<()>,
) -> PyResult<Tally> {
    let mut tally = Tally::default();
    while let Some(event) = reader.next_event().map_err(unreadable)? {
        judge(reader.line(), &event)?;
        tally.event(&event);
    }
    Ok(tally)
}
