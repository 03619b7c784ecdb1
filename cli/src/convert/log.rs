//! [`Log`]: the events of a whole log, on their way to one trace, or to one for each run.

use std::collections::{HashMap, HashSet};

use crate::convert::Args;
use crate::convert::entry::{Entry, Sources};
use crate::convert::notes::Notes;
use crate::convert::restart::{Restart, restarts};
use crate::convert::row::{Place, Problem};
use crate::convert::time::Id;
use crate::duration::in_words;

/// Decisions that only a strict trace has; there the order of lines has a meaning.
const STRICT: [&str; 7] = ["offer", "timer", "refuse", "hold", "drop", "final", "cancel"];
/// Results that are less than this apart count as simultaneous, because some clocks have whole
/// milliseconds.
pub(super) const CLOCK_STEP: i128 = 1_000_000;
/// No robot's messages come faster, or so slowly.
const PERIODS: std::ops::RangeInclusive<i128> = 10_000..=3_600_000_000_000;
/// A log with fewer messages has too little evidence.
const FEW: usize = 3;
const DAY: i128 = 86_400_000_000_000;
const MINUTE: i128 = 60_000_000_000;

const GUESSED: &str = "outputs that do not say whose result they are (the latest result was taken)";
const GIVEN_UP: &str = "messages that end without a result, read as given up";
const DISORDER: &str = "events that came after later ones and were sorted";
const REPEATED: &str = "events that repeat an earlier one in every value";
pub(super) const TWICE: &str = "messages whose id was opened before";
pub(super) const BACKWARDS: &str = "messages with a lower id than the one before";
const TEXTS: &str = "messages numbered in their order, because their ids are texts (x keeps them)";
const MIXED: &str = "lines whose id is not a whole number, although others are";
const NEGATIVE: &str = "instants before 0, so all instants were moved";
const UNREGISTERED: &str = "events of sources that the header does not have";
const EARLY: &str = "results before their requests";
const SILENT: &str = "outputs of a source without a request, a result or a failure";
const ZONES: &str = "events that lie hours, or half hours, from their message's open";
const UNORDERED: &str =
    "places where the log seems to restart, treated as one run because of --sort";
const GAPS: &str = "instants more than a day after the one before";

/// The events of a log in the order of the file.
#[derive(Default, Debug)]
pub(super) struct Log {
    pub(super) entries: Vec<Entry>,
    pub(super) rows: u64,
    /// Describes what was read.
    pub(super) files: Vec<String>,
    pub(super) kind: LogKind,
    /// `true` if messages have ids of their own, and are not counted.
    pub(super) has_ids: bool,
}

/// The order of a log's events in its file.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(super) enum LogKind {
    #[default]
    Events,
    Frames,
    /// In no order.
    Spans,
}

/// The order as the user states it.
#[derive(Clone, Copy, Default, Debug)]
pub(super) struct OrderOptions {
    pub(super) is_sorted: bool,
    pub(super) is_split: bool,
    pub(super) is_unique: bool,
}

impl OrderOptions {
    pub(super) const fn of(args: &Args) -> Self {
        Self { is_sorted: args.sort, is_split: args.split, is_unique: args.unique }
    }
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

    /// Finds out whose the outputs are that do not say so: that source's whose result came last
    /// before them.
    pub(super) fn guess(&mut self, notes: &mut Notes, sources: &Sources) -> Result<(), Problem> {
        let mut results: HashMap<Id, Vec<(i128, u64)>> = HashMap::new();
        for entry in self.entries.iter().filter(|entry| entry.ev == "result") {
            if let (Some(t), Some(p)) = (&entry.t, entry.p) {
                results.entry(t.clone()).or_default().push((entry.at, p));
            }
        }
        let is_guessed = |entry: &&mut Entry| entry.ev == "emit" && entry.p.is_none();
        for entry in self.entries.iter_mut().filter(is_guessed) {
            let all = entry.t.as_ref().and_then(|t| results.get(t)).into_iter().flatten();
            let before = all.filter(|(at, _)| *at <= entry.at + CLOCK_STEP);
            let option = match self.kind {
                LogKind::Spans => "--attribute by=NAME",
                LogKind::Frames => "--frame by=COLUMN",
                LogKind::Events => "--column p=NAME",
            };
            let Some((last, p)) = before.clone().max().copied() else {
                if self.kind == LogKind::Spans {
                    entry.ev = "miss";
                    notes.add(GIVEN_UP, &entry.place, String::new);
                    continue;
                }
                let message = format!(
                    "the output does not say whose result it is, and no result of its message came \
                     before it; name the source with {option}"
                );
                return Err(Problem::at(&entry.place, message));
            };
            let mut others = before.filter(|(at, other)| *other != p && last - at < CLOCK_STEP);
            if let Some((_, other)) = others.next() {
                let (one, other) = (sources.name(p), sources.name(*other));
                let message = format!(
                    "the output does not say whose result it is, and the results of {one} and \
                     {other} came at the same time; name the source with {option}"
                );
                return Err(Problem::at(&entry.place, message));
            }
            entry.p = Some(p);
            let remedy = || format!("if the log names the source, say where with {option}");
            notes.add_with(GUESSED, &entry.place, || sources.name(p), remedy);
        }
        Ok(())
    }

