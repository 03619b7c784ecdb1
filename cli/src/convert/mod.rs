//! `fuseline convert`: makes a trace of what other tools recorded. `rows`, `mcap`, `topics` and `spans` read it; nothing
//! is judged.

#[cfg(feature = "bags")]
mod db3;
mod header;
mod mcap;
mod otlp;
mod payload;
mod recorded;
mod rows;
mod spans;
mod topic;
mod topics;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use fuseline_traces::packed::{RawMessages, TOPIC};
use fuseline_traces::rows::{self as table, Columns, FrameColumn, Unit};
use fuseline_traces::{Decision, Event, Events, Header, Input};

use crate::convert::recorded::{AnnotatedHeader, ConvertError, Recorded};
use crate::convert::rows::MappedRows;
use crate::convert::spans::{SpanEvents, SpanOptions, SpanSources};
use crate::convert::topic::{TopicChoice, topic};
use crate::convert::topics::{MessageFile, TopicInput};
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::{is_standard, open};
use crate::output::{Output, Overwrite, refuse_onto_stdout};

#[derive(clap::Args)]
#[command(after_help = "\
A CSV file has a row an event and names its columns in its first row; JSON lines have an object an event. The
columns or keys at, ev, t, p, due, deadline, backlog, why, of, try, within, age, origin and seq are read, those
that an event has; --column gives one another name, within objects as header.stamp, or a deadline for all requests
as deadline=500ms. p is a source's priority, or its name in the header. An instant is a number or a time of day such
as 2026-11-25T18:00:00.5Z; a duration is a number; either may have its unit, as 5ms.

With --frame a CSV file has a row a frame: the columns open, t, emit, by and miss of the frame, and request,
deadline, result and fail of each source, as WEST.result=COLUMN. An empty cell is an event that did not happen.

A recording is MCAP or a database of rosbag2 (.db3). Its messages are JSON, CDR of ROS 2 by the definitions inside,
or Protobuf by the descriptors inside; databases and Protobuf are read if fuseline was built with --features bags.
--topic says which topics have events, and which, where the messages do not say so. Without at they have their log
times. A topic of JSON without --column or --event has the lines of a trace; the first may be the header.

An OTLP JSON file has OpenTelemetry's spans. A message's span is its open and, at its end, its emit, or its miss where
its status is an error; each client span below it is a request to the source that it names, and a result or a failure at
its end, but for one cancelled or out of time (gRPC's codes 1 and 4), which ends with nothing. Several client spans of one
source are attempts, also one that is linked to another. Timestamps are the attribute's if all messages have numbers, else
ordinals; without the attribute by an emit is of the result that came last.

The header is the trace's first line: it has the clouds and the commit rule. --write-header makes one.

Examples:
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
pub(crate) struct Args {
    /// The file to convert; - is standard input.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The format; by default the file's name decides.
    #[arg(long, value_name = "FORMAT")]
    from: Option<Format>,
    /// A file whose first line is the trace's header.
    #[arg(long, value_name = "FILE")]
    header: Option<PathBuf>,
    /// Make the header instead of the trace: the sources are those in the file; what cannot be guessed is
    /// read from standard input.
    #[arg(long, conflicts_with_all = ["header", "sort"])]
    write_header: bool,
    /// Where a key of the trace stands, such as at=stamp.
    #[arg(long, value_name = "KEY=NAME", value_delimiter = ',', value_parser = table::column)]
    column: Vec<(&'static str, String)>,
    /// What the file calls an event, such as response=result; heartbeat= leaves those events out.
    #[arg(long, value_name = "NAME=EV", value_delimiter = ',', value_parser = table::event)]
    event: Vec<(String, &'static str)>,
    /// Where the events of a frame stand in a CSV file with a row a frame, such as open=recv or west.result=done.
    #[arg(long, value_name = "[SOURCE.]EVENT=COLUMN", value_delimiter = ',', value_parser = table::frame_column,
        conflicts_with_all = ["column", "event"])]
    frame: Vec<FrameColumn>,
    /// The unit of instants and durations, or of one key's, such as deadline=ms; decimals are read exactly
    /// [default: ns] [possible units: ns, us, ms, s].
    #[arg(long, value_name = "[KEY=]UNIT", value_delimiter = ',', value_parser = table::unit)]
    unit: Vec<(Option<&'static str>, Unit)>,
    /// What stands between the cells of a CSV file: a character, or tab.
    #[arg(long, value_name = "CHARACTER", default_value = ",", value_parser = separator)]
    separator: u8,
    /// A topic of a recording, or what its messages are: open=/camera, west.result=/west/objects.
    #[arg(long, value_name = "[[SOURCE.]EVENT=]TOPIC", value_delimiter = ',', value_parser = topic,
        default_value = TOPIC)]
    topic: Vec<TopicChoice>,
    /// Put the events in the order of their instants, holding all of them; always so with --frame.
    #[arg(long)]
    sort: bool,
    /// The trace; without it, or with -, standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    spans: SpanOptions,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    Csv,
    /// A JSON object a line.
    Jsonl,
    Mcap,
    /// A database of rosbag2.
    Db3,
    /// OpenTelemetry's spans as JSON.
    Otlp,
}

