//! The observed judge goes through a trace line by line, and finds what a look at all lines of a timestamp at once finds.

use std::collections::{BTreeMap, BTreeSet};

use fuseline_traces::observed::{
    BrokenRule, Judge, MessageHistory, Slack, TimeOrderError, Verdict, Violation,
};
use fuseline_traces::{
    Cloud, Commit, Decision, DropReason, Event, Header, Input, OpenRefusal, Reference,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

fn header(commit: Commit) -> Header {
    let clouds = [1, 2].map(|p| Cloud { p, name: None, limit: 9, resume: 8 }).to_vec();
    Header { operator: None, window: 3, commit, clouds }
}

/// A judge that has read events; their lines begin with the second.
fn read(
    commit: Commit,
    slack: Slack,
    period: Option<u64>,
    events: &[Event],
) -> Result<Judge, TimeOrderError> {
    let mut judge = Judge::new("a.jsonl", &header(commit), slack);
    if let Some(period) = period {
        judge = judge.with_period(period);
    }
    for (line, event) in (2..).zip(events) {
        judge.line(line, event)?;
    }
    Ok(judge)
}

fn judged(commit: Commit, slack: Slack, events: &[Event]) -> Result<Verdict, TimeOrderError> {
    Ok(read(commit, slack, None, events)?.finish())
}

/// The timestamps that do not conform, apart from gaps.
fn broken(verdict: &Verdict) -> BTreeSet<u64> {
    let broken = verdict.violations.iter().filter(|found| found.rule != BrokenRule::J1);
    broken.filter_map(|found| found.t).collect()
}

fn at(event: &Event) -> u64 {
    match event {
        Event::Input(input) => input.at(),
        Event::Decision(decision) => decision.at(),
    }
}

/// The timestamps that do not conform, and those that are left open: all lines of each at once, by the words of `SPEC.md`.
fn naive(commit: Commit, slack: Slack, end: u64, events: &[Event]) -> [BTreeSet<u64>; 2] {
    let mut by_t: BTreeMap<u64, Vec<(Event, bool)>> = BTreeMap::new();
    let mut records_opens = false;
    for event in events {
        if let Some(t) = event.t() {
            by_t.entry(t).or_default().push((*event, records_opens));
        }
        records_opens |= matches!(event, Event::Input(Input::Open { .. }));
    }
    let fates: Vec<(u64, Option<MessageEnding>)> =
        by_t.into_iter().map(|(t, events)| (t, fate(commit, slack, end, &events))).collect();
    let of = |fate| {
        let are = fates.iter().filter(move |(_, other)| *other == Some(fate));
        are.map(|(t, _)| *t).collect()
    };
    [of(MessageEnding::Breaks), of(MessageEnding::Open)]
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum MessageEnding {
    Breaks,
    /// Nothing came out, nor had to.
    Open,
}

fn end(events: &[Event]) -> u64 {
    events.iter().map(at).max().unwrap_or(0)
}

/// The instants of opens with their deadlines.
type Opens = Vec<(u64, Option<u64>)>;
/// The instants of refusals with their places.
type Refusals = BTreeSet<(u64, usize)>;

/// The opens that no refusal takes away.
fn accepted(reach: u64, opens: &[(u64, Option<u64>)], refusals: &Refusals) -> Opens {
    let mut opens = opens.to_vec();
    for (at, _) in refusals {
        let nearest = (0..opens.len()).min_by_key(|place| opens[*place].0.abs_diff(*at));
        if let Some(place) = nearest.filter(|place| opens[*place].0.abs_diff(*at) <= reach) {
            opens.remove(place);
        }
    }
    opens
}

/// How many gaps longer than `most` there are between opens, and at the end.
fn gaps(most: u64, slack: Slack, events: &[Event]) -> usize {
    let reach = 2 * slack.tolerance + slack.lateness;
    let mut by_t: BTreeMap<u64, (Opens, Refusals)> = BTreeMap::new();
    for (i, event) in events.iter().enumerate() {
        match *event {
            Event::Input(Input::Open { at, t, deadline }) => {
                by_t.entry(t).or_default().0.push((at, deadline));
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
        instants.extend(events.iter().map(at).min());
    }
    instants.push(end(events));
    instants.sort_unstable();
    instants.windows(2).filter(|pair| pair[1] - pair[0] > most).count()
}

fn fate(commit: Commit, slack: Slack, end: u64, events: &[(Event, bool)]) -> Option<MessageEnding> {
    let reach = 2 * slack.tolerance + slack.lateness;
    let mut story = MessageHistory::default();
    let (mut opens, mut refusals, mut is_stranger) = (vec![], BTreeSet::new(), false);
    let (mut unknown, mut superseded) = (BTreeSet::new(), BTreeSet::new());
    for (i, (event, records_opens)) in events.iter().enumerate() {
        match *event {
            Event::Input(Input::Open { at, deadline, .. }) => opens.push((at, deadline)),
            Event::Input(Input::Result { at, p, .. }) => story.results.push((p, at)),
            Event::Input(Input::Fail { at, p, .. }) => story.failures.push((p, at)),
            Event::Decision(Decision::Request { at, p, due, .. }) => {
                is_stranger |= p == 0 || p > 2;
                story.requests.push((p, at, due));
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
            Event::Decision(Decision::Emit { at, p, .. }) => story.outputs.push((Some(p), at)),
            Event::Decision(Decision::Miss { at, .. }) => story.outputs.push((None, at)),
            _ => {}
        }
    }
    let refused_from = refusals.iter().map(|(at, _)| *at).min();
    let opens = accepted(reach, &opens, &refusals);
    let requested = story.requests.iter().map(|(_, at, _)| *at);
    let out = story.outputs.iter().map(|(_, at)| *at);
    let known = opens.iter().map(|(at, _)| *at).chain(requested).chain(out).min();
    let counts = |fact: &(u64, u64)| {
        let is_before = |at: u64| known.is_none_or(|known| at + reach < known);
        let is_refused = refused_from.is_some_and(is_before);
        let is_before = is_before(fact.1);
        !unknown.contains(fact) && !((superseded.contains(fact) || is_refused) && is_before)
    };
    story.results.retain(counts);
    story.failures.retain(counts);
    let was_refused =
        refused_from.is_some_and(|refused| known.is_none_or(|known| known + reach >= refused));
    if opens.is_empty() && was_refused {
        let is_none = story.requests.is_empty() && story.outputs.is_empty();
        return (!is_none).then_some(MessageEnding::Breaks);
    }
    if known.is_none() && story.results.is_empty() && story.failures.is_empty() {
        return None;
    }
    story.open = opens.first().copied();
    if opens.len() > 1 || is_stranger || !story.is_explained(commit, slack, end) {
        return Some(MessageEnding::Breaks);
    }
    story.outputs.is_empty().then_some(MessageEnding::Open)
}

/// What the reference machine does, with instants that are off and lines out of order.
fn traces() -> impl Strategy<Value = (Commit, Slack, Vec<Event>)> {
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
    let slack = (0..4_u64, 0..6_u64);
    let steps = vec((0..12_u64, input), 1..40);
    let noise = vec((0..9_u64, 0..9_u64, 0..40_u8), 160);
    (any::<bool>(), slack, steps, noise).prop_map(|(eager, (tolerance, lateness), steps, noise)| {
        let commit = if eager { Commit::Eager } else { Commit::Patient };
        let slack = Slack { tolerance, lateness };
        (commit, slack, recorded(commit, slack, &steps, &noise))
    })
}

fn recorded(
    commit: Commit,
    slack: Slack,
    steps: &[(u64, Input)],
    noise: &[(u64, u64, u8)],
) -> Vec<Event> {
    let mut machine = Reference::new(&header(commit));
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
            let off = off % (2 * slack.tolerance + 1);
            // Now and then a line is lost, or later than it may be.
            if odd == 0 {
                continue;
            }
            let is_output =
                matches!(event, Event::Decision(Decision::Emit { .. } | Decision::Miss { .. }));
            let late = if is_output { late % (slack.lateness + 1) } else { 0 };
            let far = if odd == 1 { 25 } else { 0 };
            events.push(moved(event, now + off - slack.tolerance + late + far));
        }
    }
    // Out of order by less than twice the tolerance.
    events.sort_by_key(|event| at(event) + at(event) * 7 % (2 * slack.tolerance + 1));
    events
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

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..Default::default() })]

    #[test]
    fn what_is_judged_along_the_way_is_what_a_look_at_the_whole_trace_finds(
        (commit, slack, events) in traces()
    ) {
        let verdict = judged(commit, slack, &events).expect("it is in order");
        prop_assert_eq!(broken(&verdict), naive(commit, slack, end(&events), &events)[0].clone(), "{:#?}", events);
        prop_assert_eq!(verdict.unfinished, None);
    }

    /// Once the run is known to have ended, nothing more is to come.
    #[test]
    fn what_an_ended_run_owes_is_what_a_look_at_the_whole_trace_finds(
        (commit, slack, events) in traces()
    ) {
        let judge = read(commit, slack, None, &events).expect("it is in order");
        let verdict = judge.finish_ended();
        let [breaks, open] = naive(commit, slack, u64::MAX, &events);
        prop_assert_eq!(broken(&verdict), breaks, "{:#?}", events);
        prop_assert_eq!(verdict.unfinished, Some(open.len() as u64), "{:#?}", events);
    }

    /// J1.
    #[test]
    fn gaps_are_those_that_a_look_at_all_opens_finds((commit, slack, events) in traces(), period in 0..60_u64) {
        let judge = read(commit, slack, Some(period), &events).expect("it is in order");
        let verdict = judge.finish();
        let found = verdict.violations.iter().filter(|found| found.rule == BrokenRule::J1).count();
        let most = period + slack.lateness + 2 * slack.tolerance;
        prop_assert_eq!(found, gaps(most, slack, &events), "{:#?}", events);
        let others = naive(commit, slack, end(&events), &events);
        prop_assert_eq!(broken(&verdict), others[0].clone(), "they change nothing else");
    }

    /// Nor do the ends of every range matter, nor what makes no sense: there is a verdict or a line out of order.
    #[test]
    fn every_trace_has_its_verdict(
        commit in prop::sample::select(&Commit::ALL[..]),
        tolerance in number(),
        lateness in number(),
        events in vec(event(), 0..24),
    ) {
        let slack = Slack { tolerance, lateness };
        for (period, is_ended) in [(None, false), (None, true), (Some(0), false), (Some(u64::MAX), true)] {
            let Ok(judge) = read(commit, slack, period, &events) else { continue };
            let verdict = if is_ended { judge.finish_ended() } else { judge.finish() };
            prop_assert_eq!(verdict.conforms, verdict.violations.is_empty() && verdict.judged > 0);
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

fn event() -> impl Strategy<Value = Event> {
    let n = number;
    let decision = prop_oneof![
        3 => (n(), n(), n(), n()).prop_map(|(at, t, p, due)| Decision::Request { at, t, p, due }),
        2 => (n(), n(), n()).prop_map(|(at, t, p)| Decision::Emit { at, t, p }),
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
