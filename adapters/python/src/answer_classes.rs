//! The machine's answers as objects of the package's own classes, which are plain Python
//! (`_validation.py`).

use fuseline_core as core;
use fuseline_core::{Admission, Firing, Opening, Outcome, Priority};
use fuseline_engine::arbiter::{drop_reason, offer_refusal, open_refusal};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyTuple;

/// The most clouds of a machine.
pub(crate) const CLOUDS: usize = 15;

static CLASSES: PyOnceLock<AnswerClasses> = PyOnceLock::new();

/// The classes, and the answers that are the same object each time.
pub(crate) struct AnswerClasses {
    none: Py<PyTuple>,
    accepted: Py<PyAny>,
    held: Py<PyAny>,
    waiting: Py<PyAny>,
    missed: Py<PyAny>,
    /// Local's result, with nothing to cancel.
    local: Py<PyAny>,
    admitted: Py<PyAny>,
    refused: Py<PyAny>,
    dropped: Py<PyAny>,
    preliminary: Py<PyAny>,
    forwarded: Py<PyAny>,
    last: Py<PyAny>,
    firing: Py<PyAny>,
    open_refusal: Py<PyAny>,
    offer_refusal: Py<PyAny>,
    drop_reason: Py<PyAny>,
    ns: Py<PyAny>,
}

impl AnswerClasses {
    pub(crate) fn get(py: Python<'_>) -> PyResult<&'static Self> {
        CLASSES.get_or_try_init(py, || Self::new(py))
    }

    fn new(py: Python<'_>) -> PyResult<Self> {
        let module = py.import("fuseline._validation")?;
        let class = |name: &str| module.getattr(name);
        let only = |name: &str| Ok::<_, PyErr>(class(name)?.call0()?.unbind());
        let none = PyTuple::empty(py);
        Ok(Self {
            accepted: only("Accepted")?,
            held: only("Held")?,
            waiting: only("Waiting")?,
            missed: only("Missed")?,
            local: class("Forwarded")?.call1((0, &none))?.unbind(),
            none: none.unbind(),
            admitted: class("Admitted")?.unbind(),
            refused: class("Refused")?.unbind(),
            dropped: class("Dropped")?.unbind(),
            preliminary: class("Preliminary")?.unbind(),
            forwarded: class("Forwarded")?.unbind(),
            last: class("Final")?.unbind(),
            firing: class("Firing")?.unbind(),
            open_refusal: class("OpenRefusal")?.unbind(),
            offer_refusal: class("OfferRefusal")?.unbind(),
            drop_reason: class("DropReason")?.unbind(),
            ns: class("ns")?.unbind(),
        })
    }

    /// Creates a duration of this many nanoseconds.
    pub(crate) fn ns(&self, py: Python<'_>, nanos: u64) -> PyResult<Py<PyAny>> {
        self.ns.call1(py, (nanos,))
    }

    /// Returns `true` if the object is an `ns`.
    pub(crate) fn is_ns(&self, object: Borrowed<'_, '_, PyAny>) -> bool {
        object.get_type().is(&self.ns)
    }

    pub(crate) fn opening(&self, py: Python<'_>, opening: Opening) -> PyResult<Py<PyAny>> {
        match opening {
            Opening::Accepted => Ok(self.accepted.clone_ref(py)),
            Opening::Refused(why) => self
                .refused
                .call1(py, (self.open_refusal.call1(py, (open_refusal(why).as_str(),))?,)),
        }
    }

    pub(crate) fn admission(&self, py: Python<'_>, admission: Admission) -> PyResult<Py<PyAny>> {
        match admission {
            Admission::Admitted { due } => self.admitted.call1(py, (due.as_nanos(),)),
            Admission::Refused(why) => self.refused.call1(py, (self.refusal(py, why)?,)),
        }
    }

    pub(crate) fn refusal(&self, py: Python<'_>, why: core::OfferRefusal) -> PyResult<Py<PyAny>> {
        self.offer_refusal.call1(py, (offer_refusal(why).as_str(),))
    }

    pub(crate) fn outcome(&self, py: Python<'_>, outcome: &Outcome<CLOUDS>) -> PyResult<Py<PyAny>> {
        match outcome {
            Outcome::Dropped(why) => {
                let why = self.drop_reason.call1(py, (drop_reason(*why).as_str(),))?;
                self.dropped.call1(py, (why,))
            }
            Outcome::Held => Ok(self.held.clone_ref(py)),
            Outcome::Waiting => Ok(self.waiting.clone_ref(py)),
            Outcome::Missed => Ok(self.missed.clone_ref(py)),
            Outcome::Forwarded { by, cancelled } => {
                if *by == Priority::LOCAL && cancelled.is_empty() {
                    return Ok(self.local.clone_ref(py));
                }
                self.forwarded.call1(py, (by.as_u16(), numbers(py, cancelled.iter())?))
            }
            Outcome::Preliminary { by, cancelled } => {
                self.preliminary.call1(py, (by.as_u16(), numbers(py, cancelled.iter())?))
            }
            Outcome::Final { by } => self.last.call1(py, (by.as_u16(),)),
        }
    }

    pub(crate) fn firings(
        &self,
        py: Python<'_>,
        firings: &[Firing<CLOUDS>],
    ) -> PyResult<Py<PyTuple>> {
        if firings.is_empty() {
            return Ok(self.none.clone_ref(py));
        }
        let firings: PyResult<Vec<_>> = firings
            .iter()
            .map(|firing| {
                let outcome = self.outcome(py, &firing.outcome)?;
                let timers = numbers(py, firing.timers.iter())?;
                let (t, due) = (firing.timestamp.as_u64(), firing.due.as_nanos());
                self.firing.call1(py, (t, due, timers, outcome))
            })
            .collect();
        Ok(PyTuple::new(py, firings?)?.unbind())
    }
}

fn numbers(
    py: Python<'_>,
    priorities: impl Iterator<Item = Priority>,
) -> PyResult<Bound<'_, PyTuple>> {
    PyTuple::new(py, priorities.map(Priority::as_u16).collect::<Vec<_>>())
}
