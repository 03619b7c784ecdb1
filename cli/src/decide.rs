//! The core's decisions as lines.

use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Annotations, Decision, Event, HeldValues, Input};

/// Goes along with the core's decisions, so that an emit says of its value what the result that it
/// sends said.
#[derive(Default)]
pub(crate) struct AnnotatedAnswers {
    values: HeldValues,
    decisions: Vec<Decision>,
}

impl AnnotatedAnswers {
    /// Appends the core's decisions about an input that has these further keys, a line each.
    pub(crate) fn decide(
        &mut self,
        arbiter: &mut Arbiter,
        input: &Input,
        annotations: &Annotations,
        answer: &mut Vec<u8>,
    ) {
        if self.values.is_idle(annotations.value()) {
            return decide(arbiter, input, answer);
        }
        self.decisions.clear();
        arbiter.decide(input, |decision| self.decisions.push(decision));
        self.values.apply(input, annotations.value(), self.decisions.iter());
        for decision in &self.decisions {
            let sent = self.values.sent(decision);
            Event::Decision(*decision).write_annotated(&sent.into(), answer);
            answer.push(b'\n');
        }
    }
}

/// Appends the core's decisions about an input, a line each.
pub(crate) fn decide(arbiter: &mut Arbiter, input: &Input, answer: &mut Vec<u8>) {
    arbiter.decide(input, |decision| {
        decision.write(answer);
        answer.push(b'\n');
    });
}
