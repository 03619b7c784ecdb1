//! Checks that the observed judge, line by line, finds what a look at all lines of a timestamp at
//! once finds.

use std::collections::{BTreeMap, BTreeSet};

use fuseline_traces::observed::{Judge, MessageHistory, Slack, SourceSlack, TimeOrderError};
use fuseline_traces::{
    Annotations, Cloud, Commit, Decision, DoubtKind, DropReason, Event, Header, HeaderAnnotations,
    Input, OpenRefusal, Reference, Rule, ValueKeys, Verdict, Violation,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::strategy::ValueTree;

fn header(commit: Commit) -> Header {
    let clouds = [1, 2].map(|p| Cloud { p, name: None, limit: 9, resume: 8 }).to_vec();
    Header { operator: None, window: 3, commit, clouds }
}

/// An event as it is recorded.
type RecordedEvent = (Event, Annotations);

/// States how a trace is judged.
#[derive(Clone, Debug)]
struct Terms {
    commit: Commit,
    own: Slack,
    slack: SourceSlack,
    /// The source with another tolerance than `slack` has, and that tolerance.
    tolerance: Option<(u64, u64)>,
    header: HeaderAnnotations,
}

impl Terms {
    fn new(commit: Commit, own: Slack, tolerance: Option<(u64, u64)>, without_local: bool) -> Self {
        let slack = SourceSlack::from(own);
        let slack = match tolerance {
            Some((p, tolerance)) => slack.with_tolerance_of(p, tolerance),
            None => slack,
        };
        let header = HeaderAnnotations { without_local, max_ages: BTreeMap::from([(1, 1)]) };
        Self { commit, own, slack, tolerance, header }
    }

    /// Returns the error of a line's stamp.
    fn tolerance(&self, event: &Event) -> u64 {
        match event {
            Event::Input(Input::Result { p, .. } | Input::Fail { p, .. })
            | Event::Decision(Decision::Request { p, .. }) => self.slack.tolerance_of(*p),
            _ => self.own.tolerance,
        }
    }

    /// Returns the greatest instant, where a stamp with a greater error counts for less.
    fn end(&self, events: &[RecordedEvent]) -> u64 {
        let at = |(event, _): &RecordedEvent| {
            at(event).saturating_sub(self.tolerance(event).saturating_sub(self.own.tolerance))
        };
        events.iter().map(at).max().unwrap_or(0)
    }
}

/// Returns a judge that has read events whose lines begin with the second.
fn read(
    terms: &Terms,
    period: Option<u64>,
    events: &[RecordedEvent],
) -> Result<Judge, TimeOrderError> {
    let mut judge = Judge::new("a.jsonl", &header(terms.commit), terms.own)
        .with_header_annotations(&terms.header);
    if let Some((p, tolerance)) = terms.tolerance {
        judge = judge.with_tolerance_of(p, tolerance);
    }
    if let Some(period) = period {
        judge = judge.with_period(period);
    }
    for (line, (event, annotations)) in (2..).zip(events) {
        judge.annotated_line(line, event, annotations)?;
    }
    Ok(judge)
}

fn judged(terms: &Terms, events: &[RecordedEvent]) -> Result<Verdict, TimeOrderError> {
    Ok(read(terms, None, events)?.finish())
}

/// Finds each kind of violation in some trace, so that the comparison is not vacuous.
#[test]
fn the_traces_break_the_rules_of_further_keys_too() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut broken = BTreeSet::new();
    for _ in 0..600 {
        let (terms, events) = traces().new_tree(&mut runner).unwrap().current();
        let verdict = judged(&terms, &events).expect("it is in order");
        broken.extend(verdict.violations.iter().map(|found| found.rule));
    }
    for rule in [Rule::D2, Rule::D18, Rule::F2, Rule::J2, Rule::P7] {
        assert!(broken.contains(&rule), "{rule} in {broken:?}");
    }
}

/// Returns the timestamps that do not conform by themselves, apart from gaps and the window.
fn broken(verdict: &Verdict) -> BTreeSet<u64> {
    let alone = |found: &&Violation| !matches!(found.rule, Rule::J1 | Rule::P9);
    let broken = verdict.violations.iter().filter(alone);
    broken.filter_map(|found| found.t).collect()
}

fn at(event: &Event) -> u64 {
    match event {
        Event::Input(input) => input.at(),
        Event::Decision(decision) => decision.at(),
    }
}

