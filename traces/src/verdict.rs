//! The verdict of either judge on one trace.

use std::fmt;

use serde::Serialize;

use crate::doubt::{self, Doubt, DoubtKind};
use crate::rule::Rule;

/// The number of violations that a verdict lists. It counts the others.
const LISTED: usize = 100;
/// The greatest number of other violations whose places a verdict stores.
const PLACES: usize = 1 << 20;

/// The verdict on one trace.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Verdict {
    /// The name that the trace was given.
    pub file: String,
    /// `true` if there is no violation and every doubt is accepted.
    pub conforms: bool,
    /// The number of judged timestamps: those that were opened and have a result, a failure, an
    /// emit or a miss.
    pub judged: u64,
    /// The number of lines in the trace, with the header.
    pub lines: u64,
    /// The doubts that are left.
    pub doubts: Vec<Doubt>,
    /// The cause that explains most violations of an observed trace, if one cause does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// The violations, up to 100.
    pub violations: Vec<Violation>,
    /// The number of further violations.
    #[serde(skip_serializing_if = "is_zero")]
    pub more: u64,
    /// The places of the further violations, if they were wanted; see
    /// [`Judge::with_places`](crate::Judge::with_places).
    #[serde(skip)]
    pub places: Vec<ViolationPlace>,
}

/// The place of a violation, without its details.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ViolationPlace {
    /// The line of the [`Violation`].
    pub line: u64,
    /// The timestamp that it is about.
    pub t: Option<u64>,
    /// The rule that is broken.
    pub rule: Rule,
}

/// A decision that the rules do not demand or, in an observed trace, a timestamp that they cannot
/// explain or a gap between opens.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Violation {
    /// The line, counted from 1. If a decision is missing, it is the line after which the decision
    /// should stand. If an observed output is missing, it is the timestamp's last line.
    pub line: u64,
    /// The timestamp that it is about. For a gap, it is the timestamp that was opened after the
    /// gap, or the last one if the gap is at the end. `None` if no timestamp was opened.
    pub t: Option<u64>,
    /// The rule or promise that is broken.
    pub rule: Rule,
    /// The line or the outputs that were found, or a note that there is none.
    pub found: String,
    /// The line that the rules demand or the outputs that they allow, or a note that there is none.
    pub expected: String,
    /// The time by which an observed output is too late, in ns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late: Option<u64>,
    /// The last lines about the timestamp, with their numbers.
    #[serde(skip)]
    pub story: Vec<String>,
}

impl Verdict {
    /// Creates the verdict on a trace of which only the header was read.
    pub(crate) const fn new(file: String) -> Self {
        Self {
            file,
            conforms: true,
            judged: 0,
            lines: 1,
            doubts: Vec::new(),
            cause: None,
            violations: Vec::new(),
            more: 0,
            places: Vec::new(),
        }
    }

    /// Counts a violation: lists the first 100, and stores the places of others if they are wanted.
    pub fn count(
        &mut self,
        place: ViolationPlace,
        keeps_places: bool,
        violation: impl FnOnce() -> Violation,
    ) {
        self.conforms = false;
        if self.violations.len() < LISTED {
            self.violations.push(violation());
            return;
        }
        self.more += 1;
        if keeps_places && self.places.len() < PLACES {
            self.places.push(place);
        }
    }

    /// Accepts these kinds of doubt.
    #[must_use]
    pub fn accepting(mut self, kinds: &[DoubtKind]) -> Self {
        self.conforms = doubt::accept(&mut self.doubts, kinds) && self.broken() == 0;
        self
    }

    /// Adds a doubt that the reader of the trace has.
    #[must_use]
    pub fn doubting(mut self, doubt: Doubt) -> Self {
        self.doubts.push(doubt);
        self.accepting(&[])
    }

    /// Sorts the violations by their lines.
    #[must_use]
    pub fn sorted(mut self) -> Self {
        self.violations.sort_by_key(|violation| violation.line);
        self
    }

    /// Returns the number of all violations, with those that are not listed.
    #[must_use]
    pub const fn broken(&self) -> u64 {
        self.violations.len() as u64 + self.more
    }

    /// Describes the verdict in a few words, such as *conforms*.
    #[must_use]
    pub fn in_short(&self) -> String {
        doubt::in_short(self.broken(), &self.doubts)
    }
}

impl Violation {
    /// Returns its place.
    #[must_use]
    pub const fn place(&self) -> ViolationPlace {
        ViolationPlace { line: self.line, t: self.t, rule: self.rule }
    }
}

impl fmt::Display for Verdict {
    /// Writes the verdict in one line, then each violation in a few.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, judged, lines, .. } = self;
        let word = self.in_short();
        write!(f, "{file}: {word}; {judged} timestamps judged in {lines} lines")?;
        for doubt in &self.doubts {
            write!(f, "\n  {doubt}")?;
        }
        for violation in &self.violations {
            write!(f, "\n{file}:{violation}")?;
        }
        if self.more > 0 {
            write!(f, "\n{} more violations", self.more)?;
        }
        Ok(())
    }
}

impl fmt::Display for Violation {
    /// Writes the line, the violation and the story, without the file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, rule, found, expected, .. } = self;
        write!(f, "{line}: ")?;
        if let Some(t) = self.t {
            write!(f, "timestamp {t} ")?;
        }
        write!(f, "breaks {rule}: {}", rule.sentence())?;
        write!(f, "\n  found    {found}\n  expected {expected}")?;
        for line in &self.story {
            write!(f, "\n  | {line}")?;
        }
        Ok(())
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
const fn is_zero(number: &u64) -> bool {
    *number == 0
}
