//! The `fuseline` command: runs, replays and judges cloud-assisted operators.
//!
//! Each subcommand is a module with its options; `exit` has the exit codes, and `fault` the errors
//! that stop a command.

mod check;
mod convert;
mod deadline;
mod decide;
mod diagnostics;
#[cfg(unix)]
mod drive;
mod duration;
mod emulation;
mod exit;
mod export;
mod fault;
mod files;
mod forward;
mod help;
mod implementation;
mod input;
mod interrupt;
mod judging;
mod judging_notes;
mod link;
mod output;
mod pages;
mod part;
mod percentile;
mod probe;
mod progress;
mod replay;
mod report;
mod results;
mod run;
mod scenario;
mod serve;
mod sink;
mod table;
mod tail;
mod verdict;

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::{self, IsTerminal};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::layer;
use tracing_subscriber::prelude::*;

use crate::diagnostics::print_line;
use crate::exit::Exit;
use crate::fault::{Fault, one_line};

const EXITS: &str = "\
Exit codes:
  0  done; every trace judged conforms
  1  a trace or an implementation does not conform
  2  bad input; one line says where and what is wrong
  3  no violation was found, but something is in doubt, such as messages that
     could not be judged; fuseline check --help has the kinds

Set RUST_LOG, for example RUST_LOG=info, to see on standard error what happens inside.";

/// Runs an operator that sends the best result available by each message's deadline, replays its
/// inputs, and judges its trace or another implementation. Without a command it runs
/// `fuseline run`.
#[derive(Parser)]
#[command(version, after_help = EXITS, max_term_width = 100)]
#[command(override_usage = "fuseline [COMMAND]")]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// When to print colours: auto prints them if standard output is a terminal.
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", display_order = 1000)]
    color: ColorChoice,
}

#[derive(Subcommand)]
enum Command {
    /// Drive a camera operator with emulated models over recorded networks, and judge its trace.
    Run(run::Args),
    /// Measure the network to a server as the paper's drive did, and record it as a drive.
    Probe(probe::Args),
    /// Serve one emulated model over one recorded network, for `fuseline run` on another computer.
    Serve(serve::Args),
    /// Read a header and inputs, and write the trace with the decisions that the core makes.
    Replay(replay::Args),
    /// Judge traces against the rules.
    Check(check::Args),
    /// Make a trace from what other tools recorded: CSV, JSON lines, MCAP or a bag of ROS 2.
    Convert(convert::Args),
    /// Write a trace for ui.perfetto.dev, Foxglove or OpenTelemetry.
    Export(export::Args),
    /// Drive another implementation through the corpus and generated runs, and judge it.
    #[cfg(unix)]
    Drive(drive::Args),
    /// Answer the inputs that `fuseline drive` sends, with the core.
    Impl(implementation::Args),
    /// Show which deadlines are safe for a vehicle at given speeds, and which one is worth it.
    Deadline(deadline::Args),
    /// Play the paper's evaluation in virtual time, from stated physics.
    #[command(arg_required_else_help = true)]
    Scenario(scenario::Args),
    /// Make a page from traces: summary, response times, and a timeline down to one timestamp.
    Report(report::Args),
    /// Print the script that completes commands and options in a shell.
    Completions(pages::ShellArgs),
    /// Write the manual pages to a folder.
    Man(pages::ManArgs),
}

/// Runs the command that the arguments name.
#[must_use]
pub fn main() -> ExitCode {
    let args: Vec<OsString> = std::env::args_os().collect();
    let (command, color) = match parse(&args) {
        Ok(parsed) => parsed,
        Err(help) if !help.use_stderr() => {
            // Nobody reads the help any more if this fails.
            let _ = help.print();
            return Exit::Conforms.into();
        }
        // A command that needs more lists what there is.
        Err(help) if help.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = help.print();
            return Exit::BadInput.into();
        }
        Err(error) => {
            print_line(format_args!("error: {}", usage(&error, &args)));
            return Exit::BadInput.into();
        }
    };
    match color {
        ColorChoice::Auto => {}
        ColorChoice::Always => anstream::ColorChoice::Always.write_global(),
        ColorChoice::Never => anstream::ColorChoice::Never.write_global(),
    }
    if let Some(filter) = log_filter() {
        // A file is to hold no colours, unless they are wanted.
        let has_colours = match color {
            ColorChoice::Auto => io::stderr().is_terminal(),
            ColorChoice::Always => true,
            ColorChoice::Never => false,
        };
        let log = layer().with_ansi(has_colours).with_writer(io::stderr).with_filter(filter);
        tracing_subscriber::registry().with(log).init();
    }
    match dispatch(command) {
        Ok(exit) => exit.into(),
        Err(fault) if fault.is_broken_pipe() => Exit::Conforms.into(),
        Err(fault) => {
            print_line(format_args!("error: {fault}"));
            Exit::BadInput.into()
        }
    }
}

