//! CSV: events, drives, recordings of a probe, and calls that were observed.

use std::path::Path;
use std::time::Duration;

use ::csv::{ReaderBuilder, Trim};
use fuseline_deadline::Observation;
use fuseline_testkit::networks::{Drive, DriveError};
use fuseline_traces::rows::{Columns, RowError, Rows, Unit};
use serde_json::{Map, Value};

use crate::parsers::held::as_file;
use crate::parsers::{Ends, ParserResult, fit};
use crate::probe::recording::ProbeRecording;

pub(super) const ENDS: &[&str] = &[
    "events",
    "no events",
    "drive",
    "no CSV",
    "no time",
    "no network",
    "which network",
    "bad round trip",
    "bad rate",
    "bad time",
    "too short",
    "recording",
    "no recording",
    "calls",
    "no calls",
];

/// No message takes longer through a network that is there.
const LONGEST: Duration = Duration::from_secs(86_400);

/// A byte for which of the command's readers looks, and a file.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let Some((which, file)) = bytes.split_first() else { return Ok(()) };
    let held = match which % 4 {
        0 => return events(file, ends),
        1 => as_file(file, |path| drive(path, ends)),
        2 => as_file(file, |path| recording(path, ends)),
        _ => return calls(file, ends),
    };
    held.map_err(|error| error.to_string())?
}

/// Rows with instants in milliseconds: an event says what the cells of its row say.
fn events(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let called = [("response".to_owned(), "result")];
    let mut rows = match Rows::new(bytes, Columns::new(&[], &called, Unit::Ms)) {
        Ok(rows) => rows,
        Err(error) => return no_events(&error, ends),
    };
    let mut cells = ReaderBuilder::new().trim(Trim::All).from_reader(bytes);
    let columns = cells.headers().map_err(|error| error.to_string())?.clone();
    let mut records = cells.into_records();
    loop {
        let event = match rows.next_event() {
            Ok(Some(event)) => event,
            Ok(None) => break,
            Err(error) => return no_events(&error, ends),
        };
        let mut line = Vec::new();
        event.write(&mut line);
        let line: Map<String, Value> =
            serde_json::from_slice(&line).map_err(|error| error.to_string())?;
        let record = records.next().and_then(Result::ok).ok_or("an event without a row")?;
        for (key, value) in &line {
            let position = columns.iter().position(|column| column == key);
            let cell = position.and_then(|position| record.get(position)).unwrap_or_default();
            let is_printed = match (&**key, value) {
                // A request without one is due when its deadline ends.
                ("due", value) if cell.is_empty() => {
                    let named =
                        |name: &str| nanos(record.get(columns.iter().position(|it| it == name)?)?);
                    let due = named("at").zip(named("deadline"));
                    value.as_u64() == due.map(|(at, deadline)| at.saturating_add(deadline))
                }
                ("at" | "due" | "deadline", value) => value.as_u64() == nanos(cell),
                (_, Value::String(text)) => text == cell || text == "result" && cell == "response",
                (_, value) => value.as_u64() == cell.parse().ok(),
            };
            if !is_printed {
                return Err(format!("{key} is {value}, the row says {cell:?}: {record:?}"));
            }
        }
    }
    ends.insert("events");
    Ok(())
}

fn no_events(error: &RowError, ends: &mut Ends) -> ParserResult {
    ends.insert("no events");
    fit(&error.to_string())
}

/// Milliseconds as nanoseconds, a digit at a time.
fn nanos(cell: &str) -> Option<u64> {
    let (mut nanos, mut decimals) = (0_u128, None);
    for c in cell.chars() {
        if c == '.' && decimals.is_none() {
            decimals = Some(0);
            continue;
        }
        nanos = nanos.checked_mul(10)?.checked_add(c.to_digit(10)?.into())?;
        decimals = decimals.map(|decimals| decimals + 1);
    }
    let decimals: u32 = decimals.unwrap_or(0);
    let nanos = nanos.checked_mul(1_000_000)?;
    let unit = 10_u128.checked_pow(decimals)?;
    (nanos % unit == 0).then(|| u64::try_from(nanos / unit).ok())?
}

/// A drive begins again when it is over, and a message that comes back does so within a lap and a
/// day.
fn drive(path: &Path, ends: &mut Ends) -> ParserResult {
    let drive = match Drive::load(&path.display().to_string()) {
        Ok(drive) => drive,
        Err(error) => {
            ends.insert(match error {
                DriveError::Open { .. } | DriveError::TooLarge { .. } => {
                    return Err(error.to_string());
                }
                DriveError::Csv { .. } => "no CSV",
                DriveError::NoTime { .. } => "no time",
                DriveError::NoColumn { .. } => "no network",
                DriveError::ManyColumns { .. } => "which network",
                DriveError::RoundTrip { .. } => "bad round trip",
                DriveError::Rate { .. } => "bad rate",
                DriveError::Time { .. } => "bad time",
                DriveError::TooShort { .. } => "too short",
            });
            return fit(&error.to_string());
        }
    };
    ends.insert("drive");
    let length = drive.length();
    if length.is_zero() {
        return Err("a drive of no length".to_owned());
    }
    let last = length.saturating_sub(Duration::from_nanos(1));
    for moment in [Duration::ZERO, length / 3, length / 2, last] {
        let found = drive.round_trip(moment);
        if found.is_some_and(|found| found > length.saturating_add(LONGEST)) {
            return Err(format!("{moment:?}: back after {found:?}, a lap is {length:?}"));
        }
        let next = moment.checked_add(length).map_or(found, |moment| drive.round_trip(moment));
        if next != found {
            return Err(format!("{moment:?}: back after {found:?}, a lap later {next:?}"));
        }
    }
    Ok(())
}

/// Rows come in the order of sending, and their figures are in their ranges.
fn recording(path: &Path, ends: &mut Ends) -> ParserResult {
    let (mut before, mut wrong) = (f64::NEG_INFINITY, None);
    let read = ProbeRecording::open(path).and_then(|mut recording| {
        recording.each(u64::MAX, |row| {
            let is_right = row.sent >= before
                && row.round_trip.is_none_or(|ms| (0.0..=86_400_000.0).contains(&ms))
                && row.position.is_none_or(|(lat, lon)| lat.abs() <= 90.0 && lon.abs() <= 180.0)
                && !(row.is_pause && row.round_trip.is_some());
            before = row.sent;
            if !is_right {
                wrong = Some(row);
            }
        })
    });
    if let Some(wrong) = wrong {
        return Err(format!("a row of a recording: {wrong:?}"));
    }
    match read {
        Ok(()) => {
            ends.insert("recording");
            Ok(())
        }
        Err(fault) => {
            ends.insert("no recording");
            fit(&fault.to_string())
        }
    }
}

/// Calls are sorted, and there is at least one.
fn calls(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    match crate::deadline::read("calls", bytes) {
        Ok(calls) => {
            ends.insert("calls");
            let is_sorted = calls.is_sorted_by_key(Observation::key);
            let is_any = calls.iter().any(|call| call.count > 0);
            if is_sorted && is_any { Ok(()) } else { Err(format!("calls: {calls:?}")) }
        }
        Err(fault) => {
            ends.insert("no calls");
            fit(&fault.to_string())
        }
    }
}