    /// Notes sources by a number that the header does not have.
    pub(super) fn note_unregistered(&self, notes: &mut Notes, sources: &Sources) {
        let is_strict = self.is_strict();
        for entry in self.entries.iter().filter(|_| !is_strict) {
            if let Some(p) = entry.p.filter(|p| !sources.is_registered(*p)) {
                notes.add(UNREGISTERED, &entry.place, || format!("p {p}"));
            }
        }
    }

    /// Notes sources that have outputs and nothing else: the log may give local another name there.
    pub(super) fn note_silent_sources(&self, notes: &mut Notes, sources: &Sources) {
        if self.is_strict() {
            return;
        }
        let of = |entry: &&Entry| matches!(entry.ev, "request" | "result" | "fail");
        let heard: HashSet<u64> = self.entries.iter().filter(of).filter_map(|it| it.p).collect();
        for entry in self.entries.iter().filter(|entry| entry.ev == "emit") {
            let Some(p) = entry.p.filter(|p| *p != 0 && !heard.contains(p)) else { continue };
            let remedy = || format!("if it is local, say so with --local {}", sources.name(p));
            notes.add_with(SILENT, &entry.place, || sources.name(p), remedy);
        }
    }

    /// Counts events that came twice, and leaves them out if they are to be.
    fn repeated(&mut self, notes: &mut Notes, is_unique: bool) -> Vec<bool> {
        if self.is_strict() {
            return vec![false; self.entries.len()];
        }
        let remedy = if is_unique {
            "they were skipped"
        } else {
            "if something was logged twice, skip the copies with --unique"
        };
        let mut seen: HashMap<_, &Place> = HashMap::new();
        let mut repeats = Vec::with_capacity(self.entries.len());
        for entry in &self.entries {
            let content = entry.content();
            let first = seen.get(&content).filter(|_| entry.ev != "tick");
            if let Some(first) = first {
                let detail = || format!("a copy of {}", first.within());
                notes.add_with(REPEATED, &entry.place, detail, || remedy);
            }
            repeats.push(first.is_some());
            seen.entry(content).or_insert(&entry.place);
        }
        drop(seen);
        if !is_unique {
            return repeats;
        }
        let mut repeats = repeats.into_iter();
        self.entries.retain(|_| !repeats.next().unwrap_or(false));
        vec![false; self.entries.len()]
    }

    /// Returns the runs of the log, each in the order of its instants, and where those after the
    /// first begin.
    pub(super) fn runs(
        mut self,
        options: OrderOptions,
        notes: &mut Notes,
    ) -> Result<(Vec<Run>, Vec<Restart>), Problem> {
        let repeats = self.repeated(notes, options.is_unique);
        let shift = self.shift(notes);
        if self.is_strict() && !options.is_sorted {
            return Ok((vec![Run::new(self.entries, shift, notes)], Vec::new()));
        }
        let mut found = restarts(&self, &repeats, notes);
        // If the ids are not numbers and the user denies an order, nothing follows from it.
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
            return Err(Problem::at(place, message));
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

    /// Returns `true` if messages have numbers as ids, whose order can be compared with that of
    /// their instants.
    fn has_numbers(&self) -> bool {
        let mut ids = self.entries.iter().filter_map(|entry| entry.t.as_ref());
        self.has_ids && ids.all(|id| matches!(id, Id::Number(_)))
    }

    /// Returns the time by which instants are moved so that none is negative.
    fn shift(&self, notes: &mut Notes) -> i128 {
        let Some(first) = self.entries.iter().min_by_key(|entry| entry.at) else { return 0 };
        if first.at >= 0 {
            return 0;
        }
        let shift = -first.at;
        for entry in self.entries.iter().filter(|entry| entry.at < 0) {
            notes.add(NEGATIVE, &entry.place, || format!("by {}", in_words(shift)));
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
                    || format!("{} before {}", in_words(later.at - entry.at), later.place.within());
                notes.add(DISORDER, &entry.place, by);
            }
            _ => latest = Some(entry),
        }
    }
}

