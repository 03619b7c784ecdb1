//! The part that the viewers' formats share.

use std::io;

use fuseline_traces::{Annotations, Event};

/// Takes a trace line by line.
pub(super) trait TraceViewer {
    fn event(&mut self, event: &Event, annotations: &Annotations) -> io::Result<()>;
    /// Returns the keys that were omitted so far, because the format has no place for them.
    fn left_out(&self) -> Vec<String> {
        Vec::new()
    }
    fn finish(self: Box<Self>) -> io::Result<()>;
}
