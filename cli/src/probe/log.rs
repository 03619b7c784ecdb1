//! Logs each slot: rows for the recording, and figures for the summary.

use std::io::Write;
use std::time::Duration;

use crate::probe::figures::Figures;
use crate::probe::pace::{SendPacing, SlotAction};
use crate::probe::row::{RequestOutcome, SlotRow, SlotRows};

/// Slots, requests and their ends, in the order in which they happen. Times are since the
/// beginning.
pub(crate) struct ProbeLog<W: Write> {
    pub(crate) pace: SendPacing,
    pub(crate) figures: Figures,
    pub(crate) latest: Option<Duration>,
    rows: SlotRows<W>,
    period: Duration,
    /// The time that an answer needs in addition, and the deadline of both.
    runtime: Duration,
    deadline: Duration,
    pause: Option<Pause>,
}

/// A pause that goes on.
struct Pause {
    /// The instant at which its first slot was due.
    first: Duration,
    skipped: u32,
}

impl<W: Write> ProbeLog<W> {
    pub(crate) fn new(
        rows: SlotRows<W>,
        period: Duration,
        (runtime, deadline): (Duration, Duration),
    ) -> Self {
        let (pace, figures) = (SendPacing::default(), Figures::new());
        Self { pace, figures, latest: None, rows, period, runtime, deadline, pause: None }
    }

    /// Notes that a slot was due and is here; returns the number of its row if a request is to be
    /// sent.
    pub(crate) fn slot(&mut self, due: Duration, now: Duration, utc_ms: i64) -> Option<u64> {
        let row = SlotRow {
            sent: now,
            queued: self.pace.queued(),
            utc_ms,
            request_outcome: RequestOutcome::Unanswered,
        };
        let counts = &mut self.figures.counts;
        counts.slots += 1;
        match self.pace.slot() {
            SlotAction::Send => {
                counts.sent += 1;
                Some(self.rows.add(row))
            }
            SlotAction::Pause => {
                counts.pauses += 1;
                counts.skipped += 1;
                self.rows.add(SlotRow { request_outcome: RequestOutcome::Lost, ..row });
                self.pause = Some(Pause { first: due, skipped: 1 });
                None
            }
            SlotAction::Skip => {
                self.skip(1);
                None
            }
        }
    }

    /// Notes the number of slots that passed while this host did something else.
    pub(crate) fn overslept(&mut self, slots: u32) {
        self.figures.counts.slots += u64::from(slots);
        if self.pause.is_some() {
            self.skip(slots);
        } else {
            self.figures.counts.missed += u64::from(slots);
        }
    }

    fn skip(&mut self, slots: u32) {
        self.figures.counts.skipped += u64::from(slots);
        if let Some(pause) = &mut self.pause {
            pause.skipped += slots;
        }
    }

    /// Notes that the request of that row was answered after this long, or failed.
    pub(crate) fn ended(&mut self, number: u64, round_trip: Option<Duration>, now: Duration) {
        let Figures { counts, answers, slots, .. } = &mut self.figures;
        if let Some(round_trip) = round_trip {
            counts.answered += 1;
            // An answer at the deadline is late (A1).
            counts.in_time += u64::from(round_trip + self.runtime < self.deadline);
            answers.add(round_trip);
            slots.add(round_trip);
            self.latest = Some(round_trip);
        } else {
            counts.failed += 1;
            slots.add_never();
        }
        self.rows.settle(number, round_trip.map_or(RequestOutcome::Lost, RequestOutcome::Answered));
        if self.pace.ended() {
            self.resume(now);
        }
    }

    /// Ends the pause.
    fn resume(&mut self, now: Duration) {
        let Some(Pause { first, skipped }) = self.pause.take() else { return };
        self.figures.paused += now.saturating_sub(first);
        for slot in 0..skipped {
            self.figures.slots.add(now.saturating_sub(first + self.period * slot));
        }
    }

    /// Writes what is known.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&mut self) -> Result<(), csv::Error> {
        self.rows.write()
    }

    /// Ends the recording: what is under way stays unanswered, and a pause has no end.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub(crate) fn finish(&mut self, now: Duration) -> Result<(), csv::Error> {
        let Figures { counts, slots, paused, .. } = &mut self.figures;
        counts.unanswered = counts.sent - counts.answered - counts.failed;
        for _ in 0..counts.unanswered {
            slots.add_never();
        }
        if let Some(Pause { first, skipped }) = self.pause.take() {
            *paused += now.saturating_sub(first);
            for _ in 0..skipped {
                slots.add_never();
            }
        }
        self.rows.finish()
    }
}

#[cfg(test)]
mod tests;
