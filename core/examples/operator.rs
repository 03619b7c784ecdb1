//! A whole operator around the core: a clock, threads, and values. The cloud returns one of three
//! results. Run it with `cargo run -p fuseline-core --example operator`.

use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::{Duration, Instant as Clock};

use fuseline_core::{
    Admission, Cloud, Commit, Deadline, Fusion, Held, Instant, Opening, Outcome, Priority, Ready,
    Timestamp,
};

const CLOUD: Priority = Priority::new(1);

enum Event {
    Message(Timestamp),
    Result(Timestamp, Priority, String),
}

struct Operator {
    start: Clock,
    fusion: Fusion<1, 16>,
    held: Held<String, 16>,
    /// The outputs sent downstream: a value, or `None` for a message that was missed or refused.
    outputs: Vec<(Timestamp, Option<String>)>,
    events: Sender<Event>,
}

impl Operator {
    /// Fires the timers that are due and sends their outputs; then the core accepts inputs.
    fn ready(&mut self) -> Ready<'_, 1, 16> {
        let Self { start, fusion, held, outputs, .. } = self;
        let now = Instant::from_nanos(Deadline::from(start.elapsed()).as_nanos());
        fusion.ready(now, |firing| {
            let value = held.firing(&firing);
            if matches!(firing.outcome, Outcome::Forwarded { .. } | Outcome::Missed) {
                outputs.push((firing.timestamp, value));
            }
        })
    }

    fn apply(&mut self, event: Event) {
        match event {
            Event::Message(t) => {
                if let Opening::Refused(_) = self.ready().open(t, None) {
                    return self.outputs.push((t, None));
                }
                self.compute(t, Priority::LOCAL);
                let admission = self.ready().offer(t, CLOUD, Deadline::from_millis(50), 0);
                // Every message is offered to the cloud; the network loses all but the first.
                if matches!(admission, Admission::Admitted { .. }) && t == Timestamp::new(0) {
                    self.compute(t, CLOUD);
                }
            }
            Event::Result(t, source, value) => {
                let outcome = self.ready().result(t, source);
                if let Some(value) = self.held.result(t, source, value, &outcome) {
                    self.outputs.push((t, Some(value)));
                }
            }
        }
    }

    /// Stands for a computation on board and for a call to the cloud.
    fn compute(&self, t: Timestamp, source: Priority) {
        let (events, value) =
            (self.events.clone(), format!("message {} by {source:?}", t.as_u64()));
        std::thread::spawn(move || events.send(Event::Result(t, source, value)));
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (events, inbox) = mpsc::channel();
    let fusion = Fusion::new(16, Commit::Eager, &[Cloud::new(CLOUD, 31)])?;
    let (held, outputs) = (Held::new(), Vec::new());
    let mut operator =
        Operator { start: Clock::now(), fusion, held, outputs, events: events.clone() };
    for t in 0..3 {
        events.send(Event::Message(Timestamp::new(t)))?;
    }
    while operator.outputs.len() < 3 {
        let due = operator.fusion.next_due().map(|due| Duration::from_nanos(due.as_nanos()));
        let event = match due {
            Some(due) => inbox.recv_timeout(due.saturating_sub(operator.start.elapsed())),
            None => inbox.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        match event {
            Ok(event) => operator.apply(event),
            Err(RecvTimeoutError::Timeout) => drop(operator.ready()), // a tick
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    for (t, value) in &operator.outputs {
        println!("{}: {}", t.as_u64(), value.as_deref().unwrap_or("no result"));
    }
    assert!(operator.outputs.iter().all(|(_, value)| value.is_some()), "each has at least local's");
    assert!(operator.held.is_empty());
    Ok(())
}
