//! `fuseline frame`: one frame's life across the operators of a vehicle, and where its time went.

mod life;

use std::collections::BTreeMap;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

use fuseline_traces::Events;
use fuseline_traces::packed::unpack_beside;

use crate::complain::complain;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::frame::life::{FrameId, FrameLife, FrameStage, MessageSearch};
use crate::input::open;
use crate::progress::watched;

#[derive(clap::Args)]
#[command(after_help = "\
A frame is a message of a sensor: its seq, and the stream that it counts in. Each operator's messages
of it are found by the origin in their traces; their ages say when each took it in and answered it.
Between two operators is what the streams and joins there took. fuseline report draws it.

Examples:
  fuseline frame run/*.jsonl
  fuseline frame --seq 120 --stream left-camera run/*.jsonl")]
pub(crate) struct Args {
    /// The traces of one vehicle's operators, plain or packed, in any order.
    #[arg(value_name = "TRACE", required = true)]
    traces: Vec<PathBuf>,
    /// The frame's timestamp in its stream; without it, the frame that most operators missed, and of several the oldest at its
    /// last answer.
    #[arg(long, value_name = "N")]
    seq: Option<u64>,
    /// Its stream; needed where several have this timestamp.
    #[arg(long, value_name = "NAME")]
    stream: Option<String>,
}

/// Why a frame has no life to show.
#[derive(Debug, thiserror::Error)]
enum FrameError {
    #[error(
        "no trace has a message of {0} with an age; give the traces of operators that it went through"
    )]
    Unknown(String),
    #[error("seq {seq} is in several streams; give --stream with one of {streams}")]
    Ambiguous { seq: u64, streams: String },
}

/// The operators' messages of each frame.
type FrameStages = BTreeMap<FrameId, Vec<FrameStage>>;

/// Prints the frame's life.
pub(crate) fn follow(args: &Args) -> Result<Exit, Fault> {
    let mut stages = FrameStages::new();
    for path in &args.traces {
        read(args, path, &mut stages)?;
    }
    let life = life_of(args, stages)?;
    let mut out = anstream::stdout();
    write!(out, "{life}").and_then(|()| out.flush()).map_err(Fault::Output)?;
    Ok(Exit::Conforms)
}

/// Finds frames' messages in one trace.
fn read(args: &Args, path: &Path, stages: &mut FrameStages) -> Result<(), Fault> {
    let (name, file) = open(path)?;
    let trace = unpack_beside(BufReader::new(watched(path, &name, file)))
        .map_err(|source| Fault::Open { name: name.clone(), source })?;
    let mut reader = Events::observed(name.as_str(), trace)?;
    let mut search = MessageSearch::new(args.seq, args.stream.as_deref(), reader.header(), &name);
    while let Some(event) = reader.next_event()? {
        search.event(&event, reader.annotations());
    }
    if search.without_age > 0 {
        let count = search.without_age;
        complain(format_args!("note: {name}: {count} messages of {} have no age", wanted(args)));
    }
    for (frame, stage) in search.finish() {
        stages.entry(frame).or_default().push(stage);
    }
    Ok(())
}

fn life_of(args: &Args, stages: FrameStages) -> Result<FrameLife, FrameError> {
    if let Some(seq) = args.seq
        && stages.len() > 1
    {
        let streams: Vec<&str> = stages.keys().map(|(stream, _)| &**stream).collect();
        return Err(FrameError::Ambiguous { seq, streams: streams.join(", ") });
    }
    let lives = stages.into_iter().map(|(frame, stages)| FrameLife::new(frame, stages));
    let worst = lives.max_by_key(|life| (life.unanswered(), life.age()));
    worst.ok_or_else(|| FrameError::Unknown(wanted(args)))
}

/// What is looked for, in words.
fn wanted(args: &Args) -> String {
    match (args.seq, &args.stream) {
        (Some(seq), Some(stream)) => format!("{stream} {seq}"),
        (Some(seq), None) => format!("seq {seq}"),
        (None, Some(stream)) => stream.clone(),
        (None, None) => "a sensor".to_owned(),
    }
}

impl From<FrameError> for Fault {
    fn from(error: FrameError) -> Self {
        Self::own(error)
    }
}
