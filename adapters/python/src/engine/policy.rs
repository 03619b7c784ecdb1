//! The policies of an engine: the package's own, which decide without the interpreter, and any
//! policy in Python.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::time::Duration;

use fuseline_deadline as deadline;
use fuseline_deadline::{Case, Chosen, Constant, End, Policy, Reason, Situation, Span};
use fuseline_traces::nanos;
use pyo3::exceptions::asyncio::CancelledError;
use pyo3::exceptions::{PyException, PyTypeError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBool, PyFloat, PyInt, PyList, PyTuple};

use crate::answer_classes::AnswerClasses;
use crate::engine::PendingException;
use crate::logging;
use crate::policy::{PyExpected, PyGuard, SharedExpected};
use crate::time::{Nanos, Number};

static CLASSES: PyOnceLock<PolicyClasses> = PyOnceLock::new();

/// The policy of one cloud.
pub(crate) enum EnginePolicy {
    Constant(Constant),
    Guard(Box<deadline::Guard>),
    Expected(SharedExpected, PendingException, Traits),
    /// The first policy caps the second.
    Capped(Box<deadline::Capped<EnginePolicy, EnginePolicy>>),
    Python(Arc<Py<PyAny>>, PendingException, Traits),
}

/// The policy's requirements on commit rule and linger.
#[derive(Clone, Copy, Default)]
pub(crate) struct Traits {
    assumes_one_output: bool,
    needs_linger: bool,
}

/// The package's classes that policies receive and return (`deadline.py`).
struct PolicyClasses {
    situation: Py<PyAny>,
    answered: Py<PyAny>,
    failed: Py<PyAny>,
    censored: Py<PyAny>,
}

impl EnginePolicy {
    /// Creates a policy. A duration is a constant, and a pair is a cap and the policy that it caps.
    /// An object of any class that is not the extension's is a policy in Python.
    pub(crate) fn new(policy: &Bound<'_, PyAny>, interrupt: &PendingException) -> PyResult<Self> {
        if AnswerClasses::get(policy.py())?.is_ns(policy.as_borrowed()) {
            let Nanos(deadline) = policy.extract()?;
            return Ok(Self::Constant(Constant(Duration::from_nanos(deadline))));
        }
        if let Ok(guard) = policy.cast::<PyGuard>() {
            return Ok(Self::Guard(Box::new(guard.get().0)));
        }
        if let Ok(expected) = policy.cast::<PyExpected>() {
            let policy = expected.get().0.clone();
            let needs_linger = policy.needs_linger()?;
            let traits = Traits { needs_linger, ..Traits::default() };
            return Ok(Self::Expected(policy, interrupt.clone(), traits));
        }
        if let Ok(pair) = policy.cast_exact::<PyTuple>() {
            let (cap, policy): (Bound<'_, PyAny>, Bound<'_, PyAny>) = pair.extract()?;
            let (cap, policy) = (Self::new(&cap, interrupt)?, Self::new(&policy, interrupt)?);
            return Ok(Self::Capped(Box::new(cap.cap(policy))));
        }
        let traits = Traits::of(policy, interrupt)?;
        Ok(Self::Python(Arc::new(policy.clone().unbind()), interrupt.clone(), traits))
    }
}

impl Traits {
    /// Returns the requirements of a policy in Python: those of the package's policy that it
    /// derives from.
    fn of(policy: &Bound<'_, PyAny>, interrupt: &PendingException) -> PyResult<Self> {
        let module = policy.py().import("fuseline.deadline")?;
        let mut traits = Self::default();
        for (class, part) in [
            ("Guard", "_guard"),
            ("Expected", "_expected"),
            ("Capped", "_cap"),
            ("Capped", "_policy"),
        ] {
            if policy.is_instance(&module.getattr(class)?)? {
                let part = EnginePolicy::new(&policy.getattr(part)?, interrupt)?;
                traits.assumes_one_output |= part.assumes_one_output();
                traits.needs_linger |= part.needs_linger();
            }
        }
        Ok(traits)
    }
}

impl Policy for EnginePolicy {
    fn decide(&mut self, situation: &Situation<'_>, cap: Duration) -> Chosen {
        match self {
            Self::Constant(policy) => policy.decide(situation, cap),
            Self::Guard(policy) => policy.decide(situation, cap),
            Self::Capped(policy) => policy.decide(situation, cap),
            Self::Expected(policy, interrupt, _) => {
                if !policy.calls_python() {
                    return policy
                        .decide(situation, cap)
                        .unwrap_or_else(|error| failed(interrupt, error));
                }
                called(interrupt, |py| {
                    policy.set_situation(situation_of(py, situation)?);
                    policy.decide(situation, cap)
                })
            }
            Self::Python(policy, interrupt, _) => called(interrupt, |py| {
                let cap = AnswerClasses::get(py)?.ns(py, nanos(cap))?;
                let known = situation_of(py, situation)?;
                chosen(&policy.bind(py).call_method1(intern!(py, "decide"), (known, cap))?)
            }),
        }
    }

