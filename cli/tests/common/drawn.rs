//! Generated traces with all keys.

use fuseline_testkit::{Generator, Rng};
use fuseline_traces::{
    Annotations, Decision, Event, ExpectedDecisions, Header, Input, Origin, Reference, ValueKeys,
};

/// A generated run with keys beside the rules.
pub(crate) struct DrawnTrace {
    pub(crate) header: Header,
    pub(crate) events: Vec<(Event, Annotations)>,
}

impl DrawnTrace {
    pub(crate) fn draw(number: u64) -> Self {
        let run = Generator { seed: 71, commit: None, clouds: 5 }.run(number);
        let (mut header, mut rng) = (run.header, Rng::with_seed(number));
        header.operator = (!number.is_multiple_of(3)).then(|| format!("operator \"{number}\""));
        for cloud in header.clouds.iter_mut().step_by(2) {
            cloud.name = Some(format!("\"cloud\" of {}", cloud.p));
        }
        let (mut reference, mut decisions) = (Reference::new(&header), ExpectedDecisions::new());
        let mut events = Vec::new();
        for input in &run.inputs {
            events.push(Event::Input(*input));
            reference.apply(input, &mut decisions);
            events.extend(decisions.drain(..).map(|(decision, _)| Event::Decision(decision)));
        }
        let annotated =
            events.into_iter().map(|event| (event, annotations(&mut rng, event, number)));
        let events = annotated.collect();
        Self { header, events }
    }

    pub(crate) fn text(&self) -> String {
        let lines = self.events.iter().map(|(event, annotations)| event.annotated(annotations));
        lines.fold(self.header.to_string() + "\n", |text, line| text + &line + "\n")
    }
}

/// Keys that this event may have; streams are of one trace alone.
fn annotations(rng: &mut Rng, event: Event, trace: u64) -> Annotations {
    let mut some = |most: u64| (rng.u64(0..3) > 0).then(|| rng.u64(0..most));
    match event {
        Event::Input(Input::Open { .. }) => {
            let (age, within, seq) = (some(1 << 40), some(1 << 40), some(9));
            let stream = format!("camera {trace}/{}", some(2).unwrap_or(2)).into();
            let origin = some(1).map(|_| Origin { stream, seq });
            let missing = ["radar", "lidar \"front\""].map(Into::into);
            let missing = missing.into_iter().filter(|_| some(3) == Some(0)).collect();
            Annotations { age, within, origin, missing, ..Annotations::NONE }
        }
        Event::Input(Input::Result { t, p, .. } | Input::Fail { t, p, .. })
        | Event::Decision(Decision::Request { t, p, .. }) => {
            let is_result = matches!(event, Event::Input(Input::Result { .. }));
            let [of, meant_for] = [(); 2].map(|()| is_result.then(|| some(9)).flatten());
            // One attempt a call; local's has no number.
            let attempt = (p > 0).then(|| t.wrapping_add(p) % 3).and_then(|it| it.checked_sub(1));
            let attempt = attempt.and_then(|attempt| u8::try_from(attempt).ok());
            Annotations { of, meant_for, attempt, ..Annotations::NONE }
        }
        Event::Decision(Decision::Emit { .. }) => {
            ValueKeys { of: some(9), meant_for: some(9) }.into()
        }
        _ => Annotations::NONE,
    }
}
