use std::collections::BTreeSet;

use proptest::collection::{btree_map, vec};
use proptest::option;
use proptest::prelude::*;

use super::super::explain::{InstantRange, RetirementOutput, WideInstant};
use super::super::slack::Slack;
use super::*;

/// Searches all explanations, one after the other. This is the definition in `SPEC.md`, word for
/// word.
struct Search<'a> {
    story: &'a MessageHistory,
    commit: Commit,
    slack: &'a SourceSlack,
    end: u64,
    /// The instant until which something can happen.
    horizon: i64,
}

/// A fact that has an instant of its own.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Fact {
    Open,
    Request(usize),
    Result(usize),
    Failure(usize),
    /// The absence of local, which fails at any instant until everything is requested.
    NoLocal,
}

/// The state that an explanation has reached.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct State {
    now: i64,
    left: BTreeSet<Fact>,
    pending: BTreeSet<u64>,
    requested: BTreeSet<u64>,
    cached: BTreeSet<u64>,
    armed: BTreeSet<(u64, i64)>,
    is_open: bool,
    out: ProducedOutputs,
}

/// The outputs with their true instants.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
struct ProducedOutputs {
    outputs: Vec<(Option<u64>, i64)>,
    /// The last output (F9).
    last: Option<(u64, i64)>,
}

