//! An operator in virtual time: the shipped machine decides, and nothing waits.
//! [`ScenarioOperator::pass`] moves time on.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use fuseline_core::ConfigError;
use fuseline_engine::arbiter::Arbiter;
use fuseline_traces::{Cloud, Commit, Decision, Header, Input};

/// The priority of the only cloud.
pub(crate) const CLOUD: u64 = 1;

/// No queue reaches this length, because requests are sent at once.
const NO_LIMIT: u64 = 1 << 20;

/// A deadline that never ends.
pub(crate) const UNLIMITED: u64 = u64::MAX;

/// One message with the responses of its sources, in nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScenarioMessage {
    /// The instant at which it comes.
    pub(crate) at: u64,
    /// The time that local takes, or `None` if it computes nothing for this message. The machine
    /// learns of that at once (F4).
    pub(crate) local: Option<u64>,
    /// The request to the cloud.
    pub(crate) request: Option<CloudRequest>,
}

/// A request to the cloud.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CloudRequest {
    /// The time that it may take.
    pub(crate) deadline: u64,
    /// The time that it takes. If it is `None`, no result comes unless [`ScenarioOperator::answer`]
    /// brings it.
    pub(crate) response: Option<u64>,
}

/// The operator's output for a timestamp.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct ScenarioOutput {
    pub(crate) at: u64,
    pub(crate) t: u64,
    /// The source of the result; `None` if the timestamp was missed.
    pub(crate) source: Option<u64>,
}

/// An operator with local and at most one cloud. Timers are served at the instants at which they
/// are due.
pub(crate) struct ScenarioOperator {
    machine: ScenarioMachine,
    messages: u64,
    /// The arrivals of results: the instant, the message and the source. Arrivals of one instant
    /// are in the order of their messages.
    arrivals: BinaryHeap<Reverse<(u64, u64, u64)>>,
    outputs: Vec<ScenarioOutput>,
    /// `true` if offers state how many requests are under way.
    is_gated: bool,
    /// Requests that are neither answered nor given up.
    under_way: BTreeSet<u64>,
    is_full: bool,
    trace: Option<Vec<u8>>,
}

/// The shipped machine. Most runs are short, and a small window is created much faster than a large
/// one.
enum ScenarioMachine {
    Small(Arbiter<1, SMALL>),
    Large(Arbiter<1, LARGE>),
}

/// The window for runs with few messages, which may all be open at once.
const SMALL: usize = 192;
/// The window for all other runs.
const LARGE: usize = 1024;

impl ScenarioMachine {
    fn new(header: &Header) -> Result<Self, ConfigError> {
        if usize::from(header.window) <= SMALL {
            Ok(Self::Small(Arbiter::new(header)?))
        } else {
            Ok(Self::Large(Arbiter::new(header)?))
        }
    }

    fn decide(&mut self, input: &Input, decide: impl FnMut(Decision)) {
        match self {
            Self::Small(arbiter) => arbiter.decide(input, decide),
            Self::Large(arbiter) => arbiter.decide(input, decide),
        }
    }

    fn next_due(&self) -> Option<u64> {
        match self {
            Self::Small(arbiter) => arbiter.next_due(),
            Self::Large(arbiter) => arbiter.next_due(),
        }
    }
}

impl ScenarioOperator {
    /// Returns an operator of this name, for about this many messages. Its trace is kept if
    /// `is_traced`.
    pub(crate) fn new(name: &str, messages: f64, is_traced: bool) -> Self {
        Self::gated(name, messages, is_traced, None)
    }

    /// Returns an operator with a gate that shuts when this many requests are under way.
    pub(crate) fn gated(name: &str, messages: f64, is_traced: bool, limit: Option<u64>) -> Self {
        let is_gated = limit.is_some();
        let limit = limit.unwrap_or(NO_LIMIT);
        // A window that is too small refuses messages, which is reported.
        let window = if messages < 180.0 { SMALL } else { LARGE };
        let cloud = Cloud { p: 1, name: None, limit, resume: limit - 1 };
        let header = Header {
            operator: is_traced.then(|| name.to_owned()),
            window: u16::try_from(window).unwrap_or(u16::MAX),
            commit: Commit::Eager,
            clouds: vec![cloud],
        };
        let trace = is_traced.then(|| {
            let mut trace = Vec::new();
            header.write(&mut trace);
            trace.push(b'\n');
            trace
        });
        let machine = ScenarioMachine::new(&header).expect("a window of 1 to 1024 and one cloud");
        let (arrivals, outputs) = (BinaryHeap::new(), Vec::new());
        let under_way = BTreeSet::new();
        Self { machine, messages: 0, arrivals, outputs, is_gated, under_way, is_full: false, trace }
    }

