//! The reasons why results did not come, with their counts.

use std::fmt;
use std::sync::Arc;

/// The number of reasons that are counted separately.
const KINDS: usize = 8;
/// The number of bytes of a reason that are kept.
const BYTES: usize = 200;

/// The reasons of a source's accepted failures (F4), and how often each was given.
///
/// The first eight are counted separately, and all others together.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Reasons {
    known: Vec<(Arc<str>, u64)>,
    others: u64,
}

impl Reasons {
    /// Counts a reason. Returns its text, shared.
    pub(crate) fn count(&mut self, why: &str) -> Arc<str> {
        if let Some((known, count)) = self.known.iter_mut().find(|(known, _)| **known == *why) {
            *count += 1;
            return Arc::clone(known);
        }
        let why: Arc<str> = why.into();
        if self.known.len() < KINDS {
            self.known.push((Arc::clone(&why), 1));
        } else {
            self.others += 1;
        }
        why
    }

    /// Returns the reasons that are counted separately, in the order in which they first came.
    pub fn iter(&self) -> impl Iterator<Item = (&str, u64)> {
        self.known.iter().map(|(why, count)| (&**why, *count))
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
