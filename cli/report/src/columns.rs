//! A judged trace as columns of small numbers, for the page.
//!
//! Events are in the order of the file, so in a whole trace an event's line is its index plus 2.
//! Instants are differences. The page reads them as doubles, which are exact up to 104 days. If a
//! trace has too many events, the page shows and counts only the first ones, but the verdict covers
//! all of them.

use std::collections::BTreeMap;
use std::sync::Arc;

use fuseline_traces::{
    Annotations, Decision, Doubt, Event, Header, Input, Origin, Verdict, Violation, ViolationPlace,
    nanos,
};
use serde::Serialize;
use serde::ser::Serializer;

use crate::deadlines::RequestDeadlines;
use crate::judging::JudgeMode;
use crate::notes::RunNotes;
use crate::quantile::Quantile;
use crate::reasons;
use crate::statistics::{RequestRow, TimestampOutcome, Totals, TraceStatistics};

/// The greatest number up to which a script's integers are exact.
const EXACT: u64 = (1 << 53) - 1;
/// The page draws at most this many of the times after which requests are due.
const DEADLINES: usize = 3;
/// A capped trace marks at most this many violations beyond the listed ones.
const MARKS: usize = 1 << 16;

/// One trace while it is read.
pub(crate) struct TraceColumns {
    /// The first events, with their lines.
    events: Vec<(u64, Event)>,
    is_part: bool,
    /// At most this many events are shown.
    most: usize,
    /// The number of events that came after these.
    left_out: u64,
    /// The sources in the order of their first mention: local, the header's clouds, then unknown
    /// sources.
    sources: BTreeMap<u64, usize>,
    statistics: TraceStatistics,
    deadlines: RequestDeadlines,
    /// The lineages of the messages that have one, by their timestamps.
    lineages: BTreeMap<u64, MessageLineage>,
}

/// The origin of a message, and its age when it was opened.
struct MessageLineage {
    origin: Option<Origin>,
    age: Option<u64>,
    /// The inputs of joins on its way from which nothing came.
    missing: Vec<Arc<str>>,
}

/// One trace in the form of the page.
#[derive(Serialize)]
pub(crate) struct PageTrace {
    file: String,
    operator: Option<String>,
    window: u16,
    commit: &'static str,
    /// The tolerance and the lateness, if the trace is judged as observed.
    observed: Option<[u64; 2]>,
    sources: Vec<SourceColumn>,
    conforms: bool,
    judged: u64,
    /// The doubts: facts that the judge could not see.
    doubts: Vec<Doubt>,
    /// The cause that explains most violations, if one cause does.
    #[serde(skip_serializing_if = "Option::is_none")]
    cause: Option<String>,
    lines: u64,
    /// The first violations in full.
    violations: Vec<ViolationRow>,
    /// The places of all other violations.
    places: ViolationPlaces,
    #[serde(rename = "account")]
    totals: Sums,
    /// The deadlines of requests, the commonest first.
    deadlines: Vec<ExactNumber>,
    /// Facts about the run that its trace does not have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) run: Option<RunNotes>,
    /// The instant from which `at` counts.
    origin: ExactNumber,
    /// The timestamps in ascending order, each as its difference from the timestamp before.
    timestamps: Vec<ExactNumber>,
    /// The outcome of each message: the index of the source whose result was forwarded, or a
    /// negative number.
    outcome: Vec<i64>,
    /// The fates of the requests. Each timestamp has one digit for each source: the column of its
    /// fate, or 0.
    fates: String,
    /// The lineages of the messages that have one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    lineages: Vec<LineageRow>,
    /// One letter for each event.
    ev: String,
    /// Each instant, as its difference from the previous event's.
    at: Vec<i128>,
    /// The index of each timestamp, as its difference from the previous event's. A tick has none.
    t: Vec<i64>,
    /// The index of the source plus 1, or 0.
    p: Vec<usize>,
    /// Further values of some events, in the order of the events. [`more_of`] describes them.
    x: Vec<i128>,
    /// The line of each event, as its difference from the previous event's. `None` if each event's
    /// line is its index plus 2.
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<Vec<ExactNumber>>,
    /// The totals of the trace, if it has more events than are shown.
    #[serde(skip_serializing_if = "Option::is_none")]
    capped: Option<CappedSums>,
}

/// The totals of a trace whose first events alone are on the page.
#[derive(Serialize)]
struct CappedSums {
    events: u64,
    violations: u64,
}

