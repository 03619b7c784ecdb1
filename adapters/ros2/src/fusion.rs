//! The event loop: the one place where the clock is read and the engine is driven.

use std::collections::{HashMap, VecDeque};
use std::io;
use std::pin::pin;
use std::time::Duration;

use fuseline_operator::{Counting, Effect, Engine, Item, Opening, Outcome, Tally};
use fuseline_tokio::{Call, Error};
use rustdds::dds::ReadError;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};
use tracing::{debug, error, info, warn};

use crate::dds::{End, Outlet};
use crate::key::{Key, KeyError, Stamp};
use crate::raw::Payload;
use crate::report::{self, Intake, Reporter};
use crate::settings::{Change, seconds};
use crate::source::{Handle, Source, Way};
use crate::stamps::{Order, Stamps};
use crate::stop::Stop;
use crate::voice::Voice;

/// Local's place among the sources.
const LOCAL: usize = 0;

/// The operator of one node.
pub(crate) struct Fusion {
    pub(crate) engine: Engine<Payload, Payload>,
    /// Local, then the clouds in their order.
    pub(crate) sources: Vec<Source>,
    pub(crate) output: Outlet,
    pub(crate) input: std::sync::Arc<End>,
    pub(crate) input_key: Key,
    pub(crate) output_key: Key,
    /// Of clouds without one of their own.
    pub(crate) deadline: Duration,
    pub(crate) voice: Voice,
    pub(crate) arrived: mpsc::Sender<Arrival>,
    pub(crate) memory: Memory,
}

/// What the loop keeps from one event to the next.
pub(crate) struct Memory {
    start: Instant,
    stamps: Stamps<Stamp>,
    next: u64,
    intake: Intake,
    counting: Counting,
    calls: HashMap<(u16, u64), AbortHandle>,
    /// Requests that could not be sent; failures (F4) once the message was offered to all.
    unsent: VecDeque<(u16, u64, &'static str)>,
}

/// What comes from outside.
pub(crate) struct Events {
    pub(crate) inputs: mpsc::Receiver<Result<Payload, ReadError>>,
    pub(crate) arrivals: mpsc::Receiver<Arrival>,
    pub(crate) deadlines: mpsc::Receiver<Result<Payload, ReadError>>,
    pub(crate) changes: mpsc::UnboundedReceiver<Change>,
    pub(crate) period: Duration,
}

/// A result, or word that there will be none.
pub(crate) enum Arrival {
    /// On the topic of the source at this place.
    Sample { place: usize, sample: Result<Payload, ReadError> },
    /// A call's end.
    Call { priority: u16, timestamp: u64, result: Result<Payload, Error> },
}

impl Memory {
    pub(crate) fn new(counting: Counting) -> Self {
        Self {
            start: Instant::now(),
            stamps: Stamps::new(),
            next: 0,
            intake: Intake::default(),
            counting,
            calls: HashMap::new(),
            unsent: VecDeque::new(),
        }
    }

    /// The operator's clock: nanoseconds since its start.
    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn instant(&self, at: u64) -> Instant {
        // What is too far for the clock is looked at again in a day.
        let far = Duration::from_secs(86_400);
        self.start + Duration::from_nanos(at).min(self.start.elapsed() + far)
    }
}

impl Fusion {
    /// Runs until told to stop and every message is answered, or until told twice; answers the
    /// counts.
    ///
    /// # Errors
    /// If the trace could not be written whole.
    pub(crate) async fn run(mut self, mut events: Events, stop: &mut Stop) -> io::Result<Tally> {
        let mut timer = pin!(sleep_until(self.memory.start));
        let mut armed = None;
        let mut report = interval(events.period);
        report.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut reporter = Reporter::new(&self.voice.node, self.memory.counting.tally());
        loop {
            if stop.came() && self.engine.is_idle() {
                break;
            }
            let due = self.engine.next_due();
            if let Some(due) = due.filter(|due| armed != Some(*due)) {
                timer.as_mut().reset(self.memory.instant(due));
                armed = Some(due);
            }
            // A2: whatever is taken in first, the core expires what is due by then before it. None has
            // precedence, so that a flood on one topic keeps no other from its turn.
            tokio::select! {
                () = stop.next() => if stop.is_urgent() { break },
                _ = report.tick() => self.report(&mut reporter),
                Some(change) = events.changes.recv() => self.change(change),
                Some(sample) = events.deadlines.recv() => self.environment(sample),
                Some(arrival) = events.arrivals.recv() => self.arrive(arrival),
                () = &mut timer, if due.is_some() => {
                    armed = None;
                    self.engine.tick(self.memory.now());
                }
                Some(sample) = events.inputs.recv(), if !stop.came() => self.take(sample),
            }
            self.act();
        }
        self.report(&mut reporter);
        for (_, call) in self.memory.calls.drain() {
            call.abort();
        }
        let mut engine = self.engine;
        // The recorder waits for the disk.
        let written = tokio::task::spawn_blocking(move || engine.finish()).await;
        written.unwrap_or_else(|error| Err(io::Error::other(error)))?;
        Ok(self.memory.counting.tally())
    }

