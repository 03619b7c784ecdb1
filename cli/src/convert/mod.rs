//! `fuseline convert`: makes a trace of what other tools recorded. Sources give rows, a mapping
//! makes events of them, and the log puts them in order; nothing is judged.

mod db3;
mod entry;
mod explain;
mod files;
mod frame;
mod header;
mod json;
mod key;
mod log;
mod mapping;
mod notes;
mod otlp;
mod payload;
mod reading;
mod restart;
mod role;
mod row;
mod spans;
mod table;
mod time;
mod topics;
mod writing;

use std::io;
use std::path::{Path, PathBuf};

use fuseline_traces::packed::TOPIC;
use thiserror::Error;

use crate::convert::explain::explain;
use crate::convert::files::{Format, LogFile};
use crate::convert::frame::FrameColumn;
use crate::convert::notes::Notes;
use crate::convert::reading::{Understood, read};
use crate::convert::role::SpanOptions;
use crate::convert::row::Problem;
use crate::convert::time::Unit;
use crate::convert::topics::{TopicChoice, topic};
use crate::convert::writing::{
    RecordedTrace, no_header, put_header, read_header, write_recording, write_runs,
};
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::is_standard;
use crate::output::{Output, Overwrite, refuse_onto_stdout};

#[derive(clap::Args)]
#[command(after_help = "\
--explain shows what was understood of a log, and the commands that convert and judge it. Look at it first.

A CSV file names its columns in its first row, and each further row is an event; JSON lines have an object for each
event. The columns at, ev, t, p, due, deadline and backlog are read by these names; --column gives one another name,
such as at=header.stamp for a key within an object. The keys of, try, within, age, origin, seq and why are read only
if --column names them. A deadline or within may be a time for all, such as deadline=500ms, and p a source for all.
p is a source's priority, or its name in the header. An instant is a number or a time of day such as
2026-11-25T18:00:00.5Z; a duration is a number; either may have its unit, as 5ms. Ids that are texts are numbered.

With --frame each row or object is a frame. The frame has open, t, within, emit, by and miss. Each source has request,
deadline, result, fail and of, as in WEST.result=COLUMN. An empty cell is an event that did not happen.

A recording is MCAP, a database of rosbag2 (.db3), or a bag's folder. Its messages are JSON, CDR of ROS 2 by the
definitions inside, or Protobuf by the descriptors inside. --topic names the topics and their events. Without at,
events have their log times. A topic of JSON without --column or --event has the lines of a trace; the first may be
the header.

An OTLP JSON file has OpenTelemetry's spans. A message's span is its open and, at its end, its emit, or its miss if
its status is an error. Each client span below it is a request to the source that it names, and a result or a failure
at its end. A call that was cancelled or ran out of time (codes 1 and 4 of gRPC, or --cancelled) has no end. Several
client spans of one source are attempts, and so is a span that is linked to another one. Without the attribute by, an
output counts as the result that came last.

convert counts on standard error whatever it guesses, changes or skips. Packed files (gzip, zstd) are unpacked, and
text may be UTF-16. A log is held in memory until its trace is written, about 0.5 GB for each million events.

The header is the trace's first line: it has the clouds and the commit rule. --write-header makes one.

