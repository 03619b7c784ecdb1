//! `fuseline convert`: makes a trace of what other tools recorded. `csv` and `mcap` read it; nothing is judged.

mod csv;
mod mcap;
mod recorded;

use std::io::{self, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use fuseline_traces::rows::{self, Columns, Unit};
use fuseline_traces::{Decision, Event, Events, Input};

use crate::convert::csv::CsvTable;
use crate::convert::recorded::{AnnotatedHeader, ConvertError, Recorded};
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::{is_standard, open};
use crate::output::{Output, Overwrite, refuse_onto_stdout};

#[derive(clap::Args)]
#[command(after_help = "\
A CSV file has a row an event and names its columns in its first row. The columns at, ev, t, p, due,
deadline, backlog, why, of, try, within, age, origin and seq are read, those that a row's event has;
--column gives one another name. An MCAP file has a JSON channel, /fuseline/trace, each message a line of a trace; a message
without at has its log time. Its first message may be the header.

The header is the trace's first line: it tells the clouds and the commit rule.

Examples:
  fuseline convert --header header.jsonl --column at=stamp_ms --unit ms events.csv -o trace.jsonl
  fuseline convert --header header.jsonl --event response=result,send=request events.csv
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
    /// Where a key of the trace stands in a CSV file, such as at=stamp.
    #[arg(long, value_name = "KEY=NAME", value_delimiter = ',', value_parser = rows::column)]
    column: Vec<(&'static str, String)>,
    /// What the file calls an event, such as response=result.
    #[arg(long, value_name = "NAME=EV", value_delimiter = ',', value_parser = rows::event)]
    event: Vec<(String, &'static str)>,
    /// The unit of a CSV file's instants and durations; decimals are read exactly.
    #[arg(long, default_value = "ns", value_parser = unit())]
    unit: Unit,
    /// The MCAP file's topic.
    #[arg(long, default_value = fuseline_traces::packed::TOPIC)]
    topic: String,
    /// Put the events in the order of their instants, holding all of them.
    #[arg(long)]
    sort: bool,
    /// The trace; without it, or with -, standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    Csv,
    Mcap,
}

/// Converts a file; a named output is written only once all of the input was read.
pub(crate) fn convert(args: &Args) -> Result<Exit, Fault> {
    let name = args.file.display().to_string();
    let format = args.from.or_else(|| format_of(&args.file));
    let format = format.ok_or(ConvertError::Format { file: name })?;
    let inputs: Vec<&Path> =
        [Some(&*args.file), args.header.as_deref()].into_iter().flatten().collect();
    let named = args.output.as_deref().filter(|path| !is_standard(path));
    let output = named.map(|path| Output::new(path, &inputs, args.overwrite)).transpose()?;
    if output.is_none() {
        refuse_onto_stdout(&inputs)?;
    }
    let (name, file) = open(&args.file)?;
    let mut recorded: Box<dyn Recorded> = match format {
        Format::Csv => {
            let columns = Columns::new(&args.column, &args.event, args.unit);
            Box::new(CsvTable::new(&name, file, columns)?)
        }
        Format::Mcap => Box::new(mcap::McapInput::new(&name, file, &args.topic)),
    };
    let own = recorded.header()?;
    let header = match &args.header {
        Some(path) => {
            let (name, file) = open(path)?;
            let events = Events::observed(name, BufReader::new(file))?;
            Some((events.header().clone(), events.header_annotations().clone()))
        }
        None => own,
    };
    let header = header.ok_or_else(|| ConvertError::NoHeader { file: name.clone() })?;
    let mut write = |out: &mut dyn Write| write(out, &header, &mut *recorded, args.sort);
    if let Some(output) = output {
        output.write(|out| write(out))?;
    } else {
        write(&mut BufWriter::new(io::stdout().lock()))?;
    }
    Ok(Exit::Conforms)
}

fn unit() -> impl TypedValueParser<Value = Unit> {
    let named = |name: String| Unit::ALL.into_iter().find(|unit| unit.as_str() == name);
    PossibleValuesParser::new(Unit::ALL.map(Unit::as_str))
        .try_map(move |name| named(name).ok_or("no such unit"))
}

fn format_of(path: &Path) -> Option<Format> {
    match path.extension()?.to_str()? {
        "csv" => Some(Format::Csv),
        "mcap" => Some(Format::Mcap),
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
