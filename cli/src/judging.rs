//! The strict and the observed judge behind one interface, line by line, and the options that
//! choose between them.

mod beside;

pub(crate) use self::beside::judge_lines;

use std::io::{self, BufRead};
use std::time::Duration;

use fuseline_report::{JudgeMode, TraceJudge, TraceRange};
use fuseline_traces::observed::Slack;
use fuseline_traces::{Cloud, Doubt, DoubtKind, Event, Events, Header, ReadError, Verdict, nanos};
use thiserror::Error;

use crate::duration::{ANY, duration};
use crate::fault::Fault;
use crate::judging_notes::JudgingNotes;
use crate::part::PartOptions;

/// States how the end of a trace is judged.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum TraceEnd {
    /// Whatever has not come by the end of the trace is missing.
    Whole,
    /// The run has ended. Everything that is not in the trace is missing, whenever it was due.
    Ended,
    /// The trace was cut short. What is not in it may still have come.
    Early,
    /// The trace grows. What is not in it may still come.
    Growing,
}

/// The options that say how a trace is judged.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub(crate) struct JudgeOptions {
    /// Judge a recording of a concurrent implementation, each timestamp by itself.
    #[arg(long, requires = "tolerance", requires = "lateness")]
    observed: bool,
    /// The greatest error of a recorded instant, such as 2ms or 500us. With a source's name from
    /// the header, such as server=10ms, the error of its requests, results and failures only; a
    /// cloud without a name is named by its priority.
    #[arg(long, value_name = "[SOURCE=]TIME", requires = "observed", value_parser = tolerance,
        allow_hyphen_values = true)]
    tolerance: Vec<Tolerance>,
    /// The greatest delay of a timer and of an output, such as 5ms.
    #[arg(long, value_name = "TIME", requires = "observed", value_parser = time,
        allow_hyphen_values = true)]
    lateness: Option<Duration>,
    /// The time from one message to the next, such as 100ms. A gap longer than this plus the
    /// lateness and twice the tolerance breaks J1, even from the last open to the end of the trace.
    #[arg(long, value_name = "TIME", requires = "observed", value_parser = time,
        allow_hyphen_values = true)]
    period: Option<Duration>,
    /// Treat the run as ended: whatever is not in the trace never came, and every timer that is
    /// left is overdue. A message that only waits for local is unfinished, and not judged.
    #[arg(long, conflicts_with = "truncated")]
    ended: bool,
    /// Judge a trace that a crash or a full disk cut off: ignore an incomplete last line and
    /// missing last decisions. The verdict says what was ignored.
    #[arg(long)]
    truncated: bool,
    #[command(flatten)]
    accept: AcceptOption,
    #[arg(long, hide = true)]
    require_judged: bool,
    #[command(flatten)]
    part: PartOptions,
}

/// The doubts that the user accepts.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct AcceptOption {
    /// Accept these kinds of doubt, such as silent. A trace in which nothing else is in doubt
    /// conforms.
    #[arg(long, value_name = "KIND,…", value_delimiter = ',', value_parser = doubt_kind)]
    accept: Vec<DoubtKind>,
}

impl AcceptOption {
    /// Returns the verdict with these doubts accepted.
    pub(crate) fn accepted(&self, found: Verdict) -> Verdict {
        found.accepting(&self.accept)
    }
}

/// Returns a kind of doubt by its name.
fn doubt_kind(name: &str) -> Result<DoubtKind, String> {
    let all = DoubtKind::ALL.map(DoubtKind::as_str).join(", ");
    DoubtKind::named(name).ok_or_else(|| format!("the kinds of doubt are {all}"))
}

/// Judges a trace to its end.
pub(crate) fn judge(how: &JudgeOptions, name: &str, trace: impl BufRead) -> Result<Verdict, Fault> {
    let (mode, end) = (how.mode()?, how.end());
    let mut reader = reader(mode, name, trace)?;
    let mut judging = how.judging(name, &reader)?;
    let mut notes = JudgingNotes::new(mode);
    let cut = judge_lines(
        &mut reader,
        end,
        |_, _| (),
        |line, event, annotations| {
            notes.event(&event);
            judging.annotated_line(line, &event, annotations)
        },
    )?;
    let found = how.accepted(finish(judging, end, cut));
    notes.warn(&found);
    Ok(found.sorted())
}

