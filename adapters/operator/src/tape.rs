//! The way from the operator to its recorder, which writes files and may wait for the disk.

use std::io;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

#[cfg(feature = "mcap")]
use std::{fs::File, io::BufWriter};

use fuseline_traces::{Decision, Event, Input, Recorder};

#[cfg(feature = "mcap")]
use crate::mcap::Mcap;

/// How many lines go to the recorder at once.
const LINES: usize = 512;
/// How many times as many may wait for the disk.
const BATCHES: usize = 64;

/// What a run is recorded as.
pub enum Sink {
    /// The trace's own format.
    Lines(Box<Recorder>),
    /// For viewers.
    #[cfg(feature = "mcap")]
    Mcap(Box<Mcap<BufWriter<File>>>),
}

/// Hands lines to a recorder on its own thread, so that a slow disk does not delay the operator.
///
/// When too many lines wait for the disk, the recording ends there, whole, with an error.
pub(crate) struct Tape {
    lines: Vec<Event>,
    batches: Option<SyncSender<Vec<Event>>>,
    writer: Option<JoinHandle<io::Result<()>>>,
    behind: bool,
}

impl Tape {
    /// # Errors
    /// If the system has no thread left.
    pub(crate) fn new(sink: Sink) -> io::Result<Self> {
        let (batches, written) = sync_channel::<Vec<Event>>(BATCHES);
        let writer = thread::Builder::new()
            .name("fuseline-trace".into())
            .spawn(move || sink.write(written.iter().flatten()))?;
        Ok(Self { lines: Vec::new(), batches: Some(batches), writer: Some(writer), behind: false })
    }

    pub(crate) fn record(&mut self, input: &Input, decisions: &[Decision]) {
        if self.lines.len() >= LINES {
            self.hand_over();
        }
        self.lines.push(Event::Input(*input));
        self.lines.extend(decisions.iter().copied().map(Event::Decision));
    }

    /// Waits until all is written.
    ///
    /// # Errors
    /// What the recorder met, or that the disk was too slow.
    pub(crate) fn finish(&mut self) -> io::Result<()> {
        self.hand_over();
        self.batches = None;
        let written = match self.writer.take().map(JoinHandle::join) {
            Some(Ok(written)) => written,
            Some(Err(_)) => Err(io::Error::other("the recorder panicked")),
            None => Ok(()),
        };
        if written.is_ok() && self.behind {
            return Err(io::Error::other("the disk is too slow for the trace"));
        }
        written
    }

    fn hand_over(&mut self) {
        let lines = std::mem::replace(&mut self.lines, Vec::with_capacity(LINES + 64));
        if let Some(batches) = &self.batches
            && batches.try_send(lines).is_err()
        {
            // A gap would make the trace a false one: what comes later is not recorded either.
            tracing::error!("the disk is too slow, the trace ends here");
            self.batches = None;
            self.behind = true;
        }
    }
}

impl Drop for Tape {
    fn drop(&mut self) {
        if self.writer.is_some()
            && let Err(error) = self.finish()
        {
            tracing::error!(%error, "the trace is not whole");
        }
    }
}

impl Sink {
    /// Writes all there is.
    fn write(self, events: impl Iterator<Item = Event>) -> io::Result<()> {
        match self {
            Self::Lines(mut recorder) => {
                for event in events {
                    match event {
                        Event::Input(input) => recorder.input(&input),
                        Event::Decision(decision) => recorder.decision(&decision),
                    }
                }
                recorder.finish()
            }
            #[cfg(feature = "mcap")]
            Self::Mcap(mut mcap) => {
                for event in events {
                    mcap.event(&event).map_err(io::Error::other)?;
                }
                mcap.finish().map_err(io::Error::other)
            }
        }
    }
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
