//! The node's services: requests, each with where its answer goes.

use tokio::sync::mpsc;

/// A request that waits for its answer.
pub(crate) struct PendingRequest<Q, R> {
    pub(crate) request: Q,
    pub(crate) reply: ServiceReply<R>,
}

/// The sender of an answer. If it is dropped, the client gets no answer.
pub(crate) struct ServiceReply<R>(Box<dyn FnOnce(R) + Send>);

/// The requests of one service, in the order in which they came.
pub(crate) type Requests<Q, R> = mpsc::Receiver<PendingRequest<Q, R>>;

/// The number of requests of a service that may wait; others wait in the middleware.
pub(crate) const WAITING: usize = 4;

impl<R> ServiceReply<R> {
    pub(crate) fn new(send: impl FnOnce(R) + Send + 'static) -> Self {
        Self(Box::new(send))
    }

    pub(crate) fn send(self, answer: R) {
        (self.0)(answer);
    }
}

impl<Q, R> PendingRequest<Q, R> {
    pub(crate) fn answer(self, answer: impl FnOnce(Q) -> R) {
        self.reply.send(answer(self.request));
    }
}
