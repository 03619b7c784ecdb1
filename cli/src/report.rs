//! `fuseline report`: shows traces and their verdicts on one page for a browser.

use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, SystemTime};

use fuseline_report::{PageWriter, RunNotes};
use fuseline_traces::packed::unpack_beside;
use fuseline_traces::{Event, Input, Verdict};
use serde::Deserialize;
use serde_json::{Value, json};
use thiserror::Error;

use crate::diagnostics::print_line;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::{is_standard, open};
use crate::interrupt::Interrupt;
use crate::judging::{JudgeOptions, TraceEnd, finish, judge_lines, reader};
use crate::judging_notes::JudgingNotes;
use crate::output::{Output, Overwrite};
use crate::progress::watched;
use crate::sink::OutputSink;
use crate::verdict;

#[cfg(test)]
mod tests;

/// The default name of the page.
pub(crate) const PAGE: &str = "report.html";

#[derive(clap::Args)]
#[command(after_help = "\
The page is one file that needs no network: a summary by source, the response times, and a timeline
from the whole run down to what happened to one timestamp and why. It shows violations with the rule
that they break. For a trace of fuseline run it also has the policies' table, the configuration and its
caveats. Two to four traces are shown side by side. If they are of operators of one vehicle, click a
timestamp to follow its sensor's frame through all of them, and to see where its time went.

Traces are judged as fuseline check does it, strictly or as observed. Exit code 0 if all conform, 1
if one breaks a rule, 2 if one cannot be read (then there is no page), 3 if something is in doubt; see
fuseline check --help.

Examples:
  fuseline report trace.jsonl
  fuseline report west.jsonl east.jsonl.gz -o drive.html
  fuseline report --watch growing.jsonl
  fuseline report --from 10m --to 12m long.jsonl
  fuseline report --observed --tolerance 2ms --lateness 5ms node.jsonl -o node.html")]
pub(crate) struct Args {
    /// The traces, plain or packed (gzip, zstd, MCAP); - is standard input.
    #[arg(value_name = "TRACE", required = true)]
    traces: Vec<PathBuf>,
    /// The page; - is standard output [default: report.html, or report-2.html and so on if that
    /// exists].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Make the page again whenever a trace has changed, until Ctrl-C; messages that are open then
    /// are not judged.
    #[arg(long, conflicts_with = "ended")]
    watch: bool,
    #[command(flatten)]
    options: JudgeOptions,
}

/// The time between two looks at the traces.
const WATCH: Duration = Duration::from_millis(500);

/// `--watch` was used without names of files.
#[derive(Debug, Error)]
#[error("--watch reads the traces and writes the page many times; name files for both")]
struct WatchError;

/// Judges each trace and writes the page once all are read.
pub(crate) fn report(args: &Args) -> Result<Exit, Fault> {
    let inputs: Vec<&Path> = args.traces.iter().map(PathBuf::as_path).collect();
    let output = Output::or_numbered(args.output.as_deref(), PAGE, &inputs, args.overwrite)?;
    if !args.watch {
        return make(args, &output, args.options.end());
    }
    if output.is_stdout() || inputs.iter().any(|path| is_standard(path)) {
        return Err(Fault::own(WatchError));
    }
    let interrupt = Interrupt::watch();
    let mut seen = state(&inputs);
    let mut exit = make(args, &output, TraceEnd::Growing)?;
    // From here on the page belongs to this command, which may overwrite it.
    let output = Output::new(Path::new(output.name()), &inputs, Overwrite { force: true })?;
    while !interrupt.is_set() {
        thread::sleep(WATCH);
        let now = state(&inputs);
        if now != seen {
            seen = now;
            match make(args, &output, TraceEnd::Growing) {
                Ok(made) => exit = made,
                // The trace may just be in the middle of a write.
                Err(fault) => print_line(format_args!("warning: {fault}; the page stays as it is")),
            }
        }
    }
    Ok(exit)
}

