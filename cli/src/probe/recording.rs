//! Reads a recording again, a row at a time.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;

use fuseline_traces::rows::{TableError, TableReader};
use serde::Deserialize;
use thiserror::Error;

use crate::fault::{Fault, plain};
use crate::probe::pace::QUEUED;

/// No line is longer, in bytes.
const LINE: usize = 64 * 1024;
/// No time is later: 30 years, in milliseconds.
const LATEST_MS: f64 = 1e12;
/// No round trip is longer: a day, in milliseconds.
const LONGEST_MS: f64 = 86_400_000.0;

/// A recording that can be read more than once.
pub(crate) struct ProbeRecording {
    name: String,
    file: File,
}

/// A row as far as plots need it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlotRow {
    /// In seconds.
    pub(crate) sent: f64,
    /// In milliseconds; none if there was no answer.
    pub(crate) round_trip: Option<f64>,
    /// `true` if a pause began and nothing was sent.
    pub(crate) is_pause: bool,
}

/// The reason why a recording cannot be plotted.
#[derive(Debug, Error)]
enum RecordingError {
    #[error("{name}:{}: {}; give a recording of fuseline probe", .source.line, described(.source))]
    Csv { name: String, source: TableError },
    #[error("{name}:{line}: {column} is {found}; it must be {must}")]
    Value { name: String, line: u64, column: &'static str, found: f64, must: &'static str },
}

impl From<RecordingError> for Fault {
    fn from(error: RecordingError) -> Self {
        Self::own(error)
    }
}

#[derive(Deserialize)]
struct RowCells {
    sent_ms: f64,
    rtt_ms: f64,
    queued: Option<u64>,
}

impl ProbeRecording {
    /// Returns the recording at `path`.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub(crate) fn open(path: &Path) -> Result<Self, Fault> {
        let name = path.display().to_string();
        match File::open(path) {
            Ok(file) => Ok(Self { name, file }),
            Err(source) => Err(Fault::Open { name, source }),
        }
    }

    /// Hands out each row in order, at most `most` of them; memory does not grow with them.
    ///
    /// # Errors
    /// If it cannot be read, or is no recording.
    pub(crate) fn each(&mut self, most: u64, mut look: impl FnMut(PlotRow)) -> Result<(), Fault> {
        let name = || self.name.clone();
        let fault = |source| RecordingError::Csv { name: name(), source };
        self.file.rewind().map_err(|source| Fault::Open { name: name(), source })?;
        let text = BoundedLines { text: &self.file, since: 0 };
        // A quoted cell could hold lines without end.
        let mut rows = TableReader::new(text, csv::ReaderBuilder::new().quoting(false));
        let columns = rows.names().map_err(fault)?;
        let (mut before, mut count) = (f64::NEG_INFINITY, 0);
        while count < most
            && let Some((line, row)) = rows.next_row().map_err(fault)?
        {
            let cells = row.deserialize(Some(&columns));
            let cells: RowCells = cells.map_err(|source| fault(TableError { line, source }))?;
            cells.check(before).map_err(|(column, found, must)| RecordingError::Value {
                name: name(),
                line,
                column,
                found,
                must,
            })?;
            before = cells.sent_ms;
            count += 1;
            look(cells.plot_row());
        }
        Ok(())
    }
}

/// Returns the problem, without the system's text.
fn described(error: &TableError) -> String {
    match error.source.kind() {
        csv::ErrorKind::Io(source) => plain(source),
        csv::ErrorKind::Deserialize { err, .. } => {
            let cell = err.field().map_or_else(String::new, |cell| format!("cell {}: ", cell + 1));
            format!("{cell}{}", err.kind())
        }
        _ => error.to_string(),
    }
}

impl RowCells {
    /// Returns the problem: the column, the figure, and its allowed values.
    fn check(&self, before: f64) -> Result<(), (&'static str, f64, &'static str)> {
        if !(self.sent_ms > before && self.sent_ms.abs() <= LATEST_MS) {
            return Err(("sent_ms", self.sent_ms, "milliseconds, greater than the line before"));
        }
        let is_lost = self.rtt_ms.to_bits() == (-1.0_f64).to_bits();
        if !is_lost && !(0.0..=LONGEST_MS).contains(&self.rtt_ms) {
            return Err(("rtt_ms", self.rtt_ms, "milliseconds from 0 to a day, or -1"));
        }
        Ok(())
    }

