//! Items, in Python's form.

use fuseline_engine::{Ending, Forwarded, Item, Source, Trigger};
use fuseline_traces::{Header, nanos};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyList;

static CLASSES: PyOnceLock<ItemClasses> = PyOnceLock::new();

/// Creates an `Item` for each output.
pub(crate) struct Effects {
    /// The priority of each source, and its object once it is needed.
    sources: Vec<(u16, PyOnceLock<Py<PyAny>>)>,
}

/// The package's classes that make up an item (`_item.py`).
struct ItemClasses {
    item: Py<PyAny>,
    source: Py<PyAny>,
    failure: Py<PyAny>,
    refusal: Py<PyAny>,
    preliminary: Py<PyAny>,
    forwarded: Py<PyAny>,
    last: Py<PyAny>,
    missed: Py<PyAny>,
    refused: Py<PyAny>,
    arrival: Py<PyAny>,
    failed: Py<PyAny>,
    timer: Py<PyAny>,
}

impl Effects {
    pub(crate) fn new(header: &Header) -> Self {
        let clouds = header.clouds.iter().map(|cloud| cloud.p);
        let sources = std::iter::once(0).chain(clouds).map(|p| (p, PyOnceLock::new()));
        Self { sources: sources.collect() }
    }

    pub(crate) fn item<'py>(
        &self,
        py: Python<'py>,
        item: Item<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let classes = ItemClasses::get(py)?;
        let Item { timestamp, opened, decided, revision, ending, failures, age, .. } = item;
        let of = match &ending {
            Ending::Preliminary(forwarded) | Ending::Forwarded(forwarded) => forwarded.of,
            Ending::Final(_) | Ending::Missed | Ending::Refused(_) => None,
        };
        let failures = failures.into_iter().map(|failed| {
            let source = self.source(py, &failed.source)?;
            classes.failure.bind(py).call1((source, &*failed.why))
        });
        let failures = PyList::new(py, failures.collect::<PyResult<Vec<_>>>()?)?;
        let class = classes.item.bind(py);
        let (opened, decided, none) = (nanos(opened), nanos(decided), py.None());
        let is_preliminary = matches!(ending, Ending::Preliminary(_));
        let item = match ending {
            Ending::Preliminary(forwarded) | Ending::Forwarded(forwarded) => {
                let Forwarded { value, source, arrived, trigger, .. } = forwarded;
                let (source, arrived) = (self.source(py, &source)?, nanos(arrived));
                let trigger = match trigger {
                    Trigger::Arrival => &classes.arrival,
                    Trigger::Failure => &classes.failed,
                    Trigger::Timer => &classes.timer,
                };
                let ending = if is_preliminary { &classes.preliminary } else { &classes.forwarded };
                class.call1((
                    timestamp, opened, decided, ending, value, source, arrived, trigger, none,
                    failures, revision,
                ))
            }
            Ending::Final(source) => {
                let (ending, source) = (&classes.last, self.source(py, &source)?);
                class.call1((
                    timestamp, opened, decided, ending, &none, source, &none, &none, &none,
                    failures, revision,
                ))
            }
            Ending::Missed => {
                let ending = &classes.missed;
                class.call1((
                    timestamp, opened, decided, ending, &none, &none, &none, &none, &none,
                    failures, revision,
                ))
            }
            Ending::Refused(why) => {
                let why = classes.refusal.bind(py).call1((why.as_str(),))?;
                let ending = &classes.refused;
                class.call1((
                    timestamp, opened, decided, ending, &none, &none, &none, &none, why, failures,
                    revision,
                ))
            }
        }?;
        // Few items have these attributes.
        if let Some(age) = age {
            item.setattr(intern!(py, "age"), age.as_secs_f64())?;
        }
        if let Some(of) = of {
            item.setattr(intern!(py, "of"), of)?;
        }
        Ok(item)
    }

    fn source<'py>(&self, py: Python<'py>, source: &Source) -> PyResult<Bound<'py, PyAny>> {
        let made = || {
            let class = ItemClasses::get(py)?.source.bind(py);
            Ok(class.call1((source.priority, &*source.name))?.unbind())
        };
        match self.sources.iter().find(|(p, _)| *p == source.priority) {
            Some((_, cell)) => Ok(cell.get_or_try_init(py, made)?.bind(py).clone()),
            None => made().map(|source| source.into_bound(py)),
        }
    }
}

impl ItemClasses {
    fn get(py: Python<'_>) -> PyResult<&'static Self> {
        CLASSES.get_or_try_init(py, || {
            let items = py.import("fuseline._item")?;
            let class = |name: &str| items.getattr(name).map(Bound::unbind);
            let member = |class: &str, name: &str| {
                Ok::<_, PyErr>(items.getattr(class)?.getattr(name)?.unbind())
            };
            Ok(Self {
                item: class("Item")?,
                source: class("Source")?,
                failure: class("Failure")?,
                refusal: class("OpenRefusal")?,
                preliminary: member("Ending", "PRELIMINARY")?,
                forwarded: member("Ending", "FORWARDED")?,
                last: member("Ending", "FINAL")?,
                missed: member("Ending", "MISSED")?,
                refused: member("Ending", "REFUSED")?,
                arrival: member("Trigger", "ARRIVAL")?,
                failed: member("Trigger", "FAILURE")?,
                timer: member("Trigger", "TIMER")?,
            })
        })
    }
}
