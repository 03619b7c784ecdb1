//! [`Log`]: the events of a whole log, on their way to one trace, or to one for each run.

use std::collections::HashMap;

use crate::convert::entry::{Entry, Sources};
use crate::convert::recorded::ConvertError;
use crate::convert::restart::{Restart, restarts};
use crate::convert::row::{Notes, Place};
use crate::convert::value::{Id, shown};

/// Decisions that only a strict trace has; there the order of lines has a meaning.
const STRICT: [&str; 7] = ["offer", "timer", "refuse", "hold", "drop", "final", "cancel"];
/// How far apart results may be before the later one is the last one: some clocks have whole milliseconds.
pub(super) const CLOCK_STEP: i128 = 1_000_000;
/// No robot's messages come faster, or so slowly.
const PERIODS: std::ops::RangeInclusive<i128> = 10_000..=3_600_000_000_000;
/// Of fewer messages nothing can be said.
const FEW: usize = 3;
const DAY: i128 = 86_400_000_000_000;

const GUESSED: &str = "outputs that do not say whose result they are (the last one was taken)";
const DISORDER: &str = "events that stood behind later ones and were put in order";
const REPEATED: &str = "events that repeat an earlier one in every value";
pub(super) const TWICE: &str = "messages whose id was opened before";
pub(super) const BACKWARDS: &str = "messages with a lower id than the one before";
const TEXTS: &str = "messages numbered in their order, since ids are texts (x keeps them)";
const MIXED: &str = "lines whose id is no whole number, though others are";
const NEGATIVE: &str = "instants before 0; all were moved";
const UNREGISTERED: &str = "events of sources that the header does not have";
const EARLY: &str = "results before their requests";
const UNORDERED: &str = "places where the log seems to restart, taken for one run as --sort says";
const GAPS: &str = "instants more than a day after the one before";

/// The events of a log in the order of the file.
#[derive(Default, Debug)]
pub(super) struct Log {
    pub(super) entries: Vec<Entry>,
    pub(super) rows: u64,
    /// What was read, in words.
    pub(super) files: Vec<String>,
    pub(super) kind: LogKind,
    /// Whether messages have ids of their own, and are not counted.
    pub(super) has_ids: bool,
}

/// How a log's events stand in its file.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(super) enum LogKind {
    #[default]
    Events,
    Frames,
    /// In no order.
    Spans,
}

/// What the user says of the order.
#[derive(Clone, Copy, Default, Debug)]
pub(super) struct OrderOptions {
    pub(super) is_sorted: bool,
    pub(super) is_split: bool,
    pub(super) is_unique: bool,
}

/// The events of one run, in the order of their instants, and how its lines are written.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) entries: Vec<Entry>,
    pub(super) shift: i128,
    /// The numbers of ids, if some are texts.
    numbers: Option<HashMap<Id, u64>>,
}

impl Log {
    fn is_strict(&self) -> bool {
        self.entries.iter().any(|entry| STRICT.contains(&entry.ev))
    }