    fn plot_row(&self) -> PlotRow {
        let round_trip = Some(self.rtt_ms).filter(|ms| *ms >= 0.0);
        // A request is sent only with fewer unanswered ones before it.
        let is_pause = round_trip.is_none() && self.queued.is_some_and(|it| it > QUEUED as u64);
        PlotRow { sent: self.sent_ms / 1000.0, round_trip, is_pause }
    }
}

/// Text with lines of bounded length.
struct BoundedLines<R> {
    text: R,
    /// Bytes since the last line ended.
    since: usize,
}

impl<R: Read> Read for BoundedLines<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let most = into.len().min(LINE);
        let read = self.text.read(&mut into[..most])?;
        self.since = match into[..read].iter().rposition(|byte| *byte == b'\n') {
            Some(end) => read - end - 1,
            None => self.since + read,
        };
        if self.since > LINE {
            return Err(io::Error::other("a line of more than 64 KiB"));
        }
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn recording(text: &str) -> ProbeRecording {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        ProbeRecording { name: "drive.csv".to_owned(), file }
    }

    const COLUMNS: &str = "sent_ms,rtt_ms,queued\n";

    fn each(recording: &mut ProbeRecording, most: u64) -> Result<Vec<PlotRow>, String> {
        let mut rows = Vec::new();
        recording.each(most, |row| rows.push(row)).map_err(|fault| fault.to_string())?;
        Ok(rows)
    }

    #[test]
    fn cells_may_be_what_their_bounds_are_and_no_more() {
        for (fits, beyond) in [
            ("1e12,0,", "1000000000001,0,"),
            ("-1e12,0,", "-1000000000001,0,"),
            ("5,0,", "5,-0.1,"),
            ("5,-1,", "5,-1.1,"),
            ("5,86400000,", "5,86400001,"),
            ("5,1,30", "5,1,-1"),
        ] {
            let one = each(&mut recording(&format!("{COLUMNS}{fits}\n")), 9);
            assert_eq!(one.map(|rows| rows.len()), Ok(1), "{fits}");
            let found = each(&mut recording(&format!("{COLUMNS}{beyond}\n")), 9).unwrap_err();
            assert!(found.starts_with("drive.csv:2: "), "{found}");
        }
        let falls = each(&mut recording(&format!("{COLUMNS}5,1,\n6,1,\n6,1,\n")), 9);
        assert!(falls.unwrap_err().starts_with("drive.csv:4: sent_ms is 6; "));
    }

    #[test]
    fn rows_are_read_as_often_as_wanted_and_no_further_than_wanted() {
        // Nothing was sent with 31 unanswered: a pause. With 30 it was sent and lost.
        let text = format!("{COLUMNS}5,0,31\n250,-1,30\n300,-1,31\n");
        let mut recording = recording(&text);
        for most in [3, 2, 9, 0] {
            let rows = each(&mut recording, most).unwrap();
            let cells: Vec<_> =
                rows.iter().map(|row| (row.sent, row.round_trip, row.is_pause)).collect();
            let all = [(0.005, Some(0.0), false), (0.25, None, false), (0.3, None, true)];
            assert_eq!(cells, all[..all.len().min(usize::try_from(most).unwrap())]);
        }
    }

    #[test]
    fn a_line_is_bounded_and_a_recording_is_not() {
        let row = |number: usize, width: usize| format!("{number},{}1,\n", "0".repeat(width));
        let long: String = (1..40).map(|number| row(number, 60_000)).collect();
        let rows = each(&mut recording(&format!("{COLUMNS}{long}")), 99).unwrap();
        assert_eq!(rows.len(), 39);
        let longer = each(&mut recording(&format!("{COLUMNS}{}", row(1, LINE + 8_192))), 99);
        assert!(longer.unwrap_err().contains("a line of more than 64 KiB"));
    }
}
