//! Raises the package's own exceptions.

use std::fmt::Display;

use fuseline_traces::Defect;
use fuseline_traces::observed::TimeOrderError;
use pyo3::prelude::*;

pyo3::import_exception!(fuseline._errors, ConfigError);
pyo3::import_exception!(fuseline._errors, DeadlineError);
pyo3::import_exception!(fuseline._errors, TimeError);
pyo3::import_exception!(fuseline._errors, ReadError);

/// Returns the exception for a trace that cannot be read, with its place. An exception that was
/// raised while reading is returned unchanged.
pub(crate) fn unreadable(error: fuseline_traces::ReadError) -> PyErr {
    let fuseline_traces::ReadError { file, line, column, defect } = error;
    match defect {
        Defect::Io(error) => match error.downcast::<PyErr>() {
            Ok(raised) => raised,
            Err(error) => read_error((file, line, column, error.to_string())),
        },
        defect => read_error((file, line, column, defect.to_string())),
    }
}

/// Returns the exception for a trace that is out of order and so cannot be judged as observed.
pub(crate) fn unjudged(error: &TimeOrderError) -> PyErr {
    let message = error.to_string();
    let place = format!("{}:{}:1: ", error.file, error.line);
    let what = message.strip_prefix(&place).unwrap_or(&message).to_owned();
    read_error((error.file.clone(), error.line, 1, what))
}

/// Returns the exception for a configuration that the machine refuses.
pub(crate) fn config(error: impl Display) -> PyErr {
    ConfigError::new_err(error.to_string())
}

fn read_error(fields: (String, u64, u64, String)) -> PyErr {
    ReadError::new_err(fields)
}
