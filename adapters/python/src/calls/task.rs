//! The awaitable object that the task of a call or computation runs.

use std::mem;
use std::sync::{Mutex, MutexGuard};

use fuseline_engine::lock;
use pyo3::exceptions::{PyGeneratorExit, PyStopIteration};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::iterator::PySendResult;
use pyo3::types::{
    PyBool, PyBytes, PyDict, PyFloat, PyInt, PyIterator, PyList, PyNone, PyString, PyTuple,
};

use crate::calls::PyCalls;
use crate::calls::source::{CallClasses, SourceEntry};

/// Runs a call or computation of one message and gives its result to the engine.
///
/// It calls the handle at its first step. A step that takes too long is counted.
#[pyclass(module = "fuseline._fuseline", frozen)]
pub(crate) struct SourceCall {
    calls: Py<PyCalls>,
    p: u16,
    t: Py<PyAny>,
    stage: Mutex<CallStage>,
}

/// The stage that a call has reached.
enum CallStage {
    /// The handle's arguments: the request and its call, or the message and its timestamp.
    New(Py<PyAny>, Py<PyAny>),
    /// The iterator that awaits the handle's coroutine.
    Handle(Py<PyIterator>),
    /// The iterator of a coroutine of the driver, which does the rest.
    Driver(Py<PyIterator>),
    Over,
}

/// The outcome of a step: a pause, or the end.
type StepResult<'py> = PyResult<Option<Bound<'py, PyAny>>>;

#[pymethods]
impl SourceCall {
    /// Runs it to its next pause.
    fn __next__<'py>(&self, py: Python<'py>) -> StepResult<'py> {
        self.calls.get().timed(py, self.p, || self.step(py))?
    }

    /// Does the same as `__next__`, because a task never sends a value.
    fn send<'py>(
        &self,
        py: Python<'py>,
        _value: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.__next__(py)?.ok_or_else(|| PyStopIteration::new_err(()))
    }

    /// Throws an exception, such as a cancellation, into it, and runs it to its next pause.
    #[pyo3(signature = (*error))]
    fn throw<'py>(
        &self,
        py: Python<'py>,
        error: &Bound<'py, PyTuple>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let thrown = self.calls.get().timed(py, self.p, || self.step_from(py, error))?;
        thrown?.ok_or_else(|| PyStopIteration::new_err(()))
    }

    /// Ends it at its current pause.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let (steps, is_handle) = match mem::replace(&mut *self.stage(), CallStage::Over) {
            CallStage::New(..) | CallStage::Over => return Ok(()),
            CallStage::Handle(steps) => (steps, true),
            CallStage::Driver(steps) => (steps, false),
        };
        steps.bind(py).call_method0(intern!(py, "close"))?;
        if !is_handle {
            return Ok(());
        }
        match self.failed(py, PyGeneratorExit::new_err(())) {
            Err(error) if error.is_instance_of::<PyGeneratorExit>(py) => Ok(()),
            other => other.map(drop),
        }
    }

    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __await__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.calls)?;
        // If the stage is locked, a step is under way.
        let Ok(stage) = self.stage.try_lock() else { return Ok(()) };
        match &*stage {
            CallStage::New(request, call) => {
                visit.call(request)?;
                visit.call(call)
            }
            CallStage::Handle(steps) | CallStage::Driver(steps) => visit.call(steps),
            CallStage::Over => Ok(()),
        }
    }
}

impl SourceCall {
    pub(super) fn new(
        calls: &Bound<'_, PyCalls>,
        p: u16,
        t: &Bound<'_, PyAny>,
        request: Bound<'_, PyAny>,
        call: &Bound<'_, PyAny>,
    ) -> Self {
        let stage = Mutex::new(CallStage::New(request.unbind(), call.clone().unbind()));
        Self { calls: calls.clone().unbind(), p, t: t.clone().unbind(), stage }
    }

