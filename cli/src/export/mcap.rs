//! MCAP: lines as JSON messages.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use fuseline_traces::{Decision, Event, Header};
use mcap::WriteOptions;
use mcap::records::MessageHeader;

use crate::export::ExportError;

/// What a message holds.
const SCHEMA: &str = r#"{"title":"fuseline.Line","description":"A line of a fuseline trace: its header, an input or a decision.","type":"object","properties":{"ev":{"type":"string"},"at":{"type":"integer"},"t":{"type":"integer"},"p":{"type":"integer"},"due":{"type":"integer"},"deadline":{"type":"integer"},"limit":{"type":"integer"},"backlog":{"type":"integer"},"why":{"type":"string"}}}"#;

/// A file that is being written.
pub(super) struct Messages<W: Write + Seek> {
    inner: mcap::Writer<W>,
    lines: u16,
    outputs: u16,
    number: u32,
    line: Vec<u8>,
}

impl<W: Write + Seek> Messages<W> {
    pub(super) fn new(out: W, header: &Header) -> Result<Self, ExportError> {
        let library = format!("fuseline {}", env!("CARGO_PKG_VERSION"));
        let options = WriteOptions::new().profile("fuseline").library(library);
        let mut inner = options.create(out)?;
        let schema = inner.add_schema("fuseline.Line", "jsonschema", SCHEMA.as_bytes())?;
        let none = BTreeMap::new();
        let lines = inner.add_channel(schema, "/fuseline/trace", "json", &none)?;
        let outputs = inner.add_channel(schema, "/fuseline/outputs", "json", &none)?;
        let mut messages = Self { inner, lines, outputs, number: 0, line: Vec::new() };
        header.write(&mut messages.line);
        messages.put(lines, 0)?;
        Ok(messages)
    }

    fn put(&mut self, channel_id: u16, at: u64) -> Result<(), ExportError> {
        let sequence = self.number;
        let header = MessageHeader { channel_id, sequence, log_time: at, publish_time: at };
        self.inner.write_to_known_channel(&header, &self.line)?;
        self.number = self.number.wrapping_add(1);
        Ok(())
    }
}

impl<W: Write + Seek> super::Writer for Messages<W> {
    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        self.line.clear();
        event.write(&mut self.line);
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.put(self.lines, at)?;
        if let Event::Decision(Decision::Emit { .. } | Decision::Miss { .. }) = event {
            self.put(self.outputs, at)?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), ExportError> {
        self.inner.finish()?;
        Ok(())
    }
}
