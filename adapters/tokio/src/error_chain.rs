//! Displays an error with its causes.

use std::error::Error;
use std::fmt;

/// Displays `error: its cause: the cause's cause`, without the causes that the text before them
/// already names.
pub(crate) struct ErrorChain<'a>(pub(crate) &'a (dyn Error + 'static));

impl fmt::Display for ErrorChain<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut logged = self.0.to_string();
        let mut cause = self.0.source();
        while let Some(error) = cause {
            let words = error.to_string();
            if !logged.contains(&words) {
                logged.push_str(": ");
                logged.push_str(&words);
            }
            cause = error.source();
        }
        f.write_str(&logged)
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("{0}")]
    struct TopCause(&'static str, #[source] io::Error);

    #[test]
    fn a_cause_is_named_once() {
        let cause = || io::Error::other("connection refused");
        assert_eq!(
            ErrorChain(&TopCause("no call", cause())).to_string(),
            "no call: connection refused"
        );
        let reported = TopCause("no call, connection refused", cause());
        assert_eq!(ErrorChain(&reported).to_string(), "no call, connection refused");
    }
}
