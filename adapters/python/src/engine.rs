//! The engine of an operator: inputs go in, and effects to carry out come out.
//!
//! Python's operator owns the clock, the loop and the tasks. Everything else is the engine that all
//! adapters share. No Python code can enter the engine while it decides: message handlers and
//! policies that try to are refused.

mod counting;
mod effects;
mod policy;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};
use std::{io, iter, mem};

use fuseline_engine as engine;
use fuseline_engine::{
    CloudConfig, EngineConfig, Latency, Lineage, Local, Offer, Origin, Recorder, Recording,
    StampedValue, lock,
};
use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyIterator;

pub(crate) use crate::engine::counting::PyCounting;
use crate::engine::effects::Effects;
use crate::engine::policy::EnginePolicy;
use crate::fusion::{CloudEntry, WindowArgument, header};
use crate::pipeline::PyLatency;
use crate::policy::SituationFields;
use crate::raised;
use crate::time::Nanos;

/// An engine whose values and requests are Python's.
type EngineState = engine::Engine<Py<PyAny>, Py<PyAny>>;
/// The effects of an input.
pub(crate) type EngineEffect = engine::Effect<Py<PyAny>, Py<PyAny>>;

/// A message's lineage, as in `fuseline.Lineage`, with its age.
pub(crate) type LineageFields =
    (Option<String>, Option<u64>, Option<u64>, Option<u64>, Vec<String>);

/// A cloud's greatest number of calls, the greatest age of its values, its linger and its policy.
type CloudBounds<'py> = (usize, u64, Nanos, Option<Bound<'py, PyAny>>);

/// The engine of one operator. Instants are nanoseconds of its clock, which begins with it.
#[pyclass(name = "Engine", module = "fuseline._fuseline", frozen)]
pub(crate) struct PyEngine {
    /// `None` once it has finished.
    inner: Mutex<Option<EngineState>>,
    effects: Effects,
    /// The instant at which the clock read 0. Ages count from it.
    start: Instant,
    counting: PyCounting,
    interrupt: PendingException,
    /// The time that each operator downstream takes.
    reserve: Vec<Latency>,
    /// `true` if it writes a trace.
    #[pyo3(get)]
    is_recording: bool,
}

/// An exception of Python that is not an error of a handler, such as `KeyboardInterrupt`. It is
/// raised after the decisions of the input.
#[derive(Clone, Default)]
pub(crate) struct PendingException(Arc<Mutex<Option<PyErr>>>);

#[pymethods]
impl PyEngine {
    /// Creates an engine.
    ///
    /// `bounds` has an entry for each cloud, in the order of `clouds`: how many calls may be under
    /// way, how many messages old its values may be, how long calls linger, and its policy as
    /// `fuseline.deadline.compiled` returns it.
    ///
    /// `local` states how many computations run at once, how many may wait (by default as many as
    /// the window holds), whether a computation of an answered message is skipped, whether results
    /// can be lost, and how many computations may be replaced.
    ///
    /// `reserve` is how long the operators downstream take.
    #[new]
    #[expect(
        clippy::needless_pass_by_value,
        clippy::too_many_arguments,
        reason = "they are what an operator is made of"
    )]
    fn new(
        clouds: Vec<CloudEntry<'_>>,
        bounds: Vec<CloudBounds<'_>>,
        local: (usize, Option<usize>, bool, bool, usize),
        window: WindowArgument,
        commit: &str,
        operator: String,
        trace: Option<PathBuf>,
        reserve: Vec<PyRef<'_, PyLatency>>,
        latency: Option<PyRef<'_, PyLatency>>,
        has_substitutes: bool,
        lag_warning: Nanos,
        greatest_deadline: Nanos,
    ) -> PyResult<Self> {
        let header = header(clouds, window, commit, Some(operator.clone()))?;
        let interrupt = PendingException::default();
        let (at_once, waiting, skip_answered, may_lose_results, replaceable) = local;
        let mut config = EngineConfig {
            local: Local {
                at_once,
                waiting,
                skip_answered,
                may_lose_results,
                replaceable,
                ..Local::default()
            },
            latency: latency.map(|latency| latency.latency()),
            has_substitutes,
            lag_warning: Duration::from_nanos(lag_warning.0),
            greatest_deadline: Duration::from_nanos(greatest_deadline.0),
            ..EngineConfig::from(&header)
        };
        for (cloud, (calls, max_age, linger, policy)) in config.clouds.iter_mut().zip(bounds) {
            (cloud.calls, cloud.max_age) = (calls, max_age);
            cloud.linger = Duration::from_nanos(linger.0);
            if let Some(policy) = policy {
                cloud.policy = Some(Box::new(EnginePolicy::new(&policy, &interrupt)?));
            }
        }
        let (header, annotations) = config.header();
        let is_recording = trace.is_some();
        let mut inner = EngineState::new(config).map_err(raised::config)?;
        let start = Instant::now();
        inner.set_start(start);
        if let Some(path) = trace {
            let recorder =
                Recorder::create_annotated(&path, &header, &annotations, Recording::default());
            recorder
                .and_then(|recorder| inner.record(recorder))
                .map_err(|error| unwritable(&error, path))?;
        }
        let counting = PyCounting::new(operator, inner.counts());
        let effects = Effects::new(&header);
        Ok(Self {
            inner: Mutex::new(Some(inner)),
            effects,
            start,
            counting,
            interrupt,
            reserve: reserve.iter().map(|latency| latency.latency()).collect(),
            is_recording,
        })
    }

    /// Sets the situation for policies from now on.
    fn set_situation(&self, situation: SituationFields) -> PyResult<()> {
        let (situation, _) = situation.split();
        self.with(|inner| inner.set_situation(situation))
    }

    /// Ends the run. If messages are open, the trace shows that.
    fn end(&self, at: u64) -> PyResult<()> {
        let left = self.with(|inner| {
            inner.end(at);
            iter::from_fn(|| inner.next_effect()).collect::<Vec<_>>()
        });
        // No call begins after the end.
        left.map(drop)
    }

    /// Returns the counts.
    #[getter]
    fn counting(&self) -> PyCounting {
        self.counting.clone()
    }

    /// Drops all values and policies, and waits until the trace is written.
    ///
    /// The interpreter is released during the wait. Nothing may come after it.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        // Policies and values are dropped after the lock, because they may run any code.
        let Some(mut inner) = mem::take(&mut *self.locked()?) else { return Ok(()) };
        py.detach(|| inner.finish()).map_err(|error| PyOSError::new_err(error.to_string()))
    }
}

