//! The machine.

use fuseline_core::{Deadline, Firing, OfferRefusal, Priority, Timestamp};
use fuseline_engine::arbiter::{Answer, Arbiter, decisions_of};
use fuseline_traces as trace;
use fuseline_traces::{Header, Input, Line};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyTuple};

use crate::answer_classes::{AnswerClasses, CLOUDS};
use crate::raised::config;
use crate::time::{Nanos, Number};

/// The firings before an input, then the input's own answer.
type FiredThenAnswer = (Py<PyTuple>, Py<PyAny>);

/// Decides for one operator: inputs go in with their instants, and answers come out.
///
/// It reads no clock.
///
/// Every input first fires what is due by its instant (F5), and only then is applied (F0). So each
/// answer is a pair: the firings in their order, then the input's own answer. Act upon a
/// `Forwarded` or `Missed` in either.
///
/// Instants are whole nanoseconds of one monotonic clock, such as `time.monotonic_ns()`, exact from
/// 0 to 2**64 - 1. A deadline is seconds as a float (rounded to the nearest nanosecond), a
/// `timedelta`, or nanoseconds as `ns`.
///
/// If several threads call it, each call is applied completely before the next.
///
/// Args:
///     clouds: Up to 15, in any order.
///     window: The greatest number of timestamps that may be open at once, 1 to 1024.
///     commit: Decides when a result is forwarded although a better one is pending (F6, F9).
///     operator: The operator's name, for people.
///     record: True to record the lines that `take_trace` returns.
///
/// Raises:
///     `ConfigError`: if no machine can have this configuration.
///
/// >>> from fuseline import Cloud, Fusion
/// >>> fusion = Fusion([Cloud(1)], window=16)
/// >>> fired, opening = fusion.open(0, 7)
/// >>> opening
/// Accepted()
/// >>> fusion.offer(0, 7, 1, deadline=0.5)
/// ((), Admitted(due=500000000))
/// >>> fusion.result(3_000_000, 7, 0)  # local's: the cloud may still answer
/// ((), Held())
/// >>> fusion.tick(fusion.next_due)
/// (Firing(t=7, due=500000000, timers=(1,), outcome=Forwarded(by=0, cancelled=())),)
#[pyclass(name = "Fusion", module = "fuseline")]
pub(crate) struct PyFusion {
    arbiter: Arbiter,
    header: Header,
    /// The lines that were recorded since they were last taken, or `None` if nothing is recorded.
    recorded: Option<Vec<u8>>,
}

/// A window that fits, or a description of the value that was given instead.
pub(crate) struct WindowArgument(Result<u16, String>);

/// A text, or its bytes.
#[derive(FromPyObject)]
enum Text {
    Str(String),
    Bytes(Vec<u8>),
}

/// Reads an entry of `clouds`: an object with these attributes.
#[derive(FromPyObject)]
pub(crate) struct CloudEntry<'py> {
    p: Bound<'py, PyAny>,
    limit: Number,
    resume: Option<Number>,
    name: Option<String>,
}

