//! Recorded networks, and rival policies over the same arrivals.

use std::time::Duration;

use fuseline_report::policies::{BoundedFigure, ComparedPolicy};
use fuseline_report::{ArrivalTime, MessageRecord, Quantile, TraceStatistics};
use fuseline_testkit::networks::{Drive, DriveError, built_in};
use fuseline_traces::{Events, Header, nanos};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::raised::unreadable;
use crate::reading::with_trace;
use crate::time::Nanos;

/// A recorded drive through one network.
#[pyclass(name = "Drive", module = "fuseline._fuseline", frozen)]
pub(crate) struct PyDrive(Drive);

/// A policy's name, its mean accuracy, and its outputs in time, each from least to most. Then, for
/// each quantile, the word for what is known of it and the nanoseconds.
type PolicyRow = (String, Option<(f64, f64)>, (u64, u64), Vec<Option<(&'static str, u64)>>);

/// The sources, local first. Each has its name, its priority, and its accuracy if that is known.
type ComparedSource = (String, u16, Option<f64>);

#[pymethods]
impl PyDrive {
    #[new]
    fn new(py: Python<'_>, name: &str) -> PyResult<Self> {
        py.detach(|| Drive::load(name)).map(Self).map_err(|error| match error {
            DriveError::Open { .. } => PyOSError::new_err(error.to_string()),
            _ => PyValueError::new_err(error.to_string()),
        })
    }

    /// Returns the drive's name, which includes the network.
    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    /// Returns the nanoseconds until the drive starts again.
    #[getter]
    fn length(&self) -> u64 {
        nanos(self.0.length())
    }

    /// Returns each round trip with the instant from which it holds, in nanoseconds.
    fn samples(&self) -> Vec<(u64, Option<u64>)> {
        self.0.samples().map(|(at, trip)| (nanos(at), trip.map(nanos))).collect()
    }

    /// Returns the nanoseconds until a message that is sent at this instant is answered.
    ///
    /// Returns None if it is never answered.
    fn round_trip(&self, at: Nanos) -> Option<u64> {
        self.0.round_trip(Duration::from_nanos(at.0)).map(nanos)
    }
}

/// Returns the names of the built-in drives.
#[pyfunction]
pub(crate) fn drives() -> Vec<&'static str> {
    built_in().collect()
}

/// Compares rival policies over the arrivals of a trace.
#[pyfunction]
#[pyo3(signature = (trace, name, deadline, accuracies))]
#[expect(clippy::needless_pass_by_value, reason = "what comes from Python is owned")]
pub(crate) fn compare_trace(
    trace: &Bound<'_, PyAny>,
    name: Option<String>,
    deadline: Nanos,
    accuracies: Vec<(String, f64)>,
) -> PyResult<Vec<PolicyRow>> {
    with_trace(trace, name, |name, trace| {
        let mut events = Events::observed(name, trace).map_err(unreadable)?;
        let header = events.header().clone();
        let clouds = header.clouds.iter().map(|cloud| cloud.p);
        let mut statistics = TraceStatistics::new(clouds, header.commit, true);
        while let Some(event) = events.next_event().map_err(unreadable)? {
            statistics.event(&event);
        }
        let sources = sources(&header, &accuracies)?;
        let messages = statistics.messages(|_, _, _| None);
        let mut rows =
            vec![row("fusion".to_owned(), &ComparedPolicy::Fusion, &messages, &sources, deadline)];
        rows.extend(rivals(&messages, &sources, deadline));
        Ok(rows)
    })
}

/// Compares rival policies over arrivals.
///
/// `messages` has, for each message and by source, the nanoseconds until its result, or None if no
/// result came.
#[pyfunction]
#[pyo3(signature = (sources, messages, deadline))]
#[expect(clippy::needless_pass_by_value, reason = "what comes from Python is owned")]
pub(crate) fn compare_responses(
    py: Python<'_>,
    sources: Vec<ComparedSource>,
    messages: Vec<Vec<Option<Nanos>>>,
    deadline: Nanos,
) -> Vec<PolicyRow> {
    py.detach(|| {
        let arrival = |response: Option<Nanos>| match response {
            Some(Nanos(nanos)) => ArrivalTime::At(Duration::from_nanos(nanos)),
            None => ArrivalTime::Never,
        };
        let message = |responses: Vec<Option<Nanos>>| MessageRecord {
            arrivals: responses.into_iter().map(arrival).collect(),
            forwarded: None,
        };
        let messages: Vec<MessageRecord> = messages.into_iter().map(message).collect();
        rivals(&messages, &sources, deadline)
    })
}

/// Returns the rivals: local alone, each cloud alone, the first result, and each better result as
/// it comes.
fn rivals(
    messages: &[MessageRecord],
    sources: &[ComparedSource],
    deadline: Nanos,
) -> Vec<PolicyRow> {
    let mut policies = vec![("local only".to_owned(), ComparedPolicy::LocalOnly)];
    for (index, (name, ..)) in sources.iter().enumerate().skip(1) {
        policies.push((format!("cloud only: {name}"), ComparedPolicy::CloudOnly(index)));
    }
    policies.push(("first response wins".to_owned(), ComparedPolicy::FirstWins));
    let priorities = sources.iter().skip(1).map(|(_, priority, _)| *priority).collect();
    policies.push(("progressive".to_owned(), ComparedPolicy::Progressive(priorities)));
    let rows = policies.into_iter();
    rows.map(|(name, policy)| row(name, &policy, messages, sources, deadline)).collect()
}

fn row(
    name: String,
    policy: &ComparedPolicy,
    messages: &[MessageRecord],
    sources: &[ComparedSource],
    deadline: Nanos,
) -> PolicyRow {
    let accuracies: Vec<Option<f64>> = sources.iter().map(|(.., accuracy)| *accuracy).collect();
    let score = policy.score(messages, &accuracies, Duration::from_nanos(deadline.0));
    let quantile = |quantile: Quantile| match quantile {
        Quantile::Exactly(at) => ("exactly", nanos(at)),
        Quantile::AtLeast(at) => ("at least", nanos(at)),
        Quantile::Never => ("never", 0),
    };
    let BoundedFigure { at_least, at_most } = score.in_time;
    let accuracy = score.ap.map(|ap| (ap.at_least, ap.at_most));
    let quantiles = score.quantiles.into_iter().map(|it| it.map(quantile)).collect();
    (name, accuracy, (at_least, at_most), quantiles)
}

/// Returns the sources of a trace, local first.
fn sources(header: &Header, accuracies: &[(String, f64)]) -> PyResult<Vec<ComparedSource>> {
    let clouds = header
        .clouds
        .iter()
        .map(|cloud| (cloud.name.clone().unwrap_or_else(|| format!("cloud-{}", cloud.p)), cloud.p));
    let sources: Vec<(String, u16)> =
        std::iter::once(("local".to_owned(), 0)).chain(clouds).collect();
    if let Some((wanted, _)) =
        accuracies.iter().find(|(wanted, _)| sources.iter().all(|(name, _)| name != wanted))
    {
        let known = sources.iter().map(|(name, _)| &**name).collect::<Vec<_>>().join(", ");
        let message = format!("an accuracy is given for {wanted:?}; the header has {known}");
        return Err(PyValueError::new_err(message));
    }
    let accuracy = |name: &str| {
        accuracies.iter().find(|(wanted, _)| wanted == name).map(|(_, accuracy)| *accuracy)
    };
    Ok(sources.into_iter().map(|(name, p)| (name.clone(), p, accuracy(&name))).collect())
}
