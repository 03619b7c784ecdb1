//! The recordings of one operator: hands each input with its decisions to every writer, in the same
//! order (D3).
//!
//! Nothing here waits for a disk; [`writer`](crate::writer) writes the lines.

use std::io;

use fuseline_core::{Commit, Firing};
use fuseline_traces::{Annotations, Decision, HeldValues, Input};

use crate::arbiter::{Answer, decisions_of};
use crate::writer::TraceWriter;

/// The writers, and the decisions of the current input.
#[derive(Default)]
pub(crate) struct Recordings {
    writers: Vec<TraceWriter>,
    decisions: Vec<Decision>,
    /// The messages that the values of emits are of.
    values: HeldValues,
}

impl Recordings {
    pub(crate) fn add(&mut self, writer: TraceWriter) {
        self.writers.push(writer);
    }

    /// Returns `true` if anything is recorded.
    pub(crate) const fn is_any(&self) -> bool {
        !self.writers.is_empty()
    }

    /// Notes timers that fired before the current input (F5).
    pub(crate) fn fired<const CLOUDS: usize>(&mut self, at: u64, firing: &Firing<CLOUDS>) {
        if !self.writers.is_empty() {
            decisions_of(at, firing, |decision| self.decisions.push(decision));
        }
    }

    /// Records the input, the firings before it, and its answer. Called only if anything is
    /// recorded.
    pub(crate) fn record<const CLOUDS: usize>(
        &mut self,
        (input, annotations): (&Input, &Annotations),
        (commit, now): (Commit, u64),
        answer: &Answer<CLOUDS>,
    ) {
        answer.decisions(commit, now, |decision| self.decisions.push(decision));
        let Self { writers, decisions, values } = self;
        if !values.is_idle(annotations.value()) {
            values.apply(input, annotations.value(), decisions.iter());
        }
        for writer in writers {
            writer.record((input, annotations), decisions, values);
        }
        self.decisions.clear();
    }

    /// Ends all recordings and waits until they are written.
    ///
    /// # Errors
    /// Returns the first error while recording. The trace is whole up to there.
    pub(crate) fn finish(&mut self) -> io::Result<()> {
        // All of them end, even if the first one fails.
        let written: Vec<_> = self.writers.drain(..).map(|mut writer| writer.finish()).collect();
        written.into_iter().collect()
    }
}
