//! Makes a run smaller while it still breaks what it breaks.

use std::time::{Duration, Instant};

use super::scenario::{Delivery, Form, Scenario};

/// How long smaller ones are tried.
const TRIES: Duration = Duration::from_secs(20);

/// The smallest run that was found of which `breaks` is true.
pub(super) fn smallest(scenario: &Scenario, breaks: impl Fn(&Scenario) -> bool) -> Scenario {
    let mut best = scenario.clone();
    let start = Instant::now();
    let is_over = || start.elapsed() > TRIES;
    loop {
        let before = best.clone();
        let mut chunk = best.inputs.len().max(best.turns.len()).max(1);
        while chunk > 0 {
            for part in [ScenarioPart::Inputs, ScenarioPart::Turns] {
                let mut from = 0;
                while from < part.len(&best) && !is_over() {
                    let smaller = part.without(&best, from, chunk);
                    if breaks(&smaller) {
                        best = smaller;
                    } else {
                        from += chunk;
                    }
                }
            }
            chunk /= 2;
        }
        for smaller in plainer(&best) {
            if !is_over() && breaks(&smaller) {
                best = smaller;
                break;
            }
        }
        if best == before || is_over() {
            return best;
        }
    }
}

/// What a run has many of.
#[derive(Clone, Copy)]
enum ScenarioPart {
    Inputs,
    Turns,
}

impl ScenarioPart {
    const fn len(self, scenario: &Scenario) -> usize {
        match self {
            Self::Inputs => scenario.inputs.len(),
            Self::Turns => scenario.turns.len(),
        }
    }

    fn without(self, scenario: &Scenario, from: usize, count: usize) -> Scenario {
        let mut smaller = scenario.clone();
        let to = (from + count).min(self.len(scenario));
        match self {
            Self::Inputs => drop(smaller.inputs.drain(from..to)),
            Self::Turns => drop(smaller.turns.drain(from..to)),
        }
        smaller
    }
}

/// The same with one thing less each.
fn plainer(scenario: &Scenario) -> Vec<Scenario> {
    let mut all = Vec::new();
    let mut propose = |change: &dyn Fn(&mut Scenario)| {
        let mut smaller = scenario.clone();
        change(&mut smaller);
        if smaller != *scenario {
            all.push(smaller);
        }
    };
    for index in 0..scenario.peers.len() {
        propose(&|it| it.peers[index].hints = false);
        propose(&|it| it.peers[index].is_called = false);
        for input in 0..scenario.inputs.len().min(40) {
            propose(&|it| it.inputs[input].fates[index] = Delivery::fair(index));
        }
    }
    for input in 0..scenario.inputs.len().min(40) {
        propose(&|it| it.inputs[input].form = Form::Whole);
        propose(&|it| it.inputs[input].is_unsent = false);
    }
    propose(&|it| it.window = 16);
    propose(&|it| it.waiting = 64);
    all
}
