//! What the formats of viewers have in common.

use std::io;

use fuseline_traces::{Annotations, Event};

/// Takes a trace line by line.
pub(super) trait TraceViewer {
    fn event(&mut self, event: &Event, annotations: &Annotations) -> io::Result<()>;
    /// What was left out so far, since the format has no place for it.
    fn left_out(&self) -> Vec<String> {
        Vec::new()
    }
    fn finish(self: Box<Self>) -> io::Result<()>;
}
