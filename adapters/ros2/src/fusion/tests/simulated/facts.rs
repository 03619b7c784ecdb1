//! What is known of a run: the trace, and what was seen beside it.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::time::Duration;

use fuseline_testkit::split;
use fuseline_traces::{Decision, DropReason, Event, Events, Input, OpenRefusal, Verdict, judge};

use super::play::{RunResult, SentRequest, StatusReport};
use super::scenario::{Disturbance, Form, Scenario};
use crate::Commit;
use crate::settings::{Change, Settings};

/// What a run may come to, in words.
pub(super) const KINDS: [&str; 14] = [
    "an output of a cloud",
    "an output of local by a timer",
    "a missed message",
    "a refused message",
    "the stamp of an open message",
    "a lost computation",
    "a result of no message",
    "a hint",
    "an output that was not sent",
    "an offer that was refused",
    "a failure",
    "an input while the node was inactive",
    "a revision of a cloud",
    "an output that was sent as a revision before",
];

pub(super) struct Facts<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) inputs: Vec<super::scenario::Input>,
    pub(super) played: &'a RunResult,
    pub(super) verdict: Verdict,
    /// By timestamp.
    pub(super) messages: Vec<Message<'a>>,
    /// By timestamp: what the trace says.
    pub(super) opened: Vec<OpenedMessage>,
    /// Inputs that were no messages, by their indices.
    pub(super) rejected: Vec<usize>,
    /// Each state that was set, and from when on.
    pub(super) set: Vec<(u64, State)>,
    pub(super) timers: BTreeMap<usize, u64>,
    pub(super) cancelled: BTreeMap<usize, u64>,
    /// Results that were too late or superseded: index and timestamp.
    pub(super) late: Vec<(usize, u64)>,
}

/// A message that was accepted, and what was reported of it.
pub(super) struct Message<'a> {
    /// The input's index.
    pub(super) serial: usize,
    /// In their order.
    pub(super) reported: Vec<&'a StatusReport>,
}

/// A message as the trace has it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct OpenedMessage {
    pub(super) at: u64,
    pub(super) deadline: Option<u64>,
    /// Each cloud that got an offer, its deadline, and whether the offer was refused.
    pub(super) offers: BTreeMap<usize, (u64, bool)>,
    /// What was sent of it, and when.
    pub(super) items: Vec<(u64, MessageOutcome)>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum MessageOutcome {
    Preliminary { index: usize },
    Forwarded { index: usize, rule: &'static str },
    Final { index: usize },
    Missed,
    Refused(OpenRefusal),
}

/// What is in force: of the node, and of each cloud.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct State {
    pub(super) is_active: bool,
    pub(super) deadline: Duration,
    pub(super) local: Duration,
    /// By index; local's mean nothing.
    pub(super) peers: Vec<CloudStatus>,
}

/// How a cloud stands.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct CloudStatus {
    pub(super) is_enabled: bool,
    pub(super) is_there: bool,
    /// A deadline of its own.
    pub(super) deadline: Option<Duration>,
}

impl<'a> Facts<'a> {
    /// # Errors
    /// If the trace cannot be read.
    pub(super) fn new(scenario: &'a Scenario, played: &'a RunResult) -> Result<Self, String> {
        let verdict = judge("trace", &*played.trace).map_err(|error| error.to_string())?;
        let parameters = scenario.parameters().into_iter().flat_map(|it| ["-p".to_owned(), it]);
        let parameters: Vec<_> = parameters.collect();
        let parameters: Vec<_> = parameters.iter().map(String::as_str).collect();
        let settings = super::super::node::settings(scenario.peers.len() - 1, &parameters);
        let mut facts = Self {
            scenario,
            inputs: scenario.all_inputs(),
            played,
            verdict,
            messages: Vec::new(),
            opened: Vec::new(),
            rejected: Vec::new(),
            set: states(scenario, &settings, &played.log.turned),
            timers: BTreeMap::new(),
            cancelled: BTreeMap::new(),
            late: Vec::new(),
        };
        facts.read()?;
        facts.assign();
        Ok(facts)
    }

