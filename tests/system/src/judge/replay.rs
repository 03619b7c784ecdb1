//! Reads the operator's trace beside a model of its queues, to find what each message and request
//! should get.
//!
//! The model shares no code with the engine, so that the two can differ.

use std::collections::{BTreeMap, VecDeque};

use fuseline_engine::Trigger;
use fuseline_testkit::split;
use fuseline_traces::{
    Commit, Decision, DropReason, Event, Events, Input, Judge, OfferRefusal, OpenRefusal, Verdict,
};

/// The part of an operator's configuration that the trace does not show.
pub struct QueueConfig {
    /// The commit rule.
    pub commit: Commit,
    /// The number of messages that local computes at once.
    pub at_once: usize,
    /// The number of further messages that may wait for local.
    pub waiting: usize,
    /// `true` if a message that already has its output leaves local's queue.
    pub skip_answered: bool,
    /// Each cloud's priority, and how many of its calls may be under way.
    pub clouds: Vec<(u16, usize)>,
}

/// The facts that the trace shows.
#[derive(Default)]
pub struct Replay {
    /// The judge's verdict on the trace.
    pub verdict: Option<Verdict>,
    /// The reason why the trace cannot be read.
    pub defect: Option<String>,
    /// The instant of the last input.
    pub end: u64,
    /// The messages in the order in which they were opened.
    pub opened: Vec<OpenedMessage>,
    /// The index of each message in `opened`.
    by_t: BTreeMap<u64, usize>,
    /// The requests to local and the clouds, in the order in which they were admitted.
    pub requested: Vec<AdmittedRequest>,
    /// The items, in the order in which they were decided.
    pub items: Vec<DecidedItem>,
    /// The offers, in their order.
    pub offers: Vec<DecidedOffer>,
    /// Descriptions of backlogs that differ from the queue's length.
    pub wrong_backlogs: Vec<String>,
    /// Descriptions of local computations that should have failed for lack of room, but did not.
    pub wrong_room: Vec<String>,
    /// The results and failures that were dropped.
    pub dropped: Vec<DroppedResult>,
    /// The source of each result that was held.
    pub held: Vec<u16>,
}

/// A message that was opened.
pub struct OpenedMessage {
    /// Its timestamp.
    pub t: u64,
    /// The instant when it was opened.
    pub at: u64,
    /// Local's deadline.
    pub deadline: Option<u64>,
    /// The outcome in its last item, once that is decided.
    pub end: Option<Departure>,
    /// Its items, by their indices in `items`.
    pub items: Vec<usize>,
    /// The sources whose failures were accepted.
    pub failures: Vec<u16>,
}

/// An item, as the trace shows it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct DecidedItem {
    /// The index of its message in `opened`.
    pub message: usize,
    /// The instant of the decision.
    pub at: u64,
    /// The outcome of the message.
    pub departure: Departure,
    /// The number of failures that were accepted by then.
    pub failures: usize,
}

/// An offer that was decided.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct DecidedOffer {
    /// The message's timestamp.
    pub t: u64,
    /// The cloud.
    pub p: u16,
    /// The deadline that was offered.
    pub deadline: u64,
    /// The reason to refuse it, if there was one.
    pub refusal: Option<OfferRefusal>,
}

/// The outcome of a message, with the source of the result.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Departure {
    /// A result was sent while better ones were pending.
    Preliminary(u16),
    /// A result was sent as the last one.
    Forwarded(u16, Trigger),
    /// The preliminary result is the last one.
    Final(u16),
    /// No result came.
    Missed,
    /// The message was not accepted.
    Refused(OpenRefusal),
}

/// A request that was admitted, or a local computation.
pub struct AdmittedRequest {
    /// The source.
    pub p: u16,
    /// The message's timestamp.
    pub t: u64,
    /// The instant when it was admitted.
    pub at: u64,
    /// The due instant.
    pub due: Option<u64>,
    /// The instant when the source had room for the request.
    pub started: Option<u64>,
    /// The instant when its timer fired.
    pub fired: Option<u64>,
    /// The instant when it was cancelled.
    pub cancelled: Option<u64>,
    /// The instant when its own result or failure came, and `true` for a result.
    pub ended: Option<(u64, bool)>,
    /// `true` if it was removed from local's queue because its message already had its output.
    pub skipped: bool,
}