#[pymethods]
impl PyFusion {
    #[new]
    #[pyo3(
        signature = (clouds=Vec::new(), *, window=WindowArgument(Ok(16)), commit="eager", operator=None, record=false),
        text_signature = "(clouds=(), *, window=16, commit='eager', operator=None, record=False)"
    )]
    fn new(
        clouds: Vec<CloudEntry<'_>>,
        window: WindowArgument,
        commit: &str,
        operator: Option<String>,
        record: bool,
    ) -> PyResult<Self> {
        Self::of(header(clouds, window, commit, operator)?, record)
    }

    /// Creates a machine with the configuration of a trace's first line.
    ///
    /// The line may have its end of line or not.
    ///
    /// Raises:
    ///     `ConfigError`: if it is no header.
    #[staticmethod]
    #[pyo3(signature = (line, *, record=false))]
    fn from_header(line: &Bound<'_, PyAny>, record: bool) -> PyResult<Self> {
        let line: Text = line.extract()?;
        let line = line.as_bytes();
        let line = line.strip_suffix(b"\n").unwrap_or(line);
        match trace::parse(line) {
            Ok(Line::Header(header)) => Self::of(header, record),
            Ok(Line::Event(_)) => {
                Err(config("this line is an event; a header has the key \"fuseline\""))
            }
            Err(error) => Err(config(format!("column {}: {}", error.column, error.message))),
        }
    }

    /// Opens timestamp `t` for a message (F1). `deadline`, if given, is how long local may take.
    #[pyo3(signature = (now, t, deadline=None))]
    fn open(
        slf: &Bound<'_, Self>,
        now: Number,
        t: Number,
        deadline: Option<Nanos>,
    ) -> PyResult<FiredThenAnswer> {
        let deadline = deadline.map(|deadline| deadline.0);
        answer(slf, &Input::Open { at: now.0, t: t.0, deadline })
    }

    /// Offers a request to cloud `p` (F2). `backlog` requests already wait in its queue.
    #[pyo3(
        signature = (now, t, p, deadline, backlog=Number(0)),
        text_signature = "($self, now, t, p, deadline, backlog=0)"
    )]
    fn offer(
        slf: &Bound<'_, Self>,
        now: Number,
        t: Number,
        p: Number,
        deadline: Nanos,
        backlog: Number,
    ) -> PyResult<FiredThenAnswer> {
        let (deadline, backlog) = (deadline.0, backlog.0);
        answer(slf, &Input::Offer { at: now.0, t: t.0, p: p.0, deadline, backlog })
    }

    /// Applies the result of source `p` (F3). Source 0 is local.
    #[pyo3(signature = (now, t, p))]
    fn result(
        slf: &Bound<'_, Self>,
        now: Number,
        t: Number,
        p: Number,
    ) -> PyResult<FiredThenAnswer> {
        answer(slf, &Input::Result { at: now.0, t: t.0, p: p.0 })
    }

    /// Reports that no result will come from source `p` (F4). Source 0 is local.
    #[pyo3(signature = (now, t, p))]
    fn fail(slf: &Bound<'_, Self>, now: Number, t: Number, p: Number) -> PyResult<FiredThenAnswer> {
        answer(slf, &Input::Fail { at: now.0, t: t.0, p: p.0 })
    }

    /// Lets time pass, and returns what fired (F0). Call it at `next_due`.
    #[pyo3(signature = (now))]
    fn tick(slf: &Bound<'_, Self>, now: Number) -> PyResult<Py<PyTuple>> {
        let py = slf.py();
        let (fired, _) = slf.borrow_mut().apply(&Input::Tick { at: now.0 });
        AnswerClasses::get(py)?.firings(py, &fired)
    }

    /// Returns why an offer with a deadline above 0 would be refused now, or None if it would be
    /// admitted.
    #[pyo3(
        signature = (t, p, backlog=Number(0)),
        text_signature = "($self, t, p, backlog=0)"
    )]
    fn foresee(
        slf: &Bound<'_, Self>,
        t: Number,
        p: Number,
        backlog: Number,
    ) -> PyResult<Option<Py<PyAny>>> {
        let py = slf.py();
        let why = match u16::try_from(p.0) {
            Err(_) => Some(OfferRefusal::Unknown),
            Ok(p) => slf.borrow().arbiter.fusion().offer_refusal(
                Timestamp::new(t.0),
                Priority::new(p),
                Deadline::from_nanos(u64::MAX),
                backlog.0,
            ),
        };
        why.map(|why| AnswerClasses::get(py)?.refusal(py, why)).transpose()
    }

    /// Returns the earliest due instant of all armed timers in nanoseconds, or None if there is
    /// none.
    #[getter]
    fn next_due(&self) -> Option<u64> {
        self.arbiter.next_due()
    }

    /// Returns the machine's clock: the greatest instant given so far, in nanoseconds.
    #[getter]
    fn now(&self) -> u64 {
        self.arbiter.now()
    }

    /// Returns the greatest timestamp ever opened, or None if there is none.
    #[getter]
    fn newest(&self) -> Option<u64> {
        self.arbiter.fusion().newest().map(Timestamp::as_u64)
    }

    /// Returns the commit rule, as a word.
    #[getter]
    const fn commit(&self) -> &'static str {
        self.header.commit.as_str()
    }

    /// Returns the header of this machine's trace, without its end of line.
    #[getter]
    fn header(&self) -> String {
        self.header.to_string()
    }

    /// Returns the due instant of the timer of (t, p) in nanoseconds, or None if it is not armed.
    fn due(&self, t: Number, p: Number) -> Option<u64> {
        let p = Priority::new(u16::try_from(p.0).ok()?);
        self.arbiter.fusion().due(Timestamp::new(t.0), p).map(fuseline_core::Instant::as_nanos)
    }

    /// Returns whole lines of the trace: everything that was recorded since the last call.
    fn take_trace<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        match &mut self.recorded {
            Some(recorded) => Ok(PyBytes::new(py, &std::mem::take(recorded))),
            None => Err(config("this machine records nothing; make it with record=True")),
        }
    }

    fn __len__(&self) -> usize {
        self.arbiter.fusion().len()
    }

    #[expect(clippy::unused_self, reason = "Python has it so")]
    const fn __bool__(&self) -> bool {
        true
    }

    fn __contains__(&self, t: &Bound<'_, PyAny>) -> bool {
        let Ok(Number(t)) = t.extract() else { return false };
        self.arbiter.fusion().slot(Timestamp::new(t)).is_some()
    }

    fn __repr__(&self) -> String {
        let Header { operator, window, commit, clouds } = &self.header;
        let name = operator.as_ref().map_or_else(String::new, |name| format!("{name:?}, "));
        let clouds: Vec<_> = clouds.iter().map(|cloud| cloud.p).collect();
        let due = self.next_due().map_or_else(|| "None".to_owned(), |due| due.to_string());
        format!(
            "Fusion({name}clouds={clouds:?}, window={window}, commit={}, open={}, now={}, next_due={due})",
            commit.as_str(),
            self.__len__(),
            self.now(),
        )
    }

    #[expect(clippy::unused_self, reason = "Python has it so")]
    fn __reduce__(&self) -> PyResult<()> {
        Err(PyTypeError::new_err(
            "a Fusion is not pickled or copied: two of them would answer for one operator; \
             record its inputs and replay them instead",
        ))
    }
}