/// The lineage of one message.
#[derive(Serialize)]
struct LineageRow {
    /// The index of the timestamp.
    t: usize,
    /// The age of the message when it was opened.
    age: Option<ExactNumber>,
    origin: Option<String>,
    seq: Option<ExactNumber>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    missing: Vec<String>,
}

/// The places of violations, without their details.
#[derive(Default, Serialize)]
struct ViolationPlaces {
    /// The rules that they break, each with its sentence.
    rules: Vec<(&'static str, &'static str)>,
    /// The rule of each violation, as its index in `rules`.
    rule: Vec<usize>,
    /// Each line, as its difference from the line before.
    line: Vec<i128>,
    /// The index of the timestamp plus 1, or 0.
    t: Vec<usize>,
}

/// The sums over the trace, because the page itself counts nothing.
#[derive(Serialize)]
struct Sums {
    messages: u64,
    forwarded: u64,
    missed: u64,
    refused: u64,
    open: u64,
    response: [ResponseColumn; 3],
    rows: Vec<SourceRow>,
}

/// One source's row.
#[derive(Serialize)]
struct SourceRow {
    place: usize,
    counts: [u64; 8],
    response: [ResponseColumn; 3],
    /// The least, the median and the greatest deadline of its requests.
    deadlines: Option<[ExactNumber; 3]>,
}

/// A quantile of response times in nanoseconds. It is `never` if too many messages have no output.
#[derive(Serialize)]
#[serde(untagged)]
enum ResponseColumn {
    Exactly(u64),
    Never(&'static str),
    None,
}

#[derive(Serialize)]
struct SourceColumn {
    p: ExactNumber,
    name: Option<String>,
    /// `true` if the header names the source, or it is local.
    known: bool,
}

#[derive(Serialize)]
struct ViolationRow {
    line: u64,
    /// The index of the timestamp.
    t: Option<usize>,
    rule: &'static str,
    sentence: &'static str,
    found: String,
    expected: String,
    late: Option<u64>,
}

/// A number that is written as a text if a script cannot hold it exactly.
#[derive(Clone, Copy)]
struct ExactNumber(u64);

impl TraceColumns {
    /// Creates the columns of a trace. At most `most` of its events are shown.
    pub(crate) fn new(header: &Header, is_observed: bool, most: usize) -> Self {
        let mut columns = Self {
            events: Vec::new(),
            is_part: false,
            most,
            left_out: 0,
            sources: BTreeMap::new(),
            statistics: TraceStatistics::new(
                header.clouds.iter().map(|cloud| cloud.p),
                header.commit,
                is_observed,
            ),
            deadlines: RequestDeadlines::new(header.commit),
            lineages: BTreeMap::new(),
        };
        columns.source(0);
        let mut clouds: Vec<u64> = header.clouds.iter().map(|cloud| cloud.p.into()).collect();
        clouds.sort_unstable();
        for p in clouds {
            columns.source(p);
        }
        columns
    }

    /// Marks that the columns show only a part of the trace.
    pub(crate) const fn of_part(mut self) -> Self {
        self.is_part = true;
        self
    }

    /// Takes the next event. If too many came before it, it is only counted.
    pub(crate) fn push(&mut self, line: u64, event: Event, annotations: &Annotations) {
        if self.events.len() >= self.most {
            self.left_out += 1;
            return;
        }
        let Annotations { origin, age, missing, .. } = annotations;
        if let Event::Input(Input::Open { t, .. }) = event
            && (origin.is_some() || age.is_some() || !missing.is_empty())
        {
            let (origin, missing) = (origin.clone(), missing.clone());
            let lineage = MessageLineage { origin, age: *age, missing };
            self.lineages.entry(t).or_insert(lineage);
        }
        if let Some(p) = priority(&event) {
            self.source(p);
        }
        self.deadlines.event(&event);
        self.statistics.event(&event);
        self.events.push((line, event));
    }

    /// Returns the number of events that are shown.
    pub(crate) const fn len(&self) -> usize {
        self.events.len()
    }

    fn source(&mut self, p: u64) {
        let next = self.sources.len();
        self.sources.entry(p).or_insert(next);
    }

