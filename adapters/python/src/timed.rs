//! Whether a coroutine lets others run: how long it runs between two pauses.

use std::time::Duration;

use pyo3::exceptions::PyStopIteration;
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyTuple};

use crate::engine::PyCounting;

/// A coroutine for a task, whose steps of source `p` are counted if they take longer than `longest` nanoseconds of `clock`.
#[pyclass(module = "fuseline._fuseline", frozen)]
pub(crate) struct TimedSteps {
    /// What its coroutine is awaited by.
    steps: Py<PyIterator>,
    clock: Py<PyAny>,
    longest: u64,
    counting: PyCounting,
    p: u16,
}

#[pymethods]
impl TimedSteps {
    #[new]
    fn new(
        coroutine: &Bound<'_, PyAny>,
        clock: Py<PyAny>,
        longest: u64,
        counting: &Bound<'_, PyCounting>,
        p: u16,
    ) -> PyResult<Self> {
        let steps = coroutine.call_method0(intern!(coroutine.py(), "__await__"))?;
        let steps = steps.cast_into::<PyIterator>()?.unbind();
        Ok(Self { steps, clock, longest, counting: counting.borrow().clone(), p })
    }

    /// Runs it to its next pause.
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.timed(py, || self.steps.bind(py).clone().next().transpose())?
    }

    /// As `__next__`: nothing is sent to what a task runs.
    fn send<'py>(
        &self,
        py: Python<'py>,
        _value: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.__next__(py)?.ok_or_else(|| PyStopIteration::new_err(()))
    }

    /// Runs it to its next pause from an exception, such as its cancellation.
    #[pyo3(signature = (*error))]
    fn throw<'py>(
        &self,
        py: Python<'py>,
        error: &Bound<'py, PyTuple>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.timed(py, || self.steps.bind(py).call_method1(intern!(py, "throw"), error.clone()))?
    }

    /// Ends it where it is.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.steps.bind(py).call_method0(intern!(py, "close")).map(drop)
    }

    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __await__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.steps)?;
        visit.call(&self.clock)
    }
}

impl TimedSteps {
    fn timed<T>(&self, py: Python<'_>, step: impl FnOnce() -> T) -> PyResult<T> {
        let now = || self.clock.bind(py).call0()?.extract::<u64>();
        let begin = now()?;
        let stepped = step();
        let took = now()?.saturating_sub(begin);
        if took > self.longest {
            self.counting.counting().ran(Some(self.p), Duration::from_nanos(took));
        }
        Ok(stepped)
    }
}
