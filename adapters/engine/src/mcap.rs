//! Writes a run as MCAP, with lines of the trace as JSON messages, for Foxglove and other readers
//! of MCAP.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use fuseline_traces::{Annotations, Decision, Event, Header, HeaderAnnotations};
pub use mcap::McapError;
use mcap::WriteOptions;
use mcap::records::MessageHeader;

/// The JSON schema of a message.
const SCHEMA: &str = r#"{"title":"fuseline.Line","description":"A line of a fuseline trace: its header, an input or a decision.","type":"object","properties":{"ev":{"type":"string"},"at":{"type":"integer"},"t":{"type":"integer"},"p":{"type":"integer"},"due":{"type":"integer"},"deadline":{"type":"integer"},"backlog":{"type":"integer"},"why":{"type":"string"},"of":{"type":"integer"},"for":{"type":"integer"},"try":{"type":"integer"},"within":{"type":"integer"},"age":{"type":"integer"},"origin":{"type":"string"},"seq":{"type":"integer"}}}"#;

/// The level of zstd: the quickest one, whose files are hardly larger.
const PACKING: u32 = 1;

/// Writes an MCAP file. The topic `/fuseline/trace` has every line, with the header first, and
/// `/fuseline/outputs` has the forwarded, final and missed ones.
pub struct Mcap<W: Write + Seek> {
    inner: mcap::Writer<W>,
    epoch: u64,
    lines: u16,
    outputs: u16,
    number: u32,
    line: Vec<u8>,
    path: Option<PathBuf>,
}

impl Mcap<BufWriter<File>> {
    /// Creates the file, or overwrites it.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn create(
        path: &Path,
        header: &Header,
        annotations: &HeaderAnnotations,
        epoch: u64,
    ) -> io::Result<Self> {
        let out = BufWriter::new(File::create(path)?);
        let mcap = Self::new(out, header, annotations, epoch).map_err(io::Error::other)?;
        Ok(Self { path: Some(path.to_owned()), ..mcap })
    }
}

impl<W: Write + Seek> Mcap<W> {
    /// Creates a recording into `out`.
    ///
    /// `epoch`, in nanoseconds, is the time that viewers show for instant 0. Give the time since
    /// 1970 if they should show the time of day.
    ///
    /// # Errors
    /// Returns an error if `out` cannot be written.
    pub fn new(
        out: W,
        header: &Header,
        annotations: &HeaderAnnotations,
        epoch: u64,
    ) -> Result<Self, McapError> {
        let library = format!("fuseline {}", env!("CARGO_PKG_VERSION"));
        // Lines come in many small writes, and handing each to a thread costs more than packing it
        // here.
        let options = WriteOptions::new().compression_threads(0).compression_level(PACKING);
        let options = options.profile("fuseline").library(library);
        let mut inner = options.create(out)?;
        let schema = inner.add_schema("fuseline.Line", "jsonschema", SCHEMA.as_bytes())?;
        let none = BTreeMap::new();
        let lines = inner.add_channel(schema, "/fuseline/trace", "json", &none)?;
        let outputs = inner.add_channel(schema, "/fuseline/outputs", "json", &none)?;
        let mut mcap =
            Self { inner, epoch, lines, outputs, number: 0, line: Vec::new(), path: None };
        header.write_annotated(annotations, &mut mcap.line);
        mcap.put(lines, 0)?;
        Ok(mcap)
    }

    /// Writes one line with its further keys. An output is written twice, once for each topic.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn event(&mut self, event: &Event, annotations: &Annotations) -> Result<(), McapError> {
        self.line.clear();
        event.write_annotated(annotations, &mut self.line);
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.put(self.lines, at)?;
        if let Event::Decision(
            Decision::Emit { .. } | Decision::Final { .. } | Decision::Miss { .. },
        ) = event
        {
            self.put(self.outputs, at)?;
        }
        Ok(())
    }

    /// Returns the path of the file, if it was [created](Self::create) here.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Writes what is buffered, so that it can be recovered if the process is killed.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn flush(&mut self) -> Result<(), McapError> {
        self.inner.flush()
    }

    /// Ends the file. Readers must recover the data of a file that was not ended.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn finish(mut self) -> Result<(), McapError> {
        self.inner.finish()?;
        Ok(())
    }

    fn put(&mut self, channel_id: u16, at: u64) -> Result<(), McapError> {
        let sequence = self.number;
        let log_time = self.epoch.saturating_add(at);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.inner.write_to_known_channel(&header, &self.line)?;
        self.number = self.number.wrapping_add(1);
        Ok(())
    }
}
