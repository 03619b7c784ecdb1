//! Records states and steps as lines: the configuration as a header, the state so far behind a `#`, inputs
//! and decisions.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::format;
use std::string::String;
use std::thread_local;
use std::vec::Vec;

use fuseline_traces as trace;

use crate::fusion::{At, Fusion};
use crate::priority::Priority;
use crate::slot::{Cause, Commit, Decision, Slot};
use crate::source::{Source, Sources};
use crate::time::{Deadline, Instant, Timestamp};
use crate::{Admission, DropReason, OfferRefusal, OpenRefusal, Opening, Outcome};

#[derive(Default)]
struct Recording {
    lines: Vec<String>,
    /// The commit rule of the last header.
    commit: Option<Commit>,
    /// The machine's clock, which is the instant of decisions.
    now: u64,
}

thread_local! {
    static RECORDING: RefCell<Recording> = RefCell::default();
}

/// Returns what was recorded since the last call.
#[must_use]
pub fn take() -> Vec<String> {
    RECORDING.take().lines
}

fn push(line: String) {
    RECORDING.with_borrow_mut(|recording| recording.lines.push(line));
}

fn write(line: &trace::Line) {
    let mut out = Vec::new();
    line.write(&mut out);
    push(String::from_utf8_lossy(&out).into_owned());
}

/// Writes a header before the first step, and when the commit rule changes. Otherwise all machines of a
/// harness have one configuration.
fn header(window: usize, commit: Commit, clouds: Vec<trace::Cloud>) {
    let last = RECORDING.with_borrow_mut(|recording| recording.commit.replace(commit));
    if last != Some(commit) {
        let commit = match commit {
            Commit::Eager => trace::Commit::Eager,
            Commit::Patient => trace::Commit::Patient,
            Commit::Progressive => trace::Commit::Progressive,
        };
        let window = u16::try_from(window).unwrap_or(u16::MAX);
        write(&trace::Line::Header(trace::Header { operator: None, window, commit, clouds }));
    }
}

fn input(input: trace::Input) {
    write(&trace::Line::Event(trace::Event::Input(input)));
}

fn decision(decision: trace::Decision) {
    let now = RECORDING.with_borrow(|recording| recording.now);
    write(&trace::Line::Event(trace::Event::Decision(decision.redated(now))));
}

fn sets(slot: Slot) -> String {
    let (requested, pending) = (slot.requested(), slot.pending());
    let (armed, cached) = (slot.armed(), slot.cached());
    format!("requested {requested:?} pending {pending:?} armed {armed:?} cached {cached:?}")
}

fn of(source: Source) -> u64 {
    source.index().into()
}

/// Records the sets as indices of sources, which here are also the priorities.
pub(crate) fn slot(slot: Slot, commit: Commit, (cause, meant): (trace::Input, Sources)) {
    let clouds = slot.requested().union(meant).clouds();
    let cloud =
        |source: Source| trace::Cloud { p: source.index().into(), name: None, limit: 1, resume: 0 };
    header(1, commit, clouds.iter().map(cloud).collect());
    push(format!("# t 1: {}", sets(slot)));
    RECORDING.with_borrow_mut(|recording| recording.now = 0);
    input(cause);
}

pub(crate) fn of_cause(cause: Cause) -> (trace::Input, Sources) {
    match cause {
        Cause::Result(source) => {
            (trace::Input::Result { at: 0, t: 1, p: of(source) }, Sources::EMPTY.with(source))
        }
        Cause::Failure(source) => {
            (trace::Input::Fail { at: 0, t: 1, p: of(source) }, Sources::EMPTY.with(source))
        }
        Cause::Timers(_) => (trace::Input::Tick { at: 0 }, Sources::EMPTY),
    }
}

pub(crate) fn of_offer(source: Source) -> (trace::Input, Sources) {
    let offer = trace::Input::Offer { at: 0, t: 1, p: of(source), deadline: 1, backlog: 0 };
    (offer, Sources::EMPTY.with(source))
}

