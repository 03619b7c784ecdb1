//! The last lines of a trace, for the story of a violation.

use std::collections::{BTreeMap, VecDeque};

use crate::annotations::Annotations;
use crate::event::Event;

/// How many lines back a story is looked for.
const RECENT: usize = 16 * 1024;
/// How many lines a story has.
const STORY: usize = 12;

/// The last lines with their numbers.
#[derive(Debug, Default)]
pub(crate) struct RecentLines {
    lines: VecDeque<(u64, Event)>,
    /// What stands on some of them besides, without the text of origins, which may be long.
    annotations: BTreeMap<u64, Annotations>,
}

impl RecentLines {
    pub(crate) fn push(&mut self, line: u64, event: &Event, annotations: &Annotations) {
        if self.lines.len() == RECENT
            && let Some((oldest, _)) = self.lines.pop_front()
            && !self.annotations.is_empty()
        {
            self.annotations.remove(&oldest);
        }
        self.lines.push_back((line, *event));
        if !annotations.is_empty() {
            let Annotations { of, attempt, within, age, origin: _ } = *annotations;
            let shown = Annotations { of, attempt, within, age, origin: None };
            self.annotations.insert(line, shown);
        }
    }

    /// From the first to the last.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &(u64, Event)> {
        self.lines.iter()
    }

    /// The last ones about a timestamp, and `cause`, a line whatever it is about.
    pub(crate) fn story(&self, t: u64, cause: Option<u64>) -> Vec<String> {
        let of_t = |(line, event): &&(u64, Event)| event.t() == Some(t) || Some(*line) == cause;
        let reported: Vec<_> = self.lines.iter().filter(of_t).collect();
        let left_out = reported.len().saturating_sub(STORY);
        let lead = (left_out > 0).then(|| format!("({left_out} earlier lines left out)"));
        let lines = reported.iter().skip(left_out).map(|(line, event)| {
            let annotations = self.annotations.get(line).unwrap_or(&Annotations::NONE);
            format!("{line}: {}", event.annotated(annotations))
        });
        lead.into_iter().chain(lines).collect()
    }
}
