//! A trace's columns filled in a thread of their own, while its next lines are judged.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use fuseline_traces::{Annotations, Event};

use crate::columns::TraceColumns;

/// How many events are handed over at once. A shorter trace needs no thread.
const BATCH: usize = 2048;
/// How many batches wait to be taken, before judging waits.
const WAITING: usize = 4;

/// The columns of one trace while it is judged.
pub(crate) struct ColumnsBeside {
    /// None once the thread has them.
    columns: Option<Box<TraceColumns>>,
    thread: Option<ColumnThread>,
    batch: ColumnBatch,
}

/// The thread, and the ways to it and back.
struct ColumnThread {
    batches: SyncSender<ColumnBatch>,
    spare: Receiver<ColumnBatch>,
    thread: JoinHandle<Box<TraceColumns>>,
}

/// Some events, and what is known of them.
#[derive(Default)]
struct ColumnBatch {
    /// With their lines.
    events: Vec<(u64, Event)>,
    /// What stands on some of them besides, by their places.
    annotations: Vec<(usize, Annotations)>,
    /// The timestamps that were found to break a rule with some of them, by their places.
    broken: Vec<(usize, u64)>,
}

impl ColumnsBeside {
    pub(crate) fn new(columns: TraceColumns) -> Self {
        Self { columns: Some(Box::new(columns)), thread: None, batch: ColumnBatch::default() }
    }

    /// The same, of a part of the trace; to be called before the first event.
    pub(crate) fn of_part(mut self) -> Self {
        self.columns = self.columns.map(|columns| Box::new(columns.of_part()));
        self
    }

    /// Takes the next event; `broken` are the timestamps that were found to break a rule with it.
    pub(crate) fn push(
        &mut self,
        line: u64,
        event: Event,
        annotations: &Annotations,
        broken: Vec<u64>,
    ) {
        let place = self.batch.events.len();
        self.batch.events.push((line, event));
        if !annotations.is_empty() {
            self.batch.annotations.push((place, annotations.clone()));
        }
        self.batch.broken.extend(broken.into_iter().map(|t| (place, t)));
        if self.batch.events.len() == BATCH {
            self.hand_over();
        }
    }

    /// The columns with all events, and the timestamps that `broken` names besides.
    pub(crate) fn finish(mut self) -> Box<TraceColumns> {
        if let Some(mut columns) = self.columns.take() {
            self.batch.fill(&mut columns, &mut Vec::new());
            return columns;
        }
        self.hand_over();
        let ColumnThread { batches, spare: _, thread } = self.thread.take().expect("it has them");
        // It ends once no batch can come.
        drop(batches);
        thread.join().unwrap_or_else(|panic| resume_unwind(panic))
    }

    fn hand_over(&mut self) {
        if let Some(columns) = self.columns.take() {
            self.thread = Some(ColumnThread::new(columns));
        }
        let Some(thread) = &self.thread else { return };
        let next = thread.spare.try_recv().unwrap_or_default();
        // Where it has ended by a panic, that comes when it is joined.
        drop(thread.batches.send(std::mem::replace(&mut self.batch, next)));
    }
}

impl ColumnThread {
    fn new(mut columns: Box<TraceColumns>) -> Self {
        let (batches, filled) = sync_channel::<ColumnBatch>(WAITING);
        let (empty, spare) = sync_channel(WAITING + 2);
        let thread = thread::spawn(move || {
            let mut broken = Vec::new();
            for mut batch in filled {
                batch.fill(&mut columns, &mut broken);
                // Where there is no room for it, it is not needed.
                drop(empty.try_send(batch));
            }
            columns
        });
        Self { batches, spare, thread }
    }
}

impl ColumnBatch {
    /// Puts the events into the columns, and is empty then. Until they are thinned, timestamps wait in `broken`.
    fn fill(&mut self, columns: &mut TraceColumns, broken: &mut Vec<u64>) {
        let mut annotations = self.annotations.drain(..).peekable();
        let mut found = self.broken.drain(..).peekable();
        for (place, (line, event)) in self.events.drain(..).enumerate() {
            let own =
                annotations.next_if(|(of, _)| *of == place).map(|(_, annotations)| annotations);
            columns.push(line, event, own.as_ref().unwrap_or(&Annotations::NONE));
            broken.extend(
                std::iter::from_fn(|| found.next_if(|(of, _)| *of == place)).map(|it| it.1),
            );
            if columns.is_long() {
                columns.thin(broken.drain(..));
            }
        }
    }
}
