//! Traces in every packing: gzip, zstd, MCAP and plain.

use std::io::{self, BufRead};

use fuseline_traces::packed::{Packing, unpack};
use fuseline_traces::{Defect, Events, LINE, Line, ReadError, observed};

use crate::parsers::{Ends, ParserResult, fit};

pub(super) const ENDS: &[&str] =
    &["plain", "gzip", "zstd", "mcap", "cut short", "cannot be unpacked", "no trace"];

/// The number of lines that are checked, because a file may unpack to any size.
const LINES: u64 = 2_000;

/// Checks any bytes as a file.
pub(super) fn check(bytes: &[u8], ends: &mut Ends) -> ParserResult {
    let inner = match unpack(bytes) {
        Ok(inner) => inner,
        Err(error) => return fit(&error.to_string()),
    };
    let mut reader = match Events::observed("packed", inner) {
        Ok(reader) => reader,
        Err(error) => return refused(&error, 1, ends),
    };
    unchanged(&Line::Header(reader.header().clone()))?;
    while reader.line() < LINES {
        let line = reader.line() + 1;
        match next(&mut reader) {
            Ok(Some(event)) => unchanged(&event)?,
            Ok(None) => {
                ends.insert(match bytes.first().copied().and_then(Packing::of) {
                    None => "plain",
                    Some(Packing::Gzip) => "gzip",
                    Some(Packing::Zstd) => "zstd",
                    Some(Packing::Mcap) => "mcap",
                });
                return Ok(());
            }
            Err(error) => return refused(&error, line, ends),
        }
    }
    Ok(())
}

fn next<R: BufRead>(reader: &mut Events<R>) -> Result<Option<Line>, ReadError> {
    Ok(reader.next_event()?.map(Line::Event))
}

/// Checks that a line stays the same when it is written and read again.
fn unchanged(line: &Line) -> ParserResult {
    let mut written = Vec::new();
    line.write(&mut written);
    let again = observed::parse(&written);
    if again.as_ref() != Ok(line) {
        let written = written.escape_ascii();
        return Err(format!("{line:?} is written as {written} and read as {again:?}"));
    }
    Ok(())
}

fn refused(error: &ReadError, line: u64, ends: &mut Ends) -> ParserResult {
    ends.insert(match &error.defect {
        Defect::Io(error) if error.kind() == io::ErrorKind::UnexpectedEof => "cut short",
        Defect::Io(_) => "cannot be unpacked",
        _ => "no trace",
    });
    if error.line != line || !(1..=LINE as u64 + 1).contains(&error.column) {
        return Err(format!("at line {line} the error is {error:?}"));
    }
    fit(&error.to_string())
}
