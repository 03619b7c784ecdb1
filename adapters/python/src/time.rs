//! Instants and durations, in Python's forms.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDelta, PyFloat, PyInt};

use crate::answer_classes::AnswerClasses;
use crate::raised::TimeError;

/// A duration, read from seconds as a float, a `timedelta`, or the package's own `ns`. A plain int
/// is refused, because it may be meant in either unit; 0 is the same in both.
#[derive(Clone, Copy)]
pub(crate) struct Nanos(pub(crate) u64);

/// A number from 0 to 2⁶⁴ − 1.
#[derive(Clone, Copy)]
pub(crate) struct Number(pub(crate) u64);

/// A number that is no time, in the unit of its figure. A duration is refused.
#[derive(Clone, Copy)]
pub(crate) struct Plain(pub(crate) f64);

/// A second, in nanoseconds.
const SECOND: f64 = 1e9;

/// Returns a duration as whole nanoseconds. A float is seconds, rounded to the nearest nanosecond.
#[pyfunction]
#[pyo3(signature = (duration, /))]
pub(crate) fn nanoseconds(py: Python<'_>, duration: Nanos) -> PyResult<Py<PyAny>> {
    AnswerClasses::get(py)?.ns(py, duration.0)
}

impl<'py> FromPyObject<'_, 'py> for Number {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.is_instance_of::<PyBool>() {
            return Err(not_whole(object));
        }
        if !object.is_instance_of::<PyInt>() {
            // Accepts objects that act as an int, such as numpy's.
            let index = object.call_method0("__index__").map_err(|_| not_whole(object))?;
            return number(index.as_borrowed());
        }
        number(object)
    }
}

impl<'py> FromPyObject<'_, 'py> for Plain {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.is_instance_of::<PyDelta>() || AnswerClasses::get(object.py())?.is_ns(object) {
            let message = format!(
                "{}: a duration was given instead of a number in m, m/s or m/s²",
                object.repr()?
            );
            return Err(PyTypeError::new_err(message));
        }
        if object.is_instance_of::<PyBool>() {
            return Err(PyTypeError::new_err("give a number, not a bool"));
        }
        object.extract().map(Self).map_err(|_| {
            let kind = kind(object);
            PyTypeError::new_err(format!(
                "give a number in m, m/s or m/s² as a float, not \
                 {kind}; if it is unknown, give math.nan"
            ))
        })
    }
}

impl<'py> FromPyObject<'_, 'py> for Nanos {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(seconds) = object.cast::<PyFloat>() {
            return seconds_of(seconds.extract()?).map(Self);
        }
        if object.is_instance_of::<PyDelta>() {
            let micros: i128 =
                object.call_method1("__floordiv__", (micro(object.py())?,))?.extract()?;
            let nanos = micros.saturating_mul(1000);
            return match u64::try_from(nanos) {
                Ok(nanos) => Ok(Self(nanos)),
                Err(_) if nanos > 0 => Ok(Self(u64::MAX)),
                Err(_) => Err(below_0(object)),
            };
        }
        if AnswerClasses::get(object.py())?.is_ns(object) {
            return number(object).map(|Number(nanos)| Self(nanos));
        }
        if object.is_instance_of::<PyInt>() && !object.is_instance_of::<PyBool>() {
            return if object.eq(0)? { Ok(Self(0)) } else { Err(ambiguous(object)) };
        }
        // Accepts other kinds of float, such as numpy's of 32 bits. An object with an index is a
        // whole number.
        if !object.hasattr("__index__")? && object.hasattr("__float__")? {
            return seconds_of(object.call_method0("__float__")?.extract()?).map(Self);
        }
        let message = format!(
            "a duration is seconds as a float, a timedelta, or nanoseconds as ns(…), not {}",
            kind(object)
        );
        Err(PyTypeError::new_err(message))
    }
}

fn ambiguous(object: Borrowed<'_, '_, PyAny>) -> PyErr {
    let message =
        format!("a duration of {0}: write {0}.0 for seconds, or ns({0}) for nanoseconds", *object);
    PyTypeError::new_err(message)
}

/// Rounds to the nearest nanosecond. A duration that is too long, or infinite, is 2⁶⁴ − 1 ns (A14).
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast stays within the range, which is what is wanted"
)]
fn seconds_of(seconds: f64) -> PyResult<u64> {
    if seconds >= 0.0 {
        Ok((seconds * SECOND).round() as u64)
    } else {
        Err(TimeError::new_err(format!("a duration of {seconds} s; it must be 0 or more")))
    }
}

fn number(object: Borrowed<'_, '_, PyAny>) -> PyResult<Number> {
    object.extract::<u64>().map(Number).map_err(|_| {
        TimeError::new_err(format!("{}: a number must be from 0 to 2**64 - 1", *object))
    })
}

fn micro(py: Python<'_>) -> PyResult<Bound<'_, PyDelta>> {
    PyDelta::new(py, 0, 0, 1, false)
}

fn below_0(object: Borrowed<'_, '_, PyAny>) -> PyErr {
    TimeError::new_err(format!("a duration of {}; it must be 0 or more", *object))
}

fn not_whole(object: Borrowed<'_, '_, PyAny>) -> PyErr {
    let message =
        format!("give a whole number as an int, not {}; instants are nanoseconds", kind(object));
    PyTypeError::new_err(message)
}

fn kind(object: Borrowed<'_, '_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string())
}
