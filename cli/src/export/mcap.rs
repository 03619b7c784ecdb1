//! MCAP: lines as JSON messages.

use std::io::{Seek, Write};

use fuseline_operator::Mcap;
use fuseline_traces::Event;

use crate::export::ExportError;

impl<W: Write + Seek> super::Writer for Mcap<W> {
    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        Ok(Self::event(self, event)?)
    }

    fn finish(self: Box<Self>) -> Result<(), ExportError> {
        Ok(Mcap::finish(*self)?)
    }
}
