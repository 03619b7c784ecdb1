//! Makes a run smaller as long as it breaks the same check.

use std::ops::Range;

use fuseline_testkit::{Simplification, Steps};

use crate::simulate::nodes::scenario::{Delivery, Form, Scenario};

/// The steps are the inputs, then the disturbances.
impl Steps for Scenario {
    fn count(&self) -> usize {
        self.inputs.len() + self.turns.len()
    }

    fn remove(&mut self, steps: Range<usize>) {
        let inputs = self.inputs.len();
        self.turns.drain(steps.start.max(inputs) - inputs..steps.end.max(inputs) - inputs);
        self.inputs.drain(steps.start.min(inputs)..steps.end.min(inputs));
    }
}

/// Returns simplifications. Each of them removes one thing.
pub(crate) fn simplifications(scenario: &Scenario) -> Vec<Simplification<Scenario>> {
    let mut all: Vec<Simplification<Scenario>> = Vec::new();
    let inputs = 0..scenario.inputs.len().min(40);
    for index in 0..scenario.peers.len() {
        all.push(Box::new(move |it| it.peers[index].hints = false));
        all.push(Box::new(move |it| it.peers[index].is_called = false));
        for input in inputs.clone() {
            all.push(Box::new(move |it| it.inputs[input].fates[index] = Delivery::fair(index)));
        }
    }
    for input in inputs {
        all.push(Box::new(move |it| it.inputs[input].form = Form::Whole));
        all.push(Box::new(move |it| it.inputs[input].is_unsent = false));
    }
    all.push(Box::new(|it| it.window = 16));
    all.push(Box::new(|it| it.waiting = 64));
    all
}
