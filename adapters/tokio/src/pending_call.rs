//! A request to a cloud and the call that it becomes, in one allocation.

use std::pin::Pin;
use std::task::{Context, Poll};

use fuseline_engine::StampedValue;
use pin_project_lite::pin_project;

use crate::Error;
use crate::call::Call;

/// A request with its handle and its response handler. It becomes a call when it begins.
pub(crate) trait PendingCall<O>:
    Future<Output = Result<StampedValue<O>, Error>> + Send
{
    /// Makes the call, which runs when it is polled.
    fn begin(self: Pin<&mut Self>, call: Call);
}

/// See [`PendingCall`].
pub(crate) type BoxedRequest<O> = Pin<Box<dyn PendingCall<O>>>;

/// Returns the request that `make` turns into a call.
pub(crate) fn request<O, M, F>(make: M) -> BoxedRequest<O>
where
    M: FnOnce(Call) -> F + Send + 'static,
    F: Future<Output = Result<StampedValue<O>, Error>> + Send + 'static,
{
    Box::pin(PinnedRequest::Waiting { make: Some(make) })
}

pin_project! {
    #[project = PinnedRequestStage]
    enum PinnedRequest<M, F> {
        Waiting { make: Option<M> },
        Begun { #[pin] call: F },
    }
}

impl<O, M, F> PendingCall<O> for PinnedRequest<M, F>
where
    M: FnOnce(Call) -> F + Send,
    F: Future<Output = Result<StampedValue<O>, Error>> + Send,
{
    fn begin(mut self: Pin<&mut Self>, call: Call) {
        if let PinnedRequestStage::Waiting { make } = self.as_mut().project()
            && let Some(make) = make.take()
        {
            self.set(Self::Begun { call: make(call) });
        }
    }
}

impl<M, F: Future> Future for PinnedRequest<M, F> {
    type Output = F::Output;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<F::Output> {
        match self.project() {
            PinnedRequestStage::Begun { call } => call.poll(context),
            PinnedRequestStage::Waiting { .. } => Poll::Pending,
        }
    }
}