    /// Finds out whose the outputs are that do not say so: that source's whose result came last before them.
    ///
    /// # Errors
    /// If two came last.
    pub(super) fn guess(
        &mut self,
        notes: &mut Notes,
        sources: &Sources,
    ) -> Result<(), ConvertError> {
        let mut results: HashMap<Id, Vec<(i128, u64)>> = HashMap::new();
        for entry in self.entries.iter().filter(|entry| entry.ev == "result") {
            if let (Some(t), Some(p)) = (&entry.t, entry.p) {
                results.entry(t.clone()).or_default().push((entry.at, p));
            }
        }
        let is_guessed = |entry: &&mut Entry| entry.ev == "emit" && entry.p.is_none();
        for entry in self.entries.iter_mut().filter(is_guessed) {
            let of_message = entry.t.as_ref().and_then(|t| results.get(t));
            let before =
                of_message.into_iter().flatten().filter(|(at, _)| *at <= entry.at + CLOCK_STEP);
            let before: Vec<(i128, u64)> = before.copied().collect();
            let Some((last, p)) = before.iter().max().copied() else {
                if self.kind == LogKind::Spans {
                    entry.ev = "miss";
                    let kind = "messages that end without a result, read as given up";
                    notes.add(kind, &entry.place, String::new);
                    continue;
                }
                let message = "the output does not say whose result it is, and its message has none before it";
                return Err(ConvertError::at(&entry.place, message));
            };
            let other = before.iter().find(|(at, other)| *other != p && last - at < CLOCK_STEP);
            if let Some((_, other)) = other {
                let (one, other) = (sources.name(p), sources.name(*other));
                let remedy = match self.kind {
                    LogKind::Spans => "--attribute by=NAME",
                    LogKind::Frames => "--frame by=COLUMN",
                    LogKind::Events => "--column p=NAME",
                };
                let message = format!(
                    "the output does not say whose result it is, and those of {one} and {other} came at once; name \
                     what says so with {remedy}"
                );
                return Err(ConvertError::at(&entry.place, &message));
            }
            entry.p = Some(p);
            notes.add_with(
                GUESSED,
                &entry.place,
                || sources.name(p),
                || match self.kind {
                    LogKind::Spans => "--attribute by=NAME names what says so".to_owned(),
                    LogKind::Frames => "--frame by=COLUMN names what says so".to_owned(),
                    LogKind::Events => "--column p=NAME names what says so".to_owned(),
                },
            );
        }
        Ok(())
    }

    /// Notes sources by a number that the header does not have.
    pub(super) fn note_unregistered(&self, notes: &mut Notes, sources: &Sources) {
        if self.is_strict() {
            return;
        }
        for entry in &self.entries {
            if let Some(p) = entry.p.filter(|p| !sources.is_registered(*p)) {
                notes.add(UNREGISTERED, &entry.place, || format!("p {p}"));
            }
        }
    }

    /// Counts events that came twice, and leaves them out if they are to be.
    pub(super) fn repeated(&mut self, notes: &mut Notes, is_unique: bool) -> Vec<bool> {
        let mut seen: HashMap<String, Place> = HashMap::new();
        let mut repeats = Vec::with_capacity(self.entries.len());
        if self.is_strict() {
            return vec![false; self.entries.len()];
        }
        for entry in &self.entries {
            let first = (entry.ev != "tick").then(|| seen.get(&entry.content()).cloned()).flatten();
            if let Some(first) = &first {
                let remedy = if is_unique {
                    "they were left out"
                } else {
                    "if something was logged twice, leave them out with --unique"
                };
                let detail = || format!("as at {}", first.within());
                notes.add_with(REPEATED, &entry.place, detail, || remedy.to_owned());
            } else {
                seen.insert(entry.content(), entry.place.clone());
            }
            repeats.push(first.is_some());
        }
        if is_unique {
            let mut kept = repeats.iter().map(|is_repeated| !is_repeated);
            self.entries.retain(|_| kept.next().unwrap_or(true));
            repeats = vec![false; self.entries.len()];
        }
        repeats
    }

