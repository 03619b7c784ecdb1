//! The `fuseline` command: runs, replays and judges cloud-assisted operators.

mod check;
mod convert;
#[cfg(unix)]
mod drive;
mod drives;
mod emulation;
mod export;
mod fault;
mod files;
mod implementation;
mod interrupt;
mod judging;
mod models;
mod policies;
mod reckoning;
mod replay;
mod report;
mod run;
mod serve;
mod sink;
mod tail;
mod verdict;
mod whole;

use std::ffi::OsString;
use std::io;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tracing_subscriber::EnvFilter;

use crate::fault::Fault;

const EXITS: &str = "\
Exit codes:
  0  done; every trace judged conforms
  1  a trace or an implementation does not conform
  2  bad input, told in one line

Set RUST_LOG (say, RUST_LOG=info) to see what happens inside, on standard error.";

/// Each message leaves with the best result that is there by its deadline: runs such an operator,
/// replays its inputs, and judges its trace or another implementation. Without a command it is `fuseline run`.
#[derive(Parser)]
#[command(version, after_help = EXITS, max_term_width = 100)]
#[command(override_usage = "fuseline [COMMAND]")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Drive a camera operator with emulated models over recorded networks, and judge its trace.
    Run(run::Args),
    /// Serve one emulated model over one recorded network, for `fuseline run` on another machine.
    Serve(serve::Args),
    /// Read a header and inputs, and write the trace with the decisions that the core makes.
    Replay(replay::Args),
    /// Judge traces against the rules.
    Check(check::Args),
    /// Make a trace of what others record, as CSV or MCAP.
    Convert(convert::Args),
    /// Write a trace for ui.perfetto.dev or for Foxglove.
    Export(export::Args),
    /// Drive another implementation through the corpus and generated runs, and judge it.
    #[cfg(unix)]
    Drive(drive::Args),
    /// Answer the inputs that `fuseline drive` sends, as the core does.
    Impl(implementation::Args),
    /// Make a page of traces: summary, response times, and a timeline down to one timestamp.
    Report(report::Args),
}

/// How a command ended.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Exit {
    /// All is well.
    Conforms = 0,
    /// A trace does not conform.
    Differs = 1,
    /// Something could not be read or made.
    BadInput = 2,
}

fn main() -> ExitCode {
    let mut args: Vec<OsString> = std::env::args_os().collect();
    if args.len() < 2 {
        args.push("run".into());
    }
    let command = match Cli::try_parse_from(args) {
        Ok(Cli { command }) => command,
        Err(help) if !help.use_stderr() => {
            // Nobody reads the help any more if this fails.
            let _ = help.print();
            return Exit::Conforms.into();
        }
        Err(error) => {
            eprintln!("error: {}", fault::usage(&error));
            return Exit::BadInput.into();
        }
    };
    if let Ok(filter) = EnvFilter::try_from_default_env() {
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(io::stderr).init();
    }
    match dispatch(command) {
        Ok(exit) => exit.into(),
        Err(fault) if fault.is_broken_pipe() => Exit::Conforms.into(),
        Err(fault) => {
            eprintln!("error: {fault}");
            Exit::BadInput.into()
        }
    }
}

fn dispatch(command: Command) -> Result<Exit, Fault> {
    match command {
        Command::Run(args) => run::run(&args),
        Command::Serve(args) => serve::serve(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Check(args) => check::check(&args),
        Command::Convert(args) => convert::convert(&args),
        Command::Export(args) => export::export(&args),
        #[cfg(unix)]
        Command::Drive(args) => drive::drive(&args),
        Command::Impl(args) => implementation::answer(&args),
        Command::Report(args) => report::report(&args),
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
