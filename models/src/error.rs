//! The errors of the command, each on one line with the place, the problem and a remedy.

use std::io;
use std::net::SocketAddr;

use fuseline_models::CheckError;
use thiserror::Error;

/// The reason a command stopped.
#[derive(Debug, Error)]
pub(crate) enum ModelsError {
    #[error("no configuration is named {name:?}; `list` names them")]
    World { name: String },
    #[error("{config}: {source}; mend the model")]
    Check { config: &'static str, source: CheckError },
    #[error("--listen {address}: {source}; choose an address of this machine and a free port")]
    Listen { address: SocketAddr, source: io::Error },
    #[error("{name}: {source}; give a directory that can be written to")]
    Save { name: String, source: io::Error },
    #[error("standard output: {0}")]
    Output(#[from] io::Error),
}

/// Returns a mistake on the command line as one line.
pub(crate) fn usage(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let mut paragraphs = text.split("\n\n").map(one_line);
    let message = paragraphs.next().unwrap_or_default();
    let message = message.strip_prefix("error: ").unwrap_or(&message).to_owned();
    let remedy = paragraphs.find_map(|paragraph| Some(paragraph.strip_prefix("tip: ")?.to_owned()));
    format!("{message}; {}", remedy.as_deref().unwrap_or("see --help"))
}

fn one_line(paragraph: &str) -> String {
    paragraph.split_whitespace().collect::<Vec<_>>().join(" ")
}
