#![doc = include_str!("../README.md")]
#![no_std]

use core::future::pending;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::channel::Receiver;
use embassy_time::{Instant as Clock, TICK_HZ, Timer};
use fuseline_core::{
    Admission, At, Deadline, Firing, Fusion, Held, Instant, Opening, Outcome, Priority, Ready,
    Timestamp,
};

/// An input to the operator. It has no instant, because its instant is when the operator receives
/// it. `V` is the type of a result's value.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Arrival<V = ()> {
    /// A message, and how long local may take for it (F1).
    Message(Timestamp, Option<Deadline>),
    /// An offer of a message to a cloud, with the deadline and the length of the cloud's queue
    /// (F2).
    Request(Timestamp, Priority, Deadline, u64),
    /// A result of this source, with its value (F3).
    Result(Timestamp, Priority, V),
    /// A failure: no result will come from this source (F4).
    Failure(Timestamp, Priority),
}

impl<V> Arrival<V> {
    const fn without_value(&self) -> Arrival {
        match *self {
            Self::Message(t, deadline) => Arrival::Message(t, deadline),
            Self::Request(t, p, deadline, backlog) => Arrival::Request(t, p, deadline, backlog),
            Self::Result(t, p, _) => Arrival::Result(t, p, ()),
            Self::Failure(t, p) => Arrival::Failure(t, p),
        }
    }
}

/// A report of the operator. For each input, the operator reports the input first, then each
/// firing, then the outcome of the input.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Report<V, const CLOUDS: usize> {
    /// The operator received this input, or `None` if only a timer was due.
    Took(Option<Arrival>),
    /// Timers fired (F5). The value is there if the firing forwards a result and it is to be sent.
    /// Under progressive, a firing never has one.
    Fired(Firing<CLOUDS>, Option<V>),
    /// A message was accepted or refused (F1).
    Opened(Timestamp, Opening),
    /// A request was admitted or refused (F2). If it is admitted, send it.
    Offered(Timestamp, Priority, Admission),
    /// The outcome of a result or a failure (F3, F4), with the value to send if a result is
    /// forwarded. Under progressive, better results may follow (F9).
    Concluded(Timestamp, Priority, Outcome<CLOUDS>, Option<V>),
}

/// Drives the machine forever: takes inputs from `inbox`, ticks at each due instant, and reports
/// everything to `report` with the instant at which it was decided. `held` stores the values of the
/// machine's held results and starts empty.
///
/// Instants are nanoseconds of embassy's clock. The future may be dropped at any await: everything
/// that it received is reported by then. The next call with the same `fusion` and `held` continues
/// from there.
pub async fn operate<V, M: RawMutex, const LEN: usize, const CLOUDS: usize, const WINDOW: usize>(
    fusion: &mut Fusion<CLOUDS, WINDOW>,
    held: &mut Held<V, WINDOW>,
    inbox: Receiver<'_, M, Arrival<V>, LEN>,
    mut report: impl FnMut(Instant, Report<V, CLOUDS>),
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
        report(now, Report::Took(arrival.as_ref().map(Arrival::without_value)));
        let ready = loop {
            match fusion.at(now) {
                At::Fired(firing) => report(now, Report::Fired(firing, held.firing(&firing))),
                At::Ready(ready) => break ready,
            }
        };
        if let Some(arrival) = arrival {
            report(now, apply(ready, held, arrival));
        }
    }
}

fn apply<V, const CLOUDS: usize, const WINDOW: usize>(
    mut ready: Ready<'_, CLOUDS, WINDOW>,
    held: &mut Held<V, WINDOW>,
    arrival: Arrival<V>,
) -> Report<V, CLOUDS> {
    match arrival {
        Arrival::Message(t, deadline) => Report::Opened(t, ready.open(t, deadline)),
        Arrival::Request(t, p, deadline, backlog) => {
            Report::Offered(t, p, ready.offer(t, p, deadline, backlog))
        }
        Arrival::Result(t, p, value) => {
            let outcome = ready.result(t, p);
            Report::Concluded(t, p, outcome, held.result(t, p, value, &outcome))
        }
        Arrival::Failure(t, p) => {
            let outcome = ready.fail(t, p);
            Report::Concluded(t, p, outcome, held.failure(t, &outcome))
        }
    }
}

/// Reads embassy's clock.
fn now() -> Instant {
    let nanos = u128::from(Clock::now().as_ticks()) * 1_000_000_000 / u128::from(TICK_HZ);
    Instant::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
}

/// Returns the first tick of embassy's clock that reads `due` or later.
fn at_least(due: Instant) -> Clock {
    let ticks = (u128::from(due.as_nanos()) * u128::from(TICK_HZ)).div_ceil(1_000_000_000);
    Clock::from_ticks(u64::try_from(ticks).unwrap_or(u64::MAX))
}