/// Returns the size and the time of change of each trace, to notice changes.
fn state(inputs: &[&Path]) -> Vec<Option<(u64, SystemTime)>> {
    let of = |path: &&Path| {
        let metadata = path.metadata().ok()?;
        Some((metadata.len(), metadata.modified().ok()?))
    };
    inputs.iter().map(of).collect()
}

/// Makes the page once.
fn make(args: &Args, output: &Output, end: TraceEnd) -> Result<Exit, Fault> {
    let (mut page, mut exit) = (PageWriter::default(), Exit::Conforms);
    let mut out: Box<dyn Write> = if output.is_stdout() {
        Box::new(OutputSink::new(anstream::stderr()))
    } else {
        Box::new(OutputSink::new(anstream::stdout()))
    };
    for path in &args.traces {
        let findings =
            read_file(&mut page, (&args.options, end), path, |found| args.options.accepted(found))?;
        verdict::print_summary(&findings, &mut out).map_err(Fault::Output)?;
        verdict::print_doubts(&findings, &mut out).map_err(Fault::Output)?;
        exit = exit.or_worse(verdict::exit(&findings));
    }
    write(output, &page)?;
    if !output.is_stdout() {
        writeln!(out, "{}: the page", output.name()).map_err(Fault::Output)?;
    }
    Ok(exit)
}

/// Makes the page of one trace, judged strictly. `doubted` adds further doubts.
pub(crate) fn of(
    trace: &Path,
    output: &Output,
    doubted: impl FnOnce(Verdict) -> Verdict,
) -> Result<(), Fault> {
    let mut page = PageWriter::default();
    let how = (&JudgeOptions::strictly(), TraceEnd::Whole);
    read_file(&mut page, how, trace, doubted)?;
    write(output, &page)
}

/// The key of the notes of `run` in a line's `x`, which is the writer's own key.
pub(crate) const NOTES: &str = "fuseline_run";

/// Returns a trace's last line, a tick that changes nothing, with the notes of `run`.
pub(crate) fn noted_tick(at: u64, notes: &RunNotes) -> String {
    let line = json!({ "ev": "tick", "at": at, "x": { NOTES: notes } });
    format!("{line}\n")
}

/// Returns the notes of `run` on a line.
fn notes(line: &[u8]) -> Option<RunNotes> {
    // Almost no tick has notes, so this checks for them first.
    line.windows(NOTES.len()).find(|key| *key == NOTES.as_bytes())?;
    let line: Value = serde_json::from_slice(line).ok()?;
    RunNotes::deserialize(line.get("x")?.get(NOTES)?).ok()
}

fn write(output: &Output, page: &PageWriter) -> Result<(), Fault> {
    output.write(|mut out| page.write(&mut out).map_err(Fault::Output))
}

/// Reads and judges one trace, and puts it on the page.
fn read_file(
    page: &mut PageWriter,
    (options, end): (&JudgeOptions, TraceEnd),
    path: &Path,
    doubted: impl FnOnce(Verdict) -> Verdict,
) -> Result<Verdict, Fault> {
    let mode = options.mode()?;
    let (name, file) = open(path)?;
    let trace = unpack_beside(BufReader::new(watched(path, &name, file)))
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
    if let Some(part) = options.part()? {
        canvas = canvas.with_part(part);
    }
    let (mut judging, mut noted_last) = (JudgingNotes::new(mode), None);
    let seen = |event: &Event, line: &[u8]| {
        if let Event::Input(Input::Tick { .. }) = event
            && let Some(notes) = notes(line)
        {
            noted_last = Some(notes);
        }
    };
    let cut = judge_lines(&mut reader, end, seen, |line, event, annotations| {
        judging.event(&event);
        canvas.annotated_event(line, event, annotations)
    })?;
    if let Some(notes) = noted_last {
        canvas.add_notes(notes);
    }
    let found = canvas.finish_as(|judging| doubted(finish(judging, end, cut)));
    judging.warn(&found);
    Ok(found)
}