    /// Reads what the trace records.
    fn read(&mut self) -> Result<(), String> {
        let mut events = Events::new("trace", &*self.played.trace).map_err(|it| it.to_string())?;
        let mut step: Option<(Input, Vec<Decision>)> = None;
        while let Some(event) = events.next_event().map_err(|error| error.to_string())? {
            match (event, &mut step) {
                (Event::Decision(decision), Some((_, decisions))) => decisions.push(decision),
                (Event::Decision(_), None) => {}
                (Event::Input(next), _) => {
                    if let Some((input, decisions)) = step.replace((next, Vec::new())) {
                        self.step(input, &decisions)?;
                    }
                }
            }
        }
        step.map_or(Ok(()), |(input, decisions)| self.step(input, &decisions))
    }

    fn step(&mut self, input: Input, decisions: &[Decision]) -> Result<(), String> {
        // What fires comes before the input's own.
        let (fired, own) = split(&input, decisions);
        for decision in fired {
            self.decision(*decision, None, &[]);
        }
        self.input(input)?;
        for decision in own {
            self.decision(*decision, Some(input), own);
        }
        Ok(())
    }

    fn input(&mut self, input: Input) -> Result<(), String> {
        match input {
            Input::Open { at, t, deadline } => {
                if t != self.opened.len() as u64 {
                    return Err(format!("{t} is opened as number {}", self.opened.len()));
                }
                self.opened.push(OpenedMessage {
                    at,
                    deadline,
                    offers: BTreeMap::new(),
                    items: Vec::new(),
                });
            }
            Input::Offer { t, p, deadline, .. } => {
                let message = self.message(t);
                message.offers.insert(index(p), (deadline, false));
            }
            Input::Result { .. } | Input::Fail { .. } | Input::Tick { .. } => {}
        }
        Ok(())
    }

    /// `own` are the decisions about the input, if this is one of them.
    fn decision(&mut self, decision: Decision, input: Option<Input>, own: &[Decision]) {
        match decision {
            Decision::Timer { p, .. } => *self.timers.entry(index(p)).or_default() += 1,
            Decision::Cancel { p, .. } => *self.cancelled.entry(index(p)).or_default() += 1,
            Decision::Emit { at, t, p } => {
                let rule = match input {
                    Some(Input::Result { .. }) => "F3",
                    Some(Input::Fail { .. }) => "F4",
                    _ => "F5",
                };
                let index = index(p);
                let is_last = self.scenario.commit != Commit::Progressive
                    || own.iter().any(|it| matches!(it, Decision::Final { .. }));
                let outcome = if is_last {
                    MessageOutcome::Forwarded { index, rule }
                } else {
                    MessageOutcome::Preliminary { index }
                };
                self.message(t).items.push((at, outcome));
            }
            // It was sent as the last one.
            Decision::Final { .. } if own.iter().any(|it| matches!(it, Decision::Emit { .. })) => {}
            Decision::Final { at, t, p } => {
                self.message(t).items.push((at, MessageOutcome::Final { index: index(p) }));
            }
            Decision::Miss { at, t } => self.message(t).items.push((at, MessageOutcome::Missed)),
            Decision::RefuseOpen { at, t, why } => {
                self.message(t).items.push((at, MessageOutcome::Refused(why)));
            }
            Decision::RefuseOffer { t, p, .. } => {
                if let Some(offer) = self.message(t).offers.get_mut(&index(p)) {
                    offer.1 = true;
                }
            }
            Decision::Drop { t, p, why, .. } => {
                let is_result = matches!(input, Some(Input::Result { .. }));
                if is_result && matches!(why, DropReason::Late | DropReason::Superseded) {
                    self.late.push((index(p), t));
                }
            }
            Decision::Request { .. } | Decision::Hold { .. } => {}
        }
    }

