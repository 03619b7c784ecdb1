//! The facts about a run: its trace, and other observations.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::Duration;

use fuseline_engine::Trigger;
use fuseline_ros2::Settings;
use fuseline_ros2::in_process::KeyValue;
use fuseline_ros2::settings::Change;
use fuseline_traces::{DropReason, nanos};

use crate::judge::replay::{
    DecidedItem, DecidedOffer, Departure, DroppedResult, OpenedMessage, QueueConfig, Replay,
};

use crate::simulate::nodes::play::{RunResult, SentRequest, StatusReport};
use crate::simulate::nodes::scenario::{Disturbance, Form, Input, LOCAL, Scenario};

/// A kind of ending in words, and whether a run came to it.
type Kind = (&'static str, fn(&Facts<'_>) -> bool);

/// The kinds of endings that a run may have.
pub const KINDS: [Kind; 14] = [
    ("an output of a cloud", |it| it.leaves(|how| matches!(how, Departure::Forwarded(1.., _)))),
    ("an output of local by a timer", |it| {
        it.leaves(|how| how == Departure::Forwarded(0, Trigger::Timer))
    }),
    ("a missed message", |it| it.leaves(|how| how == Departure::Missed)),
    ("a refused message", |it| it.leaves(|how| matches!(how, Departure::Refused(_)))),
    ("the stamp of an open message", |it| {
        it.rejected.iter().any(|serial| it.inputs[*serial].form == Form::Whole)
    }),
    ("a lost computation", |it| it.played.tally.sources[LOCAL].lost > 0),
    ("a result of no message", |it| {
        it.played.log.unmatched.iter().any(|unmatched| unmatched.unknown_stamp > 0)
    }),
    ("a hint", |it| !it.played.log.hints.is_empty()),
    ("an output that was not sent", |it| {
        let mut outputs = it.played.log.statuses.iter().filter_map(|it| it.output.as_ref());
        outputs.any(|output| !output.is_sent)
    }),
    ("an offer that was refused", |it| it.replay.offers.iter().any(|it| it.refusal.is_some())),
    ("a failure", |it| it.played.tally.sources.iter().any(|source| source.failed > 0)),
    ("an input while the node was inactive", |it| {
        let mut arrived_at = it.played.log.arrived_at.iter();
        arrived_at.any(|at| it.states(*at).all(|state| !state.is_active))
    }),
    ("a revision of a cloud", |it| it.leaves(|how| matches!(how, Departure::Preliminary(1..)))),
    ("an output that was sent as a revision before", |it| {
        it.leaves(|how| matches!(how, Departure::Final(_)))
    }),
];

/// The facts about one run.
pub struct Facts<'a> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) inputs: Vec<Input>,
    pub(crate) played: &'a RunResult,
    /// The trace, replayed.
    pub(crate) replay: Replay,
    /// The accepted messages, by timestamp.
    pub(crate) messages: Vec<Message<'a>>,
    /// The indices of the inputs that were no messages.
    pub(crate) rejected: Vec<usize>,
    /// The states that were set, each with the instant from which it was in force.
    pub(crate) set: Vec<(u64, State)>,
}

/// A message that was accepted, and its statuses.
pub(crate) struct Message<'a> {
    /// The input's index.
    pub(crate) serial: usize,
    /// The statuses in their order.
    pub(crate) reported: Vec<&'a StatusReport>,
}

/// The settings in force: the node's, and each cloud's.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct State {
    pub(crate) is_active: bool,
    pub(crate) deadline: Duration,
    pub(crate) local: Duration,
    /// The clouds by index. The entry of local has no meaning.
    pub(crate) peers: Vec<CloudStatus>,
}

/// The state of a cloud.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct CloudStatus {
    pub(crate) is_enabled: bool,
    pub(crate) is_there: bool,
    /// A deadline of its own.
    pub(crate) deadline: Option<Duration>,
}

impl<'a> Facts<'a> {
    /// Collects the facts about a run.
    ///
    /// # Errors
    /// Returns an error if the trace cannot be read.
    pub(crate) fn new(scenario: &'a Scenario, played: &'a RunResult) -> Result<Self, String> {
        let settings = scenario.settings(Path::new("none"));
        let replay = Replay::of(&queues(scenario), &played.trace);
        if let Some(defect) = &replay.defect {
            return Err(defect.clone());
        }
        if let Some((number, opened)) = (0..).zip(&replay.opened).find(|(t, opened)| *t != opened.t)
        {
            return Err(format!("{} is opened as number {number}", opened.t));
        }
        let mut facts = Self {
            scenario,
            inputs: scenario.all_inputs(),
            played,
            replay,
            messages: Vec::new(),
            rejected: Vec::new(),
            set: states(scenario, &settings, &played.log.turned),
        };
        facts.assign();
        Ok(facts)
    }

