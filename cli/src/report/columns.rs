//! A judged trace as columns of small numbers, for the page.
//!
//! Events stand in the order of the file, so that an event's line is its place plus 2. Instants are
//! differences: the page reads them as doubles, exact up to 104 days.

use std::collections::BTreeMap;

use fuseline_traces::{Decision, DropReason, Event, Header, Input, OfferRefusal, OpenRefusal};
use serde::Serialize;
use serde::ser::Serializer;

use crate::judging::Manner;
use crate::verdict::{Breach, Found};

/// The greatest number up to which a script's numbers are exact.
const EXACT: u64 = (1 << 53) - 1;

/// One trace while it is read.
pub(crate) struct Columns {
    events: Vec<Event>,
    /// The sources in the order of their first mention: local, the header's, strangers.
    sources: BTreeMap<u64, usize>,
}

/// One trace as the page has it.
#[derive(Serialize)]
pub(crate) struct Told {
    file: String,
    operator: Option<String>,
    window: u16,
    commit: &'static str,
    /// Tolerance and lateness, if judged as observed.
    observed: Option<[u64; 2]>,
    sources: Vec<Source>,
    reasons: Reasons,
    conforms: bool,
    judged: u64,
    lines: u64,
    violations: Vec<Violation>,
    more: u64,
    /// The instant from which `at` counts.
    origin: Exact,
    /// The timestamps, ascending, each as its difference from the one before.
    timestamps: Vec<Exact>,
    /// A letter an event.
    ev: String,
    /// Each instant as its difference from the event's before.
    at: Vec<i128>,
    /// The timestamp's place, each as its difference from the event's before; a tick has none.
    t: Vec<i64>,
    /// The source's place plus 1, or 0.
    p: Vec<usize>,
    /// What some events have more, in their order; see `more_of`.
    x: Vec<i128>,
}

/// The reasons by their places: the word and the sentence of each.
#[derive(Serialize)]
struct Reasons {
    open: [Said; OpenRefusal::ALL.len()],
    offer: [Said; OfferRefusal::ALL.len()],
    dropped: [Said; DropReason::ALL.len()],
}

type Said = (&'static str, &'static str);

#[derive(Serialize)]
struct Source {
    p: Exact,
    name: Option<String>,
    /// Whether the header tells it; local is.
    known: bool,
}

#[derive(Serialize)]
struct Violation {
    line: u64,
    /// The timestamp's place.
    t: Option<usize>,
    rule: &'static str,
    sentence: &'static str,
    found: String,
    expected: String,
    late: Option<u64>,
}

/// A number that is told as a text where a script could not hold it.
#[derive(Clone, Copy)]
struct Exact(u64);

impl Columns {
    pub(crate) fn new(header: &Header) -> Self {
        let mut columns = Self { events: Vec::new(), sources: BTreeMap::new() };
        columns.source(0);
        let mut clouds: Vec<u64> = header.clouds.iter().map(|cloud| cloud.p.into()).collect();
        clouds.sort_unstable();
        for p in clouds {
            columns.source(p);
        }
        columns
    }

    pub(crate) fn push(&mut self, event: Event) {
        if let Some(p) = priority(&event) {
            self.source(p);
        }
        self.events.push(event);
    }

    fn source(&mut self, p: u64) {
        let next = self.sources.len();
        self.sources.entry(p).or_insert(next);
    }

    /// The columns with the verdict.
    pub(crate) fn told(&self, header: &Header, manner: Manner, verdict: &Found) -> Told {
        let mut timestamps: Vec<u64> = self.events.iter().filter_map(Event::t).collect();
        timestamps.sort_unstable();
        timestamps.dedup();
        let place = |t: u64| timestamps.binary_search(&t).unwrap_or_default();
        let origin = self.events.iter().map(instant).min().unwrap_or_default();
        let (summary, breaches) = (verdict.summary(), verdict.breaches());
        let mut told = Told {
            file: summary.file.to_owned(),
            operator: header.operator.clone(),
            window: header.window,
            commit: header.commit.as_str(),
            observed: manner.map(|slack| [slack.tolerance, slack.lateness]),
            sources: self.named(header),
            reasons: Reasons {
                open: OpenRefusal::ALL.map(|why| (why.as_str(), why.sentence())),
                offer: OfferRefusal::ALL.map(|why| (why.as_str(), why.sentence())),
                dropped: DropReason::ALL.map(|why| (why.as_str(), why.sentence())),
            },
            conforms: summary.conforms,
            judged: summary.judged,
            lines: summary.lines,
            more: summary.violations - breaches.len() as u64,
            violations: breaches.iter().map(|breach| Violation::new(breach, place)).collect(),
            origin: Exact(origin),
            timestamps: differences(&timestamps),
            ev: self.events.iter().map(letter).collect(),
            at: Vec::with_capacity(self.events.len()),
            t: Vec::with_capacity(self.events.len()),
            p: Vec::with_capacity(self.events.len()),
            x: Vec::new(),
        };
        let (mut at, mut t) = (origin, 0);
        for event in &self.events {
            told.at.push(i128::from(instant(event)) - i128::from(at));
            at = instant(event);
            let next = event.t().map_or(t, |t| i64::try_from(place(t)).unwrap_or(i64::MAX));
            told.t.push(next - t);
            t = next;
            let source = priority(event).and_then(|p| self.sources.get(&p));
            told.p.push(source.map_or(0, |source| source + 1));
            more_of(event, &mut told.x);
        }
        told
    }

