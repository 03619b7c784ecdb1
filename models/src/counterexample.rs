//! Counterexamples as traces.

use fuseline_traces::Input;

use crate::claim::Claim;
use crate::config::Config;
use crate::state::State;

/// A run that breaks a claim.
#[derive(Clone, Debug)]
pub struct Counterexample {
    /// What it breaks, with its last input.
    pub claim: Claim,
    /// The inputs; without any of them the claim is kept.
    pub inputs: Vec<Input>,
    /// The trace: header, inputs, and decisions as the machine made them.
    pub trace: String,
}

/// The inputs with all left out that is not needed to break the claim.
pub(crate) fn shrink(config: &Config, claim: Claim, mut inputs: Vec<Input>) -> Counterexample {
    let mut place = 0;
    while place < inputs.len() {
        let mut fewer = inputs.clone();
        fewer.remove(place);
        // What is left may end sooner, and what was needed before may be no more.
        if let Some(len) = breaks(config, claim, &fewer) {
            fewer.truncate(len);
            inputs = fewer;
            place = 0;
        } else {
            place += 1;
        }
    }
    let trace = trace(config, &inputs);
    Counterexample { claim, inputs, trace }
}

/// After how many of the inputs the claim is broken, if it is.
fn breaks(config: &Config, claim: Claim, inputs: &[Input]) -> Option<usize> {
    let mut state = State::new(config)?;
    if state.broken().contains(claim) {
        return Some(0);
    }
    for (place, input) in inputs.iter().enumerate() {
        if !state.goes_on() {
            return None;
        }
        state = state.step(config, input).0;
        if state.broken().contains(claim) {
            return Some(place + 1);
        }
    }
    None
}

/// The trace of these inputs with what the machine decides.
fn trace(config: &Config, inputs: &[Input]) -> String {
    let mut lines = vec![config.header().to_string()];
    let mut state = State::new(config);
    for input in inputs {
        lines.push(input.to_string());
        if let Some(before) = &state {
            let (next, answer) = before.step(config, input);
            lines.extend(answer.decisions().map(ToString::to_string));
            state = Some(next);
        }
    }
    lines.push(String::new());
    lines.join("\n")
}
