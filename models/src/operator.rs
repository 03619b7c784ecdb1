//! The model: an operator, and everything that its vehicle can do to it.

use std::sync::atomic::{AtomicBool, Ordering};

use fuseline_traces::Input;
use stateright::{Model, Property};

use crate::claim::Claim;
use crate::property::Holds;
use crate::shown::sightings;
use crate::sighting::{Sighting, Sightings};
use crate::state::State;
use crate::world::{Readings, World};

/// Priorities that no configuration registers. A careless conversion would take the second one for
/// a cloud's priority.
const STRANGERS: [u64; 2] = [3, 65_536 + 2];

/// One operator in the environment of a configuration.
pub struct Operator {
    config: &'static World,
    /// The sightings that were reported. The checker keeps the last report of a sighting, but the
    /// first report has the shortest path to it.
    reported: Vec<AtomicBool>,
    /// The sightings to look for.
    sightings: Vec<Sighting>,
}

impl Operator {
    /// Creates an operator with this configuration.
    #[must_use]
    pub fn new(config: &'static World) -> Self {
        let reported = Sighting::ALL.iter().map(|_| AtomicBool::new(false)).collect();
        Self { config, reported, sightings: config.sightings().collect() }
    }

    /// Returns the same operator without sightings, so that the claims are its only properties.
    #[must_use]
    pub fn without_sightings(self) -> Self {
        Self { sightings: Vec::new(), ..self }
    }

    /// Returns the configuration.
    #[must_use]
    pub const fn config(&self) -> &'static World {
        self.config
    }

    /// Returns the sightings of the steps from a state.
    fn ahead(&self, state: &State) -> Sightings {
        let mut inputs = Vec::new();
        self.actions(state, &mut inputs);
        let mut shown = Sightings::default();
        for input in inputs {
            let (next, answer) = state.step(self.config, &input);
            shown.extend(sightings(self.config, state, &input, &answer, &next).iter());
        }
        shown
    }

    /// Adds the inputs, other than ticks, that can come at an instant.
    fn inputs(&self, at: u64, out: &mut Vec<Input>) {
        let config = self.config;
        let sources = || config.clouds.iter().map(|cloud| u64::from(cloud.p));
        for &t in config.timestamps {
            out.extend(config.local_deadlines.iter().map(|deadline| Input::Open {
                at,
                t,
                deadline: *deadline,
            }));
            for p in sources() {
                for &deadline in config.deadlines {
                    let offer =
                        |backlog: &u64| Input::Offer { at, t, p, deadline, backlog: *backlog };
                    out.extend(config.backlogs.iter().map(offer));
                }
            }
            for p in sources().chain([0]) {
                out.extend([Input::Result { at, t, p }, Input::Fail { at, t, p }]);
            }
        }
    }

    /// Adds the inputs that have no effect: from unknown sources, to local as if it were a cloud,
    /// or due at once.
    fn ineffective_inputs(&self, at: u64, out: &mut Vec<Input>) {
        let Some(&t) = self.config.timestamps.first() else { return };
        out.push(Input::Open { at, t, deadline: Some(0) });
        for p in STRANGERS.into_iter().chain([0]) {
            out.push(Input::Offer { at, t, p, deadline: 1, backlog: 0 });
        }
        for p in STRANGERS {
            out.extend([Input::Result { at, t, p }, Input::Fail { at, t, p }]);
        }
        for cloud in self.config.clouds {
            out.push(Input::Offer { at, t, p: cloud.p.into(), deadline: 0, backlog: 0 });
        }
    }
}

impl Holds<Claim> for Operator {
    fn holds(&self, state: &State, claim: Claim) -> bool {
        !state.violated().contains(claim)
    }
}

impl Holds<Sighting> for Operator {
    /// Returns `true` if a step from this state shows the sighting, unless another state was
    /// already reported to show it.
    fn holds(&self, state: &State, sighting: Sighting) -> bool {
        let Some(reported) = self.reported.get(sighting as usize) else { return false };
        if reported.load(Ordering::Relaxed) {
            return false;
        }
        let shows = state.ahead(|| self.ahead(state)).contains(sighting);
        shows && !reported.swap(true, Ordering::Relaxed)
    }
}

impl Model for Operator {
    type State = State;
    type Action = Input;

    fn init_states(&self) -> Vec<State> {
        State::new(self.config).into_iter().collect()
    }

    fn actions(&self, state: &State, actions: &mut Vec<Input>) {
        if !state.goes_on() {
            return;
        }
        let now = state.ledger.now();
        let clock = self.config.clock;
        let later = clock.iter().copied().filter(|at| *at > now);
        let earlier = clock.iter().copied().rev().find(|at| *at < now);
        self.inputs(now, actions);
        self.ineffective_inputs(now, actions);
        match self.config.readings {
            Readings::Now => {}
            Readings::Next => later.clone().take(1).for_each(|at| self.inputs(at, actions)),
            Readings::Any => earlier.into_iter().chain(later.clone()).for_each(|at| {
                self.inputs(at, actions);
            }),
        }
        actions.extend(earlier.into_iter().chain(later).map(|at| Input::Tick { at }));
    }

    fn next_state(&self, state: &State, input: Input) -> Option<State> {
        Some(state.step(self.config, &input).0)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let claims = Claim::ALL.iter().map(|claim| claim.property());
        claims.chain(self.sightings.iter().map(|sighting| sighting.property())).collect()
    }

    fn format_action(&self, input: &Input) -> String {
        input.to_string()
    }

    fn format_step(&self, state: &State, input: Input) -> Option<String> {
        let (next, answer) = state.step(self.config, &input);
        let mut lines: Vec<_> = answer.decisions().map(ToString::to_string).collect();
        lines.push(format!("{next:?}"));
        Some(lines.join("\n"))
    }
}
