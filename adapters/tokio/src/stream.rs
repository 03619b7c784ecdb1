//! Typed streams, which connect operators to one another and to the rest of a program (D8).
//!
//! [`Writer::write`] never waits for room, and each [`Reader`] may lag a fixed number of messages
//! behind.

use std::fmt;
use std::future::poll_fn;
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, Weak};
use std::task::{Context, Poll, ready};

use fuseline_engine::{Lineage, lock};
use futures_util::{Stream, StreamExt};
use thiserror::Error;
use tokio::sync::{Semaphore, mpsc};

use crate::in_order::OrderedReading;

/// Creates a stream of `T` with one writer. Each of its readers may lag `capacity` messages behind.
///
/// # Panics
/// Panics if `capacity` is 0, because no message could ever be written.
#[must_use]
pub fn stream<T>(capacity: usize) -> (Writer<T>, Reader<T>) {
    assert!(capacity > 0, "a stream needs room for at least 1 message");
    // A channel cannot hold more than this, and it makes no difference.
    let capacity = capacity.min(Semaphore::MAX_PERMITS);
    let (sender, receiver) = mpsc::channel(capacity);
    let joining =
        Arc::new(NewReaders { is_any: AtomicBool::new(false), readers: Mutex::default() });
    let (joining_reader, filter, order) = (Arc::downgrade(&joining), None, None);
    let reader = Reader { receiver, joining: joining_reader, capacity, filter, order };
    (Writer { readers: vec![sender], joining, count: 0 }, reader)
}

/// The writing end of a stream. Dropping it ends the stream.
///
/// A message's timestamp is its index in the stream, from 0. It is the same for all readers.
///
/// A message is [written](Self::write) at once or not at all. If a write could wait, a task could
/// deadlock: it would wait for an operator to accept a message, while the operator waits for the
/// task to read the full output. [`write_all`](Self::write_all) waits, but it takes the writer, so
/// it runs beside the task that reads.
#[derive(Debug)]
pub struct Writer<T> {
    readers: Vec<mpsc::Sender<StreamMessage<T>>>,
    joining: Arc<NewReaders<T>>,
    count: u64,
}

/// The reading end of a stream. Readers share the messages, without copies.
pub struct Reader<T> {
    receiver: mpsc::Receiver<StreamMessage<T>>,
    joining: Weak<NewReaders<T>>,
    capacity: usize,
    /// Filters the messages, if only some are wanted.
    pub(crate) filter: Option<Filter<T>>,
    /// Keeps messages until it is their turn, if order is wanted.
    pub(crate) order: Option<Box<OrderedReading<T>>>,
}

/// Keeps a message back, or returns a message for the reader.
pub(crate) type Filter<T> =
    Box<dyn FnMut(StreamMessage<T>) -> Option<StreamMessage<T>> + Send + Sync>;

/// A message on its way through a stream.
#[derive(Debug)]
pub(crate) struct StreamMessage<T> {
    pub(crate) timestamp: u64,
    pub(crate) message: Arc<T>,
    pub(crate) lineage: Option<Arc<Lineage>>,
}

impl<T> Clone for StreamMessage<T> {
    fn clone(&self) -> Self {
        let Self { timestamp, message, lineage } = self;
        Self { timestamp: *timestamp, message: Arc::clone(message), lineage: lineage.clone() }
    }
}

/// The readers that were made since the last message.
#[derive(Debug)]
struct NewReaders<T> {
    /// `true` if there are any. It is checked with each message, without the lock.
    is_any: AtomicBool,
    readers: Mutex<Vec<mpsc::Sender<StreamMessage<T>>>>,
}

impl<T> NewReaders<T> {
    fn lock(&self) -> MutexGuard<'_, Vec<mpsc::Sender<StreamMessage<T>>>> {
        lock(&self.readers)
    }
}

/// The reason why a message was not written, with the message.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Error)]
pub enum WriteError<T> {
    /// Some reader lags behind by its whole capacity.
    #[error("a reader of the stream lags behind")]
    Full(T),
    /// No reader is left.
    #[error("the stream has no reader left")]
    Closed(T),
}

impl<T> Writer<T> {
    /// Writes a message if every reader has room for it now. Returns its timestamp.
    ///
    /// # Errors
    /// Returns the message if some reader has no room, or if there is no reader.
    pub fn write(&mut self, message: T) -> Result<u64, WriteError<T>> {
        self.write_with(message, None)
    }

