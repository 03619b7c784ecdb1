//! Remembers notes for the user and the names in a log, besides its events.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use crate::convert::row::{Place, Spot};
use crate::diagnostics::print_line;

/// A note about what was guessed, changed or skipped: each kind once, with its count and its first
/// place.
#[derive(Default, Debug)]
pub(super) struct Notes(Vec<Note>);

#[derive(Debug)]
struct Note {
    kind: &'static str,
    count: u64,
    first: Place,
    detail: String,
    remedy: String,
}

/// The names of values, or of events, that a log has, with how often each stands there.
#[derive(Default, Debug)]
pub(super) struct Names(BTreeMap<Arc<str>, NameUse>);

#[derive(Default, Debug)]
struct NameUse {
    count: u64,
    /// Some of its values.
    values: Vec<String>,
}

/// At most this many values of a name are remembered.
const VALUES: usize = 6;

impl Notes {
    /// Counts something of this kind, named as several of it; `detail` is of the first one.
    pub(super) fn add(
        &mut self,
        kind: &'static str,
        place: &Place,
        detail: impl FnOnce() -> String,
    ) {
        self.add_with(kind, place, detail, String::new);
    }

    /// Adds a note with what the user can do about it.
    pub(super) fn add_with<R: Into<String>>(
        &mut self,
        kind: &'static str,
        place: &Place,
        detail: impl FnOnce() -> String,
        remedy: impl FnOnce() -> R,
    ) {
        if let Some(note) = self.0.iter_mut().find(|note| note.kind == kind) {
            note.count += 1;
            return;
        }
        let (first, detail, remedy) = (place.clone(), detail(), remedy().into());
        self.0.push(Note { kind, count: 1, first, detail, remedy });
    }

    /// Adds what is true of the file as a whole.
    pub(super) fn add_of_file(&mut self, kind: &'static str, file: &Arc<str>, detail: String) {
        let first = Place::new(file, Spot::File);
        self.0.push(Note { kind, count: 0, first, detail, remedy: String::new() });
    }

    pub(super) fn has(&self, kind: &str) -> bool {
        self.0.iter().any(|note| note.kind == kind)
    }

    /// Returns a line for each kind.
    pub(super) fn lines(&self) -> Vec<String> {
        let line = |Note { kind, count, first, detail, remedy }: &Note| {
            let colon = if detail.is_empty() { "" } else { ": " };
            let semicolon = if remedy.is_empty() { "" } else { "; " };
            let found = match first.spot {
                Spot::File => detail.clone(),
                _ if *count == 1 => format!("1 ({}{colon}{detail})", first.within()),
                _ => format!("{count} (first {}{colon}{detail})", first.within()),
            };
            format!("{}: {kind}: {found}{semicolon}{remedy}", first.file)
        };
        self.0.iter().map(line).collect()
    }

    /// Prints them on standard error, each in one line whatever the log holds.
    pub(super) fn print(&self) {
        for line in self.lines() {
            print_line(format_args!("note: {}", line.replace(char::is_control, "\u{fffd}")));
        }
    }
}

impl Names {
    pub(super) fn add(&mut self, name: &str) {
        match self.0.get_mut(name) {
            Some(found) => found.count += 1,
            None => {
                self.0.insert(name.into(), NameUse { count: 1, values: Vec::new() });
            }
        }
    }

    /// Remembers a value, as an example.
    pub(super) fn add_value(&mut self, name: &str, value: &str) {
        let Some(found) = self.0.get_mut(name) else { return };
        let is_new = || !found.values.iter().any(|known| known == value);
        if found.values.len() < VALUES && !value.is_empty() && is_new() {
            found.values.push(value.to_owned());
        }
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(|name| &**name)
    }

    /// Returns each name with its count and some of its values.
    pub(super) fn described(&self) -> Vec<String> {
        let one = |(name, NameUse { count, values }): (&Arc<str>, &NameUse)| {
            let more = if values.len() == VALUES { ", …" } else { "" };
            format!("{name} ({count}): {}{more}", values.join(", "))
        };
        self.0.iter().map(one).collect()
    }
}

/// Says that a name which the user gave occurs nowhere, and which names of its kind do: the closest
/// first.
pub(super) fn unknown<'n>(
    noun: &str,
    name: &str,
    option: &str,
    all: impl Iterator<Item = &'n str>,
) -> String {
    let space = if noun.is_empty() { "" } else { " " };
    let all = listed(name, all);
    let has = if all.is_empty() { all } else { format!("; it has {all}") };
    format!("{option}: the file has no {noun}{space}{name:?}{has}")
}

/// Returns the names that there are, the closest to another first, for an error.
pub(super) fn listed<'n>(name: &str, all: impl Iterator<Item = &'n str>) -> String {
    const SHOWN: usize = 12;
    let mut seen = HashSet::new();
    let mut all: Vec<&str> = all.filter(|name| seen.insert(*name)).collect();
    let lower = name.to_lowercase();
    all.sort_by_key(|known| strsim::damerau_levenshtein(&lower, &known.to_lowercase()));
    let more = all.len().saturating_sub(SHOWN);
    all.truncate(SHOWN);
    let shown = all.join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}
