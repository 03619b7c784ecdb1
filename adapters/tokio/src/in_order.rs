//! Returns an operator's items in the order of their timestamps, for consumers that need it (E9).
//! Off by default (A12).

use std::ops::Range;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use fuseline_engine::{Item, Ordered, Reorderer};
use tokio::time::{Instant, Sleep, sleep_until};

use crate::stream::{Reader, StreamMessage};

/// A report about items that a reader in order passes over or drops.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum OutOfOrder {
    /// These timestamps had not ended when a later one was due. If they still have items, these
    /// will be late.
    PassedOver(Range<u64>),
    /// An item of this timestamp was dropped, because the timestamp had been passed over.
    Late(u64),
}

/// The state of a reader in order.
pub(crate) struct OrderedReading<T> {
    orderer: Reorderer<StreamMessage<T>>,
    /// A message's timestamp, and `true` for its last item.
    place: fn(&T) -> (u64, bool),
    report: Box<dyn FnMut(OutOfOrder) + Send + Sync>,
    timer: Pin<Box<Sleep>>,
    /// The number of items given so far.
    count: u64,
    has_ended: bool,
}

impl<O: Send + Sync + 'static> Reader<Item<O>> {
    /// Returns this reader with its items in the order of timestamps. An item waits for the items
    /// of earlier messages for at most `wait`, and no longer than until `reserve` is left of its
    /// [end-to-end deadline](crate::Lineage::within). At most 1,024 items wait. Then the missing
    /// timestamps are passed over. `report` gets each of them, and each later item of them, which
    /// is dropped.
    ///
    /// Call it in a tokio runtime, on an output that was not read before.
    #[must_use]
    pub fn in_order(
        mut self,
        wait: Duration,
        reserve: Duration,
        report: impl FnMut(OutOfOrder) + Send + Sync + 'static,
    ) -> Self {
        self.order = Some(Box::new(OrderedReading {
            orderer: Reorderer::new(wait, reserve),
            place: |item| (item.timestamp, item.is_last()),
            report: Box::new(report),
            timer: Box::pin(sleep_until(Instant::now())),
            count: 0,
            has_ended: false,
        }));
        self
    }
}

impl<T> OrderedReading<T> {
    /// Returns the next message in order. `read` returns the next one in order of arrival.
    pub(crate) fn poll(
        &mut self,
        context: &mut Context<'_>,
        mut read: impl FnMut(&mut Context<'_>) -> Poll<Option<StreamMessage<T>>>,
    ) -> Poll<Option<StreamMessage<T>>> {
        loop {
            while let Some(ready) = self.orderer.next_ready() {
                match ready {
                    Ordered::Item(message) => {
                        // The timestamps of a stream must ascend, so the messages are numbered
                        // again.
                        let timestamp = self.count;
                        self.count += 1;
                        return Poll::Ready(Some(StreamMessage { timestamp, ..message }));
                    }
                    Ordered::PassedOver(range) => (self.report)(OutOfOrder::PassedOver(range)),
                    Ordered::Late(late) => {
                        (self.report)(OutOfOrder::Late((self.place)(&late.message).0));
                    }
                }
            }
            if self.has_ended {
                return Poll::Ready(None);
            }
            match read(context) {
                Poll::Ready(Some(message)) => {
                    let now = now();
                    let due = message.lineage.as_ref().and_then(|lineage| lineage.due(now));
                    self.orderer.arrive(now, (self.place)(&message.message), due, message);
                }
                Poll::Ready(None) => {
                    self.has_ended = true;
                    self.orderer.end();
                }
                Poll::Pending => {
                    let Some(due) = self.orderer.next_due() else { return Poll::Pending };
                    self.timer.as_mut().reset(due.into());
                    ready!(self.timer.as_mut().poll(context));
                    self.orderer.tick(now());
                }
            }
        }
    }
}

fn now() -> std::time::Instant {
    Instant::now().into_std()
}
