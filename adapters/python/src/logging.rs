//! Log lines of the engine and exceptions of handlers, in Python's `logging`, as the logger
//! `fuseline`.

use std::fmt::{self, Write as _};

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{IntoPyDict, PyDict};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

static LOGGER: PyOnceLock<Py<PyAny>> = PyOnceLock::new();

/// Forwards errors, warnings and recoveries of the engine to Python, from the recorder's thread
/// too.
///
/// A thread that waits for that thread must release the interpreter.
struct PythonSubscriber;

/// An event as text: `operator: message (field=value, …)`.
#[derive(Default)]
struct PyLogLine {
    operator: Option<String>,
    message: String,
    fields: String,
}

/// Forwards what the engine logs from now on.
pub(crate) fn install() {
    // The extension has its own copy of `tracing`, and it is imported once.
    let _ = tracing::subscriber::set_global_default(PythonSubscriber);
}

/// Logs an exception with its traceback.
pub(crate) fn exception(py: Python<'_>, message: &str, error: PyErr) {
    let logged = [("exc_info", error.into_value(py))].into_py_dict(py);
    write(py, "error", message, logged.ok().as_ref());
}

impl Subscriber for PythonSubscriber {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_event() && *metadata.level() <= Level::INFO
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        Some(LevelFilter::INFO)
    }

    fn event(&self, event: &Event<'_>) {
        let mut line = PyLogLine::default();
        event.record(&mut line);
        let level = match *event.metadata().level() {
            Level::ERROR => "error",
            Level::WARN => "warning",
            _ => "info",
        };
        // At the interpreter's end this is `None`, and nobody reads logs then.
        Python::try_attach(|py| write(py, level, &line.to_string(), None));
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

impl Visit for PyLogLine {
    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "operator" => self.operator = Some(value.to_owned()),
            _ => self.record_debug(field, &format_args!("{value}")),
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing to a string cannot fail.
        let _ = match field.name() {
            "operator" => write!(self.operator.insert(String::new()), "{value:?}"),
            "message" => write!(self.message, "{value:?}"),
            name => {
                let comma = if self.fields.is_empty() { "" } else { ", " };
                write!(self.fields, "{comma}{name}={value:?}")
            }
        };
    }
}

impl fmt::Display for PyLogLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(operator) = &self.operator {
            write!(f, "{operator}: ")?;
        }
        f.write_str(&self.message)?;
        if self.fields.is_empty() { Ok(()) } else { write!(f, " ({})", self.fields) }
    }
}

/// Writes a line. An exception that a handler of `logging` raises has nowhere else to go.
fn write(py: Python<'_>, level: &str, message: &str, more: Option<&Bound<'_, PyDict>>) {
    let logger = LOGGER.get_or_try_init(py, || {
        py.import("logging")?.call_method1("getLogger", ("fuseline",)).map(Bound::unbind)
    });
    let written =
        logger.and_then(|logger| logger.bind(py).call_method(level, (message,), more).map(drop));
    if let Err(error) = written {
        error.write_unraisable(py, None);
    }
}
