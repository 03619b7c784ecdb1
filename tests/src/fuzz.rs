//! The checks of the fuzz targets, as functions over bytes. Plain tests replay the targets' seeds
//! with them.
//!
//! Each function notes in a [`Coverage`] what the bytes reached, and returns a description of what
//! is wrong, with the trace.

mod bytes;
mod edit;

use fuseline_engine::arbiter::Arbiter;
use fuseline_testkit::{Coverage, Mark, Run, admissions_and_ends};
use fuseline_traces as traces;
use fuseline_traces::{
    Annotations, Commit, Defect, Event, Events, Header, LINE, Line, ReadError, parse, unpack,
};
use serde::de::IgnoredAny;

use bytes::Bytes;
pub use edit::{Edit, EditKind};

/// The name of a trace in verdicts and errors.
const FILE: &str = "fuzz";
/// The greatest length of an error's message, in bytes.
const MESSAGE: usize = 512;

/// A description of what is wrong.
type FuzzResult = Result<(), String>;

/// Takes bytes as a run, and compares the machine that ships with the reference machine: each
/// decision, and the next due instant after each input.
///
/// # Errors
/// Returns the first difference, and the run as it should be.
pub fn step(bytes: &[u8], reach: &mut Coverage) -> FuzzResult {
    let run = Bytes::new(bytes).run();
    compare(&run, reach).map_err(|difference| format!("{difference}\n{run:?}"))
}

/// Takes bytes as a file. It is read to its end or to an error with its place, and every line stays
/// the same when it is written and read again.
///
/// # Errors
/// Returns what is wrong with the reading.
pub fn trace_parse(bytes: &[u8], reach: &mut Coverage) -> FuzzResult {
    let inner = unpack(bytes).map_err(|error| format!("bytes in memory did not come: {error}"))?;
    let mut reader = match Events::new(FILE, inner) {
        Ok(reader) => reader,
        Err(error) => return refused(&error, 1, reach),
    };
    unchanged(reader.raw(), &Line::Header(reader.header().clone()), reach)?;
    loop {
        let line = reader.line() + 1;
        match reader.next_event() {
            Ok(Some(event)) => {
                unchanged(reader.raw(), &Line::Event(event), reach)?;
                unchanged_annotations(&event, reader.annotations())?;
            }
            Ok(None) => return Ok(()),
            Err(error) => return refused(&error, line, reach),
        }
    }
}

/// Takes bytes as an [`Edit`] and a run. The judge accepts the decisions of the machine that ships,
/// and finds the edit at its line, unless it changes nothing.
///
/// # Errors
/// Returns where the judge is wrong, and the edited trace.
pub fn judge(bytes: &[u8], reach: &mut Coverage) -> FuzzResult {
    let mut bytes = Bytes::new(bytes);
    let edit = Edit::read(&mut bytes);
    let run = bytes.run();
    let whole = replay(&run).map_err(|defect| format!("{defect}\n{run:?}"))?;
    let edited = edit.apply(&whole);
    find(&run, &whole, &edited, reach)
        .map_err(|defect| format!("{defect}\n{}", String::from_utf8_lossy(&text(&run, &edited))))
}

/// Returns all marks that [`judge`] can reach: those of runs, and a violation of every rule.
#[must_use]
pub fn marks_of_judge() -> Vec<Mark> {
    [Mark::of_runs(), Mark::of_violations()].concat()
}

/// Returns the bytes that [`step`] reads as this run. For [`judge`] an edit's bytes go before them.
///
/// The names of the operator and of the clouds are left out.
#[must_use]
pub fn bytes_of(run: &Run) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes::write(run, &mut bytes);
    bytes
}

/// Returns the run that [`step`] makes of bytes.
#[must_use]
pub fn run_of(bytes: &[u8]) -> Run {
    Bytes::new(bytes).run()
}

/// Runs both machines side by side, and compares each decision and the next due instant after each
/// input. A progressive run admits and ends what a patient one does (P13).
///
/// # Errors
/// Returns the first difference.
pub fn compare(run: &Run, reach: &mut Coverage) -> FuzzResult {
    let mut arbiter = arbiter_of(&run.header)?;
    let mut patient = arbiter_of(&Header { commit: Commit::Patient, ..run.header.clone() })?;
    let is_progressive = run.header.commit == Commit::Progressive;
    let mut context = reach.begin(run);
    let (mut found, mut of_patient) = (Vec::new(), Vec::new());
    for (i, input) in run.inputs.iter().enumerate() {
        let step = reach.follow(&mut context, input);
        found.clear();
        arbiter.decide(input, |decision| found.push(decision));
        if !found.iter().eq(step.decisions()) {
            let expected: Vec<_> = step.decisions().collect();
            return Err(format!("input {i}, {input}: {found:?}, the rules say {expected:?}"));
        }
        if is_progressive {
            of_patient.clear();
            patient.decide(input, |decision| of_patient.push(decision));
            let found = admissions_and_ends(Commit::Progressive, &found);
            let expected = admissions_and_ends(Commit::Patient, &of_patient);
            if found != expected {
                return Err(format!("input {i}, {input}: P13, {found:?}, patient {expected:?}"));
            }
        }
        if arbiter.next_due() != context.next_due() {
            let (found, expected) = (arbiter.next_due(), context.next_due());
            return Err(format!("input {i}, {input}: next due is {found:?}, not {expected:?}"));
        }
    }
    Ok(())
}

