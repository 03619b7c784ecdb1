//! Which events a page has of a trace that is too long to be shown whole, and what it says of all.
//!
//! Those of each 2^k-th timestamp by its first line, of the first timestamps that break a rule and of the first that are missed;
//! `k` grows with the trace. What is open, and what the last lines are about, may still change; all else is settled.

use std::collections::BTreeMap;

use fuseline_traces::{Decision, DropReason, Event, OfferRefusal, OpenRefusal};
use serde::Serialize;

use crate::counts::ValueCounts;
use crate::reasons;
use crate::statistics::{CountedTimestamp, TimestampOutcome, TraceStatistics};
use crate::tiles::{TileColumns, TileOutcome, TimeTiles};
use crate::timestamp_map::TimestampMap;

/// A timestamp may still get a line, or be found to break a rule, within such a part of the events that a page has.
const RECENT: usize = 64;
/// How many timestamps later one that is open may still end.
const OPEN: u64 = 1 << 18;
/// How many events a timestamp often has.
const EVENTS: usize = 16;
const DROPS: usize = DropReason::ALL.len();
const REFUSALS: usize = OpenRefusal::ALL.len() + OfferRefusal::ALL.len();
/// How many values a source's histogram has at most.
const VALUES: usize = 1 << 14;

/// What is known of a long trace while it is read.
pub(crate) struct ThinnedTrace {
    /// How many events the page may have.
    most: usize,
    /// Each timestamp whose rank is a multiple of 2 to this is shown.
    log: u32,
    /// The timestamps that may still change.
    recent: TimestampMap<HeldTimestamp>,
    /// At how many events these are looked through again.
    next: u64,
    /// The timestamps that are settled and shown, and how many events they have.
    shown: BTreeMap<u64, ShownTimestamp>,
    held: usize,
    /// How many timestamps there were.
    ranks: u64,
    /// How many events there were.
    events: u64,
    /// The greatest timestamp of the messages that are settled.
    settled: Option<u64>,
    /// How many events may yet be shown because of a broken rule, and because of a miss.
    room: [usize; 2],
    tiles: TimeTiles,
    drops: [u64; DROPS],
    refusals: [u64; REFUSALS],
    earliest: u64,
    latest: u64,
}

/// A timestamp of which events are held.
#[derive(Default)]
struct HeldTimestamp {
    /// Which one it is, by its first line.
    rank: u64,
    /// With their lines.
    events: Vec<(u64, Event)>,
    /// Which event its last one was, of all.
    last: u64,
    is_special: bool,
}

/// A timestamp that is shown.
struct ShownTimestamp {
    held: HeldTimestamp,
    outcome: TimestampOutcome,
    fates: Vec<u8>,
}

/// Why a timestamp is shown besides.
#[derive(Clone, Copy)]
pub(crate) enum SpecialCause {
    Broken,
    Missed,
}

/// What the page says of the whole of a long trace.
#[derive(Serialize)]
pub(crate) struct ThinnedColumns {
    /// Each so many-th timestamp is shown.
    every: u64,
    /// How many timestamps there are.
    timestamps: u64,
    events: u64,
    /// The last instant, after the trace's origin.
    finish: i128,
    /// By how much a response time may be too low, as a part of it.
    error: f64,
    /// The places of the timestamps that are shown beside those.
    besides: Vec<usize>,
    tiles: TileColumns,
    /// By the place of the source: its results' response times, ascending, each as its difference from the one before, and how often
    /// each occurs.
    responses: Vec<(usize, Vec<u64>, Vec<u64>)>,
    /// How often something was dropped and refused for each reason.
    drops: Vec<u64>,
    refusals: Vec<u64>,
    /// How many violations there are, and of each rule.
    violations: u64,
    rules: Vec<(&'static str, &'static str, u64)>,
}

/// What a trace's violations and statistics add to its page.
pub(crate) struct ThinnedTotals {
    pub(crate) origin: u64,
    pub(crate) responses: Vec<(usize, ValueCounts)>,
    pub(crate) violations: u64,
    pub(crate) rules: Vec<(&'static str, &'static str, u64)>,
}

impl ThinnedTrace {
    /// Of a trace of which a page has so many events at most.
    pub(crate) fn new(most: usize) -> Self {
        Self {
            most,
            log: 0,
            recent: TimestampMap::default(),
            next: 0,
            shown: BTreeMap::new(),
            held: 0,
            ranks: 0,
            events: 0,
            settled: None,
            room: [most / 8; 2],
            tiles: TimeTiles::default(),
            drops: [0; DROPS],
            refusals: [0; REFUSALS],
            earliest: u64::MAX,
            latest: 0,
        }
    }

