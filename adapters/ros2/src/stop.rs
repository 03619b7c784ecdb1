//! SIGINT and SIGTERM: the first lets the node finish what is open, the second ends it.

use std::io;
use std::task::{Context, Poll};

use tokio::signal::unix::{Signal, SignalKind, signal};

/// How often a stop of the node was requested.
#[derive(Debug)]
pub struct Stop {
    signals: Option<[Signal; 2]>,
    times: u32,
}

impl Stop {
    /// From now on, counts these signals; they no longer end the process.
    ///
    /// # Errors
    /// If the system refuses a handler.
    pub fn watch() -> io::Result<Self> {
        let signals = [signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?];
        Ok(Self { signals: Some(signals), times: 0 })
    }

    /// Never requested.
    #[must_use]
    pub const fn never() -> Self {
        Self { signals: None, times: 0 }
    }

    /// Whether it was requested at least once.
    pub(crate) const fn is_requested(&self) -> bool {
        self.times > 0
    }

    /// Whether it was requested more than once.
    #[must_use]
    pub const fn is_urgent(&self) -> bool {
        self.times > 1
    }

    /// Waits until it is requested again.
    pub(crate) async fn requested(&mut self) {
        std::future::poll_fn(|context| self.poll_next(context)).await;
    }

    /// Ready when it is requested again.
    pub(crate) fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let signals = self.signals.iter_mut().flatten();
        // All are polled, so that each will wake.
        let reported = signals.filter_map(|signal| match signal.poll_recv(context) {
            Poll::Ready(reported) => reported,
            Poll::Pending => None,
        });
        let reported = u32::try_from(reported.count()).unwrap_or(u32::MAX);
        self.times += reported;
        if reported == 0 { Poll::Pending } else { Poll::Ready(()) }
    }
}