    /// The runs of the log, each in the order of its instants, and where those after the first begin.
    ///
    /// # Errors
    /// If the log restarts and is not to be split.
    pub(super) fn runs(
        mut self,
        options: OrderOptions,
        notes: &mut Notes,
    ) -> Result<(Vec<Run>, Vec<Restart>), ConvertError> {
        let repeats = self.repeated(notes, options.is_unique);
        let shift = self.shift(notes);
        if self.is_strict() && !options.is_sorted {
            return Ok((vec![Run::new(self.entries, shift, notes)], Vec::new()));
        }
        let mut found = restarts(&self, &repeats, notes);
        // Without numbers as ids, an order that the user denies says nothing.
        if options.is_sorted && !options.is_split && !self.has_numbers() {
            for Restart { place, message, .. } in found.drain(..) {
                notes.add(UNORDERED, &place, || message);
            }
        }
        if let (Some(Restart { place, message, .. }), false) = (found.first(), options.is_split) {
            let more = match found.len() {
                1 => String::new(),
                count => format!(" ({count} restarts in all)"),
            };
            let message = format!("{message}{more}; --split writes one trace for each run");
            return Err(ConvertError::at(place, &message));
        }
        let mut parts = Vec::new();
        for restart in found.iter().rev() {
            parts.push(self.entries.split_off(restart.entry));
        }
        parts.push(self.entries);
        parts.reverse();
        let is_ordered = self.kind == LogKind::Events && !options.is_sorted;
        let run = |mut entries: Vec<Entry>| {
            if is_ordered {
                note_disorder(&entries, notes);
            }
            entries.sort_by_key(|entry| entry.at);
            Run::new(entries, shift, notes)
        };
        Ok((parts.into_iter().map(run).collect(), found))
    }

    /// Whether messages have numbers as ids, whose order can be compared with that of their instants.
    fn has_numbers(&self) -> bool {
        let mut ids = self.entries.iter().filter_map(|entry| entry.t.as_ref());
        self.has_ids && ids.all(|id| matches!(id, Id::Number(_)))
    }

    /// By how much instants are moved so that none is negative.
    fn shift(&self, notes: &mut Notes) -> i128 {
        let Some(first) = self.entries.iter().min_by_key(|entry| entry.at) else { return 0 };
        if first.at >= 0 {
            return 0;
        }
        let shift = -first.at;
        for entry in self.entries.iter().filter(|entry| entry.at < 0) {
            notes.add(NEGATIVE, &entry.place, || format!("by {}", shown(shift)));
        }
        shift
    }
}

/// Counts events that stand behind later ones.
fn note_disorder(entries: &[Entry], notes: &mut Notes) {
    let mut latest: Option<&Entry> = None;
    for entry in entries {
        match latest {
            Some(later) if entry.at < later.at => {
                let by =
                    || format!("{} before {}", shown(later.at - entry.at), later.place.within());
                notes.add(DISORDER, &entry.place, by);
            }
            _ => latest = Some(entry),
        }
    }
}

/// Counts texts among ids that are numbers: one of them may be a slip.
fn note_mixed(entries: &[Entry], notes: &mut Notes) {
    if !entries.iter().any(|entry| matches!(entry.t, Some(Id::Number(_)))) {
        return;
    }
    for entry in entries {
        if let Some(Id::Text(text)) = &entry.t {
            notes.add(MIXED, &entry.place, || text.to_string());
        }
    }
}

impl Run {
    fn new(entries: Vec<Entry>, shift: i128, notes: &mut Notes) -> Self {
        let is_text = |id: &Option<Id>| matches!(id, Some(Id::Text(_)));
        let has_texts = entries.iter().any(|entry| is_text(&entry.t) || is_text(&entry.of));
        let numbers = has_texts.then(|| {
            let mut numbers = HashMap::new();
            for id in entries.iter().flat_map(|entry| [&entry.t, &entry.of]).flatten() {
                let next = numbers.len() as u64;
                numbers.entry(id.clone()).or_insert(next);
            }
            note_mixed(&entries, notes);
            for entry in entries.iter().filter(|entry| entry.ev == "open") {
                if let Some(t) = &entry.t {
                    notes.add(TEXTS, &entry.place, || format!("{t} is {}", numbers[t]));
                }
            }
            numbers
        });
        Self { entries, shift, numbers }
    }