pub(crate) fn stepped(before: Slot, cause: Cause, decided: Decision) {
    let p = match cause {
        Cause::Result(source) | Cause::Failure(source) => of(source),
        Cause::Timers(fired) => {
            for source in fired.intersection(before.armed()).iter() {
                decision(trace::Decision::Timer { at: 0, t: 1, p: of(source) });
            }
            0
        }
    };
    match decided {
        Decision::Dropped(why) => drop(1, p, why),
        Decision::Held => decision(trace::Decision::Hold { at: 0, t: 1, p }),
        Decision::Waiting => {}
        Decision::Missed => decision(trace::Decision::Miss { at: 0, t: 1 }),
        Decision::Preliminary { by, cancelled } => {
            emit(1, of(by), cancelled.iter().map(of).collect());
        }
        Decision::Final { by } => decision(trace::Decision::Final { at: 0, t: 1, p: of(by) }),
        Decision::Forwarded { by, cancelled } => {
            emit_last(1, of(by), cancelled.iter().map(of).collect());
        }
    }
}

pub(crate) fn offered(source: Source, refusal: Option<OfferRefusal>) {
    match refusal {
        Some(why) => refuse(1, of(source), why),
        None => decision(trace::Decision::Request { at: 0, t: 1, p: of(source), due: 1 }),
    }
}

fn machine<const CLOUDS: usize, const WINDOW: usize>(fusion: &Fusion<CLOUDS, WINDOW>) {
    let clouds = fusion.clouds.entries().map(|(priority, gate)| trace::Cloud {
        p: priority.as_u16(),
        name: None,
        limit: gate.limit,
        resume: gate.resume,
    });
    header(fusion.window, fusion.commit, clouds.collect());
    let newest = fusion.newest.map(Timestamp::as_u64);
    let mut state = format!("# now {}, newest {newest:?}", fusion.now.as_nanos());
    for (priority, gate) in fusion.clouds.entries() {
        if gate.is_shut() {
            let _ = write!(state, ", the gate of {} is shut", priority.as_u16());
        }
    }
    for (timestamp, slot) in fusion.open() {
        let dues: BTreeMap<u16, u64> = slot
            .armed()
            .iter()
            .map(|source| fusion.clouds.priority(source))
            .filter_map(|p| Some((p.as_u16(), fusion.due(timestamp, p)?.as_nanos())))
            .collect();
        let _ = write!(state, "; t {}: {} due {dues:?}", timestamp.as_u64(), sets(slot));
    }
    push(state);
    RECORDING.with_borrow_mut(|recording| recording.now = fusion.now.as_nanos());
}

pub(crate) fn tick<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    now: Instant,
) {
    machine(fusion);
    input(trace::Input::Tick { at: now.as_nanos() });
    RECORDING.with_borrow_mut(|recording| recording.now = recording.now.max(now.as_nanos()));
}

pub(crate) fn came_to<const CLOUDS: usize, const WINDOW: usize>(at: &At<'_, CLOUDS, WINDOW>) {
    if let At::Fired(firing) = at {
        let t = firing.timestamp.as_u64();
        for p in firing.timers.iter() {
            decision(trace::Decision::Timer { at: 0, t, p: p.as_u16().into() });
        }
        arrived((firing.timestamp, Priority::LOCAL), firing.outcome);
    }
}

pub(crate) fn open<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    timestamp: Timestamp,
    deadline: Option<Deadline>,
) {
    machine(fusion);
    let (at, t) = (fusion.now.as_nanos(), timestamp.as_u64());
    input(trace::Input::Open { at, t, deadline: deadline.map(Deadline::as_nanos) });
}

pub(crate) fn opened(timestamp: Timestamp, opening: Opening) {
    if let Opening::Refused(why) = opening {
        let why = match why {
            OpenRefusal::Order => trace::OpenRefusal::Order,
            OpenRefusal::Full => trace::OpenRefusal::Full,
            OpenRefusal::Deadline => trace::OpenRefusal::Deadline,
        };
        decision(trace::Decision::RefuseOpen { at: 0, t: timestamp.as_u64(), why });
    }
}

/// A timestamp and a source's priority.
type RequestId = (Timestamp, Priority);

