//! The observations from outside of the operator. The simulated parts write them, and the checks
//! read them.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use fuseline_engine::{Trigger, lock};
use fuseline_tokio::deadline::{End, LinkDirection};
use fuseline_tokio::{DropReason, Ending, Forwarded, Hint, Item, OpenRefusal};
use fuseline_traces::nanos;
use tokio::time::Instant;

use crate::simulate::link::EmulatedLink;
use crate::simulate::scenario::{Scenario, ScenarioLink};
use crate::simulate::value::{InstanceCounts, ResultValue, ValueLabel};

/// The state that all simulated parts share.
pub(crate) struct SimulationState {
    pub(crate) scenario: Scenario,
    start: Instant,
    log: Mutex<Log>,
    link: EmulatedLink,
    pub(crate) frames: InstanceCounts,
    pub(crate) values: InstanceCounts,
}

/// The observations in the order in which they happened. Instants are nanoseconds of the operator's
/// clock.
#[derive(Default, PartialEq, Debug)]
pub(crate) struct Log {
    /// The message's number and the instant of its writing, by timestamp.
    pub(crate) written: Vec<(usize, u64)>,
    /// The message handlers that were called: cloud and timestamp.
    pub(crate) requested: Vec<(u16, u64)>,
    /// The calls and local computations.
    pub(crate) calls: Vec<LoggedCall>,
    /// The items that each reader read.
    pub(crate) items: Vec<Vec<Read>>,
    /// `true` for each reader that left.
    pub(crate) has_left: Vec<bool>,
    pub(crate) hints: Vec<LoggedHint>,
    /// The ends that policies were told, by the clouds' priorities.
    pub(crate) ends: Vec<(u16, End)>,
    /// The side requests: how many the handler offered, how many are under way, the most that were,
    /// and how many responses reached the response handler.
    pub(crate) sides: [usize; 4],
    /// The messages that were given to the link, in order.
    pub(crate) link: Vec<LinkPass>,
    /// The stalls of the process: from, to.
    pub(crate) stalls: Vec<(u64, u64)>,
    /// The instant when the operator was stopped or the runtime was dropped.
    pub(crate) stopped: Option<u64>,
    /// The number of items that each reader had read then; `None` for those that had left.
    pub(crate) read: Vec<Option<usize>>,
    /// The instant from which the simulation is over and drops what is left.
    pub(crate) over: Option<u64>,
}

/// A call or a local computation.
#[derive(PartialEq, Debug)]
pub(crate) struct LoggedCall {
    pub(crate) p: u16,
    pub(crate) t: u64,
    pub(crate) serial: usize,
    pub(crate) begun: u64,
    /// The time left that it was given; `None` for local.
    pub(crate) time_left: Option<Duration>,
    /// `true` if the link had no room for its request.
    pub(crate) has_no_room: bool,
    /// The instant and the way in which it ended.
    pub(crate) end: Option<(u64, CallStop)>,
}

/// A request or a result on the link.
#[derive(PartialEq, Debug)]
pub(crate) struct LinkPass {
    pub(crate) direction: LinkDirection,
    pub(crate) at: u64,
    /// The instant when it was through or found no room; `None` if it was given up.
    pub(crate) end: Option<(u64, bool)>,
}

/// States how a call ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum CallStop {
    Answered,
    Failed,
    /// Others dropped it.
    DroppedResult,
}

/// An item, as it was read.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Read {
    pub(crate) t: u64,
    /// The instant when it was read.
    pub(crate) at: u64,
    pub(crate) opened: u64,
    pub(crate) decided: u64,
    pub(crate) revision: u32,
    pub(crate) is_last: bool,
    pub(crate) outcome: LoggedOutcome,
    /// The sources whose failures were accepted, with the reasons.
    pub(crate) failures: Vec<(u16, Arc<str>)>,
}

/// States how a message ended.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum LoggedOutcome {
    Preliminary(LoggedResult),
    Forwarded(LoggedResult),
    Final(u16),
    Missed,
    Refused(OpenRefusal),
}

/// A result that was forwarded.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct LoggedResult {
    pub(crate) reported: ValueLabel,
    pub(crate) p: u16,
    pub(crate) name: Arc<str>,
    pub(crate) arrived: u64,
    pub(crate) trigger: Trigger,
}

/// A hint.
#[derive(PartialEq, Debug)]
pub(crate) struct LoggedHint {
    pub(crate) at: u64,
    pub(crate) t: u64,
    pub(crate) p: u16,
    pub(crate) reported: ValueLabel,
    pub(crate) age: Duration,
    pub(crate) why: DropReason,
}

