//! One run: operators whose requests share an uplink and whose replies share a downlink, in virtual time.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::time::Duration;

use fuseline_deadline::{
    Accuracy, End, Expected, LinkQueue, LinkRate, Policy, SendBudget, Situation,
};

use crate::emulation::REPLY_BYTES;
use crate::scenario::approach::{nanos, seconds};
use crate::scenario::link::{DeadlineRule, Remedy};
use crate::scenario::operator::{CLOUD, CloudRequest, ScenarioMessage, ScenarioOperator};

/// Operators of one vehicle at most.
pub(crate) const OPERATORS: usize = 4;
/// A late call is observed until so many later ones are under way.
const OBSERVED: usize = 16;
/// One message in so many that are not worth their bytes shows whether they would be by now.
const PROBE_EVERY: Option<u32> = Some(30);
/// What a millisecond of waiting costs, in points of AP: as `fuseline run` has it.
const PRICE_PER_MS: f64 = 0.01;

/// An operator: what it sends, and how good its results are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RequestStream {
    pub(crate) bytes: u64,
    /// Messages in a second.
    pub(crate) rate: f64,
    /// Box AP of the model on board, and of the cloud's.
    pub(crate) ap: [f64; 2],
}

/// What a run is about; seconds and bits a second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkRun<'a> {
    pub(crate) streams: &'a [RequestStream],
    pub(crate) uplink: u64,
    pub(crate) downlink: u64,
    pub(crate) queue_bytes: u64,
    pub(crate) local_response: f64,
    pub(crate) cloud_runtime: f64,
    pub(crate) round_trip: f64,
    pub(crate) deadline: f64,
    pub(crate) span: f64,
    pub(crate) remedy: Remedy,
    pub(crate) rule: DeadlineRule,
}

/// What came of an operator's messages.
#[derive(Clone, Copy, PartialEq, Default, Debug)]
pub(crate) struct StreamTotals {
    pub(crate) messages: u32,
    pub(crate) requests: u32,
    /// Requests for which the queue had no room.
    pub(crate) dropped: u32,
    /// Messages whose output is the cloud's.
    pub(crate) by_cloud: u32,
    /// The sum of the outputs' AP.
    pub(crate) ap: f64,
    /// The sum of the times from capture to output, in s.
    pub(crate) waited: f64,
}

/// What happens, of which operator's message.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum LinkEvent {
    Answered { stream: usize, t: u64 },
    Replied { stream: usize, t: u64 },
    Captured { stream: usize },
}

/// An operator in a run.
struct LinkedOperator {
    operator: ScenarioOperator,
    policy: Expected<Accuracy>,
    /// When each call began that has not come to its end.
    calls: BTreeMap<u64, u64>,
    captured: Vec<u64>,
    totals: StreamTotals,
}

/// A run under way.
struct LinkSimulation<'a> {
    run: LinkRun<'a>,
    operators: Vec<LinkedOperator>,
    events: BinaryHeap<Reverse<(u64, LinkEvent)>>,
    uplink: LinkQueue,
    downlink: LinkQueue,
    budget: SendBudget<OPERATORS>,
    /// One message in so many is sent, where that is the remedy.
    every: u64,
}

impl LinkRun<'_> {
    /// The bits that all messages have in a second, over those that the uplink carries.
    pub(crate) fn load(&self) -> f64 {
        let offered: f64 = self.streams.iter().map(|s| bits(s.bytes) * s.rate).sum();
        offered / bits(self.uplink) * 8.0
    }

    /// What comes of it, by operator.
    pub(crate) fn totals(&self) -> Vec<StreamTotals> {
        let mut simulation = LinkSimulation::new(self);
        while let Some(Reverse((at, event))) = simulation.events.pop() {
            simulation.happen(at, event);
        }
        simulation.operators.into_iter().map(LinkedOperator::end).collect()
    }
}

impl<'a> LinkSimulation<'a> {
    fn new(run: &LinkRun<'a>) -> Self {
        let operators: Vec<_> = run.streams.iter().map(|s| LinkedOperator::new(s, run)).collect();
        let streams = 0..operators.len();
        let queue = LinkQueue::new(run.queue_bytes);
        Self {
            run: *run,
            operators,
            events: streams.map(|stream| Reverse((0, LinkEvent::Captured { stream }))).collect(),
            uplink: queue,
            downlink: queue,
            budget: SendBudget::new(
                run.uplink / 8,
                Duration::from_secs_f64(run.deadline),
                PROBE_EVERY,
            ),
            every: whole_above(run.load()),
        }
    }

