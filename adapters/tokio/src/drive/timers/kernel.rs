//! A `timerfd`.

use std::io;
use std::os::fd::OwnedFd;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use rustix::io::read;
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::time::Instant;

/// A zero time disarms the timer. As an interval, it means that the timer does not repeat.
const NEVER: Timespec = Timespec { tv_sec: 0, tv_nsec: 0 };
/// The shortest time that does not disarm it.
const SHORTEST: Duration = Duration::from_nanos(1);

pub(in crate::drive) struct KernelTimer(AsyncFd<OwnedFd>);

impl KernelTimer {
    #[expect(
        deprecated,
        reason = "sound for what owns its descriptor; the new name is unsafe, for what does not"
    )]
    pub(super) fn new() -> io::Result<Self> {
        let flags = TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC;
        let timer = timerfd_create(TimerfdClockId::Monotonic, flags)?;
        AsyncFd::with_interest(timer, Interest::READABLE).map(Self)
    }

    pub(super) fn set(&self, at: Instant) -> io::Result<()> {
        let remaining = at.saturating_duration_since(Instant::now()).max(SHORTEST);
        let remaining = Timespec {
            tv_sec: remaining.as_secs().try_into().unwrap_or(i64::MAX),
            tv_nsec: remaining.subsec_nanos().into(),
        };
        let once = Itimerspec { it_interval: NEVER, it_value: remaining };
        timerfd_settime(self.0.get_ref(), TimerfdTimerFlags::empty(), &once)?;
        Ok(())
    }

    pub(super) fn poll(&self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        loop {
            let mut guard = ready!(self.0.poll_read_ready(context))?;
            // The number of times that it went off, which is 1.
            let read = guard.try_io(|timer| Ok(read(timer.get_ref(), &mut [0_u8; 8])?));
            if let Ok(read) = read {
                return Poll::Ready(read.map(|_| ()));
            }
        }
    }
}