impl SimulationState {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let readers = scenario.readers.len();
        let log = Log {
            items: vec![Vec::new(); readers],
            has_left: vec![false; readers],
            ..Log::default()
        };
        Self {
            scenario: scenario.clone(),
            start: Instant::now(),
            log: Mutex::new(log),
            link: link(scenario.link),
            frames: InstanceCounts::default(),
            values: InstanceCounts::default(),
        }
    }

    pub(crate) fn now(&self) -> u64 {
        nanos(self.start.elapsed())
    }

    pub(crate) fn at(&self, since_start: Duration) -> Instant {
        self.start + since_start
    }

    pub(crate) fn log(&self) -> MutexGuard<'_, Log> {
        lock(&self.log)
    }

    /// Waits until a request or a result is through the link, if there is one. Returns `true` if it
    /// found room.
    pub(crate) async fn pass(&self, direction: LinkDirection) -> bool {
        let Some(ScenarioLink { bytes, .. }) = self.scenario.link else { return true };
        let at = self.now();
        let index = self.log().begin_pass(LinkPass { direction, at, end: None });
        let has_room = self.link.pass(direction, bytes[direction as usize]).await;
        let now = self.now();
        self.log().link[index].end = Some((now, has_room));
        has_room
    }

    pub(crate) fn read(&self, reader: usize, item: &Item<ResultValue>) {
        let result = |forwarded: &Forwarded<ResultValue>| LoggedResult {
            reported: forwarded.value.reported,
            p: forwarded.source.priority,
            name: Arc::clone(&forwarded.source.name),
            arrived: nanos(forwarded.arrived),
            trigger: forwarded.trigger,
        };
        let outcome = match &item.ending {
            Ending::Preliminary(forwarded) => LoggedOutcome::Preliminary(result(forwarded)),
            Ending::Forwarded(forwarded) => LoggedOutcome::Forwarded(result(forwarded)),
            Ending::Final(source) => LoggedOutcome::Final(source.priority),
            Ending::Missed => LoggedOutcome::Missed,
            Ending::Refused(why) => LoggedOutcome::Refused(*why),
        };
        let failures = item.failures.iter();
        let read = Read {
            t: item.timestamp,
            at: self.now(),
            opened: nanos(item.opened),
            decided: nanos(item.decided),
            revision: item.revision,
            is_last: item.is_last(),
            outcome,
            failures: failures.map(|it| (it.source.priority, Arc::clone(&it.why))).collect(),
        };
        self.log().items[reader].push(read);
    }

    pub(crate) fn record_hint(&self, hint: &Hint<ResultValue>) {
        let received = LoggedHint {
            at: self.now(),
            t: hint.timestamp,
            p: hint.source.priority,
            reported: hint.value.reported,
            age: hint.age,
            why: hint.why,
        };
        self.log().hints.push(received);
    }
}

impl LoggedOutcome {
    /// Returns the result, if there is one.
    pub(crate) const fn result(&self) -> Option<&LoggedResult> {
        match self {
            Self::Preliminary(result) | Self::Forwarded(result) => Some(result),
            Self::Final(_) | Self::Missed | Self::Refused(_) => None,
        }
    }
}

impl Log {
    /// Notes that the operator is stopped or the runtime is dropped.
    pub(crate) fn stop(&mut self, at: u64) {
        let read = |(items, has_left): (&Vec<Read>, &bool)| (!has_left).then_some(items.len());
        self.read = self.items.iter().zip(&self.has_left).map(read).collect();
        self.stopped = Some(at);
    }

    /// Adds a message to the link's log. Returns its index.
    fn begin_pass(&mut self, pass: LinkPass) -> usize {
        self.link.push(pass);
        self.link.len() - 1
    }

    /// Returns how long the process stood still between two instants.
    pub(crate) fn stalled(&self, from: u64, to: u64) -> u64 {
        let overlap = |(begun, ended): &(u64, u64)| to.min(*ended).saturating_sub(from.max(*begun));
        self.stalls.iter().map(overlap).sum()
    }
}

fn link(scenario: Option<ScenarioLink>) -> EmulatedLink {
    let (rates, queue_bytes) = scenario.map_or(([0; 2], 0), |it| (it.rates, it.queue_bytes));
    EmulatedLink::new(queue_bytes, rates)
}