    /// Writes a message with its lineage: a [`Lineage`], or the lineage of an
    /// [item](crate::Item::lineage). The operator that reads the message passes the lineage on with
    /// its items.
    ///
    /// # Errors
    /// Returns the errors of [`write`](Self::write).
    pub fn write_with(
        &mut self,
        message: T,
        lineage: impl Into<Option<Arc<Lineage>>>,
    ) -> Result<u64, WriteError<T>> {
        self.admit();
        let Some((last, others)) = self.readers.split_last() else {
            return Err(WriteError::Closed(message));
        };
        if !self.has_room() {
            return Err(WriteError::Full(message));
        }
        let (timestamp, message, lineage) = (self.count, Arc::new(message), lineage.into());
        let message = StreamMessage { timestamp, message, lineage };
        self.count += 1;
        // Each reader has room, because nobody else writes. A reader that has closed since loses
        // nothing.
        for reader in others {
            drop(reader.try_send(message.clone()));
        }
        drop(last.try_send(message));
        Ok(timestamp)
    }

    /// Writes each message as soon as every reader has room for it, then ends the stream. Returns
    /// the number of messages that the stream has had.
    ///
    /// Run it in a task of its own, or join it with the reader:
    ///
    /// ```
    /// # use fuseline_tokio::stream;
    /// # #[tokio::main(flavor = "current_thread")] async fn main() {
    /// let (writer, mut reader) = stream(1);
    /// let writing = tokio::spawn(writer.write_all(futures_util::stream::iter(["a", "b", "c"])));
    /// while let Some(message) = reader.read().await {
    ///     println!("{message}");
    /// }
    /// assert_eq!(writing.await.unwrap(), Ok(3));
    /// # }
    /// ```
    ///
    /// # Errors
    /// Returns only [`WriteError::Closed`].
    pub async fn write_all(self, messages: impl Stream<Item = T>) -> Result<u64, WriteError<T>> {
        self.write_all_with(messages.map(|message| (message, None))).await
    }

    /// Writes each message with its lineage, as [`write_all`](Self::write_all) does.
    ///
    /// # Errors
    /// Returns the errors of [`write_all`](Self::write_all).
    pub async fn write_all_with<L: Into<Option<Arc<Lineage>>>>(
        mut self,
        messages: impl Stream<Item = (T, L)>,
    ) -> Result<u64, WriteError<T>> {
        let mut messages = pin!(messages);
        while let Some((message, lineage)) = messages.next().await {
            self.room().await;
            self.write_with(message, lineage)?;
        }
        Ok(self.count)
    }

    /// Waits until every reader has room for a message.
    pub(crate) fn room(&mut self) -> impl Future<Output = ()> + use<T> {
        self.admit();
        let readers = self.readers.clone();
        async move {
            for reader in readers {
                if reader.capacity() == 0 {
                    drop(reader.reserve().await);
                }
            }
        }
    }

    /// Removes readers that closed and adds those that joined.
    fn admit(&mut self) {
        self.readers.retain(|reader| !reader.is_closed());
        // Usually no reader has joined, and a load does not take the cache line from the threads
        // that share it.
        if self.joining.is_any.load(Ordering::Acquire) {
            self.joining.is_any.store(false, Ordering::Relaxed);
            self.readers.append(&mut self.joining.lock());
        }
    }

    fn has_room(&self) -> bool {
        self.readers.iter().all(|reader| reader.capacity() > 0)
    }
}

impl<T> Reader<T> {
    /// Returns the next message, or `None` when the stream has ended. Dropping the future loses no
    /// message.
    pub async fn read(&mut self) -> Option<Arc<T>> {
        poll_fn(|context| self.poll_numbered(context)).await.map(|it| it.message)
    }

    /// Returns another reader of the stream, for all messages written from now on.
    #[must_use]
    pub fn new_reader(&self) -> Self {
        let (sender, receiver) = mpsc::channel(self.capacity);
        if let Some(joining) = self.joining.upgrade() {
            joining.lock().push(sender);
            joining.is_any.store(true, Ordering::Release);
        }
        let joining = Weak::clone(&self.joining);
        Self { receiver, joining, capacity: self.capacity, filter: None, order: None }
    }

    /// Returns the next message with its timestamp and lineage.
    pub(crate) fn poll_numbered(
        &mut self,
        context: &mut Context<'_>,
    ) -> Poll<Option<StreamMessage<T>>> {
        let Some(mut order) = self.order.take() else { return self.poll_filtered(context) };
        let polled = order.poll(context, |context| self.poll_filtered(context));
        self.order = Some(order);
        polled
    }

