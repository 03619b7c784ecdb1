//! SIGINT, SIGTERM and SIGHUP. The first signal lets the node finish its open messages, and the
//! second ends it.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use futures_util::StreamExt;
use futures_util::stream::{SelectAll, Stream};
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Counts how often a stop of the node was requested.
#[derive(Debug)]
pub struct Stop {
    /// The main loop asks before each event, so only signals that were woken are polled.
    signals: SelectAll<SignalStream>,
    times: u32,
}

/// A signal as a stream.
#[derive(Debug)]
struct SignalStream(Signal);

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
        let signals = kinds.into_iter().map(|kind| Ok(SignalStream(signal(kind)?)));
        let signals = signals.collect::<io::Result<_>>()?;
        Ok(Self { signals, times: 0 })
    }

    /// Creates a stop that was never requested.
    #[must_use]
    pub fn never() -> Self {
        Self { signals: SelectAll::new(), times: 0 }
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
        let mut reported = 0;
        while let Poll::Ready(Some(())) = self.signals.poll_next_unpin(context) {
            reported += 1;
        }
        self.times += reported;
        if reported == 0 { Poll::Pending } else { Poll::Ready(()) }
    }
}

impl Stream for SignalStream {
    type Item = ();

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<()>> {
        self.0.poll_recv(context)
    }
}

/// Returns `true` if the process was started with this signal ignored, as far as the system says.
fn is_ignored(kind: SignalKind) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (kind.as_raw_value() - 1) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use rustix::process::{Signal, getpid, kill_process};

    use super::*;

    #[tokio::test]
    async fn second_signal_of_any_kind_is_urgent() {
        let mut stop = Stop::watch().unwrap();
        for (signal, is_urgent) in [(Signal::TERM, false), (Signal::INT, true)] {
            assert!(futures_util::poll!(std::pin::pin!(stop.requested())).is_pending());
            kill_process(getpid(), signal).unwrap();
            stop.requested().await;
            assert_eq!((stop.is_requested(), stop.is_urgent()), (true, is_urgent));
        }
    }
}
