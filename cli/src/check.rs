//! `fuseline check`: traces against the rules.

use std::fs::File;
use std::io::{self, BufReader, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};

use anstyle::{AnsiColor, Style};
use fuseline_traces::{Judge, Reader, Verdict, Violation, unpack};
use indicatif::{ProgressBar, ProgressStyle};
use textwrap::Options;

use crate::Exit;
use crate::fault::Fault;
use crate::interrupt::Interrupt;
use crate::sink::Sink;
use crate::tail::Tail;

/// Shorter files are judged before a bar could be seen, in bytes.
const LONG: u64 = 16 << 20;
/// How much of a file is read at once, in bytes.
const CHUNK: usize = 64 * 1024;

/// Rules are told within so many columns.
const WIDTH: usize = 96;

pub(crate) const GOOD: Style = AnsiColor::Green.on_default().bold();
pub(crate) const BAD: Style = AnsiColor::Red.on_default().bold();

#[derive(clap::Args)]
#[command(after_help = "\
Every decision is compared with the one that the rules demand, keys and order included. Exit code 0
if all traces conform, 1 if some do not, 2 if one cannot be read. Gzipped traces are unpacked.

Examples:
  fuseline check trace.jsonl
  fuseline check --json traces/*.jsonl
  fuseline check --follow growing.jsonl     Ctrl-C ends it with the verdict")]
pub(crate) struct Args {
    /// The traces; - or none is standard input.
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Print one JSON object a file: file, conforms, judged, lines, violations.
    #[arg(long)]
    json: bool,
    /// Keep judging one file as it grows, until Ctrl-C.
    #[arg(long)]
    follow: bool,
}

/// Judges each file; what cannot be read outweighs what does not conform.
pub(crate) fn check(args: &Args) -> Result<Exit, Fault> {
    let mut out = Sink::new(anstream::stdout());
    if args.follow {
        return follow(args, &mut out);
    }
    let input = [PathBuf::from("-")];
    let files = if args.files.is_empty() { &input[..] } else { &args.files };
    let mut exit = Exit::Conforms;
    for file in files {
        let judged = judge_file(file).and_then(|verdict| {
            tell(&mut out, &verdict, 0, args.json)?;
            Ok(exit_of(&verdict))
        });
        exit = exit.max(judged.unwrap_or_else(|fault| {
            eprintln!("error: {fault}");
            Exit::BadInput
        }));
    }
    Ok(exit)
}

/// Judges a file that is read to its end.
pub(crate) fn judge_file(path: &Path) -> Result<Verdict, Fault> {
    let (name, file) = open(path)?;
    let len = path.metadata().map_or(0, |metadata| metadata.len());
    let bar = if len >= LONG && io::stderr().is_terminal() {
        let style =
            ProgressStyle::with_template("{prefix:.dim} {wide_bar} {percent:>3} % {eta:>4}");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::new(len).with_style(style).with_prefix(name.clone())
    } else {
        ProgressBar::hidden()
    };
    let trace = BufReader::with_capacity(CHUNK, bar.wrap_read(file));
    let trace = unpack(trace).map_err(|source| Fault::Open { name: name.clone(), source })?;
    let judged = fuseline_traces::judge(&name, trace);
    bar.finish_and_clear();
    Ok(judged?)
}

/// Opens a file, or standard input for `-`, with the name to call it.
pub(crate) fn open(path: &Path) -> Result<(String, Box<dyn Read>), Fault> {
    if path.as_os_str() == "-" {
        return Ok(("stdin".to_owned(), Box::new(io::stdin())));
    }
    let name = path.display().to_string();
    match File::open(path) {
        Ok(file) => Ok((name, Box::new(file))),
        Err(source) => Err(Fault::Open { name, source }),
    }
}

/// Judges a growing file until the interrupt, and tells each violation when it is found.
fn follow(args: &Args, out: &mut Sink<impl Write>) -> Result<Exit, Fault> {
    let [path] = &args.files[..] else { return Err(Fault::Follow) };
    if path.as_os_str() == "-" {
        return Err(Fault::Follow);
    }
    let name = path.display().to_string();
    let file = File::open(path).map_err(|source| Fault::Open { name: name.clone(), source })?;
    let bar = ProgressBar::no_length();
    bar.set_style(
        ProgressStyle::with_template("{prefix:.dim} {pos} lines judged, Ctrl-C for the verdict")
            .unwrap_or_else(|_| ProgressStyle::default_spinner()),
    );
    bar.set_prefix(name.clone());
    let mut reader = Reader::new(name.as_str(), Tail::new(file, Interrupt::watch()))?;
    let mut judge = Judge::new(name.as_str(), reader.header());
    let mut told = 0;
    while let Some(event) = reader.next_event()? {
        judge.line(reader.line(), &event);
        bar.set_position(reader.line());
        for violation in judge.so_far().violations.iter().skip(told).filter(|_| !args.json) {
            bar.suspend(|| tell_violation(out, &name, violation)).map_err(Fault::Output)?;
            told += 1;
        }
    }
    bar.finish_and_clear();
    let verdict = judge.finish();
    tell(out, &verdict, told, args.json)?;
    Ok(exit_of(&verdict))
}

const fn exit_of(verdict: &Verdict) -> Exit {
    if verdict.conforms { Exit::Conforms } else { Exit::Differs }
}

/// Prints a verdict, without the violations told already.
fn tell(out: &mut impl Write, verdict: &Verdict, told: usize, json: bool) -> Result<(), Fault> {
    if json {
        serde_json::to_writer(&mut *out, verdict)
            .map_err(io::Error::from)
            .and_then(|()| writeln!(out))
            .map_err(Fault::Output)
    } else {
        tell_people(out, verdict, told).map_err(Fault::Output)
    }
}

/// Prints a verdict for people.
pub(crate) fn tell_people(out: &mut impl Write, verdict: &Verdict, told: usize) -> io::Result<()> {
    writeln!(out, "{}", summary(verdict))?;
    for violation in verdict.violations.iter().skip(told) {
        tell_violation(out, &verdict.file, violation)?;
    }
    if verdict.more > 0 {
        writeln!(out, "\n{} violations more are not shown", verdict.more)?;
    }
    Ok(())
}

/// A verdict in one line.
fn summary(verdict: &Verdict) -> String {
    let Verdict { file, judged, lines, more, violations, .. } = verdict;
    let word = if verdict.conforms {
        format!("{GOOD}conforms{GOOD:#}")
    } else {
        let violations = violations.len() as u64 + more;
        format!("{BAD}does not conform{BAD:#} ({})", count(violations, "violation"))
    };
    format!("{file}: {word}, {} judged in {}", count(*judged, "timestamp"), count(*lines, "line"))
}

fn count(count: u64, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

/// Prints what does not conform in a trace, with the rule and the story.
pub(crate) fn tell_violation(
    out: &mut impl Write,
    file: &str,
    violation: &Violation,
) -> io::Result<()> {
    let Violation { line, t, rule, found, expected, story } = violation;
    let t = t.map_or_else(String::new, |t| format!("timestamp {t} "));
    writeln!(out, "\n{file}:{line}: {t}{BAD}breaks {rule}{BAD:#}")?;
    let sentence =
        Options::new(WIDTH).initial_indent("  rule      ").subsequent_indent("            ");
    writeln!(out, "{}", textwrap::fill(rule.sentence(), sentence))?;
    writeln!(out, "  found     {found}")?;
    writeln!(out, "  expected  {expected}")?;
    for (i, line) in story.iter().enumerate() {
        writeln!(out, "  {:<9} {line}", if i == 0 { "so far" } else { "" })?;
    }
    Ok(())
}
