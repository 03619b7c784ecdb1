//! `fuseline export`: a trace for other tools' viewers.

mod mcap;
mod perfetto;
mod viewer;

use std::io::BufReader;
use std::path::PathBuf;

use fuseline_traces::Events;
use fuseline_traces::packed::unpack;

use crate::complain::complain;
use crate::exit::Exit;
use crate::export::mcap::McapWriter;
use crate::export::perfetto::Tracks;
use crate::export::viewer::TraceViewer;
use crate::fault::Fault;
use crate::input::open;
use crate::output::{Output, Overwrite};

#[derive(clap::Args)]
#[command(after_help = "\
Perfetto: a JSON trace for ui.perfetto.dev with a track for local and for each cloud, more of the same
name where calls overlap. A call is a slice from its admission to its end, named by its timestamp and by
how it ended; what was forwarded or missed stands on a track of its own.
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
    /// The file to write, which appears once it is whole; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
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

/// Writes the trace for the viewer.
pub(crate) fn export(args: &Args) -> Result<Exit, Fault> {
    let output = Output::new(&args.output, &[&args.file], args.overwrite)?;
    let (name, file) = open(&args.file)?;
    let trace = unpack(BufReader::new(file));
    let trace = trace.map_err(|source| Fault::Open { name: name.clone(), source })?;
    let mut reader = Events::observed(name.as_str(), trace)?;
    let mut is_annotated = !reader.header_annotations().is_empty();
    output.write(|out| {
        let mut writer: Box<dyn TraceViewer> = if args.viewer.mcap {
            Box::new(McapWriter::new(out, reader.header()).map_err(Fault::Output)?)
        } else {
            Box::new(Tracks::new(out, reader.header()).map_err(Fault::Output)?)
        };
        while let Some(event) = reader.next_event()? {
            writer.event(&event).map_err(Fault::Output)?;
            is_annotated |= !reader.annotations().is_empty();
        }
        writer.finish().map_err(Fault::Output)
    })?;
    if is_annotated {
        const LEFT_OUT: &str = "of, try, within, age, origin, seq, max_age and local are left out";
        complain(format_args!("note: {name}: {LEFT_OUT}; the viewer's file has no place for them"));
    }
    Ok(Exit::Conforms)
}