/// The next event of a trace.
pub(crate) enum TraceStep {
    Event(Event),
    End,
    /// This line was cut short.
    Cut(u64),
}

/// Returns the next step of a trace. It may end with a line that was cut short if `end` allows
/// that.
pub(crate) fn next_event<R: BufRead>(
    reader: &mut Events<R>,
    end: TraceEnd,
) -> Result<TraceStep, Fault> {
    let error = match reader.next_event() {
        Ok(event) => return Ok(event.map_or(TraceStep::End, TraceStep::Event)),
        Err(error) => error,
    };
    let is_cut = match &error.defect {
        fuseline_traces::Defect::Unterminated => true,
        fuseline_traces::Defect::Io(error) => error.kind() == io::ErrorKind::UnexpectedEof,
        _ => false,
    };
    match (is_cut, end) {
        (true, TraceEnd::Early | TraceEnd::Growing) => Ok(TraceStep::Cut(error.line)),
        (true, TraceEnd::Whole | TraceEnd::Ended) => Err(Fault::own(TruncatedTrace(error))),
        (false, _) => Err(unread(error)),
    }
}

/// Returns the reason why a trace cannot be read, with the option that would help.
fn unread(error: ReadError) -> Fault {
    if error.to_string().ends_with("judged as observed") {
        return Fault::own(ObservedTrace(error));
    }
    error.into()
}

/// A trace has keys that a strict judge does not take.
#[derive(Debug, Error)]
#[error("{0}; give --observed --tolerance TIME --lateness TIME")]
struct ObservedTrace(ReadError);

/// A trace ends in the middle of a line.
#[derive(Debug, Error)]
#[error("{0}; --truncated judges everything before it")]
struct TruncatedTrace(ReadError);

/// Reads a trace's header for the chosen judge.
pub(crate) fn reader<R: BufRead>(
    mode: JudgeMode,
    name: &str,
    trace: R,
) -> Result<Events<R>, Fault> {
    let read = if mode.is_none() { Events::new } else { Events::observed };
    read(name, trace).map_err(unread)
}

impl JudgeOptions {
    /// Makes options that judge every decision, to the trace's end.
    pub(crate) fn strictly() -> Self {
        let (lateness, period) = (None, None);
        Self {
            observed: false,
            tolerance: Vec::new(),
            lateness,
            period,
            ended: false,
            truncated: false,
            accept: AcceptOption::default(),
            require_judged: false,
            part: PartOptions::all(),
        }
    }

    /// Returns the action at the end of the trace.
    pub(crate) const fn end(&self) -> TraceEnd {
        match (self.truncated, self.ended) {
            (true, _) => TraceEnd::Early,
            (false, true) => TraceEnd::Ended,
            (false, false) => TraceEnd::Whole,
        }
    }

    /// Returns the verdict with these doubts accepted.
    pub(crate) fn accepted(&self, found: Verdict) -> Verdict {
        self.accept.accepted(found)
    }

    /// Returns a judge for the trace whose header was read.
    pub(crate) fn judging<R: BufRead>(
        &self,
        name: &str,
        reader: &Events<R>,
    ) -> Result<TraceJudge, Fault> {
        let judging = TraceJudge::new(self.mode()?, name, reader.header());
        let mut judging = judging.with_header_annotations(reader.header_annotations());
        for (p, tolerance) in self.tolerances(name, reader.header())? {
            judging = judging.with_tolerance_of(p, tolerance);
        }
        if let Some(period) = self.period() {
            judging = judging.with_period(period);
        }
        Ok(match self.part()? {
            None => judging,
            Some(part) => judging.with_part(part),
        })
    }

    /// Returns the part of the trace to judge, or `None` for the whole.
    pub(crate) fn part(&self) -> Result<Option<TraceRange>, Fault> {
        self.part.part()
    }

    /// Returns the tolerances of single sources of a trace, by their priority, in nanoseconds.
    pub(crate) fn tolerances(&self, file: &str, header: &Header) -> Result<Vec<(u64, u64)>, Fault> {
        let mut tolerances = Vec::new();
        for Tolerance { source, time } in &self.tolerance {
            let Some(source) = source else { continue };
            let found = sources_named(source, header);
            if found.is_empty() {
                let (file, name) = (file.to_owned(), source.clone());
                return Err(ToleranceError::Unknown { file, name, known: known(header) }.into());
            }
            tolerances.extend(found.into_iter().map(|p| (p, nanos(*time))));
        }
        Ok(tolerances)
    }

