//! The data that a source's calls need.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{IntoPyDict, PyDict, PySet, PyType};

static CLASSES: PyOnceLock<CallClasses> = PyOnceLock::new();

/// Local or a cloud.
pub(super) struct SourceEntry {
    pub(super) p: u16,
    pub(super) in_flight: Py<PyDict>,
    pub(super) aborted: Py<PySet>,
    pub(super) limit: usize,
    pub(super) handle: Py<PyAny>,
    /// `None` for local.
    pub(super) response_handler: Option<Py<PyAny>>,
    pub(super) encodes: bool,
    /// The names of its tasks, as a keyword argument of `create_task`.
    pub(super) named: Py<PyDict>,
    /// `true` if its results are copied. Then later computations cannot change a held result.
    pub(super) copies: bool,
}

/// A source as the package passes it: its priority, its tasks, how many of them there may be, its
/// handle and its response handler. Then whether its requests are encoded, how its tasks are named,
/// and whether its results are copied.
pub(super) type SourceArgument<'py> =
    (u16, Bound<'py, PyAny>, usize, Py<PyAny>, Option<Py<PyAny>>, bool, Bound<'py, PyAny>, bool);

/// The classes that each call is compared with, or that are created for each call.
pub(super) struct CallClasses {
    pub(super) coroutine: Py<PyType>,
    pub(super) generator: Py<PyType>,
    pub(super) async_generator: Py<PyType>,
    pub(super) call: Py<PyAny>,
    pub(super) stamped: Py<PyAny>,
    pub(super) check_value: Py<PyAny>,
    pub(super) check_result: Py<PyAny>,
    pub(super) snapshot: Py<PyAny>,
    pub(super) is_awaitable: Py<PyAny>,
}

impl SourceEntry {
    pub(super) fn new(
        (p, tasks, limit, handle, response_handler, encodes, name, copies): SourceArgument<'_>,
    ) -> PyResult<Self> {
        let in_flight = tasks.getattr("in_flight")?.cast_into::<PyDict>()?.unbind();
        let aborted = tasks.getattr("aborted")?.cast_into::<PySet>()?.unbind();
        let named = [("name", name)].into_py_dict(tasks.py())?.unbind();
        Ok(Self { p, in_flight, aborted, limit, handle, response_handler, encodes, named, copies })
    }
}

impl CallClasses {
    pub(super) fn get(py: Python<'_>) -> PyResult<&'static Self> {
        CLASSES.get_or_try_init(py, || {
            let kind = |name: &str| {
                Ok::<_, PyErr>(py.import("types")?.getattr(name)?.cast_into::<PyType>()?.unbind())
            };
            let (items, wiring) = (py.import("fuseline._item")?, py.import("fuseline._wiring")?);
            Ok(Self {
                coroutine: kind("CoroutineType")?,
                generator: kind("GeneratorType")?,
                async_generator: kind("AsyncGeneratorType")?,
                call: items.getattr("Call")?.unbind(),
                stamped: items.getattr("StampedValue")?.unbind(),
                check_value: wiring.getattr("check_value")?.unbind(),
                check_result: wiring.getattr("check_result")?.unbind(),
                snapshot: py.import("fuseline._snapshot")?.getattr("snapshot")?.unbind(),
                is_awaitable: wiring.getattr("is_awaitable")?.unbind(),
            })
        })
    }
}