/// Returns the filter of the log: `RUST_LOG` as `level` or `target=level,…`, or `None` if it is not
/// set or has another form.
fn log_filter() -> Option<Targets> {
    std::env::var("RUST_LOG").ok().filter(|text| !text.is_empty())?.parse().ok()
}

/// Returns the command line, whose help people can read.
fn grammar() -> clap::Command {
    help::readable(Cli::command())
}

/// Returns the command of these words, `run` if there is none, and whether it prints colours.
fn parse(args: &[OsString]) -> Result<(Command, ColorChoice), clap::Error> {
    let parsed = |args: &[OsString]| Cli::from_arg_matches(&grammar().try_get_matches_from(args)?);
    let run = [args, &["run".into()]].concat();
    let Cli { command, color } = match parsed(args)? {
        Cli { command: None, .. } => parsed(&run)?,
        parsed => parsed,
    };
    let command = command.ok_or_else(|| clap::Error::new(ErrorKind::MissingSubcommand))?;
    Ok((command, color))
}

fn dispatch(command: Command) -> Result<Exit, Fault> {
    match command {
        Command::Run(args) => run::run(&args),
        Command::Probe(args) => probe::probe(&args),
        Command::Serve(args) => serve::serve(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Check(args) => check::check(&args),
        Command::Convert(args) => convert::convert(&args),
        Command::Export(args) => export::export(&args),
        #[cfg(unix)]
        Command::Drive(args) => drive::drive(&args),
        Command::Impl(args) => implementation::answer(&args),
        Command::Deadline(args) => deadline::print_report(&args),
        Command::Scenario(args) => scenario::play(&args),
        Command::Report(args) => report::report(&args),
        Command::Completions(args) => pages::complete(&args, grammar()),
        Command::Man(args) => pages::manual(&args, grammar()),
    }
}

/// Returns a mistake on the command line as one line.
fn usage(error: &clap::Error, args: &[OsString]) -> String {
    let text = error.render().to_string();
    let mut paragraphs = text.split("\n\n").map(one_line);
    let message = paragraphs.next().unwrap_or_default();
    let message = message.strip_prefix("error: ").unwrap_or(&message).to_owned();
    let tip = || paragraphs.find_map(|paragraph| Some(paragraph.strip_prefix("tip: ")?.to_owned()));
    let remedy = unseparated_command(error, args).or_else(tip);
    format!("{message}; {}", remedy.as_deref().unwrap_or("see --help"))
}

/// Returns the usage line if the command to drive does not follow `--`.
fn unseparated_command(error: &clap::Error, args: &[OsString]) -> Option<String> {
    let has_command = args.iter().any(|arg| arg == "--");
    if has_command || args.get(1).is_none_or(|command| command != "drive") {
        return None;
    }
    let words: Vec<Cow<'_, str>> = args.iter().skip(1).map(|arg| arg.to_string_lossy()).collect();
    let index = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(word)) if !word.starts_with('-') => {
            words.iter().position(|arg| arg == word)?
        }
        _ if error.kind() == ErrorKind::MissingRequiredArgument => words.len(),
        _ => return None,
    };
    let (options, command) = words.split_at(index);
    let command = if command.is_empty() { &["COMMAND".into()] } else { command };
    let typed = [&["fuseline".into()], options, &["--".into()], command].concat();
    let quoted = shlex::try_join(typed.iter().map(|word| &**word)).ok()?;
    Some(format!("type {quoted}"))
}
