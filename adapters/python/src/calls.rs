//! Carries out the decisions of an operator's engine: begins and ends calls, and hands out items.
//!
//! It stands between the engine and the package's `Driver`, which handles rare cases.

mod source;
mod task;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use fuseline_engine::{Ending, Item, StampedValue};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyIterator, PyList, PyTuple};

use crate::calls::source::{CallClasses, SourceArgument, SourceEntry};
use crate::calls::task::SourceCall;
use crate::engine::{EngineEffect, LineageFields, PyCounting, PyEngine};
use crate::time::{Nanos, Number};

/// Nothing is due.
const NEVER: u64 = u64::MAX;

/// The calls of one operator. Instants are nanoseconds since it started.
#[pyclass(name = "Calls", module = "fuseline._fuseline", frozen)]
pub(crate) struct PyCalls {
    engine: Py<PyEngine>,
    /// The package's `Driver`.
    driver: Py<PyAny>,
    clock: Py<PyAny>,
    /// `true` if the clock is `time.monotonic_ns`, so that durations can be measured without it.
    is_monotonic: bool,
    start: u64,
    now: AtomicU64,
    /// A step that takes at most this many nanoseconds is not counted.
    longest_step: u64,
    counting: PyCounting,
    local_deadline: Option<Duration>,
    sources: Vec<SourceEntry>,
    /// The event loop's `create_task`.
    create_task: Py<PyAny>,
    output: Py<PyAny>,
    /// Called after an input if somebody waits for room, or no more messages come.
    acted: Py<PyAny>,
    waiting: Py<PyList>,
    lineages: Py<PyDict>,
    states: Py<PyList>,
    /// `true` if each item goes through the driver.
    handles_items: bool,
    is_deciding: AtomicBool,
    is_closed: AtomicBool,
    is_last: AtomicBool,
    is_over: AtomicBool,
    /// The instant to which the timer is set.
    armed: AtomicU64,
}

#[pymethods]
impl PyCalls {
    /// Creates the calls of an operator.
    ///
    /// With `handles_items` the driver looks at each item. Otherwise it looks only at items that
    /// have a lineage or no result, and at all items once there are `states`. `acted` is called
    /// after an input while anybody is in `waiting`.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "they are what a driver is made of")]
    fn new(
        py: Python<'_>,
        engine: Py<PyEngine>,
        driver: Py<PyAny>,
        clock: Bound<'_, PyAny>,
        longest_step: u64,
        counting: &Bound<'_, PyCounting>,
        local_deadline: Option<Nanos>,
        sources: Vec<SourceArgument<'_>>,
        create_task: Py<PyAny>,
        output: Py<PyAny>,
        acted: Py<PyAny>,
        waiting: Py<PyList>,
        lineages: Py<PyDict>,
        states: Py<PyList>,
        handles_items: bool,
    ) -> PyResult<Self> {
        let monotonic = py.import("time")?.getattr("monotonic_ns")?;
        let sources = sources.into_iter().map(SourceEntry::new).collect::<PyResult<_>>()?;
        Ok(Self {
            engine,
            driver,
            is_monotonic: clock.is(&monotonic),
            start: clock.call0()?.extract()?,
            clock: clock.unbind(),
            now: AtomicU64::new(0),
            longest_step,
            counting: counting.get().clone(),
            local_deadline: local_deadline.map(|Nanos(deadline)| Duration::from_nanos(deadline)),
            sources,
            create_task,
            output,
            acted,
            waiting,
            lineages,
            states,
            handles_items,
            is_deciding: AtomicBool::new(false),
            is_closed: AtomicBool::new(false),
            is_last: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
            armed: AtomicU64::new(NEVER),
        })
    }

    /// Returns the clock's reading at the start.
    #[getter]
    fn start(&self) -> u64 {
        self.start
    }

    /// Returns the nanoseconds since the start. They stand still while the clock goes back.
    fn now(&self, py: Python<'_>) -> PyResult<u64> {
        let read: u64 = self.clock.bind(py).call0()?.extract()?;
        let last = self.now.load(Ordering::Relaxed);
        let now = read.saturating_sub(self.start).max(last);
        self.now.store(now, Ordering::Relaxed);
        Ok(now)
    }

