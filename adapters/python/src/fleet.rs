//! Judges and counts one trace of a fleet in a single pass.

use pyo3::prelude::*;

use crate::judging::{KnownRun, ObservedSlack, VerdictFields, judged, verdict_fields};
use crate::reading::with_trace;
use crate::tally::{PyTally, SummaryFields};

/// The operator's name, the verdict, and the counts.
type TraceSummary = (Option<String>, VerdictFields, SummaryFields);

/// Judges a trace, as observed if a tolerance and a lateness are given, and counts its outputs.
#[pyfunction]
#[pyo3(signature = (trace, name, slack))]
pub(crate) fn survey(
    trace: &Bound<'_, PyAny>,
    name: Option<String>,
    slack: ObservedSlack,
) -> PyResult<TraceSummary> {
    with_trace(trace, name, |name, trace| {
        let mut tally = PyTally::default();
        let (header, findings) =
            judged((slack, &Vec::new()), KnownRun::default(), name, trace, |header, event| {
                tally.event(header.commit, event);
            })?;
        let counted = tally.counted(&header);
        Ok((header.operator, verdict_fields(findings), counted))
    })
}