impl Run {
    fn new(entries: Vec<Entry>, shift: i128, notes: &mut Notes) -> Self {
        let ids = || entries.iter().flat_map(Entry::messages);
        let has_texts = ids().any(|id| matches!(id, Id::Text(_)));
        let numbers = has_texts.then(|| {
            let mut numbers = HashMap::new();
            for id in ids() {
                let next = numbers.len() as u64;
                numbers.entry(id.clone()).or_insert(next);
            }
            // A single text among numbers may be a mistake.
            let is_mixed = entries.iter().any(|entry| matches!(entry.t, Some(Id::Number(_))));
            for entry in &entries {
                if let Some(Id::Text(text)) = entry.t.as_ref().filter(|_| is_mixed) {
                    notes.add(MIXED, &entry.place, || text.to_string());
                }
            }
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
    pub(super) fn write(&self, entry: &Entry, line: &mut Vec<u8>) -> Result<(), Problem> {
        let number = |id: &Id| match (&self.numbers, id) {
            (Some(numbers), id) => numbers.get(id).copied().unwrap_or(u64::MAX),
            (None, Id::Number(number)) => *number,
            (None, Id::Text(_)) => u64::MAX,
        };
        let read = entry.line(self.shift, &number);
        let (event, annotations) = read.map_err(|why| Problem::at(&entry.place, why))?;
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
        let requests = self.of("request").filter_map(|it| Some((it.due? - it.at, it)));
        let is_any_due =
            self.of("request").any(|entry| entry.due.is_some_and(|due| due <= last.at));
        if let Some((had, shortest)) = requests.min_by_key(|(had, _)| *had)
            && self.of("open").count() >= FEW
            && !is_any_due
            && had > span
        {
            let detail = format!(
                "the shortest deadline is {}, but the log lasts only {}; is the unit right (--unit \
                 deadline=ms)?",
                in_words(had),
                in_words(span)
            );
            notes.add_of_file("no deadline ends within the log", &shortest.place.file, detail);
        }
        self.doubt_order(notes);
        self.doubt_instants(notes);
    }

    /// Returns the entries of one event.
    pub(super) fn of(&self, ev: &'static str) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(move |entry| entry.ev == ev)
    }

    /// Returns the times between opens, the shortest first.
    pub(super) fn periods(&self) -> Vec<i128> {
        let next = self.of("open").skip(1);
        let mut periods: Vec<i128> =
            self.of("open").zip(next).map(|(open, next)| next.at - open.at).collect();
        periods.sort_unstable();
        periods
    }

    /// Notes events of messages that are of another clock than others, or no instants at all.
    fn doubt_order(&self, notes: &mut Notes) {
        let mut firsts: HashMap<(&str, &Id, u64), i128> = HashMap::new();
        for entry in self.of("request").chain(self.of("open")) {
            if let Some(t) = &entry.t {
                let first = firsts.entry((entry.ev, t, entry.p.unwrap_or(0))).or_insert(entry.at);
                *first = entry.at.min(*first);
            }
        }
        for entry in self.entries.iter().filter(|entry| entry.ev != "open") {
            let Some(t) = &entry.t else { continue };
            let apart = firsts.get(&("open", t, 0)).map_or(0, |open| entry.at - open);
            let halves = (apart.abs() + MINUTE) / (30 * MINUTE);
            if halves > 0 && apart.abs() - halves * 30 * MINUTE <= MINUTE {
                let side = if apart < 0 { "before" } else { "after" };
                let detail = || format!("{} {} {side} it", entry.ev, in_words(apart.abs()));
                let remedy = || "is one of them in local time and the other in UTC?";
                notes.add_with(ZONES, &entry.place, detail, remedy);
            }
            let request = entry.p.and_then(|p| firsts.get(&("request", t, p)));
            let early = request.filter(|_| entry.ev == "result").map_or(0, |at| at - entry.at);
            if early > CLOCK_STEP {
                let remedy = || "are both instants, and of the same clock?";
                notes.add_with(EARLY, &entry.place, || format!("by {}", in_words(early)), remedy);
            }
        }
    }

    /// Notes instants that lie far from the others, or too close together.
    fn doubt_instants(&self, notes: &mut Notes) {
        for pair in self.entries.windows(2) {
            let gap = pair[1].at - pair[0].at;
            if gap > DAY {
                notes.add(GAPS, &pair[1].place, || {
                    format!("{} after {}", in_words(gap), pair[0].place.within())
                });
            }
        }
        let periods = self.periods();
        let period = periods.get(periods.len() / 2).filter(|_| periods.len() + 1 >= FEW);
        let Some(period) = period else { return };
        if !PERIODS.contains(period) {
            let detail = format!("messages come every {}; is --unit right?", in_words(*period));
            notes.add_of_file("doubtful instants", &self.entries[0].place.file, detail);
        }
    }
}