impl PyEngine {
    /// Returns the lineage of a message that is accepted at `at`.
    fn lineage(&self, at: u64, (stream, seq, age, within, missing): LineageFields) -> Lineage {
        let now = self.start.checked_add(Duration::from_nanos(at));
        let captured =
            now.zip(age).and_then(|(now, age)| now.checked_sub(Duration::from_nanos(age)));
        let origin = stream.map(|stream| Origin { stream: stream.into(), seq });
        let missing = missing.into_iter().map(Into::into).collect();
        Lineage { origin, captured, within: within.map(Duration::from_nanos), missing }
    }

    /// Opens a message (F1) and offers it to clouds (F2). `offers` is iterated only if the message
    /// is accepted.
    pub(crate) fn open(
        &self,
        at: u64,
        t: u64,
        deadline: Option<Duration>,
        job: Py<PyAny>,
        offers: &Bound<'_, PyIterator>,
        lineage: Option<LineageFields>,
    ) -> PyResult<Option<EngineEffect>> {
        let offers =
            offers.try_iter()?.map_while(|offer| match offer.and_then(|it| it.extract()) {
                Ok((priority, request, Nanos(deadline))) => {
                    Some(Offer { priority, deadline: Duration::from_nanos(deadline), request })
                }
                Err(error) => {
                    self.interrupt.set(error);
                    None
                }
            });
        let lineage = lineage.map(|lineage| Arc::new(self.lineage(at, lineage)));
        self.apply(|inner| {
            if !self.reserve.is_empty() {
                inner.set_reserve(self.reserve.iter().sum());
            }
            inner.open_with(at, t, deadline, lineage, job, offers);
        })
    }

    /// Applies a source's result (F3).
    pub(crate) fn result(
        &self,
        at: u64,
        t: u64,
        p: u16,
        value: StampedValue<Py<PyAny>>,
    ) -> PyResult<Option<EngineEffect>> {
        self.apply(|inner| inner.result(at, t, p, value))
    }

    /// Reports that a source will send no result (F4).
    pub(crate) fn fail(
        &self,
        at: u64,
        t: u64,
        p: u16,
        why: &str,
    ) -> PyResult<Option<EngineEffect>> {
        self.apply(|inner| inner.fail(at, t, p, &why))
    }

    /// Does the same as `fail`, but its effects come after the effects that are left.
    pub(crate) fn fail_later(&self, at: u64, t: u64, p: u16, why: &str) -> PyResult<()> {
        self.with(|inner| inner.fail(at, t, p, &why))?;
        self.interrupt.take().map_or(Ok(()), Err)
    }