    fn poll_filtered(&mut self, context: &mut Context<'_>) -> Poll<Option<StreamMessage<T>>> {
        loop {
            let message = ready!(self.receiver.poll_recv(context));
            let message = match (&mut self.filter, message) {
                (Some(filter), Some(message)) => filter(message),
                (_, message) => return Poll::Ready(message),
            };
            if message.is_some() {
                return Poll::Ready(message);
            }
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for Reader<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reader").field("receiver", &self.receiver).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn received(reader: &mut Reader<char>) -> Option<(u64, char)> {
        let StreamMessage { timestamp, message, .. } = reader.receiver.recv().await?;
        Some((timestamp, *message))
    }

    #[tokio::test]
    async fn every_reader_gets_every_message_in_order() {
        let (mut writer, mut one) = stream(2);
        let mut other = one.new_reader();
        assert_eq!(writer.write('a'), Ok(0));
        assert_eq!(writer.write('b'), Ok(1));
        drop(writer);
        for reader in [&mut one, &mut other] {
            assert_eq!(received(reader).await, Some((0, 'a')));
            assert_eq!(received(reader).await, Some((1, 'b')));
            assert_eq!(received(reader).await, None);
        }
    }

    #[tokio::test]
    async fn a_late_reader_sees_the_same_timestamps() {
        let (mut writer, one) = stream(2);
        assert_eq!(writer.write('a'), Ok(0));
        let mut late = one.new_reader();
        assert_eq!(writer.write('b'), Ok(1));
        assert_eq!(received(&mut late).await, Some((1, 'b')));
    }

    #[tokio::test]
    async fn the_slowest_reader_holds_the_writer_back_and_loses_nothing() {
        let (mut writer, mut one) = stream(1);
        let mut slow = one.new_reader();
        assert_eq!(writer.write(1), Ok(0));
        assert_eq!(one.read().await.as_deref(), Some(&1));
        assert_eq!(writer.write(2), Err(WriteError::Full(2)));
        assert_eq!(slow.read().await.as_deref(), Some(&1));
        assert_eq!(writer.write(2), Ok(1));
    }

    #[tokio::test]
    async fn a_dropped_reader_holds_nobody_back() {
        let (mut writer, one) = stream(1);
        let mut other = one.new_reader();
        assert_eq!(writer.write(1), Ok(0));
        drop(one);
        assert_eq!(other.read().await.as_deref(), Some(&1));
        assert_eq!(writer.write(2), Ok(1));
        drop(other);
        assert_eq!(writer.write(3), Err(WriteError::Closed(3)));
    }

    #[tokio::test]
    async fn all_are_written_as_readers_make_room() {
        let (writer, mut reader) = stream(1);
        let reading = async {
            let mut read = Vec::new();
            while let Some(message) = reader.read().await {
                read.push(*message);
            }
            read
        };
        let messages = futures_util::stream::iter(0..5);
        let (written, read) = tokio::join!(writer.write_all(messages), reading);
        assert_eq!((written, read), (Ok(5), vec![0, 1, 2, 3, 4]));
    }

    #[tokio::test]
    async fn all_are_written_with_their_lineages() {
        let (writer, mut reader) = stream(9);
        let now = std::time::Instant::now();
        let messages = (0..3).map(|seq| (seq, Lineage::new("camera", 40 + seq, now)));
        let written = writer.write_all_with(futures_util::stream::iter(messages)).await;
        assert_eq!(written, Ok(3));
        while let Some(StreamMessage { message, lineage, .. }) = reader.receiver.recv().await {
            let seq = lineage.and_then(|it| it.origin.clone()?.seq);
            assert_eq!(seq, Some(40 + *message));
        }
    }

    #[tokio::test]
    async fn all_are_not_written_when_nobody_reads() {
        let (writer, reader) = stream(2);
        drop(reader);
        let messages = futures_util::stream::iter([7, 8]);
        assert_eq!(writer.write_all(messages).await, Err(WriteError::Closed(7)));
    }

    #[test]
    #[should_panic(expected = "room for at least 1 message")]
    fn a_stream_without_room_is_refused() {
        drop(stream::<u8>(0));
    }

    #[test]
    fn a_stream_of_any_length_can_be_made() {
        let (mut writer, _reader) = stream(usize::MAX);
        assert_eq!(writer.write(1), Ok(0));
    }

    #[test]
    fn a_reader_made_after_the_end_is_at_the_end() {
        let (writer, one) = stream::<u8>(1);
        drop(writer);
        let mut late = one.new_reader();
        assert_eq!(late.receiver.try_recv().unwrap_err(), mpsc::error::TryRecvError::Disconnected);
    }
}
