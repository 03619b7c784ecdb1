//! The `fuseline` command: runs, replays and judges cloud-assisted operators.

mod check;
mod fault;
mod interrupt;
mod replay;
mod tail;

use std::io;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tracing_subscriber::EnvFilter;

use crate::fault::Fault;

const EXITS: &str = "\
Exit codes:
  0  done; every trace judged conforms
  1  a trace does not conform
  2  bad input, told in one line

Set RUST_LOG (say, RUST_LOG=info) to see what happens inside, on standard error.";

/// Each message leaves with the best result that is there by its deadline: replays such an operator's
/// inputs, and judges its trace.
#[derive(Parser)]
#[command(version, after_help = EXITS, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Read a header and inputs, and write the trace with the decisions that the core makes.
    Replay(replay::Args),
    /// Judge traces against the rules.
    Check(check::Args),
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
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
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
    match dispatch(cli.command) {
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
        Command::Replay(args) => replay::replay(&args),
        Command::Check(args) => check::check(&args),
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