/// Converts a file; a named output is written only once all of the input was read.
pub(crate) fn convert(args: &Args) -> Result<Exit, Fault> {
    let name = args.file.display().to_string();
    if args.file.is_dir() {
        return Err(ConvertError::Folder { file: name }.into());
    }
    let format = args.from.or_else(|| format_of(&args.file));
    let format = format.ok_or(ConvertError::Format { file: name })?;
    if !args.frame.is_empty() && format != Format::Csv {
        return Err(ConvertError::Frames.into());
    }
    let inputs: Vec<&Path> =
        [Some(&*args.file), args.header.as_deref()].into_iter().flatten().collect();
    let named = args.output.as_deref().filter(|path| !is_standard(path));
    let output = named.map(|path| Output::new(path, &inputs, args.overwrite)).transpose()?;
    if output.is_none() {
        refuse_onto_stdout(&inputs)?;
    }
    if args.write_header {
        let header = made_header(args, format)?;
        return put(output.as_ref(), &|out| {
            let mut line = Vec::new();
            header.write(&mut line);
            line.push(b'\n');
            out.write_all(&line).and_then(|()| out.flush()).map_err(Fault::Output)
        });
    }
    let given = args.header.as_deref().map(read_header).transpose()?;
    let (name, file) = open(&args.file)?;
    let known: BTreeMap<String, u64> =
        given.iter().flat_map(|(header, _)| sources(header)).collect();
    let columns = args.columns().with_sources(known.clone());
    let mut recorded = args.recorded(format, &name, file, columns, SpanSources::Known(known))?;
    let own = recorded.header()?;
    let header = given.or(own).ok_or_else(|| ConvertError::NoHeader { file: name.clone() })?;
    let is_sorted = args.sort || !args.frame.is_empty();
    let recorded = RefCell::new(recorded);
    put(output.as_ref(), &|out| write(out, &header, &mut **recorded.borrow_mut(), is_sorted))
}

impl Args {
    fn columns(&self) -> Columns<'_> {
        let whole = self.unit.iter().rev().find(|(key, _)| key.is_none());
        let unit = whole.map_or(Unit::Ns, |(_, unit)| *unit);
        let units = self.unit.iter().filter_map(|(key, unit)| Some(((*key)?, *unit)));
        Columns::new(&self.column, &self.event, unit).with_units(units)
    }

    fn recorded<'a>(
        &'a self,
        format: Format,
        name: &'a str,
        file: Box<dyn Read>,
        columns: Columns<'a>,
        sources: SpanSources,
    ) -> Result<Box<dyn Recorded + 'a>, Fault> {
        let mut file = BufReader::new(file);
        // A name in .json may be either's.
        let is_export = format == Format::Jsonl
            && self.from.is_none()
            && otlp::is_export(file.fill_buf().map_err(|error| ConvertError::read(name, &error))?);
        let format = if is_export { Format::Otlp } else { format };
        let is_mapped = !self.column.is_empty()
            || !self.event.is_empty()
            || self.topic.iter().any(|topic| topic.event.is_some());
        Ok(match format {
            Format::Csv if self.frame.is_empty() => {
                Box::new(MappedRows::events(name, file, self.separator, columns)?)
            }
            Format::Csv => {
                Box::new(MappedRows::frames(name, file, self.separator, &self.frame, columns)?)
            }
            Format::Jsonl => Box::new(MappedRows::json(name, file, columns)),
            Format::Mcap if is_mapped => {
                let names = self.topic.iter().map(|topic| &*topic.name).collect();
                let messages = MessageFile::Mcap(Box::new(RawMessages::new(file, names)));
                Box::new(TopicInput::new(name, messages, &self.topic, &columns))
            }
            Format::Mcap => match &self.topic[..] {
                [topic] => Box::new(mcap::McapInput::new(name, file, &topic.name)),
                _ => return Err(ConvertError::Topics.into()),
            },
            #[cfg(feature = "bags")]
            Format::Db3 => self.database(name, &columns)?,
            #[cfg(not(feature = "bags"))]
            Format::Db3 => return Err(ConvertError::NoBags { file: name.to_owned() }.into()),
            Format::Otlp => {
                Box::new(SpanEvents::new(name, &otlp::read(name, file)?, &self.spans, sources)?)
            }
        })
    }

    /// `SQLite` reads the file by its name.
    #[cfg(feature = "bags")]
    fn database<'a>(
        &'a self,
        name: &'a str,
        columns: &Columns<'a>,
    ) -> Result<Box<dyn Recorded + 'a>, Fault> {
        let file = name.to_owned();
        if is_standard(&self.file) {
            return Err(ConvertError::Database { file }.into());
        }
        let names: Vec<&str> = self.topic.iter().map(|topic| &*topic.name).collect();
        let messages = db3::Db3Messages::open(&self.file, &names)
            .map_err(|error| ConvertError::File { file, message: error.to_string() })?;
        let messages = MessageFile::Db3(messages);
        Ok(Box::new(TopicInput::new(name, messages, &self.topic, columns)))
    }
}