    /// Returns each message that was assigned to an input, with its entry in the replayed trace.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = (&Message<'a>, &OpenedMessage)> {
        self.messages.iter().zip(&self.replay.opened)
    }

    /// Returns the decided items of a message.
    pub(crate) fn items(&self, opened: &OpenedMessage) -> impl Iterator<Item = &DecidedItem> {
        opened.items.iter().map(|index| &self.replay.items[*index])
    }

    /// Returns the offer of a message to a cloud.
    pub(crate) fn offer(&self, opened: &OpenedMessage, index: usize) -> Option<&DecidedOffer> {
        let is_it = |offer: &&DecidedOffer| offer.t == opened.t && usize::from(offer.p) == index;
        self.replay.offers.iter().find(is_it)
    }

    /// Returns the results that were too late or superseded.
    pub(crate) fn late(&self, index: usize) -> impl Iterator<Item = &DroppedResult> {
        self.replay.dropped.iter().filter(move |dropped| {
            let is_late = matches!(dropped.why, DropReason::Late | DropReason::Superseded);
            dropped.is_result && is_late && usize::from(dropped.p) == index
        })
    }

    /// Assigns inputs to messages. The node accepts inputs one after the other, each at the instant
    /// at which it came.
    fn assign(&mut self) {
        let mut statuses = BTreeMap::<_, Vec<&StatusReport>>::new();
        for reported in &self.played.log.statuses {
            statuses.entry(reported.timestamp()).or_default().push(reported);
        }
        for (serial, at) in self.played.log.arrived_at.iter().enumerate() {
            let input = &self.inputs[serial];
            let next = self.messages.len();
            let when = self.meanwhile(*at);
            let is_it =
                self.replay.opened.get(next).is_some_and(|opened| when.contains(&opened.at))
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

    /// Returns the states that may have been in force when an input came. If a state was set at
    /// that instant, either may have been first.
    pub(crate) fn states(&self, at: u64) -> impl Iterator<Item = &State> {
        let when = self.meanwhile(at);
        let before = self.set.iter().rev().find(|(since, _)| *since < at);
        let meanwhile = self.set.iter().filter(move |(since, _)| when.contains(since));
        before.into_iter().chain(meanwhile).map(|(_, state)| state)
    }

    /// Returns when the node may have looked at an input of this instant. That is at once, unless
    /// its process stood still from then on.
    fn meanwhile(&self, at: u64) -> RangeInclusive<u64> {
        let stalls = self.played.log.turned.iter().filter_map(|(from, turn)| match turn {
            Disturbance::Stalls(long) if *from == at => Some(nanos(*long)),
            _ => None,
        });
        at..=at + stalls.sum::<u64>()
    }

    /// Returns the requests to a peer.
    pub(crate) fn requested(&self, index: usize) -> impl Iterator<Item = &SentRequest> {
        self.played.log.requested.iter().filter(move |requested| requested.index == index)
    }

    /// Returns `true` if a message before this input has its key. A refused message counts only if
    /// `is_there` at its end.
    pub(crate) fn has_remembered(&self, serial: usize, is_there: impl Fn(u64) -> bool) -> bool {
        self.pairs().any(|(message, opened)| {
            let is_before = message.serial < serial;
            let was_refused = |item: &DecidedItem| {
                matches!(item.departure, Departure::Refused(_)) && !is_there(item.at)
            };
            let is_remembered = !self.items(opened).last().is_some_and(was_refused);
            is_before && is_remembered && self.inputs[message.serial].key == self.inputs[serial].key
        })
    }

    /// Returns `true` if another input with the same key came at the same instant.
    pub(crate) fn is_doubled_at_once(&self, serial: usize) -> bool {
        let at = &self.played.log.arrived_at;
        let is_same = |other: &usize| {
            self.inputs[*other].key == self.inputs[serial].key && at[*other] == at[serial]
        };
        (0..at.len()).filter(is_same).count() > 1
    }

    /// Returns the kinds of endings that the run came to.
    pub(crate) fn kinds(&self) -> BTreeSet<&'static str> {
        KINDS.iter().filter(|(_, is)| is(self)).map(|(kind, _)| *kind).collect()
    }

    fn leaves(&self, how: impl Fn(Departure) -> bool) -> bool {
        self.replay.items.iter().any(|item| how(item.departure))
    }
}

fn queues(scenario: &Scenario) -> QueueConfig {
    let calls = scenario.peers.iter().map(|peer| usize::from(peer.in_flight));
    QueueConfig {
        commit: scenario.commit,
        at_once: scenario.peers[LOCAL].in_flight.into(),
        waiting: scenario.waiting.into(),
        skip_answered: false,
        clouds: (0..).zip(calls).skip(1).collect(),
    }
}

/// Returns the states, each with the instant from which it was in force.
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
                // A value that is not a positive number of seconds, or exceeds the greatest
                // deadline, is ignored.
                if seconds > 0.0 && seconds <= 60.0 {
                    state.deadline = Duration::from_secs_f64(seconds);
                }
            }
            Disturbance::Activate(is_active) => state.is_active = is_active,
            Disturbance::Dies { peer, is_seen } => {
                // A called cloud gets requests in any case.
                state.peers[peer].is_there = !is_seen || scenario.peers[peer].is_called;
            }
            Disturbance::Lives(peer) => state.peers[peer].is_there = true,
        }
        states.push((*at, state.clone()));
    }
    states
}

impl StatusReport {
    pub(crate) fn value(&self, key: &str) -> Option<&str> {
        value(&self.status.values, key)
    }

    pub(crate) fn timestamp(&self) -> Option<u64> {
        self.value("timestamp")?.parse().ok()
    }

    pub(crate) fn key(&self) -> Option<u64> {
        self.value("key")?.parse().ok()
    }
}

/// Returns the value of a status under a key.
pub(crate) fn value<'a>(values: &'a [KeyValue], key: &str) -> Option<&'a str> {
    values.iter().find(|value| value.key == key).map(|value| &*value.value)
}