pub(crate) fn offer<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    (timestamp, cloud): RequestId,
    deadline: Deadline,
    backlog: u64,
) {
    machine(fusion);
    let (t, p) = (timestamp.as_u64(), cloud.as_u16().into());
    let (at, deadline) = (fusion.now.as_nanos(), deadline.as_nanos());
    input(trace::Input::Offer { at, t, p, deadline, backlog });
}

pub(crate) fn admitted((timestamp, cloud): RequestId, admission: Admission) {
    let (t, p) = (timestamp.as_u64(), cloud.as_u16().into());
    match admission {
        Admission::Admitted { due } => {
            decision(trace::Decision::Request { at: 0, t, p, due: due.as_nanos() });
        }
        Admission::Refused(why) => refuse(t, p, why),
    }
}

pub(crate) fn result<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    (timestamp, priority): RequestId,
) {
    machine(fusion);
    let (at, t) = (fusion.now.as_nanos(), timestamp.as_u64());
    input(trace::Input::Result { at, t, p: priority.as_u16().into() });
}

pub(crate) fn fail<const CLOUDS: usize, const WINDOW: usize>(
    fusion: &Fusion<CLOUDS, WINDOW>,
    (timestamp, priority): RequestId,
) {
    machine(fusion);
    let (at, t) = (fusion.now.as_nanos(), timestamp.as_u64());
    input(trace::Input::Fail { at, t, p: priority.as_u16().into() });
}

pub(crate) fn arrived<const CLOUDS: usize>(
    (timestamp, priority): RequestId,
    outcome: Outcome<CLOUDS>,
) {
    let (t, p) = (timestamp.as_u64(), priority.as_u16().into());
    match outcome {
        Outcome::Dropped(why) => drop(t, p, why),
        Outcome::Held => decision(trace::Decision::Hold { at: 0, t, p }),
        Outcome::Waiting => {}
        Outcome::Missed => decision(trace::Decision::Miss { at: 0, t }),
        Outcome::Preliminary { by, cancelled } => {
            emit(t, by.as_u16().into(), cancelled.iter().map(|p| p.as_u16().into()).collect());
        }
        Outcome::Final { by } => {
            decision(trace::Decision::Final { at: 0, t, p: by.as_u16().into() });
        }
        Outcome::Forwarded { by, cancelled } => {
            emit_last(t, by.as_u16().into(), cancelled.iter().map(|p| p.as_u16().into()).collect());
        }
    }
}

/// Records an output that retires its timestamp. Under progressive a `final` follows it (F9).
fn emit_last(t: u64, by: u64, cancelled: Vec<u64>) {
    emit(t, by, cancelled);
    let commit = RECORDING.with_borrow(|recording| recording.commit);
    if commit == Some(Commit::Progressive) {
        decision(trace::Decision::Final { at: 0, t, p: by });
    }
}

fn emit(t: u64, by: u64, cancelled: Vec<u64>) {
    decision(trace::Decision::Emit { at: 0, t, p: by });
    for p in cancelled {
        decision(trace::Decision::Cancel { at: 0, t, p });
    }
}

fn drop(t: u64, p: u64, why: DropReason) {
    let why = match why {
        DropReason::Unknown => trace::DropReason::Unknown,
        DropReason::Superseded => trace::DropReason::Superseded,
        DropReason::Unsolicited => trace::DropReason::Unsolicited,
        DropReason::Duplicate => trace::DropReason::Duplicate,
        DropReason::Late => trace::DropReason::Late,
    };
    decision(trace::Decision::Drop { at: 0, t, p, why });
}

fn refuse(t: u64, p: u64, why: OfferRefusal) {
    let why = match why {
        OfferRefusal::Unknown => trace::OfferRefusal::Unknown,
        OfferRefusal::Closed => trace::OfferRefusal::Closed,
        OfferRefusal::Duplicate => trace::OfferRefusal::Duplicate,
        OfferRefusal::Outranked => trace::OfferRefusal::Outranked,
        OfferRefusal::Deadline => trace::OfferRefusal::Deadline,
        OfferRefusal::Queue => trace::OfferRefusal::Queue,
    };
    decision(trace::Decision::RefuseOffer { at: 0, t, p, why });
}