    /// Says which input is which message: they are taken in one after the other, each at the instant at which it came.
    fn assign(&mut self) {
        let mut statuses = BTreeMap::<_, Vec<&StatusReport>>::new();
        for reported in &self.played.log.statuses {
            statuses.entry(reported.timestamp()).or_default().push(reported);
        }
        for (serial, at) in self.played.log.arrived_at.iter().enumerate() {
            let input = &self.inputs[serial];
            let next = self.messages.len();
            let when = self.meanwhile(*at);
            let is_it = self.opened.get(next).is_some_and(|opened| when.contains(&opened.at))
                && input.form == Form::Whole;
            let of_it = statuses.get(&Some(next as u64)).filter(|reported| {
                is_it && reported.iter().all(|reported| reported.key() == Some(input.key))
            });
            match of_it {
                Some(reported) => {
                    self.messages.push(Message { serial, reported: reported.clone() });
                }
                None => self.rejected.push(serial),
            }
        }
    }

    /// What may have been in force when something came: at one instant either is first.
    pub(super) fn states(&self, at: u64) -> impl Iterator<Item = &State> {
        let when = self.meanwhile(at);
        let before = self.set.iter().rev().find(|(since, _)| *since < at);
        let meanwhile = self.set.iter().filter(move |(since, _)| when.contains(since));
        before.into_iter().chain(meanwhile).map(|(_, state)| state)
    }

    /// When the node may have looked at what came at this instant: at once, unless its process stood still from then on.
    fn meanwhile(&self, at: u64) -> RangeInclusive<u64> {
        let stalls = self.played.log.turned.iter().filter_map(|(from, turn)| match turn {
            Disturbance::Stalls(long) if *from == at => u64::try_from(long.as_nanos()).ok(),
            _ => None,
        });
        at..=at + stalls.sum::<u64>()
    }

    fn message(&mut self, t: u64) -> &mut OpenedMessage {
        &mut self.opened[usize::try_from(t).unwrap()]
    }

    /// The requests to a peer.
    pub(super) fn requested(&self, index: usize) -> impl Iterator<Item = &SentRequest> {
        self.played.log.requested.iter().filter(move |requested| requested.index == index)
    }

    /// Returns `true` if a message before this input has its key. One that was refused counts only
    /// if `is_there` at its end.
    pub(super) fn has_remembered(&self, serial: usize, is_there: impl Fn(u64) -> bool) -> bool {
        self.messages.iter().zip(&self.opened).any(|(message, opened)| {
            let is_before = message.serial < serial;
            let was_refused = |(ended, outcome): &(u64, MessageOutcome)| {
                matches!(outcome, MessageOutcome::Refused(_)) && !is_there(*ended)
            };
            let is_remembered = !opened.items.last().is_some_and(was_refused);
            is_before && is_remembered && self.inputs[message.serial].key == self.inputs[serial].key
        })
    }

    /// Returns `true` if another input with this one's key came at the same instant.
    pub(super) fn is_doubled_at_once(&self, serial: usize) -> bool {
        let at = &self.played.log.arrived_at;
        let is_same = |other: &usize| {
            self.inputs[*other].key == self.inputs[serial].key && at[*other] == at[serial]
        };
        (0..at.len()).filter(is_same).count() > 1
    }

