//! The event loop that all adapters on tokio share. It is the only code that reads an operator's
//! clock and drives its engine.
//!
//! An adapter implements [`Transport`], which says where messages come from and where requests and
//! outputs go, and runs a [`Driver`] with it. The loop decides nothing: the core has the rules, and
//! the engine has the queues.
//!
//! - **Turns** (D9). Calls, the transport and the timer take turns in a fixed order. So a flood of
//!   one kind does not keep another from its turn, and a run on a paused clock can be repeated. The
//!   order changes no decision about time, because the core expires what is due before anything
//!   else (A2).
//! - **The timer** is set to the nearest due instant and never moved further away. Waking up now
//!   and then with nothing due is cheaper than moving the timer with each message. It is set again
//!   each time it fires, even if the due instant lies beyond the end of the system's clock.
//! - **Calls** (D6) run in tasks of their own. On a runtime of one thread they run within the
//!   driver, which costs half as much. The loop aborts calls that are no longer wanted or have
//!   lingered long enough, and aborts all of them when it ends or is dropped. It never aborts
//!   local's computations (F7).
//! - **Blocking** (D9) is reported. A call that runs for long without a pause holds up its thread
//!   and the other calls on it. On a runtime of one thread it holds up the whole operator. Such
//!   calls are counted and logged, and so are timers that are served late.
//! - **The clock** is read once for each event, and between two calls that are polled one after the
//!   other. **Panics** of a call or a computation are failures (F4).
//! - **A request that could not be sent** fails only after the message was offered to every cloud
//!   (A30).

mod calls;
mod clock;
mod measured_call;
mod spans;
mod timers;
mod wake_flag;

use std::future::poll_fn;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use fuseline_engine::{
    Effect, Engine, Hint, Item, Lineage, Offer, Reserve, Situation, StampedValue,
};
use futures_util::future::BoxFuture;

use crate::Error;
use crate::drive::calls::Calls;
use crate::drive::clock::DriverClock;
use crate::drive::spans::MessageSpans;
use crate::drive::timers::Timer;
use crate::drive::wake_flag::WakeFlags;
use crate::error_chain::ErrorChain;
use crate::panics::panicked;

pub use crate::drive::timers::Timers;

/// Connects a driver to one kind of operator: its streams, topics and sources.
pub trait Transport {
    /// The request that is sent to a source.
    type Request;
    /// The result that sources compute.
    type Value: Send + 'static;
    /// The message that comes in.
    type Message;

    /// Returns the next event. The driver calls this method until no event is ready, and again when
    /// the context's waker is called. The transport also does its other work here.
    fn poll_incoming(
        &mut self,
        context: &mut Context<'_>,
    ) -> Poll<Incoming<Self::Message, Self::Value>>;

    /// Returns local's job for a message, and its deadline if it has one.
    fn job(&mut self, message: &Self::Message) -> (Self::Request, Option<Duration>);

    /// Returns the requests to offer to clouds for an accepted message.
    fn offers(
        &mut self,
        timestamp: u64,
        message: &Self::Message,
    ) -> impl Iterator<Item = Offer<Self::Request>>;

    /// Returns the lineage of a message, if that is known.
    fn lineage(&mut self, timestamp: u64, message: &Self::Message) -> Option<Arc<Lineage>> {
        let _ = (timestamp, message);
        None
    }

    /// Notes that a message was accepted and offered to all clouds.
    fn taken_on(&mut self, timestamp: u64, message: &Self::Message) {
        let _ = (timestamp, message);
    }

    /// Returns the vehicle's situation at this message, for policies; `None` leaves it unchanged.
    fn situation(&mut self, timestamp: u64, message: &Self::Message) -> Option<Situation<'static>> {
        let _ = (timestamp, message);
        None
    }

    /// Returns the reserve for the operators downstream, for messages from now on (E3).
    fn reserve(&mut self) -> Reserve {
        Reserve::default()
    }

    /// Sends a request to a source.
    fn send(&mut self, start: Start<Self::Request>) -> Sent<Self::Value>;

    /// Starts another worker, because local's computation of this message has run for too long.
    /// Called only if the engine [may replace](fuseline_engine::Local::replaceable) any.
    fn replace(&mut self, timestamp: u64) {
        let _ = timestamp;
    }

    /// Sends the item of a message.
    fn output(&mut self, item: Item<Self::Value>);

    /// Takes a result that came too late for its message. Called only if the engine [takes
    /// hints](fuseline_engine::EngineConfig::takes_hints).
    fn hint(&mut self, hint: Hint<Self::Value>) {
        drop(hint);
    }

    /// Returns `true` if all outputs have been handed on. Until then the driver does not end by
    /// itself.
    fn is_delivered(&self) -> bool {
        true
    }
}