    /// Appends an entry's line, without its end.
    ///
    /// # Errors
    /// If it is no event of a trace.
    pub(super) fn write(&self, entry: &Entry, line: &mut Vec<u8>) -> Result<(), ConvertError> {
        let number = |id: &Id| match (&self.numbers, id) {
            (Some(numbers), id) => numbers.get(id).copied().unwrap_or(u64::MAX),
            (None, Id::Number(number)) => *number,
            (None, Id::Text(_)) => u64::MAX,
        };
        let read = entry.line(self.shift, &number);
        let (event, annotations) = read.map_err(|why| ConvertError::at(&entry.place, &why))?;
        event.write_annotated(&annotations, line);
        if let (Some(_), Some(t)) = (&self.numbers, &entry.t) {
            line.pop();
            line.extend(format!(",\"x\":{}}}", serde_json::Value::from(t.to_string())).bytes());
        }
        Ok(())
    }

    /// Notes what makes a verdict on this run worth little.
    pub(super) fn doubt(&self, notes: &mut Notes) {
        let (Some(first), Some(last)) = (self.entries.first(), self.entries.last()) else { return };
        // A strict trace may be drawn, and its instants anything.
        if self.entries.iter().any(|entry| STRICT.contains(&entry.ev)) {
            return;
        }
        let span = last.at - first.at;
        let requests =
            || self.entries.iter().filter(|entry| entry.ev == "request" && entry.due.is_some());
        let had = |entry: &Entry| entry.due.unwrap_or(entry.at) - entry.at;
        let shortest = requests().min_by_key(|entry| had(entry));
        let is_any_due = requests().any(|entry| entry.due.is_some_and(|due| due <= last.at));
        let opens = self.entries.iter().filter(|entry| entry.ev == "open").count();
        if let Some(shortest) = shortest
            && opens >= FEW
            && !is_any_due
            && had(shortest) > span
        {
            let (had, span) = (shown(had(shortest)), shown(span));
            let detail = format!(
                "the shortest has {had}, the log lasts {span}; is --unit right, such as --unit deadline=ms?"
            );
            notes.add_of_file("no deadline ends within the log", &shortest.place.file, detail);
        }
        self.doubt_order(notes);
        self.doubt_instants(notes);
    }

    /// Notes results that are recorded before their requests: another clock, or no instants at all.
    fn doubt_order(&self, notes: &mut Notes) {
        let mut requests: HashMap<(&Id, u64), i128> = HashMap::new();
        for entry in self.entries.iter().filter(|entry| entry.ev == "request") {
            if let (Some(t), Some(p)) = (&entry.t, entry.p) {
                let first = requests.entry((t, p)).or_insert(entry.at);
                *first = entry.at.min(*first);
            }
        }
        for entry in self.entries.iter().filter(|entry| entry.ev == "result") {
            let (Some(t), Some(p)) = (&entry.t, entry.p) else { continue };
            let early = requests.get(&(t, p)).map_or(0, |request| request - entry.at);
            if early > CLOCK_STEP {
                let remedy = || "is each an instant, and of one clock?".to_owned();
                notes.add_with(EARLY, &entry.place, || format!("by {}", shown(early)), remedy);
            }
        }
    }

    /// Notes instants that lie far from the others, or too close together.
    fn doubt_instants(&self, notes: &mut Notes) {
        for pair in self.entries.windows(2) {
            let gap = pair[1].at - pair[0].at;
            if gap > DAY {
                notes.add(GAPS, &pair[1].place, || {
                    format!("{} after {}", shown(gap), pair[0].place.within())
                });
            }
        }
        let opens: Vec<i128> =
            self.entries.iter().filter(|entry| entry.ev == "open").map(|entry| entry.at).collect();
        let mut periods: Vec<i128> = opens.windows(2).map(|pair| pair[1] - pair[0]).collect();
        periods.sort_unstable();
        let Some(period) = periods.get(periods.len() / 2).filter(|_| opens.len() >= FEW) else {
            return;
        };
        if !PERIODS.contains(period) {
            let detail = format!("messages come every {}; is --unit right?", shown(*period));
            notes.add_of_file("doubtful instants", &self.entries[0].place.file, detail);
        }
    }
}