    /// Returns the columns with the verdict.
    pub(crate) fn page_trace(
        &self,
        header: &Header,
        mode: JudgeMode,
        verdict: &Verdict,
    ) -> PageTrace {
        let events = || self.events.iter().map(|(_, event)| event);
        let mut timestamps: Vec<u64> = events().filter_map(Event::t).collect();
        timestamps.sort_unstable();
        timestamps.dedup();
        let place = |t: u64| timestamps.binary_search(&t).ok();
        let origin = events().map(instant).min().unwrap_or_default();
        let mut page_trace = PageTrace {
            file: verdict.file.clone(),
            operator: header.operator.clone(),
            window: header.window,
            commit: header.commit.as_str(),
            observed: mode.map(|slack| [slack.tolerance, slack.lateness]),
            sources: self.named(header),
            conforms: verdict.conforms,
            judged: verdict.judged,
            doubts: verdict.doubts.clone(),
            cause: verdict.cause.clone(),
            lines: verdict.lines,
            places: ViolationPlaces::new(self.marked(&verdict.places), place),
            violations: verdict
                .violations
                .iter()
                .map(|violation| ViolationRow::new(violation, place))
                .collect(),
            totals: self.sums(),
            deadlines: self.deadlines.commonest(DEADLINES).into_iter().map(ExactNumber).collect(),
            run: None,
            origin: ExactNumber(origin),
            timestamps: differences(&timestamps),
            outcome: timestamps.iter().map(|t| self.outcome(*t)).collect(),
            fates: self.fates(&timestamps),
            lineages: self
                .lineages
                .iter()
                .filter_map(|(t, it)| Some(LineageRow::new(place(*t)?, it)))
                .collect(),
            ev: events().map(letter).collect(),
            at: Vec::with_capacity(self.events.len()),
            t: Vec::with_capacity(self.events.len()),
            p: Vec::with_capacity(self.events.len()),
            x: Vec::new(),
            line: self.is_part.then(|| {
                let lines: Vec<u64> = self.events.iter().map(|(line, _)| *line).collect();
                differences(&lines)
            }),
            capped: (self.left_out > 0).then(|| CappedSums {
                events: self.len() as u64 + self.left_out,
                violations: verdict.broken(),
            }),
        };
        let (mut at, mut t) = (origin, 0);
        for event in events() {
            page_trace.at.push(i128::from(instant(event)) - i128::from(at));
            at = instant(event);
            let next = event
                .t()
                .map_or(t, |t| i64::try_from(place(t).unwrap_or_default()).unwrap_or(i64::MAX));
            page_trace.t.push(next - t);
            t = next;
            let source = priority(event).and_then(|p| self.sources.get(&p));
            page_trace.p.push(source.map_or(0, |source| source + 1));
            more_of(event, &mut page_trace.x);
        }
        page_trace
    }

    /// Returns the violations that are marked in addition to the listed ones.
    fn marked<'a>(&self, places: &'a [ViolationPlace]) -> &'a [ViolationPlace] {
        let most = if self.left_out > 0 { MARKS } else { usize::MAX };
        &places[..places.len().min(most)]
    }

    /// Returns the index of a source that the trace mentions.
    fn place(&self, p: u64) -> usize {
        self.sources.get(&p).copied().unwrap_or_default()
    }

    fn sums(&self) -> Sums {
        let Totals { messages, forwarded, missed, refused, open, response, rows } =
            self.statistics.totals();
        let line = |RequestRow { p, counts, response }| {
            let response = response.map(ResponseColumn::new);
            let deadlines = self.deadlines.spread(p).map(|spread| spread.map(ExactNumber));
            SourceRow { place: self.place(p), counts, response, deadlines }
        };
        let mut rows: Vec<SourceRow> = rows.into_iter().map(line).collect();
        rows.sort_unstable_by_key(|line| line.place);
        let response = response.map(ResponseColumn::new);
        Sums { messages, forwarded, missed, refused, open, response, rows }
    }

    fn outcome(&self, t: u64) -> i64 {
        match self.statistics.outcome(t) {
            TimestampOutcome::Forwarded { p } => i64::try_from(self.place(p)).unwrap_or(i64::MAX),
            TimestampOutcome::Missed => -1,
            TimestampOutcome::Open => -2,
            TimestampOutcome::Unopened => -3,
        }
    }

    fn fates(&self, timestamps: &[u64]) -> String {
        let mut sources: Vec<(usize, u64)> =
            self.sources.iter().map(|(p, place)| (*place, *p)).collect();
        sources.sort_unstable();
        let fate = |t: u64, p: u64| self.statistics.request_outcome(t, p).unwrap_or_default();
        let fate = &fate;
        let fates = timestamps.iter().flat_map(|t| sources.iter().map(move |(_, p)| fate(*t, *p)));
        fates
            .filter_map(|request_outcome| {
                char::from_digit(u32::try_from(request_outcome).ok()?, 10)
            })
            .collect()
    }

    fn named(&self, header: &Header) -> Vec<SourceColumn> {
        let mut named: Vec<(usize, SourceColumn)> = Vec::with_capacity(self.sources.len());
        for (&p, &place) in &self.sources {
            let cloud = header.clouds.iter().find(|cloud| u64::from(cloud.p) == p);
            let name = cloud.and_then(|cloud| cloud.name.clone());
            named.push((
                place,
                SourceColumn { p: ExactNumber(p), name, known: p == 0 || cloud.is_some() },
            ));
        }
        named.sort_unstable_by_key(|(place, _)| *place);
        named.into_iter().map(|(_, source)| source).collect()
    }
}

