//! The parts between operators: joins, order and latencies. The engine decides, and the package
//! owns clocks and streams.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_engine::{
    Aligner, Gate, JoinArrival, JoinBounds, JoinDropReason, Joined, Latency, LatestInput, Lineage,
    Ordered, Origin, Reorderer, Reserve,
};
use fuseline_traces::nanos;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::raised::config;
use crate::time::{Nanos, Number};

/// A lineage: the sensor's stream, the timestamp there, the capture on the clock, the end-to-end
/// deadline, and the inputs that are missing.
type CapturedLineage = (Option<String>, Option<u64>, Option<u64>, Option<u64>, Vec<String>);
/// A set: its key, its messages by input, the inputs that are missing, why it was given, and its
/// lineage.
type JoinedSet<'py> = (u64, Bound<'py, PyDict>, Vec<String>, &'static str, Option<CapturedLineage>);
/// An output of a reorderer: `item`, `passed over` or `late`, the item, and the range that was
/// passed over.
type OrderedEntry = (&'static str, Option<Py<PyAny>>, Option<(u64, u64)>);

/// Maps the nanoseconds of a Python clock to instants of the system's clock.
#[derive(Clone, Copy)]
struct ClockOrigin {
    nanos: u64,
    instant: Instant,
}

/// Joins messages of the same key. Instants are nanoseconds of one clock.
#[pyclass(name = "Aligner", module = "fuseline._fuseline")]
pub(crate) struct PyAligner {
    inner: Aligner<BTreeMap<usize, Py<PyAny>>>,
    /// The names of the aligned inputs, and then those of the latest-value inputs.
    names: Vec<String>,
    aligned: usize,
    clock: ClockOrigin,
}

/// Keeps an item that comes early, until it is its turn or it is due.
#[pyclass(name = "Reorderer", module = "fuseline._fuseline")]
pub(crate) struct PyReorderer {
    inner: Reorderer<Py<PyAny>>,
    clock: ClockOrigin,
}

/// Admits side requests by how many of them wait, in the same way as the machine admits a cloud's
/// requests (F2g).
#[pyclass(name = "Gate", module = "fuseline._fuseline")]
pub(crate) struct PyGate(Gate);

/// States how long an operator takes for a message, on board alone and with its clouds, or measures
/// it while the operator runs.
///
/// The operators upstream keep this much of an end-to-end deadline in reserve. Their local
/// computations end before what this operator needs on board, and their requests before what it
/// takes with its clouds.
///
/// >>> from fuseline import Latency
/// >>> Latency.measured(90, at_first=0.03).on_board
/// ns(30000000)
#[pyclass(name = "Latency", module = "fuseline", frozen)]
pub(crate) struct PyLatency(Latency);

#[pymethods]
impl PyAligner {
    /// Creates a join of aligned inputs and of latest-value inputs.
    ///
    /// A latest-value input is its name, its greatest age, and whether sets belong to its messages.
    #[new]
    #[pyo3(signature = (names, wait, window, now, latest=Vec::new()))]
    fn new(
        mut names: Vec<String>,
        wait: Nanos,
        window: usize,
        now: u64,
        latest: Vec<(String, Nanos, bool)>,
    ) -> Self {
        let wait = Duration::from_nanos(wait.0);
        let bounds = JoinBounds { wait, window, reserve: Duration::ZERO };
        let (aligned, inner) =
            (names.len(), Aligner::new(names.iter().map(String::as_str), bounds));
        names.extend(latest.iter().map(|(name, ..)| name.clone()));
        let inner = inner.with_latest(latest.into_iter().map(|(name, max_age, is_origin)| {
            LatestInput { name: name.into(), max_age: Duration::from_nanos(max_age.0), is_origin }
        }));
        Self { inner, names, aligned, clock: ClockOrigin::new(now) }
    }

    /// Adds a message to its set. Without a value, the set keeps the input's earlier value.
    ///
    /// Returns why it was dropped, if it was.
    fn arrive(
        &mut self,
        at: u64,
        index: usize,
        key: Option<u64>,
        lineage: Option<CapturedLineage>,
        value: Option<(Py<PyAny>,)>,
        is_last: bool,
    ) -> Option<&'static str> {
        let now = self.clock.instant(at);
        let lineage = lineage.map(|lineage| Arc::new(self.clock.lineage(lineage)));
        let arrival = JoinArrival { input: index, key, lineage: lineage.as_ref(), is_last };
        let arrived = self.inner.arrive(now, arrival, |set| {
            if let Some((value,)) = value {
                set.insert(index, value);
            }
        });
        arrived.err().map(JoinDropReason::as_str)
    }

    /// Replaces the latest message of a latest-value input.
    fn set_latest(
        &mut self,
        at: u64,
        index: usize,
        lineage: Option<CapturedLineage>,
        value: Py<PyAny>,
    ) {
        let now = self.clock.instant(at);
        let lineage = lineage.map(|lineage| Arc::new(self.clock.lineage(lineage)));
        let place = self.aligned.saturating_add(index);
        self.inner.set_latest(now, index, lineage, move |set| {
            set.insert(place, Python::attach(|py| value.clone_ref(py)));
        });
    }

    /// Ends this aligned input.
    fn end(&mut self, at: u64, index: usize) {
        self.inner.end(self.clock.instant(at), index);
    }

    /// Sets what end-to-end deadlines must have left when sets are given: the sum of these
    /// latencies.
    #[expect(clippy::needless_pass_by_value, reason = "it is made of a list")]
    fn set_reserve(&mut self, latencies: Vec<PyRef<'_, PyLatency>>) {
        let reserve: Reserve = latencies.iter().map(|it| &it.0).sum();
        self.inner.set_reserve(reserve.on_board());
    }

    /// Lets time pass.
    fn tick(&mut self, at: u64) {
        self.inner.tick(self.clock.instant(at));
    }

    /// Returns the next set that is ready, with the latest messages that are not too old at `at`.
    fn next_set<'py>(&mut self, py: Python<'py>, at: u64) -> PyResult<Option<JoinedSet<'py>>> {
        let now = self.clock.instant(at);
        let Some(joined) = self.inner.next_set(now) else { return Ok(None) };
        let Joined { key, set, missing, cause, lineage } = joined;
        let by_name = PyDict::new(py);
        for (input, value) in set {
            by_name.set_item(&self.names[input], value)?;
        }
        let missing = missing.iter().map(ToString::to_string).collect();
        let lineage = lineage.map(|lineage| self.clock.fields(&lineage));
        Ok(Some((key, by_name, missing, cause.as_str(), lineage)))
    }

    /// Returns the instant at which the next set is due, if a set waits.
    #[getter]
    fn next_due(&self) -> Option<u64> {
        self.inner.next_due().map(|due| self.clock.nanos(due))
    }

    /// Returns true once each input has ended and every set has been given.
    #[getter]
    fn is_over(&self) -> bool {
        self.inner.is_over()
    }
}

