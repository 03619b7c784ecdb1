//! CSV: events, drives, recordings of a probe, and observed calls.

use std::path::Path;
use std::time::Duration;

use ::csv::{ReaderBuilder, Trim};
use fuseline_deadline::Observation;
use fuseline_testkit::networks::{Drive, DriveError, each_row};
use fuseline_traces::rows::{TableError, TableReader};

use crate::parsers::held::as_file;
use crate::parsers::{Ends, ParserResult, fit};

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

/// The longest time that a message takes through a network that is available.
const LONGEST: Duration = Duration::from_secs(86_400);

/// Checks one of the readers of the command. The first byte selects the reader, and the others are
/// a file.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let Some((which, file)) = bytes.split_first() else { return Ok(()) };
    let held = match which % 4 {
        0 => return events(file, ends),
        1 => as_file(file, |path| drive(path, ends)),
        2 => return recording(file, ends),
        _ => return calls(file, ends),
    };
    held.map_err(|error| error.to_string())?
}

/// Checks that a plain reader reads the same rows, and that each row is at a later line than the
/// row before it.
fn events(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let mut options = ReaderBuilder::new();
    options.trim(Trim::All);
    let mut table = TableReader::new(bytes, &options);
    let mut plain = options.from_reader(bytes);
    match table.names() {
        Ok(names) if plain.headers().is_ok_and(|plain| *plain == names) => {}
        Ok(names) => return Err(format!("the first row is {names:?}")),
        Err(error) => return no_events(&error, ends),
    }
    let (mut records, mut before) = (plain.into_records(), 0);
    loop {
        let (line, row) = match table.next_row() {
            Ok(Some((line, row))) => (line, row.clone()),
            Ok(None) => break,
            Err(error) => return no_events(&error, ends),
        };
        let record = records.next().and_then(Result::ok).ok_or("a row that a reader has not")?;
        if record != row || line <= before {
            return Err(format!("line {line} after {before} has {row:?}, not {record:?}"));
        }
        before = line;
    }
    ends.insert("events");
    Ok(())
}

fn no_events(error: &TableError, ends: &mut Ends) -> ParserResult {
    ends.insert("no events");
    fit(&error.to_string())
}

/// Checks that a drive starts again when it is over. A message that comes back does so within a lap
/// and a day.
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

/// Checks that rows come in the order of sending, with figures in their ranges.
fn recording(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let (mut before, mut wrong) = (None, None);
    let read = each_row("recording", None, bytes, |row| {
        let is_later = before.is_none_or(|before| row.at > before);
        if !is_later || row.round_trip.is_some_and(|round_trip| round_trip > LONGEST) {
            wrong = Some(row);
        }
        before = Some(row.at);
    });
    if let Some(wrong) = wrong {
        return Err(format!("a row of a recording: {wrong:?}"));
    }
    match read {
        Ok(_) => {
            ends.insert("recording");
            Ok(())
        }
        Err(error) => {
            ends.insert("no recording");
            fit(&error.to_string())
        }
    }
}

/// Checks that calls are sorted, and that there is at least one.
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
