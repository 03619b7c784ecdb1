//! A trace read in one thread and judged in another, line by line and in order.

use std::io::BufRead;
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use fuseline_report::TraceJudge;
use fuseline_traces::observed::TimeOrderError;
use fuseline_traces::{Annotations, Event, Events};

use crate::fault::Fault;
use crate::hints::JudgingHints;
use crate::judging::{TraceEnd, next_event};

/// How many lines pass from one thread to the other at once.
const BATCH: usize = 2048;
/// How many batches wait to be judged, before reading waits.
const WAITING: usize = 4;

/// A line as it was read.
struct LineRead {
    line: u64,
    event: Event,
    annotations: Option<Box<Annotations>>,
}

/// Reads a trace to its end, and judges it meanwhile.
///
/// # Errors
/// Of the earliest line with which something is wrong.
pub(super) fn judge_lines(
    reader: &mut Events<impl BufRead>,
    end: TraceEnd,
    judging: TraceJudge,
    hints: JudgingHints,
) -> Result<(TraceJudge, JudgingHints), Fault> {
    let (lines, waiting) = sync_channel(WAITING);
    let (read, judged) = thread::scope(|scope| {
        let judge = scope.spawn(move || judge_batches(judging, hints, &waiting));
        let read = read_batches(reader, end, &lines);
        drop(lines);
        (read, judge.join())
    });
    // A line that cannot be judged stands before one that cannot be read.
    let judged = judged.unwrap_or_else(|panic| resume_unwind(panic))?;
    read.map(|()| judged)
}

fn read_batches(
    reader: &mut Events<impl BufRead>,
    end: TraceEnd,
    lines: &SyncSender<Vec<LineRead>>,
) -> Result<(), Fault> {
    loop {
        let mut batch = Vec::with_capacity(BATCH);
        let mut read = Ok(true);
        while read.as_ref().is_ok_and(|goes_on| *goes_on) && batch.len() < BATCH {
            read = next_event(reader, end).map(|event| {
                let Some(event) = event else { return false };
                let annotations = reader.annotations();
                let has_some = *annotations != Annotations::NONE;
                let annotations = has_some.then(|| Box::new(annotations.clone()));
                batch.push(LineRead { line: reader.line(), event, annotations });
                true
            });
        }
        // Where judging has ended, it says why.
        let is_judged = lines.send(batch).is_ok();
        if !read? || !is_judged {
            return Ok(());
        }
    }
}

fn judge_batches(
    mut judging: TraceJudge,
    mut hints: JudgingHints,
    lines: &Receiver<Vec<LineRead>>,
) -> Result<(TraceJudge, JudgingHints), TimeOrderError> {
    let none = Annotations::NONE;
    for LineRead { line, event, annotations } in lines.iter().flatten() {
        hints.event(&event);
        let annotations = annotations.as_deref().unwrap_or(&none);
        judging.annotated_line(line, &event, annotations)?;
    }
    Ok((judging, hints))
}