    /// Returns the period in nanoseconds, if it is known.
    pub(crate) fn period(&self) -> Option<u64> {
        self.period.map(nanos)
    }

    pub(crate) fn mode(&self) -> Result<JudgeMode, Fault> {
        if self.require_judged {
            return Err(Fault::own(RequireJudgedError));
        }
        let mut own = self.tolerance.iter().filter(|tolerance| tolerance.source.is_none());
        let (tolerance, lateness) = match (own.next(), self.lateness) {
            (Some(tolerance), Some(lateness)) => (nanos(tolerance.time), nanos(lateness)),
            (None, Some(_)) if self.observed => return Err(ToleranceError::None.into()),
            _ => return Ok(None),
        };
        if own.next().is_some() {
            return Err(ToleranceError::Twice.into());
        }
        Ok(Some(Slack { tolerance, lateness }))
    }
}

/// One option `--tolerance`.
#[derive(Clone, Debug)]
struct Tolerance {
    /// The source of the stamps, or `None` for all others.
    source: Option<String>,
    time: Duration,
}

/// An option that no longer exists, because it is always in force.
#[derive(Debug, Error)]
#[error(
    "--require-judged no longer exists: a trace in which nothing is judged is in doubt (exit code 3); omit it"
)]
struct RequireJudgedError;

/// The reason why tolerances do not fit together, or do not fit the trace.
#[derive(Debug, Error)]
enum ToleranceError {
    #[error(
        "the other stamps have no tolerance; give a --tolerance without a source, such as --tolerance 2ms"
    )]
    None,
    #[error("--tolerance without a source is given twice; give it once")]
    Twice,
    #[error("{file}: the header has no source {name:?}, which --tolerance names; it has {known}")]
    Unknown { file: String, name: String, known: String },
}

impl From<ToleranceError> for Fault {
    fn from(error: ToleranceError) -> Self {
        Self::own(error)
    }
}

/// Reads a span of time, perhaps after the source that it is for.
fn tolerance(text: &str) -> Result<Tolerance, String> {
    let (source, span) = match text.rsplit_once('=') {
        Some((source, span)) => (Some(source.to_owned()), span),
        None => (None, text),
    };
    Ok(Tolerance { source, time: time(span)? })
}

/// Returns a cloud's name on the command line.
fn cloud_name(cloud: &Cloud) -> String {
    cloud.name.clone().unwrap_or_else(|| cloud.p.to_string())
}

/// Returns the priorities of the sources with this name; several clouds may have one name.
fn sources_named(name: &str, header: &Header) -> Vec<u64> {
    let clouds = header.clouds.iter().filter(|cloud| cloud_name(cloud) == name);
    let clouds = clouds.map(|cloud| u64::from(cloud.p));
    (name == "local").then_some(0).into_iter().chain(clouds).collect()
}

/// Returns the names of a trace's sources.
fn known(header: &Header) -> String {
    let clouds = header.clouds.iter().map(cloud_name);
    ["local".to_owned()].into_iter().chain(clouds).collect::<Vec<_>>().join(", ")
}

/// Reads a span of time with its unit.
fn time(text: &str) -> Result<Duration, String> {
    duration(text, "2ms", &ANY)
}

/// Returns the verdict at the trace's end. `cut` is the line that was cut short.
pub(crate) fn finish(judging: TraceJudge, end: TraceEnd, cut: Option<u64>) -> Verdict {
    match end {
        TraceEnd::Whole => judging.finish(),
        TraceEnd::Ended => judging.finish_ended(),
        TraceEnd::Early => doubted(judging.finish_early(), cut),
        TraceEnd::Growing => judging.finish_early().0,
    }
}

/// Returns a verdict with the doubt that the trace was cut off, if it was.
fn doubted((found, is_cut): (Verdict, bool), cut: Option<u64>) -> Verdict {
    let what = match cut {
        Some(line) => format!("line {line} is cut short and was ignored"),
        None if is_cut => {
            format!("the trace ends with line {}, before the last decisions", found.lines)
        }
        None => return found,
    };
    found.doubting(Doubt::new(DoubtKind::Cut, 1, what))
}
