//! What can go wrong, told in one line: what and where, and a remedy.

use std::error;
#[cfg(unix)]
use std::ffi::OsString;
use std::io;
use std::net::SocketAddr;

use fuseline_operator::ConfigError;
use fuseline_tokio::SpawnError;
use fuseline_tokio::grpc::{RemoteError, ServeError};
use fuseline_traces::ReadError;
use fuseline_traces::observed::{Disorder, JudgeError};
use thiserror::Error;

use crate::convert::ConvertError;
use crate::emulation::EmulationError;
use crate::export::ExportError;
use crate::files::FileError;
use crate::report::ReportError;
use crate::run::PlanError;

/// Why a command stopped.
#[derive(Debug, Error)]
pub(crate) enum Fault {
    #[error("{name}: {source}; give a file that can be read, or - for standard input")]
    Open { name: String, source: io::Error },
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    Convert(#[from] ConvertError),
    #[error("{name}: {source}")]
    Export { name: String, source: ExportError },
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(transparent)]
    Judge(#[from] JudgeError),
    #[error(transparent)]
    Disorder(#[from] Disorder),
    #[error("{name}: {source}; give a file in a directory that can be written to")]
    Create { name: String, source: io::Error },
    #[error("{name}:1: {source}; mend the header")]
    Config { name: String, source: ConfigError },
    #[error("standard output: {0}")]
    Output(io::Error),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Emulation(#[from] EmulationError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error("cloud {cloud:?}: {source}")]
    Remote { cloud: String, source: RemoteError },
    #[error("{0}; choose other options for the clouds or the window")]
    Spawn(#[from] SpawnError),
    #[error("the trace was not written whole: {0}; make room for it, or name another --trace")]
    Trace(io::Error),
    #[error("no port on 127.0.0.1: {0}; free some")]
    Loopback(io::Error),
    #[error("--listen {address}: {source}; choose an address of this machine and a free port")]
    Listen { address: SocketAddr, source: io::Error },
    #[error("{}", one_line(&chain(.0)))]
    Serve(ServeError),
    #[error("the system gives no threads: {0}; end something else")]
    Runtime(io::Error),
    #[error("stdin:{line}:{column}: {message}")]
    Line { line: u64, column: u64, message: String },
    #[cfg(unix)]
    #[error("{command:?}: {source}; give a program that can be started")]
    Start { command: OsString, source: io::Error },
    #[error("--follow watches one file; give it one that is not standard input")]
    Follow,
}

impl Fault {
    /// Whether whoever read the output has gone, which is no one's fault.
    pub(crate) fn is_broken_pipe(&self) -> bool {
        matches!(self, Self::Output(error) if error.kind() == io::ErrorKind::BrokenPipe)
    }
}

/// A mistake on the command line as one line.
pub(crate) fn usage(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let mut paragraphs = text.split("\n\n").map(one_line);
    let what = paragraphs.next().unwrap_or_default();
    let what = what.strip_prefix("error: ").unwrap_or(&what).to_owned();
    let remedy = paragraphs.find_map(|paragraph| Some(paragraph.strip_prefix("tip: ")?.to_owned()));
    format!("{what}; {}", remedy.as_deref().unwrap_or("see --help"))
}

fn one_line(paragraph: &str) -> String {
    paragraph.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// An error with what caused it.
fn chain(error: &dyn error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text.push_str(": ");
        text.push_str(&error.to_string());
        source = error.source();
    }
    text
}
