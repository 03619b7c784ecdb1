//! What a step can show: the sightings that the environment reaches every rule, reason and promise.

use fuseline_core::Priority;
use fuseline_kit::History;
use fuseline_traces::{Commit, Decision, DropReason, Input, OfferRefusal, OpenRefusal};

use crate::machine::{Fired, Reaction};
use crate::operator::Operator;
use crate::property::properties;
use crate::state::State;
use crate::world::World;

properties! {
    /// Something that a step shows. Each is a `sometimes` property: in some state that can be
    /// reached, some input shows it.
    Sighting,
    /// A set of sightings.
    Sightings,
    sometimes: Operator::shows;
    ClockBack = "F0 shown: a clock that goes back stays",
    TimerFirst = "F0 shown: a timer due at a result's instant is served before it",
    OpenLimited = "F1 shown: accepted with a deadline",
    OpenFree = "F1 shown: accepted without a deadline",
    OpenOrder = "F1 shown: refused for order",
    OpenFull = "F1 shown: refused for a full window",
    OpenDeadline = "F1 shown: refused for its deadline",
    OpenRoom = "F1 shown: accepted for the room that a timer makes at its instant",
    OfferAdmitted = "F2 shown: admitted",
    OfferJoins = "F2 shown: admitted above what is held",
    OfferUnknownCloud = "F2 shown: refused for an unknown cloud",
    OfferUnknownTimestamp = "F2 shown: refused for an unknown timestamp",
    OfferClosed = "F2 shown: refused for a closed timestamp",
    OfferDuplicate = "F2 shown: refused as a duplicate",
    OfferOutranked = "F2 shown: refused as outranked",
    OfferDeadline = "F2 shown: refused for its deadline",
    GateShuts = "F2g shown: the gate shuts",
    GateStays = "F2g shown: the shut gate stays shut below its limit",
    GateOpens = "F2g shown: the shut gate opens",
    ResultUnknown = "F3 shown: dropped as unknown",
    ResultSuperseded = "F3 shown: dropped as superseded",
    ResultUnsolicited = "F3 shown: dropped as unsolicited",
    ResultDuplicate = "F3 shown: dropped as a duplicate",
    ResultLate = "F3 shown: dropped as late",
    ResultHeld = "F3 shown: held",
    ResultForwarded = "F3 shown: forwarded over others in hand",
    FailUnknown = "F4 shown: dropped as unknown",
    FailSuperseded = "F4 shown: dropped as superseded",
    FailUnsolicited = "F4 shown: dropped as unsolicited",
    FailDuplicate = "F4 shown: dropped as a duplicate",
    FailLate = "F4 shown: dropped as late",
    FailWaits = "F4 shown: accepted, and others are pending",
    FailForwards = "F4 shown: accepted, and the best in hand goes",
    FailMisses = "F4 shown: accepted, and the timestamp is missed",
    TimersTogether = "F5 shown: several timers of a timestamp fire as one",
    TimestampsTogether = "F5 shown: several timestamps are due at one instant",
    LimitAlone = "F5 shown: local's timer fires alone",
    LimitWithCloud = "F5 shown: local's timer fires with a cloud's timer",
    EagerOverPending = "F6 shown: eager, a timer commits although a better one is pending",
    EagerOwn = "F6 shown: eager, a held result's own timer commits it",
    LimitHolds = "F6 shown: eager, local's timer commits nothing",
    PatientWaits = "F6 shown: patient, a timer commits nothing while a better one is pending",
    TimerForwards = "F6 shown: a timer closes the last that outranked the best in hand",
    TimerWaits = "F6 shown: a timer finds nothing in hand, and others are pending",
    TimerMisses = "F6 shown: a timer finds nothing in hand and nothing pending",
    Cancelled = "F7 shown: a pending call is cancelled",
    LocalPending = "F7 shown: local is pending, and is not cancelled",
    Stranger = "F8 shown: a priority beyond 16 bits gets an answer",
    Once = "P1 shown: a result comes for what its instant forwarded",
    LastInstant = "P2 shown: a result of the last instant before its due one is taken",
    DueInstant = "P2 shown: a result of its due instant is dropped",
    BestOfTwo = "P3 shown: the better of two in hand is forwarded",
    Prompt = "P4 shown: something is held under something pending",
    Floor = "P5 shown: local's held result is forwarded by the latest due instant",
    Free = "P6 shown: local's result is forwarded at once without a request",
    LimitRetires = "P7 shown: a timestamp with a deadline is retired by its latest due instant",
    StaysArmed = "P8 shown: eager, a held result's timer stays live",
    Disarmed = "P8 shown: patient, a held result's timer is disarmed",
    Retired = "P8 shown: a live timer goes with its timestamp",
    WindowFull = "P9 shown: the window is full",
    DuesPassed = "P10 shown: one input passes several due instants",
    Discarded = "P11 shown: a held result is discarded",
    LastRequest = "P12 shown: local's result is in hand, and the last request's due instant ends the wait",
    LastLocal = "P12 shown: every request's due instant is past, and local's arrival ends the wait",
}