    fn ended(&mut self, end: End) {
        match self {
            Self::Constant(policy) => policy.ended(end),
            Self::Guard(policy) => policy.ended(end),
            Self::Capped(policy) => policy.ended(end),
            Self::Expected(policy, interrupt, _) => {
                policy.ended(end).unwrap_or_else(|error| failed(interrupt, error));
            }
            Self::Python(policy, interrupt, _) => called(interrupt, |py| {
                let classes = PolicyClasses::get(py)?;
                let (end, age) = match end {
                    End::Answered(age) => (&classes.answered, age),
                    End::Failed(age) => (&classes.failed, age),
                    End::Censored(age) => (&classes.censored, age),
                };
                let age = AnswerClasses::get(py)?.ns(py, nanos(age))?;
                policy.bind(py).call_method1(intern!(py, "ended"), (end, age)).map(drop)
            }),
        }
    }

    fn assumes_one_output(&self) -> bool {
        match self {
            Self::Constant(policy) => policy.assumes_one_output(),
            Self::Guard(policy) => policy.assumes_one_output(),
            Self::Capped(policy) => policy.assumes_one_output(),
            Self::Expected(_, _, traits) | Self::Python(_, _, traits) => traits.assumes_one_output,
        }
    }

    fn needs_linger(&self) -> bool {
        match self {
            Self::Constant(policy) => policy.needs_linger(),
            Self::Guard(policy) => policy.needs_linger(),
            Self::Capped(policy) => policy.needs_linger(),
            Self::Expected(_, _, traits) | Self::Python(_, _, traits) => traits.needs_linger,
        }
    }
}

impl PolicyClasses {
    fn get(py: Python<'_>) -> PyResult<&'static Self> {
        CLASSES.get_or_try_init(py, || {
            let module = py.import("fuseline.deadline")?;
            let end = |name: &str| Ok::<_, PyErr>(module.getattr("End")?.getattr(name)?.unbind());
            Ok(Self {
                situation: module.getattr("Situation")?.unbind(),
                answered: end("ANSWERED")?,
                failed: end("FAILED")?,
                censored: end("CENSORED")?,
            })
        })
    }
}

/// Calls Python, and handles its error.
fn called<T>(interrupt: &PendingException, call: impl FnOnce(Python<'_>) -> PyResult<T>) -> T {
    Python::attach(call).unwrap_or_else(|error| failed(interrupt, error))
}

/// Reports an error and panics. The engine catches the panic of a policy and makes no request.
fn failed(interrupt: &PendingException, error: PyErr) -> ! {
    Python::attach(|py| {
        // A policy has nothing that can be cancelled. This error means that it asked for the result
        // of something that was.
        if error.is_instance_of::<PyException>(py) || error.is_instance_of::<CancelledError>(py) {
            logging::exception(py, "a policy failed", error);
        } else {
            interrupt.set(error);
        }
    });
    // Unlike a panic, this prints nothing.
    resume_unwind(Box::new("a policy failed"))
}

fn situation_of(py: Python<'_>, situation: &Situation<'_>) -> PyResult<Py<PyAny>> {
    let Span { least, greatest } = situation.speed.map(|speed| speed.0);
    let speed = if least.to_bits() == greatest.to_bits() {
        PyFloat::new(py, least).into_any()
    } else {
        (least, greatest).into_pyobject(py)?.into_any()
    };
    let classes = AnswerClasses::get(py)?;
    let ages = situation.under_way.iter().map(|age| classes.ns(py, nanos(*age)));
    let ages = PyList::new(py, ages.collect::<PyResult<Vec<_>>>()?)?;
    let reveal = situation.reveal.map(|reveal| reveal.0);
    PolicyClasses::get(py)?.situation.call1(py, (speed, reveal, ages))
}

/// Reads an object with the attributes of `Chosen`. A plain int is nanoseconds, because arithmetic
/// with an `ns` gives one.
fn chosen(object: &Bound<'_, PyAny>) -> PyResult<Chosen> {
    let py = object.py();
    let given = object.getattr(intern!(py, "deadline"))?;
    let is_int = given.is_instance_of::<PyInt>() && !given.is_instance_of::<PyBool>();
    let nanos = if is_int { given.extract::<Number>()?.0 } else { given.extract::<Nanos>()?.0 };
    let reason = object.getattr(intern!(py, "reason"))?;
    let word: String = reason.getattr(intern!(py, "value"))?.extract()?;
    let reason = match &*word {
        "constant" => Reason::Constant,
        "guard" => Reason::Guard(case(&object.getattr(intern!(py, "case"))?)?),
        "expected" => {
            let loss: Option<f64> = object.getattr(intern!(py, "loss"))?.extract()?;
            Reason::Expected { loss: loss.unwrap_or(f64::NAN) }
        }
        "probe" => Reason::Probe,
        "cap" => Reason::Cap,
        _ => return Err(PyTypeError::new_err(format!("{}: no Reason", reason.repr()?))),
    };
    Ok(Chosen { deadline: Duration::from_nanos(nanos), reason })
}

fn case(object: &Bound<'_, PyAny>) -> PyResult<Case> {
    let number: Option<u8> =
        object.getattr(intern!(object.py(), "value")).and_then(|it| it.extract()).ok();
    match number {
        Some(1) => Ok(Case::LocalStops),
        Some(2) => Ok(Case::CloudAlone),
        Some(3) => Ok(Case::Unsure),
        _ => {
            Err(PyTypeError::new_err(format!("{}: the guard's reason has a Case", object.repr()?)))
        }
    }
}
