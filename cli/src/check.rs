//! `fuseline check`: checks traces against the rules.
//!
//! Files are judged several at a time and reported in their order. `judging` has the judges'
//! options, and `verdict` has the text.

use std::fs::File;
use std::io::{BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};

use fuseline_traces::Verdict;
use fuseline_traces::packed::{Packing, unpack_beside};
use indicatif::MultiProgress;
use rayon::prelude::*;
use thiserror::Error;

use crate::diagnostics::print_line;
use crate::exit::Exit;
use crate::fault::Fault;
use crate::input::open;
use crate::interrupt::Interrupt;
use crate::judging::{JudgeOptions, TraceEnd, TraceStep, finish, judge, next_event, reader};
use crate::output::Overwrite;
use crate::progress;
use crate::results::{Outputs, Subject};
use crate::sink::OutputSink;
use crate::tail::Tail;
use crate::verdict::{self, print_violation};

/// The number of bytes of a file that are read at once.
const CHUNK: usize = 64 * 1024;
/// The number of files that a thread judges before their verdicts are printed.
const AT_ONCE: usize = 4;

#[derive(clap::Args)]
#[command(after_help = "\
Without --observed, every decision is compared with the decision that the rules demand, with its keys
and its order. --observed judges a trace that several threads or hosts recorded. It judges each
timestamp by itself. A timestamp conforms if the rules can explain its outputs, although instants may be
off by the tolerance, and timers and outputs late by the lateness. Memory grows with the timestamps that
are open at once, not with the trace.

A hung operator conforms unless you give --ended or --period, or the recorder writes a last tick: a
trace does not show that its run is over. With --period the operator must open a message at least that
often, whatever its timestamp is.

A trace conforms if it breaks no rule and nothing is in doubt. If something is in doubt, the verdict is
\"no violation found\", with what the judge could not see, and the exit code is 3. --accept accepts
kinds of doubt:
  unjudged    no timestamp was judged
  unanswered  messages have no output, though later ones were answered
  unfinished  messages were open when the run ended (--ended)
  unopened    requests, results or outputs have timestamps that no open has
  silent      a cloud answered none of its requests
  coarse      deadlines are no longer than the lateness plus twice the tolerance
  blurred     everything lies within the tolerance, so its order is unknown
  endless     no deadline of a source ended within the trace
  cut         the trace was cut off (--truncated)
A message that is still within its deadlines when the trace ends is not in doubt. Without --observed,
only unjudged, unanswered, unfinished and cut can occur.

With --from, --to or --timestamps the verdict is about that part alone. The whole trace is read, because
the rules depend on everything that came before.

Exit code 0 if all traces conform, 1 if one breaks a rule, 2 if one cannot be read, 3 if something is in
doubt; 2 wins over 1, and 1 over 3. Traces in gzip, zstd or MCAP are unpacked as they are read; several
files are judged at once.

