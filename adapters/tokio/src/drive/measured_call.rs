//! Times each poll of a call, because a call that runs without a pause holds up its thread.

use std::pin::Pin;
use std::task::{Context, Poll};

use fuseline_engine::{Counting, StampedValue};
use futures_util::future::BoxFuture;
use tokio::time::Instant;

use crate::Error;

/// A source's call or computation.
pub(super) struct MeasuredCall<V> {
    pub(super) priority: u16,
    pub(super) call: BoxFuture<'static, Result<StampedValue<V>, Error>>,
    pub(super) counting: Counting,
}

impl<V> Future for MeasuredCall<V> {
    type Output = Result<StampedValue<V>, Error>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let begin = Instant::now();
        let polled = self.call.as_mut().poll(context);
        self.counting.check_handler_time(Some(self.priority), begin.elapsed());
        polled
    }
}