    /// Something came on the input topic.
    fn take(&mut self, sample: Result<Payload, ReadError>) {
        let intake = &mut self.memory.intake;
        let Ok(payload) = sample.inspect_err(|error| debug!(%error, "input not read")) else {
            intake.encoding += 1;
            return;
        };
        let key = match self.input_key.read(&payload.body, payload.big_endian) {
            Ok(key) => key,
            Err(error) => {
                debug!(%error, "input without a key");
                match error {
                    KeyError::Short => intake.short += 1,
                    KeyError::Nanosec => intake.nanosec += 1,
                }
                return;
            }
        };
        match self.memory.stamps.order(key) {
            Order::Taken => {
                warn!(%key, "an open message has this stamp: not taken in");
                intake.duplicate_stamp += 1;
                return;
            }
            Order::Backwards => intake.stamp_backwards += 1,
            Order::Forwards => {}
        }
        self.message(key, &payload);
    }

    /// A message came (F1); each cloud that is there is asked (F2).
    fn message(&mut self, key: Stamp, payload: &Payload) {
        // One instant for all of it: deadlines count from the message, and equal ones end together.
        let now = self.memory.now();
        let timestamp = self.memory.next;
        self.memory.next += 1;
        self.memory.stamps.open(key, timestamp);
        let deadline = self.sources[LOCAL].deadline;
        let opening = self.engine.open(now, timestamp, deadline, payload.clone());
        if opening == Opening::Refused {
            return;
        }
        self.act_now();
        for place in LOCAL + 1..self.sources.len() {
            let source = &self.sources[place];
            if source.enabled && source.is_reached() {
                let deadline = source.deadline.unwrap_or(self.deadline);
                let priority = source.priority;
                self.engine.offer(now, timestamp, priority, deadline, payload.clone());
                self.act_now();
            }
        }
        if opening == Opening::NoRoom {
            self.memory.unsent.push_back((0, timestamp, "too many messages wait for local"));
        }
    }

    /// A result or a failure came (F3, F4).
    fn arrive(&mut self, arrival: Arrival) {
        let now = self.memory.now();
        match arrival {
            Arrival::Call { priority, timestamp, result } => {
                self.memory.calls.remove(&(priority, timestamp));
                match result {
                    Ok(payload) => self.engine.result(now, timestamp, priority, payload),
                    Err(error) => self.engine.fail(now, timestamp, priority, &error),
                }
            }
            Arrival::Sample { place, sample } => {
                let source = &mut self.sources[place];
                let key = sample.ok().and_then(|payload| {
                    let key = self.output_key.read(&payload.body, payload.big_endian).ok()?;
                    Some((key, payload))
                });
                let Some((key, payload)) = key else {
                    debug!(source = source.name, "result without a key");
                    source.strays.malformed += 1;
                    return;
                };
                let Some(timestamp) = self.memory.stamps.find(key) else {
                    debug!(source = source.name, %key, "result of no message");
                    source.strays.unknown_stamp += 1;
                    return;
                };
                self.engine.result(now, timestamp, source.priority, payload);
            }
        }
    }

    /// Does what the engine says, and lets fail what could not be sent.
    fn act(&mut self) {
        self.act_now();
        while let Some((priority, timestamp, why)) = self.memory.unsent.pop_front() {
            self.engine.fail(self.memory.now(), timestamp, priority, &why);
            self.act_now();
        }
    }

