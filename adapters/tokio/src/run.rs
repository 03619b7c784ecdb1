//! An operator on streams. Its [`Transport`] reads the input, makes the requests and writes the
//! items.
//!
//! It accepts no new message while a reader lags. Open messages go on (D8).

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_engine::{
    CarriedMessage, Counting, Hint, Item, Latency, Lineage, Offer, Reserve, Situation,
};
use tokio::sync::oneshot;
use tokio::time::Instant;
use tracing::error;

use crate::call::Call;
use crate::drive::{Incoming, Sent, Start, Transport};
use crate::outbox::Outbox;
use crate::panics::reason;
use crate::pending_call::BoxedRequest;
use crate::setup::{CloudHandler, HintHandler, SituationSource, StateHandler, SubstituteHandler};
use crate::side::SideRunner;
use crate::stream::{Reader, StreamMessage};
use crate::workers::Workers;

/// An operator's input and output, its handlers, and its workers.
pub(crate) struct Streams<I, O> {
    pub(crate) input: Reader<I>,
    pub(crate) clouds: Vec<CloudHandler<I, O>>,
    /// `true` if policies run between the message handlers.
    pub(crate) has_policies: bool,
    pub(crate) situation: Option<SituationSource<I>>,
    pub(crate) sides: Vec<SideRunner<I>>,
    pub(crate) hints: Option<HintHandler<O>>,
    pub(crate) substitutes: Option<SubstituteHandler<O>>,
    pub(crate) states: Vec<StateHandler<O>>,
    pub(crate) reserve: Vec<Latency>,
    /// Messages without a last item and their timestamps, which ascend, if items carry them.
    pub(crate) carried: Option<VecDeque<(u64, Arc<I>)>>,
    pub(crate) workers: Workers<I, O>,
    /// Local's deadline.
    pub(crate) deadline: Option<Duration>,
    pub(crate) output: Outbox<Item<O>>,
    pub(crate) counting: Counting,
    /// `None` once nobody can stop the operator.
    pub(crate) stop: Option<oneshot::Receiver<()>>,
    pub(crate) is_open: bool,
}

/// The work that is sent to a source.
pub(crate) enum Work<I, O> {
    Local(Arc<I>),
    Call(BoxedRequest<O>, Option<Arc<Lineage>>),
}

impl<I: Send + Sync + 'static, O: Send + Sync + 'static> Transport for Streams<I, O> {
    type Request = Work<I, O>;
    type Value = O;
    type Message = StreamMessage<I>;

    fn poll_incoming(&mut self, context: &mut Context<'_>) -> Poll<Incoming<StreamMessage<I>, O>> {
        if let Some(stop) = &mut self.stop
            && let Poll::Ready(reported) = Pin::new(stop).poll(context)
        {
            self.stop = None;
            if reported.is_ok() {
                // Items that were decided are still written, as far as readers have room (D1).
                let _ = self.output.poll_delivered(context);
                return Poll::Ready(Incoming::Stop);
            }
        }
        if let Poll::Ready(completion) = self.workers.poll_completion(context) {
            return Poll::Ready(Incoming::Completion(completion));
        }
        // A lagging reader holds back new messages only.
        let was_waiting = !self.is_delivered();
        if self.output.poll_delivered(context).is_pending() {
            return Poll::Pending;
        }
        if !self.is_open {
            // This tells the driver, which waits for it, that the last item was delivered.
            return if was_waiting { Poll::Ready(Incoming::Last) } else { Poll::Pending };
        }
        self.input.poll_numbered(context).map(|message| {
            if let Some(message) = message {
                return Incoming::Message { timestamp: message.timestamp, message };
            }
            self.is_open = false;
            Incoming::Last
        })
    }

    fn job(&mut self, message: &StreamMessage<I>) -> (Work<I, O>, Option<Duration>) {
        if let Some(carried) = &mut self.carried {
            carried.push_back((message.timestamp, Arc::clone(&message.message)));
        }
        (Work::Local(Arc::clone(&message.message)), self.deadline)
    }

