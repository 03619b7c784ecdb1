//! Counterexamples as traces.

use std::convert::Infallible;

use fuseline_testkit::Simplification;
use fuseline_traces::Input;

use crate::claim::Claim;
use crate::state::State;
use crate::world::World;

/// A run that breaks a claim.
#[derive(Clone, Debug)]
pub struct Counterexample {
    /// The claim that its last input breaks.
    pub claim: Claim,
    /// The inputs. Each of them is needed to break the claim.
    pub inputs: Vec<Input>,
    /// The trace: the header, the inputs, and the machine's decisions.
    pub trace: String,
}

impl Counterexample {
    /// Returns the counterexample with only the inputs that are needed to break the claim.
    pub(crate) fn of(config: &World, claim: Claim, inputs: Vec<Input>) -> Self {
        let inputs = shrink(inputs, |inputs| breaks(config, claim, inputs));
        let trace = trace(config, &inputs);
        Self { claim, inputs, trace }
    }
}

/// Returns the inputs without those that can be left out. An input that only moves the clock
/// becomes a tick.
fn shrink(inputs: Vec<Input>, breaks: impl Fn(&[Input]) -> bool) -> Vec<Input> {
    let tick = |index: usize| -> Simplification<Vec<Input>> {
        Box::new(move |inputs| inputs[index] = Input::Tick { at: inputs[index].at() })
    };
    let ticks = |inputs: &Vec<Input>| (0..inputs.len()).map(tick).collect();
    let breaks = |inputs: &Vec<Input>| Ok::<_, Infallible>(breaks(inputs));
    let Ok(smallest) = fuseline_testkit::shrink(inputs, ticks, breaks);
    smallest
}

/// Returns `true` if the inputs break the claim.
fn breaks(config: &World, claim: Claim, inputs: &[Input]) -> bool {
    let Some(mut state) = State::new(config) else { return false };
    inputs.iter().any(|input| {
        state.goes_on() && {
            state = state.step(config, input).0;
            state.violated().contains(claim)
        }
    })
}

/// Returns the trace of these inputs with the machine's decisions.
fn trace(config: &World, inputs: &[Input]) -> String {
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

#[cfg(test)]
mod tests {
    use fuseline_traces::judge;

    use super::*;

    fn ticks(instants: &[u64]) -> Vec<Input> {
        instants.iter().map(|at| Input::Tick { at: *at }).collect()
    }

    #[test]
    fn shrinking_leaves_what_is_needed_and_no_more() {
        // The claim is broken if a 3 comes after a 1.
        let breaks = |inputs: &[Input]| {
            let from_one = inputs.iter().skip_while(|input| input.at() != 1);
            from_one.into_iter().any(|input| input.at() == 3)
        };
        let mut inputs = ticks(&[0, 1, 2, 1, 3, 4, 3]);
        inputs.insert(2, Input::Open { at: 1, t: 0, deadline: None });
        inputs.insert(6, Input::Result { at: 3, t: 0, p: 0 });
        assert_eq!(shrink(inputs, breaks), ticks(&[1, 3]));
    }

    #[test]
    fn the_trace_of_a_run_is_one_that_the_judge_reads() {
        let config = World::named("2x1-eager").expect("a configuration");
        let inputs = [
            Input::Open { at: 0, t: 0, deadline: Some(2) },
            Input::Offer { at: 0, t: 0, p: 5, deadline: 3, backlog: 0 },
            Input::Result { at: 1, t: 0, p: 0 },
            Input::Tick { at: 4 },
        ];
        let trace = trace(config, &inputs);
        let verdict = judge("a run", trace.as_bytes()).expect("a trace");
        assert!(verdict.violations.is_empty(), "{trace}");
        assert_eq!((verdict.lines, verdict.judged), (9, 1), "{trace}");
    }

    #[test]
    fn no_run_breaks_what_is_kept() {
        let config = World::named("2x1-eager").expect("a configuration");
        let inputs = ticks(&[1, 0, 4]);
        assert!(!Claim::ALL.iter().any(|claim| breaks(config, *claim, &inputs)));
    }
}
