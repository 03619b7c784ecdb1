//! Explains in plain words why a call failed.

use std::error::Error;
use std::fmt;
use std::io;

use tonic::{Status, transport};

/// Describes why a call failed in a few plain words, such as `connection refused` or `a bearer
/// token is needed`. It names the innermost cause. The [`Status`] has the details.
#[derive(Clone, Debug)]
pub struct CallError(Status);

impl CallError {
    /// The words for a connection that broke.
    pub const BROKE: &str = "the connection broke";

    /// Returns the status from the server, or from the connection to it.
    #[must_use]
    pub const fn status(&self) -> &Status {
        &self.0
    }
}

impl From<Status> for CallError {
    fn from(status: Status) -> Self {
        Self(status)
    }
}

// There is no source, because the text already names the innermost cause.
impl Error for CallError {}

impl fmt::Display for CallError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let status = &self.0;
        let (mut is_transport, mut innermost) = (false, None);
        let mut next = status.source();
        while let Some(cause) = next {
            is_transport |= cause.is::<transport::Error>();
            innermost = Some(cause);
            next = cause.source();
        }
        match innermost {
            Some(cause) => match cause.downcast_ref() {
                // HTTP/2 has many texts for a broken connection, and it is chance which of them
                // comes.
                Some(io) if is_broken(io) => f.write_str(Self::BROKE),
                Some(io) => f.write_str(&plain(io)),
                None if is_transport => f.write_str(Self::BROKE),
                None => write!(f, "{cause}"),
            },
            None if status.message().is_empty() => f.write_str(status.code().description()),
            None => f.write_str(status.message()),
        }
    }
}

fn is_broken(error: &io::Error) -> bool {
    use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
    matches!(error.kind(), BrokenPipe | ConnectionAborted | ConnectionReset | UnexpectedEof)
}

/// Returns the error's text as part of a sentence, such as `connection refused`, without the
/// system's error number. The time at which a certificate was verified is left out too, or tallies
/// would have a new reason for each second.
fn plain(error: &io::Error) -> String {
    let words = error.to_string();
    if words.contains("InvalidContentType") {
        return "the server does not speak TLS".to_owned();
    }
    if error.kind() == io::ErrorKind::TimedOut {
        return "no connection in time".to_owned();
    }
    let ends = [" (os error", ": verification time"].map(|rest| words.find(rest));
    let words = &words[..ends.into_iter().flatten().min().unwrap_or(words.len())];
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}