    /// Opens a message (F1) and offers it to clouds (F2).
    ///
    /// `offers` is iterated only if the message is accepted, and gives a cloud's priority, the
    /// request and its deadline. `lineage` is the sensor's stream, the timestamp there, the age and
    /// the end-to-end deadline in nanoseconds, and the inputs that are missing.
    fn open(
        this: &Bound<'_, Self>,
        at: u64,
        t: u64,
        job: Py<PyAny>,
        offers: &Bound<'_, PyIterator>,
        lineage: Option<LineageFields>,
    ) -> PyResult<()> {
        let it = this.get();
        let deadline = it.local_deadline;
        it.decide(this, at, true, |engine| engine.open(at, t, deadline, job, offers, lineage))
    }

    /// Applies a source's result, unless its call was aborted (F3).
    fn came(
        this: &Bound<'_, Self>,
        p: u16,
        t: &Bound<'_, PyAny>,
        value: Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let source = this.get().source(p)?;
        this.get().result(this, source, t, value)
    }

    /// Reports that a source will send no result (F4).
    fn fail(this: &Bound<'_, Self>, at: u64, t: u64, p: u16, why: &str) -> PyResult<()> {
        this.get().decide(this, at, true, |engine| engine.fail(at, t, p, why))
    }

    /// Serves the timer. It may have fired too early (F5).
    fn wake_up(this: &Bound<'_, Self>) -> PyResult<()> {
        let it = this.get();
        it.armed.store(NEVER, Ordering::Relaxed);
        if it.is_over() {
            return Ok(());
        }
        let now = it.now(this.py())?;
        match it.engine.get().next_due()? {
            Some(due) if due <= now => it.decide(this, now, true, |engine| engine.tick(now)),
            _ => it.act(this, now, None),
        }
    }

    /// Ends the input of messages. From now on `acted` is called after each input.
    fn close(&self) {
        self.is_closed.store(true, Ordering::Relaxed);
    }

    /// Ends the operator, and returns `true` if that took effect now.
    ///
    /// Returns `false` if it had already ended. Returns `false` in the midst of an input, too; that
    /// input is then the last one.
    fn stop(&self) -> bool {
        if self.is_deciding.load(Ordering::Relaxed) {
            self.is_last.fetch_or(!self.is_over(), Ordering::Relaxed);
            return false;
        }
        !self.is_over.swap(true, Ordering::Relaxed)
    }

    /// Returns `true` if it has ended.
    #[getter]
    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Returns whether no message is open and nothing is being decided, or the operator is over.
    #[getter]
    fn is_idle(&self) -> PyResult<bool> {
        Ok(self.is_over()
            || (!self.is_deciding.load(Ordering::Relaxed) && self.engine.get().is_idle()?))
    }

    /// Returns whether fewer messages are open than the window holds, as far as is known now.
    fn has_room(&self, window: usize) -> PyResult<bool> {
        Ok(self.is_over()
            || (!self.is_deciding.load(Ordering::Relaxed)
                && self.engine.get().open_len()? < window))
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        for it in [&self.driver, &self.clock, &self.create_task, &self.output, &self.acted] {
            visit.call(it)?;
        }
        visit.call(&self.engine)?;
        visit.call(&self.waiting)?;
        visit.call(&self.lineages)?;
        visit.call(&self.states)?;
        for source in &self.sources {
            visit.call(&source.in_flight)?;
            visit.call(&source.aborted)?;
            visit.call(&source.handle)?;
            if let Some(handler) = &source.response_handler {
                visit.call(handler)?;
            }
        }
        Ok(())
    }
}

impl PyCalls {
    fn source(&self, p: u16) -> PyResult<&SourceEntry> {
        let found = self.sources.iter().find(|source| source.p == p);
        found.ok_or_else(|| pyo3::exceptions::PyKeyError::new_err(p))
    }

