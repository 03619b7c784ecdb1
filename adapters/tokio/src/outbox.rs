//! Hands the outputs of an operator or a join to their readers (D8 bounded).

use std::collections::VecDeque;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use fuseline_engine::{Item, Lineage};
use futures_util::FutureExt;
use futures_util::future::BoxFuture;

use crate::stream::{WriteError, Writer};

/// Gives items to the readers at once. An item waits here only while a reader lags.
pub(crate) struct Outbox<T> {
    writer: Writer<T>,
    /// Returns an item's lineage, which the next operator's message gets.
    lineage_of: fn(&T) -> Option<Arc<Lineage>>,
    /// The newest item of each message that was open when a reader began to lag.
    waiting: VecDeque<T>,
    /// Ready when every reader has room again.
    room: Option<BoxFuture<'static, ()>>,
}

impl<T: Send + Sync + 'static> Outbox<T> {
    pub(crate) const fn new(writer: Writer<T>, lineage_of: fn(&T) -> Option<Arc<Lineage>>) -> Self {
        Self { writer, lineage_of, waiting: VecDeque::new(), room: None }
    }

    /// Writes the message now, or once those before it were written (E1).
    pub(crate) fn push(&mut self, message: T) {
        if self.waiting.is_empty() {
            match self.write(message) {
                // The operator goes on without readers, because traces and counts do.
                Ok(_) | Err(WriteError::Closed(_)) => {}
                Err(WriteError::Full(message)) => self.waiting.push_back(message),
            }
        } else {
            self.waiting.push_back(message);
        }
    }

    /// Writes the waiting items while there is room.
    pub(crate) fn poll_delivered(&mut self, context: &mut Context<'_>) -> Poll<()> {
        while let Some(message) = self.waiting.pop_front() {
            match self.write(message) {
                Ok(_) | Err(WriteError::Closed(_)) => {}
                Err(WriteError::Full(message)) => {
                    self.waiting.push_front(message);
                    let room = self.room.get_or_insert_with(|| self.writer.room().boxed());
                    match Pin::new(room).poll(context) {
                        Poll::Ready(()) => self.room = None,
                        Poll::Pending => return Poll::Pending,
                    }
                }
            }
        }
        // The future may hold a permit, which would keep a place from the next item.
        self.room = None;
        Poll::Ready(())
    }

    pub(crate) fn is_delivered(&self) -> bool {
        self.waiting.is_empty()
    }

    fn write(&mut self, message: T) -> Result<u64, WriteError<T>> {
        let lineage = (self.lineage_of)(&message);
        self.writer.write_with(message, lineage)
    }
}

impl<O: Send + Sync + 'static> Outbox<Item<O>> {
    /// Writes the item. It replaces an earlier item of its message that still waits (F9).
    pub(crate) fn put(&mut self, item: Item<O>) {
        let is_same = |earlier: &Item<O>| earlier.timestamp == item.timestamp;
        let earlier = self.waiting.iter().position(is_same);
        let item = match earlier.and_then(|index| self.waiting.remove(index)) {
            Some(earlier) => item.instead_of(earlier),
            None => item,
        };
        self.push(item);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::stream;
    use fuseline_engine::{Ending, Forwarded, Source, Trigger};
    use std::time::Duration;

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
            substitute: None,
            carried: None,
        }
    }

    /// D1, D8, F9: what waits for room is the newest of each message.
    #[tokio::test]
    async fn a_better_item_takes_the_place_of_one_that_waits_and_the_last_one_has_its_value() {
        let (writer, mut reader) = stream(1);
        let mut outbox = Outbox::new(writer, |item: &Item<_>| item.lineage.clone());
        let source = |priority| Source { priority, name: "a source".into() };
        let of = |priority, value| Forwarded {
            value,
            source: source(priority),
            arrived: Duration::ZERO,
            trigger: Trigger::Arrival,
            of: None,
            meant_for: None,
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
        let mut outbox = Outbox::<Item<()>>::new(writer, |item| item.lineage.clone());
        (0..3).for_each(|t| outbox.put(item(t)));
        let mut context = Context::from_waker(std::task::Waker::noop());
        assert!(outbox.poll_delivered(&mut context).is_pending());
        assert!(reader.read().await.is_some() && reader.read().await.is_some());
        assert!(outbox.poll_delivered(&mut context).is_ready());
        outbox.put(item(3));
        assert!(outbox.waiting.is_empty(), "there was room for it");
    }
}
