//! The way from the operator to its recorder, which writes files and may wait for the disk.

use std::io;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use fuseline_traces::{Decision, Input, Recorder};

/// How many lines go to the recorder at once.
const LINES: usize = 512;
/// How many times as many may wait for the disk.
const BATCHES: usize = 64;

/// Hands lines to a recorder on its own thread, so that a slow disk does not delay the operator.
///
/// When too many lines wait for the disk, the recording ends there, whole, with an error.
pub(crate) struct Tape {
    lines: Vec<Line>,
    batches: Option<SyncSender<Vec<Line>>>,
    writer: Option<JoinHandle<io::Result<()>>>,
    behind: bool,
}

enum Line {
    Input(Input),
    Decision(Decision),
}

impl Tape {
    /// # Errors
    /// If the system has no thread left.
    pub(crate) fn new(mut recorder: Recorder) -> io::Result<Self> {
        let (batches, written) = sync_channel::<Vec<Line>>(BATCHES);
        let writer = thread::Builder::new().name("fuseline-trace".into()).spawn(move || {
            for line in written.iter().flatten() {
                match line {
                    Line::Input(input) => recorder.input(&input),
                    Line::Decision(decision) => recorder.decision(&decision),
                }
            }
            recorder.finish()
        })?;
        Ok(Self { lines: Vec::new(), batches: Some(batches), writer: Some(writer), behind: false })
    }

    pub(crate) fn record(&mut self, input: &Input, decisions: &[Decision]) {
        if self.lines.len() >= LINES {
            self.hand_over();
        }
        self.lines.push(Line::Input(*input));
        self.lines.extend(decisions.iter().copied().map(Line::Decision));
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