impl Search<'_> {
    /// Returns `true` if some explanation fits.
    fn fits(&self) -> bool {
        self.ends().iter().any(|out| self.fits_what_came_out(out))
    }

    /// Returns the outputs and their instants, over all explanations.
    fn ends(&self) -> BTreeSet<ProducedOutputs> {
        let story = self.story;
        let mut left: BTreeSet<Fact> = story.open.iter().map(|_| Fact::Open).collect();
        left.extend((0..story.requests.len()).map(Fact::Request));
        left.extend((0..story.results.len()).map(Fact::Result));
        left.extend((0..story.failures.len()).map(Fact::Failure));
        left.extend(story.without_local.then_some(Fact::NoLocal));
        let mut start = State {
            now: -i64::try_from(self.slack.greatest()).unwrap(),
            left,
            pending: BTreeSet::new(),
            requested: BTreeSet::new(),
            cached: BTreeSet::new(),
            armed: BTreeSet::new(),
            is_open: false,
            out: ProducedOutputs::default(),
        };
        if story.open.is_none() {
            start.open(None);
        }
        let (mut seen, mut ends) = (BTreeSet::new(), BTreeSet::new());
        let mut todo = vec![start];
        while let Some(state) = todo.pop() {
            if !seen.insert(state.clone()) {
                continue;
            }
            let has_request = state.left.iter().any(|fact| matches!(fact, Fact::Request(_)));
            let is_done = state.left.is_empty()
                || (state.left.len() == 1 && state.left.contains(&Fact::NoLocal) && !has_request);
            if state.now > self.horizon && is_done {
                ends.insert(state.out.clone());
            }
            todo.extend(self.next(&state));
        }
        ends
    }

    fn at(&self, fact: Fact) -> i64 {
        let at = match fact {
            Fact::Open => self.story.open.unwrap().0,
            Fact::Request(i) => self.story.requests[i].1,
            Fact::Result(i) => self.story.results[i].1,
            Fact::Failure(i) => self.story.failures[i].1,
            Fact::NoLocal => unreachable!("it has no instant of its own"),
        };
        i64::try_from(at).unwrap()
    }

    fn slack(&self) -> (i64, i64) {
        (
            i64::try_from(self.slack.tolerance()).unwrap(),
            i64::try_from(self.slack.lateness()).unwrap(),
        )
    }

    /// Returns the error of a source's stamps.
    fn tolerance_of(&self, p: u64) -> i64 {
        i64::try_from(self.slack.tolerance_of(p)).unwrap()
    }

    /// Returns the error of a fact's stamp.
    fn tolerance(&self, fact: Fact) -> i64 {
        match fact {
            Fact::Open | Fact::NoLocal => self.slack().0,
            Fact::Request(i) => self.tolerance_of(self.story.requests[i].0),
            Fact::Result(i) => self.tolerance_of(self.story.results[i].0),
            Fact::Failure(i) => self.tolerance_of(self.story.failures[i].0),
        }
    }

    /// Returns the error of a due instant. Local's counts from the open.
    fn tolerance_of_due(&self, p: u64) -> i64 {
        if p == 0 { self.slack().0 } else { self.tolerance_of(p) }
    }

    /// Returns `true` if a live timer cannot be served after `now`.
    fn must_have_fired(&self, p: u64, due: i64, now: i64) -> bool {
        let by = due + self.slack().1 + self.tolerance_of_due(p);
        by <= i64::try_from(self.end).unwrap() && by <= now
    }

    fn next(&self, state: &State) -> Vec<State> {
        let lateness = self.slack().1;
        let mut next = Vec::new();
        let is_within = |fact: Fact| {
            let (at, tolerance) = (self.at(fact), self.tolerance(fact));
            at - tolerance <= state.now && state.now <= at + tolerance
        };
        for fact in &state.left {
            let is_now = match fact {
                Fact::NoLocal => state.now <= self.horizon,
                fact => is_within(*fact),
            };
            if is_now {
                let mut after = state.clone();
                after.left.remove(fact);
                if self.apply(&mut after, *fact) {
                    next.push(after);
                }
            }
        }
        for (p, due) in &state.armed {
            let tolerance = self.tolerance_of_due(*p);
            if due - tolerance <= state.now && state.now <= due + lateness + tolerance {
                let mut after = state.clone();
                after.armed.remove(&(*p, *due));
                after.pending.remove(p);
                after.settle(self.commit, *p > 0);
                next.push(after);
            }
        }
        let has_request = state.left.iter().any(|fact| matches!(fact, Fact::Request(_)));
        let must_come = state.left.iter().any(|fact| match fact {
            Fact::NoLocal => !has_request && !self.story.requests.is_empty(),
            fact => self.at(*fact) + self.tolerance(*fact) <= state.now,
        });
        let must_fire =
            state.armed.iter().any(|(p, due)| self.must_have_fired(*p, *due, state.now));
        if !must_come && !must_fire && state.now <= self.horizon {
            next.push(State { now: state.now + 1, ..state.clone() });
        }
        next
    }

    /// Applies a fact to the state. Returns `false` if the fact cannot come now.
    fn apply(&self, state: &mut State, fact: Fact) -> bool {
        if fact != Fact::Open && state.left.contains(&Fact::Open) {
            return false;
        }
        match fact {
            Fact::Open => {
                let (at, deadline) = self.story.open.unwrap();
                state.open(deadline.map(|deadline| i64::try_from(at + deadline).unwrap()));
                true
            }
            Fact::Request(i) => {
                let (p, _, due) = self.story.requests[i];
                state.requested.insert(p);
                let due = i64::try_from(due).unwrap();
                // The last output outranks this source (F9).
                let is_outranked = self.commit == Commit::Progressive
                    && state.cached.last().is_some_and(|sent| *sent > p);
                if !is_outranked {
                    state.pending.insert(p);
                    state.armed.insert((p, due));
                }
                state.is_open && !self.must_have_fired(p, due, state.now - 1)
            }
            Fact::Result(i) => {
                let (p, _) = self.story.results[i];
                if self.is_before_its_request(state, p) {
                    return false;
                }
                if p == 0 && self.story.without_local {
                    return true;
                }
                state.result(self.commit, p);
                true
            }
            Fact::Failure(i) => {
                let (p, _) = self.story.failures[i];
                if self.is_before_its_request(state, p) {
                    return false;
                }
                if p == 0 && self.story.without_local {
                    return true;
                }
                if state.is_open && state.pending.remove(&p) {
                    state.armed.retain(|(q, _)| *q != p);
                    state.settle(self.commit, false);
                }
                true
            }
            Fact::NoLocal => {
                if state.is_open && state.pending.remove(&0) {
                    state.settle(self.commit, false);
                }
                true
            }
        }
    }

    fn is_before_its_request(&self, state: &State, p: u64) -> bool {
        let is_of_p =
            |fact: &Fact| matches!(fact, Fact::Request(i) if self.story.requests[*i].0 == p);
        state.left.iter().any(is_of_p)
    }

    /// Returns `true` if each output was observed or came too late to be observed, and each
    /// observed output is among the outputs.
    fn fits_what_came_out(&self, out: &ProducedOutputs) -> bool {
        let (tolerance, lateness) = self.slack();
        let is_it = |at: u64, y: i64| {
            let at = i64::try_from(at).unwrap();
            y - tolerance <= at && at <= y + lateness + tolerance
        };
        let MessageHistory { outputs, finals, .. } = self.story;
        let may_be_missing = |y: i64| y + lateness + tolerance > i64::try_from(self.end).unwrap();
        let is_seen = |(what, y): &(Option<u64>, i64)| {
            let observed = outputs.iter().filter(|(p, _)| p == what).collect::<Vec<_>>();
            match observed[..] {
                [] => may_be_missing(*y),
                [(_, at)] => is_it(*at, *y),
                _ => false,
            }
        };
        let is_produced =
            |(p, _): &(Option<u64>, u64)| out.outputs.iter().any(|(what, _)| what == p);
        // Outputs are in order as far as their stamps tell (A54).
        let is_in_order = outputs.iter().all(|(p, at)| {
            let mut higher = outputs.iter().filter(|(q, _)| q > p);
            let by = |then: u64| {
                i64::try_from(*at).unwrap() <= i64::try_from(then).unwrap() + 2 * tolerance
            };
            higher.all(|(_, then)| by(*then))
        });
        out.outputs.iter().all(is_seen)
            && outputs.iter().all(is_produced)
            && is_in_order
            && match (&finals[..], out.last) {
                ([], _) => true,
                ([(p, at)], Some((last, y))) => *p == last && is_it(*at, y),
                _ => false,
            }
    }
}

