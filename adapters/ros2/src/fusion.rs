//! The operator on topics: its transport.

use std::collections::HashMap;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::{Duration, SystemTime};

use fuseline_engine::{Counting, Ending, Hint, Item, Lineage, Offer, Origin, Reserve, Situation};
use fuseline_tokio::Call;
use fuseline_tokio::drive::{Incoming, Sent, Start, Transport};
use futures_util::StreamExt;
use tokio::time::Instant;
use tracing::{debug, error};

use crate::key::{MessageKey, Stamp};
use crate::lifecycle::LifecycleRequests;
use crate::middleware::{Endpoint, Publish};
use crate::raw::Payload;
use crate::report::{self, NodeCounts, Reporter};
use crate::source::{NodeSource, Route};
use crate::speed::Speed;
use crate::stamps::Stamps;
use crate::status_publisher::PublishStatus;
use crate::stop::Stop;

mod channels;
#[cfg(test)]
mod tests;

use channels::known;
pub(crate) use channels::{InputChannels, report_ticks};

/// Local's index among the sources.
const LOCAL: usize = 0;

/// The transport of one node: what it receives and sends.
pub(crate) struct NodeFusion<'a> {
    /// Local, then the clouds in their order.
    pub(crate) sources: Vec<NodeSource>,
    pub(crate) output: Box<dyn Publish>,
    /// The topic of preliminary results, under progressive.
    pub(crate) revisions: Option<Box<dyn Publish>>,
    /// The ends of input and output, to report peers that do not fit.
    pub(crate) ends: Vec<Arc<Endpoint>>,
    pub(crate) input_key: MessageKey,
    /// The stream that messages come from.
    pub(crate) origin: Arc<str>,
    /// The end-to-end deadline of messages, and the part of it that is kept for the nodes
    /// downstream.
    pub(crate) within: Option<Duration>,
    pub(crate) reserve: Duration,
    pub(crate) output_key: MessageKey,
    /// The greatest that a deadline may be.
    pub(crate) greatest_deadline: Duration,
    /// The deadline of clouds without one of their own.
    pub(crate) deadline: Duration,
    pub(crate) node: String,
    pub(crate) status_publisher: Box<dyn PublishStatus>,
    pub(crate) counting: Counting,
    pub(crate) received: InputChannels<'a>,
    /// The requests to a managed node's lifecycle; a plain one is always active.
    pub(crate) orders: Option<&'a mut LifecycleRequests>,
    pub(crate) stop: &'a mut Stop,
    pub(crate) memory: LoopState,
    /// The vehicle's speed, if a topic gives it.
    pub(crate) speed: Option<Speed>,
}

/// The number of parties that take turns in [`InputChannels`].
const TURNS: usize = 7;

/// The state between two events.
pub(crate) struct LoopState {
    stamps: Stamps<Stamp>,
    /// By timestamp: the preliminary result of each open message that has one.
    preliminary: HashMap<u64, Item<Payload>>,
    /// The next message's timestamp.
    next: u64,
    intake: NodeCounts,
    reporter: Reporter,
    /// The party that has the next turn.
    turn: usize,
}

impl LoopState {
    pub(crate) fn new(reporter: Reporter) -> Self {
        let (stamps, preliminary, intake) = (Stamps::new(), HashMap::new(), NodeCounts::default());
        Self { stamps, preliminary, next: 0, intake, reporter, turn: 0 }
    }
}

