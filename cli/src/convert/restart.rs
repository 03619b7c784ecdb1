//! Restarts of a log: a clock or a counter that goes back, so that two runs would lie over each
//! other.

use std::collections::{BTreeMap, HashMap};

use crate::convert::entry::Entry;
use crate::convert::log::{BACKWARDS, Log, LogKind, TWICE};
use crate::convert::notes::Notes;
use crate::convert::row::Place;
use crate::convert::time::Id;
use crate::duration::in_words;

/// Instants of one clock may be stamped out of their order by so much.
const SLACK: i128 = 1_000_000;

/// Finds where a log begins another run of the operator.
#[derive(Clone, Debug)]
pub(super) struct Restart {
    /// The first entry of the new run.
    pub(super) entry: usize,
    pub(super) place: Place,
    pub(super) message: String,
}

/// A message that opens, in the order of the file.
#[derive(Clone, Debug)]
struct Opening<'l> {
    entry: usize,
    at: i128,
    /// The last instant of its row.
    end: i128,
    id: &'l Id,
    /// The order of ids: their numbers, or that of their first appearance.
    rank: u64,
    place: &'l Place,
}

/// The facts about a run so far.
#[derive(Default)]
struct RunSoFar<'o> {
    by_at: BTreeMap<i128, &'o Opening<'o>>,
    seen: HashMap<&'o Id, &'o Opening<'o>>,
    last: Option<&'o Opening<'o>>,
    latest: Option<&'o Opening<'o>>,
    end: i128,
    highest: u64,
    /// The opening at which ids went back without one that was there before.
    fell: Option<usize>,
}

/// Returns the places where runs begin; entries that repeat others are ignored.
pub(super) fn restarts(log: &Log, repeats: &[bool], notes: &mut Notes) -> Vec<Restart> {
    let openings = openings(log, repeats);
    let is_ranked = log.has_ids && openings.iter().all(|it| matches!(it.id, Id::Number(_)));
    let mut found: Vec<Restart> = Vec::new();
    let mut run = RunSoFar::default();
    let mut start = 0;
    let mut index = 0;
    while let Some(opening) = openings.get(index) {
        let clock = run.clock_goes_back(opening, is_ranked);
        let counter = run.counter_goes_back(opening, openings.get(index + 1));
        // The run began where the clock went back last, or the counter.
        let goes_back = |at: &usize| openings[*at].at + SLACK < openings[*at - 1].at;
        let clock = clock
            .map(|message| ((start + 1..=index).rev().find(goes_back).unwrap_or(index), message));
        let counter = counter.map(|message| (run.fell.unwrap_or(index), message));
        if let Some((begin, message)) = clock.or(counter) {
            let is_new = found.last().is_none_or(|last| last.entry < openings[begin].entry);
            if is_new {
                let Opening { entry, place, .. } = openings[begin];
                found.push(Restart {
                    entry: first_of_row(log, entry),
                    place: place.clone(),
                    message,
                });
            }
            start = begin;
            run = RunSoFar::default();
            for before in &openings[begin..index] {
                run.take(before);
            }
        } else if run.note(opening, is_ranked, notes) {
            run.fell = Some(index);
        }
        run.take(opening);
        index += 1;
    }
    found
}

fn openings<'l>(log: &'l Log, repeats: &[bool]) -> Vec<Opening<'l>> {
    let mut ends: HashMap<u64, i128> = HashMap::new();
    if log.kind == LogKind::Frames {
        for Entry { row, at, .. } in &log.entries {
            let end = ends.entry(*row).or_insert(*at);
            *end = (*end).max(*at);
        }
    }
    let mut ranks: HashMap<&Id, u64> = HashMap::new();
    let mut openings = Vec::new();
    let opens = log.entries.iter().enumerate().filter(|(_, entry)| entry.ev == "open");
    for (index, entry) in opens.filter(|(index, _)| !repeats[*index]) {
        let Some(id) = &entry.t else { continue };
        let next = ranks.len() as u64;
        let by_appearance = *ranks.entry(id).or_insert(next);
        let rank = match id {
            Id::Number(number) => *number,
            Id::Text(_) => by_appearance,
        };
        let end = ends.get(&entry.row).copied().unwrap_or(entry.at);
        openings.push(Opening { entry: index, at: entry.at, end, id, rank, place: &entry.place });
    }
    openings
}

/// Returns the first entry of an entry's row.
fn first_of_row(log: &Log, entry: usize) -> usize {
    let row = log.entries[entry].row;
    (0..=entry).rev().take_while(|at| log.entries[*at].row == row).last().unwrap_or(entry)
}

impl<'o> RunSoFar<'o> {
    fn take(&mut self, opening: &'o Opening<'o>) {
        self.by_at.entry(opening.at).or_insert(opening);
        self.seen.entry(opening.id).or_insert(opening);
        if self.latest.is_none_or(|latest| latest.at < opening.at) {
            self.latest = Some(opening);
        }
        self.end = if self.last.is_none() { opening.end } else { self.end.max(opening.end) };
        self.highest = self.highest.max(opening.rank);
        self.last = Some(opening);
    }

    /// A message opens before one that stands before it, and its id says that it came after it.
    fn clock_goes_back(&self, opening: &Opening<'_>, is_ranked: bool) -> Option<String> {
        let latest = self.latest.filter(|latest| opening.at + SLACK < latest.at)?;
        let after = self.by_at.range(opening.at + SLACK..).next();
        let before = self.by_at.range(..=opening.at).next_back();
        let is_contradicted = if is_ranked {
            after.is_some_and(|(_, other)| other.rank <= opening.rank)
                || before.is_some_and(|(_, other)| other.rank >= opening.rank)
        } else {
            // Rows may be written as their frames end.
            opening.end + SLACK < self.end
        };
        is_contradicted.then(|| {
            format!(
                "the log restarts here: message {} opens {} before message {} ({}), which comes \
                 first in the log",
                opening.id,
                in_words(latest.at - opening.at),
                latest.id,
                latest.place.within()
            )
        })
    }

    /// Ids that were used before come again, this one and the next one.
    fn counter_goes_back(
        &self,
        opening: &Opening<'_>,
        next: Option<&Opening<'_>>,
    ) -> Option<String> {
        let last = self.last.filter(|last| opening.rank < last.rank || self.fell.is_some())?;
        let seen = self.seen.get(opening.id)?;
        next.filter(|next| next.rank <= self.highest)?;
        Some(format!(
            "the log restarts here: message {} comes after message {}, but was opened before that \
             ({})",
            opening.id,
            last.id,
            seen.place.within()
        ))
    }

    /// Notes what is odd and no restart. Returns whether ids went back.
    fn note(&self, opening: &Opening<'_>, is_ranked: bool, notes: &mut Notes) -> bool {
        if let Some(seen) = self.seen.get(opening.id) {
            let detail = || format!("message {}, first at {}", opening.id, seen.place.within());
            notes.add(TWICE, opening.place, detail);
            false
        } else if let Some(last) = self.last
            && is_ranked
            && opening.rank < last.rank
            && opening.at >= last.at
        {
            let detail = || format!("{} after {}", opening.id, last.id);
            notes.add(BACKWARDS, opening.place, detail);
            true
        } else {
            false
        }
    }
}
