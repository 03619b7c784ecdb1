//! Counts the bytes of request and reply bodies, which bounds the server's memory and shows when a
//! client stalls.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use http_body::Frame;
use hyper::body::Incoming;
use tokio::time::{Sleep, sleep};
use tonic::Status;
use tonic::body::Body;

use crate::grpc::server::connection_watch::ConnectionWatch;

/// The size of the pieces of a reply, in bytes. Pieces show whether a reader is slow or has
/// stalled.
const PIECE: usize = 64 * 1024;

/// The number of bytes that one call's request takes. They are given back when its body and its
/// handler are dropped.
pub(crate) struct RequestMemory {
    watch: Arc<ConnectionWatch>,
    bytes: AtomicUsize,
}

impl RequestMemory {
    pub(crate) fn new(watch: Arc<ConnectionWatch>) -> Arc<Self> {
        Arc::new(Self { watch, bytes: AtomicUsize::new(0) })
    }

    fn take(&self, bytes: usize) -> Result<(), Status> {
        if !self.watch.limits.take(bytes) {
            let why = "the server holds as many bytes as its limit allows; try again later";
            return Err(self.watch.refused(Status::resource_exhausted(why)));
        }
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        Ok(())
    }
}

impl Drop for RequestMemory {
    fn drop(&mut self) {
        self.watch.limits.give_back(self.bytes.load(Ordering::Relaxed));
    }
}

/// A request's body, all of which must arrive in time.
pub(crate) struct RequestBody {
    body: Incoming,
    held: Arc<RequestMemory>,
    in_time: Pin<Box<Sleep>>,
}

impl RequestBody {
    pub(crate) fn new(body: Incoming, held: Arc<RequestMemory>) -> Self {
        let in_time = Box::pin(sleep(held.watch.limits.bounds.stall));
        Self { body, held, in_time }
    }
}

impl http_body::Body for RequestBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let Poll::Ready(frame) = Pin::new(&mut self.body).poll_frame(cx) else {
            ready!(self.in_time.as_mut().poll(cx));
            let late = Status::deadline_exceeded("the request did not arrive completely in time");
            return Poll::Ready(Some(Err(self.held.watch.refused(late))));
        };
        let frame = frame.map(|frame| {
            let frame = frame.map_err(|error| {
                self.held.watch.taken_back();
                Status::from_error(error.into())
            })?;
            self.held.take(frame.data_ref().map_or(0, Bytes::len))?;
            Ok(frame)
        });
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }
}

/// A reply's body, which is sent in pieces.
pub(crate) struct ReplyBody {
    body: Body,
    watch: Arc<ConnectionWatch>,
    rest: UnsentBytes,
}

impl ReplyBody {
    pub(crate) fn new(body: Body, watch: Arc<ConnectionWatch>) -> Self {
        let rest = UnsentBytes { bytes: Bytes::new(), reply: 0, watch: Arc::clone(&watch) };
        Self { body, watch, rest }
    }
}

impl http_body::Body for ReplyBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        if self.rest.bytes.is_empty() {
            let frame = match ready!(Pin::new(&mut self.body).poll_frame(cx)) {
                Some(Ok(frame)) => frame,
                end => return Poll::Ready(end),
            };
            match frame.into_data() {
                Ok(bytes) => self.rest = UnsentBytes::new(bytes, &self.watch)?,
                Err(trailers) => return Poll::Ready(Some(Ok(trailers))),
            }
        }
        let piece = self.rest.split();
        Poll::Ready(Some(Ok(Frame::data(Bytes::from_owner(piece)))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.bytes.is_empty() && self.body.is_end_stream()
    }
}

/// Bytes of a reply that the client has not taken yet.
struct UnsentBytes {
    bytes: Bytes,
    /// The reply's number in the watch.
    reply: u64,
    watch: Arc<ConnectionWatch>,
}

impl UnsentBytes {
    fn new(bytes: Bytes, watch: &Arc<ConnectionWatch>) -> Result<Self, Status> {
        if !watch.limits.take(bytes.len()) {
            let why = "the server holds as many bytes as its limit allows; try again later";
            return Err(watch.refused(Status::resource_exhausted(why)));
        }
        let reply = watch.reply_ready(bytes.len());
        Ok(Self { bytes, reply, watch: Arc::clone(watch) })
    }

    fn split(&mut self) -> Self {
        let bytes = self.bytes.split_to(self.bytes.len().min(PIECE));
        Self { bytes, reply: self.reply, watch: Arc::clone(&self.watch) }
    }
}

impl AsRef<[u8]> for UnsentBytes {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for UnsentBytes {
    fn drop(&mut self) {
        self.watch.limits.give_back(self.bytes.len());
        self.watch.paid(self.reply, self.bytes.len());
    }
}
