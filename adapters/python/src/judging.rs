//! Reads, judges and replays traces, with the interpreter's lock released.

use std::io::BufRead;

use fuseline_engine::arbiter::Arbiter;
use fuseline_report::{JudgeMode, PageWriter, TraceJudge};
use fuseline_traces::observed::Slack;
use fuseline_traces::{
    Annotations, Cloud, Decision, Event, Events, Header, HeldValues, Input, Origin, Verdict,
    Violation,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::raised::{config, unjudged, unreadable};
use crate::reading::with_trace;
use crate::time::Nanos;

/// A verdict's fields in the order of `fuseline.Verdict`. Its violations are in the same form.
pub(crate) type VerdictFields =
    (String, bool, u64, u64, Vec<ViolationFields>, u64, Vec<DoubtFields>, Option<String>);
/// Kind, count, what was found, and the first message.
pub(crate) type DoubtFields = (&'static str, u64, String, Option<u64>);
pub(crate) type ViolationFields =
    (u64, Option<u64>, &'static str, &'static str, String, String, Option<u64>, Vec<String>);
/// The number and word of a line, then `at`, `t`, `p`, `deadline`, `backlog`, `due` and `why`, and
/// the annotations if there are any.
type Row = (u64, &'static str, u64, CountFields, Option<&'static str>, Option<AnnotationFields>);
/// `of`, `for`, `try`, `within`, `age`, `origin`, `seq` and `missing`.
type AnnotationFields = (
    Option<u64>,
    Option<u64>,
    Option<u8>,
    Option<u64>,
    Option<u64>,
    Option<String>,
    Option<u64>,
    Option<Vec<String>>,
);
type CountFields = (Option<u64>, Option<u64>, Option<u64>, Option<u64>, Option<u64>);

/// A tolerance and a lateness, if a trace is to be judged as observed.
pub(crate) type ObservedSlack = Option<(Nanos, Nanos)>;

/// The tolerances of single sources of an observed trace, by their names.
pub(crate) type SourceTolerances = Vec<(String, Nanos)>;

pub(crate) fn mode(slack: ObservedSlack) -> JudgeMode {
    slack.map(|(tolerance, lateness)| Slack { tolerance: tolerance.0, lateness: lateness.0 })
}

/// Judges a trace, strictly or as observed.
#[pyfunction]
#[pyo3(signature = (trace, name, slack, tolerances, ended, period))]
#[expect(clippy::needless_pass_by_value, reason = "what comes from Python is owned")]
pub(crate) fn check(
    trace: &Bound<'_, PyAny>,
    name: Option<String>,
    slack: ObservedSlack,
    tolerances: SourceTolerances,
    ended: bool,
    period: Option<Nanos>,
) -> PyResult<VerdictFields> {
    let known = KnownRun { ended, period: period.map(|Nanos(period)| period) };
    with_trace(trace, name, |name, trace| {
        Ok(verdict_fields(judged((slack, &tolerances), known, name, trace, |_, _| {})?.1))
    })
}

/// The facts about a run besides its trace.
#[derive(Clone, Copy, Default)]
pub(crate) struct KnownRun {
    /// `true` if the run is over, so that everything that was due is overdue.
    ended: bool,
    /// The nanoseconds from one open to the next (J1).
    period: Option<u64>,
}

/// Judges a trace as it is read, and gives `each` every event with the header.
pub(crate) fn judged(
    (slack, tolerances): (ObservedSlack, &SourceTolerances),
    known: KnownRun,
    name: &str,
    trace: impl BufRead,
    mut each: impl FnMut(&Header, &Event),
) -> PyResult<(Header, Verdict)> {
    let mode = mode(slack);
    let mut reader = reader(mode, name, trace)?;
    let mut judging = TraceJudge::new(mode, name, reader.header())
        .with_header_annotations(reader.header_annotations());
    for (p, tolerance) in by_priority(tolerances, name, reader.header())? {
        judging = judging.with_tolerance_of(p, tolerance);
    }
    if let Some(period) = known.period {
        judging = judging.with_period(period);
    }
    while let Some(event) = reader.next_event().map_err(unreadable)? {
        judging
            .annotated_line(reader.line(), &event, reader.annotations())
            .map_err(|disorder| unjudged(&disorder))?;
        each(reader.header(), &event);
    }
    let findings = if known.ended { judging.finish_ended() } else { judging.finish() };
    Ok((reader.header().clone(), findings))
}

/// Judges traces and writes the page about them. Returns the verdicts and the page's HTML.
#[pyfunction]
#[pyo3(signature = (traces, slack, tolerances))]
#[expect(clippy::needless_pass_by_value, reason = "what comes from Python is owned")]
pub(crate) fn report<'py>(
    py: Python<'py>,
    traces: Vec<(Bound<'py, PyAny>, Option<String>)>,
    slack: ObservedSlack,
    tolerances: SourceTolerances,
) -> PyResult<(Vec<VerdictFields>, Bound<'py, PyBytes>)> {
    let (mut page, mode) = (PageWriter::default(), mode(slack));
    let mut verdicts = Vec::with_capacity(traces.len());
    for (trace, name) in traces {
        verdicts.push(with_trace(&trace, name, |name, trace| {
            let mut reader = reader(mode, name, trace)?;
            let mut trace_page = page
                .begin(mode, name, reader.header())
                .with_header_annotations(reader.header_annotations());
            for (p, tolerance) in by_priority(&tolerances, name, reader.header())? {
                trace_page = trace_page.with_tolerance_of(p, tolerance);
            }
            while let Some(event) = reader.next_event().map_err(unreadable)? {
                trace_page
                    .annotated_event(reader.line(), event, reader.annotations())
                    .map_err(|error| unjudged(&error))?;
            }
            Ok(verdict_fields(trace_page.finish()))
        })?);
    }
    let html = py.detach(|| {
        let mut html = Vec::new();
        page.write(&mut html).map(|()| html)
    })?;
    Ok((verdicts, PyBytes::new(py, &html)))
}

/// Returns the priorities of the named sources, each with its tolerance in nanoseconds.
fn by_priority(
    tolerances: &SourceTolerances,
    file: &str,
    header: &Header,
) -> PyResult<Vec<(u64, u64)>> {
    let name_of = |cloud: &Cloud| match &cloud.name {
        Some(name) => name.clone(),
        None => format!("cloud-{}", cloud.p),
    };
    let clouds = header.clouds.iter().map(|cloud| (name_of(cloud), u64::from(cloud.p)));
    let sources: Vec<_> = std::iter::once(("local".to_owned(), 0)).chain(clouds).collect();
    let mut found = Vec::new();
    for (wanted, tolerance) in tolerances {
        let named = sources.iter().filter(|(name, _)| name == wanted);
        let before = found.len();
        found.extend(named.map(|(_, p)| (*p, tolerance.0)));
        if found.len() == before {
            let known = sources.iter().map(|(name, _)| &**name).collect::<Vec<_>>().join(", ");
            let message =
                format!("{file}: a tolerance is given for {wanted:?}; the header has {known}");
            return Err(PyValueError::new_err(message));
        }
    }
    Ok(found)
}

fn reader<R: BufRead>(mode: JudgeMode, name: &str, trace: R) -> PyResult<Events<R>> {
    let read = if mode.is_none() { Events::new } else { Events::observed };
    read(name, trace).map_err(unreadable)
}

/// Returns a verdict in the form that the package takes.
pub(crate) fn verdict_fields(verdict: Verdict) -> VerdictFields {
    let Verdict { file, conforms, judged, lines, doubts, cause, violations, more, .. } = verdict;
    let doubts = doubts.into_iter().map(|it| (it.kind.as_str(), it.count, it.found, it.t));
    let violations = violations.into_iter().map(|it| {
        let Violation { line, t, rule, found, expected, late, story } = it;
        (line, t, rule.id(), rule.sentence(), found, expected, late, story)
    });
    (file, conforms, judged, lines, violations.collect(), more, doubts.collect(), cause)
}

/// Returns the whole trace: the inputs unchanged, and the machine's decisions.
#[pyfunction]
#[pyo3(signature = (trace, name))]
pub(crate) fn replay<'py>(
    trace: &Bound<'py, PyAny>,
    name: Option<String>,
) -> PyResult<Bound<'py, PyBytes>> {
    let whole = with_trace(trace, name, |name, trace| {
        let mut reader = Events::new(name, trace).map_err(unreadable)?;
        let mut arbiter = Arbiter::<15, 1024>::new(reader.header()).map_err(config)?;
        let (mut values, mut decisions) = (HeldValues::default(), Vec::new());
        let mut out = reader.raw().to_vec();
        out.push(b'\n');
        while let Some(event) = reader.next_event().map_err(unreadable)? {
            if let Event::Input(input) = event {
                out.extend_from_slice(reader.raw());
                out.push(b'\n');
                decisions.clear();
                arbiter.decide(&input, |decision| decisions.push(decision));
                // An emit states the same about its value as the result that it sends did (D2,
                // D18).
                values.apply(&input, reader.annotations().value(), decisions.iter());
                for decision in &decisions {
                    let sent = values.sent(decision);
                    Event::Decision(*decision).write_annotated(&sent.into(), &mut out);
                    out.push(b'\n');
                }
            }
        }
        Ok(out)
    })?;
    Ok(PyBytes::new(trace.py(), &whole))
}

