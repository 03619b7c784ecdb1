//! The last lines of a trace, for the story of a violation.

use std::collections::BTreeMap;

use crate::annotations::Annotations;
use crate::event::Event;

/// The number of last lines in which a story is looked for.
const RECENT: usize = 16 * 1024;
/// The number of lines in a story.
const STORY: usize = 12;

/// The last lines with their numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecentLines {
    /// The lines, which are a ring once it is full.
    lines: Vec<(u64, Event)>,
    /// The index of the oldest line.
    first: usize,
    is_full: bool,
    /// The further keys of some lines, without texts, which may be long.
    annotations: BTreeMap<u64, Annotations>,
}

impl RecentLines {
    pub(crate) fn push(&mut self, line: u64, event: &Event, annotations: &Annotations) {
        let mut oldest = None;
        if self.is_full
            && let Some(place) = self.lines.get_mut(self.first)
        {
            oldest = Some(place.0);
            *place = (line, *event);
            self.first = (self.first + 1) % RECENT;
        } else {
            self.grow(line, event);
        }
        if !(self.annotations.is_empty() && annotations.is_empty()) {
            self.annotate(oldest, line, annotations);
        }
    }

    #[cold]
    fn grow(&mut self, line: u64, event: &Event) {
        self.lines.push((line, *event));
        self.is_full = self.lines.len() == RECENT;
    }

    /// Notes the further keys of a line, in place of the oldest line's.
    #[cold]
    fn annotate(&mut self, oldest: Option<u64>, line: u64, annotations: &Annotations) {
        if let Some(oldest) = oldest {
            self.annotations.remove(&oldest);
        }
        if !annotations.is_empty() {
            let &Annotations { of, meant_for, attempt, within, age, .. } = annotations;
            let shown = Annotations { of, meant_for, attempt, within, age, ..Annotations::NONE };
            self.annotations.insert(line, shown);
        }
    }

    /// Returns the lines from the first to the last.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &(u64, Event)> {
        let (newer, older) = self.lines.split_at_checked(self.first).unwrap_or_default();
        older.iter().chain(newer)
    }

    /// Returns the first line about a timestamp, its last ones, and the line `cause`, whatever it
    /// is about.
    pub(crate) fn story(&self, t: u64, cause: Option<u64>) -> Vec<String> {
        let of_t = |(line, event): &&(u64, Event)| event.t() == Some(t) || Some(*line) == cause;
        let reported: Vec<_> = self.iter().filter(of_t).collect();
        let text = |(line, event): &(u64, Event)| {
            let shown = self.annotations.get(line);
            format!("{line}: {}", shown.map_or_else(|| event.to_string(), |it| event.annotated(it)))
        };
        if reported.len() <= STORY {
            return reported.into_iter().map(text).collect();
        }
        let left_out = reported.len() - STORY;
        let lead = reported.first().map(|first| text(first));
        let gap = format!("({left_out} lines left out)");
        let last = reported.iter().skip(left_out + 1).map(|line| text(line));
        lead.into_iter().chain([gap]).chain(last).collect()
    }
}