impl State {
    fn open(&mut self, deadline: Option<i64>) {
        self.is_open = true;
        self.requested.insert(0);
        self.pending.insert(0);
        self.armed.extend(deadline.map(|due| (0, due)));
    }

    fn result(&mut self, commit: Commit, p: u64) {
        if !self.is_open || !self.pending.remove(&p) {
            return;
        }
        if commit == Commit::Progressive {
            self.out.outputs.push((Some(p), self.now));
            self.cached = BTreeSet::from([p]);
            self.pending.retain(|q| *q > p);
            self.armed.retain(|(q, _)| *q > p);
            self.settle(commit, false);
        } else if self.pending.iter().any(|q| *q > p) {
            self.cached.insert(p);
            if p == 0 || commit == Commit::Patient {
                self.armed.retain(|(q, _)| *q != p);
            }
        } else {
            self.retire(Some(p));
        }
    }

    fn settle(&mut self, commit: Commit, is_timer: bool) {
        match self.cached.last().copied() {
            Some(_) if commit == Commit::Progressive && !self.pending.is_empty() => {}
            Some(last) if commit == Commit::Progressive => {
                self.out.last = Some((last, self.now));
                self.close();
            }
            Some(best) => {
                let outranked = self.pending.iter().any(|q| *q > best);
                if !outranked || (is_timer && commit == Commit::Eager) {
                    self.retire(Some(best));
                }
            }
            None if self.pending.is_empty() => self.retire(None),
            None => {}
        }
    }

    fn retire(&mut self, what: Option<u64>) {
        self.out.outputs.push((what, self.now));
        self.close();
    }

    fn close(&mut self) {
        self.is_open = false;
        self.pending.clear();
        self.cached.clear();
        self.armed.clear();
    }
}

