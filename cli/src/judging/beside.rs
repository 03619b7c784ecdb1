//! Reads a trace in one thread and judges it in another, line by line and in order.

use std::io::BufRead;
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use fuseline_traces::observed::TimeOrderError;
use fuseline_traces::{Annotations, Event, Events};

use crate::fault::Fault;
use crate::judging::{TraceEnd, TraceStep, next_event};

/// The number of lines that pass from one thread to the other at once.
const BATCH: usize = 2048;
/// The number of batches that may wait to be judged before reading waits.
const WAITING: usize = 4;

/// A line as it was read.
struct LineRead {
    line: u64,
    event: Event,
    annotations: Option<Box<Annotations>>,
}

type LineBatch = Vec<LineRead>;

/// Reads a trace to its end. Another thread calls `judge` with each line's number and contents. The
/// reading thread calls `read`, which also gets each line's bytes. Returns the line that was cut
/// short, if that is allowed and happened.
///
/// # Errors
/// Returns the error of the earliest line that cannot be read or judged.
pub(crate) fn judge_lines(
    reader: &mut Events<impl BufRead>,
    end: TraceEnd,
    read: impl FnMut(&Event, &[u8]),
    judge: impl FnMut(u64, Event, &Annotations) -> Result<(), TimeOrderError> + Send,
) -> Result<Option<u64>, Fault> {
    let (lines, waiting) = sync_channel(WAITING);
    let (judged, spare) = sync_channel(WAITING + 2);
    let (read, judged) = thread::scope(|scope| {
        let judge = scope.spawn(move || judge_batches(judge, &waiting, &judged));
        let read = read_batches(reader, end, read, (&lines, &spare));
        drop(lines);
        (read, judge.join())
    });
    // A line that cannot be judged comes before a line that cannot be read.
    judged.unwrap_or_else(|panic| resume_unwind(panic))?;
    read
}

fn read_batches(
    reader: &mut Events<impl BufRead>,
    end: TraceEnd,
    mut seen: impl FnMut(&Event, &[u8]),
    (lines, spare): (&SyncSender<LineBatch>, &Receiver<LineBatch>),
) -> Result<Option<u64>, Fault> {
    let mut cut = None;
    loop {
        // Reusing memory saves the system from providing new pages.
        let mut batch = spare.try_recv().unwrap_or_else(|_| Vec::with_capacity(BATCH));
        let mut read = Ok(true);
        while read.as_ref().is_ok_and(|goes_on| *goes_on) && batch.len() < BATCH {
            read = next_event(reader, end).map(|step| {
                let event = match step {
                    TraceStep::Event(event) => event,
                    TraceStep::End => return false,
                    TraceStep::Cut(line) => {
                        cut = Some(line);
                        return false;
                    }
                };
                seen(&event, reader.raw());
                let annotations = reader.annotations();
                let has_some = *annotations != Annotations::NONE;
                let annotations = has_some.then(|| Box::new(annotations.clone()));
                batch.push(LineRead { line: reader.line(), event, annotations });
                true
            });
        }
        // If judging has ended early, it returns the reason.
        let is_judged = lines.send(batch).is_ok();
        if !read? || !is_judged {
            return Ok(cut);
        }
    }
}

fn judge_batches(
    mut judge: impl FnMut(u64, Event, &Annotations) -> Result<(), TimeOrderError>,
    lines: &Receiver<LineBatch>,
    judged: &SyncSender<LineBatch>,
) -> Result<(), TimeOrderError> {
    let none = Annotations::NONE;
    for mut batch in lines {
        for LineRead { line, event, annotations } in batch.drain(..) {
            judge(line, event, annotations.as_deref().unwrap_or(&none))?;
        }
        // If there is no room for the batch, it is not needed any more.
        drop(judged.try_send(batch));
    }
    Ok(())
}
