//! Timers that wake the driver at a due instant.

#[cfg(target_os = "linux")]
mod kernel;

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use tokio::time::{Instant, Sleep, sleep_until};
#[cfg(target_os = "linux")]
use tracing::error;

/// The timers that wake an operator at a due instant (F5).
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Timers {
    /// tokio's timers. They go off at whole milliseconds of the runtime, on average half a
    /// millisecond late, and follow a paused clock.
    #[default]
    Tokio,
    /// The kernel's timers, a `timerfd` each. They go off as soon as the thread can run. Each costs
    /// a system call when it is set and when it goes off. Linux only, on a runtime with I/O
    /// enabled; a paused clock does not move them.
    Kernel,
}

/// One timer.
pub(super) enum Timer {
    Tokio(Pin<Box<Sleep>>),
    #[cfg(target_os = "linux")]
    Kernel(kernel::KernelTimer),
}

impl Timer {
    /// Creates a timer that is not set.
    ///
    /// # Errors
    /// Returns an error if the system has no such timer, or no more of them for this process.
    pub(super) fn new(timers: Timers) -> io::Result<Self> {
        match timers {
            Timers::Tokio => Ok(Self::Tokio(Box::pin(sleep_until(Instant::now())))),
            #[cfg(target_os = "linux")]
            Timers::Kernel => kernel::KernelTimer::new().map(Self::Kernel),
            #[cfg(not(target_os = "linux"))]
            Timers::Kernel => Err(io::Error::new(
                io::ErrorKind::Unsupported,
                "the kernel's timers exist only on Linux",
            )),
        }
    }

    /// Sets the timer to go off at `at`, and not before.
    pub(super) fn set(&mut self, at: Instant) {
        match self {
            Self::Tokio(sleep) => sleep.as_mut().reset(at),
            #[cfg(target_os = "linux")]
            Self::Kernel(timer) => {
                if let Err(error) = timer.set(at) {
                    self.fall_back(&error, at);
                }
            }
        }
    }

    /// Is ready when the timer has gone off, once for each time that it was set.
    pub(super) fn poll(&mut self, context: &mut Context<'_>) -> Poll<()> {
        match self {
            Self::Tokio(sleep) => sleep.as_mut().poll(context),
            #[cfg(target_os = "linux")]
            Self::Kernel(timer) => match timer.poll(context) {
                Poll::Ready(Err(error)) => {
                    // At worst nothing is due, and the driver goes on.
                    self.fall_back(&error, Instant::now());
                    Poll::Ready(())
                }
                polled => polled.map(|_| ()),
            },
        }
    }

    /// Goes on with tokio's timers, because a failed timer must not keep others from firing (P8).
    #[cfg(target_os = "linux")]
    fn fall_back(&mut self, error: &io::Error, at: Instant) {
        error!(%error, "the kernel's timer failed; tokio's timers are used from now on");
        *self = Self::Tokio(Box::pin(sleep_until(at)));
    }
}
