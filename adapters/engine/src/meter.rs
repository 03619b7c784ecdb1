//! The counters and histograms of one operator, registered once through the `metrics` facade.

use fuseline_traces::{DropReason, OfferRefusal, OpenRefusal};
use metrics::{Counter, Gauge, Histogram, counter, gauge, histogram};

use crate::event::CountedEvent;
use crate::item::{Source, Trigger};
use crate::tally::CurrentDeadline;

/// An operator's meters.
pub(crate) struct Meters {
    pub(crate) messages: Counter,
    refused: [Counter; OpenRefusal::ALL.len()],
    pub(crate) missed: Counter,
    pub(crate) handler_failures: Counter,
    /// The delays of timers.
    pub(crate) timer_lag: Histogram,
    pub(crate) open: Gauge,
}

/// One source's meters, ordered by how many messages need them, as [the counts](crate::counts) are.
#[repr(C)]
pub(crate) struct SourceMeters {
    admitted: Counter,
    held: Counter,
    /// The time from the request's admission to its result.
    pub(crate) response: Histogram,
    pub(crate) calls: Gauge,
    pub(crate) backlog: Gauge,
    forwarded: Counter,
    outputs: [Counter; Trigger::ALL.len()],
    /// The time from accepting the message to the output; under progressive, to each output.
    pub(crate) output: Histogram,
    deadlines: [Counter; CurrentDeadline::WHYS.len()],
    /// The deadline of the latest offer.
    pub(crate) deadline: Gauge,
    sent_bytes: Counter,
    preliminary: Counter,
    cancelled: Counter,
    timers: Counter,
    finals: Counter,
    refused: [Counter; OfferRefusal::ALL.len()],
    dropped: [Counter; DropReason::ALL.len()],
    failed: Counter,
    failures_dropped: [Counter; DropReason::ALL.len()],
    lost: Counter,
    handler_failed: Counter,
    policy_failed: Counter,
    held_up: Counter,
}

impl Meters {
    /// Registers with the recorder that is installed now. Without one, counting costs next to nothing.
    pub(crate) fn new(operator: &str) -> Self {
        let operator = operator.to_owned();
        Self {
            messages: counter!("fuseline_messages_total", "operator" => operator.clone()),
            refused: OpenRefusal::ALL.map(|why| {
                counter!("fuseline_refused_messages_total",
                    "operator" => operator.clone(), "why" => why.as_str())
            }),
            missed: counter!("fuseline_missed_messages_total", "operator" => operator.clone()),
            handler_failures: counter!(
                "fuseline_handler_failures_total",
                "operator" => operator.clone(), "source" => "operator", "handler" => "message"
            ),
            timer_lag: histogram!("fuseline_timer_lag_seconds", "operator" => operator.clone()),
            open: gauge!("fuseline_open_messages", "operator" => operator),
        }
    }

    pub(crate) fn refused(&self, why: OpenRefusal) {
        increment(&self.refused, why.index());
    }
}

impl SourceMeters {
    pub(crate) fn new(operator: &str, source: &Source) -> Self {
        let labels =
            [("operator", operator.to_owned()), ("source", source.name.as_ref().to_owned())];
        let by = |name: &'static str, outcome: &'static str| {
            let [operator, source] = labels.clone();
            counter!(name, &[operator, source, ("outcome", outcome.to_owned())])
        };
        let handler = |handler: &'static str| {
            let [operator, source] = labels.clone();
            let labels = [operator, source, ("handler", handler.to_owned())];
            counter!("fuseline_handler_failures_total", &labels)
        };
        let request = |outcome| by("fuseline_requests_total", outcome);
        let result = |outcome| by("fuseline_results_total", outcome);
        let output = |outcome| by("fuseline_outputs_total", outcome);
        let failure = |outcome| by("fuseline_failures_total", outcome);
        Self {
            admitted: request("admitted"),
            refused: OfferRefusal::ALL.map(|why| request(why.as_str())),
            outputs: Trigger::ALL.map(|trigger| output(trigger.as_str())),
            finals: output("final"),
            forwarded: result("forwarded"),
            preliminary: result("preliminary"),
            held: result("held"),
            dropped: DropReason::ALL.map(|why| result(why.as_str())),
            failed: failure("accepted"),
            failures_dropped: DropReason::ALL.map(|why| failure(why.as_str())),
            lost: counter!("fuseline_lost_total", &labels),
            handler_failed: handler("message"),
            policy_failed: handler("policy"),
            held_up: counter!("fuseline_held_up_total", &labels),
            timers: counter!("fuseline_timers_total", &labels),
            cancelled: counter!("fuseline_cancelled_total", &labels),
            sent_bytes: counter!("fuseline_sent_bytes_total", &labels),
            response: histogram!("fuseline_response_seconds", &labels),
            output: histogram!("fuseline_output_seconds", &labels),
            backlog: gauge!("fuseline_backlog", &labels),
            calls: gauge!("fuseline_calls", &labels),
            deadline: gauge!("fuseline_deadline_seconds", &labels),
            deadlines: CurrentDeadline::WHYS.map(|why| {
                let [operator, source] = labels.clone();
                counter!("fuseline_deadlines_total", &[operator, source, ("why", why.to_owned())])
            }),
        }
    }

    /// Counts a deadline that was chosen.
    pub(crate) fn chosen(&self, chosen: &CurrentDeadline) {
        increment(&self.deadlines, chosen.index());
    }

    pub(crate) fn count(&self, event: CountedEvent) {
        match event {
            CountedEvent::Admitted => self.admitted.increment(1),
            CountedEvent::Refused(why) => increment(&self.refused, why.index()),
            CountedEvent::Output(trigger) => increment(&self.outputs, trigger as usize),
            CountedEvent::Final => self.finals.increment(1),
            CountedEvent::Forwarded => self.forwarded.increment(1),
            CountedEvent::Preliminary => self.preliminary.increment(1),
            CountedEvent::Held => self.held.increment(1),
            CountedEvent::Dropped(why) => increment(&self.dropped, why.index()),
            CountedEvent::Failed => self.failed.increment(1),
            CountedEvent::Lost => self.lost.increment(1),
            CountedEvent::HandlerFailed => self.handler_failed.increment(1),
            CountedEvent::PolicyFailed => self.policy_failed.increment(1),
            CountedEvent::HeldUp => self.held_up.increment(1),
            CountedEvent::FailureDropped(why) => increment(&self.failures_dropped, why.index()),
            CountedEvent::Timer => self.timers.increment(1),
            CountedEvent::Cancelled => self.cancelled.increment(1),
            CountedEvent::Sent { bytes } => self.sent_bytes.increment(bytes),
        }
    }
}

fn increment(counters: &[Counter], index: usize) {
    if let Some(counter) = counters.get(index) {
        counter.increment(1);
    }
}