/// Generates small stories: up to three clouds, with instants so close that all orders occur.
fn stories() -> impl Strategy<Value = MessageHistory> {
    let at = 0..8_u64;
    let open = option::weighted(0.8, (0..3_u64, option::of(1..6_u64)));
    let requests = btree_map(1..4_u64, (0..4_u64, 1..8_u64), 0..4);
    let came = |most| vec((0..4_u64, at.clone()), 0..most);
    let outputs = vec((option::weighted(0.8, 0..4_u64), at.clone()), 0..2);
    let without_local = any::<bool>();
    (open, requests, came(4), came(3), outputs, without_local).prop_map(
        |(open, requests, results, failures, outputs, without_local)| MessageHistory {
            // An absent local has no deadline.
            open: open.map(|(at, deadline)| (at, deadline.filter(|_| !without_local))),
            requests: requests.into_iter().map(|(p, (at, due))| (p, at, due)).collect(),
            results,
            failures,
            outputs,
            finals: Vec::new(),
            without_local,
        },
    )
}

fn commits() -> impl Strategy<Value = Commit> {
    any::<bool>().prop_map(|eager| if eager { Commit::Eager } else { Commit::Patient })
}

/// Generates slacks, often with a separate tolerance for one source.
fn slacks() -> impl Strategy<Value = SourceSlack> {
    let own = option::of((0..4_u64, 0..4_u64));
    (0..3_u64, 0..3_u64, own).prop_map(|(tolerance, lateness, own)| {
        let slack = SourceSlack::from(Slack { tolerance, lateness });
        match own {
            Some((p, tolerance)) => slack.with_tolerance_of(p, tolerance),
            None => slack,
        }
    })
}

/// Returns the greatest instant of a story's trace, in which another timestamp's lines come `rest`
/// later.
fn end(story: &MessageHistory, rest: u64) -> u64 {
    let requests = story.requests.iter().map(|(_, at, _)| *at);
    let came = story.results.iter().chain(&story.failures).map(|(_, at)| *at);
    let out = story.outputs.iter().map(|(_, at)| *at);
    let opened = story.open.iter().map(|(at, _)| *at);
    requests.chain(came).chain(out).chain(opened).max().unwrap_or(0) + rest
}

const HORIZON: i64 = 20;