/// Writes to the output, or to standard output if there is none.
fn put(
    output: Option<&Output>,
    write: &dyn Fn(&mut dyn Write) -> Result<(), Fault>,
) -> Result<Exit, Fault> {
    match output {
        Some(output) => output.write(|out| write(out))?,
        None => write(&mut BufWriter::new(io::stdout().lock()))?,
    }
    Ok(Exit::Conforms)
}

fn read_header(path: &Path) -> Result<AnnotatedHeader, Fault> {
    let (name, file) = open(path)?;
    let events = Events::observed(name, BufReader::new(file))?;
    Ok((events.header().clone(), events.header_annotations().clone()))
}

/// The sources that a header names, with their priorities.
fn sources(header: &Header) -> impl Iterator<Item = (String, u64)> {
    let clouds = header.clouds.iter();
    let named = clouds.filter_map(|cloud| Some((cloud.name.clone()?, u64::from(cloud.p))));
    [("local".to_owned(), 0)].into_iter().chain(named)
}

/// The header for a file, from its sources and what is asked.
fn made_header(args: &Args, format: Format) -> Result<Header, Fault> {
    if is_standard(&args.file) {
        return Err(ConvertError::Asking.into());
    }
    let (name, file) = open(&args.file)?;
    let sources = Rc::new(RefCell::new(Vec::new()));
    let columns = args.columns().gathering(Rc::clone(&sources));
    let gathered = SpanSources::Gathered(Rc::clone(&sources));
    let mut recorded = args.recorded(format, &name, file, columns, gathered)?;
    if recorded.header()?.is_some() {
        return Err(ConvertError::HasHeader { file: name.clone() }.into());
    }
    while recorded.next_event()?.is_some() {}
    let sources = sources.borrow().clone();
    header::ask(&sources, &mut io::stdin().lock(), &mut io::stderr())
}

fn separator(text: &str) -> Result<u8, &'static str> {
    match text.as_bytes() {
        [byte] if byte.is_ascii() && !matches!(byte, b'"' | b'\n' | b'\r') => Ok(*byte),
        _ if text == "tab" => Ok(b'\t'),
        _ => Err("it must be one ASCII character, or tab"),
    }
}

fn format_of(path: &Path) -> Option<Format> {
    match path.extension()?.to_str()? {
        "csv" | "tsv" => Some(Format::Csv),
        "jsonl" | "ndjson" | "json" => Some(Format::Jsonl),
        "mcap" => Some(Format::Mcap),
        "db3" => Some(Format::Db3),
        _ => None,
    }
}

fn write(
    out: &mut dyn Write,
    (header, annotations): &AnnotatedHeader,
    recorded: &mut dyn Recorded,
    sort: bool,
) -> Result<(), Fault> {
    let mut line = Vec::new();
    let mut put = |write: &dyn Fn(&mut Vec<u8>)| {
        line.clear();
        write(&mut line);
        line.push(b'\n');
        out.write_all(&line).map_err(Fault::Output)
    };
    put(&|line| header.write_annotated(annotations, line))?;
    let mut events = Vec::new();
    while let Some((event, annotations)) = recorded.next_event()? {
        if sort {
            events.push((event, annotations));
        } else {
            put(&|line| event.write_annotated(&annotations, line))?;
        }
    }
    events.sort_by_key(|(event, _)| at(event));
    for (event, annotations) in events {
        put(&|line| event.write_annotated(&annotations, line))?;
    }
    out.flush().map_err(Fault::Output)
}

const fn at(event: &Event) -> u64 {
    match event {
        Event::Input(input) => Input::at(input),
        Event::Decision(decision) => Decision::at(decision),
    }
}
