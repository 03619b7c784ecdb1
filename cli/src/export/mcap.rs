//! MCAP: lines as JSON messages.

use std::io::{self, Seek, Write};

use fuseline_engine::{Mcap, McapError};
use fuseline_traces::{Annotations, Event, Header, HeaderAnnotations};

use crate::export::viewer::TraceViewer;

pub(super) struct McapWriter<W: Write + Seek>(Mcap<W>);

impl<W: Write + Seek> McapWriter<W> {
    pub(super) fn new(
        out: W,
        header: &Header,
        annotations: &HeaderAnnotations,
    ) -> io::Result<Self> {
        Ok(Self(Mcap::new(out, header, annotations, 0).map_err(io_error)?))
    }
}

impl<W: Write + Seek> TraceViewer for McapWriter<W> {
    fn event(&mut self, event: &Event, annotations: &Annotations) -> io::Result<()> {
        self.0.event(event, annotations).map_err(io_error)
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        self.0.finish().map_err(io_error)
    }
}

/// Returns why the file could not be written.
fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        error => io::Error::other(error),
    }
}
