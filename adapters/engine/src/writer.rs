//! Hands lines from the operator to its recorder, which writes files and may wait for the disk
//! (D10).

use std::fs::Metadata;
use std::io;
use std::mem;
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;
#[cfg(feature = "mcap")]
use std::{fs::File, io::BufWriter};

use fuseline_traces::{Annotations, Decision, Event, HeldValues, Input, Recorder};

use crate::counts::Counts;
use crate::lock::lock;
#[cfg(feature = "mcap")]
use crate::mcap::Mcap;

/// The longest time that a line waits before it is written.
const PERIOD: Duration = Duration::from_millis(500);
/// The number of waiting lines at which they are written without delay.
const LINES: usize = 512;
/// The greatest number of lines that may wait for the disk.
const WAITING: usize = 64 * LINES;

/// The destination of a recording.
pub enum Sink {
    /// A file in the trace's own format.
    Lines(Box<Recorder>),
    /// An MCAP file for viewers.
    #[cfg(feature = "mcap")]
    Mcap(Box<Mcap<BufWriter<File>>>),
}

/// Hands lines to a recorder on its own thread, so that a slow disk does not delay the operator.
///
/// Lines are written twice a second, at once when a message is missed or refused, and after each
/// input if the recorder is configured so. If too many lines wait for the disk, or it refuses them,
/// the recording ends there, after a whole input, with an error. The operator continues.
pub(crate) struct TraceWriter {
    waiting: Arc<Mutex<PendingInputs>>,
    writer: Option<JoinHandle<io::Result<()>>>,
    counts: Arc<Counts>,
    every_input: bool,
    /// `true` if nothing is recorded any more.
    is_over: bool,
}

/// The whole inputs, with their decisions, that wait for the recorder.
#[derive(Default)]
struct PendingInputs {
    lines: EventBatch,
    is_end: bool,
}

/// Events, and the further keys of the few that have any.
#[derive(Default)]
struct EventBatch {
    events: Vec<Event>,
    /// Each with the index of its event, in ascending order.
    annotations: Vec<(usize, Annotations)>,
}

impl TraceWriter {
    /// # Errors
    /// Returns an error if the thread cannot be started.
    pub(crate) fn new(sink: Sink, counts: Arc<Counts>) -> io::Result<Self> {
        let waiting = Arc::<Mutex<PendingInputs>>::default();
        let every_input = sink.every_input();
        let (queue, reported) = (Arc::clone(&waiting), Arc::clone(&counts));
        let writer = thread::Builder::new()
            .name("fuseline-trace".into())
            .spawn(move || write(sink, &queue, &reported))?;
        Ok(Self { waiting, writer: Some(writer), counts, every_input, is_over: false })
    }

    /// Records an input with its decisions. `values` knows the messages that the decisions' values
    /// are of.
    pub(crate) fn record(
        &mut self,
        (input, annotations): (&Input, &Annotations),
        decisions: &[Decision],
        values: &HeldValues,
    ) {
        if self.is_over {
            return;
        }
        // The writer holds the lock only while it exchanges two vectors.
        let mut waiting = lock(&self.waiting);
        if waiting.lines.events.len() >= WAITING {
            // A gap would make the trace false, so later inputs are not recorded either.
            self.is_over = true;
            self.counts.recording_error("the disk is too slow");
            return;
        }
        let was_few = waiting.lines.events.len() < LINES;
        waiting.lines.push(Event::Input(*input), annotations);
        for decision in decisions {
            let sent = values.sent(decision);
            waiting.lines.push(Event::Decision(*decision), &sent.into());
        }
        let are_many = was_few && waiting.lines.events.len() >= LINES;
        drop(waiting);
        if self.every_input || are_many || decisions.iter().any(is_loss) {
            self.wake();
        }
    }

    /// Waits until everything is written.
    ///
    /// # Errors
    /// Returns the recorder's error, or an error that the disk was too slow.
    pub(crate) fn finish(&mut self) -> io::Result<()> {
        lock(&self.waiting).is_end = true;
        self.wake();
        let written = match self.writer.take().map(JoinHandle::join) {
            Some(Ok(written)) => written,
            Some(Err(_)) => Err(io::Error::other("the recorder panicked")),
            None => Ok(()),
        };
        if written.is_ok() && self.is_over {
            return Err(io::Error::other("the disk is too slow for the trace"));
        }
        written
    }

    fn wake(&self) {
        if let Some(writer) = &self.writer {
            writer.thread().unpark();
        }
    }
}

impl Drop for TraceWriter {
    fn drop(&mut self) {
        if self.writer.is_some() {
            // The error was reported when it happened.
            let _ = self.finish();
        }
    }
}

/// The file of a recording, as it was at the last look. Lines that are written to a removed file
/// are lost.
#[derive(Default)]
struct WatchedFile {
    path: PathBuf,
    /// Identifies the file, whatever its name.
    identity: (u64, u64),
    len: u64,
}

