//! An operator on streams: its [`Transport`] reads the input, makes the requests and writes the items.
//!
//! While a reader lags it takes in no new message; what is open goes on (D8).

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_engine::{Counting, Hint, Item, Lineage, Offer, Situation};
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use tokio::sync::oneshot;
use tokio::time::Instant;
use tracing::error;

use crate::call::Call;
use crate::drive::{Incoming, Sent, Start, Transport};
use crate::panics::reason;
use crate::setup::{BoxedRequest, HintHandler, Registered, SituationSource};
use crate::side::SideRunner;
use crate::stream::{Reader, StreamMessage, WriteError, Writer};
use crate::workers::Workers;

/// What an operator reads, requests and writes.
pub(crate) struct Streams<I, O> {
    pub(crate) input: Reader<I>,
    pub(crate) clouds: Vec<Registered<I, O>>,
    pub(crate) situation: Option<SituationSource<I>>,
    pub(crate) sides: Vec<SideRunner<I>>,
    pub(crate) hints: Option<HintHandler<O>>,
    pub(crate) workers: Workers<I, O>,
    /// Local's deadline.
    pub(crate) deadline: Option<Duration>,
    pub(crate) output: Outbox<O>,
    pub(crate) counting: Counting,
    /// None once nobody can stop the operator any more.
    pub(crate) stop: Option<oneshot::Receiver<()>>,
    pub(crate) is_open: bool,
}

/// What is sent to a source.
pub(crate) enum Work<I, O> {
    Local(Arc<I>),
    Call(BoxedRequest<O>, Option<Arc<Lineage>>),
}

/// The output: items are given to the readers at once, and wait here only while one lags.
pub(crate) struct Outbox<O> {
    writer: Writer<Item<O>>,
    /// At most one for each message that was open when the reader began to lag: the newest.
    waiting: VecDeque<Item<O>>,
    /// Ready when every reader has room again.
    room: Option<BoxFuture<'static, ()>>,
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
                // D1 one item: what was decided is written, as far as readers have room.
                let _ = self.output.poll_delivered(context);
                return Poll::Ready(Incoming::Stop);
            }
        }
        if let Poll::Ready(completion) = self.workers.poll_completion(context) {
            return Poll::Ready(Incoming::Completion(completion));
        }
        // A reader that lags holds back new messages, and nothing else.
        let was_waiting = !self.is_delivered();
        if self.output.poll_delivered(context).is_pending() {
            return Poll::Pending;
        }
        if !self.is_open {
            // The driver ends only once it knows that what waited has been delivered.
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
        (Work::Local(Arc::clone(&message.message)), self.deadline)
    }

    fn offers(
        &mut self,
        timestamp: u64,
        message: &StreamMessage<I>,
    ) -> impl Iterator<Item = Offer<Work<I, O>>> {
        let Self { clouds, counting, .. } = self;
        clouds.iter_mut().filter_map(move |cloud| {
            let (request, deadline) = cloud.request(&message.message, timestamp, counting)?;
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
        let begin = Instant::now();
        let assessed = catch_unwind(AssertUnwindSafe(|| assess(&message.message, timestamp)));
        self.counting.ran(None, begin.elapsed());
        Some(assessed.unwrap_or_else(|panic| {
            let why = reason(&*panic);
            error!(timestamp, why, "the handler of situations panicked: the situation is unknown");
            self.counting.handler_failed(None);
            Situation::UNKNOWN
        }))
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
        let begin = Instant::now();
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| take_hint(hint))) {
            error!(timestamp, why = reason(&*panic), "the handler of hints panicked");
            self.counting.handler_failed(None);
        }
        self.counting.ran(None, begin.elapsed());
    }

    fn send(&mut self, start: Start<Work<I, O>>) -> Sent<O> {
        let Start { priority, timestamp, left, request } = start;
        match request {
            Work::Local(message) => self.workers.compute(message, timestamp),
            Work::Call(request, lineage) => {
                let call = Call::new(timestamp, left, priority, self.counting.clone());
                Sent::Call(request(call.with_lineage(lineage)))
            }
        }
    }

    fn replace(&mut self, timestamp: u64) {
        self.workers.replace(timestamp);
    }

    fn output(&mut self, item: Item<O>) {
        self.output.put(item);
    }

    fn is_delivered(&self) -> bool {
        self.output.waiting.is_empty()
    }
}

