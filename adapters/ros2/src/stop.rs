//! SIGINT, SIGTERM and SIGHUP. The first signal lets the node finish its open messages, and the
//! second ends it.

use std::io;
use std::task::{Context, Poll};

use tokio::signal::unix::{Signal, SignalKind, signal};

/// Counts how often a stop of the node was requested.
#[derive(Debug)]
pub struct Stop {
    signals: Vec<Signal>,
    times: u32,
}

impl Stop {
    /// Counts these signals from now on. They no longer end the process. A SIGHUP that is already
    /// ignored, as by `nohup`, stays ignored.
    ///
    /// # Errors
    /// Returns an error if the system refuses a handler.
    pub fn watch() -> io::Result<Self> {
        let mut kinds = vec![SignalKind::interrupt(), SignalKind::terminate()];
        if !is_ignored(SignalKind::hangup()) {
            kinds.push(SignalKind::hangup());
        }
        let signals = kinds.into_iter().map(signal).collect::<io::Result<_>>()?;
        Ok(Self { signals, times: 0 })
    }

    /// Creates a stop that was never requested.
    #[must_use]
    pub const fn never() -> Self {
        Self { signals: Vec::new(), times: 0 }
    }

    /// Returns `true` if a stop was requested at least once.
    pub(crate) const fn is_requested(&self) -> bool {
        self.times > 0
    }

    /// Returns `true` if a stop was requested more than once.
    #[must_use]
    pub const fn is_urgent(&self) -> bool {
        self.times > 1
    }

    /// Waits until the next request.
    pub(crate) async fn requested(&mut self) {
        std::future::poll_fn(|context| self.poll_next(context)).await;
    }

    /// Becomes ready with the next request.
    pub(crate) fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<()> {
        let signals = self.signals.iter_mut();
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

/// Returns `true` if the process was started with this signal ignored, as far as the system says.
fn is_ignored(kind: SignalKind) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (kind.as_raw_value() - 1) & 1 == 1)
}
