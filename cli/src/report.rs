//! `fuseline report`: traces and what the judge says of them, as one page for a browser.

use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};

use fuseline_report::{Findings, PageError, PageWriter};
use fuseline_traces::packed::unpack;

use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::judging::{JudgeOptions, TraceEnd, next_event, noted, reader};
use crate::output::{Output, Overwrite};
use crate::sink::OutputSink;
use crate::verdict;

#[cfg(test)]
mod tests;

/// What the page is called if it has no other name.
pub(crate) const PAGE: &str = "report.html";

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
    /// The page; - is standard output [default: report.html, or report-2.html and so on if that exists].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    options: JudgeOptions,
}

impl From<PageError> for Fault {
    fn from(error: PageError) -> Self {
        Self::own(error)
    }
}

/// Judges each trace and writes the page once all are read.
pub(crate) fn report(args: &Args) -> Result<Exit, Fault> {
    let inputs: Vec<&Path> = args.traces.iter().map(PathBuf::as_path).collect();
    let output = Output::or_numbered(args.output.as_deref(), PAGE, &inputs, args.overwrite)?;
    let (mut page, mut exit) = (PageWriter::default(), Exit::Conforms);
    let mut out: Box<dyn Write> = if output.is_stdout() {
        Box::new(OutputSink::new(anstream::stderr()))
    } else {
        Box::new(OutputSink::new(anstream::stdout()))
    };
    for path in &args.traces {
        let findings = read_file(&mut page, &args.options, path)?;
        verdict::print_summary(&findings.summary(), &mut out).map_err(Fault::Output)?;
        exit = exit.max(args.options.exit(&findings));
    }
    write(&output, &page)?;
    if !output.is_stdout() {
        writeln!(out, "{}: the page", output.name()).map_err(Fault::Output)?;
    }
    Ok(exit)
}

/// Makes the page of one trace, judged strictly.
pub(crate) fn of(trace: &Path, output: &Output) -> Result<(), Fault> {
    let mut page = PageWriter::default();
    read_file(&mut page, &JudgeOptions::strictly(), trace)?;
    write(output, &page)
}

fn write(output: &Output, page: &PageWriter) -> Result<(), Fault> {
    output.write(|mut out| page.write(&mut out).map_err(Fault::Output))
}

/// Reads and judges one trace, and puts it on the page.
fn read_file(
    page: &mut PageWriter,
    options: &JudgeOptions,
    path: &Path,
) -> Result<Findings, Fault> {
    let (mode, end) = (options.mode()?, options.end());
    let (name, file) = open(path)?;
    let trace = unpack(BufReader::new(file))
        .map_err(|source| Fault::Open { name: name.clone(), source })?;
    let mut reader = reader(mode, &name, trace)?;
    let mut canvas = page.begin(mode, &name, reader.header());
    canvas = canvas.with_header_annotations(reader.header_annotations());
    for (p, tolerance) in options.tolerances(&name, reader.header())? {
        canvas = canvas.with_tolerance_of(p, tolerance);
    }
    if let Some(period) = options.period() {
        canvas = canvas.with_period(period);
    }
    while let Some(event) = next_event(&mut reader, end)? {
        canvas.annotated_event(reader.line(), event, reader.annotations())?;
    }
    Ok(match end {
        TraceEnd::Whole => canvas.finish(),
        TraceEnd::Ended => canvas.finish_ended(),
        TraceEnd::Early => noted(canvas.finish_early()),
    })
}