    /// Gives a message to local and, if it has a request, to the cloud. Everything due by then
    /// happens first.
    pub(crate) fn message(&mut self, message: &ScenarioMessage) {
        let ScenarioMessage { at, local, request } = *message;
        self.pass(at);
        let t = self.messages;
        self.messages += 1;
        self.input(Input::Open { at, t, deadline: None });
        if let Some(CloudRequest { deadline, response }) = request {
            let backlog = if self.is_gated { self.under_way.len() as u64 } else { 0 };
            self.input(Input::Offer { at, t, p: CLOUD, deadline, backlog });
            if let Some(response) = response {
                self.arrivals.push(Reverse((at.saturating_add(response), t, CLOUD)));
            }
        }
        match local {
            Some(response) => self.arrivals.push(Reverse((at.saturating_add(response), t, 0))),
            None => self.input(Input::Fail { at, t, p: 0 }),
        }
    }

    /// Lets time pass until `to`. Everything that arrives or is due by then happens.
    pub(crate) fn pass(&mut self, to: u64) {
        while let Some(Reverse((at, t, p))) = self.arrivals.peek().copied() {
            if at > to {
                break;
            }
            self.arrivals.pop();
            self.serve(at);
            self.input(Input::Result { at, t, p });
        }
        self.serve(to);
    }

    /// Returns when the next result arrives or the next timer is due.
    pub(crate) fn next(&self) -> Option<u64> {
        let arrival = self.arrivals.peek().map(|Reverse((at, _, _))| *at);
        [arrival, self.machine.next_due()].into_iter().flatten().min()
    }

    /// Returns the outputs since the last call, in their order.
    pub(crate) fn take_outputs(&mut self) -> Vec<ScenarioOutput> {
        std::mem::take(&mut self.outputs)
    }

    /// Returns `true` if a message was refused because the window was full.
    pub(crate) const fn is_full(&self) -> bool {
        self.is_full
    }

    /// Returns the trace, if it was kept.
    pub(crate) fn into_trace(self) -> Option<Vec<u8>> {
        self.trace
    }

    /// Serves each timer that is due by `to` at its due instant.
    fn serve(&mut self, to: u64) {
        while let Some(at) = self.machine.next_due().filter(|due| *due <= to) {
            self.input(Input::Tick { at });
        }
    }

    fn input(&mut self, input: Input) {
        let Self { machine, outputs, under_way, is_full, trace, .. } = self;
        if let Input::Result { t, p: CLOUD, .. } | Input::Fail { t, p: CLOUD, .. } = input {
            under_way.remove(&t);
        }
        if let Some(trace) = trace {
            input.write(trace);
            trace.push(b'\n');
        }
        machine.decide(&input, |decision| {
            if let Some(trace) = trace {
                decision.write(trace);
                trace.push(b'\n');
            }
            match decision {
                Decision::Emit { at, t, p } => {
                    outputs.push(ScenarioOutput { at, t, source: Some(p) });
                }
                Decision::Miss { at, t } => outputs.push(ScenarioOutput { at, t, source: None }),
                // Timestamps rise, so an open is refused only for a full window.
                Decision::RefuseOpen { .. } => *is_full = true,
                Decision::Request { t, .. } => {
                    under_way.insert(t);
                }
                Decision::Timer { t, p: CLOUD, .. } | Decision::Cancel { t, p: CLOUD, .. } => {
                    under_way.remove(&t);
                }
                Decision::Timer { .. }
                | Decision::RefuseOffer { .. }
                | Decision::Hold { .. }
                | Decision::Drop { .. }
                | Decision::Final { .. }
                | Decision::Cancel { .. } => {}
            }
        });
    }
}
