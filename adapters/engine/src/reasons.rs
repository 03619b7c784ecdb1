//! The reasons why results did not come, with their counts.

use std::fmt;
use std::sync::Arc;

/// The number of reasons that are counted separately.
const KINDS: usize = 8;
/// The number of bytes of a reason that are kept.
const BYTES: usize = 200;

/// The reasons of a source's accepted failures (F4), and how often each was given.
///
/// The eight that were given last are counted separately, and all others together. So a reason that
/// is new today is named, whatever went wrong before.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Reasons {
    known: Vec<KnownReason>,
    others: u64,
    /// The number of reasons given so far.
    given: u64,
}

/// A reason that is counted separately.
#[derive(Clone, PartialEq, Eq, Debug)]
struct KnownReason {
    why: Arc<str>,
    count: u64,
    /// The value of `given` when it was given last.
    last: u64,
}

impl Reasons {
    /// Counts a reason. Returns its text, shared.
    pub(crate) fn count(&mut self, why: &str) -> Arc<str> {
        self.given += 1;
        let last = self.given;
        if let Some(known) = self.known.iter_mut().find(|known| *known.why == *why) {
            known.count += 1;
            known.last = last;
            return Arc::clone(&known.why);
        }
        if self.known.len() >= KINDS
            && let Some(oldest) = (0..KINDS).min_by_key(|index| self.known[*index].last)
        {
            self.others += self.known.remove(oldest).count;
        }
        let why: Arc<str> = why.into();
        self.known.push(KnownReason { why: Arc::clone(&why), count: 1, last });
        why
    }

    /// Returns the reasons that are counted separately, in the order in which they first came.
    pub fn iter(&self) -> impl Iterator<Item = (&str, u64)> {
        self.known.iter().map(|known| (&*known.why, known.count))
    }

    /// Returns the number of failures with other reasons.
    #[must_use]
    pub const fn others(&self) -> u64 {
        self.others
    }
}

/// Writes `30 × connection refused, 2 × deadline exceeded`, or nothing if there are no reasons.
impl fmt::Display for Reasons {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (why, count)) in self.iter().enumerate() {
            let comma = if index > 0 { ", " } else { "" };
            write!(f, "{comma}{count} × {why}")?;
        }
        if self.others > 0 {
            write!(f, ", {} × other reasons", self.others)?;
        }
        Ok(())
    }
}

/// Returns the beginning of a reason's text.
pub(crate) fn to_text(why: &dyn fmt::Display) -> String {
    let mut text = why.to_string();
    if text.len() > BYTES {
        let end = '…'.len_utf8();
        let cut = (0..=BYTES - end).rev().find(|index| text.is_char_boundary(*index));
        text.truncate(cut.unwrap_or(0));
        text.push('…');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_reason_takes_the_place_of_the_oldest() {
        let mut reasons = Reasons::default();
        for kind in 0..KINDS {
            reasons.count(&format!("reason {kind}"));
        }
        reasons.count("reason 0");
        reasons.count("certificate expired");
        let named: Vec<_> = reasons.iter().collect();
        assert_eq!(
            (named.len(), named[0], named[KINDS - 1]),
            (8, ("reason 0", 2), ("certificate expired", 1))
        );
        assert!(named.iter().all(|(why, _)| *why != "reason 1"));
        assert_eq!(reasons.others(), 1);
    }
}
