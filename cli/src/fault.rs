//! An error that stops a command, in one line: the problem, its place, and the remedy.

use std::error::Error;
use std::io;

use fuseline_engine::ConfigError;
use fuseline_traces::ReadError;
use fuseline_traces::observed::{JudgeError, TimeOrderError};
use thiserror::Error;

/// The reason why a command stopped. Reasons of several commands are here. A reason of one command
/// alone is an error of that command's module.
#[derive(Debug, Error)]
pub(crate) enum Fault {
    #[error("{name}: {}; give a file that can be read, or - for standard input", plain(.source))]
    Open { name: String, source: io::Error },
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    Judge(#[from] JudgeError),
    #[error(transparent)]
    TimeOrderError(#[from] TimeOrderError),
    #[error("{name}: {}; {}", plain(.source), room(.source))]
    Create { name: String, source: io::Error },
    #[error("{name}: {}; name a folder that can be written to", plain(.source))]
    Folder { name: String, source: io::Error },
    #[error(
        "{output}: this is the same file as the input {input}; name another file for the output"
    )]
    Same { output: String, input: String },
    #[error("{name}:1: {source}; correct the header")]
    Config { name: String, source: ConfigError },
    #[error("standard output: {}", plain(.0))]
    Output(io::Error),
    #[error("cannot start a thread: {}; end other programs first", plain(.0))]
    Runtime(io::Error),
    #[error(transparent)]
    Own(Box<dyn Error + Send + Sync>),
}

impl Fault {
    /// Returns an error of one command alone.
    pub(crate) fn own(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Own(Box::new(error))
    }

    /// Returns `true` if the reader of the output has gone away, which is no error.
    pub(crate) fn is_broken_pipe(&self) -> bool {
        matches!(self, Self::Output(error) if error.kind() == io::ErrorKind::BrokenPipe)
    }
}

/// Returns the remedy for a file that cannot be written.
fn room(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "make room, or give a file on another disk"
        }
        _ => "give a file in a directory that can be written to",
    }
}

/// Returns the cause of an error in words, without the system's error number, and without the path
/// of a file that the user does not know.
pub(crate) fn plain(error: &(dyn Error + 'static)) -> String {
    let mut innermost = error;
    while let Some(source) = innermost.source() {
        innermost = source;
    }
    let Some(io) = innermost.downcast_ref::<io::Error>().or_else(|| error.downcast_ref()) else {
        return innermost.to_string();
    };
    let text = match (io.raw_os_error(), io.kind()) {
        (Some(code), _) => io::Error::from_raw_os_error(code).to_string(),
        // A temporary file's path would follow.
        (None, io::ErrorKind::NotFound) => "No such file or directory".to_owned(),
        (None, io::ErrorKind::PermissionDenied) => "Permission denied".to_owned(),
        (None, io::ErrorKind::StorageFull) => "No space left on device".to_owned(),
        (None, io::ErrorKind::ReadOnlyFilesystem) => "Read-only file system".to_owned(),
        (None, _) => io.to_string(),
    };
    text.split(" (os error").next().unwrap_or_default().to_owned()
}

pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns an error with what caused it, as one line.
pub(crate) fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        let cause = error.to_string();
        // Some errors name their cause themselves.
        if !text.ends_with(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
        source = error.source();
    }
    one_line(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Error)]
    #[error("{text}")]
    struct CausedError {
        text: &'static str,
        source: Option<Box<Self>>,
    }

    #[test]
    fn an_error_names_each_of_its_causes_once() {
        let caused =
            |text, source: Option<CausedError>| CausedError { text, source: source.map(Box::new) };
        let full = caused("disk full", None);
        let write = caused("cannot write: disk full", Some(full));
        assert_eq!(chain(&write), "cannot write: disk full");
        assert_eq!(chain(&caused("no page", Some(write))), "no page: cannot write: disk full");
    }
}