Examples:
  fuseline check trace.jsonl
  fuseline check --observed --tolerance 2ms --lateness 5ms node.jsonl
  fuseline check --ended --observed --tolerance 2ms --lateness 5ms --period 100ms arm.jsonl
  fuseline check --json traces/*.jsonl
  fuseline check --accept silent,endless traces/*.jsonl
  fuseline check --from 10m --to 12m long.jsonl
  fuseline check --sarif found.sarif traces/*.jsonl
  fuseline check --follow growing.jsonl     Ctrl-C ends it with the verdict
  fuseline check --truncated crashed.jsonl")]
pub(crate) struct Args {
    /// The traces; standard input if there are none, or for -.
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    how: JudgeOptions,
    /// Print one JSON object for each file: file, conforms, judged, lines, doubts, violations.
    #[arg(long)]
    json: bool,
    /// Write the verdicts for continuous integration, as `JUnit` XML.
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write violations as SARIF, which code hosts show beside the change.
    #[arg(long, value_name = "FILE")]
    sarif: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Keep judging one file while it grows, until Ctrl-C; messages that are open then are not
    /// judged.
    #[arg(long, conflicts_with_all = ["junit", "sarif", "ended"])]
    follow: bool,
}

/// The reason why a file cannot be followed.
#[derive(Debug, Error)]
enum FollowError {
    #[error("--follow watches one file, which cannot be standard input; name the file")]
    NotOne,
    #[error("{0}: this file is packed, and --follow needs a plain one; check it without --follow")]
    Packed(String),
}

impl From<FollowError> for Fault {
    fn from(error: FollowError) -> Self {
        Self::own(error)
    }
}

/// Judges each file. A file that cannot be read decides the exit code, whatever the others'
/// verdicts are.
pub(crate) fn check(args: &Args) -> Result<Exit, Fault> {
    let mut out = OutputSink::new(anstream::stdout());
    if args.follow {
        return follow(args, &mut out);
    }
    let input = [PathBuf::from("-")];
    let files = if args.files.is_empty() { &input[..] } else { &args.files };
    let read: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let results = [args.sarif.as_deref(), args.junit.as_deref()];
    let outputs = Outputs::new(results, &read, args.overwrite)?;
    let mut all = Vec::new();
    let bars = MultiProgress::new();
    let mut exit = Exit::Conforms;
    for some in files.chunks(AT_ONCE * rayon::current_num_threads()) {
        let judged: Vec<Result<Verdict, Fault>> = some
            .par_iter()
            .with_max_len(1)
            .map(|file| judge_file(&args.how, file, &bars))
            .collect();
        for (path, found) in some.iter().zip(judged) {
            let ended = match &found {
                Ok(found) => {
                    verdict::print_report(found, &mut out, 0, args.json).map_err(Fault::Output)?;
                    verdict::exit(found)
                }
                Err(fault) => {
                    print_line(format_args!("error: {fault}"));
                    Exit::BadInput
                }
            };
            if !outputs.is_empty() {
                let subject = match &found {
                    Ok(found) => Subject::found(found),
                    Err(fault) => Subject::unread(path, fault),
                };
                all.push(subject);
            }
            exit = exit.or_worse(ended);
        }
    }
    outputs.write(&all)?;
    Ok(exit)
}

/// Judges a file that is read to its end.
fn judge_file(how: &JudgeOptions, path: &Path, bars: &MultiProgress) -> Result<Verdict, Fault> {
    let (name, file) = open(path)?;
    let bar = progress::bar(bars, path, &name);
    let trace = BufReader::with_capacity(CHUNK, bar.wrap_read(file));
    let trace =
        unpack_beside(trace).map_err(|source| Fault::Open { name: name.clone(), source })?;
    let judged = judge(how, &name, trace);
    bar.finish_and_clear();
    judged
}

/// Opens a file to be followed.
fn plain_file(path: &Path, name: &str) -> Result<File, Fault> {
    let opened = || {
        let mut file = File::open(path)?;
        let mut first = [0];
        let is_packed = file.read(&mut first)? > 0 && Packing::of(first[0]).is_some();
        file.rewind()?;
        Ok((file, is_packed))
    };
    match opened().map_err(|source| Fault::Open { name: name.to_owned(), source })? {
        (file, false) => Ok(file),
        (_, true) => Err(FollowError::Packed(name.to_owned()).into()),
    }
}

/// Judges a growing file until the interrupt, and prints each violation when it is found.
fn follow(args: &Args, out: &mut OutputSink<impl Write>) -> Result<Exit, Fault> {
    let [path] = &args.files[..] else { return Err(FollowError::NotOne.into()) };
    if path.as_os_str() == "-" {
        return Err(FollowError::NotOne.into());
    }
    let name = path.display().to_string();
    // The interrupt is watched before the file is opened, because a user who sees that the file was
    // read may interrupt.
    let interrupt = Interrupt::watch();
    let file = plain_file(path, &name)?;
    let bar = progress::styled(None, "{prefix:.dim} {pos} lines judged, Ctrl-C for the verdict");
    bar.set_prefix(name.clone());
    let mode = args.how.mode()?;
    let mut reader = reader(mode, &name, Tail::new(file, interrupt))?;
    let mut judging = args.how.judging(&name, &reader)?;
    let mut reported = 0;
    while let TraceStep::Event(event) = next_event(&mut reader, TraceEnd::Growing)? {
        judging.annotated_line(reader.line(), &event, reader.annotations())?;
        bar.set_position(reader.line());
        if args.json {
            continue;
        }
        for violation in judging.since(reported) {
            bar.suspend(|| print_violation(violation, &name, out)).map_err(Fault::Output)?;
            reported += 1;
        }
    }
    bar.finish_and_clear();
    let found = args.how.accepted(finish(judging, TraceEnd::Growing, None));
    verdict::print_report(&found, out, reported, args.json).map_err(Fault::Output)?;
    Ok(verdict::exit(&found))
}