/// Returns the timestamps that do not conform, and those that stay open, from all lines of each at
/// once, by the words of `SPEC.md`.
fn naive(terms: &Terms, end: u64, events: &[RecordedEvent]) -> [BTreeSet<u64>; 2] {
    let mut by_t: BTreeMap<u64, Vec<(RecordedEvent, bool)>> = BTreeMap::new();
    let mut records_opens = false;
    for (event, annotations) in events {
        if let Some(t) = event.t() {
            by_t.entry(t).or_default().push(((*event, annotations.clone()), records_opens));
        }
        records_opens |= matches!(event, Event::Input(Input::Open { .. }));
    }
    let fates: Vec<(u64, Option<MessageEnding>)> =
        by_t.into_iter().map(|(t, events)| (t, fate(terms, t, end, &events))).collect();
    let of = |fate| {
        let are = fates.iter().filter(move |(_, other)| *other == Some(fate));
        are.map(|(t, _)| *t).collect()
    };
    [of(MessageEnding::Breaks), of(MessageEnding::Open)]
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum MessageEnding {
    Breaks,
    /// It has no output and owes none.
    Open,
}

/// The instants of opens, each with its deadline and the instant by which it demands an output.
type Opens = Vec<(u64, (Option<u64>, Option<u64>))>;
/// The instants of refusals, with their places.
type Refusals = BTreeSet<(u64, usize)>;

/// Returns the opens that no refusal removes.
fn accepted(reach: u64, opens: &Opens, refusals: &Refusals) -> Opens {
    let mut opens = opens.clone();
    for (at, _) in refusals {
        let nearest = (0..opens.len()).min_by_key(|place| opens[*place].0.abs_diff(*at));
        if let Some(place) = nearest.filter(|place| opens[*place].0.abs_diff(*at) <= reach) {
            opens.remove(place);
        }
    }
    opens
}

/// Counts the gaps longer than `most` between opens, and at the end.
fn gaps(most: u64, terms: &Terms, events: &[RecordedEvent]) -> usize {
    let reach = 2 * terms.own.tolerance + terms.own.lateness;
    let mut by_t: BTreeMap<u64, (Opens, Refusals)> = BTreeMap::new();
    for (i, (event, _)) in events.iter().enumerate() {
        match *event {
            Event::Input(Input::Open { at, t, deadline }) => {
                by_t.entry(t).or_default().0.push((at, (deadline, None)));
            }
            Event::Decision(Decision::RefuseOpen { at, t, .. }) => {
                by_t.entry(t).or_default().1.insert((at, i));
            }
            _ => {}
        }
    }
    let of_t = by_t.values().flat_map(|(opens, refusals)| accepted(reach, opens, refusals));
    let mut instants: Vec<u64> = of_t.map(|(at, _)| at).collect();
    if instants.is_empty() {
        instants.extend(events.iter().map(|(event, _)| at(event)).min());
    }
    instants.push(instants.iter().copied().fold(terms.end(events), u64::max));
    instants.sort_unstable();
    instants.windows(2).filter(|pair| pair[1] - pair[0] > most).count()
}

/// An output: instant, line.
type OutputLine = (u64, usize);
/// The lines of a timestamp.
type TimestampLines = (Opens, Refusals, Vec<OutputLine>);
/// A timestamp, the instants of its accepted opens, and its first output.
type OpenedTimestamp = (u64, Vec<u64>, Option<OutputLine>);

/// Returns, for each accepted open, its timestamp, the number of others that were certainly open
/// then, and the number that may have been (P9). Only outputs that came in time count.
fn crowds(terms: &Terms, events: &[RecordedEvent]) -> Vec<(u64, usize, usize)> {
    let (twice, reach) = (2 * terms.own.tolerance, 2 * terms.own.tolerance + terms.own.lateness);
    let mut by_t: BTreeMap<u64, TimestampLines> = BTreeMap::new();
    for (i, (event, _)) in events.iter().enumerate() {
        match *event {
            Event::Input(Input::Open { at, t, deadline }) => {
                by_t.entry(t).or_default().0.push((at, (deadline, None)));
            }
            Event::Decision(Decision::RefuseOpen { at, t, .. }) => {
                by_t.entry(t).or_default().1.insert((at, i));
            }
            Event::Decision(
                Decision::Emit { at, t, .. }
                | Decision::Final { at, t, .. }
                | Decision::Miss { at, t },
            ) => by_t.entry(t).or_default().2.push((at, i)),
            _ => {}
        }
    }
    let opened: Vec<OpenedTimestamp> = by_t
        .into_iter()
        .map(|(t, (opens, refusals, out))| {
            let opens = accepted(reach, &opens, &refusals);
            (t, opens.iter().map(|(at, _)| *at).collect(), out.into_iter().min())
        })
        .collect();
    // The line after which no earlier output can come.
    let settled = |opened_at: u64| {
        let is_past = |(event, _): &RecordedEvent| {
            at(event).saturating_sub(terms.tolerance(event))
                > opened_at + reach + terms.own.tolerance
        };
        events.iter().position(is_past).unwrap_or(events.len())
    };
    let crowd = |t: u64, at: u64| {
        let others = opened.iter().filter(|(other, opens, _)| {
            *other != t && opens.first().is_some_and(|open| open + twice < at)
        });
        let settled = settled(at);
        let is_told = |(out, i): (u64, usize)| out > at + reach && i <= settled;
        let surely = others.clone().filter(|(.., out)| out.is_some_and(is_told));
        let perhaps = others.filter(|(.., out)| out.is_none_or(|(out, _)| out > at));
        (t, surely.count(), perhaps.count())
    };
    let all = opened.iter().flat_map(|(t, opens, _)| opens.iter().map(move |at| (*t, *at)));
    all.map(|(t, at)| crowd(t, at)).collect()
}

/// A request line: source, instant, due instant, attempt.
type RequestLine = (u64, u64, u64, Option<u8>);
/// A failure line: source, instant, attempt.
type FailureLine = (u64, u64, Option<u8>);

/// Returns one request for each source, unless an attempt is requested twice (A47).
fn folded(requests: &[RequestLine]) -> Vec<(u64, u64, u64)> {
    let mut folded = Vec::new();
    for p in requests.iter().map(|(p, ..)| *p).collect::<BTreeSet<_>>() {
        let of_p: Vec<_> = requests.iter().filter(|(q, ..)| *q == p).collect();
        let attempts: BTreeSet<_> = of_p.iter().map(|(.., attempt)| *attempt).collect();
        let first = of_p.iter().map(|(_, at, ..)| *at).min();
        let first = of_p.iter().find(|(_, at, ..)| Some(*at) == first);
        let is_twice = attempts.len() < of_p.len();
        let counted = if is_twice { &of_p[..] } else { first.map(std::slice::from_ref).unwrap() };
        folded.extend(counted.iter().map(|(p, at, due, _)| (*p, *at, *due)));
    }
    folded
}

/// Returns the whole requests that failed, and the requests whose attempts all failed (A47).
fn failed(requests: &[RequestLine], failures: &[FailureLine]) -> Vec<(u64, u64)> {
    let whole = failures.iter().filter(|(.., attempt)| attempt.is_none());
    let mut failed: Vec<(u64, u64)> = whole.map(|(p, at, _)| (*p, *at)).collect();
    for p in [1, 2] {
        let attempts: BTreeSet<_> =
            requests.iter().filter(|(q, ..)| *q == p).map(|(.., attempt)| *attempt).collect();
        let first = |attempt: &Option<u8>| {
            let of_it = failures.iter().filter(|(q, _, it)| *q == p && it == attempt);
            attempt.and_then(|_| of_it.map(|(_, at, _)| *at).min())
        };
        let firsts: Option<Vec<u64>> = attempts.iter().map(first).collect();
        failed.extend(firsts.into_iter().flatten().max().map(|at| (p, at)));
    }
    failed
}

/// Returns `true` if an output may not have the value that it names, or that the results name (D2,
/// D18).
fn is_value_wrong(
    terms: &Terms,
    t: u64,
    (p, at, value): (u64, u64, ValueKeys),
    came: &[ResultLine],
) -> bool {
    let by = at + terms.own.tolerance + terms.slack.tolerance_of(p);
    let results: Vec<_> = came.iter().filter(|came| came.0 == p && came.1 <= by).collect();
    let all_say = !results.is_empty() && results.iter().all(|came| came.2.of.is_some());
    let latest = results.iter().filter_map(|came| came.2.of).max().filter(|_| all_say);
    let (first, last) = terms.header.values_of(t, p);
    let is_of_another = match (value.of, latest) {
        (None, None) => false,
        (None, Some(latest)) => latest < first || latest > last,
        (Some(of), latest) => of < first || of > last || latest.is_some_and(|it| of > it),
    };
    let is_for_another = |value: &ValueKeys| value.meant_for.is_some_and(|it| it != t);
    let are_all = !results.is_empty() && results.iter().all(|came| is_for_another(&came.2));
    is_of_another || is_for_another(&value) || are_all
}

/// A result: source, instant, and what it says of its value.
type ResultLine = (u64, u64, ValueKeys);

fn fate(
    terms: &Terms,
    t: u64,
    end: u64,
    events: &[(RecordedEvent, bool)],
) -> Option<MessageEnding> {
    let (own, lateness) = (terms.own.tolerance, terms.own.lateness);
    let reach = 2 * own + lateness;
    let without_local = terms.header.without_local;
    let mut story = MessageHistory { without_local, ..MessageHistory::default() };
    let (mut opens, mut refusals, mut is_stranger) = (vec![], BTreeSet::new(), false);
    let (mut unknown, mut superseded) = (BTreeSet::new(), BTreeSet::new());
    let (mut requests, mut results, mut failures) = (vec![], Vec::<ResultLine>::new(), vec![]);
    let mut sent = vec![];
    for (i, ((event, annotations), records_opens)) in events.iter().enumerate() {
        let (value, attempt) = (annotations.value(), annotations.attempt);
        match *event {
            Event::Input(Input::Open { at, deadline, .. }) => {
                opens.push((at, (deadline, annotations.due(at))));
            }
            Event::Input(Input::Result { at, p, .. }) => results.push((p, at, value)),
            Event::Input(Input::Fail { at, p, .. }) => failures.push((p, at, attempt)),
            Event::Decision(Decision::Request { at, p, due, .. }) => {
                is_stranger |= p == 0 || p > 2;
                requests.push((p, at, due, attempt));
            }
            Event::Decision(Decision::RefuseOpen { at, .. }) => drop(refusals.insert((at, i))),
            Event::Decision(Decision::Drop { at, p, why: DropReason::Unknown, .. }) => {
                unknown.insert((p, at));
            }
            Event::Decision(Decision::Drop { at, p, why: DropReason::Superseded, .. })
                if *records_opens =>
            {
                superseded.insert((p, at));
            }
            Event::Decision(Decision::Emit { at, p, .. }) => {
                story.outputs.push((Some(p), at));
                sent.push((p, at, value));
            }
            Event::Decision(Decision::Miss { at, .. }) => story.outputs.push((None, at)),
            Event::Decision(Decision::Final { at, p, .. }) => story.finals.push((p, at)),
            _ => {}
        }
    }
    let refused_from = refusals.iter().map(|(at, _)| *at).min();
    let opens = accepted(reach, &opens, &refusals);
    let opened = opens.iter().map(|(at, _)| (*at, own));
    let finals = story.finals.iter().map(|(_, at)| *at);
    let out = story.outputs.iter().map(|(_, at)| *at).chain(finals).map(|at| (at, own));
    let requested = requests.iter().map(|(p, at, ..)| (*at, terms.slack.tolerance_of(*p)));
    let known: Vec<(u64, u64)> = opened.chain(requested).chain(out).collect();
    let is_before = |at: u64, tolerance: u64| {
        known.iter().all(|(known, other)| at + tolerance + other + lateness < *known)
    };
    let is_refused = refused_from.is_some_and(|refused| is_before(refused, own));
    let counts = |p: u64, at: u64| {
        let is_before = is_before(at, terms.slack.tolerance_of(p));
        !unknown.contains(&(p, at)) && !((superseded.contains(&(p, at)) || is_refused) && is_before)
    };
    results.retain(|(p, at, _)| counts(*p, *at));
    failures.retain(|(p, at, _)| counts(*p, *at));
    // It was refused, unless a line of it certainly came before.
    let was_refused = refusals.iter().any(|(refused, _)| {
        !known.iter().any(|(known, other)| known + other + own + lateness < *refused)
    });
    if opens.is_empty() && was_refused {
        let is_none = requests.is_empty() && story.outputs.is_empty() && story.finals.is_empty();
        return (!is_none).then_some(MessageEnding::Breaks);
    }
    if known.is_empty() && results.is_empty() && failures.is_empty() {
        return None;
    }
    story.open = opens.first().map(|(at, (deadline, _))| (*at, *deadline));
    story.requests = folded(&requests);
    story.results = results.iter().map(|(p, at, _)| (*p, *at)).collect();
    story.failures = failed(&requests, &failures);
    let is_explained = story.is_explained(terms.commit, terms.slack.clone(), end);
    if opens.len() > 1 || is_stranger || !is_explained {
        return Some(MessageEnding::Breaks);
    }
    let mut sent = sent.into_iter();
    if sent.any(|output| is_value_wrong(terms, t, output, &results)) {
        return Some(MessageEnding::Breaks);
    }
    // The message's own deadline (J2).
    let due = opens.first().and_then(|(_, (_, due))| *due);
    let first = story.outputs.iter().map(|(_, at)| *at).min();
    let is_late = due.is_some_and(|due| match first {
        Some(at) => at > due + reach,
        None => end >= due + reach,
    });
    if is_late {
        return Some(MessageEnding::Breaks);
    }
    let is_none = story.outputs.is_empty() && story.finals.is_empty();
    is_none.then_some(MessageEnding::Open)
}

/// Generates what the reference machine does, with wrong instants, lines out of order and keys that
/// are sometimes wrong.
fn traces() -> impl Strategy<Value = (Terms, Vec<RecordedEvent>)> {
    let input = prop_oneof![
        4 => (0..6_u64, option::of(1..30_u64))
            .prop_map(|(t, deadline)| Input::Open { at: 0, t, deadline }),
        5 => (0..6_u64, 1..4_u64, 1..30_u64).prop_map(|(t, p, deadline)| Input::Offer {
            at: 0, t, p, deadline, backlog: 0
        }),
        6 => (0..6_u64, 0..4_u64).prop_map(|(t, p)| Input::Result { at: 0, t, p }),
        2 => (0..6_u64, 0..4_u64).prop_map(|(t, p)| Input::Fail { at: 0, t, p }),
        3 => Just(Input::Tick { at: 0 }),
    ];
    let slack = (0..4_u64, 0..6_u64, option::of((0..3_u64, 0..7_u64)));
    let steps = vec((0..12_u64, input), 1..40);
    let noise = vec((0..9_u64, 0..9_u64, 0..40_u8), 160);
    let header = (prop::sample::select(&Commit::ALL[..]), prop::bool::weighted(0.2));
    (header, slack, steps, noise).prop_map(
        |((commit, without_local), (tolerance, lateness, other), steps, noise)| {
            let own = Slack { tolerance, lateness };
            let terms = Terms::new(commit, own, other, without_local);
            let events = recorded(&terms, &steps, &noise);
            (terms, events)
        },
    )
}

fn recorded(terms: &Terms, steps: &[(u64, Input)], noise: &[(u64, u64, u8)]) -> Vec<RecordedEvent> {
    let mut machine = Reference::new(&header(terms.commit));
    let mut now = 20;
    let mut events = Vec::new();
    let mut noise = noise.iter().cycle();
    for (wait, input) in steps {
        now += wait;
        let input = redated(*input, now);
        let mut demands = Vec::new();
        machine.apply(&input, &mut demands);
        let decided = demands.into_iter().map(|(decision, _)| Event::Decision(decision));
        for event in std::iter::once(Event::Input(input)).chain(decided) {
            let (off, late, odd) = noise.next().copied().unwrap_or_default();
            let tolerance = terms.tolerance(&event);
            let off = off % (2 * tolerance + 1);
            // Sometimes a line is lost, or later than it may be.
            if odd == 0 {
                continue;
            }
            let is_output = matches!(
                event,
                Event::Decision(
                    Decision::Emit { .. } | Decision::Final { .. } | Decision::Miss { .. }
                )
            );
            let late = if is_output { late % (terms.own.lateness + 1) } else { 0 };
            let far = if odd == 1 { 25 } else { 0 };
            let at = (now + off + late + far).saturating_sub(tolerance);
            let annotations = annotations(&event, odd);
            let again = again(&event, &annotations, odd, at);
            events.push((moved(event, at), annotations));
            events.extend(again);
        }
    }
    // The lines are out of order by less than the tolerances of both.
    events.sort_by_key(|(event, _)| {
        let tolerance = terms.tolerance(event);
        at(event) + 9 + at(event) * 7 % (2 * tolerance + 1) - tolerance
    });
    events
}

/// Returns the further keys of a line, some of them wrong.
fn annotations(event: &Event, odd: u8) -> Annotations {
    let mut annotations = Annotations::NONE;
    match event {
        Event::Input(Input::Open { .. }) if odd.is_multiple_of(3) => {
            annotations.within = Some(u64::from(odd));
            annotations.age = odd.is_multiple_of(2).then_some(u64::from(odd / 3));
        }
        Event::Input(Input::Result { t, .. }) | Event::Decision(Decision::Emit { t, .. }) => {
            annotations.of = match odd % 9 {
                2 | 4 => Some(*t),
                5 => Some(t.saturating_sub(1)),
                7 if odd > 20 => Some(t.saturating_sub(2)),
                _ => None,
            };
            annotations.meant_for = match odd % 8 {
                3 => Some(*t),
                6 if odd > 20 => Some(t + 1),
                _ => None,
            };
        }
        Event::Input(Input::Fail { p, .. }) if *p > 0 && odd % 4 > 1 => {
            annotations.attempt = Some(odd % 2);
        }
        Event::Decision(Decision::Request { .. }) if !odd.is_multiple_of(4) => {
            annotations.attempt = Some(0);
        }
        _ => {}
    }
    annotations
}

/// Returns a second attempt, or the failure of the other one.
fn again(event: &Event, annotations: &Annotations, odd: u8, at: u64) -> Option<RecordedEvent> {
    let other = match event {
        Event::Decision(Decision::Request { .. }) if odd % 4 == 2 => Some(1),
        // The same attempt a second time is one too many.
        Event::Decision(Decision::Request { .. }) if odd == 27 => Some(0),
        Event::Input(Input::Fail { .. }) if odd % 3 == 1 => Some(1 - annotations.attempt?),
        _ => return None,
    };
    let later = at + u64::from(odd % 5);
    Some((moved(*event, later), Annotations { attempt: other, ..Annotations::NONE }))
}

fn redated(mut input: Input, now: u64) -> Input {
    match &mut input {
        Input::Open { at, .. }
        | Input::Offer { at, .. }
        | Input::Result { at, .. }
        | Input::Fail { at, .. }
        | Input::Tick { at } => *at = now,
    }
    input
}

fn moved(event: Event, now: u64) -> Event {
    match event {
        Event::Input(input) => Event::Input(redated(input, now)),
        Event::Decision(decision) => Event::Decision(decision.redated(now)),
    }
}

/// Returns the number of messages that were open when the run ended.
fn unfinished(verdict: &Verdict) -> u64 {
    let mut of_kind = verdict.doubts.iter().filter(|it| it.kind == DoubtKind::Unfinished);
    of_kind.next().map_or(0, |doubt| doubt.count)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..Default::default() })]

    #[test]
    fn streaming_agrees_with_the_naive_judge(
        (terms, events) in traces()
    ) {
        let verdict = judged(&terms, &events).expect("it is in order");
        prop_assert_eq!(broken(&verdict), naive(&terms, terms.end(&events), &events)[0].clone(), "{:#?}", events);
        prop_assert_eq!(unfinished(&verdict), 0);
    }

    /// If the run is known to have ended, nothing more is to come.
    #[test]
    fn ended_run_agrees_with_the_naive_judge(
        (terms, events) in traces()
    ) {
        let judge = read(&terms, None, &events).expect("it is in order");
        let verdict = judge.finish_ended();
        let [breaks, open] = naive(&terms, u64::MAX, &events);
        prop_assert_eq!(broken(&verdict), breaks, "{:#?}", events);
        prop_assert_eq!(unfinished(&verdict), open.len() as u64, "{:#?}", events);
    }

    /// The gaps are those that a look at all opens finds (J1).
    #[test]
    fn gaps_are_those_that_a_look_at_all_opens_finds((terms, events) in traces(), period in 0..60_u64) {
        let judge = read(&terms, Some(period), &events).expect("it is in order");
        let verdict = judge.finish();
        let found = verdict.violations.iter().filter(|found| found.rule == Rule::J1).count();
        let most = period + terms.own.lateness + 2 * terms.own.tolerance;
        prop_assert_eq!(found, gaps(most, &terms, &events), "{:#?}", events);
        let others = naive(&terms, terms.end(&events), &events);
        prop_assert_eq!(broken(&verdict), others[0].clone(), "they change nothing else");
    }

    /// The crowded opens are those that a look at all outputs finds (P9).
    #[test]
    fn crowded_opens_are_those_among_all_outputs((terms, events) in traces()) {
        let verdict = judged(&terms, &events).expect("it is in order");
        let found = verdict.violations.iter().filter(|found| found.rule == Rule::P9);
        let found: BTreeSet<u64> = found.filter_map(|found| found.t).collect();
        // A timestamp that is opened twice may be found at either open.
        let mut by_t: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
        for (t, surely, perhaps) in crowds(&terms, &events) {
            let most = by_t.entry(t).or_default();
            *most = (most.0.max(surely), most.1.max(perhaps));
        }
        for (t, (surely, perhaps)) in by_t {
            prop_assert!(surely < 3 || found.contains(&t), "{} in {:#?}", t, events);
            prop_assert!(perhaps >= 3 || !found.contains(&t), "{} in {:#?}", t, events);
        }
    }

    /// Neither the ends of any range nor nonsense prevents a verdict, or an error that a line is
    /// out of order.
    #[test]
    fn every_trace_has_its_verdict(
        commit in prop::sample::select(&Commit::ALL[..]),
        tolerance in number(),
        lateness in number(),
        other in option::of((0..4_u64, number())),
        without_local in any::<bool>(),
        events in vec((event(), any_annotations()), 0..24),
    ) {
        let terms = Terms::new(commit, Slack { tolerance, lateness }, other, without_local);
        for (period, is_ended) in [(None, false), (None, true), (Some(0), false), (Some(u64::MAX), true)] {
            let Ok(judge) = read(&terms, period, &events) else { continue };
            let verdict = if is_ended { judge.finish_ended() } else { judge.finish() };
            let is_clean = verdict.violations.is_empty() && verdict.doubts.is_empty();
            prop_assert_eq!(verdict.conforms, is_clean);
            let is_unjudged = verdict.doubts.iter().any(|doubt| doubt.kind == DoubtKind::Unjudged);
            prop_assert_eq!(is_unjudged, verdict.judged == 0);
            let is_told = |found: &Violation| found.t.is_none() || !found.story.is_empty();
            prop_assert!(verdict.violations.iter().all(is_told));
        }
    }
}