impl PyFusion {
    fn of(header: Header, record: bool) -> PyResult<Self> {
        let arbiter = Arbiter::new(&header).map_err(config)?;
        let recorded = record.then(|| format!("{header}\n").into_bytes());
        Ok(Self { arbiter, header, recorded })
    }

    /// Applies an input. Returns the firings before it, and its answer.
    fn apply(&mut self, input: &Input) -> (Vec<Firing<CLOUDS>>, Answer<CLOUDS>) {
        let mut fired = Vec::new();
        let answer = self.arbiter.apply(input, |_, firing| fired.push(*firing));
        if let Some(recorded) = &mut self.recorded {
            let now = self.arbiter.now();
            let end = |out: &mut Vec<u8>| out.push(b'\n');
            input.write(recorded);
            end(recorded);
            let mut decide = |decision: trace::Decision| {
                decision.write(recorded);
                end(recorded);
            };
            for firing in &fired {
                decisions_of(now, firing, &mut decide);
            }
            answer.decisions(self.arbiter.fusion().commit(), now, &mut decide);
        }
        (fired, answer)
    }
}

impl<'py> FromPyObject<'_, 'py> for WindowArgument {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let window = if object.is_instance_of::<PyBool>() { None } else { object.extract().ok() };
        Ok(Self(window.ok_or_else(|| object.to_string())))
    }
}

impl Text {
    fn as_bytes(&self) -> &[u8] {
        match self {
            Self::Str(text) => text.as_bytes(),
            Self::Bytes(bytes) => bytes,
        }
    }
}

/// Applies an input. The machine is free again while Python's own classes make the answer.
fn answer(slf: &Bound<'_, PyFusion>, input: &Input) -> PyResult<FiredThenAnswer> {
    let py = slf.py();
    let classes = AnswerClasses::get(py)?;
    let (fired, answer) = slf.borrow_mut().apply(input);
    let own = match answer {
        Answer::Open { opening, .. } => classes.opening(py, opening)?,
        Answer::Offer { admission, .. } => classes.admission(py, admission)?,
        Answer::Result { outcome, .. } | Answer::Fail { outcome, .. } => {
            classes.outcome(py, &outcome)?
        }
        Answer::Tick => py.None(),
    };
    Ok((classes.firings(py, &fired)?, own))
}

/// Returns the configuration of a machine as its trace's header has it.
pub(crate) fn header(
    clouds: Vec<CloudEntry<'_>>,
    window: WindowArgument,
    commit: &str,
    operator: Option<String>,
) -> PyResult<Header> {
    let window = window
        .0
        .map_err(|window| config(format!("a window of {window}; it must be from 1 to 1024")))?;
    let Some(commit) = trace::Commit::ALL.into_iter().find(|rule| rule.as_str() == commit) else {
        let words = "it must be eager, patient or progressive";
        return Err(config(format!("a commit rule {commit}; {words}")));
    };
    let clouds = clouds.into_iter().map(cloud).collect::<PyResult<_>>()?;
    Ok(Header { operator, window, commit, clouds })
}

fn cloud(entry: CloudEntry<'_>) -> PyResult<trace::Cloud> {
    let CloudEntry { p, limit: Number(limit), resume, name } = entry;
    let Some(p) = p.extract::<u16>().ok().filter(|p| *p > 0) else {
        return Err(config(format!("a cloud with priority {p}; it must be from 1 to 65535")));
    };
    let resume = resume.map_or(limit.saturating_sub(1), |resume| resume.0);
    Ok(trace::Cloud { p, name, limit, resume })
}
