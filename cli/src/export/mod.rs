//! `fuseline export`: a trace for the viewers of others.

mod mcap;
mod perfetto;

use std::io::{self, BufReader, Seek, Write};
use std::path::PathBuf;

use fuseline_operator::{Mcap, McapError};
use fuseline_traces::{Event, Header, Reader, unpack};
use thiserror::Error;

use crate::Exit;
use crate::check::open;
use crate::fault::Fault;
use crate::whole;

#[derive(clap::Args)]
#[command(after_help = "\
Perfetto: a JSON trace for ui.perfetto.dev with a track for local and for each cloud, a slice for each
request from its admission to its end, named by its timestamp, and an instant for each output.
MCAP: for Foxglove; the topic /fuseline/trace has each line as a JSON message, the header first, and
/fuseline/outputs what was forwarded or missed. `fuseline convert` reads it back.

Examples:
  fuseline export --perfetto trace.jsonl -o trace.perfetto.json
  fuseline export --mcap trace.jsonl -o trace.mcap")]
#[group(skip)]
pub(crate) struct Args {
    /// The trace; - or none is standard input.
    #[arg(value_name = "FILE", default_value = "-")]
    file: PathBuf,
    #[command(flatten)]
    viewer: Viewer,
    /// The file to write; it appears once it is whole.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Viewer {
    /// For ui.perfetto.dev.
    #[arg(long)]
    perfetto: bool,
    /// For Foxglove and everything that reads MCAP.
    #[arg(long)]
    mcap: bool,
}

/// Why a trace cannot be written for a viewer.
#[derive(Debug, Error)]
pub(crate) enum ExportError {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Mcap(#[from] McapError),
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// Takes a trace line by line.
trait Writer {
    fn event(&mut self, event: &Event) -> Result<(), ExportError>;
    fn finish(self: Box<Self>) -> Result<(), ExportError>;
}

/// Writes the trace for the viewer.
pub(crate) fn export(args: &Args) -> Result<Exit, Fault> {
    let (name, file) = open(&args.file)?;
    let trace = unpack(BufReader::new(file));
    let trace = trace.map_err(|source| Fault::Open { name: name.clone(), source })?;
    let mut reader = Reader::observed(name, trace)?;

    let name = args.output.display().to_string();
    let wrong = |source: ExportError| Fault::Export { name: name.clone(), source };
    whole::write(&args.output, |out| {
        let mut writer = writer(&args.viewer, out, reader.header()).map_err(wrong)?;
        while let Some(event) = reader.next_event()? {
            writer.event(&event).map_err(wrong)?;
        }
        writer.finish().map_err(wrong)
    })?;
    Ok(Exit::Conforms)
}

fn writer<'a, W: Write + Seek + 'a>(
    viewer: &Viewer,
    out: W,
    header: &Header,
) -> Result<Box<dyn Writer + 'a>, ExportError> {
    Ok(if viewer.mcap {
        Box::new(Mcap::new(out, header, 0)?)
    } else {
        Box::new(perfetto::Tracks::new(out, header)?)
    })
}