/// Returns a trace's name, its header, and its lines as rows.
#[pyfunction]
#[pyo3(signature = (trace, name))]
pub(crate) fn read(
    trace: &Bound<'_, PyAny>,
    name: Option<String>,
) -> PyResult<(String, String, Vec<Row>)> {
    with_trace(trace, name, |name, trace| {
        let mut reader = Events::observed(name, trace).map_err(unreadable)?;
        let mut header = Vec::new();
        reader.header().write_annotated(reader.header_annotations(), &mut header);
        let header = String::from_utf8_lossy(&header).into_owned();
        let mut rows = Vec::new();
        while let Some(event) = reader.next_event().map_err(unreadable)? {
            rows.push(row(reader.line(), &event, reader.annotations()));
        }
        Ok((name.to_owned(), header, rows))
    })
}

fn row(line: u64, event: &Event, annotations: &Annotations) -> Row {
    let (word, at, numbers, why) = match *event {
        Event::Input(input) => match input {
            Input::Open { at, t, deadline } => {
                ("open", at, (Some(t), None, deadline, None, None), None)
            }
            Input::Offer { at, t, p, deadline, backlog } => {
                ("offer", at, (Some(t), Some(p), Some(deadline), Some(backlog), None), None)
            }
            Input::Result { at, t, p } => ("result", at, of(t, p), None),
            Input::Fail { at, t, p } => ("fail", at, of(t, p), None),
            Input::Tick { at } => ("tick", at, (None, None, None, None, None), None),
        },
        Event::Decision(decision) => match decision {
            Decision::Timer { at, t, p } => ("timer", at, of(t, p), None),
            Decision::RefuseOpen { at, t, why } => {
                ("refuse", at, (Some(t), None, None, None, None), Some(why.as_str()))
            }
            Decision::RefuseOffer { at, t, p, why } => ("refuse", at, of(t, p), Some(why.as_str())),
            Decision::Request { at, t, p, due } => {
                ("request", at, (Some(t), Some(p), None, None, Some(due)), None)
            }
            Decision::Hold { at, t, p } => ("hold", at, of(t, p), None),
            Decision::Drop { at, t, p, why } => ("drop", at, of(t, p), Some(why.as_str())),
            Decision::Emit { at, t, p } => ("emit", at, of(t, p), None),
            Decision::Final { at, t, p } => ("final", at, of(t, p), None),
            Decision::Miss { at, t } => ("miss", at, (Some(t), None, None, None, None), None),
            Decision::Cancel { at, t, p } => ("cancel", at, of(t, p), None),
        },
    };
    let further = (!annotations.is_empty()).then(|| {
        let Annotations { of, meant_for, attempt, within, age, origin, missing } =
            annotations.clone();
        let (stream, seq) = match origin {
            Some(Origin { stream, seq }) => (Some(stream.as_ref().to_owned()), seq),
            None => (None, None),
        };
        let missing: Vec<String> = missing.iter().map(ToString::to_string).collect();
        let missing = Some(missing).filter(|missing| !missing.is_empty());
        (of, meant_for, attempt, within, age, stream, seq, missing)
    });
    (line, word, at, numbers, why, further)
}

const fn of(t: u64, p: u64) -> CountFields {
    (Some(t), Some(p), None, None, None)
}
