//! `--deadline`: how long requests have that do not say so.

use crate::convert::value::{self, Unit};

/// How long requests have that do not say so.
#[derive(Clone, Default, Debug)]
pub(super) struct Deadlines(Vec<(Option<String>, u64)>);

/// `TIME`, or `SOURCE=TIME`.
///
/// # Errors
/// What to write instead.
pub(super) fn deadline(text: &str) -> Result<(Option<String>, u64), String> {
    let (source, time) = match text.rsplit_once('=') {
        Some((source, time)) => (Some(source.to_owned()), time),
        None => (None, text),
    };
    let nanos = humantime::parse_duration(time).ok().map(|time| i128::try_from(time.as_nanos()));
    let nanos = match nanos {
        Some(Ok(nanos)) => Some(nanos),
        _ if time.ends_with('s') => value::duration(time, Unit::Ns).ok().map(|time| time.nanos),
        _ => None,
    };
    let nanos = nanos.and_then(|nanos| u64::try_from(nanos).ok());
    let nanos = nanos.ok_or("it must be a time with a unit, such as 40ms, or SOURCE=TIME")?;
    Ok((source, nanos))
}

impl Deadlines {
    pub(super) fn new(given: &[(Option<String>, u64)]) -> Self {
        Self(given.to_vec())
    }

    /// The deadline of a source's requests, if one was given.
    pub(super) fn of(&self, source: &str) -> Option<u64> {
        let find = |name: Option<&str>| {
            let found = self.0.iter().rev().find(|(known, _)| known.as_deref() == name);
            found.map(|(_, nanos)| *nanos)
        };
        find(Some(source)).or_else(|| find(None))
    }
}
