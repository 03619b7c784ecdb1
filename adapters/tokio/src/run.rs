//! The operator's task: the one place where its clock is read and its engine is driven.

use std::collections::{HashMap, VecDeque};
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use fuseline_operator::{Counting, Effect, Engine, Item, Opening};
use tokio::sync::{Notify, mpsc};
use tokio::task::AbortHandle;
use tokio::time::{Instant, sleep_until};
use tracing::{Instrument, debug_span, error};

use crate::Error;
use crate::local::{Workers, guarded};
use crate::setup::{Call, Registered, Request};
use crate::stream::{Reader, WriteError, Writer};
use crate::words::Words;

/// An operator's state while it runs.
pub(crate) struct Run<I, O> {
    engine: Engine<O, Work<I, O>>,
    clouds: Vec<Registered<I, O>>,
    workers: Workers<I, O>,
    deadline: Option<Duration>,
    start: Instant,
    arrived: Arrived<O>,
    calls: Calls,
    output: Writer<Item<O>>,
    /// What waits for a reader of the output; at most what was open when it began to lag.
    outbox: VecDeque<Item<O>>,
    counting: Counting,
}

/// What goes to a source.
pub(crate) enum Work<I, O> {
    Local(Arc<I>),
    Call(Request<O>),
}

/// The way for what comes from sources. Each call and each computation sends one, so no more are on
/// it than were begun.
pub(crate) type Arrived<O> = mpsc::UnboundedSender<Arrival<O>>;

/// What comes from a source.
pub(crate) struct Arrival<O> {
    pub(crate) priority: u16,
    pub(crate) timestamp: u64,
    pub(crate) result: Result<O, Error>,
}

/// The calls under way, aborted when this is dropped.
#[derive(Default)]
struct Calls(HashMap<(u16, u64), AbortHandle>);

impl<I: Send + Sync + 'static, O: Send + Sync + 'static> Run<I, O> {
    pub(crate) fn new(
        engine: Engine<O, Work<I, O>>,
        clouds: Vec<Registered<I, O>>,
        workers: Workers<I, O>,
        deadline: Option<Duration>,
        arrived: Arrived<O>,
        output: Writer<Item<O>>,
    ) -> Self {
        let counting = engine.counts();
        let (start, calls, outbox) = (Instant::now(), Calls::default(), VecDeque::new());
        Self { engine, clouds, workers, deadline, start, arrived, calls, output, outbox, counting }
    }

    /// Runs until the input has ended and every message is answered, or until told to stop.
    pub(crate) async fn run(
        mut self,
        mut input: Reader<I>,
        mut arrivals: mpsc::UnboundedReceiver<Arrival<O>>,
        stop: Arc<Notify>,
    ) -> io::Result<()> {
        let mut stopped = pin!(stop.notified());
        let mut timer = pin!(sleep_until(self.start));
        let mut armed = None;
        let mut is_open = true;
        loop {
            self.deliver();
            if !is_open && self.engine.is_idle() && self.outbox.is_empty() {
                break;
            }
            let due = self.engine.next_due();
            if let Some(due) = due.filter(|_| due != armed) {
                timer.as_mut().reset(self.instant(due));
                armed = Some(due);
            }
            // A2: whatever is taken in first, the core expires what is due by then before it.
            tokio::select! {
                biased;
                () = &mut stopped => break,
                Some(arrival) = arrivals.recv() => self.arrive(arrival),
                () = &mut timer, if due.is_some() => self.engine.tick(self.now()),
                () = self.output.room(), if !self.outbox.is_empty() => {}
                message = input.numbered(), if is_open && self.outbox.is_empty() => match message {
                    Some((timestamp, message)) => self.message(timestamp, &message),
                    None => is_open = false,
                },
            }
            self.act();
        }
        let Self { mut engine, calls, output, .. } = self;
        drop((calls, output));
        // The recorder waits for the disk.
        let written = tokio::task::spawn_blocking(move || engine.finish());
        let written = written.await.unwrap_or_else(|error| Err(io::Error::other(error)));
        if let Err(error) = &written {
            error!(%error, "the trace is not whole");
        }
        written
    }

    /// A message came (F1); each cloud's handler is asked (F2).
    fn message(&mut self, timestamp: u64, message: &Arc<I>) {
        // One instant for all of it: deadlines count from the message, and equal ones end together.
        let now = self.now();
        let job = Work::Local(Arc::clone(message));
        let opening = self.engine.open(now, timestamp, self.deadline, job);
        if opening == Opening::Refused {
            return;
        }
        self.act();
        for i in 0..self.clouds.len() {
            let registered = &mut self.clouds[i];
            let priority = registered.priority;
            if let Some((request, deadline)) = registered.ask(message, timestamp) {
                let request = Work::Call(request);
                self.engine.offer(now, timestamp, priority, deadline, request);
                self.act();
            }
        }
        if opening == Opening::NoRoom {
            let why = "too many computations wait";
            self.engine.fail(now, timestamp, 0, &why);
        }
    }

    /// A result or a failure came (F3, F4).
    fn arrive(&mut self, Arrival { priority, timestamp, result }: Arrival<O>) {
        self.calls.0.remove(&(priority, timestamp));
        let now = self.now();
        match result {
            Ok(value) => self.engine.result(now, timestamp, priority, value),
            Err(error) => self.engine.fail(now, timestamp, priority, &Words(&*error)),
        }
    }

    /// Does what the engine says.
    fn act(&mut self) {
        while let Some(effect) = self.engine.next_effect() {
            match effect {
                Effect::Output(item) => self.outbox.push_back(item),
                Effect::Start { timestamp, request: Work::Local(message), .. } => {
                    self.workers.compute(message, timestamp);
                }
                Effect::Start { priority, timestamp, due, request: Work::Call(request) } => {
                    self.call(priority, timestamp, due.unwrap_or(u64::MAX), request);
                }
                Effect::Abort { priority, timestamp } => {
                    if let Some(call) = self.calls.0.remove(&(priority, timestamp)) {
                        call.abort();
                    }
                }
            }
        }
    }

    /// Makes a call in a task of its own.
    fn call(&mut self, priority: u16, timestamp: u64, due: u64, request: Request<O>) {
        let deadline = Duration::from_nanos(due.saturating_sub(self.now()));
        let call = Call::new(timestamp, deadline, priority, self.counting.clone());
        let arrived = self.arrived.clone();
        let task = async move {
            let result = guarded(request(call)).await;
            drop(arrived.send(Arrival { priority, timestamp, result }));
        };
        let span = debug_span!("call", priority, timestamp);
        let task = tokio::spawn(task.instrument(span));
        self.calls.0.insert((priority, timestamp), task.abort_handle());
    }

    /// Hands items to the output while its readers have room.
    fn deliver(&mut self) {
        while let Some(item) = self.outbox.pop_front() {
            match self.output.write(item) {
                // An output that nobody reads is no reason to end: traces and counts go on.
                Ok(_) | Err(WriteError::Closed(_)) => {}
                Err(WriteError::Full(item)) => {
                    self.outbox.push_front(item);
                    return;
                }
            }
        }
    }

    /// The operator's clock: nanoseconds since its start.
    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// When the clock reads `nanos`; for readings beyond the system's clock, a day from now.
    fn instant(&self, nanos: u64) -> Instant {
        let day = Duration::from_secs(24 * 60 * 60);
        self.start.checked_add(Duration::from_nanos(nanos)).unwrap_or_else(|| Instant::now() + day)
    }
}

impl Drop for Calls {
    fn drop(&mut self) {
        self.0.values().for_each(AbortHandle::abort);
    }
}