proptest! {
    #![proptest_config(ProptestConfig { cases: 4096, failure_persistence: None, ..Default::default() })]

    #[test]
    fn allowed_outputs_are_those_of_any_order(
        story in stories(), slack in slacks(), commit in commits(), rest in 0..12_u64
    ) {
        let end = end(&story, rest);
        let ends = Search { story: &story, commit, slack: &slack, end, horizon: HORIZON }.ends();
        // Before the trace's first instant nothing can tell two instants apart.
        let ends: BTreeSet<_> = ends.into_iter().map(|out| {
            out.outputs.first().map(|(p, y)| (*p, (*y).max(0)))
        }).collect();
        let mut found = BTreeSet::new();
        if let Some((facts, priorities)) = story.facts(commit, &slack, end) {
            found.extend(facts.stays_open().then_some(None));
            for y in 0..=HORIZON {
                let at = WideInstant::try_from(y).unwrap();
                let when = InstantRange { from: at, to: at };
                let yields = |output| facts.yields(output, when);
                found.extend(yields(RetirementOutput::Miss).then_some(Some((None, y))));
                for (i, p) in priorities.iter().enumerate() {
                    found.extend(yields(RetirementOutput::Emit(i)).then_some(Some((Some(*p), y))));
                }
            }
        }
        prop_assert_eq!(&found, &ends);
        let Some((facts, priorities)) = story.facts(commit, &slack, end) else { return Ok(()) };
        let outputs = (0..priorities.len()).map(RetirementOutput::Emit).chain([RetirementOutput::Miss]);
        for output in outputs {
            let what = if let RetirementOutput::Emit(i) = output { Some(priorities[i]) } else { None };
            let of = ends.iter().flatten().filter(|(p, _)| *p == what).map(|(_, y)| *y);
            let (first, last) = (of.clone().min(), of.max());
            let span = facts.span(output);
            prop_assert_eq!(span.map(|span| i64::try_from(span.from).unwrap()), first);
            let to = span.map(|span| i64::try_from(span.to).unwrap_or(i64::MAX).min(HORIZON));
            prop_assert_eq!(to, last);
        }
    }

    #[test]
    fn explains_what_any_order_of_facts_explains(
        story in stories(), slack in slacks(), commit in commits(), rest in 0..12_u64
    ) {
        let end = end(&story, rest);
        let search = Search { story: &story, commit, slack: &slack, end, horizon: HORIZON };
        prop_assert_eq!(story.is_explained_within(commit, &slack, end), search.fits());
    }

    #[test]
    fn progressive_spans_are_those_of_any_order(
        story in stories(), slack in slacks(), end in 0..19_u64
    ) {
        let ends = progressive_ends(&story, &slack, end);
        let Some((facts, priorities)) = story.facts(Commit::Progressive, &slack, end) else {
            prop_assert_eq!(ends, []);
            return Ok(());
        };
        let free = ProgressiveFacts::free(&facts);
        let instants = |may_be: &dyn Fn(InstantRange) -> bool| -> BTreeSet<i64> {
            let is_then = |y: &i64| {
                let at = WideInstant::try_from(*y).unwrap();
                may_be(InstantRange { from: at, to: at })
            };
            (0..=HORIZON).filter(is_then).collect()
        };
        let outputs = ends.iter().flat_map(|out| &out.outputs);
        for (q, p) in priorities.iter().enumerate() {
            let emits: BTreeSet<_> =
                outputs.clone().filter(|(what, _)| *what == Some(*p)).map(|(_, y)| *y).collect();
            let finals: BTreeSet<_> =
                ends.iter().filter_map(|out| out.last).filter(|(last, _)| last == p).map(|(_, y)| y).collect();
            prop_assert_eq!(&instants(&|when| free.with(q, when).is_explained()), &emits);
            prop_assert_eq!(instants(&|when| free.ends(q, when)), finals);
            let span = free.span(q).map(|span| [span.from, span.to].map(|y| i64::try_from(y).unwrap()));
            prop_assert_eq!(span, emits.first().zip(emits.last()).map(|(from, to)| [*from, *to]));
        }
        let misses: BTreeSet<_> = outputs.filter(|(what, _)| what.is_none()).map(|(_, y)| *y).collect();
        prop_assert_eq!(instants(&|when| facts.yields(RetirementOutput::Miss, when)), misses);
    }

    /// Records the outputs of a story with all errors that may occur, and leaves out or moves some
    /// of them.
    #[test]
    fn progressive_explains_what_any_order_explains(
        story in stories(), slack in slacks(), end in 0..19_u64, noise in vec(any::<(u8, u8, u8)>(), 64)
    ) {
        let ends = progressive_ends(&story, &slack, end);
        let mut noise = noise.into_iter().cycle();
        for i in 0..48 {
            let (which, ..) = noise.next().unwrap();
            let out = ends.get((usize::from(which) + i * 7) % ends.len().max(1));
            let recorded = match out.filter(|_| i > 0) {
                Some(out) => recorded(&story, out, &slack, &mut noise),
                None => story.clone(),
            };
            let search =
                Search { story: &recorded, commit: Commit::Progressive, slack: &slack, end, horizon: HORIZON };
            let fits = ends.iter().any(|out| search.fits_what_came_out(out));
            let is_explained = recorded.is_explained_within(Commit::Progressive, &slack, end);
            prop_assert_eq!(is_explained, fits, "{:?}", recorded);
        }
    }
}