    /// Lets time pass until this instant (F5).
    pub(crate) fn tick(&self, at: u64) -> PyResult<Option<EngineEffect>> {
        self.apply(|inner| inner.tick(at))
    }

    /// Returns the next effect, or `None` once it has finished.
    pub(crate) fn next_effect(&self) -> PyResult<Option<EngineEffect>> {
        Ok(self.locked()?.as_mut().and_then(next_wanted))
    }

    /// Returns the package's item.
    pub(crate) fn item<'py>(
        &self,
        py: Python<'py>,
        item: engine::Item<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.effects.item(py, item)
    }

    /// Returns the instant at which to tick next, or `None` if there is none.
    pub(crate) fn next_due(&self) -> PyResult<Option<u64>> {
        self.with(|inner| inner.next_due())
    }

    /// Returns whether no message is open.
    pub(crate) fn is_idle(&self) -> PyResult<bool> {
        self.with(|inner| inner.is_idle())
    }

    /// Returns the number of open messages.
    pub(crate) fn open_len(&self) -> PyResult<usize> {
        self.with(|inner| inner.open_len())
    }

    /// Applies an input. Returns the first effect to carry out.
    fn apply(&self, input: impl FnOnce(&mut EngineState)) -> PyResult<Option<EngineEffect>> {
        self.with(|inner| {
            input(inner);
            self.interrupt.take().map_or(Ok(()), Err)?;
            Ok(next_wanted(inner))
        })?
    }

    fn with<T>(&self, apply: impl FnOnce(&mut EngineState) -> T) -> PyResult<T> {
        match &mut *self.locked()? {
            Some(inner) => Ok(apply(inner)),
            None => Err(PyRuntimeError::new_err("the operator has ended")),
        }
    }

    /// Locks the engine without waiting, because the holder of the lock may wait for the
    /// interpreter.
    fn locked(&self) -> PyResult<MutexGuard<'_, Option<EngineState>>> {
        match self.inner.try_lock() {
            Ok(inner) => Ok(inner),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "the operator decides about a message: neither its handlers nor its policies, nor other threads, can give \
                 it an input meanwhile",
            )),
        }
    }
}

impl Drop for PyEngine {
    fn drop(&mut self) {
        let inner = self.inner.get_mut().unwrap_or_else(PoisonError::into_inner);
        let Some(inner) = inner else { return };
        // The recorder's thread may want to log an error, and waits for the interpreter to do so.
        let written = Python::try_attach(|py| py.detach(|| inner.finish()));
        // The error was logged when it happened.
        let _: Option<io::Result<()>> = written;
    }
}

impl PendingException {
    /// Stores the exception, unless an earlier one is stored.
    pub(crate) fn set(&self, error: PyErr) {
        self.locked().get_or_insert(error);
    }

    fn take(&self) -> Option<PyErr> {
        self.locked().take()
    }

    /// Locks the exception. No Python code runs while it is locked.
    fn locked(&self) -> MutexGuard<'_, Option<PyErr>> {
        lock(&self.0)
    }
}

/// Refuses a policy that would learn nothing of longer deadlines with this linger.
#[pyfunction]
pub(crate) fn check_linger(name: String, policy: &Bound<'_, PyAny>, linger: Nanos) -> PyResult<()> {
    let policy = EnginePolicy::new(policy, &PendingException::default())?;
    let cloud = CloudConfig {
        name,
        policy: Some(Box::new(policy)),
        linger: Duration::from_nanos(linger.0),
        ..CloudConfig::new(1)
    };
    let config = EngineConfig { clouds: vec![cloud], ..EngineConfig::default() };
    config.check().map_err(raised::config)
}

/// Returns the next effect except hints, which Python does not use.
fn next_wanted(inner: &mut EngineState) -> Option<EngineEffect> {
    iter::from_fn(|| inner.next_effect()).find(|effect| !matches!(effect, EngineEffect::Hint(_)))
}

/// Returns Python's error for a file that cannot be written. It names the file, as the error of
/// Python's own `open` does.
fn unwritable(error: &io::Error, path: PathBuf) -> PyErr {
    match error.raw_os_error() {
        Some(number) => {
            let words = error.to_string();
            let words = words.split(" (os error").next().unwrap_or_default().to_owned();
            PyOSError::new_err((number, words, path.into_os_string()))
        }
        None => PyOSError::new_err(format!("{}: {error}", path.display())),
    }
}
