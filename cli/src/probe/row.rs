//! The recording: a row for each request and each pause, in the order of sending.

use std::collections::VecDeque;
use std::io::Write;
use std::time::Duration;

/// The columns; `sent_ms` and `rtt_ms` are those of a drive.
const COLUMNS: [&str; 4] = ["sent_ms", "rtt_ms", "queued", "utc_ms"];

/// The action at a slot.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlotRow {
    /// Since the probe began.
    pub(crate) sent: Duration,
    /// Requests that were unanswered then.
    pub(crate) queued: usize,
    /// The time of day, in milliseconds since 1970.
    pub(crate) utc_ms: i64,
    pub(crate) request_outcome: RequestOutcome,
}

/// The outcome.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum RequestOutcome {
    /// It is under way.
    Unanswered,
    /// It was answered after this long.
    Answered(Duration),
    /// It failed, or nothing was sent because a pause began.
    Lost,
}

/// Writes rows once all before them are known; how many wait is bounded by how long a call may
/// take.
pub(crate) struct SlotRows<W: Write> {
    csv: csv::Writer<W>,
    waiting: VecDeque<SlotRow>,
    /// The number of the first that waits.
    first: u64,
    /// In microseconds; none before the first.
    last_sent: Option<u128>,
}

impl<W: Write> SlotRows<W> {
    /// Writes the names of the columns.
    ///
    /// # Errors
    /// If they cannot be written.
    pub(crate) fn new(out: W) -> Result<Self, csv::Error> {
        let mut csv = csv::Writer::from_writer(out);
        csv.write_record(COLUMNS)?;
        csv.flush()?;
        Ok(Self { csv, waiting: VecDeque::new(), first: 0, last_sent: None })
    }

    /// Adds a row; gives its number.
    pub(crate) fn add(&mut self, row: SlotRow) -> u64 {
        self.waiting.push_back(row);
        self.first + self.waiting.len() as u64 - 1
    }

    /// Says what became of the request in that row.
    pub(crate) fn settle(&mut self, number: u64, request_outcome: RequestOutcome) {
        let index = number.checked_sub(self.first).and_then(|index| usize::try_from(index).ok());
        if let Some(row) = index.and_then(|index| self.waiting.get_mut(index)) {
            row.request_outcome = request_outcome;
        }
    }

    /// Writes what is known.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&mut self) -> Result<(), csv::Error> {
        while let Some(row) = self.waiting.front().copied() {
            if row.request_outcome == RequestOutcome::Unanswered {
                break;
            }
            self.waiting.pop_front();
            self.put(&row)?;
        }
        Ok(self.csv.flush()?)
    }

    /// Writes all that is left; what is unanswered counts as lost.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn finish(&mut self) -> Result<(), csv::Error> {
        while let Some(row) = self.waiting.pop_front() {
            self.put(&row)?;
        }
        Ok(self.csv.flush()?)
    }

    fn put(&mut self, row: &SlotRow) -> Result<(), csv::Error> {
        self.first += 1;
        // A drive's times rise strictly.
        let sent =
            self.last_sent.map_or(row.sent.as_micros(), |last| row.sent.as_micros().max(last + 1));
        self.last_sent = Some(sent);
        let rtt = match row.request_outcome {
            RequestOutcome::Answered(rtt) => milliseconds(rtt.as_micros()),
            RequestOutcome::Unanswered | RequestOutcome::Lost => "-1".to_owned(),
        };
        self.csv.write_record([
            milliseconds(sent),
            rtt,
            row.queued.to_string(),
            row.utc_ms.to_string(),
        ])
    }
}

fn milliseconds(micros: u128) -> String {
    format!("{}.{:03}", micros / 1000, micros % 1000)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(sent_us: u64, request_outcome: RequestOutcome) -> SlotRow {
        let utc_ms = 1_000_000 + i64::try_from(sent_us / 1000).unwrap();
        SlotRow { sent: Duration::from_micros(sent_us), queued: 3, utc_ms, request_outcome }
    }

    fn text(rows: &SlotRows<Vec<u8>>) -> String {
        String::from_utf8(rows.csv.get_ref().clone()).unwrap()
    }

    #[test]
    fn rows_are_written_in_the_order_of_sending_once_they_are_known() {
        let mut rows = SlotRows::new(Vec::new()).unwrap();
        let first = rows.add(row(5, RequestOutcome::Unanswered));
        let second = rows.add(row(33_333, RequestOutcome::Unanswered));
        rows.add(row(66_666, RequestOutcome::Lost));
        rows.settle(second, RequestOutcome::Answered(Duration::from_micros(68_001)));
        rows.write().unwrap();
        assert_eq!(text(&rows).lines().count(), 1);
        rows.settle(first, RequestOutcome::Answered(Duration::from_millis(2)));
        rows.write().unwrap();
        let expected = "sent_ms,rtt_ms,queued,utc_ms\n\
                        0.005,2.000,3,1000000\n\
                        33.333,68.001,3,1000033\n\
                        66.666,-1,3,1000066\n";
        assert_eq!(text(&rows), expected);
    }

    #[test]
    fn times_rise_strictly_and_what_is_left_is_lost() {
        let mut rows = SlotRows::new(Vec::new()).unwrap();
        rows.add(row(7, RequestOutcome::Lost));
        rows.add(row(7, RequestOutcome::Unanswered));
        rows.finish().unwrap();
        let reported = text(&rows);
        let sent: Vec<&str> = reported.lines().skip(1).map(|it| &it[..9]).collect();
        assert_eq!(sent, ["0.007,-1,", "0.008,-1,"]);
    }
}