/// What one step shows.
pub(crate) fn sightings(
    config: &World,
    before: &State,
    input: &Input,
    answer: &Reaction,
    after: &State,
) -> Sightings {
    let mut shown = Sightings::default();
    if input.at() < before.ledger.now() {
        shown.insert(Sighting::ClockBack);
    }
    let instants = answer.fired.windows(2);
    for pair in instants {
        if let [first, second] = pair {
            shown.insert_if(Sighting::DuesPassed, first.due != second.due);
            let apart = first.due == second.due && first.t != second.t;
            shown.insert_if(Sighting::TimestampsTogether, apart);
        }
    }
    for (place, fired) in answer.fired.iter().enumerate() {
        // An earlier firing of the same timestamp would have changed its history.
        let is_first = answer.fired.iter().take(place).all(|other| other.t != fired.t);
        if let Some(history) = before.ledger.history(fired.t).filter(|_| is_first) {
            of_firing(config, history, fired, &mut shown);
        }
    }
    of_input(config, before, input, answer, after, &mut shown);
    let open = after.ledger.open();
    shown.insert_if(Sighting::WindowFull, open.len() == usize::from(config.window));
    shown.insert_if(Sighting::Prompt, open.iter().any(|(_, history)| history.best().is_some()));
    shown
}

/// What the first firing of a timestamp shows.
fn of_firing(config: &World, history: &History, fired: &Fired, shown: &mut Sightings) {
    let eager = config.commit == Commit::Eager;
    let timers = || {
        fired.decisions.iter().filter_map(|decision| match decision {
            Decision::Timer { p, .. } => Some(*p),
            _ => None,
        })
    };
    let local = timers().any(|p| p == 0);
    let cloud = timers().any(|p| p > 0);
    let better = history.best().is_some_and(|best| {
        history.pending().any(|p| p > best && timers().all(|timer| timer != p))
    });
    shown.insert_if(Sighting::TimersTogether, timers().count() > 1);
    shown.insert_if(Sighting::LimitAlone, local && !cloud);
    shown.insert_if(Sighting::LimitWithCloud, local && cloud);
    let last = history.timers().all(|(_, due)| due <= fired.due);
    let output = fired
        .decisions
        .iter()
        .find(|decision| matches!(decision, Decision::Emit { .. } | Decision::Miss { .. }));
    match output {
        Some(Decision::Emit { p, .. }) => {
            shown.insert_if(Sighting::EagerOverPending, eager && better);
            shown.insert_if(Sighting::EagerOwn, eager && timers().any(|timer| timer == *p));
            shown.insert_if(Sighting::TimerForwards, !better);
            shown.insert_if(Sighting::Floor, *p == 0 && last);
            of_emit(history, None, &fired.decisions, shown);
        }
        Some(_) => shown.insert(Sighting::TimerMisses),
        None => {
            let held = history.best().is_some();
            shown.insert_if(Sighting::LimitHolds, eager && held && !cloud);
            shown.insert_if(Sighting::PatientWaits, !eager && held && cloud);
            shown.insert_if(Sighting::TimerWaits, !held);
        }
    }
    let waits = history.is_held(0) && !history.are_requests_over(fired.due.saturating_sub(1));
    let over = history.are_requests_over(fired.due);
    shown.insert_if(Sighting::LastRequest, output.is_some() && waits && over);
    let limited = history.due(0).is_some();
    shown.insert_if(Sighting::LimitRetires, output.is_some() && limited && last);
}