impl<O: Send + Sync + 'static> Outbox<O> {
    pub(crate) const fn new(writer: Writer<Item<O>>) -> Self {
        Self { writer, waiting: VecDeque::new(), room: None }
    }

    fn put(&mut self, item: Item<O>) {
        if self.waiting.is_empty() {
            // The next operator's message comes from what this one's did.
            let lineage = item.lineage.clone();
            match self.writer.write_with(item, lineage) {
                // An output that nobody reads is no reason to end: traces and counts go on.
                Ok(_) | Err(WriteError::Closed(_)) => {}
                Err(WriteError::Full(item)) => self.waiting.push_back(item),
            }
        } else {
            let is_same = |earlier: &Item<O>| earlier.timestamp == item.timestamp;
            let earlier = self.waiting.iter().position(is_same);
            let item = match earlier.and_then(|index| self.waiting.remove(index)) {
                // F9: nobody was given it, and nobody needs it any more.
                Some(earlier) => item.instead_of(earlier),
                None => item,
            };
            self.waiting.push_back(item);
        }
    }

    /// Hands on the items that wait while there is room.
    fn poll_delivered(&mut self, context: &mut Context<'_>) -> Poll<()> {
        while let Some(item) = self.waiting.pop_front() {
            let lineage = item.lineage.clone();
            match self.writer.write_with(item, lineage) {
                Ok(_) | Err(WriteError::Closed(_)) => {}
                Err(WriteError::Full(item)) => {
                    self.waiting.push_front(item);
                    let room = self.room.get_or_insert_with(|| self.writer.room().boxed());
                    match Pin::new(room).poll(context) {
                        Poll::Ready(()) => self.room = None,
                        Poll::Pending => return Poll::Pending,
                    }
                }
            }
        }
        // Else it would hold a permit that was reserved for it.
        self.room = None;
        Poll::Ready(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::stream;
    use fuseline_engine::{Ending, Forwarded, Source, Trigger};

    fn item<O>(timestamp: u64) -> Item<O> {
        Item {
            timestamp,
            opened: Duration::ZERO,
            decided: Duration::ZERO,
            revision: 0,
            ending: Ending::Missed,
            failures: Vec::new(),
            lineage: None,
            age: None,
        }
    }

    /// D1, D8, F9: what waits for room is the newest of each message.
    #[tokio::test]
    async fn a_better_item_takes_the_place_of_one_that_waits_and_the_last_one_has_its_value() {
        let (writer, mut reader) = stream(1);
        let mut outbox = Outbox::new(writer);
        let source = |priority| Source { priority, name: "a source".into() };
        let of = |priority, value| Forwarded {
            value,
            source: source(priority),
            arrived: Duration::ZERO,
            trigger: Trigger::Arrival,
            of: None,
        };
        let endings = [
            (0, Ending::Preliminary(of(0, "local's of 0"))),
            (1, Ending::Preliminary(of(0, "local's of 1"))),
            (0, Ending::Preliminary(of(1, "west's of 0"))),
            (1, Ending::Preliminary(of(2, "east's of 1"))),
            (1, Ending::Final(source(2))),
            (0, Ending::Forwarded(of(2, "east's of 0"))),
        ];
        for (t, ending) in endings {
            outbox.put(Item { ending, ..item(t) });
        }
        assert_eq!(outbox.waiting.len(), 2);
        let mut context = Context::from_waker(std::task::Waker::noop());
        let mut read = Vec::new();
        while let Some(item) = reader.read().now_or_never() {
            let item = item.unwrap();
            let value = item.forwarded().map(|it| it.value).unwrap();
            read.push((item.timestamp, value, item.is_last()));
            let _ = outbox.poll_delivered(&mut context);
        }
        let expected =
            [(0, "local's of 0", false), (1, "east's of 1", true), (0, "east's of 0", true)];
        assert_eq!(read, expected);
    }

    /// D8: found by the simulator.
    #[tokio::test]
    async fn an_outbox_that_was_emptied_keeps_no_place_from_the_next_items() {
        let (writer, mut reader) = stream(2);
        let mut outbox = Outbox::<()>::new(writer);
        (0..3).for_each(|t| outbox.put(item(t)));
        let mut context = Context::from_waker(std::task::Waker::noop());
        assert!(outbox.poll_delivered(&mut context).is_pending());
        assert!(reader.read().await.is_some() && reader.read().await.is_some());
        assert!(outbox.poll_delivered(&mut context).is_ready());
        outbox.put(item(3));
        assert!(outbox.waiting.is_empty(), "there was room for it");
    }
}