impl WatchedFile {
    /// Looks at the file under its name.
    ///
    /// # Errors
    /// Returns an error if it was removed, replaced or shortened since the last look.
    fn check(&mut self, path: &Path) -> io::Result<()> {
        let lost = |what| {
            let path = path.display();
            io::Error::other(format!("{path} was {what} while it was written"))
        };
        let found = match path.metadata() {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(lost("removed")),
            found => found?,
        };
        let before = mem::replace(self, Self::of(path, &found));
        if before.path != path {
            Ok(())
        } else if before.identity != self.identity {
            Err(lost("replaced"))
        } else if before.len > self.len {
            Err(lost("shortened"))
        } else {
            Ok(())
        }
    }

    fn of(path: &Path, found: &Metadata) -> Self {
        #[cfg(unix)]
        let identity = (found.dev(), found.ino());
        #[cfg(not(unix))]
        let identity = (0, 0);
        Self { path: path.to_owned(), identity, len: found.len() }
    }
}

/// Writes lines until the end.
fn write(mut sink: Sink, waiting: &Mutex<PendingInputs>, counts: &Counts) -> io::Result<()> {
    let mut lines = EventBatch::default();
    let mut watched = WatchedFile::default();
    let mut failed = None;
    loop {
        let is_end = {
            let mut waiting = lock(waiting);
            mem::swap(&mut lines, &mut waiting.lines);
            waiting.is_end
        };
        if failed.is_none() {
            let mut written = sink.check(&mut watched);
            if !lines.events.is_empty() {
                written = written.and_then(|()| sink.write(lines.iter()));
            }
            if let Err(error) = written {
                counts.recording_error(&error.to_string());
                failed = Some(error);
            }
        }
        lines.clear();
        if is_end {
            break;
        }
        thread::park_timeout(PERIOD);
    }
    failed.map_or_else(|| sink.finish(), Err)
}

/// Returns `true` for a decision that must be in the file even if the process is killed.
const fn is_loss(decision: &Decision) -> bool {
    matches!(decision, Decision::Miss { .. } | Decision::RefuseOpen { .. })
}

impl EventBatch {
    fn push(&mut self, event: Event, annotations: &Annotations) {
        if !annotations.is_empty() {
            self.annotations.push((self.events.len(), annotations.clone()));
        }
        self.events.push(event);
    }

    fn iter(&self) -> impl Iterator<Item = (Event, &Annotations)> {
        static NONE: Annotations = Annotations::NONE;
        let mut annotated = self.annotations.iter().peekable();
        self.events.iter().enumerate().map(move |(index, event)| {
            let own = annotated.next_if(|(of, _)| *of == index);
            (*event, own.map_or(&NONE, |(_, annotations)| annotations))
        })
    }

    fn clear(&mut self) {
        self.events.clear();
        self.annotations.clear();
    }
}

impl Sink {
    /// Checks that the file is still there.
    fn check(&self, watched: &mut WatchedFile) -> io::Result<()> {
        match self {
            Self::Lines(recorder) => watched.check(&recorder.file()),
            #[cfg(feature = "mcap")]
            Self::Mcap(mcap) => mcap.path().map_or(Ok(()), |path| watched.check(path)),
        }
    }

    /// Writes whole inputs with their decisions, and flushes the file.
    fn write<'a>(
        &mut self,
        events: impl Iterator<Item = (Event, &'a Annotations)>,
    ) -> io::Result<()> {
        match self {
            Self::Lines(recorder) => {
                recorder.extend(events);
                recorder.error().map_or(Ok(()), |error| Err(again(error, &recorder.file())))
            }
            #[cfg(feature = "mcap")]
            Self::Mcap(mcap) => {
                for (event, annotations) in events {
                    mcap.event(&event, annotations).map_err(io::Error::other)?;
                }
                mcap.flush().map_err(io::Error::other)
            }
        }
    }

    fn finish(self) -> io::Result<()> {
        match self {
            Self::Lines(recorder) => recorder.finish(),
            #[cfg(feature = "mcap")]
            Self::Mcap(mcap) => mcap.finish().map_err(io::Error::other),
        }
    }

    const fn every_input(&self) -> bool {
        match self {
            Self::Lines(recorder) => recorder.recording().every_input,
            #[cfg(feature = "mcap")]
            Self::Mcap(_) => false,
        }
    }
}

/// Returns a copy of the error that names the file.
fn again(error: &io::Error, file: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", file.display()))
}

impl From<Recorder> for Sink {
    fn from(recorder: Recorder) -> Self {
        Self::Lines(Box::new(recorder))
    }
}

#[cfg(feature = "mcap")]
impl From<Mcap<BufWriter<File>>> for Sink {
    fn from(mcap: Mcap<BufWriter<File>>) -> Self {
        Self::Mcap(Box::new(mcap))
    }
}