/// Returns everything that progressive may send for a story. Before the trace's first instant
/// nothing can tell two instants apart.
fn progressive_ends(story: &MessageHistory, slack: &SourceSlack, end: u64) -> Vec<ProducedOutputs> {
    let search = Search { story, commit: Commit::Progressive, slack, end, horizon: HORIZON };
    let ends: BTreeSet<_> = search
        .ends()
        .into_iter()
        .map(|ProducedOutputs { mut outputs, last }| {
            for (_, y) in &mut outputs {
                *y = (*y).max(0);
            }
            ProducedOutputs { outputs, last: last.map(|(p, y)| (p, y.max(0))) }
        })
        .collect();
    ends.into_iter().collect()
}

/// Returns a story with these outputs as they are recorded. Sometimes an output is lost, has
/// another source, or is too early or too late.
fn recorded(
    story: &MessageHistory,
    out: &ProducedOutputs,
    slack: &SourceSlack,
    noise: &mut impl Iterator<Item = (u8, u8, u8)>,
) -> MessageHistory {
    let mut recorded = MessageHistory { outputs: vec![], finals: vec![], ..story.clone() };
    for (p, y) in &out.outputs {
        let (what, off, odd) = noise.next().unwrap();
        let p = if odd > 250 { Some(u64::from(what % 4)) } else { *p };
        if odd > 20 {
            recorded.outputs.push((p, recorded_at(*y, off, odd, slack)));
        }
    }
    let (what, off, odd) = noise.next().unwrap();
    if let Some((p, y)) = out.last.filter(|_| odd > 90) {
        let p = if odd > 250 { u64::from(what % 4) } else { p };
        recorded.finals.push((p, recorded_at(y, off, odd, slack)));
    }
    recorded
}

/// Returns an instant within the errors of the clock, or sometimes beyond them, but never later
/// than the search looks.
fn recorded_at(y: i64, off: u8, odd: u8, slack: &SourceSlack) -> u64 {
    let [tolerance, reach] =
        [slack.tolerance(), slack.reach()].map(|it| i64::try_from(it).unwrap());
    let beyond = i64::from(odd.is_multiple_of(5));
    let at = y - tolerance - beyond + i64::from(off) % (reach + 1 + 2 * beyond);
    u64::try_from(at.min(HORIZON - tolerance)).unwrap_or(0)
}

/// Returns the answers of the analysis and of the search for a story with exact stamps.
fn progressive(story: &MessageHistory, end: u64) -> [bool; 2] {
    let (commit, slack) = (Commit::Progressive, Slack { tolerance: 0, lateness: 0 }.into());
    let search = Search { story, commit, slack: &slack, end, horizon: HORIZON };
    [story.is_explained_within(commit, &slack, end), search.fits()]
}

#[test]
fn outranked_request_ends_by_its_own_timer() {
    let story = |due| MessageHistory {
        open: Some((0, None)),
        requests: vec![(1, 3, due), (2, 0, 9), (3, 0, 9)],
        results: vec![(2, 0)],
        outputs: vec![(Some(2), 0)],
        finals: vec![(2, 9)],
        ..MessageHistory::default()
    };
    assert_eq!(progressive(&story(3), 9), [true; 2]);
    assert_eq!(progressive(&story(2), 9), [false; 2]);
}

/// If the trace ends before the timer must be served, the timer's result may be sent unseen.
#[test]
fn unserved_timer_lets_its_result_be_sent_unseen() {
    let story = |came| MessageHistory {
        open: Some((0, None)),
        requests: vec![(1, 0, 1), (2, 2, 9)],
        results: vec![(1, came), (2, 4)],
        failures: vec![(0, 0)],
        outputs: vec![(Some(2), 4)],
        ..MessageHistory::default()
    };
    assert_eq!(progressive(&story(3), 0), [true; 2]);
    // Nothing is pending between source 1's timer and source 2's request.
    assert_eq!(progressive(&story(3), 1), [false; 2]);
    assert_eq!(progressive(&story(1), 0), [false; 2]);
}