    fn happen(&mut self, at: u64, event: LinkEvent) {
        match event {
            LinkEvent::Captured { stream } => self.capture(at, stream),
            LinkEvent::Replied { stream, t } => {
                let rate = LinkRate::constant(self.run.downlink);
                // A reply that finds no room is lost.
                if let Some(at) = self.downlink.send(at, REPLY_BYTES as u64, |_| rate) {
                    self.events.push(Reverse((at, LinkEvent::Answered { stream, t })));
                }
            }
            LinkEvent::Answered { stream, t } => {
                let operator = &mut self.operators[stream];
                operator.operator.answer(at, t);
                operator.ended(t, |began| End::Answered(since(began, at)));
            }
        }
    }

    /// A message comes, and the next one after it.
    fn capture(&mut self, at: u64, stream: usize) {
        let RequestStream { bytes, rate, .. } = self.run.streams[stream];
        let operator = &mut self.operators[stream];
        let t = operator.captured.len() as u64;
        operator.captured.push(at);
        let next = nanos(f64::from(operator.totals.messages + 1) / rate);
        operator.totals.messages += 1;
        if seconds(next) < self.run.span {
            self.events.push(Reverse((next, LinkEvent::Captured { stream })));
        }
        let (gain, deadline) = operator.decide(at, &self.run);
        let is_offered = match self.run.remedy {
            Remedy::None | Remedy::Gate(_) => true,
            Remedy::EveryNth => t.is_multiple_of(self.every),
            Remedy::Budget => self.budget.offer(stream, at, bytes, gain),
        };
        let local = Some(nanos(self.run.local_response));
        let request = is_offered.then_some(CloudRequest { deadline, response: None });
        if !operator.operator.message(&ScenarioMessage { at, local, request }) {
            return;
        }
        operator.totals.requests += 1;
        operator.calls.insert(t, at);
        let rate = LinkRate::constant(self.run.uplink);
        if let Some(sent) = self.uplink.send(at, bytes, |_| rate) {
            let replied = sent + nanos(self.run.round_trip + self.run.cloud_runtime);
            self.events.push(Reverse((replied, LinkEvent::Replied { stream, t })));
        } else {
            operator.totals.dropped += 1;
            operator.operator.fail(at, t);
            operator.ended(t, |_| End::Failed(Duration::ZERO));
        }
    }
}

impl LinkedOperator {
    fn new(stream: &RequestStream, run: &LinkRun<'_>) -> Self {
        let [local, cloud] = stream.ap;
        let loss = Accuracy { local, cloud, price_per_ms: PRICE_PER_MS };
        let response = Duration::from_secs_f64(run.local_response);
        // Calls run on past their due instants, so that nothing is probed.
        let policy = Expected::new(loss, response, None).expect("plausible options");
        let limit = match run.remedy {
            Remedy::Gate(limit) => Some(limit),
            Remedy::None | Remedy::EveryNth | Remedy::Budget => None,
        };
        let operator = ScenarioOperator::gated("link", f64::INFINITY, false, limit);
        let (calls, captured) = (BTreeMap::new(), Vec::new());
        Self { operator, policy, calls, captured, totals: StreamTotals::default() }
    }

    /// What a request is expected to gain, and its deadline.
    fn decide(&mut self, at: u64, run: &LinkRun<'_>) -> (f64, u64) {
        while self.calls.len() > OBSERVED
            && let Some((&oldest, _)) = self.calls.first_key_value()
        {
            self.ended(oldest, |began| End::Censored(since(began, at)));
        }
        let ages: Vec<Duration> = self.calls.values().map(|began| since(*began, at)).collect();
        let situation = Situation { under_way: &ages, ..Situation::UNKNOWN };
        let cap = Duration::from_secs_f64(run.deadline);
        let gain = self.policy.gain(&situation, cap);
        let deadline = match run.rule {
            DeadlineRule::Constant => cap,
            DeadlineRule::Expected => self.policy.decide(&situation, cap).deadline,
        };
        (gain, crate::scenario::approach::whole(deadline))
    }

    fn ended(&mut self, t: u64, end: impl FnOnce(u64) -> End) {
        if let Some(began) = self.calls.remove(&t) {
            self.policy.ended(end(began));
        }
    }

    fn end(mut self) -> StreamTotals {
        self.operator.pass(u64::MAX);
        let Accuracy { local, cloud, .. } = *self.policy.loss();
        for output in self.operator.take_outputs() {
            let index = usize::try_from(output.t).unwrap_or(usize::MAX);
            self.totals.waited += seconds(output.at - self.captured[index]);
            match output.source {
                Some(CLOUD) => {
                    self.totals.by_cloud += 1;
                    self.totals.ap += cloud;
                }
                Some(_) => self.totals.ap += local,
                None => {}
            }
        }
        self.totals
    }
}

fn since(began: u64, at: u64) -> Duration {
    Duration::from_nanos(at - began)
}

#[expect(clippy::cast_precision_loss, reason = "rates and messages are far below 2^53")]
fn bits(count: u64) -> f64 {
    count as f64
}

/// The least whole number that is not less, at least 1.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "above 0, saturating")]
fn whole_above(load: f64) -> u64 {
    (load - 1e-9).ceil().max(1.0) as u64
}
