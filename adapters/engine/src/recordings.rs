//! The recordings of one operator: each input with its decisions, handed to every writer in the same order (D3).
//!
//! Nothing here waits for a disk: what a writer does with the lines is in [`writer`](crate::writer).

use std::io;

use fuseline_core::{Commit, Firing};
use fuseline_traces::{Decision, Input};

use crate::arbiter::{Answer, decisions_of};
use crate::writer::TraceWriter;

/// The writers, and the decisions of the current input.
#[derive(Default)]
pub(crate) struct Recordings {
    writers: Vec<TraceWriter>,
    decisions: Vec<Decision>,
}

impl Recordings {
    pub(crate) fn add(&mut self, writer: TraceWriter) {
        self.writers.push(writer);
    }

    /// F5: timers fired before the current input.
    pub(crate) fn fired<const CLOUDS: usize>(&mut self, at: u64, firing: &Firing<CLOUDS>) {
        if !self.writers.is_empty() {
            decisions_of(at, firing, |decision| self.decisions.push(decision));
        }
    }

    /// Records the input, what fired before it, and its answer.
    pub(crate) fn record<const CLOUDS: usize>(
        &mut self,
        input: &Input,
        (commit, now): (Commit, u64),
        answer: &Answer<CLOUDS>,
    ) {
        if self.writers.is_empty() {
            return;
        }
        answer.decisions(commit, now, |decision| self.decisions.push(decision));
        for writer in &mut self.writers {
            writer.record(input, &self.decisions);
        }
        self.decisions.clear();
    }

    /// Ends all of them, and waits until they are written.
    ///
    /// # Errors
    /// The first error while recording; the trace is whole up to there.
    pub(crate) fn finish(&mut self) -> io::Result<()> {
        // All of them, even if the first fails.
        let written: Vec<_> = self.writers.drain(..).map(|mut writer| writer.finish()).collect();
        written.into_iter().collect()
    }
}
