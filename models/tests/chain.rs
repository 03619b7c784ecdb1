//! Checks two chained operators under one end-to-end deadline, state by state, with the shipped
//! machine twice and the engine's budget (E1 to E4).
//!
//! The environment captures, offers, returns results, fails, and serves each timer up to
//! [`LATENESS`] late. The second operator accepts an item when the first sends it.

use std::time::Duration;

use fuseline_core::{Priority, Timestamp};
use fuseline_engine::arbiter::Arbiter;
use fuseline_engine::{Budget, Reserve};
use fuseline_traces::{Cloud, Commit, Decision, Header, Input, nanos};
use stateright::{Checker, Model, Property};

/// The time from capture to the last output.
const WITHIN: u64 = 4;
/// The reserves of the first and of the second operator.
const RESERVES: [u64; 2] = [2, 0];
/// The greatest lateness of each operator's timers.
const LATENESS: u64 = 1;
/// The time that a cloud may take by its own deadline.
const DEADLINES: [u64; 2] = [1, 5];
/// The ages of a message when the first operator accepts it.
const AGES: [u64; 2] = [0, 3];
const HORIZON: u64 = 9;
const CLOUD: u64 = 1;

/// The chain and its environment.
struct Chain {
    window: u16,
    messages: usize,
    has_substitutes: bool,
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct ChainState {
    now: u64,
    stages: [ChainStage; 2],
    /// The outcomes that the step to this state showed.
    shown: Vec<ChainOutcome>,
    broken: Vec<&'static str>,
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct ChainStage {
    machine: Arbiter<1, 2>,
    /// The messages by timestamp.
    messages: Vec<ChainMessage>,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct ChainMessage {
    captured: u64,
    /// The instant at which the first operator accepted it.
    written: u64,
    taken_in: u64,
    /// `true` if there is a result to compute from.
    has_value: bool,
    /// The number of its endings.
    endings: u32,
    ended: Option<u64>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
enum ChainOutcome {
    /// An item without a result led to an output.
    OutputOfNothing,
    AtTheLatest,
    RequestIsCut,
    NothingIsLeft,
    SubstituteInTime,
    CloudSends,
}

#[derive(Clone, PartialEq, Eq, Debug)]
enum ChainAction {
    Capture { age: u64 },
    Offer { operator: usize, t: u64, deadline: u64 },
    Result { operator: usize, t: u64, p: u64 },
    Fail { operator: usize, t: u64, p: u64 },
    Tick { operator: usize },
    Advance,
}

impl Chain {
    fn machine(&self) -> Arbiter<1, 2> {
        let cloud = Cloud { p: 1, name: None, limit: 9, resume: 0 };
        let (window, clouds) = (self.window, vec![cloud]);
        Arbiter::new(&Header { operator: None, window, commit: Commit::Eager, clouds }).unwrap()
    }

    fn budget(operator: usize, message: &ChainMessage) -> Budget {
        let reserve = Duration::from_nanos(RESERVES[operator]);
        Budget::ending_at(message.captured + WITHIN, Reserve::new(reserve, reserve))
    }

    /// Opens a message at an operator, which may refuse it (F1).
    fn take_in(&self, state: &mut ChainState, operator: usize, message: ChainMessage) {
        let (at, t) = (state.now, state.stages[operator].messages.len() as u64);
        let message = ChainMessage { taken_in: at, endings: 0, ended: None, ..message };
        let deadline = Self::budget(operator, &message).for_local(at, self.has_substitutes);
        state.stages[operator].messages.push(message);
        self.apply(state, operator, &Input::Open { at, t, deadline: Some(nanos(deadline)) });
    }

    fn apply(&self, state: &mut ChainState, operator: usize, input: &Input) {
        let mut decisions = Vec::new();
        state.stages[operator].machine.decide(input, |decision| decisions.push(decision));
        for decision in decisions {
            match decision {
                Decision::Emit { t, p, .. } => self.ended(state, operator, t, Some(p)),
                Decision::Miss { t, .. } | Decision::RefuseOpen { t, .. } => {
                    self.ended(state, operator, t, None);
                }
                Decision::Request { t, due, .. } => requested(state, operator, t, due),
                _ => {}
            }
        }
    }

    /// Sends the item of a message from an operator.
    fn ended(&self, state: &mut ChainState, operator: usize, t: u64, by: Option<u64>) {
        let now = state.now;
        let message = &mut state.stages[operator].messages[usize::try_from(t).unwrap()];
        message.endings += 1;
        message.ended.get_or_insert(now);
        let message = *message;
        let ChainMessage { captured, written, taken_in, has_value, .. } = message;
        let reserve_begins = captured + WITHIN - RESERVES[operator];
        if by.is_none() && self.has_substitutes {
            if now > reserve_begins.max(taken_in + 1) + LATENESS {
                state.broken.push("E4");
            }
            if operator == 0 && now == reserve_begins {
                state.shown.push(ChainOutcome::SubstituteInTime);
            }
        }
        if operator == 0 {
            self.take_in(state, 1, ChainMessage { has_value: by.is_some(), ..message });
        } else {
            if by.is_some() && !has_value {
                state.shown.push(ChainOutcome::OutputOfNothing);
            }
            if now == latest(captured, written, 1) {
                state.shown.push(ChainOutcome::AtTheLatest);
            }
            if by == Some(CLOUD) {
                state.shown.push(ChainOutcome::CloudSends);
            }
        }
    }
}

/// Returns the latest instant at which an operator may answer a message (E2). Each operator on the
/// way adds the lateness of one timer. If the message is over when it comes, the operator also adds
/// the least deadline, which is 1 ns (F1).
fn latest(captured: u64, written: u64, operator: u64) -> u64 {
    (captured + WITHIN).max(written + 1) + LATENESS + operator * (LATENESS + 1)
}

/// Checks that a request ends by its own deadline, and no later than where the reserve begins (E3).
fn requested(state: &mut ChainState, operator: usize, t: u64, due: u64) {
    let message = &state.stages[operator].messages[usize::try_from(t).unwrap()];
    if due > message.captured + WITHIN - RESERVES[operator] {
        state.broken.push("E3");
    }
}

impl ChainState {
    /// Returns `true` if each message has one item, and each item of the first operator leads to
    /// one item of the second (E1).
    fn is_answered_once(&self) -> bool {
        let [first, second] = &self.stages;
        let items = first.messages.iter().filter(|message| message.endings > 0).count();
        items == second.messages.len()
            && self.stages.iter().flat_map(|operator| &operator.messages).all(|it| it.endings <= 1)
    }

    /// Returns `true` if every ending is in time (E2).
    fn is_in_time(&self) -> bool {
        (0..).zip(&self.stages).all(|(index, operator)| {
            operator.messages.iter().all(|message| {
                message.ended.unwrap_or(self.now)
                    <= latest(message.captured, message.written, index)
            })
        })
    }

    fn shows(&self, shown: ChainOutcome) -> bool {
        self.shown.contains(&shown)
    }
}

impl Model for Chain {
    type State = ChainState;
    type Action = ChainAction;

    fn init_states(&self) -> Vec<ChainState> {
        let operator = || ChainStage { machine: self.machine(), messages: Vec::new() };
        let stages = [operator(), operator()];
        vec![ChainState { now: 0, stages, shown: Vec::new(), broken: Vec::new() }]
    }

    fn actions(&self, state: &ChainState, actions: &mut Vec<ChainAction>) {
        if state.stages[0].messages.len() < self.messages {
            let ages = AGES.into_iter().filter(|age| *age <= state.now);
            actions.extend(ages.map(|age| ChainAction::Capture { age }));
        }
        for (operator, ChainStage { machine, .. }) in state.stages.iter().enumerate() {
            for (timestamp, slot) in machine.fusion().open() {
                let t = timestamp.as_u64();
                let of = |p| machine.fusion().source(Priority::new(p)).unwrap();
                if !slot.requested().contains(of(1)) {
                    let offer = |deadline| ChainAction::Offer { operator, t, deadline };
                    actions.extend(DEADLINES.map(offer));
                }
                for p in [0, 1].into_iter().filter(|p| slot.pending().contains(of(*p))) {
                    let p = p.into();
                    actions.push(ChainAction::Result { operator, t, p });
                    actions.push(ChainAction::Fail { operator, t, p });
                }
            }
            if machine.next_due().is_some_and(|due| due <= state.now) {
                actions.push(ChainAction::Tick { operator });
            }
        }
        let is_late = |operator: &ChainStage| {
            operator.machine.next_due().is_some_and(|due| due + LATENESS <= state.now)
        };
        if state.now < HORIZON && !state.stages.iter().any(is_late) {
            actions.push(ChainAction::Advance);
        }
    }

    fn next_state(&self, last: &ChainState, action: ChainAction) -> Option<ChainState> {
        let mut state = last.clone();
        state.shown.clear();
        let at = state.now;
        match action {
            ChainAction::Advance => state.now += 1,
            ChainAction::Capture { age } => {
                let (endings, ended, has_value) = (0, None, true);
                let (captured, written, taken_in) = (at - age, at, at);
                let message =
                    ChainMessage { captured, written, taken_in, has_value, endings, ended };
                self.take_in(&mut state, 0, message);
            }
            ChainAction::Tick { operator } => self.apply(&mut state, operator, &Input::Tick { at }),
            ChainAction::Result { operator, t, p } => {
                self.apply(&mut state, operator, &Input::Result { at, t, p });
            }
            ChainAction::Fail { operator, t, p } => {
                self.apply(&mut state, operator, &Input::Fail { at, t, p });
            }
            ChainAction::Offer { operator, t, deadline } => {
                let message = &state.stages[operator].messages[usize::try_from(t).unwrap()];
                let left = nanos(Self::budget(operator, message).for_cloud(at));
                let is_open = |state: &ChainState| {
                    state.stages[operator].machine.fusion().slot(Timestamp::new(t)).is_some()
                };
                if is_open(&state) && left == 0 {
                    state.shown.push(ChainOutcome::NothingIsLeft);
                } else if left < deadline {
                    state.shown.push(ChainOutcome::RequestIsCut);
                }
                let input =
                    Input::Offer { at, t, p: CLOUD, deadline: deadline.min(left), backlog: 0 };
                self.apply(&mut state, operator, &input);
            }
        }
        state.shown.sort_unstable();
        state.shown.dedup();
        Some(state)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let mut properties = vec![
            Property::always("E1 one output", |_, state: &ChainState| state.is_answered_once()),
            Property::always("E2 by the deadline", |_, state: &ChainState| state.is_in_time()),
            Property::always("E3 budget", |_, state: &ChainState| !state.broken.contains(&"E3")),
            Property::always("E4 something", |_, state: &ChainState| !state.broken.contains(&"E4")),
            Property::sometimes(
                "E1 an output of an item without a result",
                |_, state: &ChainState| state.shows(ChainOutcome::OutputOfNothing),
            ),
            Property::sometimes("E2 an answer at the latest instant", |_, state: &ChainState| {
                state.shows(ChainOutcome::AtTheLatest)
            }),
            Property::sometimes("E3 a request is cut", |_, state: &ChainState| {
                state.shows(ChainOutcome::RequestIsCut)
            }),
            Property::sometimes("E3 nothing is left for a cloud", |_, state: &ChainState| {
                state.shows(ChainOutcome::NothingIsLeft)
            }),
            Property::sometimes("E3 a cloud's result is sent", |_, state: &ChainState| {
                state.shows(ChainOutcome::CloudSends)
            }),
        ];
        if self.has_substitutes {
            properties.push(Property::sometimes(
                "E4 when the reserve begins",
                |_, state: &ChainState| state.shows(ChainOutcome::SubstituteInTime),
            ));
        }
        properties
    }
}

/// Checks all states. A different number of states means that the machine, the budget or the
/// environment changed.
#[track_caller]
fn assert_holds(chain: Chain, states: usize) {
    let checker = chain.checker().threads(2).spawn_bfs().join();
    checker.assert_properties();
    assert_eq!(checker.unique_state_count(), states);
}

/// With substitutes, two operators keep the budget (E1 to E4).
#[test]
fn chain_with_substitutes_keeps_the_budget() {
    assert_holds(Chain { window: 1, messages: 1, has_substitutes: true }, 5_566);
}

/// Without substitutes, two operators keep the budget (E1 to E3).
#[test]
fn chain_without_substitutes_keeps_the_budget() {
    assert_holds(Chain { window: 1, messages: 1, has_substitutes: false }, 5_814);
}

/// The second of two messages may be refused (E1 to E4).
#[test]
fn two_messages_of_a_chain_keep_the_budget() {
    assert_holds(Chain { window: 1, messages: 2, has_substitutes: true }, 700_626);
}