#[pymethods]
impl PyReorderer {
    #[new]
    fn new(wait: Nanos, reserve: Nanos, now: u64) -> Self {
        let [wait, reserve] = [wait, reserve].map(|Nanos(nanos)| Duration::from_nanos(nanos));
        Self { inner: Reorderer::new(wait, reserve), clock: ClockOrigin::new(now) }
    }

    /// Takes an item of `timestamp`.
    fn arrive(
        &mut self,
        at: u64,
        timestamp: u64,
        is_last: bool,
        lineage: Option<CapturedLineage>,
        item: Py<PyAny>,
    ) {
        let now = self.clock.instant(at);
        let due = lineage.and_then(|lineage| self.clock.lineage(lineage).due(now));
        self.inner.arrive(now, (timestamp, is_last), due, item);
    }

    /// Lets time pass.
    fn tick(&mut self, at: u64) {
        self.inner.tick(self.clock.instant(at));
    }

    /// Ends the input.
    fn end(&mut self) {
        self.inner.end();
    }

    /// Returns the next item or report.
    fn next_ready(&mut self) -> Option<OrderedEntry> {
        Some(match self.inner.next_ready()? {
            Ordered::Item(item) => ("item", Some(item), None),
            Ordered::PassedOver(range) => ("passed over", None, Some((range.start, range.end))),
            Ordered::Late(item) => ("late", Some(item), None),
        })
    }

    /// Returns the instant at which the next item is due, if an item waits.
    #[getter]
    fn next_due(&self) -> Option<u64> {
        self.inner.next_due().map(|due| self.clock.nanos(due))
    }
}