    /// Takes the next event; whether it can change what became of its timestamp. What is settled gets late lines that cannot.
    pub(crate) fn push(&mut self, line: u64, event: Event) -> bool {
        self.events += 1;
        self.count(&event);
        let Some(t) = event.t() else { return true };
        if self.recent.get_mut(t).is_none() {
            // F1: what is opened is later than all before.
            if self.settled.is_some_and(|settled| t <= settled) {
                if let Some(shown) = self.shown.get_mut(&t) {
                    shown.held.events.push((line, event));
                    self.held += 1;
                }
                return false;
            }
            if let Some(shown) = self.shown.remove(&t) {
                self.held -= shown.held.events.len();
                self.recent.insert(t, shown.held);
            }
        }
        let ranks = &mut self.ranks;
        let held = self.recent.or_insert_with(t, || {
            let rank = *ranks;
            *ranks += 1;
            HeldTimestamp { rank, events: Vec::with_capacity(EVENTS), last: 0, is_special: false }
        });
        held.events.push((line, event));
        held.last = self.events;
        if let Event::Decision(Decision::Miss { .. }) = event {
            self.show(t, SpecialCause::Missed);
        }
        true
    }

    fn count(&mut self, event: &Event) {
        let at = match event {
            Event::Input(input) => input.at(),
            Event::Decision(decision) => decision.at(),
        };
        self.earliest = self.earliest.min(at);
        self.latest = self.latest.max(at);
        match *event {
            Event::Decision(Decision::Drop { why, .. }) => self.drops[why.index()] += 1,
            Event::Decision(Decision::RefuseOpen { why, .. }) => {
                self.refusals[reasons::index_of_open(why)] += 1;
            }
            Event::Decision(Decision::RefuseOffer { why, .. }) => {
                self.refusals[reasons::index_of_offer(why)] += 1;
            }
            Event::Input(_)
            | Event::Decision(
                Decision::Timer { .. }
                | Decision::Request { .. }
                | Decision::Hold { .. }
                | Decision::Emit { .. }
                | Decision::Final { .. }
                | Decision::Miss { .. }
                | Decision::Cancel { .. },
            ) => {}
        }
    }

    /// Shows a timestamp besides the others while there is room.
    pub(crate) fn show(&mut self, t: u64, cause: SpecialCause) {
        let settled = self.shown.get_mut(&t).map(|shown| &mut shown.held);
        let Some(held) = self.recent.get_mut(t).or(settled) else { return };
        let room = &mut self.room[cause as usize];
        if !held.is_special && held.events.len() <= *room {
            held.is_special = true;
            *room -= held.events.len();
        }
    }

    /// Whether it is time to [`settle`](Self::settle).
    pub(crate) const fn is_due(&self) -> bool {
        self.next <= self.events
    }

    /// Counts what will change no more, and leaves events out if there are too many.
    pub(crate) fn settle(
        &mut self,
        statistics: &mut TraceStatistics,
        sources: &BTreeMap<u64, usize>,
    ) {
        self.next = self.events + self.part();
        let mut counted = Vec::new();
        statistics.fold(|t, waits| self.is_settled(t, waits), |one| counted.push(one));
        for one in counted {
            self.count_settled(one, sources);
        }
        // Of some there is nothing but refusals.
        let others: Vec<u64> = self.recent.iter().map(|(t, _)| t).collect();
        for t in others {
            if !statistics.has(t) && self.is_settled(t, false) {
                self.count_settled(CountedTimestamp::unopened(t), sources);
            }
        }
        while self.held > self.most / 2 && self.log < u64::BITS {
            self.log += 1;
            self.shown.retain(|_, shown| shown.held.is_shown(self.log));
            self.held = self.shown.values().map(|shown| shown.held.events.len()).sum();
        }
    }

    /// Counts what is left. Answers the events that the page shows, by their lines.
    pub(crate) fn finish(
        &mut self,
        statistics: &mut TraceStatistics,
        sources: &BTreeMap<u64, usize>,
    ) -> Vec<(u64, Event)> {
        self.settle(statistics, sources);
        for one in statistics.counted().collect::<Vec<_>>() {
            self.count_settled(one, sources);
        }
        for t in self.recent.iter().map(|(t, _)| t).collect::<Vec<_>>() {
            self.count_settled(CountedTimestamp::unopened(t), sources);
        }
        let shown =
            self.shown.values_mut().flat_map(|shown| std::mem::take(&mut shown.held.events));
        let mut shown: Vec<(u64, Event)> = shown.collect();
        shown.sort_unstable_by_key(|(line, _)| *line);
        shown
    }