Examples:
  fuseline convert --explain events.csv --column at=stamp_ms --unit ms
  fuseline convert --write-header events.csv -o header.jsonl
  fuseline convert --header header.jsonl --column at=stamp_ms --unit ms events.csv -o trace.jsonl
  fuseline convert --header header.jsonl --event response=result,send=request,heartbeat= events.csv
  fuseline convert --header header.jsonl --unit s --unit deadline=ms log.jsonl \\
    --column at=header.stamp,ev=kind
  fuseline convert --header header.jsonl --unit ms --separator ';' frames.csv --frame \\
    open=recv,emit=out,by=winner,local.result=own \\
    --frame west.request=sent,west.deadline=500,west.result=done
  fuseline convert --header header.jsonl bag.mcap \\
    --column t=header.stamp,p=source,deadline=200ms --topic open=/camera,emit=/objects \\
    --topic west.request=/west/image,west.result=/west/objects,local.result=/own/objects
  fuseline convert --header header.jsonl --span message=decide,local=plan --deadline 40ms spans.json
  fuseline convert drive.mcap | fuseline check --observed --tolerance 2ms --lateness 5ms")]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub(crate) struct Args {
    /// The file to convert, the parts of a log in order, or the folder of a bag; - is standard
    /// input.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// The format; by default the file's name decides.
    #[arg(long, value_name = "FORMAT")]
    from: Option<Format>,
    /// A file whose first line is the trace's header.
    #[arg(long, value_name = "FILE")]
    header: Option<PathBuf>,
    /// Make the header instead of the trace. It has the sources in the file, and asks on standard
    /// input for everything that cannot be guessed.
    #[arg(long, conflicts_with_all = ["header", "sort", "split"])]
    write_header: bool,
    /// Show what convert understands of the log, and convert nothing; needs no header.
    #[arg(long, conflicts_with_all = ["write_header", "output", "split"])]
    explain: bool,
    /// The column that has a key of the trace, such as at=stamp.
    #[arg(long, value_name = "KEY=NAME", value_delimiter = ',', value_parser = key::column)]
    column: Vec<(&'static str, String)>,
    /// The file's name for an event, such as response=result; heartbeat= skips these events.
    #[arg(long, value_name = "NAME=EV", value_delimiter = ',', value_parser = key::event)]
    event: Vec<(String, &'static str)>,
    /// The column of an event in rows or objects that have one frame each, such as open=recv or
    /// west.result=done.
    #[arg(long, value_name = "[SOURCE.]EVENT=COLUMN", value_delimiter = ',', value_parser = frame::frame_column,
        conflicts_with_all = ["column", "event"])]
    frame: Vec<FrameColumn>,
    /// The unit of instants and durations, or of one key's, such as deadline=ms; decimals are read
    /// exactly [default: ns] [possible units: ns, us, ms, s].
    #[arg(long, value_name = "[KEY=]UNIT", value_delimiter = ',', value_parser = key::unit)]
    unit: Vec<(Option<&'static str>, Unit)>,
    /// The separator of the cells of a CSV file: a character, or tab.
    #[arg(long, value_name = "CHARACTER", default_value = ",", value_parser = separator)]
    separator: u8,
    /// A topic of a recording, with the events that its messages are: open=/camera,
    /// west.result=/west/objects.
    #[arg(long, value_name = "[[SOURCE.]EVENT=]TOPIC", value_delimiter = ',', value_parser = topic,
        default_value = TOPIC)]
    topic: Vec<TopicChoice>,
    /// The log's name for local, if it is neither local nor 0.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    local: Vec<String>,
    /// The deadline of requests that state none, such as 40ms, or west=40ms for one source.
    #[arg(long, value_name = "[SOURCE=]TIME", value_delimiter = ',', value_parser = key::deadline)]
    deadline: Vec<(Option<String>, u64)>,
    /// Texts that mean no value, besides empty cells and null: NaN, None, -1.
    #[arg(long, value_name = "TEXT", value_delimiter = ',', allow_hyphen_values = true)]
    missing: Vec<String>,
    /// Skip rows, or messages of spans, that cannot be read, and count them.
    #[arg(long)]
    skip_bad: bool,
    /// Skip events that repeat an earlier one in every value, and count them.
    #[arg(long)]
    unique: bool,
    /// Read a file that was cut off up to its last whole row.
    #[arg(long)]
    truncated: bool,
    /// Sort the events by their instants, as for a log made of several files. Without this option
    /// convert sorts them too, but notes that it did.
    #[arg(long)]
    sort: bool,
    /// Begin another trace where the log restarts: OUTPUT-1, OUTPUT-2 and so on.
    #[arg(long)]
    split: bool,
    /// The file for the trace; standard output without it, or for -.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    spans: SpanOptions,
}