/// An event that comes in through a transport.
#[derive(Debug)]
pub enum Incoming<M, V> {
    /// A message came.
    Message {
        /// The timestamp, greater than every earlier message's.
        timestamp: u64,
        /// The message.
        message: M,
    },
    /// A result or failure that is not the end of a call.
    Completion(Completion<V>),
    /// No more messages will come: the driver ends once all are answered.
    Last,
    /// The driver ends at once.
    Stop,
}

/// A source's result for a message, or the reason why there is none.
#[derive(Debug)]
pub struct Completion<V> {
    /// The source's priority; 0 is local.
    pub priority: u16,
    /// The message's timestamp.
    pub timestamp: u64,
    /// The result, or the reason why there is none.
    pub result: Result<StampedValue<V>, Error>,
}

/// A request to be sent.
#[derive(Debug)]
pub struct Start<R> {
    /// The source's priority; 0 is local.
    pub priority: u16,
    /// The message's timestamp.
    pub timestamp: u64,
    /// The time left, with the time to linger (D5); for local 2⁶⁴ − 1 ns.
    pub left: Duration,
    /// The request that the message handler offered.
    pub request: R,
}

/// The way in which a request was sent.
pub enum Sent<V> {
    /// The request is a call. The future returns the source's result or failure. Dropping the
    /// future must abort the call.
    Call(BoxFuture<'static, Result<StampedValue<V>, Error>>),
    /// The request was sent. Its result may come by [`Incoming::Completion`].
    Away,
    /// The reason why the request could not be sent.
    Failed(Error),
}

/// An operator with its event loop. The fields that every event needs come first, because an
/// operator among thousands has nothing in the processor's caches.
#[repr(C)]
pub struct Driver<T: Transport> {
    /// The flags of calls, transport and timer.
    wake_flags: WakeFlags,
    /// The party that has the next turn.
    turn: usize,
    calls: Calls<T::Value>,
    clock: DriverClock,
    /// The clock's reading for the current event.
    now: u64,
    /// The instant when the timer goes off, if it is set.
    armed: Option<u64>,
    is_last: bool,
    /// The requests of the current message that could not be sent.
    unsent: Vec<(u16, u64, Error)>,
    spans: MessageSpans,
    engine: Engine<T::Value, T::Request>,
    timer: Timer,
    transport: T,
}

/// Ends the recordings and waits until they are written, which the disk may delay.
///
/// # Errors
/// Returns an error if a recording is not whole.
pub async fn finish<V: Send + 'static, R: Send + 'static>(
    mut engine: Engine<V, R>,
) -> io::Result<()> {
    let written = tokio::task::spawn_blocking(move || engine.finish()).await;
    written.unwrap_or_else(|error| Err(io::Error::other(error)))
}

/// The party whose turn it is.
enum PollTurn<M, V> {
    Transport(Incoming<M, V>),
    /// The timer went off.
    Timer,
}

/// The number of parties that take turns.
const TURNS: usize = 3;
/// The parties' indices.
const CALLS: usize = 0;
const TRANSPORT: usize = 1;
const TIMER: usize = 2;

impl<T: Transport> Driver<T> {
    /// Creates a driver whose clock starts now.
    ///
    /// # Errors
    /// Returns an error if the system has no such timer, or no more of them for this process.
    ///
    /// # Panics
    /// Panics outside of a tokio runtime, and for the kernel's timer in a runtime without I/O.
    pub fn new(
        mut engine: Engine<T::Value, T::Request>,
        transport: T,
        timers: Timers,
    ) -> io::Result<Self> {
        let timer = Timer::new(timers)?;
        let wake_flags = WakeFlags::new();
        let clock = DriverClock::new();
        engine.set_start(clock.start());
        Ok(Self {
            calls: Calls::new(wake_flags.driver(), engine.counts()),
            engine,
            transport,
            clock,
            now: 0,
            spans: MessageSpans::default(),
            timer,
            armed: None,
            unsent: Vec::new(),
            turn: 0,
            wake_flags,
            is_last: false,
        })
    }

    /// Runs until the transport stops it, or until no more messages will come and all are answered.
    /// Then aborts the calls. Call [`finish`] with the engine that it returns.
    pub async fn run(mut self) -> (T, Engine<T::Value, T::Request>) {
        loop {
            self.act();
            if self.is_last && self.engine.is_idle() && self.transport.is_delivered() {
                break;
            }
            if let Some(due) = self.engine.next_due()
                && self.armed.is_none_or(|armed| due < armed)
            {
                self.timer.set(self.clock.instant(due));
                self.armed = Some(due);
                self.wake_flags.set(TIMER);
            }
            let turn = poll_fn(|context| self.poll_turn(context)).await;
            match turn {
                PollTurn::Transport(Incoming::Message { timestamp, message }) => {
                    self.message(timestamp, &message);
                }
                PollTurn::Transport(Incoming::Completion(completion)) => self.complete(completion),
                PollTurn::Transport(Incoming::Last) => self.is_last = true,
                PollTurn::Transport(Incoming::Stop) => break,
                PollTurn::Timer => {
                    self.armed = None;
                    if self.engine.next_due().is_some_and(|due| due <= self.now) {
                        self.engine.tick(self.now);
                    }
                }
            }
        }
        let over = self.clock.now();
        self.engine.end(over);
        (self.transport, self.engine)
    }