    /// Applies a result (F3).
    fn result(
        &self,
        this: &Bound<'_, Self>,
        source: &SourceEntry,
        t: &Bound<'_, PyAny>,
        value: Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let py = this.py();
        let in_flight = source.in_flight.bind(py);
        if !in_flight.contains(t)? {
            return Ok(());
        }
        let checked = stamped(py, value).and_then(|StampedValue { value, of, meant_for }| {
            let is_plain = task::is_plain(&value);
            if !is_plain {
                CallClasses::get(py)?.check_result.bind(py).call1((&value,))?;
            }
            let is_changed = source.copies && !(is_plain && is_unchangeable(&value));
            let value = if is_changed {
                CallClasses::get(py)?.snapshot.bind(py).call1((value,))?
            } else {
                value
            };
            Ok(StampedValue { value, of, meant_for })
        });
        let StampedValue { value, of, meant_for } = match checked {
            Ok(stamped) => stamped,
            Err(error) => {
                // A value that cannot be read is a failure (D7).
                let arguments = (source.p, t, error.into_value(py));
                return self
                    .driver
                    .bind(py)
                    .call_method1(intern!(py, "_failed"), arguments)
                    .map(drop);
            }
        };
        if value.is_none() {
            let arguments = (source.p, t);
            return self
                .driver
                .bind(py)
                .call_method1(intern!(py, "_without_value"), arguments)
                .map(drop);
        }
        in_flight.del_item(t)?;
        let (now, t) = (self.now(py)?, t.extract()?);
        // If the engine wants nothing done, nothing is due earlier than before.
        let value = StampedValue { value: value.unbind(), of, meant_for };
        self.decide(this, now, false, |engine| engine.result(now, t, source.p, value))
    }

    /// Applies an input, and carries out what the engine decides.
    fn decide(
        &self,
        this: &Bound<'_, Self>,
        now: u64,
        always: bool,
        input: impl FnOnce(&PyEngine) -> PyResult<Option<EngineEffect>>,
    ) -> PyResult<()> {
        let py = this.py();
        self.is_deciding.store(true, Ordering::Relaxed);
        // An exception that is not an error of a handler is raised after all decisions are carried
        // out.
        let (first, raised) = match input(self.engine.get()) {
            Ok(first) => (first, None),
            Err(raised) => (None, Some(raised)),
        };
        let acts = always || first.is_some() || raised.is_some();
        let done = if acts { self.act(this, now, first) } else { Ok(()) };
        self.is_deciding.store(false, Ordering::Relaxed);
        if self.is_last.load(Ordering::Relaxed) {
            self.driver.bind(py).call_method0(intern!(py, "stop"))?;
        }
        let is_awaited =
            self.is_closed.load(Ordering::Relaxed) || !self.waiting.bind(py).is_empty();
        let done = done.and_then(|()| {
            if acts && is_awaited { self.acted.bind(py).call0().map(drop) } else { Ok(()) }
        });
        raised.map_or(done, Err)
    }

    /// Carries out what the engine decides.
    fn act(&self, this: &Bound<'_, Self>, now: u64, first: Option<EngineEffect>) -> PyResult<()> {
        let py = this.py();
        let mut next = first;
        loop {
            let effect = match next.take() {
                Some(effect) => effect,
                None => match self.engine.get().next_effect()? {
                    Some(effect) => effect,
                    None => break,
                },
            };
            match effect {
                EngineEffect::Start { priority, timestamp, until, request } => {
                    self.begin(this, now, priority, timestamp, until, request)?;
                }
                EngineEffect::Output(item) => self.give(py, item)?,
                EngineEffect::Abort { priority, timestamp } => {
                    let abort = intern!(py, "_abort");
                    self.driver.bind(py).call_method1(abort, (priority, timestamp))?;
                }
                EngineEffect::Replace { timestamp } => {
                    self.driver.bind(py).call_method1(intern!(py, "_replace"), (timestamp,))?;
                }
                EngineEffect::Hint(_) => {}
            }
        }
        if self.is_over() { Ok(()) } else { self.arm(py, now) }
    }

    fn give(&self, py: Python<'_>, item: Item<Py<PyAny>>) -> PyResult<()> {
        let is_result = !matches!(item.ending, Ending::Missed | Ending::Refused(_));
        let item = self.engine.get().item(py, item)?;
        let is_plain = is_result
            && !self.handles_items
            && self.lineages.bind(py).is_empty()
            && self.states.bind(py).is_empty();
        if is_plain {
            self.output.bind(py).call1((item,))?;
        } else {
            self.driver.bind(py).call_method1(intern!(py, "_give"), (item,))?;
        }
        Ok(())
    }