    fn named(&self, header: &Header) -> Vec<Source> {
        let mut named: Vec<(usize, Source)> = Vec::with_capacity(self.sources.len());
        for (&p, &place) in &self.sources {
            let cloud = header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
            let name = cloud.and_then(|cloud| cloud.name.clone());
            named.push((place, Source { p: Exact(p), name, known: p == 0 || cloud.is_some() }));
        }
        named.sort_unstable_by_key(|(place, _)| *place);
        named.into_iter().map(|(_, source)| source).collect()
    }
}

impl Violation {
    fn new(breach: &Breach<'_>, place: impl Fn(u64) -> usize) -> Self {
        let Breach { line, t, rule: (rule, sentence), found, expected, late, story: _ } = *breach;
        let (found, expected) = (found.to_owned(), expected.to_owned());
        Self { line, t: t.map(place), rule, sentence, found, expected, late }
    }
}

impl Serialize for Exact {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0 <= EXACT {
            serializer.serialize_u64(self.0)
        } else {
            serializer.collect_str(&self.0)
        }
    }
}

/// Ascending numbers, each as its difference from the one before.
fn differences(numbers: &[u64]) -> Vec<Exact> {
    let before = std::iter::once(&0).chain(numbers);
    numbers.iter().zip(before).map(|(number, before)| Exact(number - before)).collect()
}

const fn instant(event: &Event) -> u64 {
    match event {
        Event::Input(input) => input.at(),
        Event::Decision(decision) => decision.at(),
    }
}

const fn letter(event: &Event) -> char {
    match event {
        Event::Input(Input::Open { .. }) => 'o',
        Event::Input(Input::Offer { .. }) => 'f',
        Event::Input(Input::Result { .. }) => 'r',
        Event::Input(Input::Fail { .. }) => 'x',
        Event::Input(Input::Tick { .. }) => '.',
        Event::Decision(Decision::Timer { .. }) => 't',
        Event::Decision(Decision::RefuseOpen { .. } | Decision::RefuseOffer { .. }) => 'n',
        Event::Decision(Decision::Request { .. }) => 'q',
        Event::Decision(Decision::Hold { .. }) => 'h',
        Event::Decision(Decision::Drop { .. }) => 'd',
        Event::Decision(Decision::Emit { .. }) => 'e',
        Event::Decision(Decision::Miss { .. }) => 'm',
        Event::Decision(Decision::Cancel { .. }) => 'c',
    }
}

const fn priority(event: &Event) -> Option<u64> {
    match event {
        Event::Input(Input::Open { .. } | Input::Tick { .. })
        | Event::Decision(Decision::RefuseOpen { .. } | Decision::Miss { .. }) => None,
        Event::Input(Input::Offer { p, .. } | Input::Result { p, .. } | Input::Fail { p, .. })
        | Event::Decision(
            Decision::Timer { p, .. }
            | Decision::RefuseOffer { p, .. }
            | Decision::Request { p, .. }
            | Decision::Hold { p, .. }
            | Decision::Drop { p, .. }
            | Decision::Emit { p, .. }
            | Decision::Cancel { p, .. },
        ) => Some(*p),
    }
}

/// What an event has more: an open its deadline or −1, an offer its deadline and backlog, a request the
/// time to its due instant, a refusal and a drop the place of their reason in its table.
fn more_of(event: &Event, x: &mut Vec<i128>) {
    match *event {
        Event::Input(Input::Open { deadline, .. }) => x.push(deadline.map_or(-1, i128::from)),
        Event::Input(Input::Offer { deadline, backlog, .. }) => {
            x.extend([i128::from(deadline), i128::from(backlog)]);
        }
        Event::Decision(Decision::Request { at, due, .. }) => {
            x.push(i128::from(due) - i128::from(at));
        }
        Event::Decision(Decision::RefuseOpen { why, .. }) => x.push(why.index() as i128),
        Event::Decision(Decision::RefuseOffer { why, .. }) => x.push(why.index() as i128),
        Event::Decision(Decision::Drop { why, .. }) => x.push(why.index() as i128),
        Event::Input(Input::Result { .. } | Input::Fail { .. } | Input::Tick { .. })
        | Event::Decision(
            Decision::Timer { .. }
            | Decision::Hold { .. }
            | Decision::Emit { .. }
            | Decision::Miss { .. }
            | Decision::Cancel { .. },
        ) => {}
    }
}