impl ViolationPlaces {
    fn new(places: &[ViolationPlace], place: impl Fn(u64) -> Option<usize>) -> Self {
        let (mut columns, mut before) = (Self::default(), 0);
        for ViolationPlace { line, t, rule } in places {
            let rule = (rule.id(), rule.sentence());
            let known = columns.rules.iter().position(|known| *known == rule);
            columns.rule.push(known.unwrap_or(columns.rules.len()));
            if known.is_none() {
                columns.rules.push(rule);
            }
            columns.line.push(i128::from(*line) - before);
            before = i128::from(*line);
            columns.t.push(t.and_then(&place).map_or(0, |place| place + 1));
        }
        columns
    }
}

impl LineageRow {
    fn new(t: usize, MessageLineage { origin, age, missing }: &MessageLineage) -> Self {
        let (stream, seq) = match origin {
            Some(Origin { stream, seq }) => (Some(stream.to_string()), *seq),
            None => (None, None),
        };
        let [age, seq] = [*age, seq].map(|number| number.map(ExactNumber));
        let missing = missing.iter().map(ToString::to_string).collect();
        Self { t, age, origin: stream, seq, missing }
    }
}

impl ResponseColumn {
    fn new(quantile: Option<Quantile>) -> Self {
        match quantile {
            Some(Quantile::Exactly(at) | Quantile::AtLeast(at)) => Self::Exactly(nanos(at)),
            Some(Quantile::Never) => Self::Never("never"),
            None => Self::None,
        }
    }
}

impl ViolationRow {
    fn new(violation: &Violation, place: impl Fn(u64) -> Option<usize>) -> Self {
        let Violation { line, t, rule, late, .. } = *violation;
        let (found, expected) = (violation.found.clone(), violation.expected.clone());
        let (rule, sentence) = (rule.id(), rule.sentence());
        Self { line, t: t.and_then(place), rule, sentence, found, expected, late }
    }
}

impl Serialize for ExactNumber {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0 <= EXACT {
            serializer.serialize_u64(self.0)
        } else {
            serializer.collect_str(&self.0)
        }
    }
}

/// Returns ascending numbers, each as its difference from the number before.
fn differences(numbers: &[u64]) -> Vec<ExactNumber> {
    let before = std::iter::once(&0).chain(numbers);
    numbers.iter().zip(before).map(|(number, before)| ExactNumber(number - before)).collect()
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
        Event::Decision(Decision::Final { .. }) => 'z',
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
            | Decision::Final { p, .. }
            | Decision::Cancel { p, .. },
        ) => Some(*p),
    }
}

/// Appends the further values of an event. An open has its deadline or −1. An offer has its
/// deadline and its backlog. A request has the time to its due instant. A refusal or a drop has the
/// index of its reason.
fn more_of(event: &Event, x: &mut Vec<i128>) {
    let place = |place: usize| i128::try_from(place).unwrap_or(i128::MAX);
    match *event {
        Event::Input(Input::Open { deadline, .. }) => x.push(deadline.map_or(-1, i128::from)),
        Event::Input(Input::Offer { deadline, backlog, .. }) => {
            x.extend([i128::from(deadline), i128::from(backlog)]);
        }
        Event::Decision(Decision::Request { at, due, .. }) => {
            x.push(i128::from(due) - i128::from(at));
        }
        Event::Decision(Decision::RefuseOpen { why, .. }) => {
            x.push(place(reasons::index_of_open(why)));
        }
        Event::Decision(Decision::RefuseOffer { why, .. }) => {
            x.push(place(reasons::index_of_offer(why)));
        }
        Event::Decision(Decision::Drop { why, .. }) => x.push(place(why.index())),
        Event::Input(Input::Result { .. } | Input::Fail { .. } | Input::Tick { .. })
        | Event::Decision(
            Decision::Timer { .. }
            | Decision::Hold { .. }
            | Decision::Emit { .. }
            | Decision::Final { .. }
            | Decision::Miss { .. }
            | Decision::Cancel { .. },
        ) => {}
    }
}
