use std::collections::BTreeSet;

use proptest::collection::{btree_map, vec};
use proptest::option;
use proptest::prelude::*;

use super::super::explain::{InstantRange, RetirementOutput, WideInstant};
use super::super::slack::Slack;
use super::*;

/// Every explanation there is, one after the other: the definition of `SPEC.md`, word for word.
struct Search<'a> {
    story: &'a MessageHistory,
    commit: Commit,
    slack: &'a SourceSlack,
    end: u64,
    /// Until when something can happen.
    horizon: i64,
}

/// A fact that has an instant of its own.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Fact {
    Open,
    Request(usize),
    Result(usize),
    Failure(usize),
    /// Where there is no local: it fails at any instant until all is requested.
    NoLocal,
}

/// Where an explanation has come to.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct State {
    now: i64,
    left: BTreeSet<Fact>,
    pending: BTreeSet<u64>,
    requested: BTreeSet<u64>,
    cached: BTreeSet<u64>,
    armed: BTreeSet<(u64, i64)>,
    is_open: bool,
    out: ObservedOutput,
}

/// What came out, if anything, and at which true instant.
type ObservedOutput = Option<(Option<u64>, i64)>;

impl Search<'_> {
    /// Whether some explanation fits.
    fn fits(&self) -> bool {
        self.ends().iter().any(|out| self.fits_what_came_out(*out))
    }

    /// What may come out and when, over all explanations.
    fn ends(&self) -> BTreeSet<ObservedOutput> {
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
            out: None,
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
                ends.insert(state.out);
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

    /// The error of a source's stamps.
    fn tolerance_of(&self, p: u64) -> i64 {
        i64::try_from(self.slack.tolerance_of(p)).unwrap()
    }

    /// The error of a fact's stamp.
    fn tolerance(&self, fact: Fact) -> i64 {
        match fact {
            Fact::Open | Fact::NoLocal => self.slack().0,
            Fact::Request(i) => self.tolerance_of(self.story.requests[i].0),
            Fact::Result(i) => self.tolerance_of(self.story.results[i].0),
            Fact::Failure(i) => self.tolerance_of(self.story.failures[i].0),
        }
    }

    /// Of a due instant: local's counts from the open.
    fn tolerance_of_due(&self, p: u64) -> i64 {
        if p == 0 { self.slack().0 } else { self.tolerance_of(p) }
    }

    /// Whether a timer that is live cannot be served after `now`.
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

    /// Whether it may come now.
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
                state.pending.insert(p);
                let due = i64::try_from(due).unwrap();
                state.armed.insert((p, due));
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

    fn fits_what_came_out(&self, out: ObservedOutput) -> bool {
        let (tolerance, lateness) = self.slack();
        match (&*self.story.outputs, out) {
            ([], None) => true,
            ([], Some((_, y))) => y + lateness + tolerance > i64::try_from(self.end).unwrap(),
            ([(p, at)], Some((what, y))) => {
                let at = i64::try_from(*at).unwrap();
                *p == what && y - tolerance <= at && at <= y + lateness + tolerance
            }
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
        if self.pending.iter().any(|q| *q > p) {
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
        self.is_open = false;
        self.pending.clear();
        self.cached.clear();
        self.armed.clear();
        self.out = Some((what, self.now));
    }
}

/// Small stories: up to three clouds, instants close enough that all orders occur.
fn stories() -> impl Strategy<Value = MessageHistory> {
    let at = 0..8_u64;
    let open = option::weighted(0.8, (0..3_u64, option::of(1..6_u64)));
    let requests = btree_map(1..4_u64, (0..4_u64, 1..8_u64), 0..4);
    let came = |most| vec((0..4_u64, at.clone()), 0..most);
    let outputs = vec((option::weighted(0.8, 0..4_u64), at.clone()), 0..2);
    let without_local = any::<bool>();
    (open, requests, came(4), came(3), outputs, without_local).prop_map(
        |(open, requests, results, failures, outputs, without_local)| MessageHistory {
            // Where there is no local it has no deadline.
            open: open.map(|(at, deadline)| (at, deadline.filter(|_| !without_local))),
            requests: requests.into_iter().map(|(p, (at, due))| (p, at, due)).collect(),
            results,
            failures,
            outputs,
            without_local,
        },
    )
}

fn commits() -> impl Strategy<Value = Commit> {
    any::<bool>().prop_map(|eager| if eager { Commit::Eager } else { Commit::Patient })
}

/// Often one source has a tolerance of its own.
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

/// The greatest instant of a story's trace, where another timestamp's come `rest` later.
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
    fn what_may_come_out_and_when_is_what_any_order_of_the_facts_brings_out(
        story in stories(), slack in slacks(), commit in commits(), rest in 0..12_u64
    ) {
        let end = end(&story, rest);
        let ends = Search { story: &story, commit, slack: &slack, end, horizon: HORIZON }.ends();
        // Before the trace's first instant there is nothing that could tell two instants apart.
        let ends: BTreeSet<ObservedOutput> = ends.into_iter().map(|out| out.map(|(p, y)| (p, y.max(0)))).collect();
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
    fn a_story_is_explained_if_any_order_of_its_facts_explains_it(
        story in stories(), slack in slacks(), commit in commits(), rest in 0..12_u64
    ) {
        let end = end(&story, rest);
        let search = Search { story: &story, commit, slack: &slack, end, horizon: HORIZON };
        prop_assert_eq!(story.is_explained_within(commit, &slack, end), search.fits());
    }
}