/// A result or failure that was dropped.
pub struct DroppedResult {
    /// The instant of the decision.
    pub at: u64,
    /// The message's timestamp.
    pub t: u64,
    /// The source.
    pub p: u16,
    /// The reason.
    pub why: DropReason,
    /// `true` for a result.
    pub is_result: bool,
}

/// One source's queue.
struct ReplayQueue {
    p: u16,
    at_once: usize,
    waiting: VecDeque<usize>,
    flying: Vec<usize>,
}

/// Reads the trace line by line.
struct ReplayReader<'a> {
    config: &'a QueueConfig,
    replay: Replay,
    queues: Vec<ReplayQueue>,
    now: u64,
    /// The timestamp whose local computation must fail next, unless there is room for it.
    crowded: Option<u64>,
}

impl Replay {
    /// Reads and judges a trace.
    #[must_use]
    pub fn of(config: &QueueConfig, trace: &[u8]) -> Self {
        let mut events = match Events::new("trace", trace) {
            Ok(events) => events,
            Err(error) => return Self { defect: Some(error.to_string()), ..Self::default() },
        };
        let mut judge = Judge::new("trace", events.header());
        let queue = |p, at_once: usize| ReplayQueue {
            p,
            at_once: at_once.max(1),
            waiting: VecDeque::new(),
            flying: Vec::new(),
        };
        let clouds = config.clouds.iter().map(|(p, calls)| queue(*p, *calls));
        let queues = [queue(0, config.at_once)].into_iter().chain(clouds).collect();
        let replay = Self::default();
        let mut reader = ReplayReader { config, replay, queues, now: 0, crowded: None };
        let mut input = None;
        let mut decisions = Vec::new();
        loop {
            match events.next_event() {
                Ok(Some(event)) => {
                    judge.line(events.line(), &event);
                    match event {
                        Event::Decision(decision) => decisions.push(decision),
                        Event::Input(next) => {
                            if let Some(input) = input.replace(next) {
                                reader.step(&input, &decisions);
                            }
                            decisions.clear();
                        }
                    }
                }
                Ok(None) => break,
                Err(error) => {
                    reader.replay.defect = Some(error.to_string());
                    break;
                }
            }
        }
        if let Some(input) = input {
            reader.step(&input, &decisions);
        }
        reader.replay.verdict = Some(judge.finish());
        reader.replay
    }

    /// Returns the message of this timestamp.
    #[must_use]
    pub fn message(&self, t: u64) -> Option<&OpenedMessage> {
        self.by_t.get(&t).map(|index| &self.opened[*index])
    }

    /// Returns the index in `items` of the item with this revision.
    #[must_use]
    pub fn item(&self, t: u64, revision: u32) -> Option<usize> {
        self.message(t)?.items.get(usize::try_from(revision).ok()?).copied()
    }
}

impl AdmittedRequest {
    /// Returns when the request was closed, if that was before it ended.
    #[must_use]
    pub fn closed(&self) -> Option<u64> {
        self.fired.into_iter().chain(self.cancelled).min()
    }
}