impl Transport for NodeFusion<'_> {
    type Request = Payload;
    type Value = Payload;
    type Message = Payload;

    /// Topics, parameters and reports take turns, so that a flood on one does not keep another from
    /// its turn.
    fn poll_incoming(&mut self, context: &mut Context<'_>) -> Poll<Incoming<Payload, Payload>> {
        if self.stop.poll_next(context).is_ready() {
            let urgent = self.stop.is_urgent();
            return Poll::Ready(if urgent { Incoming::Stop } else { Incoming::Last });
        }
        let mut idle = 0;
        while idle < TURNS {
            let turn = self.memory.turn;
            self.memory.turn = (turn + 1) % TURNS;
            let received = &mut self.received;
            let event = match turn {
                0 if self.stop.is_requested()
                    || self.orders.as_ref().is_some_and(|it| it.last.is_some()) =>
                {
                    Poll::Pending
                }
                // Inputs that come while the node is inactive are not kept.
                0 => known(received.inputs.poll_recv(context))
                    .map(|sample| if self.is_active() { self.take(sample) } else { None }),
                1 => known(received.results.poll_recv(context))
                    .map(|(index, sample)| self.result(index, sample)),
                2 => known(received.deadlines.poll_recv(context))
                    .map(|sample| self.environment(sample))
                    .map(|()| None),
                3 => known(received.changes.poll_recv(context))
                    .map(|change| self.change(change))
                    .map(|()| None),
                4 => known(received.speeds.poll_recv(context))
                    .map(|sample| self.take_speed(sample))
                    .map(|()| None),
                5 => self.poll_orders(context),
                _ => known(received.reports.poll_next_unpin(context))
                    .map(|()| self.report())
                    .map(|()| None),
            };
            match event {
                Poll::Ready(Some(event)) => return Poll::Ready(event),
                Poll::Ready(None) => idle = 0,
                Poll::Pending => idle += 1,
            }
        }
        Poll::Pending
    }

    fn job(&mut self, payload: &Payload) -> (Payload, Option<Duration>) {
        (payload.clone(), self.sources[LOCAL].deadline)
    }

    /// Offers the message to each cloud that is there.
    fn offers(&mut self, _: u64, payload: &Payload) -> impl Iterator<Item = Offer<Payload>> {
        let requested = self.sources.iter().skip(1).filter(|it| it.enabled && it.is_reached());
        requested.map(|source| Offer {
            priority: source.priority,
            deadline: source.deadline.unwrap_or(self.deadline),
            request: payload.clone(),
        })
    }

    fn lineage(&mut self, timestamp: u64, _: &Payload) -> Option<Arc<Lineage>> {
        self.lineage_of(timestamp)
    }

    fn reserve(&mut self) -> Reserve {
        Reserve::new(self.reserve, self.reserve)
    }

    fn situation(&mut self, _: u64, _: &Payload) -> Option<Situation<'static>> {
        Some(self.speed.as_ref()?.situation(Instant::now()))
    }

    fn send(&mut self, start: Start<Payload>) -> Sent<Payload> {
        let Start { priority, timestamp, left, request } = start;
        let Some(source) = self.sources.iter().find(|source| source.priority == priority) else {
            return Sent::Failed("there is no such source".into());
        };
        match &source.route {
            Route::Topics { requests, .. } if requests.matched() == 0 => {
                Sent::Failed("no node subscribes to its topic".into())
            }
            Route::Topics { requests, .. } => {
                let bytes = request.body.len() as u64;
                if !requests.publish(request) {
                    return Sent::Failed("its subscriber is too far behind".into());
                }
                self.counting.sent(priority, bytes);
                Sent::Away
            }
            Route::Grpc(handle) => {
                let call = Call::new(timestamp, left, priority, self.counting.clone());
                let call = call.with_lineage(self.lineage_of(timestamp));
                let handle = Arc::clone(handle);
                let (input_key, output_key) = (self.input_key, self.output_key);
                Sent::Call(Box::pin(async move {
                    let requested = input_key.read(&request.body, request.big_endian);
                    let mut reply = handle(request, call).await?;
                    let stamp = output_key.read(&reply.value.body, reply.value.big_endian);
                    // D2: what the reply says of itself, by its stamp if not in words.
                    let is_same = stamp.is_ok() && stamp == requested;
                    reply.of = reply.of.or_else(|| is_same.then_some(timestamp));
                    Ok(reply)
                }))
            }
        }
    }

    /// Publishes a late result, which may help with the next messages. It never goes to the
    /// output's topic.
    fn hint(&mut self, hint: Hint<Payload>) {
        let Hint { source, value, timestamp, why, .. } = hint;
        let of = self.sources.iter().find(|it| it.priority == source.priority);
        if let Some(hints) = of.and_then(|source| source.hints.as_ref())
            && !hints.publish(value)
        {
            debug!(timestamp, %source, %why, "a late result is not published as a hint, because a \
                                              subscriber is too far behind");
        }
    }

    /// Publishes an item. Only the last item of a message goes to the output's topic (F7, F9).
    fn output(&mut self, item: Item<Payload>) {
        let LoopState { stamps, preliminary, intake, .. } = &mut self.memory;
        let timestamp = item.timestamp;
        let key = match item.ending {
            Ending::Preliminary(_) => stamps.key(timestamp),
            Ending::Refused(_) => stamps.refuse(timestamp),
            Ending::Forwarded(_) | Ending::Final(_) | Ending::Missed => stamps.answer(timestamp),
        };
        let status = report::of_item(&self.node, key, &item);
        let item = match preliminary.remove(&timestamp) {
            Some(earlier) => item.instead_of(earlier),
            None => item,
        };
        let topic = if item.is_last() { Some(&self.output) } else { self.revisions.as_ref() };
        if let (Some(topic), Some(forwarded)) = (topic, item.forwarded())
            && !topic.publish(forwarded.value.clone())
        {
            error!(
                timestamp,
                "the output is not published, because a subscriber is too far behind"
            );
            intake.unsent += 1;
        }
        if !item.is_last() {
            preliminary.insert(timestamp, item);
        }
        self.status_publisher.status(status);
    }
}

impl NodeFusion<'_> {
    /// Returns the lineage of an open message. Its stamp is read from the wall clock, whose steps
    /// no deadline may follow (D13). So the age is only written and sent. The end-to-end deadline
    /// counts from the intake.
    fn lineage_of(&self, timestamp: u64) -> Option<Arc<Lineage>> {
        let stamp = self.memory.stamps.key(timestamp)?;
        let age = match self.input_key {
            MessageKey::Header => stamp.age(SystemTime::now()),
            MessageKey::Integer { .. } => None,
        };
        let captured = age.and_then(|age| Instant::now().into_std().checked_sub(age));
        let origin = Origin { stream: Arc::clone(&self.origin), seq: stamp.seq() };
        Some(Arc::new(Lineage {
            origin: Some(origin),
            captured,
            within: self.within,
            ..Lineage::default()
        }))
    }
}