/// Options that do not go together.
#[derive(Debug, Error)]
enum OptionError {
    #[error("--frame is for rows of CSV and JSON; give --column for others")]
    Frames,
    #[error(
        "--topic was given several times; give each topic its event, such as --topic open=/camera, \
         or name the keys that say it with --column"
    )]
    Topics,
    #[error(
        "several recordings of trace lines cannot be read at once; convert one at a time, or read \
         the parts of one recording with --column"
    )]
    Recordings,
    #[error(
        "--write-header asks its questions on standard input, so the log cannot come from there; \
         name a file"
    )]
    Asking,
    #[error("--split writes a file for each run; name one with -o, such as -o trace.jsonl")]
    Split,
}

impl From<OptionError> for Fault {
    fn from(error: OptionError) -> Self {
        Self::own(error)
    }
}

impl Args {
    /// Returns the files of the log.
    fn log_files(&self, notes: &mut Notes) -> Result<Vec<LogFile>, Fault> {
        let files = files::files(&self.files, self.from, notes)?;
        let is_rows = |file: &LogFile| matches!(file.format, Format::Csv | Format::Jsonl);
        if !self.frame.is_empty() && !files.iter().all(is_rows) {
            return Err(OptionError::Frames.into());
        }
        let mut databases = files.iter().filter(|file| file.format == Format::Db3);
        if let Some(file) = databases.find(|file| is_standard(&file.path)) {
            let message = "a database of rosbag2 cannot come from standard input; name its file";
            return Err(Problem::of_file(&file.name, message).into());
        }
        Ok(files)
    }

    /// Returns `true` if a recording has the lines of a trace.
    fn is_trace_in_mcap(&self, files: &[LogFile]) -> bool {
        self.column.is_empty()
            && self.event.is_empty()
            && self.topic.iter().all(|topic| topic.event.is_none())
            && files.iter().any(|file| file.format == Format::Mcap)
    }
}

/// Converts a log; a named output is written only once all of the input was read.
pub(crate) fn convert(args: &Args) -> Result<Exit, Fault> {
    let mut inputs: Vec<&Path> = args.files.iter().map(|path| &**path).collect();
    inputs.extend(args.header.as_deref());
    let named = args.output.as_deref().filter(|path| !is_standard(path));
    if args.split && named.is_none() {
        return Err(OptionError::Split.into());
    }
    let output = named.filter(|_| !args.split);
    let output = output.map(|path| Output::new(path, &inputs, args.overwrite)).transpose()?;
    if named.is_none() {
        refuse_onto_stdout(&inputs)?;
    }
    if args.write_header && args.files.iter().any(|path| is_standard(path)) {
        return Err(OptionError::Asking.into());
    }
    let given = args.header.as_deref().map(read_header).transpose()?;
    let mut notes = Notes::default();
    let files = args.log_files(&mut notes)?;
    let is_recording = args.is_trace_in_mcap(&files);
    if is_recording && (args.write_header || args.explain) {
        // A recording without a line of a trace is another log, of which nothing was named yet.
        let recorded = RecordedTrace::open(args, &files[0], &args.topic[0].name)?.header();
        if let Ok(Some(_)) = recorded {
            let message = if args.explain {
                "it is a trace already; judge it with `fuseline check`"
            } else {
                "it has a header already; convert it without --write-header"
            };
            return Err(Problem::of_file(&files[0].name, message).into());
        }
    } else if is_recording {
        return write_recording(args, &files, given, output.as_ref());
    }
    let header = given.as_ref().map(|(header, _)| header);
    if args.explain {
        let understood = read(args, &files, header, notes)?;
        return explain(args, &files[0].name, understood, given.is_some());
    }
    if args.write_header {
        let Understood { sources, notes, .. } = read(args, &files, None, notes)?;
        notes.print();
        let header = header::ask(sources.found(), &mut io::stdin().lock(), &mut io::stderr())?;
        return put_header(output.as_ref(), header);
    }
    let header = given.ok_or_else(|| no_header(&files[0]))?;
    write_runs(args, &files, &header, notes, output.as_ref(), &inputs)
}

fn separator(text: &str) -> Result<u8, &'static str> {
    match text.as_bytes() {
        [byte] if byte.is_ascii() && !matches!(byte, b'"' | b'\n' | b'\r') => Ok(*byte),
        _ if text == "tab" => Ok(b'\t'),
        _ => Err("it must be one ASCII character, or tab"),
    }
}