/// What a forwarding shows; `came` is the result that brought it about.
fn of_emit(history: &History, came: Option<u64>, decisions: &[Decision], shown: &mut Sightings) {
    let cancels = decisions.iter().any(|decision| matches!(decision, Decision::Cancel { .. }));
    let fired = |p| decisions.iter().any(|d| matches!(d, Decision::Timer { p: q, .. } if *q == p));
    shown.insert_if(Sighting::Cancelled, cancels);
    shown.insert_if(Sighting::LocalPending, history.is_pending(0) && came != Some(0) && !fired(0));
    shown.insert_if(Sighting::Retired, history.timers().any(|(p, _)| came != Some(p) && !fired(p)));
    let others = usize::from(came.is_none());
    shown.insert_if(Sighting::Discarded, history.held().count() > others);
    shown.insert_if(Sighting::BestOfTwo, came.is_none() && history.held().count() > 1);
}

/// What the input's own decisions show.
fn of_input(
    config: &World,
    before: &State,
    input: &Input,
    answer: &Reaction,
    after: &State,
    shown: &mut Sightings,
) {
    let decision = answer.own.first();
    if let Input::Result { t, p: 0, .. } | Input::Fail { t, p: 0, .. } = *input {
        let now = after.ledger.now();
        let waited =
            |history: &History| !history.is_local_alone() && history.are_requests_over(now);
        let ends = matches!(decision, Some(Decision::Emit { .. } | Decision::Miss { .. }));
        let is_last = ends && before.ledger.history(t).is_some_and(waited);
        shown.insert_if(Sighting::LastLocal, is_last);
    }
    match *input {
        Input::Open { deadline, .. } => {
            if let Some(Decision::RefuseOpen { why, .. }) = decision {
                shown.insert(open_refused(*why));
            } else {
                shown.insert(if deadline.is_some() {
                    Sighting::OpenLimited
                } else {
                    Sighting::OpenFree
                });
                let full = before.ledger.open().len() == before.machine.fusion().window();
                shown.insert_if(Sighting::OpenRoom, full);
            }
        }
        Input::Offer { t, p, backlog, .. } => {
            let low = config.cloud(p).is_some_and(|cloud| backlog < cloud.limit);
            of_offer(before, (t, p), low, answer, after, shown);
        }
        Input::Result { t, p, .. } => of_result(before, (t, p), answer, after, shown),
        Input::Fail { t, p, .. } => {
            shown.insert_if(Sighting::Stranger, p > u64::from(u16::MAX));
            shown.insert(match decision {
                Some(Decision::Drop { why, .. }) => fail_dropped(*why),
                Some(Decision::Miss { .. }) => Sighting::FailMisses,
                Some(_) => Sighting::FailForwards,
                None => Sighting::FailWaits,
            });
            if let (Some(history), Some(Decision::Emit { .. })) =
                (before.ledger.history(t).filter(|_| answer.fired.is_empty()), decision)
            {
                of_emit(history, None, &answer.own, shown);
            }
        }
        Input::Tick { .. } => {}
    }
}

fn of_offer(
    before: &State,
    (t, p): (u64, u64),
    below_limit: bool,
    answer: &Reaction,
    after: &State,
    shown: &mut Sightings,
) {
    let cloud = u16::try_from(p).ok().map(Priority::new);
    let was_shut =
        cloud.and_then(|p| before.machine.fusion().gate(p)).is_some_and(|gate| gate.is_shut());
    if let Some(Decision::RefuseOffer { why, .. }) = answer.own.first() {
        let gate = if was_shut { Sighting::GateStays } else { Sighting::GateShuts };
        let gate = (below_limit || !was_shut).then_some(gate);
        shown.extend(offer_refused(*why, after.ledger.was_reached(t), gate));
    } else {
        shown.insert(Sighting::OfferAdmitted);
        let held = before.ledger.history(t).is_some_and(|history| history.best().is_some());
        shown.insert_if(Sighting::OfferJoins, held);
        shown.insert_if(Sighting::GateOpens, was_shut);
    }
}