fn number() -> impl Strategy<Value = u64> {
    prop_oneof![
        4 => 0..4_u64,
        1 => Just(u64::MAX / 2),
        2 => u64::MAX - 2..=u64::MAX,
    ]
}

fn any_annotations() -> impl Strategy<Value = Annotations> {
    let n = || option::weighted(0.3, number());
    (n(), n(), option::weighted(0.3, 0..3_u8), n(), n()).prop_map(
        |(of, meant_for, attempt, within, age)| Annotations {
            of,
            meant_for,
            attempt,
            within,
            age,
            ..Annotations::NONE
        },
    )
}

fn event() -> impl Strategy<Value = Event> {
    let n = number;
    let decision = prop_oneof![
        3 => (n(), n(), n(), n()).prop_map(|(at, t, p, due)| Decision::Request { at, t, p, due }),
        2 => (n(), n(), n()).prop_map(|(at, t, p)| Decision::Emit { at, t, p }),
        1 => (n(), n(), n()).prop_map(|(at, t, p)| Decision::Final { at, t, p }),
        1 => (n(), n()).prop_map(|(at, t)| Decision::Miss { at, t }),
        1 => (n(), n()).prop_map(|(at, t)| Decision::RefuseOpen { at, t, why: OpenRefusal::Full }),
        1 => (n(), n(), n(), any::<bool>()).prop_map(|(at, t, p, is_unknown)| {
            let why = if is_unknown { DropReason::Unknown } else { DropReason::Superseded };
            Decision::Drop { at, t, p, why }
        }),
    ];
    let input = prop_oneof![
        2 => (n(), n(), option::of(n())).prop_map(|(at, t, deadline)| Input::Open { at, t, deadline }),
        3 => (n(), n(), n()).prop_map(|(at, t, p)| Input::Result { at, t, p }),
        1 => (n(), n(), n()).prop_map(|(at, t, p)| Input::Fail { at, t, p }),
        1 => n().prop_map(|at| Input::Tick { at }),
    ];
    prop_oneof![input.prop_map(Event::Input), decision.prop_map(Event::Decision)]
}
