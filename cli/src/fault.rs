//! What can go wrong, told in one line: what and where, and a remedy.

use std::io;

use fuseline_operator::ConfigError;
use fuseline_traces::ReadError;
use thiserror::Error;

/// Why a command stopped.
#[derive(Debug, Error)]
pub(crate) enum Fault {
    #[error("{name}: {source}; give a file that can be read, or - for standard input")]
    Open { name: String, source: io::Error },
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("{name}: {source}; give a file in a directory that can be written to")]
    Create { name: String, source: io::Error },
    #[error("{name}:1: {source}; mend the header")]
    Config { name: String, source: ConfigError },
    #[error("standard output: {0}")]
    Output(io::Error),
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