    /// Whether a timestamp's events may be shown.
    pub(crate) fn holds(&self, t: u64) -> bool {
        self.recent.has(t) || self.shown.contains_key(&t)
    }

    /// What became of a timestamp that is shown and of its requests.
    pub(crate) fn end_of(&self, t: u64) -> Option<(TimestampOutcome, &[u8])> {
        self.shown.get(&t).map(|shown| (shown.outcome, &shown.fates[..]))
    }

    /// The first instant.
    pub(crate) const fn origin(&self) -> u64 {
        self.earliest
    }

    fn count_settled(&mut self, one: CountedTimestamp, sources: &BTreeMap<u64, usize>) {
        let CountedTimestamp { t, begin, outcome, fates } = one;
        let place = |p| sources.get(&p).copied().unwrap_or_default();
        let tile = match outcome {
            TimestampOutcome::Forwarded { p } => Some(TileOutcome::Forwarded(place(p))),
            TimestampOutcome::Missed => Some(TileOutcome::Missed),
            TimestampOutcome::Open => Some(TileOutcome::Open),
            TimestampOutcome::Unopened => None,
        };
        if let (Some(begin), Some(tile)) = (begin, tile) {
            self.tiles.add(begin, tile);
        }
        // What was no message may still become one.
        if tile.is_some() {
            self.settled = self.settled.max(Some(t));
        }
        if let Some(held) = self.recent.remove(t).filter(|held| held.is_shown(self.log)) {
            self.held += held.events.len();
            self.shown.insert(t, ShownTimestamp { held, outcome, fates });
        }
    }

    /// Whether a timestamp will change no more; `waits` says whether it is open.
    fn is_settled(&self, t: u64, waits: bool) -> bool {
        let Some(held) = self.recent.get(t) else { return true };
        let may_end = waits && held.rank + OPEN > self.ranks;
        held.last + self.part() < self.events && !may_end
    }

    /// Within how many events a timestamp may change.
    fn part(&self) -> u64 {
        (self.most / RECENT).max(EVENTS) as u64
    }

    /// What the page says of the whole.
    pub(crate) fn columns(
        &self,
        totals: ThinnedTotals,
        place: impl Fn(u64) -> Option<usize>,
    ) -> ThinnedColumns {
        let error = totals.responses.iter().map(|(_, counts)| counts.error()).fold(0.0, f64::max);
        let besides = self.shown.iter().filter(|(_, shown)| !shown.held.is_regular(self.log));
        ThinnedColumns {
            every: 1_u64.checked_shl(self.log).unwrap_or(u64::MAX),
            timestamps: self.ranks,
            events: self.events,
            finish: i128::from(self.latest) - i128::from(totals.origin),
            error,
            besides: besides.filter_map(|(t, _)| place(*t)).collect(),
            tiles: self.tiles.columns(totals.origin),
            responses: totals.responses.into_iter().map(histogram).collect(),
            drops: self.drops.to_vec(),
            refusals: self.refusals.to_vec(),
            violations: totals.violations,
            rules: totals.rules,
        }
    }
}

impl HeldTimestamp {
    const fn is_regular(&self, log: u32) -> bool {
        self.rank.trailing_zeros() >= log
    }

    const fn is_shown(&self, log: u32) -> bool {
        self.is_special || self.is_regular(log)
    }
}

/// A source's response times for the page's histogram.
fn histogram((place, mut counts): (usize, ValueCounts)) -> (usize, Vec<u64>, Vec<u64>) {
    counts.bound_to(VALUES);
    let mut before = 0;
    let differences = counts.iter().map(|(value, _)| value - std::mem::replace(&mut before, value));
    (place, differences.collect(), counts.iter().map(|(_, times)| times).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_has_no_more_values_than_a_page_can_hold() {
        let of = |values: u64| {
            let mut counts = ValueCounts::default();
            (0..values).for_each(|value| counts.add(3 * value, 1));
            let (place, differences, times) = histogram((7, counts));
            assert_eq!((place, times.iter().sum::<u64>()), (7, values));
            assert_eq!(differences.len(), times.len());
            differences
        };
        let most = VALUES as u64;
        assert_eq!(of(most)[..3], [0, 3, 3]);
        assert_eq!(of(most).len(), VALUES);
        assert!(of(most + 1).len() < VALUES);
    }
}
