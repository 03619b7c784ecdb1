//! `fuseline report`: traces and what the judge says of them, as one page for a browser.

mod columns;
mod page;
mod reasons;

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use fuseline_unpack::unpack;
use thiserror::Error;

use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::judging::{End, How, Judging, Manner, next_event, reader};
use crate::output::Output;
use crate::report::columns::{Columns, Told};
use crate::report::page::Data;
use crate::sink::Sink;
use crate::verdict::Found;

#[cfg(test)]
pub(crate) use crate::report::tests::data;

/// How many events a page may hold; a browser takes no text much longer than theirs.
const EVENTS: usize = 10_000_000;

#[derive(clap::Args)]
#[command(after_help = "\
The page is one file that needs no network: a summary by source, the response times, and a timeline
from the whole run down to what happened to one timestamp and why. Violations stand in it with the
rule that they break.

Traces are judged as fuseline check does it, strictly or as observed. Exit code 0 if all conform, 1
if some do not, 2 if one cannot be read; then there is no page.

Examples:
  fuseline report trace.jsonl
  fuseline report west.jsonl east.jsonl.gz -o drive.html
  fuseline report --observed --tolerance 2ms --lateness 5ms node.jsonl -o node.html")]
pub(crate) struct Args {
    /// The traces, plain or packed (gzip, zstd, MCAP); - is standard input.
    #[arg(value_name = "TRACE", required = true)]
    traces: Vec<PathBuf>,
    /// The page; - is standard output.
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    output: PathBuf,
    #[command(flatten)]
    how: How,
}

/// Why there is no page.
#[derive(Debug, Error)]
pub(crate) enum ReportError {
    #[error("{file}: a page holds 10,000,000 events, and there are more; cut the trace")]
    TooLong { file: String },
}

impl From<ReportError> for Fault {
    fn from(error: ReportError) -> Self {
        Self::own(error)
    }
}

/// Judges each trace and writes the page once all are read.
pub(crate) fn report(args: &Args) -> Result<Exit, Fault> {
    let inputs: Vec<&Path> = args.traces.iter().map(PathBuf::as_path).collect();
    let output = Output::new(&args.output, &inputs)?;
    let (mut told, mut exit, mut room) = (Vec::new(), Exit::Conforms, EVENTS);
    let mut out: Box<dyn Write> = if output.is_stdout() {
        Box::new(Sink::new(anstream::stderr()))
    } else {
        Box::new(Sink::new(anstream::stdout()))
    };
    for path in &args.traces {
        let (one, verdict) = read_file(args.how.manner(), args.how.end(), path, &mut room)?;
        verdict.summary().tell(&mut out).map_err(Fault::Output)?;
        exit = exit.max(verdict.exit());
        told.push(one);
    }
    write(&output, &told)?;
    Ok(exit)
}

/// Makes the page of one trace, judged strictly.
pub(crate) fn of(trace: &Path, page: &Path) -> Result<(), Fault> {
    let output = Output::new(page, &[trace])?;
    let (told, _) = read_file(None, End::Whole, trace, &mut EVENTS.clone())?;
    write(&output, &[told])
}

/// Writes the page of what was told.
fn write(output: &Output, told: &[Told]) -> Result<(), Fault> {
    output.write(|out| page::write(out, &Data::new(told)).map_err(Fault::Output))
}

fn read_file(
    manner: Manner,
    end: End,
    path: &Path,
    room: &mut usize,
) -> Result<(Told, Found), Fault> {
    let (name, file) = open(path)?;
    let trace = unpack(BufReader::new(file))
        .map_err(|source| Fault::Open { name: name.clone(), source })?;
    read(manner, end, &name, trace, room)
}

/// Reads and judges one trace; `room` is how many events more the page can hold.
fn read(
    manner: Manner,
    end: End,
    name: &str,
    trace: impl BufRead,
    room: &mut usize,
) -> Result<(Told, Found), Fault> {
    let mut reader = reader(manner, name, trace)?;
    let header = reader.header().clone();
    let mut judging = Judging::new(manner, name, &header);
    let mut columns = Columns::new(&header, manner.is_some());
    while let Some(event) = next_event(&mut reader, end)? {
        let too_long = || ReportError::TooLong { file: name.to_owned() };
        *room = room.checked_sub(1).ok_or_else(too_long)?;
        judging.line(reader.line(), &event)?;
        columns.push(event);
    }
    let verdict = judging.finish(end);
    Ok((columns.told(&header, manner, &verdict), verdict))
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    /// The page's data for this trace.
    pub(crate) fn data(trace: &[u8]) -> Value {
        let (told, found) = read(None, End::Whole, "trace", trace, &mut EVENTS.clone()).unwrap();
        assert!(found.summary().conforms);
        let data = serde_json::to_vec(&Data::new(&[told])).unwrap();
        serde_json::from_slice(&data).unwrap()
    }
}