impl ReplayReader<'_> {
    fn step(&mut self, input: &Input, decisions: &[Decision]) {
        self.now = self.now.max(input.at());
        self.replay.end = self.now;
        self.crowds(input);
        let (fired, own) = split(input, decisions);
        if let Input::Offer { t, p, backlog, .. } = *input {
            let waiting = self.queue(p).map_or(0, |queue| self.queues[queue].waiting.len());
            if waiting as u64 != backlog {
                let reported =
                    format!("{t} was offered to {p} with backlog {backlog}, {waiting} wait");
                self.replay.wrong_backlogs.push(reported);
            }
        }
        if let Input::Result { t, p, .. } | Input::Fail { t, p, .. } = *input {
            self.end(t, p, matches!(input, Input::Result { .. }));
        }
        for decision in fired {
            self.decide(decision, Trigger::Timer, input, &[]);
        }
        let trigger = match input {
            Input::Fail { .. } => Trigger::Failure,
            _ => Trigger::Arrival,
        };
        self.open(input, own);
        if let Input::Fail { t, p, .. } = *input
            && !own.iter().any(|decision| matches!(decision, Decision::Drop { .. }))
            && let Some(index) = self.replay.by_t.get(&t)
        {
            self.replay.opened[*index].failures.push(short(p));
        }
        for decision in own {
            self.decide(decision, trigger, input, own);
        }
        self.start();
    }

    /// Opens a message and gives it to local. If local has no room for it, a computation must fail
    /// next (F1).
    fn open(&mut self, input: &Input, own: &[Decision]) {
        let Input::Open { at, t, deadline } = *input else { return };
        let replay = &mut self.replay;
        replay.by_t.insert(t, replay.opened.len());
        let (items, failures) = (Vec::new(), Vec::new());
        replay.opened.push(OpenedMessage { t, at, deadline, end: None, items, failures });
        if own.is_empty() {
            let due = deadline.map(|deadline| self.now.saturating_add(deadline));
            self.admit(0, 0, t, due);
            self.crowded = Some(t);
        }
    }

    /// Checks that the oldest computation fails if too many wait for local.
    fn crowds(&mut self, input: &Input) {
        let Some(t) = self.crowded else { return };
        if matches!(input, Input::Offer { t: of, .. } if *of == t) {
            return;
        }
        self.crowded = None;
        let waiting = self.queues[0].waiting.len();
        let bound = self.config.waiting;
        // The oldest computation is discarded (D17).
        let oldest = self.queues[0].waiting.front().map(|index| self.replay.requested[*index].t);
        let fails = matches!(input, Input::Fail { t: of, p: 0, .. } if Some(*of) == oldest);
        if waiting > bound && !fails {
            let reported = format!("{waiting} wait for local, which is bounded by {bound}");
            self.replay.wrong_room.push(reported);
        }
    }

    fn admit(&mut self, queue: usize, p: u16, t: u64, due: Option<u64>) {
        self.queues[queue].waiting.push_back(self.replay.requested.len());
        self.replay.requested.push(AdmittedRequest {
            p,
            t,
            at: self.now,
            due,
            started: None,
            fired: None,
            cancelled: None,
            ended: None,
            skipped: false,
        });
    }

    /// Records the decision on the offer in the input.
    fn offer(&mut self, input: &Input, refusal: Option<OfferRefusal>) {
        if let Input::Offer { t, p, deadline, .. } = *input {
            self.replay.offers.push(DecidedOffer { t, p: short(p), deadline, refusal });
        }
    }

    /// Records the result or failure of the source's own call.
    fn end(&mut self, t: u64, p: u64, is_result: bool) {
        if let Some(queue) = self.queue(p)
            && let Some(requested) = self.take(queue, t)
        {
            self.replay.requested[requested].ended = Some((self.now, is_result));
        } else if let Some(requested) = self
            .replay
            .requested
            .iter_mut()
            .rev()
            .find(|requested| u64::from(requested.p) == p && requested.t == t)
        {
            // It came although the request was closed: it lingered, or came together with its
            // timer.
            requested.ended.get_or_insert((self.now, is_result));
        }
    }

    /// Records a decision. `own` has the decisions about the input itself, if this is one of them.
    fn decide(&mut self, decision: &Decision, trigger: Trigger, input: &Input, own: &[Decision]) {
        match *decision {
            Decision::Timer { at, t, p } => {
                if p > 0
                    && let Some(queue) = self.queue(p)
                {
                    self.take(queue, t);
                }
                self.mark(t, p, |requested| requested.fired = Some(at));
            }
            Decision::Cancel { at, t, p } => {
                if let Some(queue) = self.queue(p) {
                    self.take(queue, t);
                }
                self.mark(t, p, |requested| requested.cancelled = Some(at));
            }
            Decision::Request { t, p, due, .. } => {
                self.offer(input, None);
                if let Some(queue) = self.queue(p) {
                    self.admit(queue, short(p), t, Some(due));
                }
            }
            Decision::RefuseOffer { why, .. } => self.offer(input, Some(why)),
            Decision::Emit { at, t, p } => {
                let is_end = |it: &Decision| matches!(it, Decision::Final { .. });
                let is_last = self.config.commit != Commit::Progressive || own.iter().any(is_end);
                let departure = if is_last {
                    Departure::Forwarded(short(p), trigger)
                } else {
                    Departure::Preliminary(short(p))
                };
                self.leave(at, t, departure);
            }
            // The output was already sent as the last one.
            Decision::Final { .. } if own.iter().any(|it| matches!(it, Decision::Emit { .. })) => {}
            Decision::Final { at, t, p } => self.leave(at, t, Departure::Final(short(p))),
            Decision::Miss { at, t } => self.leave(at, t, Departure::Missed),
            Decision::RefuseOpen { at, t, why } => self.leave(at, t, Departure::Refused(why)),
            Decision::Hold { p, .. } => self.replay.held.push(short(p)),
            Decision::Drop { at, t, p, why } => {
                let is_result = matches!(input, Input::Result { .. });
                self.replay.dropped.push(DroppedResult { at, t, p: short(p), why, is_result });
            }
        }
    }

    fn leave(&mut self, at: u64, t: u64, departure: Departure) {
        let Some(index) = self.replay.by_t.get(&t).copied() else { return };
        let message = &mut self.replay.opened[index];
        if !matches!(departure, Departure::Preliminary(_)) {
            message.end = Some(departure);
        }
        message.items.push(self.replay.items.len());
        let failures = message.failures.len();
        self.replay.items.push(DecidedItem { message: index, at, departure, failures });
        let waits = |queue: &ReplayQueue, requested: &[AdmittedRequest]| {
            queue.waiting.iter().position(|index| requested[*index].t == t)
        };
        if self.config.skip_answered
            && let Some(at) = waits(&self.queues[0], &self.replay.requested)
            && let Some(requested) = self.queues[0].waiting.remove(at)
        {
            self.replay.requested[requested].skipped = true;
        }
    }

    /// Starts waiting requests, in their order, while there is room.
    fn start(&mut self) {
        for queue in &mut self.queues {
            while queue.flying.len() < queue.at_once
                && let Some(requested) = queue.waiting.pop_front()
            {
                self.replay.requested[requested].started = Some(self.now);
                queue.flying.push(requested);
            }
        }
    }

    /// Removes a request from the calls under way, or from its queue.
    fn take(&mut self, queue: usize, t: u64) -> Option<usize> {
        let requested = &self.replay.requested;
        let ReplayQueue { waiting, flying, .. } = &mut self.queues[queue];
        if let Some(index) = flying.iter().position(|index| requested[*index].t == t) {
            return Some(flying.remove(index));
        }
        let index = waiting.iter().position(|index| requested[*index].t == t)?;
        waiting.remove(index)
    }

    fn mark(&mut self, t: u64, p: u64, mark: impl FnOnce(&mut AdmittedRequest)) {
        let is_it =
            |requested: &&mut AdmittedRequest| requested.t == t && u64::from(requested.p) == p;
        if let Some(requested) = self.replay.requested.iter_mut().rev().find(is_it) {
            mark(requested);
        }
    }

    fn queue(&self, p: u64) -> Option<usize> {
        self.queues.iter().position(|queue| u64::from(queue.p) == p)
    }
}

/// Converts a priority. The priorities of the engine's requests fit.
fn short(p: u64) -> u16 {
    u16::try_from(p).unwrap_or(u16::MAX)
}
