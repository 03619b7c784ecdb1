//! `fuseline frame`: one frame's life across the operators of a vehicle, and where its time went.

mod life;
mod page;

use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

use fuseline_traces::Events;
use fuseline_traces::packed::unpack;

use crate::complain::complain;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::frame::life::{FrameLife, FrameStage, MessageSearch};
use crate::input::open;
use crate::output::{Output, Overwrite};
use crate::progress::watched;

#[derive(clap::Args)]
#[command(after_help = "\
A frame is a message of a sensor: its seq, and the stream that it counts in. Each operator's messages
of it are found by the origin in their traces; their ages say when each took it in and answered it.
Between two operators is what the streams and joins there took.

Examples:
  fuseline frame --seq 120 run/*.jsonl
  fuseline frame --seq 120 --stream left-camera run/*.jsonl -o frame.html")]
pub(crate) struct Args {
    /// The traces of one vehicle's operators, plain or packed, in any order.
    #[arg(value_name = "TRACE", required = true)]
    traces: Vec<PathBuf>,
    /// The frame's timestamp in its stream.
    #[arg(long, value_name = "N")]
    seq: u64,
    /// Its stream; needed where several have this timestamp.
    #[arg(long, value_name = "NAME")]
    stream: Option<String>,
    /// Draw it on a page too; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Why a frame has no life to show.
#[derive(Debug, thiserror::Error)]
enum FrameError {
    #[error(
        "no trace has a message of seq {seq} with an age; give the traces of operators that it went through"
    )]
    Unknown { seq: u64 },
    #[error("seq {seq} is in several streams; give --stream with one of {streams}")]
    Ambiguous { seq: u64, streams: String },
}

/// Prints the frame's life, and draws it.
pub(crate) fn follow(args: &Args) -> Result<Exit, Fault> {
    let inputs: Vec<&Path> = args.traces.iter().map(PathBuf::as_path).collect();
    let output = args.output.as_deref().map(|path| Output::new(path, &inputs, args.overwrite));
    let output = output.transpose()?;
    let mut stages = Vec::new();
    for path in inputs {
        read(args, path, &mut stages)?;
    }
    let life = life_of(args, stages)?;
    if let Some(output) = &output {
        output.write(|out| page::write(out, &life).map_err(Fault::Output))?;
    }
    if output.as_ref().is_none_or(|output| !output.is_stdout()) {
        let mut out = anstream::stdout();
        write!(out, "{life}").and_then(|()| out.flush()).map_err(Fault::Output)?;
    }
    Ok(Exit::Conforms)
}

/// Finds the frame's messages in one trace.
fn read(args: &Args, path: &Path, stages: &mut Vec<FrameStage>) -> Result<(), Fault> {
    let (name, file) = open(path)?;
    let trace = unpack(BufReader::new(watched(path, &name, file)))
        .map_err(|source| Fault::Open { name: name.clone(), source })?;
    let mut reader = Events::observed(name.as_str(), trace)?;
    let mut search = MessageSearch::new(args.seq, args.stream.as_deref(), reader.header(), &name);
    while let Some(event) = reader.next_event()? {
        search.event(&event, reader.annotations());
    }
    if search.without_age > 0 {
        let count = search.without_age;
        complain(format_args!("note: {name}: {count} messages of seq {} have no age", args.seq));
    }
    stages.append(&mut search.finish());
    Ok(())
}

fn life_of(args: &Args, stages: Vec<FrameStage>) -> Result<FrameLife, FrameError> {
    let seq = args.seq;
    let mut streams: Vec<&str> = stages.iter().map(|stage| &*stage.stream).collect();
    streams.sort_unstable();
    streams.dedup();
    match &streams[..] {
        [] => Err(FrameError::Unknown { seq }),
        [stream] => Ok(FrameLife::new((*stream).to_owned(), seq, stages)),
        _ => Err(FrameError::Ambiguous { seq, streams: streams.join(", ") }),
    }
}

impl From<FrameError> for Fault {
    fn from(error: FrameError) -> Self {
        Self::own(error)
    }
}