    fn step<'py>(&self, py: Python<'py>) -> StepResult<'py> {
        // No Python code runs while the stage is locked.
        let stage = mem::replace(&mut *self.stage(), CallStage::Over);
        let (steps, is_handle) = match stage {
            CallStage::New(request, call) => match self.begin(py, request, call) {
                Ok(begun) => begun,
                Err(error) => return self.failed(py, error),
            },
            CallStage::Handle(steps) => (steps.into_bound(py), true),
            CallStage::Driver(steps) => (steps.into_bound(py), false),
            CallStage::Over => return Ok(None),
        };
        let sent = steps.send(&PyNone::get(py));
        self.went(py, steps, is_handle, sent)
    }

    fn step_from<'py>(&self, py: Python<'py>, error: &Bound<'py, PyTuple>) -> StepResult<'py> {
        let stage = mem::replace(&mut *self.stage(), CallStage::Over);
        let (steps, is_handle) = match stage {
            // A coroutine that has not begun does the same.
            CallStage::New(..) | CallStage::Over => {
                return Err(PyErr::from_value(error.get_item(0)?));
            }
            CallStage::Handle(steps) => (steps.into_bound(py), true),
            CallStage::Driver(steps) => (steps.into_bound(py), false),
        };
        let sent = match steps.call_method1(intern!(py, "throw"), error.clone()) {
            Ok(pause) => Ok(PySendResult::Next(pause)),
            Err(error) if error.is_instance_of::<PyStopIteration>(py) => {
                error.value(py).getattr(intern!(py, "value")).map(PySendResult::Return)
            }
            Err(error) => Err(error),
        };
        self.went(py, steps, is_handle, sent)
    }

    /// Handles the outcome of a step.
    fn went<'py>(
        &self,
        py: Python<'py>,
        steps: Bound<'py, PyIterator>,
        is_handle: bool,
        sent: PyResult<PySendResult<'py>>,
    ) -> StepResult<'py> {
        match sent {
            Ok(PySendResult::Next(pause)) => {
                let steps = steps.unbind();
                *self.stage() =
                    if is_handle { CallStage::Handle(steps) } else { CallStage::Driver(steps) };
                Ok(Some(pause))
            }
            Ok(PySendResult::Return(response)) if is_handle => self.returned(py, response),
            Ok(PySendResult::Return(_)) => Ok(None),
            Err(error) if is_handle => self.failed(py, error),
            Err(error) => Err(error),
        }
    }

    /// Calls the handle. Returns the iterator that runs the call, and `true` if it is the handle's
    /// own coroutine.
    fn begin<'py>(
        &self,
        py: Python<'py>,
        request: Py<PyAny>,
        call: Py<PyAny>,
    ) -> PyResult<(Bound<'py, PyIterator>, bool)> {
        let source = self.source()?;
        if source.encodes {
            let encoded =
                self.driver(py).call_method1(intern!(py, "_encoded"), (self.p, request, call))?;
            return Ok((steps_of(&encoded)?, false));
        }
        let returned = source.handle.bind(py).call1((request, call))?;
        if returned.get_type().is(&CallClasses::get(py)?.coroutine) {
            return Ok((steps_of(&returned)?, true));
        }
        let awaiting =
            self.driver(py).call_method1(intern!(py, "_awaiting"), (self.p, &self.t, returned))?;
        Ok((steps_of(&awaiting)?, false))
    }

    /// Takes the value that the handle returned.
    fn returned<'py>(&self, py: Python<'py>, response: Bound<'py, PyAny>) -> StepResult<'py> {
        let value = match self.value_of(py, response) {
            Ok((value, false)) => value,
            Ok((value, true)) => {
                let arguments = (self.p, &self.t, value);
                let later = self.driver(py).call_method1(intern!(py, "_value_later"), arguments)?;
                *self.stage() = CallStage::Driver(steps_of(&later)?.unbind());
                return self.step(py);
            }
            Err(error) => return self.failed(py, error),
        };
        let calls = self.calls.bind(py);
        calls.get().result(calls, self.source()?, self.t.bind(py), value)?;
        Ok(None)
    }

    /// Returns the result, and `true` if the result must be awaited.
    fn value_of<'py>(
        &self,
        py: Python<'py>,
        response: Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyAny>, bool)> {
        let classes = CallClasses::get(py)?;
        let check = |value: &Bound<'py, PyAny>, who: &str, remedy: &str| {
            classes.check_value.bind(py).call1((value, who, remedy)).map(drop)
        };
        let Some(response_handler) = &self.source()?.response_handler else {
            if may_be_awaitable(&response, classes)? {
                check(&response, "local", "give an async def, which awaits it")?;
            }
            return Ok((response, false));
        };
        if may_be_awaitable(&response, classes)? {
            check(&response, "the handle", "await it there")?;
        }
        let value = response_handler.bind(py).call1((response,))?;
        if !may_be_awaitable(&value, classes)? {
            return Ok((value, false));
        }
        let is_awaitable = classes.is_awaitable.bind(py).call1((&value,))?.is_truthy()?;
        if !is_awaitable {
            check(&value, "the response handler", "await it there")?;
        }
        Ok((value, is_awaitable))
    }

    /// Turns an error of a call or of local into a failure, which affects no other message (D7).
    fn failed<'py>(&self, py: Python<'py>, error: PyErr) -> StepResult<'py> {
        let arguments = (self.p, &self.t, error.into_value(py));
        self.driver(py).call_method1(intern!(py, "_failed"), arguments)?;
        Ok(None)
    }

    fn source(&self) -> PyResult<&SourceEntry> {
        self.calls.get().source(self.p)
    }

    fn driver<'py>(&self, py: Python<'py>) -> &Bound<'py, PyAny> {
        self.calls.get().driver.bind(py)
    }

    fn stage(&self) -> MutexGuard<'_, CallStage> {
        lock(&self.stage)
    }
}

/// Returns the iterator that awaits a coroutine.
fn steps_of<'py>(coroutine: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyIterator>> {
    let steps = coroutine.call_method0(intern!(coroutine.py(), "__await__"))?;
    Ok(steps.cast_into::<PyIterator>()?)
}

/// Returns `true` if the value is of a type that needs no further checks.
pub(super) fn is_plain(value: &Bound<'_, PyAny>) -> bool {
    value.is_none()
        || value.is_exact_instance_of::<PyInt>()
        || value.is_exact_instance_of::<PyString>()
        || value.is_exact_instance_of::<PyList>()
        || value.is_exact_instance_of::<PyDict>()
        || value.is_exact_instance_of::<PyTuple>()
        || value.is_exact_instance_of::<PyBytes>()
        || value.is_exact_instance_of::<PyFloat>()
        || value.is_exact_instance_of::<PyBool>()
}

/// Returns `true` if the value has an awaitable's methods or is a generator.
fn may_be_awaitable(value: &Bound<'_, PyAny>, classes: &CallClasses) -> PyResult<bool> {
    if is_plain(value) {
        return Ok(false);
    }
    let kind = value.get_type();
    Ok(kind.is(&classes.generator)
        || kind.is(&classes.async_generator)
        || kind.hasattr(intern!(value.py(), "__await__"))?)
}
