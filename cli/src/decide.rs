//! The core's decisions as lines.

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::Input;

/// Appends the core's decisions about an input, a line each.
pub(crate) fn decide(arbiter: &mut Arbiter, input: &Input, answer: &mut Vec<u8>) {
    arbiter.decide(input, |decision| {
        decision.write(answer);
        answer.push(b'\n');
    });
}