    /// What it came to.
    pub(super) fn kinds(&self) -> BTreeSet<&'static str> {
        let mut kinds = BTreeSet::new();
        let mut mark = |is: bool, kind: usize| {
            if is {
                kinds.insert(KINDS[kind]);
            }
        };
        for OpenedMessage { items, offers, .. } in &self.opened {
            for (_, outcome) in items {
                match outcome {
                    MessageOutcome::Preliminary { index } => mark(*index > 0, 12),
                    MessageOutcome::Forwarded { index: 0, rule } => mark(*rule == "F5", 1),
                    MessageOutcome::Forwarded { .. } => mark(true, 0),
                    MessageOutcome::Final { .. } => mark(true, 13),
                    MessageOutcome::Missed => mark(true, 2),
                    MessageOutcome::Refused(_) => mark(true, 3),
                }
            }
            mark(offers.values().any(|(_, is_refused)| *is_refused), 9);
        }
        let is_doubled = |serial: &usize| self.inputs[*serial].form == Form::Whole;
        mark(self.rejected.iter().any(is_doubled), 4);
        let sources = &self.played.tally.sources;
        mark(sources[0].lost > 0, 5);
        let log = &self.played.log;
        mark(log.unmatched.iter().any(|unmatched| unmatched.unknown_stamp > 0), 6);
        mark(!log.hints.is_empty(), 7);
        let unsent = |reported: &StatusReport| {
            reported.output.as_ref().is_some_and(|output| !output.is_sent)
        };
        mark(log.statuses.iter().any(unsent), 8);
        mark(sources.iter().any(|source| source.failed > 0), 10);
        let mut arrived_at = log.arrived_at.iter();
        mark(arrived_at.any(|at| self.states(*at).all(|state| !state.is_active)), 11);
        kinds
    }
}

impl OpenedMessage {
    /// How it was answered, and when.
    pub(super) fn ended(&self) -> Option<(u64, MessageOutcome)> {
        let is_last = |(_, outcome): &&(u64, MessageOutcome)| {
            !matches!(outcome, MessageOutcome::Preliminary { .. })
        };
        self.items.iter().find(is_last).copied()
    }
}

/// Each state, and from when on it was in force.
fn states(
    scenario: &Scenario,
    settings: &Settings,
    turned: &[(u64, Disturbance)],
) -> Vec<(u64, State)> {
    let well = CloudStatus { is_enabled: true, is_there: true, deadline: None };
    let mut state = State {
        is_active: true,
        deadline: settings.deadline,
        local: settings.local.deadline,
        peers: vec![well; scenario.peers.len()],
    };
    let mut states = vec![(0, state.clone())];
    for (at, turn) in turned {
        match *turn {
            Disturbance::Set(Change::Deadline(deadline)) => state.deadline = deadline,
            Disturbance::Set(Change::LocalDeadline(deadline)) => state.local = deadline,
            Disturbance::Set(Change::CloudDeadline(cloud, own)) => {
                state.peers[cloud + 1].deadline = own;
            }
            Disturbance::Set(Change::CloudEnabled(cloud, enabled)) => {
                state.peers[cloud + 1].is_enabled = enabled;
            }
            Disturbance::Set(Change::SimTime(_)) | Disturbance::Stalls(_) => {}
            Disturbance::Deadline(seconds) => {
                // What is no positive number of seconds, or above the greatest deadline, is ignored.
                if seconds > 0.0 && seconds <= 60.0 {
                    state.deadline = Duration::from_secs_f64(seconds);
                }
            }
            Disturbance::Activate(is_active) => state.is_active = is_active,
            Disturbance::Dies { peer, is_seen } => {
                // A request is made to a called cloud all the same.
                state.peers[peer].is_there = !is_seen || scenario.peers[peer].is_called;
            }
            Disturbance::Lives(peer) => state.peers[peer].is_there = true,
        }
        states.push((*at, state.clone()));
    }
    states
}

fn index(p: u64) -> usize {
    usize::try_from(p).unwrap()
}

impl StatusReport {
    pub(super) fn value(&self, key: &str) -> Option<&str> {
        value(&self.status.values, key)
    }

    pub(super) fn timestamp(&self) -> Option<u64> {
        self.value("timestamp")?.parse().ok()
    }

    pub(super) fn key(&self) -> Option<u64> {
        self.value("key")?.parse().ok()
    }
}

/// What a status has under a key.
pub(super) fn value<'a>(values: &'a [crate::report::KeyValue], key: &str) -> Option<&'a str> {
    values.iter().find(|value| value.key == key).map(|value| &*value.value)
}
