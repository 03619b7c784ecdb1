//! `fuseline export`: converts a trace for other tools' viewers.

mod frames;
mod mcap;
mod otlp;
mod perfetto;
mod viewer;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use fuseline_traces::packed::unpack_beside;
use fuseline_traces::{Annotations, Event, Events};

use crate::diagnostics::print_line;
use crate::exit::Exit;
use crate::export::frames::Frames;
use crate::export::mcap::McapWriter;
use crate::export::otlp::SpanWriter;
use crate::export::perfetto::Tracks;
use crate::export::viewer::TraceViewer;
use crate::fault::Fault;
use crate::input::{is_standard, name, open};
use crate::output::{Output, Overwrite};
use crate::part::PartOptions;
use crate::progress::watched;

#[derive(clap::Args)]
#[command(after_help = "\
Perfetto: a JSON trace for ui.perfetto.dev with a track for local and for each cloud, or several if calls
overlap. A call is a slice from its admission to its end, named by its timestamp and its end. Another
track has what was forwarded or missed. Several traces become several processes: arrows lead a frame from
operator to operator by the origin and seq of its messages. The messages' ages show how far the operators'
clocks are apart. Outputs have their ages.
MCAP: for Foxglove. The topic /fuseline/trace has each line as a JSON message, the header first, and
/fuseline/outputs has what was forwarded or missed. `fuseline convert` reads it back.
OTLP: OpenTelemetry's spans as JSON. Each message is a span, with a span below it for local and for each
request. `fuseline convert` reads their attributes back. Frames of one origin and seq are one trace.

Examples:
  fuseline export --perfetto trace.jsonl -o trace.perfetto.json
  fuseline export --perfetto detector.jsonl tracker.jsonl -o frames.perfetto.json
  fuseline export --perfetto trace.jsonl --from 10m --to 12m -o minutes.perfetto.json
  fuseline export --mcap trace.jsonl -o trace.mcap
  fuseline export --otlp trace.jsonl -o spans.json")]
#[group(skip)]
pub(crate) struct Args {
    /// The traces, several only for Perfetto; standard input if there are none, or for -.
    #[arg(value_name = "FILE", default_value = "-")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    viewer: Viewer,
    #[command(flatten)]
    part: PartOptions,
    /// The file to write, which appears once it is complete; - is standard output.
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
    /// For programs that read OpenTelemetry's spans, such as Jaeger.
    #[arg(long)]
    otlp: bool,
}

/// The reason why several traces cannot be exported.
#[derive(Debug, thiserror::Error)]
enum SeveralTraces {
    #[error("MCAP and OTLP take one trace; export each to a file of its own")]
    TakesOne,
    #[error(
        "several traces cannot come from standard input, because each is read twice; give files"
    )]
    Standard,
}

/// Writes the traces for the viewer.
pub(crate) fn export(args: &Args) -> Result<Exit, Fault> {
    let inputs: Vec<&Path> = args.files.iter().map(PathBuf::as_path).collect();
    args.part.part()?;
    let output = Output::new(&args.output, &inputs, args.overwrite)?;
    let mut frames = Frames::new(inputs.len());
    if inputs.len() > 1 {
        if args.viewer.mcap || args.viewer.otlp {
            return Err(Fault::own(SeveralTraces::TakesOne));
        }
        if inputs.iter().any(|path| is_standard(path)) {
            return Err(Fault::own(SeveralTraces::Standard));
        }
        for (trace, path) in inputs.iter().enumerate() {
            let mut reader = reader(path)?;
            while let Some(event) = reader.next_event()? {
                frames.event(trace, &event, reader.annotations());
            }
        }
        frames.align();
    }
    let (mut left_out, mut lost) = (Vec::new(), Vec::new());
    output.write(|mut out| {
        if args.viewer.mcap {
            let mut reader = reader(inputs[0])?;
            let writer = McapWriter::new(out, reader.header(), reader.header_annotations());
            write(Box::new(writer.map_err(Fault::Output)?), &mut reader, args.part.filter()?)?;
            return Ok(());
        }
        if args.viewer.otlp {
            let mut reader = reader(inputs[0])?;
            let writer = SpanWriter::new(&mut out, reader.header()).map_err(Fault::Output)?;
            lost = write(Box::new(writer), &mut reader, args.part.filter()?)?.lost;
            return Ok(());
        }
        perfetto::begin(&mut out).map_err(Fault::Output)?;
        for (trace, path) in inputs.iter().enumerate() {
            let mut reader = reader(path)?;
            let tracks = Tracks::new(&mut out, reader.header(), frames.of(trace));
            let tracks = Box::new(tracks.map_err(Fault::Output)?);
            if write(tracks, &mut reader, args.part.filter()?)?.has_keys {
                left_out.push(name(path));
            }
        }
        perfetto::end(&mut out).map_err(Fault::Output)
    })?;
    if !lost.is_empty() {
        let (name, lost) = (name(inputs[0]), lost.join(", "));
        print_line(format_args!(
            "note: {name}: omitted, because spans cannot express them: {lost}; a trace made of these spans may get another verdict"
        ));
    }
    for name in left_out {
        const LEFT_OUT: &str = "of, try, within, max_age and local are omitted";
        print_line(format_args!(
            "note: {name}: {LEFT_OUT}; the viewer's file has no place for them"
        ));
    }
    Ok(Exit::Conforms)
}

fn reader(path: &Path) -> Result<Events<impl BufRead + use<>>, Fault> {
    let (name, file) = open(path)?;
    let trace = unpack_beside(BufReader::new(watched(path, &name, file)));
    let trace = trace.map_err(|source| Fault::Open { name: name.clone(), source })?;
    Ok(Events::observed(name.as_str(), trace)?)
}

/// The keys that an export omits.
struct LeftOut {
    /// `true` if the trace has keys for which Perfetto's file has no place.
    has_keys: bool,
    /// The keys that the format cannot express.
    lost: Vec<String>,
}

/// Writes one trace.
fn write(
    mut writer: Box<dyn TraceViewer + '_>,
    reader: &mut Events<impl BufRead>,
    mut takes: impl FnMut(&Event) -> bool,
) -> Result<LeftOut, Fault> {
    let mut has_keys = !reader.header_annotations().is_empty();
    while let Some(event) = reader.next_event()? {
        if !takes(&event) {
            continue;
        }
        let annotations = reader.annotations();
        writer.event(&event, annotations).map_err(Fault::Output)?;
        let Annotations { attempt, within, .. } = annotations;
        has_keys |= !annotations.value().is_empty() || attempt.is_some() || within.is_some();
    }
    let lost = writer.left_out();
    writer.finish().map_err(Fault::Output)?;
    Ok(LeftOut { has_keys, lost })
}