#[pymethods]
impl PyGate {
    /// Creates an open gate, which shuts at `limit` waiting requests and opens again at `resume` or
    /// fewer.
    #[new]
    fn new(limit: Number, resume: Number) -> PyResult<Self> {
        Gate::new(limit.0, resume.0).map(Self).ok_or_else(|| {
            config(format!(
                "a limit of {} with a resume of {}; give a greater limit",
                limit.0, resume.0
            ))
        })
    }

    /// Consults the gate, and returns whether one more request may join the `backlog`.
    const fn admits(&mut self, backlog: u64) -> bool {
        self.0.admits(backlog)
    }
}

#[pymethods]
impl PyLatency {
    /// States how long the operator takes on board, and how long with its clouds if that is more.
    #[staticmethod]
    #[pyo3(signature = (latency, with_clouds=None))]
    fn stated(latency: Nanos, with_clouds: Option<Nanos>) -> Self {
        let on_board = Duration::from_nanos(latency.0);
        let with_clouds = with_clouds.map_or(on_board, |it| Duration::from_nanos(it.0));
        Self(Latency::stated_with_clouds(on_board, with_clouds))
    }

    /// Measures a percentile, 1 to 100, of local's last 256 computations and of the last 256
    /// messages.
    ///
    /// Each of the two is `at_first` until 16 of its values are recorded.
    #[staticmethod]
    fn measured(percent: i64, at_first: Nanos) -> PyResult<Self> {
        match u8::try_from(percent) {
            Ok(percent @ 1..=100) => {
                Ok(Self(Latency::measured(percent, Duration::from_nanos(at_first.0))))
            }
            _ => Err(config(format!("a percentile of {percent}; it must be from 1 to 100"))),
        }
    }

    /// Records how long a message took until its last item. Does nothing if the latency is stated.
    fn record(&self, latency: Nanos) {
        self.0.record(Duration::from_nanos(latency.0));
    }

    /// Records how long local computed a result. Does nothing if the latency is stated.
    fn record_local(&self, latency: Nanos) {
        self.0.record_local(Duration::from_nanos(latency.0));
    }

    /// Returns what the operator needs on board at present.
    #[getter]
    fn on_board(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        crate::answer_classes::AnswerClasses::get(py)?.ns(py, nanos(self.0.estimate().on_board()))
    }

    /// Returns what the operator takes with its clouds at present.
    #[getter]
    fn with_clouds(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        crate::answer_classes::AnswerClasses::get(py)?
            .ns(py, nanos(self.0.estimate().with_clouds()))
    }
}

impl PyLatency {
    pub(crate) fn latency(&self) -> Latency {
        self.0.clone()
    }
}

impl ClockOrigin {
    /// Starts at a clock that reads `nanos` now.
    fn new(nanos: u64) -> Self {
        Self { nanos, instant: Instant::now() }
    }

    fn instant(&self, nanos: u64) -> Instant {
        let since = Duration::from_nanos(nanos.abs_diff(self.nanos));
        let instant = if nanos < self.nanos {
            self.instant.checked_sub(since)
        } else {
            self.instant.checked_add(since)
        };
        instant.unwrap_or(self.instant)
    }

    fn nanos(&self, instant: Instant) -> u64 {
        match instant.checked_duration_since(self.instant) {
            Some(since) => self.nanos.saturating_add(nanos(since)),
            None => self.nanos.saturating_sub(nanos(self.instant - instant)),
        }
    }

    fn lineage(&self, (stream, seq, captured, within, missing): CapturedLineage) -> Lineage {
        let origin = stream.map(|stream| Origin { stream: stream.into(), seq });
        let captured = captured.map(|captured| self.instant(captured));
        let missing = missing.into_iter().map(Into::into).collect();
        Lineage { origin, captured, within: within.map(Duration::from_nanos), missing }
    }

    fn fields(&self, lineage: &Lineage) -> CapturedLineage {
        let Lineage { origin, captured, within, missing } = lineage;
        let stream = origin.as_ref().map(|origin| origin.stream.to_string());
        let seq = origin.as_ref().and_then(|origin| origin.seq);
        let captured = captured.map(|captured| self.nanos(captured));
        let missing = missing.iter().map(ToString::to_string).collect();
        (stream, seq, captured, within.map(nanos), missing)
    }
}