    /// Returns the next party that is ready, starting after the last one, with the clock read
    /// afterwards. Only parties that were woken are polled.
    fn poll_turn(&mut self, context: &mut Context<'_>) -> Poll<PollTurn<T::Message, T::Value>> {
        let Self { calls, transport, timer, wake_flags, armed, clock, now, turn: next, .. } = self;
        for _ in 0..TURNS {
            let turn = *next;
            *next = if turn + 1 < TURNS { turn + 1 } else { 0 };
            if !wake_flags.is_set(turn) {
                continue;
            }
            let ready = wake_flags.poll(turn, |context| match turn {
                CALLS => calls.poll_completion(*clock, context).map(|(completion, ended)| {
                    (PollTurn::Transport(Incoming::Completion(completion)), ended)
                }),
                TIMER if armed.is_some() => {
                    timer.poll(context).map(|()| (PollTurn::Timer, clock.now()))
                }
                TIMER => Poll::Pending,
                _ => transport
                    .poll_incoming(context)
                    .map(|incoming| (PollTurn::Transport(incoming), clock.now())),
            });
            if let Poll::Ready((ready, at)) = ready {
                *now = at;
                return Poll::Ready(ready);
            }
        }
        wake_flags.wait(context);
        Poll::Pending
    }

    /// Opens a message (F1), and offers it to each cloud (F2).
    fn message(&mut self, timestamp: u64, message: &T::Message) {
        // The open and all offers happen at one instant, so equal deadlines end together.
        let now = self.now;
        if let Some(situation) = self.transport.situation(timestamp, message) {
            self.engine.set_situation(situation);
        }
        let lineage = self.transport.lineage(timestamp, message);
        if lineage.as_ref().is_some_and(|lineage| lineage.within.is_some()) {
            self.engine.set_reserve(self.transport.reserve());
        }
        let (job, deadline) = self.transport.job(message);
        let offers = self.transport.offers(timestamp, message);
        let source = lineage.clone();
        if self.engine.open_with(now, timestamp, deadline, lineage, job, offers) {
            let deadline = self.engine.local_deadline(now, timestamp, deadline);
            self.spans.open(self.engine.name(), timestamp, deadline, source.as_deref());
            self.transport.taken_on(timestamp, message);
        }
    }

    /// Applies a result or a failure (F3, F4).
    fn complete(&mut self, Completion { priority, timestamp, result }: Completion<T::Value>) {
        let now = self.now;
        self.spans.complete((priority, timestamp), &result);
        match result {
            Ok(value) => self.engine.result(now, timestamp, priority, value),
            Err(error) => self.engine.fail(now, timestamp, priority, &ErrorChain(&*error)),
        }
    }

    /// Carries out the engine's effects, and fails the requests that could not be sent.
    fn act(&mut self) {
        loop {
            while let Some(effect) = self.engine.next_effect() {
                let is_output = matches!(effect, Effect::Output(_));
                match effect {
                    Effect::Output(item) => {
                        self.spans.item(&item);
                        self.transport.output(item);
                    }
                    Effect::Start { priority, timestamp, until, request } => {
                        let left = until.map_or(u64::MAX, |until| until.saturating_sub(self.now));
                        let left = Duration::from_nanos(left);
                        self.send(Start { priority, timestamp, left, request });
                    }
                    Effect::Abort { priority, timestamp } => {
                        self.calls.abort(priority, timestamp);
                        self.spans.abort((priority, timestamp));
                    }
                    Effect::Replace { timestamp } => self.transport.replace(timestamp),
                    Effect::Hint(hint) => self.transport.hint(hint),
                }
                // With a new request or a waiting output, the transport may have something new to
                // wait for.
                if !is_output || !self.transport.is_delivered() {
                    self.wake_flags.set(TRANSPORT);
                }
            }
            if self.unsent.is_empty() {
                return;
            }
            for (priority, timestamp, error) in self.unsent.drain(..) {
                self.engine.fail(self.now, timestamp, priority, &ErrorChain(&*error));
            }
        }
    }

    fn send(&mut self, start: Start<T::Request>) {
        let Start { priority, timestamp, left, .. } = start;
        let deadline = left.saturating_sub(self.engine.linger(priority));
        let sent = catch_unwind(AssertUnwindSafe(|| self.transport.send(start)));
        let mut span = self.spans.begin((priority, timestamp), deadline);
        match sent.unwrap_or_else(|panic| Sent::Failed(panicked(&*panic))) {
            Sent::Call(call) => {
                self.calls.begin((priority, timestamp), call, span);
                self.wake_flags.set(CALLS);
            }
            Sent::Away => self.spans.wait((priority, timestamp), span),
            Sent::Failed(error) => {
                span.fail();
                self.unsent.push((priority, timestamp, error));
            }
        }
    }
}