    fn act_now(&mut self) {
        while let Some(effect) = self.engine.next_effect() {
            match effect {
                Effect::Output(item) => self.answer(item),
                Effect::Start { priority, timestamp, due, request } => {
                    self.send(priority, timestamp, due, request);
                }
                Effect::Abort { priority, timestamp } => {
                    if let Some(call) = self.memory.calls.remove(&(priority, timestamp)) {
                        call.abort();
                    }
                }
            }
        }
    }

    /// The message goes to a source.
    fn send(&mut self, priority: u16, timestamp: u64, due: Option<u64>, payload: Payload) {
        let Some(source) = self.sources.iter().find(|source| source.priority == priority) else {
            return;
        };
        match &source.way {
            Way::Topics { requests, .. } => {
                let bytes = payload.body.len() as u64;
                if requests.end.matched() == 0 {
                    let why = "nobody subscribes to its topic";
                    self.memory.unsent.push_back((priority, timestamp, why));
                } else if requests.publish(payload) {
                    self.memory.counting.sent(priority, bytes);
                } else {
                    let why = "its subscriber is too far behind";
                    self.memory.unsent.push_back((priority, timestamp, why));
                }
            }
            Way::Grpc(handle) => {
                let handle = Handle::clone(handle);
                self.call(&handle, priority, timestamp, due.unwrap_or(u64::MAX), payload);
            }
        }
    }

    /// Makes a call in a task of its own.
    fn call(&mut self, handle: &Handle, p: u16, timestamp: u64, due: u64, payload: Payload) {
        let deadline = Duration::from_nanos(due.saturating_sub(self.memory.now()));
        let call = Call::new(timestamp, deadline, p, self.memory.counting.clone());
        let (arrived, reply) = (self.arrived.clone(), handle(payload, call));
        let task = tokio::spawn(async move {
            let result = reply.await;
            // Nobody listens any more when the node ends.
            drop(arrived.send(Arrival::Call { priority: p, timestamp, result }).await);
        });
        self.memory.calls.insert((p, timestamp), task.abort_handle());
    }

    /// F7: what became of a message goes out.
    fn answer(&mut self, item: Item<Payload>) {
        let key = match item.outcome {
            Outcome::Refused(_) => self.memory.stamps.refuse(item.timestamp),
            Outcome::Forwarded(_) | Outcome::Missed => self.memory.stamps.answer(item.timestamp),
        };
        let status = report::of_item(&self.voice.node, key, &item);
        if let Outcome::Forwarded(forwarded) = item.outcome
            && !self.output.publish(forwarded.value)
        {
            error!(timestamp = item.timestamp, "output not sent: a subscriber is too far behind");
            self.memory.intake.unsent += 1;
        }
        self.voice.status(status);
    }

    /// The environment decides the deadline: `std_msgs/msg/Float64`, seconds.
    fn environment(&mut self, sample: Result<Payload, ReadError>) {
        let decided = sample.ok().and_then(|payload| {
            let bytes = *payload.body.first_chunk()?;
            let is_big = payload.big_endian;
            seconds(if is_big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
        });
        if let Some(deadline) = decided {
            self.deadline = deadline;
        } else {
            warn!("a deadline that is no positive number of seconds: ignored");
        }
    }

    /// A parameter was set.
    fn change(&mut self, change: Change) {
        info!(?change, "parameter set");
        match change {
            Change::Deadline(deadline) => self.deadline = deadline,
            Change::LocalDeadline(deadline) => self.sources[LOCAL].deadline = Some(deadline),
            Change::CloudDeadline(cloud, deadline) => {
                self.sources[LOCAL + 1 + cloud].deadline = deadline;
            }
            Change::CloudEnabled(cloud, enabled) => {
                self.sources[LOCAL + 1 + cloud].enabled = enabled;
            }
            // ROS's own, which stamps what the voice says.
            Change::SimTime(_) => {}
        }
    }

    fn report(&mut self, reporter: &mut Reporter) {
        let ends = [&*self.input, &*self.output.end];
        let tally = self.memory.counting.tally();
        let statuses = reporter.period(tally, self.memory.intake, &self.sources, &ends);
        self.voice.diagnostics(statuses);
    }
}
