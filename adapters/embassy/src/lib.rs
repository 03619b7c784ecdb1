#![doc = include_str!("../README.md")]
#![no_std]

use core::future::pending;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::channel::Receiver;
use embassy_time::{Instant as Clock, TICK_HZ, Timer};
use fuseline_core::{
    Admission, At, Deadline, Firing, Fusion, Instant, Opening, Outcome, Priority, Ready, Timestamp,
};

/// What comes to the operator: an input without its instant, which is when it is received.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Arrival {
    /// F1: a message, and how long local may take for it.
    Message(Timestamp, Option<Deadline>),
    /// F2: may it be sent to this cloud, which may take this long and in whose queue this many others wait?
    Request(Timestamp, Priority, Deadline, u64),
    /// F3: a result of this source.
    Result(Timestamp, Priority),
    /// F4: no result will come from this source.
    Failure(Timestamp, Priority),
}

/// What an operator reports, in order: what it took in, then what fired, then what became of what it took in.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Report<const CLOUDS: usize> {
    /// It took this in; none if only time went by.
    Took(Option<Arrival>),
    /// Timers fired (F5).
    Fired(Firing<CLOUDS>),
    /// What became of a message (F1).
    Opened(Timestamp, Opening),
    /// What became of a request (F2). If it is admitted, send it.
    Offered(Timestamp, Priority, Admission),
    /// What became of a result or a failure (F3, F4).
    Concluded(Timestamp, Priority, Outcome<CLOUDS>),
}

/// Drives the machine for ever: takes what comes from `inbox`, ticks at each due instant, and reports everything to `report`
/// with the instant at which it was decided.
///
/// Instants are nanoseconds of embassy's clock. It may be dropped at any await: whatever was received is reported by then.
pub async fn operate<M: RawMutex, const LEN: usize, const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    inbox: Receiver<'_, M, Arrival, LEN>,
    mut report: impl FnMut(Instant, Report<CLOUDS>),
) -> ! {
    loop {
        let due = fusion.next_due();
        let wake = async {
            match due {
                Some(due) => Timer::at(at_least(due)).await,
                None => pending().await,
            }
        };
        let arrival = match select(inbox.receive(), wake).await {
            Either::First(arrival) => Some(arrival),
            Either::Second(()) => None,
        };
        let now = now();
        report(now, Report::Took(arrival));
        loop {
            match fusion.at(now) {
                At::Fired(firing) => report(now, Report::Fired(firing)),
                At::Ready(ready) => {
                    if let Some(arrival) = arrival {
                        report(now, apply(ready, arrival));
                    }
                    break;
                }
            }
        }
    }
}

fn apply<const CLOUDS: usize, const WINDOW: usize>(
    mut ready: Ready<'_, CLOUDS, WINDOW>,
    arrival: Arrival,
) -> Report<CLOUDS> {
    match arrival {
        Arrival::Message(t, deadline) => Report::Opened(t, ready.open(t, deadline)),
        Arrival::Request(t, p, deadline, backlog) => {
            Report::Offered(t, p, ready.offer(t, p, deadline, backlog))
        }
        Arrival::Result(t, p) => Report::Concluded(t, p, ready.result(t, p)),
        Arrival::Failure(t, p) => Report::Concluded(t, p, ready.fail(t, p)),
    }
}

/// embassy's clock.
fn now() -> Instant {
    let nanos = u128::from(Clock::now().as_ticks()) * 1_000_000_000 / u128::from(TICK_HZ);
    Instant::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
}

/// The first tick of embassy's clock that reads `due` or later.
fn at_least(due: Instant) -> Clock {
    let ticks = (u128::from(due.as_nanos()) * u128::from(TICK_HZ)).div_ceil(1_000_000_000);
    Clock::from_ticks(u64::try_from(ticks).unwrap_or(u64::MAX))
}