    fn offers(
        &mut self,
        timestamp: u64,
        message: &StreamMessage<I>,
    ) -> impl Iterator<Item = Offer<Work<I, O>>> {
        let Self { clouds, has_policies, counting, .. } = self;
        let mut ended = None;
        clouds.iter_mut().filter_map(move |cloud| {
            ended = ended.filter(|_| !*has_policies);
            let requested = cloud.request(&message.message, timestamp, counting, &mut ended);
            let (request, deadline) = requested?;
            let request = Work::Call(request, message.lineage.clone());
            Some(Offer { priority: cloud.priority, deadline, request })
        })
    }

    fn lineage(&mut self, _: u64, message: &StreamMessage<I>) -> Option<Arc<Lineage>> {
        message.lineage.clone()
    }

    fn situation(
        &mut self,
        timestamp: u64,
        message: &StreamMessage<I>,
    ) -> Option<Situation<'static>> {
        let assess = self.situation.as_mut()?;
        let assessed = handled(&self.counting, "situations", timestamp, || {
            assess(&message.message, timestamp)
        });
        Some(assessed.unwrap_or(Situation::UNKNOWN))
    }

    fn taken_on(
        &mut self,
        timestamp: u64,
        StreamMessage { message, lineage, .. }: &StreamMessage<I>,
    ) {
        for side in &mut self.sides {
            side.on_message(message, timestamp, lineage.as_ref());
        }
    }

    fn hint(&mut self, hint: Hint<O>) {
        let Some(take_hint) = &mut self.hints else { return };
        let timestamp = hint.timestamp;
        handled(&self.counting, "hints", timestamp, || take_hint(hint));
    }

    fn send(&mut self, start: Start<Work<I, O>>) -> Sent<O> {
        let Start { priority, timestamp, left, request } = start;
        match request {
            Work::Local(message) => self.workers.compute(message, timestamp),
            Work::Call(mut request, lineage) => {
                let call = Call::new(timestamp, left, priority, self.counting.clone());
                request.as_mut().begin(call.with_lineage(lineage));
                Sent::Call(request)
            }
        }
    }

    fn replace(&mut self, timestamp: u64) {
        self.workers.replace(timestamp);
    }

    fn reserve(&mut self) -> Reserve {
        self.reserve.iter().sum()
    }

    fn output(&mut self, mut item: Item<O>) {
        item.carried = self.carry(item.timestamp, item.is_last());
        if let Some(forwarded) = item.forwarded() {
            let t = forwarded.of.unwrap_or(item.timestamp);
            for take_over in &mut self.states {
                handled(&self.counting, "states", t, || take_over(t, &forwarded.value));
            }
        }
        // A missed message gets a substitute, so that something is sent for each message (E4).
        if let Some(substitute) = self.substitutes.as_mut().filter(|_| item.needs_substitute()) {
            let timestamp = item.timestamp;
            let given = handled(&self.counting, "substitutes", timestamp, || substitute(&item));
            item.substitute = given.flatten();
            // Only the handler knows how old its substitute is (E7).
            item.age = item.age.filter(|_| item.substitute.is_none());
        }
        self.output.put(item);
    }

    fn is_delivered(&self) -> bool {
        self.output.is_delivered()
    }
}

impl<I: Send + Sync + 'static, O> Streams<I, O> {
    /// Returns the message of an item. The last item takes it away.
    fn carry(&mut self, t: u64, is_last: bool) -> Option<CarriedMessage> {
        let carried = self.carried.as_mut()?;
        let index = carried.binary_search_by_key(&t, |(t, _)| *t).ok()?;
        let message = if is_last {
            carried.remove(index).map(|(_, message)| message)
        } else {
            carried.get(index).map(|(_, message)| Arc::clone(message))
        };
        Some(CarriedMessage(message?))
    }
}

/// Calls one of the operator's own handlers and returns its value. Counts and logs a panic, and a
/// handler that runs for long (D11).
fn handled<R>(
    counting: &Counting,
    handler: &'static str,
    timestamp: u64,
    call: impl FnOnce() -> R,
) -> Option<R> {
    let begin = Instant::now();
    let called = catch_unwind(AssertUnwindSafe(call));
    counting.check_handler_time(None, begin.elapsed());
    let logged = called.map_err(|panic| {
        error!(timestamp, handler, why = reason(&*panic), "a handler of the operator panicked");
        counting.handler_failed(None);
    });
    logged.ok()
}