    fn begin(
        &self,
        this: &Bound<'_, Self>,
        now: u64,
        p: u16,
        t: u64,
        until: Option<u64>,
        request: Py<PyAny>,
    ) -> PyResult<()> {
        if self.is_over() || self.is_last.load(Ordering::Relaxed) {
            return Ok(());
        }
        let (py, source) = (this.py(), self.source(p)?);
        let (in_flight, aborted) = (source.in_flight.bind(py), source.aborted.bind(py));
        let overdue = in_flight.len() + aborted.len();
        if overdue >= source.limit {
            let why = format!("{overdue} calls have not ended, although they should have");
            return self.engine.get().fail_later(now, t, p, &why);
        }
        let timestamp = t.into_pyobject(py)?.into_any();
        // A task may end while it is being created, if the loop's tasks are eager.
        in_flight.set_item(&timestamp, py.None())?;
        // The call gets the time that is left, not the time that was given (D5).
        let left = until.map(|until| seconds(until.saturating_sub(now)));
        let work = match left {
            None => SourceCall::new(this, p, &timestamp, request.into_bound(py), &timestamp),
            Some(left) => {
                let class = CallClasses::get(py)?.call.bind(py);
                let call = if self.lineages.bind(py).is_empty() {
                    class.call1((&timestamp, left))?
                } else {
                    let driver = self.driver.bind(py);
                    driver.call_method1(intern!(py, "_call_of"), (now, &timestamp, left))?
                };
                SourceCall::new(this, p, &timestamp, request.into_bound(py), &call)
            }
        };
        let task = self.create_task.bind(py).call((work,), Some(source.named.bind(py)))?;
        if in_flight.contains(&timestamp)? {
            in_flight.set_item(timestamp, task)?;
        }
        Ok(())
    }

    /// Sets the timer if it has to fire earlier than now set.
    fn arm(&self, py: Python<'_>, now: u64) -> PyResult<()> {
        let Some(due) = self.engine.get().next_due()? else { return Ok(()) };
        if due < self.armed.load(Ordering::Relaxed) {
            self.driver.bind(py).call_method1(intern!(py, "_arm"), (due, now))?;
            self.armed.store(due, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Counts a step of a source if it takes too long.
    fn timed<T>(&self, py: Python<'_>, p: u16, step: impl FnOnce() -> T) -> PyResult<T> {
        let (stepped, took) = if self.is_monotonic {
            let begin = Instant::now();
            let stepped = step();
            (stepped, begin.elapsed())
        } else {
            let read = || self.clock.bind(py).call0()?.extract::<u64>();
            let begin = read()?;
            let stepped = step();
            (stepped, Duration::from_nanos(read()?.saturating_sub(begin)))
        };
        if took > Duration::from_nanos(self.longest_step) {
            self.counting.counting().check_handler_time(Some(p), took);
        }
        Ok(stepped)
    }
}

/// Returns `true` if a plain value holds no other values.
fn is_unchangeable(value: &Bound<'_, PyAny>) -> bool {
    !value.is_exact_instance_of::<PyList>()
        && !value.is_exact_instance_of::<PyDict>()
        && !value.is_exact_instance_of::<PyTuple>()
}

/// Returns a value with the keys that it states about its message.
fn stamped<'py>(
    py: Python<'py>,
    value: Bound<'py, PyAny>,
) -> PyResult<StampedValue<Bound<'py, PyAny>>> {
    if task::is_plain(&value) || !value.is_instance(CallClasses::get(py)?.stamped.bind(py))? {
        return Ok(value.into());
    }
    let of: Option<Number> = value.getattr(intern!(py, "of"))?.extract()?;
    let meant_for: Option<Number> = value.getattr(intern!(py, "meant_for"))?.extract()?;
    let [of, meant_for] = [of, meant_for].map(|number| number.map(|Number(t)| t));
    Ok(StampedValue { value: value.getattr(intern!(py, "value"))?, of, meant_for })
}

/// Divides as Python does, and returns the nearest float.
#[expect(clippy::cast_precision_loss, reason = "Python's division rounds as well")]
fn seconds(nanos: u64) -> f64 {
    nanos as f64 / 1e9
}
