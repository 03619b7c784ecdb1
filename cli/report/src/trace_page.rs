//! The page with its traces. Each trace is judged as it is read.

use std::io::{self, Write};

use fuseline_traces::observed::TimeOrderError;
use fuseline_traces::{Annotations, Event, Header, HeaderAnnotations, Verdict};

use crate::columns::{PageTrace, TraceColumns};
use crate::judging::{JudgeMode, TraceJudge};
use crate::notes::RunNotes;
use crate::page::{self, Data};
use crate::part::{PartFilter, TraceRange};

/// The greatest number of events of one trace on a page. If a trace is longer, the page shows and
/// counts the first ones, and says so. The verdict covers the whole trace.
pub const MOST_EVENTS: usize = 1_250_000;
/// Each trace may use one eighth of the room that is left, so the room never runs out.
const PART: usize = 8;

/// A page about traces.
pub struct PageWriter {
    page_trace: Vec<PageTrace>,
    /// The number of events for which there is still room.
    room: usize,
}

/// One trace while it is read. If it is dropped, the page does not show it.
pub struct TracePage<'a> {
    page: &'a mut PageWriter,
    mode: JudgeMode,
    header: Header,
    judging: TraceJudge,
    columns: TraceColumns,
    notes: Option<RunNotes>,
    part: Option<PartFilter>,
}

impl Default for PageWriter {
    fn default() -> Self {
        Self::with_most_events(MOST_EVENTS)
    }
}

impl PageWriter {
    /// Returns a page that holds this many events of the first trace, and fewer of the traces that
    /// follow long ones.
    #[must_use]
    pub const fn with_most_events(most: usize) -> Self {
        Self { page_trace: Vec::new(), room: most.saturating_mul(PART) }
    }

    /// Begins a trace, which is called `name`.
    pub fn begin(&mut self, mode: JudgeMode, name: &str, header: &Header) -> TracePage<'_> {
        TracePage {
            mode,
            header: header.clone(),
            judging: TraceJudge::new(mode, name, header).with_places(),
            columns: TraceColumns::new(header, mode.is_some(), self.room / PART),
            notes: None,
            part: None,
            page: self,
        }
    }

    /// Writes the whole page as HTML in UTF-8.
    ///
    /// # Errors
    /// Returns an error if `out` cannot be written.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        page::write(out, &Data::new(&self.page_trace))
    }
}

impl TracePage<'_> {
    /// Judges for an operator with this period; see [`TraceJudge::with_period`].
    #[must_use]
    pub fn with_period(mut self, period: u64) -> Self {
        self.judging = self.judging.with_period(period);
        self
    }

    /// Judges a trace whose header has these annotations; see
    /// [`TraceJudge::with_header_annotations`].
    #[must_use]
    pub fn with_header_annotations(mut self, annotations: &HeaderAnnotations) -> Self {
        self.judging = self.judging.with_header_annotations(annotations);
        self
    }

    /// Judges with a tolerance for one source's stamps; see [`TraceJudge::with_tolerance_of`].
    #[must_use]
    pub fn with_tolerance_of(mut self, p: u64, tolerance: u64) -> Self {
        self.judging = self.judging.with_tolerance_of(p, tolerance);
        self
    }

    /// Shows a part of the trace; see [`TraceJudge::with_part`].
    #[must_use]
    pub fn with_part(mut self, part: TraceRange) -> Self {
        self.judging = self.judging.with_part(part).with_places();
        self.columns = self.columns.of_part();
        self.part = Some(PartFilter::new(part));
        self
    }

    /// Shows these facts about its run beside it.
    pub fn add_notes(&mut self, notes: RunNotes) {
        self.notes = Some(notes);
    }

    /// Takes the next event, with its line and no annotations.
    ///
    /// # Errors
    /// Returns an error if an observed trace is further out of order than its tolerance.
    pub fn event(&mut self, line: u64, event: Event) -> Result<(), TimeOrderError> {
        self.annotated_event(line, event, &Annotations::NONE)
    }

    /// Takes the next event, with its line and its annotations. They take part in the judgement,
    /// and the page shows the origin and the age of a message.
    ///
    /// # Errors
    /// Returns an error if an observed trace is further out of order than its tolerance.
    pub fn annotated_event(
        &mut self,
        line: u64,
        event: Event,
        annotations: &Annotations,
    ) -> Result<(), TimeOrderError> {
        self.judging.annotated_line(line, &event, annotations)?;
        if self.part.as_mut().is_some_and(|part| !part.takes(&event)) {
            return Ok(());
        }
        self.columns.push(line, event, annotations);
        Ok(())
    }

    /// Judges the whole trace and puts it on the page; see [`TraceJudge::finish`].
    #[must_use = "whether it conforms"]
    pub fn finish(self) -> Verdict {
        self.end(|judging| (judging.finish(), false)).0
    }

    /// Finishes the page of a run that is known to have ended; see [`TraceJudge::finish_ended`].
    #[must_use = "whether it conforms"]
    pub fn finish_ended(self) -> Verdict {
        self.end(|judging| (judging.finish_ended(), false)).0
    }

    /// Finishes the page of a trace that may go on or was cut short; see
    /// [`TraceJudge::finish_early`].
    #[must_use = "whether it conforms"]
    pub fn finish_early(self) -> (Verdict, bool) {
        self.end(TraceJudge::finish_early)
    }

    /// Finishes the page with a verdict that the caller makes.
    #[must_use = "whether it conforms"]
    pub fn finish_as(self, finish: impl FnOnce(TraceJudge) -> Verdict) -> Verdict {
        self.end(|judging| (finish(judging), false)).0
    }

    fn end(self, finish: impl FnOnce(TraceJudge) -> (Verdict, bool)) -> (Verdict, bool) {
        let (found, is_cut) = finish(self.judging);
        let mut shown = self.columns.page_trace(&self.header, self.mode, &found);
        shown.run = self.notes;
        self.page.page_trace.push(shown);
        self.page.room = self.page.room.saturating_sub(self.columns.len());
        (found, is_cut)
    }
}
