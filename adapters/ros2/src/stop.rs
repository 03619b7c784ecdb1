//! SIGINT and SIGTERM: the first lets the node finish what is open, the second ends it.

use std::io;
use std::task::{Context, Poll};

use tokio::signal::unix::{Signal, SignalKind, signal};

/// How often the node was told to stop.
#[derive(Debug)]
pub struct Stop {
    signals: Option<[Signal; 2]>,
    times: u32,
}

impl Stop {
    /// From now on these signals no longer end the process but are counted.
    ///
    /// # Errors
    /// If the system refuses handlers.
    pub fn watch() -> io::Result<Self> {
        let signals = [signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?];
        Ok(Self { signals: Some(signals), times: 0 })
    }

    /// Never told.
    #[must_use]
    pub const fn never() -> Self {
        Self { signals: None, times: 0 }
    }

    /// Whether it was told at least once.
    pub(crate) const fn came(&self) -> bool {
        self.times > 0
    }

    /// Whether it was told more than once.
    #[must_use]
    pub const fn is_urgent(&self) -> bool {
        self.times > 1
    }

    /// Whether it was told again.
    pub(crate) fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let signals = self.signals.iter_mut().flatten();
        // Each is looked at, so that each will wake.
        let told = signals.filter_map(|signal| match signal.poll_recv(context) {
            Poll::Ready(told) => told,
            Poll::Pending => None,
        });
        let told = u32::try_from(told.count()).unwrap_or(u32::MAX);
        self.times += told;
        if told == 0 { Poll::Pending } else { Poll::Ready(()) }
    }
}