/// Checks an accepted line: it is JSON to others too, and it stays the same when it is written and
/// read again.
fn unchanged(raw: &[u8], line: &Line, reach: &mut Coverage) -> FuzzResult {
    reach.line(line);
    let wrong = |what: &str| Err(format!("{what}: {}\n{line:?}", String::from_utf8_lossy(raw)));
    if serde_json::from_slice::<IgnoredAny>(raw).is_err() {
        return wrong("read though it is not JSON");
    }
    // A line with a blank in it is read key by key.
    if let Some(rest) = raw.strip_prefix(b"{") {
        let spaced = parse(&[b"{ ", rest].concat());
        if spaced != parse(raw) {
            return wrong(&format!("with a blank in it read as {spaced:?}"));
        }
    }
    let mut written = Vec::new();
    line.write(&mut written);
    let again = parse(&written);
    if again.as_ref() != Ok(line) {
        return wrong(&format!("written as {}, read as {again:?}", written.escape_ascii()));
    }
    Ok(())
}

/// Checks the further keys of an accepted line, which stay the same when they are written and read
/// again.
fn unchanged_annotations(event: &Event, annotations: &Annotations) -> FuzzResult {
    if annotations.is_empty() {
        return Ok(());
    }
    let mut written = b"{\"fuseline\":1,\"window\":1,\"clouds\":[]}\n".to_vec();
    event.write_annotated(annotations, &mut written);
    written.push(b'\n');
    let again = Events::new(FILE, &written[..]).and_then(|mut reader| {
        reader.next_event()?;
        Ok(reader.annotations().clone())
    });
    match again {
        Ok(again) if again == *annotations => Ok(()),
        again => {
            Err(format!("{annotations:?} written as {}, read as {again:?}", written.escape_ascii()))
        }
    }
}

/// Checks an error at line number `line`: it names that line and is safe for a terminal.
fn refused(error: &ReadError, line: u64, reach: &mut Coverage) -> FuzzResult {
    reach.defect(error);
    let message = error.to_string();
    let column = 1..=LINE as u64 + 1;
    // The message about a broken file is flate2's.
    let is_ours = !matches!(error.defect, Defect::Io(_));
    if error.line != line || !column.contains(&error.column) {
        return Err(format!("at line {line} the error is {message:?}"));
    }
    if is_ours && (message.len() > MESSAGE || message.contains(char::is_control)) {
        return Err(format!("not fit for a terminal: {message:?}"));
    }
    Ok(())
}

/// Returns the run's inputs, each with the decisions of the machine that ships.
fn replay(run: &Run) -> Result<Vec<Event>, String> {
    let mut arbiter = arbiter_of(&run.header)?;
    let mut events = Vec::new();
    for input in &run.inputs {
        events.push(Event::Input(*input));
        arbiter.decide(input, |decision| events.push(Event::Decision(decision)));
    }
    Ok(events)
}

fn find(run: &Run, whole: &[Event], edited: &[Event], reach: &mut Coverage) -> FuzzResult {
    let conforming = verdict(run, whole)?;
    if !conforming.violations.is_empty() {
        return Err(format!("what the core decides is judged so: {conforming}"));
    }
    reach.watch(run);
    let verdict = verdict(run, edited)?;
    if verdict.judged != conforming.judged || verdict.lines != edited.len() as u64 + 1 {
        return Err(format!("the edit changes what is counted: {verdict}"));
    }
    let found = verdict.violations.first();
    if let Some(found) = found {
        reach.mark(Mark::Violation(found.rule));
    }
    let expected = broken_line(whole, edited);
    if found.map(|found| found.line) != expected
        || verdict.violations.is_empty() != expected.is_none()
    {
        return Err(format!("the edit is at {expected:?}, judged so: {verdict}"));
    }
    Ok(())
}

/// Returns the line at which the judge finds the first difference: at a decision or, if one is
/// missing, at the line before what takes its place.
fn broken_line(whole: &[Event], edited: &[Event]) -> Option<u64> {
    let both = whole.len().max(edited.len());
    let index = (0..both).find(|index| whole.get(*index) != edited.get(*index))?;
    // The header is line 1, and the first event is line 2.
    let line = index as u64 + 2;
    match edited.get(index) {
        Some(Event::Decision(_)) => Some(line),
        Some(Event::Input(_)) | None => Some(line - 1),
    }
}

fn verdict(run: &Run, events: &[Event]) -> Result<traces::Verdict, String> {
    traces::judge(FILE, &*text(run, events)).map_err(|error| format!("it cannot be read: {error}"))
}

/// Returns the trace as it is written.
fn text(run: &Run, events: &[Event]) -> Vec<u8> {
    let mut text = Vec::new();
    run.header.write(&mut text);
    text.push(b'\n');
    for event in events {
        event.write(&mut text);
        text.push(b'\n');
    }
    text
}

fn arbiter_of(header: &Header) -> Result<Arbiter, String> {
    Arbiter::new(header).map_err(|error| format!("a sound configuration is refused: {error}"))
}