fn of_result(
    before: &State,
    (t, p): (u64, u64),
    answer: &Reaction,
    after: &State,
    shown: &mut Sightings,
) {
    let now = after.ledger.now();
    let history = before.ledger.history(t);
    let due = history.and_then(|history| history.due(p));
    let is_taken = !matches!(answer.own.first(), Some(Decision::Drop { .. }));
    shown.insert_if(
        Sighting::LastInstant,
        is_taken && due.is_some_and(|due| now.checked_add(1) == Some(due)),
    );
    shown.insert_if(Sighting::DueInstant, !is_taken && due == Some(now));
    shown.insert_if(
        Sighting::TimerFirst,
        answer.fired.iter().any(|fired| fired.t == t && fired.due == now),
    );
    match answer.own.first() {
        Some(Decision::Drop { why, .. }) => {
            shown.insert(result_dropped(*why));
            let forwarded = answer.fired.iter().flat_map(|fired| &fired.decisions);
            let just = forwarded.filter(|d| matches!(d, Decision::Emit { .. })).any(|d| d.t() == t);
            shown.insert_if(Sighting::Once, just);
        }
        Some(Decision::Hold { .. }) => {
            shown.insert(Sighting::ResultHeld);
            let live = after.ledger.history(t).is_some_and(|history| history.due(p).is_some());
            shown.insert_if(Sighting::StaysArmed, p > 0 && live);
            shown.insert_if(Sighting::Disarmed, p > 0 && !live);
        }
        _ => {
            if let Some(history) = history.filter(|_| answer.fired.is_empty()) {
                shown.insert_if(Sighting::Free, history.is_local_alone());
                shown.insert_if(Sighting::ResultForwarded, history.best().is_some());
                of_emit(history, Some(p), &answer.own, shown);
            }
        }
    }
}

/// The sighting of a refused open.
fn open_refused(why: OpenRefusal) -> Sighting {
    match why {
        OpenRefusal::Order => Sighting::OpenOrder,
        OpenRefusal::Full => Sighting::OpenFull,
        OpenRefusal::Deadline => Sighting::OpenDeadline,
    }
}

/// The sighting of a refused offer; `gate` is that of its gate.
fn offer_refused(why: OfferRefusal, reached: bool, gate: Option<Sighting>) -> Option<Sighting> {
    match why {
        OfferRefusal::Unknown if reached => Some(Sighting::OfferUnknownCloud),
        OfferRefusal::Unknown => Some(Sighting::OfferUnknownTimestamp),
        OfferRefusal::Closed => Some(Sighting::OfferClosed),
        OfferRefusal::Duplicate => Some(Sighting::OfferDuplicate),
        OfferRefusal::Outranked => Some(Sighting::OfferOutranked),
        OfferRefusal::Deadline => Some(Sighting::OfferDeadline),
        OfferRefusal::Queue => gate,
    }
}

fn result_dropped(why: DropReason) -> Sighting {
    match why {
        DropReason::Unknown => Sighting::ResultUnknown,
        DropReason::Superseded => Sighting::ResultSuperseded,
        DropReason::Unsolicited => Sighting::ResultUnsolicited,
        DropReason::Duplicate => Sighting::ResultDuplicate,
        DropReason::Late => Sighting::ResultLate,
    }
}

fn fail_dropped(why: DropReason) -> Sighting {
    match why {
        DropReason::Unknown => Sighting::FailUnknown,
        DropReason::Superseded => Sighting::FailSuperseded,
        DropReason::Unsolicited => Sighting::FailUnsolicited,
        DropReason::Duplicate => Sighting::FailDuplicate,
        DropReason::Late => Sighting::FailLate,
    }
}
